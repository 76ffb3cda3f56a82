"""Plans: timed under every limit, checked, refused with reasons."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.errors import MotionError
from ori_deploy.motion import FourBars, plan_motion
from ori_deploy.motion.timing import time_path
from tests.shapes import overfull, structure, wing


def limits(n: int, v: float, a: float, crease: int = 2) -> tuple[np.ndarray, np.ndarray]:
    velocity, acceleration = np.full((n, 4), np.inf), np.full((n, 4), np.inf)
    velocity[:, crease], acceleration[:, crease] = v, a
    return velocity, acceleration


@settings(max_examples=20)
@given(
    name=st.sampled_from(["wing", "ellipse 4", "ellipse 6 without wall", "two cells", "two inner vertices"]),
    v=st.floats(0.05, 5.0),
    a=st.floats(0.1, 20.0),
    crease=st.integers(0, 3),
    rate=st.sampled_from([50.0, 100.0, 333.0]),
)
def test_every_crease_keeps_its_limits(name: str, v: float, a: float, crease: int, rate: float) -> None:
    bars = FourBars.of(structure(name).cells)
    velocity, acceleration = limits(bars.n_cells, v, a, crease)
    time, fold, fold_rate = time_path(bars, velocity, acceleration, rate)
    assert np.allclose(np.diff(time), 1.0 / rate)
    assert fold[0] == 0.0
    assert fold[-1] == 1.0
    assert (np.diff(fold) >= 0.0).all()
    assert fold_rate[0] == pytest.approx(0.0, abs=1e-9)
    angles = bars.angles(fold)[:, :, crease]
    first = np.diff(angles, axis=0) * rate
    second = np.diff(first, axis=0) * rate
    assert np.abs(first).max() <= v * (1 + 1e-6)
    assert np.abs(second).max() <= a * (1 + 1e-6)
    # Time-optimal: somewhere a limit is nearly reached, or the motion is only a few samples long.
    assert len(time) < 12 or max(np.abs(first).max() / v, np.abs(second).max() / a) > 0.85


def test_halving_speed_and_quartering_acceleration_doubles_the_time() -> None:
    bars = FourBars.of(structure("wing").cells)
    quick = time_path(bars, *limits(4, 1.0, 4.0), 200.0)[0][-1]
    slow = time_path(bars, *limits(4, 0.5, 1.0), 200.0)[0][-1]
    assert slow == pytest.approx(2.0 * quick, rel=0.02)


def test_a_crease_with_only_one_kind_of_limit_is_limited_by_it() -> None:
    bars = FourBars.of(structure("wing").cells)
    velocity, acceleration = limits(4, 1.0, 4.0)
    velocity[0, 3], acceleration[1, 3] = 0.3, 0.5
    _, fold, _ = time_path(bars, velocity, acceleration, 200.0)
    first = np.diff(bars.angles(fold), axis=0) * 200.0
    second = np.diff(first, axis=0) * 200.0
    assert np.abs(first[:, 0, 3]).max() <= 0.3 * (1 + 1e-6)
    assert np.abs(second[:, 1, 3]).max() <= 0.5 * (1 + 1e-6)


def test_plan_holds_what_the_mechanism_does() -> None:
    s = wing()
    plan = plan_motion(s, *limits(4, 0.6, 1.2), 100.0, design_sha256="d", design_name="wing")
    bars = FourBars.of(s.cells)
    assert np.array_equal(plan.crease_angles_rad, bars.angles(plan.fold))
    numeric = np.gradient(plan.crease_angles_rad, plan.time_s, axis=0)
    assert np.abs(plan.crease_rates_rad_s[5:-5] - numeric[5:-5]).max() < 0.05
    assert plan.latch_points == ("slit:P-O2",)
    assert plan.check.deepest_penetration_m <= plan.check.allowed_penetration_m
    assert plan.check.smallest_clearance_m > 0.0
    assert plan.cell_ids == ("c1", "c2", "c3", "c4")


def test_colliding_motion_is_refused() -> None:
    with pytest.raises(MotionError, match=r"panels c\d\.\w+ and c\d\.\w+ reach into each other at fold"):
        plan_motion(wing(slit="O1"), *limits(4, 0.6, 1.2), 100.0)


def test_refusal_names_slits_that_would_be_free() -> None:
    with pytest.raises(MotionError) as refused:
        plan_motion(wing(slit="O1"), *limits(4, 0.6, 1.2), 100.0)
    assert refused.value.remedy == 'slits = [["P", "O2"]] or [["P", "O3"]] would be free'
    with pytest.raises(MotionError, match=r'slits = \[\["P", "O\w+"\], \["Q", "O\w+"\]\]'):
        plan_motion(overfull(), *limits(5, 0.6, 1.2), 100.0)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan")])
def test_nonsense_limits_are_refused_with_crease_and_cell(bad: float) -> None:
    velocity, acceleration = limits(4, 0.6, 1.2)
    velocity[2, 1] = bad
    with pytest.raises(MotionError, match="velocity limit of crease open_d of cell c3"):
        plan_motion(wing(), velocity, acceleration, 100.0)


@pytest.mark.parametrize(("v", "a"), [(1e-3, 1e-3), (1e3, 1e5), (1e6, 1e9)])
def test_extreme_limits_are_timed_or_refused_in_words(v: float, a: float) -> None:
    bars = FourBars.of(structure("wing").cells)
    time, fold, _ = time_path(bars, *limits(4, v, a), 100.0)
    assert fold[-1] == 1.0
    assert len(time) >= 3
    with pytest.raises(MotionError, match=r"takes too long to be sampled.*limit: 1000000 samples"):
        time_path(bars, *limits(4, 1e-7, 1e-7), 100.0)


def test_limits_have_to_be_there() -> None:
    free = np.full((4, 4), np.inf)
    with pytest.raises(MotionError, match="no crease has a velocity limit"):
        plan_motion(wing(), free, free, 100.0)
    with pytest.raises(MotionError, match="wrong shape"):
        plan_motion(wing(), free[:2], free, 100.0)
    with pytest.raises(MotionError, match="rate_hz"):
        plan_motion(wing(), *limits(4, 1.0, 1.0), 0.0)
