"""Commands from a second terminal: sessions in processes of their own, in real time."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from ori_deploy.cli import main
from ori_deploy.cli.operate import _page
from ori_deploy.operate.messages import LatchStatus
from ori_deploy.operate.places import socket_path
from tests.cli.inside import run
from tests.operate.test_messages import STATUS

pytestmark = pytest.mark.usefixtures("runtime_folder")

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
RIG = "rig.toml"


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan of a few seconds, and beside it the rig that it was made for."""
    made = tmp_path_factory.mktemp("operated")
    text = (EXAMPLES / "rig_mock.toml").read_text()
    (made / RIG).write_text(text.replace("max_crease_velocity_rad_s = 0.6", "max_crease_velocity_rad_s = 0.9"))
    assert run("design", EXAMPLES / "ellipse_4.toml", "-o", "e.design.json", cwd=made).returncode == 0
    done = run("plan", "e.design.json", "--rig", RIG, "-o", "e.plan.json", cwd=made)
    assert done.returncode == 0, done.stderr
    return made / "e.plan.json"


class Session:
    """A session in a process of its own."""

    def __init__(self, cwd: Path, *words: object) -> None:
        line = [sys.executable, "-u", "-m", "ori_deploy.cli", *(str(word) for word in words)]
        self.process = subprocess.Popen(line, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.pid = self.process.pid
        self._out = ""

    def until(self, words: str) -> None:
        """Read its lines up to one with these words."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._out += line
            if words in line:
                return
        raise AssertionError(f"{words!r} never came: {self.end()}")

    def end(self) -> tuple[int, str, str]:
        """Exit status, output and errors."""
        out, err = self.process.communicate(timeout=60.0)
        assert "Traceback" not in err
        return self.process.returncode, self._out + out, err


@contextmanager
def session(cwd: Path, *words: object) -> Iterator[Session]:
    """A session, killed at the end if need be."""
    running = Session(cwd, *words)
    try:
        yield running
    finally:
        running.process.kill()
        running.process.communicate()


def asked(*words: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A command at the other terminal: a process of its own."""
    line = [sys.executable, "-m", "ori_deploy.cli", *(str(word) for word in words)]
    return subprocess.run(line, cwd=cwd, capture_output=True, text=True, timeout=60, check=False)


def answer(*words: object, cwd: Path) -> dict[str, Any]:
    """Its last document with --json."""
    done = asked(*words, "--json", cwd=cwd)
    assert done.returncode == 0, done.stderr
    document: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return document


@pytest.mark.slow
def test_pause_status_resume_deployed(plan: Path, runtime_folder: Path, tmp_path: Path) -> None:
    with session(tmp_path, "deploy", plan, "--rig", plan.with_name(RIG), "--realtime") as running:
        running.until("-> moving")
        paused = answer("pause", "--wait", "--pid", running.pid, cwd=tmp_path)
        assert (paused["state"], paused["at_rest"]) == ("hold", True)
        first, second = (answer("status", "--pid", running.pid, cwd=tmp_path) for _ in range(2))
        assert (first["state"], first["stage"], first["rate"]) == ("hold", "open", 0.0)
        assert (first["pid"], first["plan"], first["rig"], first["ports"]) == (
            running.pid,
            str(plan),
            str(plan.with_name(RIG)),
            [],
        )
        assert first["fold"] == second["fold"]
        assert second["cycles"] > first["cycles"]  # held and watched, not asleep
        again = asked("pause", "--wait", "--pid", running.pid, cwd=tmp_path)
        assert (again.returncode, again.stderr) == (0, "")
        assert again.stdout.startswith("pause: paused already, state hold, at rest ")
        page = asked("status", "--pid", running.pid, cwd=tmp_path).stdout
        assert "next       ori-deploy resume goes on; ori-deploy stop gives it up" in page
        done = asked("resume", "--wait", "--pid", running.pid, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "state deployed, at rest" in done.stdout
        status, out, err = running.end()
    assert status == 0
    assert "state deployed" in out
    assert "held: `ori-deploy resume` goes on" in err
    assert not list(runtime_folder.iterdir())


@pytest.mark.slow
def test_stop_ends_the_session_as_ctrl_c_does_and_says_who(plan: Path, tmp_path: Path) -> None:
    with session(tmp_path, "deploy", plan, "--rig", plan.with_name(RIG), "--realtime") as running:
        running.until("-> moving")
        page = asked("status", "--pid", running.pid, cwd=tmp_path).stdout
        for words in ("moving, not at rest", "open of deploy", str(plan), str(running.pid), "at full speed"):
            assert words in page
        stopped = answer("stop", "--wait", "--pid", running.pid, cwd=tmp_path)
        assert (stopped["state"], stopped["at_rest"]) == ("armed", True)
        status, _, err = running.end()
    assert status == 130
    assert "brought to rest along its path; asked for by an operator at another terminal" in err


@pytest.mark.slow
def test_estop_ends_with_its_fault_and_status_1(plan: Path, tmp_path: Path) -> None:
    with session(tmp_path, "deploy", plan, "--rig", plan.with_name(RIG), "--realtime") as running:
        running.until("-> moving")
        done = asked("estop", "--wait", "--pid", running.pid, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        status, out, err = running.end()
    assert status == 1
    assert "emergency_stop" in out
    assert "pressed by an operator at another terminal (pid " in out
    assert "error: not deployed" in err


def test_without_a_controller_the_status_is_3_and_the_line_says_what_to_do(tmp_path: Path) -> None:
    for name in ("status", "pause", "resume", "stop", "estop"):
        done = run(name, cwd=tmp_path)
        assert done.returncode == 3
        assert done.stderr.count("\n") == 1
        assert "no controller is running" in done.stderr
        assert "remedy: start one" in done.stderr


def test_every_command_has_its_help_and_an_example() -> None:
    for name in ("status", "pause", "resume", "stop", "estop"):
        page = CliRunner().invoke(main, [name, "-h"], prog_name="ori-deploy").output
        assert f"ori-deploy {name} " in page.split("Example:")[1]


def test_an_emergency_stop_waits_for_no_room_to_load() -> None:
    code = (
        "import sys; from click.testing import CliRunner; from ori_deploy.cli import main;"
        "CliRunner().invoke(main, ['estop', '--help']); print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    loaded = set(done.stdout.split())
    assert "ori_deploy.operate.client" in loaded
    assert not loaded & {"numpy", "scipy", "ori_deploy.motion", "ori_deploy.deploy.controller"}


def test_virtual_time_has_no_socket_and_help_says_so(
    plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def made(*_: object) -> None:
        raise AssertionError("a socket on virtual time")

    monkeypatch.setattr("ori_deploy.cli.session.operated", made)
    assert run("deploy", plan, "--rig", plan.with_name(RIG), cwd=tmp_path).returncode == 0
    page = " ".join(run("deploy", "--help", cwd=tmp_path).stdout.split())
    assert "Other terminals can command a motion only with this, or on hardware" in page


@pytest.mark.slow
def test_ctrl_c_gives_up_what_is_held(plan: Path, tmp_path: Path) -> None:
    with session(tmp_path, "deploy", plan, "--rig", plan.with_name(RIG), "--realtime") as running:
        running.until("-> moving")
        answer("pause", "--wait", "--pid", running.pid, cwd=tmp_path)
        running.process.send_signal(signal.SIGINT)
        status, out, err = running.end()
    assert status == 130
    assert "hold -> stopping" in out
    assert "asked for by a signal" in err


@pytest.mark.slow
def test_watch_follows_to_the_end_and_several_sessions_are_told_apart(plan: Path, tmp_path: Path) -> None:
    with (
        session(tmp_path, "deploy", plan, "--rig", plan.with_name(RIG), "--realtime") as one,
        session(tmp_path, "deploy", plan, "--rig", plan.with_name(RIG), "--realtime") as two,
    ):
        one.until("-> moving")
        two.until("-> moving")
        done = asked("status", cwd=tmp_path)
        assert done.returncode == 3
        for pid in (one.pid, two.pid):
            assert f"pid {pid} ({plan.name}, no port, moving)" in done.stderr
        with (
            session(tmp_path, "status", "--watch", "--json", "--pid", one.pid) as watching,
            session(tmp_path, "status", "--watch", "--json", "--pid", one.pid) as bored,
        ):
            bored.until("pid")
            bored.process.send_signal(signal.SIGINT)
            assert bored.end()[0] == 0
            assert asked("stop", "--wait", "--pid", two.pid, cwd=tmp_path).returncode == 0
            assert one.end()[0] == 0
            status, out, err = watching.end()
        assert status == 0
        assert "has ended" in err
        folds = [json.loads(line)["fold"] for line in out.splitlines()]
        assert folds == sorted(folds)
        assert len(folds) > 3
        assert two.end()[0] == 130


@pytest.mark.slow
def test_kill_9_leaves_a_socket_that_the_next_session_removes(
    plan: Path, runtime_folder: Path, tmp_path: Path
) -> None:
    with session(tmp_path, "deploy", plan, "--rig", plan.with_name(RIG), "--realtime") as killed:
        killed.until("-> moving")
        left = socket_path(runtime_folder, killed.pid)
        os.kill(killed.pid, signal.SIGKILL)
        killed.process.communicate()
        assert left.exists()
    with session(tmp_path, "deploy", plan, "--rig", plan.with_name(RIG), "--realtime") as running:
        running.until("-> moving")
        assert not left.exists()
        assert asked("estop", "--pid", running.pid, cwd=tmp_path).returncode == 0
        assert running.end()[0] == 1


def test_what_pauses_a_motion_is_told_and_stow_locks_are_not_among_its_latches() -> None:
    latches = (LatchStatus("pin", True, True, "slit:P-T2"), LatchStatus("lock", False, False, "stow"))
    told = _page(replace(STATUS, concern="over_temperature: servo_c2: 71 degrees", latches=latches))
    assert re.search(r"^concern +over_temperature: servo_c2", told, re.MULTILINE)
    assert "1 of 1 confirmed closed" in told
