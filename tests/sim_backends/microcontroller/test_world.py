"""The world at the pins: servos follow, limp and jam; latches close where they can and hold."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim_backends.microcontroller.spec import HingeSpec, LatchSpec, WorldSpec
from sim_backends.mock_latches import GRIP_RAD
from tests.sim_backends.microcontroller.bench import Probe, probe

GRIP = GRIP_RAD + 1e-9


def ticks(hinge: HingeSpec, position_rad: float) -> int:
    return round((hinge.pulse_zero_ns + position_rad * hinge.pulse_slope_ns) / 500)


def go(chip: Probe, hinge: HingeSpec, position_rad: float, duration_s: float = 0.6) -> None:
    chip.tell("P", hinge.output, ticks(hinge, position_rad))
    chip.board.run(duration_s)


def test_a_servo_follows_no_faster_than_it_can_and_stays_when_the_pulses_end(tmp_path: Path) -> None:
    hinge = HingeSpec(output=7, adc=2, pulse_slope_ns=-636_620, max_velocity_rad_s=2.0, upper_rad=0.9)
    with probe(tmp_path / "tty", WorldSpec(hinges=(hinge,))) as chip:
        go(chip, hinge, 0.8, 0.12)
        assert 0.1 < chip.board.truth().shaft_rad[0] < 0.24
        chip.tell("P", 7, 0)
        chip.board.run(0.1)
        limp = chip.board.truth().shaft_rad[0]
        chip.board.run(0.3)
        assert chip.board.truth().shaft_rad[0] == limp
        go(chip, hinge, 0.8)
        assert chip.board.truth().shaft_rad[0] == pytest.approx(0.8, abs=0.001)
        go(chip, hinge, 1.0)
        assert chip.board.truth().shaft_rad[0] == 0.9


def test_a_jammed_shaft_stays_and_a_pushed_one_comes_back(tmp_path: Path) -> None:
    hinge = HingeSpec(output=0)
    with probe(tmp_path / "tty", WorldSpec(hinges=(hinge,))) as chip:
        chip.board.jam(0)
        go(chip, hinge, 0.5)
        assert chip.board.truth().shaft_rad == (0.0,)
        chip.board.push(0, 0.1)
        assert chip.board.truth().shaft_rad == (0.1,)
        chip.board.jam(0, False)
        chip.board.run(0.6)
        assert chip.board.truth().shaft_rad[0] == pytest.approx(0.5, abs=0.001)


def test_a_lock_pin_enters_only_its_hole_and_holds(tmp_path: Path) -> None:
    hinge = HingeSpec(output=0)
    pin = LatchSpec("lock_pin", output=11, sensor=3, hinges=(0,), closed_rad=(0.5,), range_rad=(0.02,))
    with probe(tmp_path / "tty", WorldSpec(hinges=(hinge,), latches=(pin,))) as chip:
        chip.tell("P", 11, 2 * pin.engaged_us)
        chip.board.run(1.0)
        latch = chip.board.truth().latches[0]
        assert not latch.closed
        assert 0.4 < latch.travel <= 0.5
        assert chip.ask("S") & 8
        go(chip, hinge, 0.51)
        chip.board.run(0.3)
        assert chip.board.truth().latches[0].closed
        assert not chip.ask("S") & 8
        go(chip, hinge, 0.0)
        assert 0.5 - GRIP <= chip.board.truth().shaft_rad[0] <= 0.5
        chip.tell("P", 11, 2 * pin.released_us)
        chip.board.run(0.8)
        assert not chip.board.truth().latches[0].closed
        assert chip.board.truth().shaft_rad[0] == pytest.approx(0.0, abs=0.001)


def test_an_electromagnet_takes_hold_in_reach_and_lets_go(tmp_path: Path) -> None:
    hinge = HingeSpec(output=0)
    magnets = (
        LatchSpec("electromagnet", output=5, sensor=0, hinges=(0,), closed_rad=(0.2,), range_rad=(0.05,)),
        LatchSpec("magnet", sensor=1, sensor_high=True, hinges=(0,), closed_rad=(0.2,), range_rad=(0.05,)),
    )
    with probe(tmp_path / "tty", WorldSpec(hinges=(hinge,), latches=magnets)) as chip:
        chip.ask("M", 5, 1)
        assert chip.ask("S") & 3 == 0b01
        go(chip, hinge, 0.2)
        assert [latch.closed for latch in chip.board.truth().latches] == [True, True]
        assert chip.ask("S") & 3 == 0b10
        go(chip, hinge, -0.3)
        assert chip.board.truth().shaft_rad[0] == pytest.approx(0.2, abs=GRIP)
        chip.board.latch_stuck(0)
        chip.ask("M", 5, 0)
        chip.board.run(0.3)
        assert chip.board.truth().latches[0].closed
        chip.board.latch_stuck(0, False)
        chip.board.run(0.6)
        truth = chip.board.truth()
        assert [latch.closed for latch in truth.latches] == [False, False]
        assert truth.shaft_rad[0] == pytest.approx(-0.3, abs=0.001)
        assert truth.latches[0].energised_s == pytest.approx(1.2, abs=0.1)


def test_a_pin_that_starts_home_is_closed(tmp_path: Path) -> None:
    pin = LatchSpec(
        "lock_pin", output=4, sensor=6, hinges=(0,), closed_rad=(0.0,), range_rad=(0.02,), start_closed=True
    )
    with probe(tmp_path / "tty", WorldSpec(hinges=(HingeSpec(output=0),), latches=(pin,))) as chip:
        assert chip.board.truth().latches[0].closed
        chip.board.push(0, 0.4)
        assert chip.board.truth().shaft_rad[0] == pytest.approx(GRIP_RAD)


def test_a_bouncing_sensor_bounces(tmp_path: Path) -> None:
    with probe(tmp_path / "tty") as chip:
        chip.board.sensor(2, "bounces")
        levels = {chip.ask("S") & 4 for _ in range(20)}
        assert levels == {0, 4}
