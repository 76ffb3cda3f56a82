"""A session that takes orders: armed by one, and by every other that needs it."""

from __future__ import annotations

import pytest

from ori_deploy.deploy.states import IllegalCommand, State
from ori_deploy.operate.desk import Desk, Refusal
from ori_deploy.operate.messages import Answer, Code, Do, Request
from ori_deploy.operate.orders import StandingOrders
from ori_deploy.wire.vehicle import dialect
from tests.deploy.synthetic import Bench, bench
from tests.deploy.test_span import in_segments
from tests.mav.world import command, world
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


# -- a word that the span is unfolded ------------------------------------------------------------------


def segments(*, span_unfolded: bool = False) -> tuple[Bench, StandingOrders, Desk]:
    """A controller that takes orders, of a structure with a span in segments."""
    b = bench(in_segments())
    b.controller.disarm()
    orders = StandingOrders(b.controller, b.clock, 0.01, lambda: None, span_unfolded=span_unfolded)
    desk = Desk(b.controller, SESSION, b.plan, b.rig, b.bus, b.clock.now(), orders)
    b.controller.add_observer(desk)
    return b, orders, desk


def through(orders: StandingOrders) -> State | None:
    """Until an order has ended."""
    for _ in range(2000):
        result = orders.step()
        if result is not None:
            return result.state
    return None


def deploy(desk: Desk, *, word: bool = False) -> Answer:
    return desk.answer(Request(Do.DEPLOY, span_unfolded=word), "a page")


def test_a_word_is_good_for_one_deployment() -> None:
    """Reproduced: deployed, stowed, the span folded by hand, and Deploy was taken without asking again."""
    b, orders, desk = segments(span_unfolded=True)
    assert deploy(desk).took
    assert through(orders) is State.DEPLOYED
    assert desk.answer(Request(Do.STOW), "a page").took
    assert through(orders) is State.STOWED
    refused = deploy(desk)
    assert (refused.took, refused.code) == (False, Code.SPAN_WORD)
    assert "ori-deploy span-unfolded" in (refused.why or "")
    assert b.controller.state is State.STOWED
    assert deploy(desk, word=True).took
    assert through(orders) is State.DEPLOYED


def test_without_a_word_nothing_is_powered() -> None:
    b, _, desk = segments()
    assert deploy(desk).code is Code.SPAN_WORD
    assert b.controller.state is State.READY


def test_a_word_that_was_not_used_ends_with_the_stowing() -> None:
    b, orders, desk = segments(span_unfolded=True)
    orders.arm()
    desk.answer(Request(Do.STOW), "a page")
    assert through(orders) is State.STOWED
    assert deploy(desk).code is Code.SPAN_WORD
    assert b.controller.state is State.STOWED


def test_a_word_given_at_a_terminal_is_good_for_whoever_deploys_next_and_once() -> None:
    b, orders, desk = segments()
    assert desk.answer(Request(Do.SPAN_UNFOLDED), "a terminal").took
    assert b.controller.state is State.READY
    assert deploy(desk).took
    b.step_until_fold(0.3)
    desk.answer(Request(Do.STOP), "a page")
    assert through(orders) is State.ARMED
    assert deploy(desk).code is Code.SPAN_WORD  # held nowhere and nobody's: it is wanted again


def test_what_is_under_way_turns_round_and_goes_on_without_another_word() -> None:
    b, orders, desk = segments(span_unfolded=True)
    deploy(desk)
    for _ in range(120):
        orders.step()
    assert desk.answer(Request(Do.STOW), "a page").took
    orders.step()
    assert deploy(desk).took
    orders.step()
    assert desk.answer(Request(Do.PAUSE), "a page").took
    for _ in range(60):
        orders.step()
    assert b.controller.state is State.HOLD
    assert deploy(desk).took
    assert through(orders) is State.DEPLOYED


def test_a_ground_station_is_told_where_the_word_is_given() -> None:
    w = world(bench_of=bench(in_segments(), armed=False))
    w.run(1.0)
    w.hear(command(dialect.ORI_CMD_DEPLOY))
    w.run(0.3)
    assert [reason for _, reason in w.answers()] == [dialect.ORI_REASON_REFUSED]
    assert any("span-unfolded" in text for text in ["".join(w.texts())])
    assert w.state is State.READY
    w.desk.answer(Request(Do.SPAN_UNFOLDED), "a terminal")
    w.run(0.5)
    w.hear(command(dialect.ORI_CMD_DEPLOY))
    w.until(lambda: w.state is State.DEPLOYED)


def test_a_session_for_one_command_is_not_armed_by_order() -> None:
    b = bench()
    desk = Desk(b.controller, SESSION, b.plan, b.rig, b.bus, b.clock.now())
    assert desk.answer(Request(Do.ARM), "a page").code is Code.ONE_COMMAND
