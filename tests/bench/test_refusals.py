"""An error is a refusal, and gives status 3, only as long as nothing has moved, gone limp or been changed."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.dynamixel.line import ServoRefused
from ori_deploy.bench.board import release
from ori_deploy.bench.jog import carry_out, plan_move
from ori_deploy.bench.restart import reset_error
from ori_deploy.bench.servos import set_baud, torque_off
from ori_deploy.bench.walk import Limits, stop_zero
from ori_deploy.errors import InputError, begun
from ori_deploy.wire.generated import ori_deploy as d
from sim_backends.dynamixel.packets import Instruction
from sim_backends.dynamixel.servo import DATA_LIMIT, Refusal
from sim_backends.dynamixel.spec import ServoSpec
from tests.actuators.mcu.setups import electromagnet, wiring
from tests.bench.servos import Bench
from tests.bench.test_board_jog import Setup
from tests.bench.test_walk import LIMITS, XM, hinge, several_turns, vouch, vouched

OVERHEATING = 0x04
WRITE = 3


def test_what_fails_once_something_has_begun_is_no_refusal() -> None:
    for already, wrong in ((False, CommandRefused("no")), (True, CommandRefused("no")), (True, InputError("bad"))):
        with pytest.raises(type(wrong)) as told, begun(already=already):
            raise wrong
        assert told.value.refused is (not already)


def test_servos_that_may_have_gone_limp_were_not_refused() -> None:
    with Bench(ServoSpec(id=1), ServoSpec(id=2), slack_s=0.05) as bench:
        pongs = [bench.pong(1), bench.pong(2)]
        bench.bus.faults[1].mute = True
        with pytest.raises(CommandRefused, match="servo 2 does not confirm") as told:
            torque_off(bench.line, pongs)
    assert not told.value.refused


def test_a_rate_that_was_set_and_is_not_answered_at_was_not_refused() -> None:
    def falls_silent(instruction: Instruction) -> bool:
        bench.bus.faults[0].mute |= instruction.code == WRITE
        return True

    with Bench(ServoSpec(id=1), hears=falls_silent, slack_s=0.05) as bench:
        with pytest.raises(CommandRefused, match="no answer at 2000000 baud from servo 1") as told:
            set_baud(bench.line, [bench.pong()], 2_000_000)
        assert bench.register("baud_rate") == 4
    assert not told.value.refused


def test_a_servo_that_was_restarted_and_has_its_error_again_was_not_refused() -> None:
    with Bench(ServoSpec(id=1), slack_s=0.05) as bench:
        bench.bus.motors.temperature_c[0] = 95.0
        bench.servo().fail(OVERHEATING)
        with pytest.raises(CommandRefused, match="overheating again after a restart") as told:
            reset_error(bench.line, bench.pong(), bench.clock)
    assert not told.value.refused


def test_a_goal_that_is_refused_on_the_way_is_no_refusal_of_the_way() -> None:
    with Bench(ServoSpec(id=1)) as bench:
        move = plan_move(bench.line, bench.pong(), 1.0, by_rad=0.5)

        write = bench.servo().write

        def refuse_once(*_: object) -> None:
            bench.servo().write = write  # type: ignore[method-assign]
            raise Refusal(DATA_LIMIT)

        def under_way() -> bool:
            """It is to stop there, and refuses the goal by which it would."""
            if bench.shaft_rad() > 0.1:
                bench.servo().write = refuse_once  # type: ignore[method-assign]
            return bench.shaft_rad() > 0.1

        with pytest.raises(ServoRefused, match="goal_position") as told:
            carry_out(bench.line, move, bench.clock, under_way)
        assert 0.1 < bench.shaft_rad() < 0.4
    assert not told.value.refused


def test_a_way_that_does_not_begin_is_refused() -> None:
    with Bench(ServoSpec(id=1)) as bench:
        move = plan_move(bench.line, bench.pong(), 1.0, by_rad=0.5)
        bench.bus.motors.push(0, math.radians(30.0))
        with pytest.raises(CommandRefused, match="was turned by") as told:
            carry_out(bench.line, move, bench.clock, lambda: False)
    assert told.value.refused


def walk(bench: Bench, limits: Limits = LIMITS) -> None:
    stop_zero(bench.line, bench.pong(), hinge(), limits, bench.clock, lambda: False)


@pytest.mark.parametrize(
    ("error", "current_a", "says"),
    [(OVERHEATING, None, "servo 1 takes no torque, reports overheating"), (0, 9.0, r"--current 9 A; limit: 3\.21 A")],
)
def test_a_walk_that_cannot_begin_is_refused_before_anything_is_set(
    error: int, current_a: float | None, says: str
) -> None:
    with several_turns() as bench:
        vouch(bench, turns=2)
        bench.servo().fail(error)
        stood = bench.register("present_position")
        bench.told.clear()
        with pytest.raises(CommandRefused, match=says) as told:
            walk(bench, replace(LIMITS, current_a=current_a))
        assert WRITE not in {instruction.code for instruction in bench.told}
        assert vouched(bench)
        assert bench.register("present_position") == stood
    assert told.value.refused


def test_a_servo_that_has_forgotten_its_turns_for_a_walk_was_not_refused() -> None:
    """It finds something wrong with itself only once its mode is another."""
    mode = XM.table.operating_mode.address.to_bytes(2, "little")

    def fails_then(instruction: Instruction) -> bool:
        if instruction.code == WRITE and instruction.parameters.startswith(mode):
            bench.servo().fail(OVERHEATING)
        return True

    with several_turns() as bench:
        vouch(bench, turns=2)
        bench._hears = fails_then
        with pytest.raises(CommandRefused, match="takes no torque, reports overheating") as told:
            walk(bench)
        assert not vouched(bench)
    assert not told.value.refused


def test_a_latch_that_is_not_let_go_comes_after_hinges_that_were() -> None:
    one = Setup(wiring(latches=(electromagnet("em"),)))
    one.go(one.plan(by=0.1))
    one.device.latches[0].engaged = True
    one.device._on_ori_latch_command = lambda m: (d.ORI_REFUSED_INDEX, m.index, 0)  # type: ignore[method-assign]
    with pytest.raises(CommandRefused, match="em is not released") as told:
        release(one.board, with_latches=True)
    assert one.device.outputs_on == 0
    assert not told.value.refused


def test_a_hinge_that_is_not_turned_off_after_its_way_was_not_refused() -> None:
    one = Setup()
    jog = one.plan(by=0.1)
    one.device._on_ori_disable = lambda _: (d.ORI_REFUSED_STATE, 255, d.ORI_BRAKING)  # type: ignore[method-assign]
    with pytest.raises(CommandRefused, match="b stays on") as told:
        one.go(jog, let_go=True)
    assert not told.value.refused
