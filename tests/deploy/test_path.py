"""The path, its one variable, and where the structure is on it, each against a second way of finding out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from ori_deploy.actuators.rig import Crease
from ori_deploy.clock import VirtualClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.localise import Localiser, locate
from ori_deploy.deploy.motion import Approach, gentle_ramp
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.path_variable import PathVariable, Ramp
from ori_deploy.deploy.result import StartRefused
from ori_deploy.errors import MotionError, RigError
from ori_deploy.motion.plan import Plan
from sim_backends.mock import MockBus
from tests.deploy.synthetic import bench, synthetic_plan, synthetic_rig

PLAN = synthetic_plan(4, curvature=0.3)
RIG = synthetic_rig(PLAN)
TABLE = PathTable.build(PLAN, RIG)
LOCALISER = Localiser(TABLE)


@given(st.floats(-0.5, 2.5))
def test_path_is_the_cubic_spline_through_the_plan(time_s: float) -> None:
    spline = CubicHermiteSpline(TABLE.time_s, TABLE.shaft_rad, TABLE.shaft_rate_rad_s)
    expected = spline(np.clip(time_s, 0.0, TABLE.duration_s))
    np.testing.assert_allclose(TABLE.shaft_at(time_s), expected, rtol=0, atol=1e-12)
    fold = np.interp(time_s, TABLE.time_s, TABLE.fold)
    assert TABLE.fold_at(time_s) == pytest.approx(fold, abs=1e-12)


@given(st.floats(0.0, 1.0))
def test_time_at_inverts_fold_at(fold: float) -> None:
    assert TABLE.fold_at(TABLE.time_at(fold)) == pytest.approx(fold, abs=1e-9)


@given(
    targets=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=200),
    start=st.floats(0.0, 2.0),
    duration=st.floats(0.05, 2.0),
)
def test_path_rate_is_bounded_in_size_slope_and_jerk_and_stays_between_the_ends(
    targets: list[float], start: float, duration: float
) -> None:
    ramp, variable = Ramp.lasting(duration), PathVariable(start, 0.0, 2.0)
    rates, ended = [0.0], False
    for target in targets:
        position = variable.position
        variable.advance(0.01, target, ramp)
        assert abs(variable.rate) <= 1.0 + 1e-9
        assert 0.0 <= variable.position <= 2.0
        assert abs(variable.position - position) <= 0.01 + 1e-9
        ended |= variable.position in (0.0, 2.0)
        rates.append(variable.rate)
    if not ended:  # at an end it rests at once, as the plan does
        slopes = np.diff(rates) / 0.01
        assert np.abs(slopes).max() <= ramp.slew_per_s * (1.0 + 1e-9)
        assert np.abs(np.diff(slopes, prepend=0.0)).max() / 0.01 <= ramp.jerk_per_s2 * (1.0 + 1e-9)


@given(rate=st.floats(0.05, 1.0), duration=st.floats(0.1, 1.0))
def test_a_stop_takes_its_time_and_half_of_it_as_way(rate: float, duration: float) -> None:
    """From a steady rate: the ramp is symmetric, so the mean rate is half of what it was."""
    ramp, variable = Ramp.lasting(duration), PathVariable(0.0, 0.0, 100.0)
    while variable.rate < rate:
        variable.advance(0.001, rate, ramp)
    begin, time_s = variable.position, 0.0
    while not variable.at_rest:
        variable.advance(0.001, 0.0, ramp)
        time_s += 0.001
    peak = min(ramp.slew_per_s, (rate * ramp.jerk_per_s2) ** 0.5)
    expected = rate / peak + peak / ramp.jerk_per_s2
    assert time_s == pytest.approx(expected, abs=0.0015)
    assert variable.position - begin == pytest.approx(0.5 * rate * expected, abs=0.001)


def test_a_ramp_lasts_what_it_says_and_an_emergency_two_cycles() -> None:
    for ramp, cycles in ((Ramp.lasting(0.25), 25), (Ramp.within_cycles(2, 0.01), 2)):
        variable = PathVariable(0.0, 0.0, 10.0)
        while variable.rate < 1.0:
            variable.advance(0.01, 1.0, Ramp.lasting(0.25))
        for _ in range(cycles):
            assert not variable.at_rest
            variable.advance(0.01, 0.0, ramp)
        assert abs(variable.rate) < 1e-9


def test_it_turns_round_without_a_jump() -> None:
    ramp, variable = Ramp.lasting(0.25), PathVariable(0.0, 0.0, 10.0)
    rates = []
    for target in [1.0] * 50 + [-1.0] * 80:
        variable.advance(0.01, target, ramp)
        rates.append(variable.rate)
    assert rates[-1] == -1.0
    assert np.abs(np.diff(rates)).max() <= ramp.slew_per_s * 0.01 + 1e-12


def test_path_variable_comes_to_exact_rest() -> None:
    ramp, variable = Ramp(3.7, 37.0), PathVariable(0.0, 0.0, 10.0)
    for target in [1.0] * 50 + [0.0] * 38:
        variable.advance(0.01, target, ramp)
    assert variable.at_rest
    position = variable.position
    variable.advance(0.01, 0.0, ramp)
    assert variable.position == position


def test_slope_of_the_rate_respects_the_actuators_acceleration() -> None:
    assert gentle_ramp(TABLE, RIG) == Ramp.lasting(RIG.controller.hold_ramp_s)
    weak = synthetic_rig(PLAN, each_cell={"actuator": {**_actuator(), "max_acceleration_rad_s2": 3.0}})
    slew = gentle_ramp(PathTable.build(PLAN, weak), weak).slew_per_s
    assert slew * np.abs(TABLE.shaft_rate_rad_s).max() == pytest.approx(3.0)


def _actuator() -> dict[str, float]:
    return {
        "max_velocity_rad_s": 8.0,
        "max_acceleration_rad_s2": 60.0,
        "max_torque_nm": 2.0,
        "min_position_rad": -20.0,
        "max_position_rad": 20.0,
    }


def test_approach_is_slow_ends_on_the_path_and_keeps_cells_together() -> None:
    start = TABLE.shaft_at(0.5)
    target = TABLE.shaft_at(0.6)
    ramp = Ramp.lasting(0.25)
    approach = Approach(start, target, RIG, ramp)
    np.testing.assert_allclose(approach.shaft(), start, rtol=0, atol=0)
    before, largest = start, 0.0
    for _ in range(1000):
        approach.variable.advance(0.01, 1.0, ramp)
        shaft = approach.shaft()
        largest = max(largest, float(np.abs(RIG.to_crease(shaft) - RIG.to_crease(before)).max()) / 0.01)
        before = shaft
        if approach.finished:
            break
    np.testing.assert_allclose(before, target, rtol=0, atol=1e-12)
    assert largest <= RIG.controller.align_velocity_rad_s * 1.001


# -- where it is


def brute_force_folds(shaft: np.ndarray) -> np.ndarray:
    """Fold of every cell by trying a fine grid of path times."""
    times = np.linspace(0.0, TABLE.duration_s, 20001)
    folds = np.interp(times, TABLE.time_s, TABLE.fold)
    places = np.column_stack([np.interp(folds, TABLE.fold, TABLE.shaft_rad[:, i]) for i in range(len(shaft))])
    return folds[np.abs(places - shaft).argmin(axis=0)]


@settings(max_examples=50)
@given(st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4))
def test_folds_agree_with_brute_force(folds: list[float]) -> None:
    shaft = np.array([np.interp(f, TABLE.fold, TABLE.shaft_rad[:, i]) for i, f in enumerate(folds)])
    found = LOCALISER.folds(shaft)
    np.testing.assert_allclose(found, folds, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found, brute_force_folds(shaft), rtol=0, atol=2e-4)


def test_folds_beyond_the_ends_show_as_such_and_silence_as_nan() -> None:
    shaft = TABLE.shaft_at(0.0)
    shaft[0] += 0.05  # direction -1: beyond closed
    shaft[1] = np.nan
    folds = LOCALISER.folds(shaft)
    assert folds[0] < 0.0
    assert np.isnan(folds[1])
    assert folds[2] == 0.0
    open_too_far = TABLE.shaft_at(TABLE.duration_s) - 0.05
    assert (LOCALISER.folds(open_too_far) > 1.0).all()


def at_folds(*folds: float) -> np.ndarray:
    return np.array([np.interp(f, TABLE.fold, TABLE.shaft_rad[:, i]) for i, f in enumerate(folds)])


def test_structure_is_located_where_it_stands() -> None:
    shaft = at_folds(0.4, 0.41, 0.39, 0.4)
    place = locate(shaft, LOCALISER.folds(shaft), 0.2, TABLE, RIG)
    assert TABLE.fold_at(place) == pytest.approx(0.4, abs=1e-6)


def test_cell_out_of_step_is_refused_by_name() -> None:
    shaft = at_folds(0.4, 0.4, 0.65, 0.4)
    with pytest.raises(StartRefused, match=r"cell c3 is out of step.*0\.65.*0\.2000.*remedy"):
        locate(shaft, LOCALISER.folds(shaft), 0.2, TABLE, RIG)


def test_cell_off_the_path_is_refused_by_name() -> None:
    shaft = at_folds(0.4, 0.4, 0.4, 0.48)
    with pytest.raises(StartRefused, match=r"cell c4 is off the path.*start_tolerance_rad = 0\.05.*remedy"):
        locate(shaft, LOCALISER.folds(shaft), 0.2, TABLE, RIG)


def test_structure_beyond_the_end_of_the_path_is_refused() -> None:
    shaft = TABLE.shaft_at(0.0) + 4.0 * 0.06
    with pytest.raises(StartRefused, match="off the path"):
        locate(shaft, LOCALISER.folds(shaft), 0.2, TABLE, RIG)


# -- what cannot be carried out


def controller_for(plan: Plan, crease: Crease = "close_a") -> Controller:
    rig = synthetic_rig(plan, each_cell={"crease": crease})
    clock = VirtualClock()
    bus = MockBus.from_rig(rig, clock, PLAN.crease_angles_rad[0], PLAN.crease_angles_rad[-1])
    return Controller(plan, rig, bus, clock)


def test_driven_crease_that_turns_back_is_refused_by_name() -> None:
    angles = PLAN.crease_angles_rad.copy()
    angles[:, 0, 3] = 0.4 * np.sin(2.0 * PLAN.fold)
    with pytest.raises(MotionError, match=r"close_b of cell c1 turns back.*remedy: drive another crease"):
        controller_for(replace(PLAN, crease_angles_rad=angles), "close_b")


def test_other_creases_may_turn_back() -> None:
    angles = PLAN.crease_angles_rad.copy()
    angles[:, 0, 3] = 0.4 * np.sin(2.0 * PLAN.fold)
    rates = PLAN.crease_rates_rad_s.copy()
    rates[:, 0, 3] = np.gradient(angles[:, 0, 3], PLAN.time_s)
    controller_for(replace(PLAN, crease_angles_rad=angles, crease_rates_rad_s=rates), "close_a")


def test_a_rate_that_is_not_that_of_the_angle_is_refused() -> None:
    rates = PLAN.crease_rates_rad_s.copy()
    rates[90, 1, 2] *= 1.5
    with pytest.raises(MotionError, match="rate of crease close_a of cell c2 is not that of its angle"):
        controller_for(replace(PLAN, crease_rates_rad_s=rates))


def test_a_plan_without_latch_points_is_refused() -> None:
    with pytest.raises(MotionError, match="nothing locks the deployed state"):
        controller_for(replace(PLAN, latch_points=()))


def test_a_plan_of_another_rate_is_refused() -> None:
    with pytest.raises(RigError, match="different rates"):
        controller_for(replace(PLAN, rate_hz=50.0))


def test_the_ramp_and_the_approach_keep_the_limits_of_accelerations() -> None:
    weak = synthetic_rig(PLAN, passive_creases={"max_acceleration_rad_s2": 0.8})
    slew = gentle_ramp(TABLE, weak).slew_per_s
    assert slew * np.abs(PLAN.crease_rates_rad_s[:, :, [0, 1, 3]]).max() == pytest.approx(0.8)
    soft = synthetic_rig(PLAN, each_cell={"max_crease_acceleration_rad_s2": 0.5})
    approach = Approach(TABLE.shaft_at(0.5), TABLE.shaft_at(0.6), soft, gentle_ramp(TABLE, soft))
    shafts = []
    while not approach.finished:
        approach.variable.advance(0.01, 1.0, gentle_ramp(TABLE, soft))
        shafts.append(soft.to_crease(approach.shaft()))
    assert np.abs(np.diff(shafts, n=2, axis=0)).max() / 1e-4 <= 0.5 * 1.01


def test_plan_with_a_hole_is_refused() -> None:
    angles = PLAN.crease_angles_rad.copy()
    angles[7, 2, 2] = np.nan
    with pytest.raises(MotionError, match="angles is not finite"):
        controller_for(replace(PLAN, crease_angles_rad=angles))


def test_plan_that_does_not_end_at_rest_is_refused() -> None:
    rates = PLAN.crease_rates_rad_s.copy()
    rates[-1, 1, 2] = 0.1
    with pytest.raises(MotionError, match=r"not at rest at its end.*servo_c2"):
        controller_for(replace(PLAN, crease_rates_rad_s=rates))


def test_fold_that_does_not_increase_is_refused() -> None:
    fold = PLAN.fold.copy()
    fold[5] = fold[4]
    with pytest.raises(MotionError, match="fold does not increase"):
        controller_for(replace(PLAN, fold=fold))


def test_plan_beyond_a_shafts_range_is_refused() -> None:
    with pytest.raises(RigError, match=r"servo_c\d.*position range too small"):
        controller_for(replace(PLAN, crease_angles_rad=PLAN.crease_angles_rad * 10.0))


@pytest.mark.parametrize(("times", "what"), [(0.2, "velocity"), (0.75, "acceleration")])
def test_plan_faster_than_this_rig_allows_is_refused(times: float, what: str) -> None:
    # What the table does counts, not the rates it claims.
    limits = {"acceleration": {"max_crease_acceleration_rad_s2": 2.0}}.get(what, {})
    with pytest.raises(MotionError, match=rf"{what} of crease \w+ of cell c\d is beyond what this rig allows"):
        bench(replace(PLAN, time_s=PLAN.time_s * times), each_cell=limits)


def test_bus_of_another_rig_is_refused() -> None:
    one, other = bench(synthetic_plan(4)), bench(synthetic_plan(5))
    with pytest.raises(RigError, match="bus's hinges"):
        Controller(one.plan, one.rig, other.bus, one.clock)


def test_rig_of_another_plan_is_refused() -> None:
    one, other = bench(synthetic_plan(4)), bench(synthetic_plan(5))
    with pytest.raises(RigError, match="rig's cells"):
        Controller(other.plan, one.rig, one.bus, one.clock)
