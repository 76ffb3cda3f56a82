"""The wing on virtual servos by the command line: two processes, the real SDK, a real pty."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from ori_deploy.actuators.resolve import resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.files import load_plan
from ori_deploy.telemetry.read import read_run
from sim_backends.dynamixel.from_rig import Start, spec_for_files
from sim_backends.dynamixel.launcher import VirtualBus
from tests.cli.virtual import simulator

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
RIG = EXAMPLES / "rig_wing_dynamixel.toml"


def run(*words: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "ori_deploy.cli", *(str(w) for w in words)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="session")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dxl")
    assert run("design", EXAMPLES / "wing_naca2412.toml", "-o", "w.design.json", cwd=folder).returncode == 0
    done = run("plan", "w.design.json", "--rig", RIG, "-o", "w.plan.json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "w.plan.json"


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """The shipped rig with more patience: the machine that runs the tests has other things to do as well."""
    text = RIG.read_text().replace("watchdog_s = 0.08 ", "reply_slack_s = 0.03\nwatchdog_s = 0.5 ")
    text = text.replace("[controller]\n", "[controller]\nlost_replies_allowed = 5\n")
    path = tmp_path / "rig.toml"
    path.write_text(text)
    return path


@contextmanager
def virtual(plan: Path, folder: Path, start: Start = "stowed", rig: Path = RIG) -> Iterator[VirtualBus]:
    with VirtualBus(spec_for_files(rig, plan, start), link=folder / "ttyDXL") as bus:
        yield bus


def begin(plan: Path, folder: Path, rig: Path = RIG) -> subprocess.Popen[str]:
    """A deployment in the middle of its motion, where every servo turns."""
    command = [sys.executable, "-u", "-m", "ori_deploy.cli", "deploy", str(plan), "--rig", str(rig)]
    command += ["--port", str(folder / "ttyDXL"), "--log", "flight.mcap"]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        if "-> moving" in line:
            break
    time.sleep(3.0)
    return process


def end(process: subprocess.Popen[str]) -> str:
    _, errors = process.communicate(timeout=60)
    assert "Traceback" not in errors
    return errors


def is_decided_the_same_again(log: Path) -> None:
    done = run("replay", log, "--json", cwd=log.parent)
    assert done.returncode == 0, done.stdout
    assert json.loads(done.stdout)["cycles"] == len(read_run(log).time_s)


def shafts(bus: VirtualBus) -> np.ndarray:
    truth = bus.truth()
    return np.array([truth[i].output_rad for i in sorted(truth)])


@pytest.mark.slow
def test_the_wing_deploys_and_stows_by_the_two_commands_of_the_example(plan: Path, rig: Path, tmp_path: Path) -> None:
    """The commands in the head of the example rig, as they stand there."""
    text = [line.removeprefix("#   ") for line in RIG.read_text().splitlines() if line.startswith("#   ")]
    (tmp_path / "out").mkdir()
    (tmp_path / "examples").mkdir()
    shutil.copy(rig, tmp_path / "examples" / RIG.name)
    shutil.copy(plan, tmp_path / "wing.plan.json")
    deploy = text[1].removeprefix("ori-deploy ").split()
    with simulator(text[0], tmp_path) as said:
        assert "virtual bus on out/ttyDXL" in said
        done = run(*deploy, "--log", "run.mcap", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "state deployed" in done.stdout
        done = run("stow", *deploy[1:], cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "state stowed" in done.stdout
    assert not list((tmp_path / "out").iterdir())
    is_decided_the_same_again(tmp_path / "run.mcap")
    log = read_run(tmp_path / "run.mcap")
    assert np.nanmax(log.fold) > 0.98


@pytest.mark.slow
def test_deployed_is_where_the_plan_ends(plan: Path, rig: Path, tmp_path: Path) -> None:
    made = load_plan(plan)
    fitted = resolve_rig(load_rig(rig), made.cell_ids, made.latch_points)
    with virtual(plan, tmp_path) as bus:
        begun = shafts(bus)
        np.testing.assert_allclose(begun, fitted.to_actuator(made.crease_angles_rad[0]), atol=1e-6)
        assert end(begin(plan, tmp_path, rig)) == ""
        away = np.abs(fitted.to_crease(shafts(bus)) - fitted.driven(made.crease_angles_rad[-1]))
        assert (away < fitted.controller.goal_tolerance_rad).all()
        assert all(servo.torque_on for servo in bus.truth().values())  # at_close = "hold"


@pytest.mark.slow
def test_what_is_deployed_already_is_told_so_and_left_alone(plan: Path, rig: Path, tmp_path: Path) -> None:
    with virtual(plan, tmp_path, "deployed", rig) as bus:
        words = (plan, "--rig", rig, "--port", tmp_path / "ttyDXL", "--log", "again.mcap")
        before, limp = shafts(bus), not any(one.torque_on for one in bus.truth().values())
        done = run("deploy", *words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "deployed already" in done.stdout
        assert limp == (not any(one.torque_on for one in bus.truth().values()))
        np.testing.assert_array_equal(shafts(bus), before)


@pytest.mark.slow
def test_kill_9_stops_every_servo_and_the_next_session_knows_where_it_is(
    plan: Path, rig: Path, tmp_path: Path
) -> None:
    as_shipped = tmp_path / "shipped.toml"
    as_shipped.write_text(rig.read_text().replace("watchdog_s = 0.5 ", "watchdog_s = 0.08 "))
    assert load_rig(as_shipped).dynamixel.watchdog_s == load_rig(RIG).dynamixel.watchdog_s
    with virtual(plan, tmp_path) as bus:
        process = begin(plan, tmp_path, as_shipped)
        moving = bus.truth()
        killed = time.monotonic()
        os.kill(process.pid, signal.SIGKILL)
        assert min(killed - servo.moved_s for servo in moving.values()) < 0.05
        process.communicate(timeout=10)
        is_decided_the_same_again(tmp_path / "flight.mcap")
        time.sleep(0.5)
        truth = bus.truth()
        assert all(servo.frozen and servo.torque_on for servo in truth.values())
        # 120 ms from the kill to the last motion of any servo.
        assert max(servo.moved_s for servo in truth.values()) - killed < 0.12
        stood = shafts(bus)
        done = run("deploy", plan, "--rig", rig, "--port", tmp_path / "ttyDXL", "--log", "next.mcap", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        first = read_run(tmp_path / "next.mcap")
        gear = np.array([2.0, 4.0, 2.0, 12.0])
        assert (np.abs(first.commanded_rad[1] - stood) / gear < np.radians(1.0)).all()


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_brings_real_servos_to_rest_and_leaves_them_holding(
    plan: Path, rig: Path, tmp_path: Path, number: signal.Signals
) -> None:
    with virtual(plan, tmp_path) as bus:
        process = begin(plan, tmp_path, rig)
        os.kill(process.pid, number)
        errors = end(process)
        assert process.returncode == 130
        assert "brought to rest" in errors
        truth = bus.truth()
        assert all(servo.torque_on and not servo.frozen for servo in truth.values())
        assert all(bus.register(i, "bus_watchdog") == 0 for i in truth)
    is_decided_the_same_again(tmp_path / "flight.mcap")


@pytest.mark.slow
def test_relax_as_the_rig_says(plan: Path, rig: Path, tmp_path: Path) -> None:
    limp = tmp_path / "limp.toml"
    limp.write_text(rig.read_text().replace('at_close = "hold"', 'at_close = "relax"'))
    with virtual(plan, tmp_path) as bus:
        done = run("deploy", plan, "--rig", limp, "--port", tmp_path / "ttyDXL", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert not any(servo.torque_on for servo in bus.truth().values())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda bus: bus.overload(3), ("hardware_error", "servo_3", "OVERLOAD")),
        (lambda bus: bus.reboot(2), ("servo_2",)),
        (lambda bus: bus.heat(4, 75.0), ("over_temperature", "servo_4")),
        (lambda bus: bus.sag(2.0), ("low_voltage", "servo_1")),
        (lambda bus: bus.mute(1), ("lost_replies", "servo_1")),
        (lambda bus: bus.jam(3), ("servo_3",)),
        (lambda bus: bus.unplug(), ("bus_closed", "gone")),
    ],
    ids=["overload", "reboot", "heat", "voltage", "silence", "jam", "unplug"],
)
def test_faults_on_the_way_are_typed_and_name_the_servo(
    plan: Path, rig: Path, tmp_path: Path, spoil: object, words: tuple[str, ...]
) -> None:
    assert callable(spoil)
    with virtual(plan, tmp_path) as bus:
        process = begin(plan, tmp_path, rig)
        spoil(bus)
        output, errors = process.communicate(timeout=60)
        assert process.returncode == 1, output + errors
        assert "Traceback" not in errors
        for word in words:
            assert word in output, output
    is_decided_the_same_again(tmp_path / "flight.mcap")


@pytest.mark.slow
def test_single_lost_and_spoilt_replies_do_not_stop_a_motion(plan: Path, rig: Path, tmp_path: Path) -> None:
    with virtual(plan, tmp_path) as bus:
        process = begin(plan, tmp_path, rig)
        for k in range(30):
            (bus.drop if k % 2 else bus.corrupt)(1 + k % 4, 1)
            time.sleep(0.05)
        assert end(process) == ""
        assert process.returncode == 0


@pytest.mark.slow
def test_switched_on_servos_of_several_turns_want_a_word_and_check_it(plan: Path, rig: Path, tmp_path: Path) -> None:
    """The same wing with gears of 10: deployed shafts stand up to five turns away."""
    text = rig.read_text()
    for gear in ("2.0", "4.0", "12.0"):
        text = text.replace(f"gear_ratio = {gear}\n", "gear_ratio = 10.0\n")
    text = text.replace("min_position_rad = -3.13", "min_position_rad = -40.0")
    text = text.replace("max_position_rad = 3.13", "max_position_rad = 40.0")
    rig.write_text(text)
    assert run("plan", plan.parent / "w.design.json", "--rig", rig, "-o", "t.plan.json", cwd=tmp_path).returncode == 0
    words = ("t.plan.json", "--rig", rig, "--port", tmp_path / "ttyDXL")
    with virtual(tmp_path / "t.plan.json", tmp_path, "deployed", rig) as bus:
        before = shafts(bus)
        for more, message in (((), "--stands"), (("--stands", "stowed"), "not where the structure is said to stand")):
            done = run("stow", *words, *more, cwd=tmp_path)
            assert done.returncode == 3, done.stdout + done.stderr
            assert message in done.stderr
        np.testing.assert_array_equal(shafts(bus), before)
        done = run("stow", *words, "--stands", "deployed", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "state stowed" in done.stdout
        assert run("deploy", *words, cwd=tmp_path).returncode == 0  # the word still holds
        np.testing.assert_allclose(shafts(bus), before, atol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "message", "status"),
    [
        (("--rig", RIG, "--port", "nowhere"), "nowhere cannot be opened: no such device", 3),
        (("--rig", EXAMPLES / "rig_mock.toml", "--port", "x"), "--port", 2),
        (("--rig", EXAMPLES / "rig_mock.toml", "--stands", "stowed"), "--stands", 2),
    ],
)
def test_bad_input_is_one_line(
    plan: Path, tmp_path: Path, words: tuple[str | Path, ...], message: str, status: int
) -> None:
    made = plan
    if "rig_mock" in str(words[1]):
        assert (
            run("plan", plan.parent / "w.design.json", *words[:2], "-o", "m.plan.json", cwd=tmp_path).returncode == 0
        )
        made = tmp_path / "m.plan.json"
    done = run("deploy", made, *words, cwd=tmp_path)
    assert done.returncode == status, done.stderr
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
