"""Hinges walked against their stops: virtual servos, in virtual time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from ori_deploy.actuators.bus import BusTimeout, CommandRefused
from ori_deploy.actuators.dynamixel.startup import MARK_ADDRESS, mark_of, write
from ori_deploy.actuators.dynamixel.wiring import RAD_PER_COUNT, HingeServo
from ori_deploy.bench.calibration import LEAD_RAD, HingeZero, NotCalibrated, Zero, held_zero
from ori_deploy.bench.walk import Limits, stop_zero
from ori_deploy.wire.dynamixel import OperatingMode, model_named
from sim_backends.dynamixel.packets import Instruction
from sim_backends.dynamixel.spec import ServoSpec
from tests.bench.servos import Bench

XM = model_named("xm430")
TURN = 2.0 * math.pi
PING, READ = 1, 2

STOP_RAD = 3.6
"""Where the shaft of these hinges is stopped: its first turn ends at 3.14."""

LIMITS = Limits(speed_rad_s=2.0, current_a=None, max_temperature_c=70.0, min_voltage_v=10.0)


def hinge(old_zero_rad: float = 0.0, way_rad: float = 2.0) -> HingeZero:
    """One of several turns that stands at its stop where its crease is at 0."""
    servo = HingeServo("servo_1", 1, XM, OperatingMode.EXTENDED_POSITION, -20_000, 20_000)
    return HingeZero(servo, "c1", "close_a", -1.0, old_zero_rad, 0.0, way_rad)


def several_turns(start_rad: float = 2.5) -> Bench:
    """A servo that stands before the end of its first turn, which it counts on beyond."""
    return Bench(ServoSpec(id=1, start_rad=start_rad, upper_stop_rad=STOP_RAD, load_nm=0.05))


def vouch(bench: Bench, turns: int = 0) -> None:
    """As `ori-deploy deploy --stands` leaves it."""
    write(bench.line, 1, XM.table.operating_mode, OperatingMode.EXTENDED_POSITION)
    write(bench.line, 1, XM.table.homing_offset, 4096 * turns)
    write(bench.line, 1, mark_of(XM), MARK_ADDRESS)


def vouched(bench: Bench) -> bool:
    return bench.line.read(1, mark_of(XM)) == MARK_ADDRESS


def by_stop(bench: Bench, one: HingeZero, forgets: Callable[[], None] = lambda: None) -> Zero:
    return stop_zero(bench.line, bench.pong(), one, LIMITS, bench.clock, lambda: False, forgets)


def test_nobody_vouches_any_more_for_turns_that_a_calibration_lost() -> None:
    forgotten: list[bool] = []
    with several_turns() as bench:
        vouch(bench)
        before = bench.shaft_rad() - bench.register("present_position") * RAD_PER_COUNT
        by_stop(bench, hinge(), lambda: forgotten.append(vouched(bench)))
        after = bench.shaft_rad() - bench.register("present_position") * RAD_PER_COUNT
        assert after - before == pytest.approx(TURN, abs=0.01)  # the mode came back, and it counts from its turn now
        assert not vouched(bench)
    assert forgotten == [True]  # told once, and before it is done


@pytest.mark.parametrize("ends", [NotCalibrated, BusTimeout, KeyboardInterrupt])
def test_turns_that_were_lost_are_told_of_however_a_walk_ends(ends: type[BaseException]) -> None:
    def end() -> bool:
        if ends is NotCalibrated:
            return True
        raise ends

    forgotten: list[bool] = []
    with several_turns() as bench:
        vouch(bench)
        with pytest.raises(ends):
            stop_zero(
                bench.line, bench.pong(), hinge(), LIMITS, bench.clock, end, lambda: forgotten.append(vouched(bench))
            )
        assert not vouched(bench)
    assert forgotten == [True]


def test_turns_that_were_vouched_for_are_those_of_the_zero() -> None:
    """The old zero is one of other turns, and the servo knew better until its mode was changed."""
    for turns in (0, 3):
        with several_turns() as bench:
            vouch(bench, turns)
            zero = by_stop(bench, hinge(old_zero_rad=STOP_RAD - 2 * TURN))
        assert zero.zero_rad == pytest.approx(STOP_RAD + turns * TURN, abs=0.01)


def test_turns_that_nobody_vouched_for_are_those_of_the_old_zero() -> None:
    forgotten: list[bool] = []
    with several_turns() as bench:
        write(bench.line, 1, XM.table.operating_mode, OperatingMode.EXTENDED_POSITION)
        zero = by_stop(bench, hinge(old_zero_rad=STOP_RAD - 2 * TURN), lambda: forgotten.append(True))
    assert zero.zero_rad == pytest.approx(STOP_RAD - 2 * TURN, abs=0.01)
    assert not forgotten


@pytest.mark.parametrize("reversed_before", [False, True])
def test_a_held_pose_leaves_the_word_for_its_turns_unless_the_sense_had_to_be_changed(reversed_before: bool) -> None:
    forgotten: list[bool] = []
    with several_turns() as bench:
        vouch(bench, turns=2)
        if reversed_before:
            bench.servo().put(XM.table.drive_mode, 1)
        zero = held_zero(
            bench.line, bench.pong(), hinge(old_zero_rad=2.5), bench.clock, lambda: forgotten.append(True)
        )
        assert vouched(bench) is not reversed_before
    assert zero.zero_rad == pytest.approx(2.5 if reversed_before else 2.5 + 2 * TURN, abs=0.01)
    assert forgotten == [True] * reversed_before


def test_a_hinge_that_backs_off_from_its_stop_stops_where_it_is_when_told_to() -> None:
    with several_turns() as bench:
        farthest = [0.0]

        def backing_off() -> bool:
            """Once it has left the stop again."""
            farthest.append(max(farthest[-1], bench.shaft_rad()))
            return farthest[-1] > STOP_RAD - 0.01 and bench.shaft_rad() < STOP_RAD - 0.02

        slow = replace(LIMITS, speed_rad_s=0.3)
        with pytest.raises(NotCalibrated, match=r"servo_1 \(id 1\): stopped while it backed off"):
            stop_zero(bench.line, bench.pong(), hinge(), slow, bench.clock, backing_off)
        assert STOP_RAD - 0.08 < bench.shaft_rad() < STOP_RAD - 0.02
        assert not bench.torque_on()


def give_way(bench: Bench, at_rad: float, times: int = 1) -> Callable[[], bool]:
    """Something holds the shaft there so often, and falls off when it backs off."""
    jammed, met = bench.bus.motors.jammed, [0]

    def look() -> bool:
        backs_off = bench.servo().rad_of(bench.register("goal_position")) < bench.shaft_rad() - 0.05
        if jammed[0] and backs_off:
            jammed[0] = False
        elif not jammed[0] and not backs_off and bench.shaft_rad() > at_rad and met[0] < times:
            jammed[0], met[0] = True, met[0] + 1
        return False

    return look


def test_what_gives_way_is_not_taken_for_the_stop_nor_driven_through() -> None:
    with several_turns() as bench:
        with pytest.raises(
            NotCalibrated, match=r"stood still at 17\d\.\d\d deg .* went on past it to 1[78]\d\."
        ) as told:
            stop_zero(bench.line, bench.pong(), hinge(), LIMITS, bench.clock, give_way(bench, 3.0))
        assert "limit: within 1.04 deg, as of one stop; remedy: " in str(told.value)
        assert 3.0 < bench.shaft_rad() < 3.25
        assert not bench.torque_on()


def test_what_is_met_before_the_place_where_it_was_met_first_is_no_stop() -> None:
    with several_turns() as bench:

        def in_its_way() -> bool:
            """Something falls between once it has been at its stop."""
            backs_off = bench.servo().rad_of(bench.register("goal_position")) < bench.shaft_rad() - 0.02
            farthest.append(max(farthest[-1], bench.shaft_rad()))
            was_there = farthest[-1] > STOP_RAD - 0.001 and bench.shaft_rad() < STOP_RAD - 0.03
            bench.bus.motors.jammed[0] = was_there and bench.shaft_rad() > STOP_RAD - 0.06 and not backs_off
            return False

        farthest = [0.0]
        slow = replace(LIMITS, speed_rad_s=0.5)
        with pytest.raises(NotCalibrated, match=r"at places [23]\.\d\d deg of the shaft apart; limit: 0\.69 deg"):
            stop_zero(bench.line, bench.pong(), hinge(), slow, bench.clock, in_its_way)


def test_the_second_way_to_a_stop_goes_no_farther_than_the_first_may() -> None:
    """What falls off just before the end of the way does not make it longer."""
    one = hinge(way_rad=1.8)
    with several_turns(start_rad=0.0) as bench, pytest.raises(NotCalibrated):
        stop_zero(bench.line, bench.pong(), one, LIMITS, bench.clock, give_way(bench, 1.94))
    assert bench.shaft_rad() < 1.1 * one.way_rad + 0.2 + LEAD_RAD


def test_a_shaft_that_is_stuck_both_ways_stands_at_no_stop() -> None:
    with several_turns() as bench:
        bench.bus.motors.jammed[0] = True
        with pytest.raises(
            NotCalibrated, match=r"servo_1 \(id 1\): does not come away.*: 0\.00 deg.*limit: 2\.86 deg.*--current"
        ):
            by_stop(bench, hinge(old_zero_rad=STOP_RAD))
        assert not bench.torque_on()


def test_what_comes_back_no_farther_than_something_elastic_does_is_no_stop() -> None:
    clamped = ServoSpec(id=1, start_rad=3.58, lower_stop_rad=STOP_RAD - 0.03, upper_stop_rad=STOP_RAD, load_nm=0.05)
    with Bench(clamped) as bench, pytest.raises(NotCalibrated, match=r"come away from where it stood: 1\.[67]\d deg"):
        by_stop(bench, hinge())


def test_the_slowest_hinge_there_is_has_time_to_come_away_from_its_stop() -> None:
    with several_turns(start_rad=STOP_RAD - 0.02) as bench:
        slowest = replace(LIMITS, speed_rad_s=0.024)
        zero = stop_zero(bench.line, bench.pong(), hinge(STOP_RAD), slowest, bench.clock, lambda: False)
        assert bench.shaft_rad() < STOP_RAD - 0.08
    assert zero.zero_rad == pytest.approx(STOP_RAD, abs=0.01)


@pytest.mark.parametrize("off_rad", [0.05, -0.05])
def test_a_stop_is_compared_with_what_the_old_zero_has(off_rad: float) -> None:
    with several_turns() as bench:
        zero = by_stop(bench, hinge(old_zero_rad=STOP_RAD + off_rad))
    assert zero.short_rad == pytest.approx(off_rad, abs=0.01)


def test_every_gain_that_a_change_of_mode_resets_is_put_back() -> None:
    gains = [
        register
        for register in XM.table
        if XM.table.velocity_i_gain.address <= register.address <= XM.table.feedforward_1st_gain.address
    ]
    assert len(gains) == 7
    with several_turns() as bench:
        for k, register in enumerate(gains):
            bench.servo().put(register, 501 + k)
        by_stop(bench, hinge())
        assert [bench.register(register.name) for register in gains] == [501 + k for k in range(7)]


def test_a_slow_line_makes_no_slow_walk() -> None:
    def late(_: Instruction) -> bool:
        bench.clock.sleep_until(bench.clock.now() + 0.016)
        return True

    with several_turns(start_rad=2.0) as bench:
        bench._hears = late
        began = bench.clock.now()
        slow = replace(LIMITS, speed_rad_s=0.2)
        stop_zero(bench.line, bench.pong(), hinge(), slow, bench.clock, lambda: False)
        assert bench.clock.now() - began < 1.5 * (STOP_RAD - 2.0) / 0.2 + 5.0


def test_a_walk_that_is_faster_than_its_servo_is_refused_before_anything_is_set() -> None:
    with several_turns() as bench:
        for speed in (1e3, 1e300):
            with pytest.raises(CommandRefused, match=r"limit: .* to 274.8 deg/s") as refused:
                stop_zero(
                    bench.line, bench.pong(), hinge(), replace(LIMITS, speed_rad_s=speed), bench.clock, lambda: False
                )
            assert refused.value.refused
        assert {instruction.code for instruction in bench.told} <= {PING, READ}
