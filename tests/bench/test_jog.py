"""A way that was told is the way that is gone, or none."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.dynamixel.line import ServoLine
from ori_deploy.actuators.dynamixel.port import BlockingPort
from ori_deploy.bench.jog import carry_out, plan_move
from ori_deploy.clock import MonotonicClock
from ori_deploy.wire.dynamixel import OperatingMode
from sim_backends.dynamixel_bus import BusSpec, ServoSpec, VirtualBus
from tests.bench.servos import Bench

STEP_DEG_S = 0.229 * 6.0
"""What the profile counts in."""


def test_a_shaft_that_was_turned_since_its_way_was_told_does_not_go(tmp_path: Path) -> None:
    spec = BusSpec(servos=(ServoSpec(id=1),), wire_timing=False)
    with VirtualBus(spec, tmp_path / "tty") as virtual:
        port = BlockingPort(str(virtual.link), spec.baud, slack_s=0.05)
        port.open()
        try:
            line = ServoLine(port)
            move = plan_move(line, line.ping(1), 1.0, by_rad=0.1)
            virtual.push(1, 1.0)
            with pytest.raises(CommandRefused, match=r"was turned by 65[12] counts"):
                carry_out(line, move, MonotonicClock(), lambda: False)
        finally:
            port.close()
        truth = virtual.truth()[1]
        assert truth.shaft_rad == pytest.approx(1.0, abs=0.01)
        assert not truth.torque_on


@pytest.mark.parametrize(("wished", "steps"), [(STEP_DEG_S, 1), (1.4, 2), (10.0, 8)])
def test_the_speed_of_a_move_is_the_one_that_its_servo_goes_at(wished: float, steps: int) -> None:
    with Bench(ServoSpec(id=1)) as bench:
        move = plan_move(bench.line, bench.pong(), math.radians(wished), by_rad=math.radians(5.0))
        assert math.degrees(move.speed_rad_s) == pytest.approx(steps * STEP_DEG_S)
        began = bench.clock.now()
        seen: list[int] = []
        carry_out(bench.line, move, bench.clock, lambda: bool(seen.append(bench.register("profile_velocity"))))
        assert set(seen) == {steps}
        assert move.way_rad / move.speed_rad_s == pytest.approx(bench.clock.now() - began, abs=0.6)


@pytest.mark.parametrize("wished", [0.1, 0.0, -5.0, 1e6])
def test_a_speed_that_a_servo_does_not_have_is_refused_with_both_limits(wished: float) -> None:
    with Bench(ServoSpec(id=1)) as bench:
        with pytest.raises(CommandRefused, match=r"limit: 1\.374 deg/s, .* to 274.8 deg/s, .*remedy"):
            plan_move(bench.line, bench.pong(), math.radians(wished), by_rad=0.1)
        assert not bench.torque_on()


@pytest.mark.parametrize("mode", [OperatingMode.POSITION, OperatingMode.EXTENDED_POSITION])
@pytest.mark.parametrize("by_rad", [math.radians(1e308), -1e306, 5_000.0])
def test_a_way_beyond_all_counts_is_refused_with_its_limits(mode: OperatingMode, by_rad: float) -> None:
    with Bench(ServoSpec(id=1)) as bench:
        bench.servo().put(bench.servo().table.operating_mode, mode)
        with pytest.raises(
            CommandRefused, match=r"would go to -?[\d.e+]{5,9} deg; limit: -\d+\.\d deg to \d+\.\d deg"
        ):
            plan_move(bench.line, bench.pong(), 1.0, by_rad=by_rad)


def test_a_goal_may_be_as_far_as_the_limit_and_no_count_farther() -> None:
    with Bench(ServoSpec(id=1)) as bench:
        bench.servo().put(bench.servo().table.max_position_limit, 2_500)
        for count, reached in ((2_500, True), (2_501, False)):
            goal = (count - 2_048) * 2.0 * math.pi / 4_096
            if reached:
                assert plan_move(bench.line, bench.pong(), 1.0, to_rad=goal).goal_rad == goal
            else:
                with pytest.raises(CommandRefused, match=r"limit: -180\.0 deg to 39\.7 deg"):
                    plan_move(bench.line, bench.pong(), 1.0, to_rad=goal)


def test_a_servo_goes_no_faster_than_it_is_set_to() -> None:
    with Bench(ServoSpec(id=1)) as bench:
        bench.servo().put(bench.servo().table.velocity_limit, 50)
        assert plan_move(bench.line, bench.pong(), math.radians(50 * STEP_DEG_S)).speed_rad_s > 0.0
        with pytest.raises(CommandRefused, match=r"--speed 200 deg/s; limit: .* to 68\.7 deg/s, its velocity_limit"):
            plan_move(bench.line, bench.pong(), math.radians(200.0))


@pytest.mark.parametrize(
    ("drive_mode", "words"),
    [(1, "reversed"), (4, "time-based profile"), (8, "a goal turns torque on"), (5, "reversed, time-based profile")],
)
def test_only_the_sense_and_speed_that_a_motion_has_are_jogged_in(drive_mode: int, words: str) -> None:
    with Bench(ServoSpec(id=1)) as bench:
        bench.servo().put(bench.servo().table.drive_mode, drive_mode)
        with pytest.raises(
            CommandRefused, match=rf"servo 1: drive_mode is {drive_mode}: {words}; limit: 0.*remedy: "
        ):
            plan_move(bench.line, bench.pong(), 1.0, by_rad=0.1)
        assert not bench.torque_on()
