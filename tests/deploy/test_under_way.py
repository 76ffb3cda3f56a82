"""Commands under way: hold, stop, turn round, slow down, and the emergency stop."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from ori_deploy.deploy.localise import Localiser
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.result import FaultKind, Outcome
from ori_deploy.deploy.states import IllegalCommand, State
from ori_deploy.errors import InputError
from tests.deploy.synthetic import bench
from tests.deploy.test_controller import PIN, STOW_LOCK, largest_step, peak_crease_rate


def test_hold_brings_all_cells_to_rest_in_step_and_resume_goes_on() -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(0.4)
    b.controller.hold()
    start = len(b.records)
    localiser = Localiser(PathTable.build(b.plan, b.rig))
    b.step_to_rest()
    assert len(b.records) - start <= 27  # hold_ramp_s, and what the slope takes that was still there
    for record in b.records[start:]:
        commanded = localiser.folds(record.commanded_rad)
        assert np.ptp(commanded) < 1e-9
        np.testing.assert_allclose(commanded, record.commanded_fold, atol=1e-5)
    rates = [record.rate for record in b.records[start + 6 :]]  # a slope that still pointed up has turned round
    assert all(later <= earlier for earlier, later in pairwise(rates))
    resting = b.steps(30)
    np.testing.assert_array_equal(resting.commanded_rad, b.records[-25].commanded_rad)
    result = b.controller.run()
    assert result.outcome is Outcome.HELD
    assert result.state is State.HOLD
    b.controller.resume()
    assert b.controller.run().succeeded
    assert largest_step(b) <= peak_crease_rate(b) * 1.001


@pytest.mark.parametrize("fold", [0.001, 0.2, 0.8])
def test_stop_gives_up_and_the_other_way_is_open(fold: float) -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(fold)
    b.controller.stop()
    result = b.controller.run()
    assert result.outcome is Outcome.STOPPED
    assert result.state is State.ARMED
    b.controller.stow()
    assert b.controller.run().succeeded
    assert b.controller.state is State.STOWED
    assert largest_step(b) <= peak_crease_rate(b) * 1.001


def test_hold_while_aligning_freezes_the_alignment() -> None:
    b = bench(start_fold=0.5)
    b.controller.deploy()
    b.steps(6)
    b.controller.hold()
    b.step_to_rest()
    held = b.steps(10).commanded_rad
    np.testing.assert_array_equal(b.steps(10).commanded_rad, held)
    b.controller.resume()
    assert b.controller.run().succeeded


def test_hold_while_latching_starts_the_wait_again() -> None:
    b = bench(latch=[PIN])
    b.controller.deploy()
    while b.controller.step().stage != "latch":
        pass
    b.steps(3)
    b.controller.hold()
    b.steps(300)  # far longer than the latch's timeout
    b.controller.resume()
    assert b.controller.run().succeeded


@pytest.mark.parametrize("first", ["deploy", "stow"])
@pytest.mark.parametrize("fold", [0.02, 0.5, 0.98])
@pytest.mark.parametrize("held", [False, True])
def test_a_motion_turns_round_wherever_it_is(first: str, fold: float, held: bool) -> None:
    second, ending = ("stow", State.STOWED) if first == "deploy" else ("deploy", State.DEPLOYED)
    b = bench(start="stowed" if first == "deploy" else "deployed", latch=[PIN, STOW_LOCK])
    getattr(b.controller, first)()
    b.step_until_fold(fold)
    if held:
        b.controller.hold()
        b.step_to_rest()
    getattr(b.controller, second)()
    with pytest.raises(IllegalCommand, match=f"already under way to {second}"):
        getattr(b.controller, second)()
    result = b.controller.run()
    assert result.succeeded, result.fault
    assert (result.command, result.state) == (second, ending)
    assert largest_step(b) <= peak_crease_rate(b) * 1.001
    for before, record in pairwise(b.records):
        assert record.rate == 0.0 or abs(record.rate - before.rate) <= 0.0534


@pytest.mark.parametrize(
    ("first", "stage"),
    [("deploy", "unlock"), ("deploy", "latch"), ("stow", "unlatch"), ("stow", "lock")],
)
def test_a_command_turns_round_while_latches_are_worked_on(first: str, stage: str) -> None:
    second, ending = ("stow", State.STOWED) if first == "deploy" else ("deploy", State.DEPLOYED)
    slow = {"travel_s": 0.4}
    b = bench(start="stowed" if first == "deploy" else "deployed", latch=[{**PIN, **slow}, STOW_LOCK])
    getattr(b.controller, first)()
    while b.controller.step().stage != stage:
        pass
    b.steps(5)
    getattr(b.controller, second)()
    result = b.controller.run()
    assert result.succeeded, result.fault
    assert result.state is ending
    assert largest_step(b) <= peak_crease_rate(b) * 1.001


@pytest.mark.parametrize("first", ["deploy", "stow"])
def test_turning_round_waits_for_every_latch_as_well(first: str) -> None:
    """The structure is latched at the end from which the second command moves away."""
    second, stuck = ("stow", "pin") if first == "deploy" else ("deploy", "lock")
    b = bench(start="deployed" if first == "deploy" else "stowed", latch=[PIN, STOW_LOCK])
    b.bus.latch_stuck(stuck)
    getattr(b.controller, first)()
    b.steps(3)
    goal = b.records[-1].commanded_rad
    getattr(b.controller, second)()
    result = b.controller.run()
    assert result.fault is not None
    assert (result.fault.kind, result.fault.thing) == (FaultKind.LATCH_TIMEOUT, stuck)
    np.testing.assert_allclose(b.records[-1].commanded_rad, goal, atol=0.01)


def test_speed_can_be_limited_at_any_moment_and_is_no_number_outside_its_range() -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(0.3)
    b.controller.limit_speed(0.25)
    b.steps(40)
    assert b.records[-1].rate == pytest.approx(0.25)
    b.controller.limit_speed(1.0)
    assert b.controller.run().succeeded
    for part in (0.0, -1.0, 1.01, math.nan):
        with pytest.raises(InputError, match="speed"):
            b.controller.limit_speed(part)


@pytest.mark.parametrize("fold", [0.1, 0.5, 0.9])
def test_the_emergency_stop_rests_in_two_cycles_and_holds(fold: float) -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(fold)
    b.controller.emergency_stop("a test")
    assert b.controller.state is State.FAULT
    assert b.steps(2).rate == 0.0
    goal = b.records[-1].commanded_rad
    result = b.controller.run()
    assert result.outcome is Outcome.EMERGENCY_STOPPED
    assert result.fault is not None
    assert "a test" in result.fault.detail
    np.testing.assert_array_equal(b.steps(30).commanded_rad, goal)
    assert b.bus.true_torque_on.all()
    b.controller.clear_fault()
    b.controller.stow()
    assert b.controller.run().succeeded


def test_the_emergency_stop_hurries_a_stop_that_is_under_way_and_keeps_its_reason() -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(0.4)
    b.bus.jam("servo_c2")
    while b.controller.state is not State.FAULT:
        b.steps(1)
    assert b.records[-1].rate != 0.0
    b.controller.emergency_stop()
    assert b.steps(2).rate == 0.0
    assert b.controller.fault is not None
    assert b.controller.fault.kind is not FaultKind.EMERGENCY_STOP


def test_the_emergency_stop_is_heard_in_every_state() -> None:
    b = bench(armed=False)
    b.controller.emergency_stop()
    assert b.controller.state is State.DISCONNECTED
    b.controller.connect()
    b.controller.emergency_stop()
    assert b.controller.state is State.FAULT
    b.controller.clear_fault()
    assert b.controller.state is State.READY
    b.controller.arm()
    b.controller.emergency_stop()
    assert b.controller.fault is not None
