"""Room that the step tolerance leaves, against a search that tries every place on the way."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ori_deploy.deploy.monitor import CRAWL
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.path_variable import PathVariable, Ramp
from ori_deploy.deploy.step_room import REACTION_CYCLES, USABLE, StepRoom
from ori_deploy.motion.step_tolerance import StepTolerance
from tests.deploy.synthetic import synthetic_plan, synthetic_rig

PLAN = synthetic_plan(4)
TABLE = PathTable.build(PLAN, synthetic_rig(PLAN))
SLEW, RATE_HZ = 4.0, 100.0
SLOPE = Ramp(SLEW, float("inf"))
LEAD = np.array([0.2, 0.45, 0.7, 0.9, 0.97, 1.0])

tolerances = st.lists(st.sampled_from([0.02, 0.03, 0.05, 0.1, 0.2, 1.0]), min_size=6, max_size=6).map(
    lambda spreads: StepTolerance(LEAD, np.array(spreads), 1.0, 0.0)
)
places = st.integers(0, 2000).map(lambda k: k / 2000.0)


def room(tolerance: StepTolerance) -> StepRoom:
    return StepRoom(tolerance, TABLE, SLEW, REACTION_CYCLES / RATE_HZ)


def usable(tolerance: StepTolerance, lead: float) -> float:
    return USABLE * tolerance.allowed(min(max(lead, 0.0), 1.0))


def slow_ahead(tolerance: StepTolerance, low: float, lead: float) -> float:
    """Farthest lead that can be reached without ever being beyond the tolerance, `low` stuck."""
    reached = lead
    for x in np.arange(lead, 1.0 + 1e-9, 0.0001):
        if x - low > usable(tolerance, x) + 1e-9:
            break
        reached = x
    return reached


def slow_behind(tolerance: StepTolerance, low: float, lead: float) -> float:
    """Lowest fold of the hindmost cell for which every lead down to it is inside its tolerance."""
    end = low
    leads = np.arange(lead, -1e-9, -0.0001)
    allowed = np.array([usable(tolerance, x) for x in leads])
    for c in np.arange(low, -1e-9, -0.0005):
        if (leads - c > allowed + 1e-9)[leads >= c].any():
            break
        end = c
    return end


@settings(max_examples=60)
@given(tolerance=tolerances, low=places, gap=st.floats(0.0, 0.1))
def test_room_ahead_agrees_with_a_search(tolerance: StepTolerance, low: float, gap: float) -> None:
    lead = min(low + gap, 1.0)
    assume(lead - low < usable(tolerance, lead) - 1e-6)
    folds = np.array([low, lead, lead])
    end = slow_ahead(tolerance, low, lead)
    found = lead + room(tolerance).ahead(folds, lead)
    assert abs(min(found, 1.0) - end) < 2.5e-4


@settings(max_examples=60)
@given(tolerance=tolerances, low=places, gap=st.floats(0.0, 0.1))
def test_room_behind_agrees_with_a_search(tolerance: StepTolerance, low: float, gap: float) -> None:
    lead = min(low + gap, 1.0)
    assume(slow_behind(tolerance, low, lead) < low)
    folds = np.array([low, lead, lead])
    end = slow_behind(tolerance, low, lead)
    found = low - room(tolerance).behind(folds, low)
    assert abs(max(found, 0.0) - end) < 1e-3


@given(tolerance=tolerances, low=places)
def test_no_room_when_the_tolerance_is_used_up(tolerance: StepTolerance, low: float) -> None:
    lead = low + usable(tolerance, low) + 1e-3
    assume(lead <= 1.0)
    assume(lead - low >= usable(tolerance, lead))
    assert room(tolerance).ahead(np.array([low, lead]), lead) == 0.0


@settings(max_examples=60)
@given(tolerance=tolerances, stuck=st.floats(0.0, 0.95), direction=st.sampled_from([1.0, -1.0]))
def test_cells_that_follow_the_limit_stop_inside_the_tolerance_when_one_sticks(
    tolerance: StepTolerance, stuck: float, direction: float
) -> None:
    """One cell freezes at full speed; the others follow the command exactly, seen one cycle late."""
    step_room = room(tolerance)
    start = TABLE.time_at(stuck)
    variable = PathVariable(start, 0.0, TABLE.duration_s)
    seen = np.full(3, TABLE.fold_at(start))
    for _ in range(400):
        fold = TABLE.fold_at(variable.position)
        limit = step_room.rate_limit(seen, fold, variable.position, direction)
        seen = np.array([stuck, fold, fold])
        variable.advance(1.0 / RATE_HZ, direction * limit if limit >= CRAWL else 0.0, SLOPE)
        moved = TABLE.fold_at(variable.position)
        assert abs(moved - stuck) <= usable(tolerance, max(moved, stuck)) + 1e-9
