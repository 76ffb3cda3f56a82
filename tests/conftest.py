"""For all tests: a runtime folder of a test's own, and the processor for whom time passes."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from ori_deploy import runtime_dir

# How long an example takes is the machine's affair. Everybody tries the same examples, so that a change is judged by
# what it changed; `make campaign` tries others every time.
settings.register_profile(
    "same", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True, database=None
)
settings.register_profile("other", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("same")

COMPUTING = (
    *("aero", "design", "docs", "export", "figures", "files", "firmware", "layout", "loads", "motion", "oracle"),
    *("profiles", "search", "sweep", "view", "cli/test_cones.py", "cli/test_optimise.py", "cli/test_sweep.py"),
    *("mav/test_stateful.py", "telemetry/test_replay.py", "test_gallery.py"),
)
"""Tests that wait for nothing but the processor."""


def pytest_configure() -> None:
    """Jobs in the background ignore interrupts, those of `nohup` hangups, and so would all that is started here."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Let tests that compute, and what they start, give way to those in which motions run in real time.

    There are more workers than processors. Only root may take a thread back from the idle policy.
    """
    place = item.path.relative_to(Path(__file__).parent)
    if os.geteuid() != 0 or not any(place.is_relative_to(one) for one in COMPUTING):
        return (yield)
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    try:
        return (yield)
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@pytest.fixture
def runtime_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where sockets and locks go; nothing of other programs on this machine is seen."""
    made = Path(tempfile.mkdtemp(prefix="od-"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(made))
    monkeypatch.setattr(runtime_dir, "FALLBACK", made / "tmp")
    monkeypatch.setattr(runtime_dir, "RUN_USER", made / "run")
    yield made / runtime_dir.NAME
    shutil.rmtree(made)
