"""Four-bars and poses: rigid, closed, flat, and equal to the slow oracle's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ori_deploy.design import build
from ori_deploy.errors import CellError, MotionError
from ori_deploy.motion import FourBars, Mechanism
from ori_deploy.profiles import Superellipse
from tests.oracle.bridge import retold
from tests.oracle.fold import solve
from tests.shapes import CATALOGUE, ring_on, structure

everything = pytest.mark.parametrize("name", CATALOGUE)

QUICK = {"wing", "circle 3", "ellipse 7 off centre", "one cell", "two inner vertices"}
by_the_oracle = pytest.mark.parametrize(
    "name",
    [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in CATALOGUE],  # which builds each anew
)
FLAT = np.array([np.pi, np.pi, 0.0, 0.0])


def bars(name: str) -> FourBars:
    return FourBars.of(structure(name).cells)


@everything
def test_deployed_angles_come_back_at_fold_one(name: str) -> None:
    assert np.allclose(bars(name).angles(1.0), structure(name).cells.angle, atol=1e-10)


@everything
def test_flat_means_flat(name: str) -> None:
    assert np.abs(bars(name).angles(0.0) - FLAT).max() < 1e-9


@everything
def test_flat_state_is_approached_without_a_jump(name: str) -> None:
    fold = np.logspace(-12, -3, 60)
    away = np.abs(bars(name).angles(fold) - FLAT).max(axis=(1, 2))
    assert (away <= 400.0 * fold + 1e-9).all()


@everything
def test_angles_always_add_up_and_stay_in_range(name: str) -> None:
    angles = bars(name).angles(np.linspace(0.0, 1.0, 400))
    assert np.allclose(angles.sum(axis=-1), 2.0 * np.pi, atol=1e-12)
    assert angles.min() >= 0.0
    assert angles[..., 2:].max() < np.pi
    assert angles[..., :2].max() <= np.pi + 0.2


@everything
def test_linkage_closes_at_every_fold(name: str) -> None:
    b = bars(name)
    angles = b.angles(np.linspace(0.0, 1.0, 101))
    lean, link = b.lean, b.link
    inner = np.stack(  # link angles at v1, c', v3, d'
        [
            angles[..., 2] + lean[:, 0] + lean[:, 3],
            angles[..., 0] - lean[:, 0] - lean[:, 1],
            angles[..., 3] + lean[:, 1] + lean[:, 2],
            angles[..., 1] - lean[:, 2] - lean[:, 3],
        ]
    )
    heading = np.exp(1j * np.cumsum(np.pi - inner[[1, 2, 3]], axis=0))
    end = link[:, 0] + (heading * link.T[1:, None, :]).sum(axis=0)
    assert np.abs(end).max() < 1e-13 * link.sum(axis=1).max()


@by_the_oracle
def test_angles_agree_with_the_oracle(name: str) -> None:
    told, _ = retold(structure(name))
    fold = [0.02, 0.3, 0.77, 0.99]
    ours = bars(name).angles(fold)
    for cell, other in enumerate(told.cells):
        for i, at in enumerate(fold):
            v1, c, v3, d = solve(other, at)
            assert np.allclose(ours[i, cell], [c, d, v1, v3], atol=3e-5)


@everything
def test_transmission_is_the_slope(name: str) -> None:
    b = bars(name)
    fold = np.linspace(0.05, 0.95, 40)
    h = 1e-4
    slope = (b.angles(fold + h) - b.angles(fold - h)) / (2 * h)
    assert np.allclose(b.transmission(fold), slope, atol=1e-2, rtol=1e-3)
    assert np.allclose(b.transmission(fold)[..., 2], structure(name).cells.angle[:, 2], rtol=1e-6)


@given(data=st.data())
@settings(max_examples=30)
def test_one_pose_and_many_are_the_same(data: st.DataObject) -> None:
    b = bars("ellipse 6 without wall")
    folds = np.array(data.draw(st.lists(st.lists(st.floats(0, 1), min_size=6, max_size=6), min_size=1, max_size=5)))
    together = b.angles(folds)
    for row, fold in zip(together, folds, strict=True):
        assert np.allclose(b.angles(fold[None])[0], row, atol=1e-14)
    assert np.allclose(b.angles(0.4), b.angles([0.4])[0], atol=1e-15)
    assert np.allclose(b.angles(0.4), b.angles(np.full((1, 6), 0.4))[0], atol=1e-15)


@pytest.mark.parametrize("fold", [-0.1, 1.0001, float("nan")])
def test_folds_outside_the_motion_are_refused(fold: float) -> None:
    with pytest.raises(MotionError, match="fold: outside the motion"):
        bars("wing").angles(fold)


# --- poses ---------------------------------------------------------------------------------------------


def random_folds(name: str, n: int = 30) -> np.ndarray:
    generator = np.random.default_rng(5)
    return np.concatenate(
        [generator.random((n, structure(name).layout.n_cells)), np.zeros((1, structure(name).layout.n_cells))]
    )


@everything
def test_deployed_pose_leaves_everything_in_place(name: str) -> None:
    poses = Mechanism(structure(name)).poses(1.0)
    assert np.abs(poses.turn - 1.0).max() < 1e-9
    assert np.abs(poses.shift).max() < 1e-9 * structure(name).profile.size


@everything
def test_panels_stay_congruent_and_joined_at_their_creases(name: str) -> None:
    s = structure(name)
    poses = Mechanism(s).poses(random_folds(name))
    assert np.abs(np.abs(poses.turn) - 1.0).max() < 1e-12
    for cell in range(s.layout.n_cells):
        # Panels 0|1 meet at c, 1|2 at b, 2|3 at d, and 3|0 at a, where the loop has to close.
        for k, crease in enumerate((0, 3, 1, 2)):
            one, two = 4 * cell + k, 4 * cell + (k + 1) % 4
            z = s.cells.crease[cell, crease]
            gap = poses.turn[one] * z + poses.shift[one] - poses.turn[two] * z - poses.shift[two]
            assert np.abs(gap).max() < 1e-12 * s.profile.size


@everything
def test_bonded_panels_move_as_one(name: str) -> None:
    s = structure(name)
    poses = Mechanism(s).poses(random_folds(name))
    for panel, other in enumerate(s.layout.bonded_to):
        if other >= 0:
            assert np.abs(poses.turn[panel] - poses.turn[other]).max() < 1e-12
            assert np.abs(poses.shift[panel] - poses.shift[other]).max() < 1e-12 * s.profile.size


@everything
def test_folded_inner_faces_of_a_cell_lie_on_one_line_and_all_panels_are_parallel(name: str) -> None:
    s = structure(name)
    poses = Mechanism(s).poses(0.0)
    turned = poses.turn[:, 0] * s.cells.direction.ravel()
    # Panels a-c and c-b of a cell run one way, b-d and d-a back.
    assert np.abs((turned / turned[0]).imag).max() < 1e-9
    for cell in range(s.layout.n_cells):
        face = s.cells.crease[cell, [0, 0, 1, 1]] + 1j * s.cells.direction[cell] * s.cells.offset[cell, [0, 0, 1, 1]]
        panels = slice(4 * cell, 4 * cell + 4)
        on_face = poses.turn[panels, 0] * face + poses.shift[panels, 0]
        height = (np.conj(turned[4 * cell]) * (on_face - on_face[0])).imag
        assert np.abs(height).max() < 1e-9 * s.profile.size


@everything
def test_matrices_are_the_motions(name: str) -> None:
    s = structure(name)
    poses = Mechanism(s).poses(random_folds(name, 3))
    matrices = poses.matrices()
    assert np.allclose(np.linalg.det(matrices), 1.0)
    z = s.cells.crease[0, 0]
    moved = matrices @ np.array([z.real, z.imag, 1.0])
    assert np.allclose(moved[..., 0] + 1j * moved[..., 1], (poses.turn * z + poses.shift).T)


@settings(max_examples=60)
@given(
    aspect=st.floats(0.4, 1.0),
    n=st.integers(3, 9),
    phase=st.floats(0.0, 6.2),
    wall=st.floats(0.0, 0.03),
    data=st.data(),
)
def test_any_ring_moves_rigidly_and_folds_flat(
    aspect: float, n: int, phase: float, wall: float, data: st.DataObject
) -> None:
    try:
        s = build(ring_on(Superellipse(1.0, aspect), n, phase=phase), wall)
    except CellError:
        assume(False)
    fold = np.array([data.draw(st.lists(st.floats(0.0, 1.0), min_size=n, max_size=n)), [0.0] * n, [1.0] * n])
    four_bars = FourBars.of(s.cells)
    angles = four_bars.angles(fold)
    assert np.allclose(angles.sum(axis=-1), 2.0 * np.pi, atol=1e-12)
    leaning = four_bars.lean[four_bars.lean > 0.0]
    # Where links hardly lean, how they lie when flat is a difference of numbers that are nearly equal.
    exact = 1e-9 + (4.0 * np.finfo(float).eps / leaning.min() if leaning.size else 0.0)
    assert np.abs(angles[1] - FLAT).max() < exact
    assert np.allclose(angles[2], s.cells.angle, atol=1e-9)
    poses = Mechanism(s).poses(fold)
    assert np.abs(np.abs(poses.turn) - 1.0).max() < 1e-12
    crease = s.cells.crease[:, 2]  # v1: the last crease of the loop, which nothing forces to close
    first, last = 4 * np.arange(n), 4 * np.arange(n) + 3
    gap = (poses.turn[first] - poses.turn[last]) * crease[:, None] + poses.shift[first] - poses.shift[last]
    assert np.abs(gap).max() < 1e-11
