"""Ways back onto the path: free by a second, slow check, and refused with the panels that are in the way."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely.geometry import Polygon

from ori_deploy.errors import MotionError
from ori_deploy.motion import Interference, Mechanism, recovery
from ori_deploy.motion.recovery import SAMPLE, SEATING_WAY, find_recovery
from tests.oracle.bridge import retold
from tests.oracle.fold import clash, overlap_depth, placed
from tests.shapes import structure, wing

WING = Interference(Mechanism(structure("wing")))
folds = st.lists(st.floats(0.0, 0.9), min_size=4, max_size=4).map(np.array)


@settings(max_examples=25)
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
    told, slits = retold(WING.mechanism.structure)  # type: ignore[arg-type]
    for a, b in pairwise(way.fold):
        for part in np.linspace(0.0, 1.0, 7):
            fold = a + part * (b - a)
            assert clash(placed(told, list(fold), slits, 120)).depth < 1.3 * WING.allowed_m


@pytest.mark.slow
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


# -- out of slits that touch ---------------------------------------------------------------------------


def depth_by_oracle(name: str, fold: np.ndarray, panels: tuple[str, str]) -> float:
    """How deep two panels reach into each other."""
    built = structure(name)
    told, slits = retold(built)
    at, ids = placed(told, list(fold), slits, 120), built.layout.panel_ids
    one, two = (Polygon(at[divmod(ids.index(panel), 4)]) for panel in panels)
    return overlap_depth(one, two)


def along(corners: np.ndarray, way: float) -> np.ndarray:
    """The fold at which the cell that moves most has moved that far along the first straight line."""
    a, b = corners[:2]
    return np.asarray(a + way / np.abs(b - a).max() * (b - a))


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("wing", [1.0, 0.97, 1.0, 1.0]),
        ("ellipse 4", [0.98, 1.0, 1.0, 0.99]),
        ("superellipse 6, m = 1.5", [0.959, 0.979, 0.979, 0.979, 0.959, 0.979]),
    ],
)
def test_what_touches_at_a_slit_parts_and_gets_no_deeper_by_the_oracle(name: str, start: list[float]) -> None:
    built = structure(name)
    check = Interference(Mechanism(built))
    told, slits = retold(built)
    slit = {divmod(int(panel), 4) for panel in np.flatnonzero(built.layout.is_slit)}
    way = find_recovery(check, np.array(start), contact_m=0.01 * check.mechanism.size_m)
    least = np.inf
    for part in np.linspace(0.0, SEATING_WAY, 5):
        worst = clash(placed(told, list(along(way.fold, part)), slits, 120))
        assert worst.depth < least + check.allowed_m
        if part == 0.0:
            assert worst.depth > check.allowed_m
        if worst.depth > 1.3 * check.allowed_m:
            assert set(worst.pair or ()) & slit
        least = min(least, worst.depth)
    assert least < 1.3 * check.allowed_m


SUPER = "superellipse 6, m = 1.5"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "cell", "by", "target", "panels"),
    [
        # The slit's faces are pressed deeper into each other before they part.
        ([0.937, 0.937, 0.957, 0.957, 0.937, 0.937], 0, -0.01, 0.917, "c1.ac c6.da"),
        # They are, too, but first a face meets a panel that it did not touch.
        ([0.959, 0.979, 0.979, 0.979, 0.959, 0.979], 1, 0.005, 0.9715, "c1.ac c6.ac"),
    ],
)
def test_a_way_that_is_clear_later_is_refused_for_its_first_bit(
    start: list[float], cell: int, by: float, target: float, panels: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    check = Interference(Mechanism(structure(SUPER)))
    corners = np.stack([start, start, np.full(6, target)])
    corners[1, cell] += by
    one, two = panels.split()
    # By the oracle: within the first 0.02 these panels get deeper, and they did not touch or not so deep.
    before, after = (depth_by_oracle(SUPER, fold, (one, two)) for fold in corners[:2])
    assert after > 1.3 * max(before, check.allowed_m)
    assert np.abs(corners[1] - corners[0]).max() < SEATING_WAY
    legs = np.linspace(corners[1], corners[2], 60)
    moved = np.abs(legs - corners[1]).max(axis=1) + np.abs(corners[1] - corners[0]).max()
    assert check.first_collision(legs[moved > SEATING_WAY + SAMPLE]) is None
    monkeypatch.setattr(recovery, "_ways", lambda _: iter([corners]))
    with pytest.raises(MotionError, match=rf"panels {one} and {two} reach into each other.*by hand"):
        find_recovery(check, corners[0], contact_m=0.01 * check.mechanism.size_m)


def test_slits_that_do_not_come_apart_soon_are_no_way(monkeypatch: pytest.MonkeyPatch) -> None:
    check = Interference(Mechanism(structure("circle 3")))
    start, end = np.array([0.96, 1.0, 1.0]), np.full(3, 0.97)
    assert check.first_collision(end[None]) is None
    monkeypatch.setattr(recovery, "_ways", lambda _: iter([np.stack([start, end])]))
    with pytest.raises(MotionError, match=r"panels c1.ac and c3.da reach into each other.*by hand"):
        find_recovery(check, start, contact_m=0.01 * check.mechanism.size_m)


def test_where_cells_stand_only_slits_faces_may_touch_something() -> None:
    check = Interference(Mechanism(wing(slit="O1")))
    with pytest.raises(MotionError, match=r"panels c1.da and c3.da reach into .*limit: 0.1 mm.*zero_rad"):
        find_recovery(check, np.array([0.98, 0.99, 0.96, 0.97]), contact_m=0.01)
