"""What the desk says is what the controller says."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ori_deploy.actuators import rig
from ori_deploy.deploy.states import State
from ori_deploy.operate.desk import Desk
from ori_deploy.operate.due import DueGoals
from ori_deploy.operate.messages import MAY_MOVE, STOW_POINT, Code, Do, Request, Status
from ori_deploy.operate.orders import StandingOrders
from tests.deploy.synthetic import Bench, bench
from tests.deploy.test_controller import PIN, STOW_LOCK
from tests.operate.served import SESSION


def desk_of(b: Bench) -> Desk:
    desk = Desk(b.controller, SESSION, b.plan, b.rig, b.bus, b.clock.now())
    b.controller.add_observer(desk)
    return desk


def status(desk: Desk) -> Status:
    told = desk.answer(Request(Do.STATUS), "somebody").status
    assert told is not None
    return told


def test_before_the_first_cycle_nothing_is_made_up() -> None:
    now = status(desk_of(bench()))
    assert (now.state, now.cycles, now.stage, now.command) == (State.ARMED, 0, None, None)
    assert now.fold is now.rate is now.progress_percent is now.remaining_s is None
    assert now.latches == ()
    assert now.plan == str(Path("/somewhere/wing.plan.json"))


def test_a_deployment_is_told_as_it_is() -> None:
    b = bench()
    desk = desk_of(b)
    b.controller.deploy()
    record = b.step_until_fold(0.5)
    now = status(desk)
    assert (now.state, now.stage, now.command, now.at_rest) == (State.MOVING, "open", "deploy", False)
    assert now.fold == pytest.approx(record.commanded_fold, abs=1e-6)
    assert now.rate == pytest.approx(record.rate, abs=1e-6)
    assert now.remaining_s == pytest.approx(2.0 - record.path_time_s, abs=1e-3)
    assert now.progress_percent == pytest.approx(50.0 * record.path_time_s, abs=0.01)
    assert now.uptime_s == pytest.approx(record.time_s - 100.0, abs=1e-3)
    result = b.controller.run()
    now = status(desk)
    assert (now.state, now.progress_percent, now.remaining_s, now.at_rest) == (State.DEPLOYED, 100.0, 0.0, True)
    assert now.command == "deploy"
    assert [latch.confirmed for latch in now.latches] == [True, True]
    # The monitor compares with the goal that was due as well; it looks at alignment a little differently.
    assert now.worst_tracking_rad == pytest.approx(result.worst_tracking_rad, rel=0.05)
    assert now.worst_tracking_hinge in b.bus.hinge_ids


def test_progress_of_a_stow_counts_backwards() -> None:
    b = bench(start="deployed")
    desk = desk_of(b)
    b.controller.stow()
    record = b.step_until_fold(0.9)
    now = status(desk)
    assert now.command == "stow"
    assert now.remaining_s == pytest.approx(record.path_time_s, abs=1e-3)
    assert now.progress_percent is not None
    assert now.progress_percent < 50.0


@pytest.mark.parametrize("do", sorted(MAY_MOVE))
def test_a_session_that_ends_takes_stops_and_nothing_that_moves(do: Do) -> None:
    b = bench()
    desk = desk_of(b)
    desk.closing = True
    told = desk.answer(Request(do), "somebody")
    assert (told.took, told.code) == (False, Code.NOT_NOW)
    assert told.why == "the session has been told to end, and does at rest"
    assert desk.answer(Request(Do.ESTOP), "somebody").took
    assert b.controller.state is State.FAULT


def test_a_fault_is_told_with_its_remedy() -> None:
    b = bench()
    desk = desk_of(b)
    b.controller.deploy()
    b.step_until_fold(0.3)
    answer = desk.answer(Request(Do.ESTOP), "the test")
    assert answer.took
    assert answer.state is State.FAULT
    assert answer.fault is not None
    assert "pressed by the test" in answer.fault
    assert "remedy: " in answer.fault
    b.step_to_rest()
    assert status(desk).fault == answer.fault
    refused = desk.answer(Request(Do.RESUME), "the test")
    assert not refused.took
    assert refused.allowed == (Do.STATUS, Do.ESTOP)
    assert refused.fault == answer.fault


def test_a_pause_while_paused_changes_nothing_and_is_taken() -> None:
    b = bench()
    desk = desk_of(b)
    assert not desk.answer(Request(Do.PAUSE), "too early").took
    b.controller.deploy()
    b.step_until_fold(0.3)
    assert desk.answer(Request(Do.PAUSE), "the test").why is None
    again = desk.answer(Request(Do.PAUSE), "the test")
    assert (again.took, again.state, again.why) == (True, State.HOLD, "paused already")


def test_stop_is_remembered_and_only_when_it_was_taken() -> None:
    b = bench()
    desk = desk_of(b)
    assert not desk.answer(Request(Do.STOP), "too early").took
    assert desk.stopped_by is None
    b.controller.deploy()
    b.step_until_fold(0.3)
    assert desk.answer(Request(Do.STOP), "the test").state is State.STOPPING
    assert desk.stopped_by == "the test"


def test_behind_a_queue_it_is_the_goal_that_is_due_that_counts() -> None:
    """A hinge that does exactly what it is told, 0.3 s later, is never off."""
    b = bench()
    b.controller.deploy()
    b.steps(2)
    delay = 0.3
    exact, late = DueGoals(b.rig, delay), DueGoals(b.rig, delay, lambda now: now + delay)
    record, n = b.records[-1], len(b.bus.hinge_ids)
    for k in range(200):
        now = 100.0 + 0.01 * k
        for due, behind in ((exact, delay), (late, delay + 0.1)):
            at = np.full(n, math.sin(now - behind))
            readings = replace(record.readings, position_rad=at)
            due.note(replace(record, time_s=now, commanded_rad=np.full(n, math.sin(now)), readings=readings))
    gear = 4.0
    assert exact.worst_rad < 1e-4
    assert exact.off_rad <= exact.worst_rad
    assert late.worst_rad == pytest.approx(0.1 / gear, rel=0.1)


def test_a_page_is_told_every_cell_s_fold_its_current_and_its_temperature() -> None:
    b = bench()
    desk = desk_of(b)
    assert status(desk).folds == status(desk).current_a == status(desk).temperature_c == ()
    b.controller.deploy()
    record = b.step_until_fold(0.5)
    now = status(desk)
    assert now.folds == pytest.approx(record.folds, abs=1e-5)
    assert now.current_a == pytest.approx(record.readings.current_a, abs=1e-3)
    assert len(now.temperature_c) == len(record.readings.current_a)
    assert not now.takes_orders


def test_without_a_link_nothing_is_known_and_what_was_counted_stays() -> None:
    """Reproduced: 900 lost replies and no link were "50 % open, out of step 0.000"."""
    b = bench()
    orders = StandingOrders(b.controller, b.clock, 0.01, lambda: None)
    desk = Desk(b.controller, SESSION, b.plan, b.rig, b.bus, b.clock.now(), orders)
    b.controller.add_observer(desk)
    b.controller.deploy()
    b.step_until_fold(0.5)
    before = status(desk)
    assert before.folds
    assert before.current_a
    b.bus.unplug()
    b.step_to_rest()
    assert desk.answer(Request(Do.CLEAR_FAULT), "the test").state is State.DISCONNECTED
    now = status(desk)
    assert now.fold is now.rate is now.progress_percent is now.remaining_s is now.stage is None
    assert now.folds == now.current_a == now.temperature_c == now.latches == ()
    assert now.cycles > before.cycles
    b.bus.replug()
    b.controller.connect()
    assert status(desk).folds == ()  # nor is it made up of what was read before


def test_what_pauses_a_motion_is_told() -> None:
    b = bench()
    desk = desk_of(b)
    b.controller.deploy()
    b.step_until_fold(0.3)
    assert status(desk).concern is None
    b.bus.overheat("servo_c2", 75.0)
    for _ in range(200):
        b.controller.step()
        if b.controller.concern is not None:
            break
    told = status(desk)
    assert told.state is State.HOLD
    assert "servo_c2" in (told.concern or "")


def test_latches_tell_the_point_they_are_on() -> None:
    b = bench(latch=[PIN, STOW_LOCK, {**PIN, "id": "other", "secures": "cell:c1"}])
    desk = desk_of(b)
    b.controller.deploy()
    b.controller.run()
    now = status(desk)
    assert {one.id: one.secures for one in now.latches} == {
        "pin": "slit:P-T2", STOW_LOCK["id"]: STOW_POINT, "other": "cell:c1"
    }  # fmt: skip
    assert now.secured == (2, 2)
    assert STOW_POINT == rig.STOW_POINT
