"""The command line: in a process of its own where signals, pipes or the exit status are the matter."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from ori_deploy.cli import demo, main, session
from ori_deploy.cli.session import StoppedBy, StopRequest, run_command
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import MotionResult, Outcome
from ori_deploy.deploy.states import State
from tests.cli.inside import run

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
COMMANDS = (
    "design",
    "poses",
    "plan",
    "deploy",
    "stow",
    "report",
    "replay",
    "demo",
    "limit",
    "strip",
    "bus",
    "doctor",
    "export",
    "schema",
)


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a design, a plan and a log of the example wing."""
    folder = tmp_path_factory.mktemp("wing")
    for words in (
        ("design", EXAMPLES / "wing_naca2412.toml", "-o", "wing.design.json"),
        ("plan", "wing.design.json", "--rig", EXAMPLES / "rig_mock.toml", "-o", "wing.plan.json"),
        ("deploy", "wing.plan.json", "--rig", EXAMPLES / "rig_mock.toml", "--log", "run.mcap"),
    ):
        done = run(*words, cwd=folder)
        assert done.returncode == 0, done.stderr
    return folder


def test_help_lists_every_command_and_each_has_an_example() -> None:
    def page(*words: str) -> str:
        return CliRunner().invoke(main, [*words, "--help"], prog_name="ori-deploy").output

    listing = page()
    for name in COMMANDS:
        assert f"\n  {name} " in listing
        assert f"ori-deploy {name} " in page(name).split("Example:")[1]


def test_files_in_files_out(made: Path) -> None:
    assert json.loads((made / "wing.design.json").read_text())["packaging"]["eta"] == pytest.approx(2.1311, abs=5e-5)
    assert json.loads((made / "wing.plan.json").read_text())["fold"][-1] == 1.0
    assert (made / "run.mcap").stat().st_size > 10_000
    assert not list(made.glob(".*")) + list(made.glob("*.partial"))


def test_stow_starts_deployed_and_ends_stowed(made: Path) -> None:
    done = run("stow", "wing.plan.json", "--rig", EXAMPLES / "rig_mock.toml", cwd=made)
    assert done.returncode == 0, done.stderr
    assert "state stowed" in done.stdout


@pytest.mark.slow
def test_explicit_rig_drives_the_same_wing(made: Path, tmp_path: Path) -> None:
    rig = EXAMPLES / "rig_wing_explicit.toml"
    assert run("plan", made / "wing.design.json", "--rig", rig, "-o", "x.plan.json", cwd=tmp_path).returncode == 0
    done = run("deploy", "x.plan.json", "--rig", rig, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "state deployed" in done.stdout


def test_poses_prints_every_panel_and_cells_can_fold_apart(made: Path) -> None:
    done = run("poses", "wing.design.json", "--fold", "0.3", "--json", cwd=made)
    panels = json.loads(done.stdout)
    assert len(panels) == 16
    for panel in panels:
        matrix = np.array(panel["transform"])
        assert np.allclose(matrix[:2, :2] @ matrix[:2, :2].T, np.eye(2))
    apart = json.loads(
        run("poses", "wing.design.json", "--fold", "0.3", "--fold-cell", "c2=0.5", "--json", cwd=made).stdout
    )
    same = [p["transform"] == q["transform"] for p, q in zip(panels, apart, strict=True)]
    assert True in same
    assert False in same
    assert "turned" in run("poses", "wing.design.json", "--fold", "1", cwd=made).stdout


def test_report_takes_a_plan_from_a_pipe(made: Path, tmp_path: Path) -> None:
    """Reproduced: it was read a second time for its digest, empty, and the run was told to be of another plan."""
    words = f"{sys.executable} -m ori_deploy.cli report {made / 'run.mcap'} -o {tmp_path / 'page.html'}"
    line = f"{words} --plan <(cat {made / 'wing.plan.json'})"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert "Deployed with every latch confirmed" in (tmp_path / "page.html").read_text()


def test_report_stands_alone(made: Path) -> None:
    assert run("report", "run.mcap", "-o", "alone.html", cwd=made).returncode == 0
    done = run("report", "run.mcap", "--design", "wing.design.json", "--plan", "wing.plan.json", cwd=made)
    assert done.returncode == 0, done.stderr
    page = (made / "run.html").read_text()
    assert page.count("<svg") >= 4
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert (made / "alone.html").read_text().count("<svg") >= 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("design", "missing.toml"), "missing.toml: cannot be read"),
        (("plan", "wing.plan.json", "--rig", EXAMPLES / "rig_mock.toml"), "key schema"),
        (("plan", "wing.design.json", "--rig", "missing.toml"), "missing.toml"),
        (("deploy", "wing.design.json", "--rig", EXAMPLES / "rig_mock.toml"), "key schema"),
        (("poses", "wing.design.json", "--fold", "1.5"), "fold: outside the motion; found 1.5"),
        (("poses", "wing.design.json", "--fold", "0.5", "--fold-cell", "c9=1"), "--fold-cell: unknown cell"),
        (("poses", "wing.design.json", "--fold", "0.5", "--fold-cell", "c1=x"), "--fold-cell: not a number"),
        (("poses", "wing.design.json", "--fold", "nan"), "fold: outside the motion"),
        (("report", "wing.plan.json"), "wing.plan.json"),
    ],
)
def test_bad_input_ends_in_one_line_and_status_2(made: Path, words: tuple[str | Path, ...], message: str) -> None:
    before = sorted(made.iterdir())
    done = run(*words, cwd=made)
    assert done.returncode == 2, done.stdout + done.stderr
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(made.iterdir()) == before


def test_a_shell_sees_the_status_and_one_line(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "ori_deploy.cli", "design", "missing.toml"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("in_mm", [False, True])
def test_lengths_that_were_meant_in_millimetres_are_asked_about(tmp_path: Path, in_mm: bool) -> None:
    text = (EXAMPLES / "ellipse_4.toml").read_text()
    for key, value in (("a_m", 0.1), ("b_m", 0.06), ("span_m", 0.5), ("wall_m", 0.001)):
        assert f"{key} = {value}" in text
        text = text.replace(f"{key} = {value}", f"{key} = {1e3 * value if in_mm else value}")
    (tmp_path / "shape.toml").write_text(text)
    done = run("design", "shape.toml", cwd=tmp_path)
    assert done.returncode == 0
    assert ("500 m large" in done.stderr) == in_mm
    assert len(done.stderr.splitlines()) == in_mm


def test_colliding_slit_is_refused_and_leaves_no_plan(tmp_path: Path) -> None:
    text = (EXAMPLES / "wing_naca2412.toml").read_text().replace('slits = [["P", "T2"]]', 'slits = [["P", "T1"]]')
    (tmp_path / "graze.toml").write_text(text)
    assert run("design", "graze.toml", cwd=tmp_path).returncode == 0
    done = run("plan", "graze.design.json", "--rig", EXAMPLES / "rig_mock.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert "reach into each other at fold 0.7" in done.stderr
    assert "depth" in done.stderr
    assert not (tmp_path / "graze.plan.json").exists()


@pytest.mark.slow
def test_demo_leaves_everything_it_promises(tmp_path: Path) -> None:
    done = run("demo", EXAMPLES / "ellipse_6.toml", "-o", "demo", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for name in (
        "ellipse_6.design.json",
        "ellipse_6.plan.json",
        "run.mcap",
        "report.html",
        "section.svg",
        "strip.svg",
    ):
        assert (tmp_path / "demo" / name).stat().st_size > 1000
    for row in ("packaging ratio eta", "volume reduction", "box ratio", "duration", "tracking error", "clearance"):
        assert row in done.stdout


def test_demo_moves_simulated_servos_only(tmp_path: Path) -> None:
    """Reproduced: it opened the port of a rig of hardware, to move what it had just thought of."""
    done = run("demo", "--rig", EXAMPLES / "rig_wing_dynamixel.toml", "-o", "demo", cwd=tmp_path)
    assert done.returncode == 2
    assert 'backend = "dynamixel"' in done.stderr
    assert not (tmp_path / "demo").exists()


def test_demo_deletes_no_log(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"of a flight")
    (tmp_path / "bad.toml").write_text("")
    assert run("demo", "bad.toml", "-o", ".", cwd=tmp_path).returncode == 2
    assert (tmp_path / "run.mcap").read_bytes() == b"of a flight"


@pytest.mark.parametrize("lost", ["log", "stow"])
def test_demo_ends_with_the_status_of_what_became_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost: str
) -> None:
    """Reproduced: 2 without a log after both motions, and 1 for Ctrl-C during the second."""
    results: list[MotionResult] = []

    def carried_out(*words: Any) -> Any:
        plan, both, _ = session.carry_out(*words)
        results.extend(both)
        if lost == "log":
            words[-1].log.unlink()
            return plan, both, None
        cut = replace(both[-1], outcome=Outcome.STOPPED)
        assert not cut.succeeded
        return plan, (both[0], cut), StoppedBy.SIGNAL

    monkeypatch.setattr(demo, "carry_out", carried_out)
    done = run("demo", EXAMPLES / "ellipse_4.toml", "-o", ".", cwd=tmp_path)
    assert [result.succeeded for result in results] == [True, True]
    assert done.returncode == (1 if lost == "log" else 130)
    assert "no figures were made" in done.stderr


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
    ],
)
def test_interruption_brings_it_to_rest_and_keeps_the_log(made: Path, tmp_path: Path, number: signal.Signals) -> None:
    command = [sys.executable, "-u", "-m", "ori_deploy.cli", "deploy", str(made / "wing.plan.json")]
    command += ["--rig", str(EXAMPLES / "rig_mock.toml"), "--log", "cut.mcap", "--realtime"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if "-> moving" in line:
                break
        time.sleep(0.5)
        os.kill(process.pid, number)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == 130, errors
    assert "brought to rest" in errors
    assert "Traceback" not in errors
    done = run("report", "cut.mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "stopped" in (tmp_path / "cut.html").read_text().lower()


@pytest.mark.slow
def test_a_closed_pipe_does_not_end_the_motion(made: Path, tmp_path: Path) -> None:
    words = f"{sys.executable} -m ori_deploy.cli deploy {made / 'wing.plan.json'} --rig {EXAMPLES / 'rig_mock.toml'}"
    subprocess.run(f"{words} --log pipe.mcap | head -n 1", shell=True, cwd=tmp_path, check=True, timeout=60)
    assert run("report", "pipe.mcap", cwd=tmp_path).returncode == 0
    assert "Deployed with every latch confirmed" in (tmp_path / "pipe.html").read_text()


@pytest.mark.slow
def test_a_full_disk_behind_the_output_does_not_end_the_motion(made: Path, tmp_path: Path) -> None:
    words = f"{sys.executable} -m ori_deploy.cli deploy {made / 'wing.plan.json'} --rig {EXAMPLES / 'rig_mock.toml'}"
    subprocess.run(f"{words} --log full.mcap > /dev/full", shell=True, cwd=tmp_path, check=False, timeout=60)
    assert run("report", "full.mcap", cwd=tmp_path).returncode == 0
    assert "Deployed with every latch confirmed" in (tmp_path / "full.html").read_text()


def test_an_older_log_is_kept(made: Path, tmp_path: Path) -> None:
    words = ("deploy", made / "wing.plan.json", "--rig", EXAMPLES / "rig_mock.toml", "--log", "run.mcap")
    assert run(*words, cwd=tmp_path).returncode == 0
    first = (tmp_path / "run.mcap").read_bytes()
    assert run(*words, cwd=tmp_path).returncode == 0
    assert (tmp_path / "run-1.mcap").read_bytes() == first


def test_inputs_are_never_overwritten(made: Path, tmp_path: Path) -> None:
    spec = tmp_path / "s.toml"
    spec.write_text((EXAMPLES / "ellipse_4.toml").read_text())
    assert run("design", spec, "-o", spec, cwd=tmp_path).returncode == 2
    assert spec.read_text() == (EXAMPLES / "ellipse_4.toml").read_text()
    plan = made / "wing.plan.json"
    before = plan.read_bytes()
    done = run("deploy", plan, "--rig", EXAMPLES / "rig_mock.toml", "--log", plan, cwd=tmp_path)
    assert done.returncode == 2
    assert "is a file that is read here" in done.stderr
    assert plan.read_bytes() == before


def test_a_rig_that_allows_less_than_the_plan_needs_is_refused(made: Path, tmp_path: Path) -> None:
    text = (EXAMPLES / "rig_mock.toml").read_text()
    slow = text.replace("max_crease_velocity_rad_s = 0.6", "max_crease_velocity_rad_s = 0.1")
    assert slow != text
    (tmp_path / "slow.toml").write_text(slow)
    done = run("deploy", made / "wing.plan.json", "--rig", "slow.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert "beyond what this rig allows" in done.stderr
    assert "plan again with this rig" in done.stderr


@pytest.mark.parametrize("content", ["[" * 100_000, "{" * 10, "", "\xff"])
def test_files_that_are_not_what_they_should_be_are_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "x.json").write_bytes(content.encode("latin-1"))
    for words in (
        ("plan", "x.json", "--rig", EXAMPLES / "rig_mock.toml"),
        ("design", "x.json"),
        ("report", "x.json"),
    ):
        done = run(*words, cwd=tmp_path)
        assert done.returncode == 2, done.stderr
        assert "Traceback" not in done.stderr


class _SignalledOnce:
    """A controller that is told to stop while it is already coming to rest with a fault."""

    def __init__(self, states: list[State]) -> None:
        self._states = states
        self.stops = 0

    @property
    def state(self) -> State:
        return self._states[0]

    @property
    def under_way(self) -> bool:
        return len(self._states) > 1

    def stop(self) -> None:
        assert self.state in (State.MOVING, State.LATCHING)
        self.stops += 1

    def step(self) -> None:
        self._states.pop(0)

    def result(self) -> str:
        return "ended"


@pytest.mark.parametrize(
    ("states", "stops"),
    [([State.FAULT, State.FAULT], 0), ([State.MOVING, State.STOPPING, State.ARMED], 1), ([State.DEPLOYED], 0)],
)
def test_a_signal_stops_a_motion_once_and_nothing_else(states: list[State], stops: int) -> None:
    stop = StopRequest()
    stop.requested = True
    controller = _SignalledOnce(states)
    assert run_command(controller, stop) == "ended"  # type: ignore[arg-type,comparison-overlap]
    assert controller.stops == stops


def test_nervous_fingers_ask_once_and_patient_ones_break_off(monkeypatch: pytest.MonkeyPatch) -> None:
    with StopRequest() as stop:
        for _ in range(3):
            signal.raise_signal(signal.SIGINT)
        assert stop.requested
        monkeypatch.setattr(session, "SAME_WISH_S", 0.0)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("number", StopRequest.SIGNALS)
@pytest.mark.parametrize("ignored", [False, True])
def test_a_hangup_that_was_to_mean_nothing_means_nothing(number: signal.Signals, ignored: bool) -> None:
    """As `nohup` leaves it; interrupts are ignored by every job in the background, and are asked for by `kill`."""
    before = signal.signal(number, signal.SIG_IGN if ignored else signal.SIG_DFL)
    try:
        with StopRequest() as stop:
            heeded = not (ignored and number == signal.SIGHUP)
            assert (signal.getsignal(number) is signal.SIG_IGN) == (not heeded)
            signal.raise_signal(number)
            assert stop.requested == heeded
        assert signal.getsignal(number) is (signal.SIG_IGN if ignored else signal.SIG_DFL)
    finally:
        signal.signal(number, before)


def test_a_signal_before_torque_leaves_it_off(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Requested(StopRequest):
        def __enter__(self) -> StopRequest:
            super().__enter__()
            self.requested = True
            return self

    def armed(_: Controller) -> None:
        raise AssertionError("torque went on")

    monkeypatch.setattr(session, "StopRequest", Requested)
    monkeypatch.setattr(Controller, "arm", armed)
    _, results, stopped = session.carry_out(
        made / "wing.plan.json", EXAMPLES / "rig_mock.toml", ("deploy",), session.Options()
    )
    assert (results, stopped) == ((), StoppedBy.SIGNAL)
