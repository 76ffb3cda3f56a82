"""`bus calibrate` on virtual servos in this process and in virtual time: what it says, and how it ends."""

from __future__ import annotations

import math
import signal
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from ori_deploy.actuators.bus import ActuatorFault, CommandRefused
from ori_deploy.actuators.dynamixel.line import ServoLine
from ori_deploy.actuators.dynamixel.startup import MARK_ADDRESS, mark_of, write
from ori_deploy.actuators.dynamixel.wiring import HingeServo
from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import parse_rig
from ori_deploy.bench.calibration import HingeZero, NotCalibrated, Zero
from ori_deploy.bench.walk import Limits
from ori_deploy.cli import bus_calibrate
from ori_deploy.cli.bus_common import Place
from ori_deploy.cli.session import StopRequest
from ori_deploy.files import digest
from ori_deploy.motion import Plan
from ori_deploy.wire.dynamixel import OperatingMode, model_named
from sim_backends.dynamixel.packets import Instruction
from sim_backends.dynamixel.spec import ServoSpec
from tests.bench.servos import Bench

RIG = Path(__file__).parents[2] / "examples" / "rig_wing_dynamixel.toml"
WRITES = {3, 131}
XM = model_named("xm430")
STOP_RAD = 1.0
LIMITS = Limits(speed_rad_s=math.radians(100.0), current_a=None, max_temperature_c=70.0, min_voltage_v=10.0)


def rig() -> ResolvedRig:
    cells = ("c1", "c2", "c3", "c4")
    return resolve_rig(parse_rig(tomllib.loads(RIG.read_text()), "rig.toml"), cells, ("slit:P-T2",))


def hinge(k: int, turns: int = 1) -> HingeZero:
    """One that stands at its stop where its crease is at 0."""
    mode = OperatingMode.POSITION if turns == 1 else OperatingMode.EXTENDED_POSITION
    servo = HingeServo(f"servo_{k}", k, XM, mode, 0, 4096 * turns - 1)
    return HingeZero(servo, f"c{k}", "close_a", -1.0, STOP_RAD, 0.0, 1.0)


class AtBench(Place):
    """Whose line leads to a bench."""

    def __init__(self, bench: Bench) -> None:
        super().__init__("virtual", (1_000_000,), None)
        object.__setattr__(self, "_bench", bench)

    @contextmanager
    def opened(self) -> Iterator[ServoLine]:
        yield self._bench.line  # type: ignore[attr-defined]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    servos = [ServoSpec(id=k, start_rad=0.8, upper_stop_rad=STOP_RAD, load_nm=0.05) for k in (1, 2)]
    with Bench(*servos) as made:
        monkeypatch.setattr(bus_calibrate, "MonotonicClock", lambda: made.clock)
        yield made


def measure(bench: Bench, *hinges: HingeZero, limits: Limits = LIMITS) -> list[Zero]:
    return bus_calibrate._measure(AtBench(bench), rig(), hinges, limits, yes=True)


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        (replace(LIMITS, speed_rad_s=math.radians(400.0)), "servo 1: --speed 400 deg/s; limit: "),
        (replace(LIMITS, current_a=2.5), "servo 2: --current 2.5 A; limit: 2.00 A, as it is set; remedy: "),
    ],
)
def test_a_walk_that_a_hinge_cannot_make_is_refused_while_all_hold(bench: Bench, limits: Limits, says: str) -> None:
    write(bench.line, 2, XM.table.current_limit or XM.table.pwm_limit, 743)  # 2 A
    for k in (1, 2):
        write(bench.line, k, XM.table.torque_enable, 1)
    bench.told.clear()
    with pytest.raises(CommandRefused, match=says) as told:
        measure(bench, hinge(1), hinge(2), limits=limits)
    assert told.value.refused
    assert bench.torque_on(1)
    assert bench.torque_on(2)
    assert WRITES.isdisjoint(instruction.code for instruction in bench.told)


def test_a_walk_says_how_fast_it_may_go(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    """A servo's profile has steps; it goes at the next one."""
    measure(bench, hinge(1), limits=replace(LIMITS, speed_rad_s=math.radians(14.0)))
    err = capsys.readouterr().err
    assert "servo_1 (id 1, close_a of cell c1): walks to its stop, at up to 15.11 deg/s of the shaft\n" in err


@pytest.mark.parametrize(("turns", "warnings"), [(3, 1), (1, 0)])
def test_a_walk_that_ends_badly_warns_of_the_turns_that_it_cost(
    bench: Bench, capsys: pytest.CaptureFixture[str], turns: int, warnings: int
) -> None:
    write(bench.line, 1, mark_of(XM), MARK_ADDRESS)

    def fails_on_its_way(_: Instruction) -> bool:
        if bench.shaft_rad() > 0.9:
            bench.servo().fail(0x20)
        return True

    bench._hears = fails_on_its_way
    with pytest.raises(ActuatorFault, match="overload"):
        measure(bench, hinge(1, turns))
    said = capsys.readouterr().err
    assert said.count("warning: servo_1, of more than one turn, has forgotten its turns: say --stands") == warnings


def test_a_signal_that_comes_when_a_hinge_is_done_lets_no_other_one_walk(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Late(StopRequest):
        """The signal comes after the last look at it."""

        def __exit__(self, *error: Any) -> None:
            signal.raise_signal(signal.SIGINT)
            super().__exit__(*error)

    monkeypatch.setattr(bus_calibrate, "StopRequest", Late)
    with pytest.raises(SystemExit) as ended:
        measure(bench, hinge(1), hinge(2))
    assert ended.value.code == 130
    assert "interrupted: at its stop; it is limp, and nothing was written" in capsys.readouterr().err
    assert bench.shaft_rad(1) > 0.85
    assert bench.shaft_rad(2) == 0.8


def plan() -> Plan:
    """None: it is looked at only where there is a file to write."""
    return cast("Plan", None)


@pytest.mark.parametrize(
    ("meanwhile", "says"),
    [
        (None, "cannot be read; found No such file or directory"),
        (b"schema = 'ori-depl", "changed while"),
        (b"# \xe4", "changed while"),
    ],
)
def test_zeros_are_told_when_the_rig_is_no_file_any_more_to_put_them_into(
    tmp_path: Path, meanwhile: bytes | None, says: str
) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(RIG.read_bytes())
    read = replace(rig(), sha256=digest(path))
    if meanwhile is None:
        path.unlink()
    else:
        path.write_bytes(meanwhile)
    found = [Zero(hinge(k), 0.0, 0.0, 0.25 * k) for k in (1, 2)]
    with pytest.raises(
        NotCalibrated, match=rf"not written, c1 0\.250000, c2 0\.500000: .*rig\.toml: {says}.*remedy: "
    ):
        bus_calibrate._write(path, read, plan(), found, as_json=False)
    assert [other.read_bytes() for other in tmp_path.iterdir()] == [meanwhile] * (meanwhile is not None)


@pytest.mark.parametrize("wrong", [FileNotFoundError(2, "No such file or directory"), UnicodeError("bad byte")])
def test_zeros_are_told_when_the_rig_goes_in_the_moment_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: Exception
) -> None:
    def gone(*_: object) -> None:
        raise wrong

    path = tmp_path / "rig.toml"
    path.write_bytes(RIG.read_bytes())
    monkeypatch.setattr(bus_calibrate, "from_template", gone)
    found = [Zero(hinge(1), 0.0, 0.0, 0.25)]
    with pytest.raises(NotCalibrated, match=r"not written, c1 0\.250000: .*; remedy: put them in by hand"):
        bus_calibrate._write(path, replace(rig(), sha256=digest(path)), plan(), found, as_json=False)
