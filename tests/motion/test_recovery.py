"""Ways back onto the path: free by a second, slow check, and refused with the panels that are in the way."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ori_deploy.errors import MotionError
from ori_deploy.motion import Interference, Mechanism
from ori_deploy.motion.recovery import SAMPLE, find_recovery
from tests.oracle.bridge import retold
from tests.oracle.fold import clash, placed
from tests.shapes import structure, wing

WING = Interference(Mechanism(structure("wing")))
TOLD, SLITS = retold(WING.mechanism.structure)  # type: ignore[arg-type]
folds = st.lists(st.floats(0.0, 0.9), min_size=4, max_size=4).map(np.array)


@settings(max_examples=25, deadline=None)
@given(folds)
def test_a_way_begins_where_the_cells_stand_and_ends_in_step(start: np.ndarray) -> None:
    assume(WING.first_collision(start[None]) is None)
    way = find_recovery(WING, start)
    np.testing.assert_array_equal(way.fold[0], start)
    assert np.ptp(way.fold[-1]) == 0.0
    assert way.fold[-1, 0] == way.target
    assert ((way.fold >= 0.0) & (way.fold <= 1.0)).all()


@pytest.mark.parametrize(
    "start", [[0.3, 0.4, 0.5, 0.45], [0.0, 0.5, 0.0, 0.0], [0.2, 1.0, 0.1, 0.9], [0.95, 0.97, 0.93, 1.0]]
)
def test_no_pose_of_a_way_clashes_by_the_oracle_either(start: list[float]) -> None:
    way = find_recovery(WING, np.array(start))
    for a, b in pairwise(way.fold):
        for part in np.linspace(0.0, 1.0, 7):
            fold = a + part * (b - a)
            assert clash(placed(TOLD, list(fold), SLITS, 120)).depth < 1.3 * WING.allowed_m


def test_a_straight_way_that_is_blocked_is_gone_round() -> None:
    """With this slit the wing's panels meet in step at fold 0.76, and not one cell after the other."""
    check = Interference(Mechanism(wing(slit="O1")))
    generator = np.random.default_rng(5)
    bent = elsewhere = 0
    for start in generator.uniform(0.4, 1.0, (130, 4)):
        if check.first_collision(start[None]) is not None:
            continue
        way = find_recovery(check, start)
        bent += len(way.fold) > 2
        elsewhere += way.target != 0.5 * (start.min() + start.max())
        rows = np.concatenate([a + np.linspace(0.0, 1.0, 100)[:, None] * (b - a) for a, b in pairwise(way.fold)])
        assert check.first_collision(rows, between=False) is None
    assert bent > 0
    assert elsewhere > bent


def test_an_impossible_pose_is_refused_with_its_panels_unless_it_is_seating() -> None:
    start = np.array([1.0, 0.97, 1.0, 1.0])
    with pytest.raises(MotionError, match=r"panels c\d.* reach into each other.*zero_rad"):
        find_recovery(WING, start)
    way = find_recovery(WING, start, contact_m=0.002)
    assert WING.first_collision(np.stack([way.fold[0] + 0.7 * (way.fold[1] - way.fold[0]), way.fold[1]])) is None


def test_noise_beyond_the_ends_counts_as_the_end_and_silence_is_refused() -> None:
    way = find_recovery(WING, np.array([-0.004, 0.1, 0.05, -0.001]))
    assert way.fold.min() >= 0.0
    with pytest.raises(MotionError, match="says where it stands"):
        find_recovery(WING, np.array([0.1, np.nan, 0.1, 0.1]))
    assert way.n_poses >= 0.05 / SAMPLE
