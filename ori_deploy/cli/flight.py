"""The flight recorder of a session: where its log goes, what stands at its head, and what to say when it fails."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
import numpy as np

from ori_deploy.actuators.bus import ActuatorBus
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.cli.frame import warn
from ori_deploy.clock import Clock, VirtualClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.journal import Journal
from ori_deploy.deploy.observers import Observer
from ori_deploy.errors import FileError
from ori_deploy.files import digest
from ori_deploy.files.text import HeldFile
from ori_deploy.motion import Plan
from ori_deploy.telemetry.frames import plan_info
from ori_deploy.telemetry.log import behind, kept_as, there
from ori_deploy.telemetry.recorder import Recorder
from ori_deploy.telemetry.taped import taped

PLAN_NAME, RIG_NAME = "plan.json", "rig.toml"
"""Names of the two files in a log."""


@contextmanager
def flight_recorder(
    path: Path | None, plan_file: HeldFile, rig_file: HeldFile, plan: Plan, rig: ResolvedRig, clock: Clock
) -> Iterator[Recorder | None]:
    """Record to `path` until the end of the block; None for no log. A log that is not whole is told of.

    The log keeps the very bytes that plan and rig were made of: it could not be decided again with any others.

    Raises
    ------
    FileError
        The log cannot be written, or the recorder does not come up: nothing has moved yet.
    """
    if path is None:
        yield None
        return
    if not path.name or (there(path) and not path.is_file()):
        raise FileError(f"{path}: the log has to be a file", limit="a regular file", remedy="choose another name")
    files = {PLAN_NAME: plan_file.data, RIG_NAME: rig_file.data}
    if there(path):
        click.echo(f"note: {path} is there already; it is kept as {kept_as(path)}", err=True)
    try:
        folder = behind(path).parent
        if not folder.is_dir():
            folder.mkdir(parents=True)
            click.echo(f"note: made the folder {folder} for the log", err=True)
        recorder = Recorder(
            path,
            plan_info(plan, rig, plan_sha256=digest(plan_file)),
            clock,
            versions=versions(clock),
            files=files,
            waits=isinstance(clock, VirtualClock),
        )
    except OSError as wrong:
        raise FileError(
            f"{path}: the log cannot be written", value=wrong.strerror, remedy="check the folder"
        ) from wrong
    try:
        yield recorder
    finally:
        try:
            recorder.close()
        except OSError as wrong:
            warn(f"the log is not whole: {wrong}")


def controller_for(
    plan: Plan,
    rig: ResolvedRig,
    bus: ActuatorBus,
    clock: Clock,
    observers: Sequence[Observer],
    recorder: Recorder | None,
    journal: Journal | None = None,
) -> Controller:
    """A controller, recorded where there is a recorder."""
    if recorder is None:
        return Controller(plan, rig, bus, clock, observers, journal)
    watching: tuple[Observer, ...] = (recorder, *observers)
    return taped(
        recorder,
        lambda bus, clock, journal: Controller(plan, rig, bus, clock, watching, journal),
        bus,
        clock,
        journal,
    )


def versions(clock: Clock) -> Callable[[], dict[str, Any]]:
    """What the loop runs on: the message of `/versions`. The date is for people; nothing depends on it."""
    told = {
        "ori_deploy": version("ori-deploy"),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "platform": platform.platform(),
        "machine": platform.machine(),
        "processors": os.cpu_count() or 0,
        "affinity": sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [],
        "scheduling": "",
        "clock": "virtual" if isinstance(clock, VirtualClock) else "real",
        "begun_utc": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    return lambda: {**told, "scheduling": _scheduling()}


def _scheduling() -> str:
    """Policy and priority of this process, as far as the system tells."""
    if sys.platform != "linux":
        return "unknown"
    names = {os.SCHED_OTHER: "other", os.SCHED_FIFO: "fifo", os.SCHED_RR: "rr", os.SCHED_BATCH: "batch"}
    policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    priority = os.sched_getparam(0).sched_priority
    return f"{names.get(policy, policy)} priority {priority} nice {os.nice(0)}"
