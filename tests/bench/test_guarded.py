"""A servo that was under torque is put back as it was, whatever happens meanwhile."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from ori_deploy.actuators.dynamixel import line as lines
from ori_deploy.actuators.dynamixel.line import ServoLine, ServoRefused
from ori_deploy.bench.guarded import Guarded, NotReached, NotRestored
from ori_deploy.bench.jog import carry_out, plan_move
from ori_deploy.wire.dynamixel import Register
from sim_backends.dynamixel.spec import ServoSpec
from tests.bench.servos import Bench


@pytest.fixture
def interrupt(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, int], None]:
    """Have writes of a register interrupted, so many of them."""
    write = ServoLine.write

    def begin(name: str, times: int) -> None:
        left = [times]

        def interrupted(line: ServoLine, servo_id: int, register: Register, value: int) -> None:
            if register.name == name and left[0]:
                left[0] -= 1
                raise KeyboardInterrupt
            write(line, servo_id, register, value)

        monkeypatch.setattr(lines.ServoLine, "write", interrupted)

    return begin


def under_torque(bench: Bench, then: Callable[[Guarded], None]) -> None:
    """A servo that goes slower than before and holds, and what is done with it."""
    with Guarded(bench.line, bench.pong(), bench.clock) as servo:
        servo.set(servo.table.profile_velocity, 17)
        servo.hold()
        then(servo)


STEPS = ("goal_position", "torque_enable", "bus_watchdog", "profile_velocity")


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("ended_by", [KeyboardInterrupt, ValueError])
def test_an_interrupt_on_the_way_out_skips_nothing(
    interrupt: Callable[[str, int], None], step: str, ended_by: type[BaseException]
) -> None:
    def end(_: Guarded) -> None:
        interrupt(step, 1)
        raise ended_by

    with Bench(ServoSpec(id=1)) as bench:
        with pytest.raises(KeyboardInterrupt):
            under_torque(bench, end)
        assert not bench.torque_on()
        assert (bench.register("bus_watchdog"), bench.register("profile_velocity")) == (0, 0)


def test_an_interrupt_at_the_end_of_what_went_well_ends_the_program_all_the_same(
    interrupt: Callable[[str, int], None],
) -> None:
    with Bench(ServoSpec(id=1)) as bench:
        with pytest.raises(KeyboardInterrupt):
            under_torque(bench, lambda _: interrupt("torque_enable", 1))
        assert not bench.torque_on()
        assert (bench.register("bus_watchdog"), bench.register("profile_velocity")) == (0, 0)


def test_a_step_that_is_interrupted_twice_is_told_and_the_others_are_done(
    interrupt: Callable[[str, int], None],
) -> None:
    def end(_: Guarded) -> None:
        interrupt("torque_enable", 2)
        raise KeyboardInterrupt

    with Bench(ServoSpec(id=1)) as bench:
        with pytest.raises(NotRestored, match="servo 1 could not be put back: torque may be on; remedy: "):
            under_torque(bench, end)
        assert (bench.register("bus_watchdog"), bench.register("profile_velocity")) == (0, 0)


LIMIT = 2_100
"""Of goals, in counts; these servos stand at 2700."""


def beyond_its_limit(*, holds: bool, tripped: bool) -> Bench:
    bench = Bench(ServoSpec(id=1, start_rad=1.0))
    servo = bench.servo()
    if holds:
        servo.write(servo.table.goal_position.address, bench.register("goal_position").to_bytes(4, "little"))
        servo.write(servo.table.torque_enable.address, b"\1")
    servo.put(servo.table.max_position_limit, LIMIT)
    if tripped:
        servo.trip()
    return bench


def test_a_limp_servo_whose_watchdog_tripped_is_given_no_goal() -> None:
    with beyond_its_limit(holds=False, tripped=True) as bench:
        goal = bench.register("goal_position")
        with Guarded(bench.line, bench.pong(), bench.clock):
            assert bench.register("bus_watchdog") == 0
        assert bench.register("goal_position") == goal


@pytest.mark.parametrize("tripped", [False, True])
def test_a_servo_that_holds_beyond_its_limit_is_stopped_at_it(tripped: bool) -> None:
    def end(servo: Guarded) -> None:
        if tripped:
            bench.servo().trip()
        servo.stop()

    with beyond_its_limit(holds=True, tripped=tripped) as bench:
        under_torque(bench, end)
        assert bench.register("goal_position") == LIMIT
        assert (bench.torque_on(), bench.register("bus_watchdog")) == (True, 0)


def test_a_servo_that_its_watchdog_stopped_is_not_waited_for() -> None:
    with Bench(ServoSpec(id=1)) as bench:
        move = plan_move(bench.line, bench.pong(), 1.0, by_rad=1.0)

        def busy_once() -> bool:
            if bench.shaft_rad() > 0.2 and not bench.bus.motors.frozen[0]:
                bench.clock.sleep_until(bench.clock.now() + 1.2)
            return False

        began = bench.clock.now()
        with pytest.raises(NotReached, match=r"servo 1 stopped: it heard nothing .*limit: 1 s; remedy: .*try again"):
            carry_out(bench.line, move, bench.clock, busy_once)
        assert bench.clock.now() - began < 3.0
        assert not bench.torque_on()
        assert bench.register("bus_watchdog") == 0


def test_a_goal_that_comes_after_the_watchdog_is_told_as_that() -> None:
    def late(servo: Guarded) -> None:
        bench.clock.sleep_until(bench.clock.now() + 1.2)
        servo.aim(2_100)

    with Bench(ServoSpec(id=1)) as bench:
        with pytest.raises(NotReached, match="servo 1 stopped: it heard nothing"):
            under_torque(bench, late)
        assert not bench.torque_on()


def test_a_goal_that_is_refused_for_itself_is_told_as_that() -> None:
    with Bench(ServoSpec(id=1)) as bench, pytest.raises(ServoRefused, match="goal_position = 5000"):
        under_torque(bench, lambda servo: servo.aim(5_000))
