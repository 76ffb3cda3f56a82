"""The scripts of examples/ground_station against a component that serves in a process of its own."""

from __future__ import annotations

import csv
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.cli.serving import Served, quick_plan, serving
from tests.mav.stations import free_port

SCRIPTS = Path(__file__).parents[2] / "examples" / "ground_station"

pytestmark = pytest.mark.usefixtures("runtime_folder")


def script(name: str, *words: object) -> subprocess.CompletedProcess[str]:
    """A script, from its beginning to its end."""
    line = [sys.executable, str(SCRIPTS / f"{name}.py"), *map(str, words)]
    return subprocess.run(line, capture_output=True, text=True, timeout=120, check=False)


@contextmanager
def stand_in(served: Served) -> Iterator[None]:
    """The script that speaks for an autopilot, until the component has believed it."""
    with subprocess.Popen([sys.executable, str(SCRIPTS / "stand_in_autopilot.py"), served.link]) as autopilot:
        try:
            served.until(lambda told: told.may_fold and told.may_deploy)
            yield
        finally:
            autopilot.kill()


@pytest.mark.slow
def test_nobody_there_is_no_go() -> None:
    done = script("preflight_deploy", f"udpout:127.0.0.1:{free_port()}")
    assert (done.returncode, done.stderr) == (1, "")
    assert done.stdout.startswith("NO-GO: system 1 component 140 is not heard")


def test_the_stand_in_keeps_away_from_vehicles() -> None:
    done = script("stand_in_autopilot", "udpout:192.0.2.1:14550")
    assert (done.returncode, done.stdout) == (1, "")
    assert "only on 127.0.0.1" in done.stderr


def test_ctrl_c_ends_the_stand_in_without_a_word() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as component:
        component.bind(("127.0.0.1", 0))
        component.settimeout(60.0)
        link = f"udpout:127.0.0.1:{component.getsockname()[1]}"
        line = [sys.executable, str(SCRIPTS / "stand_in_autopilot.py"), link]
        with subprocess.Popen(line, stderr=subprocess.PIPE, text=True) as autopilot:
            assert component.recv(300)  # it speaks
            autopilot.send_signal(signal.SIGINT)
            _, error = autopilot.communicate(timeout=60)
    assert (autopilot.returncode, error) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("words", [("bench_cycles", 1), ("plot_telemetry", "deploy", "never.png")])
def test_a_script_that_hears_nobody_says_so_and_ends(words: tuple[str, object]) -> None:
    name, *rest = words
    done = script(name, f"udpout:127.0.0.1:{free_port()}", *rest)
    assert done.returncode == 1
    assert done.stderr.startswith("system 1 component 140 is not heard")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("name", [path.stem for path in sorted(SCRIPTS.glob("*.py"))])
def test_a_script_without_words_shows_how_it_is_called(name: str) -> None:
    done = script(name)
    assert (done.returncode, done.stdout) == (1, "")
    assert f"python examples/ground_station/{name}.py udpout:127.0.0.1:14560" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_go_only_with_what_is_deployed_and_locked(tmp_path: Path) -> None:
    with serving(quick_plan(tmp_path), tmp_path) as served:
        done = script("preflight_deploy", served.link)
        assert (done.returncode, done.stdout) == (1, "NO-GO: deploy temporarily rejected: arming unknown\n")
        with stand_in(served):
            done = script("preflight_deploy", served.link)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.splitlines()[-1] == "GO: deployed and locked"


@pytest.mark.slow
def test_cycles_are_counted_and_a_refusal_ends_them(tmp_path: Path) -> None:
    with serving(quick_plan(tmp_path), tmp_path) as served:
        with stand_in(served):
            done = script("bench_cycles", served.link, 2)
        assert (done.returncode, done.stderr) == (0, "")
        rows = list(csv.DictReader(done.stdout.splitlines()))
        assert [row["cycle"] for row in rows] == ["1", "2"]
        assert {row["latches_confirmed"] for row in rows} == {"2"}
        assert all(float(row[name]) > 0.9 for row in rows for name in ("deploy_s", "fold_s"))
        assert all(0.0 < float(row["worst_tracking_deg"]) < 10.0 for row in rows)
        served.until(lambda told: not told.may_deploy)  # the stand-in is gone
        done = script("bench_cycles", served.link, 1)
        assert done.returncode == 1
        assert "cycle 1: deploy temporarily rejected: arming unknown" in done.stderr


@pytest.mark.slow
def test_a_motion_is_drawn(tmp_path: Path) -> None:
    with serving(quick_plan(tmp_path), tmp_path, deploy_when="always") as served:
        done = script("plot_telemetry", served.link, "deploy", tmp_path / "deploy.png")
    assert (done.returncode, done.stdout, done.stderr) == (0, "accepted\n", "")
    assert (tmp_path / "deploy.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "deploy.png").stat().st_size > 10_000
