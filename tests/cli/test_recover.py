"""Journals and ways back into step, from the command line."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.cli import journal, recover, session
from ori_deploy.cli.session import StopRequest
from ori_deploy.clock import Clock
from ori_deploy.errors import FileError
from ori_deploy.files import load_plan
from ori_deploy.motion import Plan
from sim_backends.mock import MockBus
from tests.cli.inside import run

EXAMPLES = Path(__file__).parents[2] / "examples"
RIG = EXAMPLES / "rig_mock.toml"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recover")
    assert run("design", EXAMPLES / "wing_naca2412.toml", "-o", "w.design.json", cwd=folder).returncode == 0
    assert run("plan", "w.design.json", "--rig", RIG, "-o", "w.plan.json", cwd=folder).returncode == 0
    return folder


def standing(monkeypatch: pytest.MonkeyPatch, folds: list[float]) -> None:
    """Simulated servos are found with each cell at a fold of its own."""

    def made_bus(rig: ResolvedRig, plan: Plan, clock: Clock, *_: object) -> MockBus:
        angles = plan.crease_angles_rad
        rows = [int(np.searchsorted(plan.fold, fold)) for fold in folds]
        start = np.array([angles[min(row, len(angles) - 1), c] for c, row in enumerate(rows)])
        return MockBus.from_rig(rig, clock, angles[0], angles[-1], start_rad=start)

    monkeypatch.setattr(session, "make_bus", made_bus)


def test_cells_out_of_step_are_brought_back_along_a_checked_way(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    standing(monkeypatch, [0.2, 0.45, 0.3, 0.35])
    refused = run("deploy", "w.plan.json", "--rig", RIG, cwd=made)
    assert refused.returncode == 3
    assert "off the path" in refused.stderr
    assert "ori-deploy recover" in refused.stderr
    done = run("recover", "w.plan.json", "--rig", RIG, "--design", "w.design.json", cwd=made)
    assert done.returncode == 0, done.stderr
    assert "c2 0.4" in done.stdout
    assert "poses checked" in done.stdout
    assert "recover: succeeded" in done.stdout


def test_other_terminals_are_served_while_a_way_is_looked_for(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal:
        polls = 0

        def poll(self) -> None:
            self.polls += 1

    terminal: Any = Terminal()
    stop = StopRequest()
    assert not session._asked(stop, terminal)
    stop.requested = True
    assert session._asked(stop, terminal)
    assert terminal.polls == 2
    looked: list[bool] = []
    whole = session._asked
    monkeypatch.setattr(session, "_asked", lambda stop, operator: looked.append(True) or whole(stop, operator))
    standing(monkeypatch, [0.2, 0.45, 0.3, 0.35])
    done = run("recover", "w.plan.json", "--rig", RIG, "--design", "w.design.json", cwd=made)
    assert done.returncode == 0, done.stderr
    assert looked


def test_a_pose_that_cannot_be_is_refused_with_its_panels(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    standing(monkeypatch, [1.0, 0.2, 1.0, 1.0])
    done = run("recover", "w.plan.json", "--rig", RIG, "--design", "w.design.json", cwd=made)
    assert done.returncode == 3
    assert "reach into each other" in done.stderr
    assert done.stderr.count("\n") == 1


def test_another_design_is_refused_before_anything_is_connected(made: Path, tmp_path: Path) -> None:
    assert run("design", EXAMPLES / "ellipse_4.toml", "-o", "e.design.json", cwd=tmp_path).returncode == 0
    words = ("recover", made / "w.plan.json", "--rig", RIG, "--design", "e.design.json")
    done = run(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert "not the design of this plan" in done.stderr


def test_the_journal_is_kept_and_believed_until_somebody_looked(made: Path, tmp_path: Path) -> None:
    path = tmp_path / "w.journal"
    words = ("w.plan.json", "--rig", RIG, "--journal", path)
    assert run("deploy", *words, cwd=made).returncode == 0
    entry = json.loads(path.read_text())
    assert (entry["command"], entry["state"], entry["from_fold"]) == ("deploy", "deployed", 1.0)
    # Simulated servos are found stowed again: not where the journal left them.
    again = run("deploy", *words, cwd=made)
    assert again.returncode == 3
    assert "not where the journal says" in again.stderr
    assert "--trust-measured" in again.stderr
    assert run("deploy", *words, "--trust-measured", cwd=made).returncode == 0
    stowed = run("stow", *words, cwd=made)  # found deployed, as the journal says
    assert stowed.returncode == 0, stowed.stderr
    assert json.loads(path.read_text())["state"] == "stowed"


def test_a_journal_that_is_none_is_refused_before_anything_moves(made: Path, tmp_path: Path) -> None:
    path = tmp_path / "w.journal"
    path.write_text("something else")
    done = run("deploy", "w.plan.json", "--rig", RIG, "--journal", path, cwd=made)
    assert done.returncode == 2
    assert str(path) in done.stderr
    assert path.read_text() == "something else"


def test_speed_slows_the_motion_and_is_a_part_of_it(made: Path) -> None:
    fast = run("deploy", "w.plan.json", "--rig", RIG, cwd=made)
    slow = run("deploy", "w.plan.json", "--rig", RIG, "--speed", "0.5", cwd=made)

    def seconds(text: str) -> float:
        return float(text.rsplit("succeeded in ", 1)[1].split(" s", 1)[0])

    assert seconds(slow.stdout) > 1.6 * seconds(fast.stdout)
    wrong = run("deploy", "w.plan.json", "--rig", RIG, "--speed", "2", cwd=made)
    assert wrong.returncode == 2
    assert "speed" in wrong.stderr


def test_a_device_has_a_journal_of_its_own_and_a_pseudo_terminal_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, made: Path
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    plan = load_plan(made / "w.plan.json")
    rig = session.rig_for(RIG, plan)
    assert journal.default_path(RIG, rig, None) is None
    servo_rig = EXAMPLES / "rig_wing_dynamixel.toml"
    servos = session.rig_for(servo_rig, plan)
    found = journal.default_path(servo_rig, servos, "/dev/ttyUSB0")
    assert found is not None
    assert found.parent == tmp_path / "ori-deploy"
    assert found != journal.default_path(tmp_path / servo_rig.name, servos, "/dev/ttyUSB0")
    link = tmp_path / "ttyDXL"
    link.symlink_to("/dev/pts/0")
    assert journal.default_path(servo_rig, servos, str(link)) is None


def test_a_rig_from_a_pipe_wants_a_journal_by_name(tmp_path: Path, made: Path) -> None:
    """Reproduced: it has another name each time, and so had its journal: nobody ever found the last word."""
    servos = session.rig_for(EXAMPLES / "rig_wing_dynamixel.toml", load_plan(made / "w.plan.json"))
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(FileError, match="no file") as caught:
        journal.default_path(pipe, servos, "/dev/ttyUSB0")
    assert "--journal" in str(caught.value.remedy)


def spawned(process: subprocess.Popen[str]) -> list[int]:
    """Its worker, as soon as that has begun."""
    listed = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    while process.poll() is None:
        pids = [int(pid) for pid in listed.read_text().split()]
        found = [pid for pid in pids if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        if found:
            return found
        time.sleep(0.005)
    raise AssertionError(process.communicate())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_all_of_it_while_its_worker_loads_is_one_line(
    made: Path, tmp_path: Path, number: signal.Signals
) -> None:
    """Reproduced: the worker died of Ctrl-C, with a traceback, and that was another, with status 1."""
    line = [sys.executable, "-m", "ori_deploy.cli", "recover", str(made / "w.plan.json"), "--rig", str(RIG)]
    line += ["--design", str(made / "w.design.json")]
    with subprocess.Popen(
        line, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        spawned(process)
        os.killpg(process.pid, number)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert errors.count("\n") == 1


def test_a_worker_that_is_killed_is_told_in_one_line(made: Path, tmp_path: Path) -> None:
    line = [sys.executable, "-m", "ori_deploy.cli", "recover", str(made / "w.plan.json"), "--rig", str(RIG)]
    line += ["--design", str(made / "w.design.json")]
    with subprocess.Popen(line, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        for pid in spawned(process):
            os.kill(pid, signal.SIGKILL)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 3, errors
    assert errors.startswith("error: the process that looks for a way has ended")
    assert errors.count("\n") == 1


@pytest.mark.slow
def test_a_worker_does_not_outlive_a_session_that_is_killed(made: Path, tmp_path: Path) -> None:
    line = [sys.executable, "-m", "ori_deploy.cli", "recover", str(made / "w.plan.json"), "--rig", str(RIG)]
    line += ["--design", str(made / "w.design.json"), "--realtime"]
    with subprocess.Popen(
        line, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True
    ) as process:
        (worker,) = spawned(process)
        process.kill()
    until = time.monotonic() + 30.0
    while Path(f"/proc/{worker}/cmdline").exists() and time.monotonic() < until:
        time.sleep(0.05)
    assert not Path(f"/proc/{worker}/cmdline").exists()


def test_the_way_is_looked_for_in_the_design_that_was_read(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What has the name of the design by then may be another's."""
    design = tmp_path / "w.design.json"
    design.write_bytes((made / "w.design.json").read_bytes())
    compared = recover.load_design

    def replaced(path: Path) -> Any:
        read = compared(path)
        design.write_text("no design")
        return read

    standing(monkeypatch, [0.2, 0.45, 0.3, 0.35])
    monkeypatch.setattr(recover, "load_design", replaced)
    done = run("recover", made / "w.plan.json", "--rig", RIG, "--design", design, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
