"""What comes at the same moment, too late, or twice: nothing is claimed that is not so, nothing goes on by itself."""

from __future__ import annotations

import pytest

from ori_deploy.deploy.states import State
from ori_deploy.mav.words import Tune
from ori_deploy.operate.messages import Do, Request
from ori_deploy.wire.vehicle import dialect
from tests.mav.test_component import (
    ACCEPTED,
    CANCELLED,
    DENIED,
    DEPLOY,
    FOLD,
    LATER,
    STOP,
    deployed,
)
from tests.mav.world import AUTOPILOT, IN_AIR, US, World, command, world


def slowly(w: World, part: float = 0.3) -> None:
    w.hear(dialect.MAVLink_param_set_message(*US, b"ORI_SPEED", part, dialect.MAV_PARAM_TYPE_REAL32))


def results(w: World) -> list[tuple[int, int]]:
    """Command and result of every final answer since the last time."""
    acks = w.take(dialect.MAVLink_command_ack_message)
    return [(ack.command, ack.result) for ack in acks if ack.result != dialect.MAV_RESULT_IN_PROGRESS]


# -- another terminal ----------------------------------------------------------------------------------


def test_a_deployment_that_a_terminal_turned_round_is_not_accepted() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING and w.record.commanded_fold > 0.2)
    assert w.desk.answer(Request(Do.STOW), "a terminal").took
    w.until(lambda: w.state is State.STOWED)
    w.run(0.2)
    assert w.answers() == [(CANCELLED, dialect.ORI_REASON_STOPPED)]


def test_a_terminals_motion_is_not_held_for_a_station_that_wanted_the_other_one() -> None:
    w = world(link_timeout_s=3.0)
    slowly(w)
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING and w.record.commanded_fold > 0.2)
    w.desk.answer(Request(Do.STOW), "a terminal")
    w.until(lambda: w.state is State.STOWED, ground=False)


def test_a_stop_right_after_a_terminals_order_stops_it() -> None:
    w = world()
    w.run(0.13)
    slowly(w)
    w.run(0.02)
    assert w.desk.answer(Request(Do.DEPLOY), "a terminal").took
    w.cycle()
    w.hear(command(STOP))
    w.run(1.5)
    assert w.state is State.ARMED
    assert w.answers() == [(ACCEPTED, 0)]


# -- two orders at once ----------------------------------------------------------------------------------


def test_deploy_is_not_accepted_while_a_fold_is_about_to_begin() -> None:
    w = deployed()
    w.hear(command(FOLD))
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.STOWED)
    w.run(0.2)
    assert results(w) == [(DEPLOY, LATER), (FOLD, ACCEPTED)]


@pytest.mark.parametrize("by_cancel", [False, True])
def test_a_command_sent_again_after_a_stop_does_not_begin_again(by_cancel: bool) -> None:
    """MAVSDK sends a command four times in 2 s, always with confirmation 0, while it hears no answer."""
    w = deployed()
    slowly(w)
    w.run(0.1)
    w.hear(command(FOLD))
    w.run(0.2)
    w.hear(dialect.MAVLink_command_cancel_message(1, 140, FOLD) if by_cancel else command(STOP))
    w.until(lambda: w.state is State.ARMED)
    w.run(0.1)
    where, begun = w.record.commanded_fold, w.now
    w.answers()
    for _ in range(2):
        w.hear(command(FOLD))
        w.run(0.5)
    assert w.record.commanded_fold == where
    assert set(w.answers()) == {(CANCELLED, dialect.ORI_REASON_STOPPED)}
    w.run(1.5)
    w.hear(command(FOLD))  # a new one
    w.until(lambda: w.state is State.STOWED)
    assert w.now > begun


def test_a_fold_that_was_held_and_is_sent_again_stays_held() -> None:
    w = deployed()
    slowly(w)
    w.run(0.1)
    w.hear(command(FOLD))
    w.run(0.2)
    w.autopilot(armed=True)
    for _ in range(40):
        w.cycle()
    assert w.state is State.HOLD
    w.autopilot(armed=False)  # all is well again, and the same command comes once more
    w.hear(command(FOLD))
    w.run(0.5)
    assert w.state is State.HOLD
    w.run(1.5)
    w.hear(command(FOLD))
    w.until(lambda: w.state is State.STOWED)


# -- a loop that is late ---------------------------------------------------------------------------------


def test_a_stop_is_carried_out_however_late() -> None:
    w = world()
    slowly(w, 0.1)
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING)
    w.hear(command(STOP))
    w.loop_hangs = True
    w.run(1.5)
    w.loop_hangs = False
    w.run(1.0)
    assert w.state in (State.ARMED, State.FAULT)
    assert w.record.rate == 0.0


def test_a_command_after_a_parameter_is_judged_by_it() -> None:
    w = world(deploy_when="always")
    w.run(0.1, landed=IN_AIR)
    for value in (1.0, 3.0):
        w.hear(dialect.MAVLink_param_set_message(*US, b"ORI_DEPLOY_WHEN", value, dialect.MAV_PARAM_TYPE_REAL32))
        w.component.tick(w.now)
    w.hear(command(DEPLOY))
    w.run(0.3, landed=IN_AIR)
    assert w.answers() == [(LATER, dialect.ORI_REASON_AIRBORNE)]


def test_a_flood_of_parameters_leaves_the_loop_its_orders() -> None:
    w = world()
    w.run(0.1)
    begun = len(w.words)
    for index in range(200):
        slowly(w, 0.1 + 0.001 * index)
        w.component.tick(w.now)
    assert len([word for word in w.to_loop if word[0] == "Tune"]) <= 1
    w.run(0.5)
    told = [word for word in w.words[begun:] if isinstance(word, Tune)]
    assert told[-1].speed == pytest.approx(0.1 + 0.199)


@pytest.mark.parametrize("number", [dialect.MAV_CMD_ARM_AUTHORIZATION_REQUEST, dialect.MAV_CMD_REQUEST_MESSAGE])
def test_nothing_is_said_of_a_structure_whose_loop_is_silent(number: int) -> None:
    w = deployed()
    w.loop_hangs = True
    w.run(1.5)
    w.sent.clear()
    w.hear(command(number, float(dialect.MAVLINK_MSG_ID_ORI_STRUCTURE)), AUTOPILOT)
    assert [result for result, _ in w.answers()] == [
        DENIED if number == dialect.MAV_CMD_ARM_AUTHORIZATION_REQUEST else LATER
    ]
    assert not w.take(dialect.MAVLink_ori_structure_message)
