"""A session that takes orders: armed by one, and by every other that needs it."""

from __future__ import annotations

import pytest

from ori_deploy.deploy.states import IllegalCommand, State
from ori_deploy.operate.desk import Desk, Refusal
from ori_deploy.operate.messages import Code, Do, Request
from ori_deploy.operate.orders import StandingOrders
from tests.deploy.synthetic import Bench, bench
from tests.operate.served import SESSION


def standing(b: Bench) -> StandingOrders:
    b.controller.disarm()
    return StandingOrders(b.controller, b.clock, 0.01, lambda: None)


def test_to_arm_holds_where_measured_and_moves_nothing() -> None:
    b = bench()
    orders = standing(b)
    assert b.controller.state is State.READY
    orders.arm()
    assert b.controller.state is State.ARMED
    assert not orders.running
    with pytest.raises(IllegalCommand):
        orders.arm()


class Closed:
    """An interlock that lets nothing move."""

    def refuses(self, do: Do, force: bool) -> Refusal | None:
        del force
        return Refusal(Code.AIRBORNE, "in the air") if do is Do.DEPLOY else None


def test_nothing_is_powered_where_nothing_may_move() -> None:
    b = bench()
    orders = standing(b)
    desk = Desk(b.controller, SESSION, b.plan, b.rig, b.bus, b.clock.now(), orders, Closed())
    answer = desk.answer(Request(Do.ARM), "a page")
    assert (answer.took, answer.code) == (False, Code.AIRBORNE)
    assert b.controller.state is State.READY


def test_a_session_for_one_command_is_not_armed_by_order() -> None:
    b = bench()
    desk = Desk(b.controller, SESSION, b.plan, b.rig, b.bus, b.clock.now())
    assert desk.answer(Request(Do.ARM), "a page").code is Code.ONE_COMMAND
