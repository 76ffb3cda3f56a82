"""What comes at the same moment, too late, or twice: nothing is claimed that is not so, nothing goes on by itself."""

from __future__ import annotations

import pytest

from ori_deploy.deploy.states import State
from ori_deploy.mav.commands import LONGEST_ANSWER_S
from ori_deploy.mav.words import Tune
from ori_deploy.operate.messages import Do, Request
from ori_deploy.wire.vehicle import dialect
from tests.mav.test_component import (
    ACCEPTED,
    CANCELLED,
    CLEAR,
    DENIED,
    DEPLOY,
    FAILED,
    FOLD,
    IN_PROGRESS,
    LATER,
    STOP,
    deployed,
)
from tests.mav.world import AUTOPILOT, GROUND, IN_AIR, US, World, command, heartbeat, world


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


def test_a_stop_that_got_lost_is_not_answered_by_an_older_one() -> None:
    """Who repeats it with confirmation 1 has sent a first one that nobody heard."""
    w = world()
    w.run(0.1)
    w.hear(command(STOP))
    assert w.answers() == [(ACCEPTED, dialect.ORI_REASON_NOTHING_TO_DO)]
    w.hear(command(DEPLOY), GROUND)
    w.until(lambda: w.state is State.MOVING and w.record.commanded_fold > 0.1)
    w.hear(command(STOP, confirmation=1))
    assert w.answers() == []
    w.until(lambda: w.state is State.ARMED, 3.0)
    w.run(0.2)
    assert set(results(w)) == {(STOP, ACCEPTED), (DEPLOY, CANCELLED)}
    w.hear(command(STOP, confirmation=2))  # and what is so is told again
    assert results(w) == [(STOP, ACCEPTED)]


def test_a_fault_is_not_forgotten_because_an_older_one_was() -> None:
    w = world()
    w.run(0.1)
    w.hear(command(CLEAR))
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING)
    w.bench.controller.emergency_stop()
    w.until(lambda: w.state is State.FAULT and w.desk.at_rest)
    w.run(0.3)
    results(w)
    w.hear(command(CLEAR, confirmation=1))
    w.run(0.2)
    assert w.state is not State.FAULT
    assert results(w) == [(CLEAR, ACCEPTED)]


# -- a loop that takes its time ----------------------------------------------------------------------------


def test_a_stop_for_a_silent_loop_waits_for_it() -> None:
    w = world()
    slowly(w, 0.2)
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING and w.record.commanded_fold > 0.05)
    w.loop_hangs = True
    w.run(1.5)
    results(w)
    for _ in range(300):  # a flood of them into a loop that is not there
        w.hear(command(STOP))
        w.cycle()
    assert results(w) == [(STOP, FAILED)]
    w.hear(command(STOP, confirmation=1))  # is no answer to this one
    assert len([word for word in w.to_loop if word[0] == "Ask"]) <= 3
    w.loop_hangs = False
    w.run(1.0)
    assert w.state in (State.ARMED, State.FAULT)
    assert w.record.rate == 0.0
    assert (STOP, ACCEPTED) in results(w)


def arming_for(w: World, seconds: float) -> None:
    """The first order takes so long: the loop connects, boards start, every servo is armed in its turn."""

    def vouch() -> None:
        for index in range(round(100.0 * seconds)):
            w.bench.clock.sleep_until(w.now + 0.01)
            if index % 50 == 0:
                w.hear(heartbeat())
            w.tell_component()

    w.orders._vouch = vouch


def test_an_order_that_takes_long_to_begin_is_told_and_watched() -> None:
    w = world(link_loss="hold", link_timeout_s=3.0)
    slowly(w, 0.2)
    w.run(0.1)
    arming_for(w, 6.0)
    w.hear(command(DEPLOY))
    w.cycle()
    told = [ack.result for ack in w.take(dialect.MAVLink_command_ack_message)]
    assert len(told) >= 5
    assert set(told) == {IN_PROGRESS}, "stations give up what nobody speaks of"
    w.run(0.5)
    assert w.state is State.MOVING
    w.run(4.0, ground=False)
    assert w.state is State.HOLD, "its station fell silent"
    assert results(w) == [(DEPLOY, FAILED)]


def test_an_order_that_was_given_up_and_begins_after_all_is_stopped() -> None:
    w = world()
    slowly(w)
    w.run(0.1)
    arming_for(w, LONGEST_ANSWER_S + 5.0)
    w.hear(command(DEPLOY))
    w.cycle()
    assert results(w) == [(DEPLOY, FAILED)]
    w.run(2.0)
    assert w.state is State.ARMED
    assert w.record.commanded_fold < 0.1
    assert not w.orders.running


def test_a_motion_whose_loop_was_silent_for_a_while_is_watched_again() -> None:
    w = world(link_loss="hold", link_timeout_s=3.0)
    slowly(w, 0.1)
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING)
    w.loop_hangs = True
    w.run(1.3)
    assert results(w) == [(DEPLOY, FAILED)]
    w.loop_hangs = False
    w.run(0.3)
    assert w.state is State.MOVING
    w.hear(command(FOLD))
    assert results(w) == [(FOLD, LATER)]
    w.hear(dialect.MAVLink_command_cancel_message(1, 140, DEPLOY))
    w.until(lambda: w.state is State.ARMED, 3.0)


# -- held, by others than the network ------------------------------------------------------------------------


@pytest.mark.parametrize("then", [DEPLOY, FOLD])
def test_what_was_held_by_a_terminal_goes_on_or_turns_round_for_a_station(then: int) -> None:
    w = world()
    slowly(w)
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING and w.record.commanded_fold > 0.2)
    w.desk.answer(Request(Do.PAUSE), "a terminal")
    w.run(2.5)
    acks = w.take(dialect.MAVLink_command_ack_message)
    assert (acks[-1].result, acks[-1].result_param2) == (FAILED, dialect.ORI_REASON_HELD)
    w.hear(command(then))
    w.until(lambda: w.state is (State.DEPLOYED if then == DEPLOY else State.STOWED))
    w.run(0.2)
    assert results(w) == [(then, ACCEPTED)]


def test_what_a_terminal_goes_on_with_is_the_stations_again() -> None:
    w = world(link_loss="hold", link_timeout_s=3.0)
    slowly(w, 0.1)
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING and w.record.commanded_fold > 0.1)
    w.desk.answer(Request(Do.PAUSE), "a terminal")
    w.run(1.0)
    assert results(w) == [(DEPLOY, FAILED)]
    w.desk.answer(Request(Do.RESUME), "a terminal")
    w.run(0.5)
    w.hear(command(FOLD))
    assert results(w) == [(FOLD, LATER)]
    w.run(4.0, ground=False)
    assert w.state is State.HOLD


def test_a_fault_cannot_be_cleared_before_its_order_is_over() -> None:
    """Two terminals in one cycle: one presses the emergency stop on what is held, the other clears the fault."""
    w = world()
    w.run(0.1)
    w.hear(command(DEPLOY))
    w.until(lambda: w.state is State.MOVING)
    w.desk.answer(Request(Do.PAUSE), "a terminal")
    w.run(1.0)
    assert w.desk.answer(Request(Do.ESTOP), "a terminal").took
    refused = w.desk.answer(Request(Do.CLEAR_FAULT), "another")
    assert not refused.took
    assert "not over" in (refused.why or "")
    w.cycle()
    assert w.desk.answer(Request(Do.CLEAR_FAULT), "another").took
    w.run(0.5)
    w.desk.answer(Request(Do.ARM), "a terminal")
    w.run(0.1)
    assert w.state is State.ARMED
