"""Bringing cells that are out of step back onto the path."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.clock import VirtualClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.journal import Entry
from ori_deploy.deploy.result import CycleRecord, FaultKind, Outcome, StartRefused
from ori_deploy.deploy.states import IllegalCommand, State
from ori_deploy.deploy.way import Way
from ori_deploy.motion.recovery import Recovery
from sim_backends.mock import MockBus
from tests.deploy.synthetic import Bench, synthetic_plan, synthetic_rig

PLAN = synthetic_plan(4, curvature=0.3, tolerance=0.05)


def out_of_step(folds: list[float], **tables: object) -> Bench:
    """A bench whose cells stand each at a fold of its own, armed."""
    rig, clock = synthetic_rig(PLAN, **tables), VirtualClock(100.0)
    angles = PLAN.crease_angles_rad
    start = np.array([angles[int(np.searchsorted(PLAN.fold, fold)), c] for c, fold in enumerate(folds)])
    bus = MockBus.from_rig(rig, clock, angles[0], angles[-1], start_rad=start)
    records: list[CycleRecord] = []
    controller = Controller(PLAN, rig, bus, clock, [records.append])
    controller.connect()
    controller.arm()
    return Bench(PLAN, rig, clock, bus, controller, records)


def way(b: Bench, *corners: list[float]) -> Recovery:
    """A way from where the cells stand over these corners; nobody checks it here."""
    measured = b.controller.step().folds
    return Recovery(np.stack([np.clip(measured, 0.0, 1.0), *map(np.array, corners)]), 2)


def largest_crease_step(b: Bench) -> float:
    """Of driven creases, between two commands, radians."""
    goals = b.rig.to_crease(np.array([r.commanded_rad for r in b.records if np.isfinite(r.commanded_rad).all()]))
    return float(np.abs(np.diff(goals, axis=0)).max())


@settings(max_examples=5)
@given(
    folds=st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4),
    corners=st.lists(st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4), max_size=2),
    target=st.floats(0.1, 0.9),
)
def test_any_way_is_followed_slowly_and_ends_armed_in_step(
    folds: list[float], corners: list[list[float]], target: float
) -> None:
    b = out_of_step(folds, controller={"align_velocity_rad_s": 0.5})
    b.controller.recover(way(b, *corners, [target] * 4))
    result = b.controller.run()
    assert result.succeeded, result.fault
    assert (result.command, result.state) == ("recover", State.ARMED)
    np.testing.assert_allclose(b.records[-1].folds, target, atol=0.03)
    assert largest_crease_step(b) <= b.rig.controller.align_velocity_rad_s / 100.0 * 1.05
    assert largest_crease_step(b) < np.deg2rad(1.0)
    b.controller.deploy()
    assert b.controller.run().succeeded


def test_without_recovery_cells_out_of_step_are_refused() -> None:
    b = out_of_step([0.2, 0.5, 0.2, 0.2])
    with pytest.raises(StartRefused, match="c2 is out of step"):
        b.controller.deploy()


def test_a_way_that_begins_elsewhere_is_refused() -> None:
    b = out_of_step([0.2, 0.5, 0.2, 0.2])
    with pytest.raises(StartRefused, match="c2 is not where the way begins"):
        b.controller.recover(Recovery(np.array([[0.2, 0.4, 0.2, 0.2], [0.3] * 4]), 2))
    assert b.controller.state is State.ARMED


def test_a_recovery_holds_resumes_and_stops_but_does_not_turn_round() -> None:
    b = out_of_step([0.2, 0.5, 0.2, 0.2])
    b.controller.recover(way(b, [0.3] * 4))
    b.steps(60)
    with pytest.raises(IllegalCommand, match="brought into step"):
        b.controller.deploy()
    b.controller.hold()
    assert b.step_to_rest().state is State.HOLD
    with pytest.raises(IllegalCommand, match="brought into step"):
        b.controller.stow()
    goal = b.records[-1].commanded_rad
    np.testing.assert_array_equal(b.steps(20).commanded_rad, goal)
    b.controller.resume()
    b.steps(30)
    b.controller.stop()
    assert b.controller.run().outcome is Outcome.STOPPED
    b.controller.recover(way(b, [0.3] * 4))
    assert b.controller.run().succeeded


def test_a_cell_that_sticks_during_recovery_is_a_fault() -> None:
    b = out_of_step([0.2, 0.5, 0.2, 0.2])
    b.bus.jam("servo_c2")
    b.controller.recover(way(b, [0.3] * 4))
    result = b.controller.run()
    assert result.fault is not None
    assert (result.fault.kind, result.fault.thing) == (FaultKind.PATH_TOLERANCE, "servo_c2")
    rates = [r.rate for r in b.records if r.state is State.FAULT]
    assert all(after <= before for before, after in pairwise(rates))


def test_nothing_is_recovered_without_a_position() -> None:
    b = out_of_step([0.2, 0.5, 0.2, 0.2])
    planned = way(b, [0.3] * 4)
    b.bus.mute("servo_c1")
    with pytest.raises((StartRefused, CommandRefused), match="servo_c1"):
        b.controller.recover(planned)


def test_a_goal_off_the_way_is_taken_out_slowly_and_a_lost_reply_at_its_end_does_no_harm() -> None:
    b = out_of_step([0.2, 0.5, 0.2, 0.2])
    measured = b.controller.step().folds
    goal = b.controller._motion.goal + 0.3  # somebody told the shafts something else
    b.controller._motion.goal = goal
    recovery = Recovery(np.stack([np.clip(measured, 0.0, 1.0), np.full(4, 0.3)]), 2)
    follow = Way(recovery, goal, PLAN, b.rig, b.controller._motion.gentle)
    shafts = [follow.shaft()]
    np.testing.assert_allclose(shafts[0], goal)
    while not follow.finished:
        follow.variable.advance(0.01, 1.0, b.controller._motion.gentle)
        shafts.append(follow.shaft())
    speed = np.abs(np.diff(b.rig.to_crease(np.array(shafts)), axis=0)).max() / 0.01
    assert speed <= b.rig.controller.align_velocity_rad_s * 1.05


def test_a_reply_that_is_lost_as_the_way_ends_is_waited_for() -> None:
    b = out_of_step([0.2, 0.5, 0.2, 0.2])
    b.controller.recover(way(b, [0.3] * 4))
    while not b.controller._motion.followed:
        b.controller.step()
    b.bus.drop_replies("servo_c3", 1)
    assert b.controller.run().succeeded


def test_recovered_cells_are_noted_where_they_are() -> None:
    posted = []

    class Noted:
        last = failure = None

        def post(self, entry: Entry) -> None:
            posted.append(entry)

        def settled(self) -> bool:
            return True

    b = out_of_step([0.2, 0.5, 0.2, 0.2])
    b.controller._journal = Noted()  # type: ignore[assignment]
    b.controller.recover(way(b, [0.3] * 4))
    assert posted[-1].folds == pytest.approx((0.2, 0.5), abs=0.02)
    assert b.controller.run().succeeded
    assert posted[-1].state == "armed"
    assert posted[-1].folds == pytest.approx((0.3, 0.3), abs=0.02)
