"""The table of states keeps the promises that can be read off it."""

from __future__ import annotations

import pytest

from ori_deploy.deploy.states import COMMANDS, RULES, Action, Event, Guard, IllegalCommand, Machine, State
from tests.deploy.synthetic import bench

TRANSITIONS = {key: rule.targets for key, rule in RULES.items()}


def targets(state: State) -> set[State]:
    return {target for (source, _), ends in TRANSITIONS.items() if source is state for target in ends}


def test_every_state_can_be_reached_and_left() -> None:
    reached, todo = {State.DISCONNECTED}, [State.DISCONNECTED]
    while todo:
        new = targets(todo.pop()) - reached
        reached |= new
        todo.extend(new)
    assert reached == set(State)
    assert all(targets(state) - {state} for state in State)


def test_every_event_occurs() -> None:
    assert {event for _, event in TRANSITIONS} == set(Event)


def test_deployed_and_stowed_are_reached_from_latching_only() -> None:
    for goal in (State.DEPLOYED, State.STOWED):
        assert {source for (source, _), ends in TRANSITIONS.items() if goal in ends} == {State.LATCHING}


def test_moving_begins_from_latching_or_an_operators_word_only() -> None:
    ways = {key for key, ends in TRANSITIONS.items() if State.MOVING in ends}
    turning = {
        (state, command)
        for state in (State.MOVING, State.LATCHING, State.HOLD)
        for command in (Event.DEPLOY, Event.STOW)
    }
    assert ways == {(State.LATCHING, Event.RELEASED), (State.HOLD, Event.RESUME)} | turning


def test_the_emergency_stop_is_allowed_everywhere_and_leads_to_a_fault_wherever_there_is_a_link() -> None:
    for state in State:
        assert TRANSITIONS[state, Event.EMERGENCY_STOP] == (state if state is State.DISCONNECTED else State.FAULT,)


def test_every_guard_and_action_of_the_table_is_the_controllers_and_none_is_idle() -> None:
    controller = bench(armed=False).controller
    assert {rule.guard for rule in RULES.values()} - {None} == set(controller._guards) == set(Guard)
    assert {rule.action for rule in RULES.values()} - {None} == set(controller._actions) == set(Action)


def test_a_fault_can_happen_in_every_state_with_a_link_and_is_left_by_clearing_or_disconnecting_only() -> None:
    for state in set(State) - {State.DISCONNECTED, State.FAULT}:
        assert TRANSITIONS[state, Event.FAULT] == (State.FAULT,)
    exits = {event for (source, event), ends in TRANSITIONS.items() if source is State.FAULT and ends != (source,)}
    assert exits == {Event.CLEAR_FAULT, Event.DISCONNECT}


def test_nothing_leads_from_fault_into_motion() -> None:
    assert not targets(State.FAULT) & {State.MOVING, State.LATCHING, State.DEPLOYED, State.STOWED}


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_outside_the_table_is_refused_with_those_that_are_allowed(state: State, command: Event) -> None:
    machine = Machine()
    machine.state = state
    allowed = [other for other in COMMANDS if (state, other) in TRANSITIONS]
    if command in allowed:
        machine.require(command)
        return
    with pytest.raises(IllegalCommand) as caught:
        machine.require(command)
    assert caught.value.state is state
    assert caught.value.allowed == tuple(allowed)
    assert str(state) in str(caught.value)
    assert all(str(other) in str(caught.value) for other in allowed)


def test_an_event_that_can_lead_to_several_states_needs_one_of_them() -> None:
    machine = Machine()
    machine.state = State.HOLD
    for target in (None, State.DEPLOYED):
        with pytest.raises(ValueError, match="resume leads from hold"):
            machine.fire(Event.RESUME, 0.0, target)
    machine.fire(Event.RESUME, 1.0, State.LATCHING)
    assert machine.state is State.LATCHING
    (transition,) = machine.take_transitions()
    assert (transition.source, transition.target, transition.time_s) == (State.HOLD, State.LATCHING, 1.0)
    assert machine.take_transitions() == ()
