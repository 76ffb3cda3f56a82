"""Spherical four-bars and rotations: rigid, closed, flat, and equal to the slow oracle's."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ori_deploy.design import ConeStructure, build_cone
from ori_deploy.errors import CellError, LayoutError, MotionError
from ori_deploy.motion import ConeMechanism, FourBars, Mechanism, SphericalFourBars, mechanism_of
from ori_deploy.profiles.sphere import arc, polygon_excess, unit
from tests.cones import CONES, cone, cone_ring, half
from tests.oracle.cone import ConeCell
from tests.oracle.cone_bridge import cone_retold
from tests.oracle.cone_fold import solve
from tests.shapes import CATALOGUE, structure

everything = pytest.mark.parametrize("name", CONES)
FLAT = np.array([np.pi, np.pi, 0.0, 0.0])
QUICK = {"elliptic 6", "wide 5", "one cell", "tapered wing"}
BETWEEN = (0, 3, 1, 2)
"""Crease between panel k and k + 1 of a cell, in the order of CREASES."""


def bars(name: str) -> SphericalFourBars:
    return SphericalFourBars.of(cone(name).cells)


@cache
def told(name: str) -> ConeCell:
    """The first cell of a structure, built by the oracle."""
    return cone_retold(cone(name), [0])[0]


@everything
def test_deployed_angles_come_back_at_fold_one(name: str) -> None:
    assert np.allclose(bars(name).angles(1.0), cone(name).cells.angle, atol=1e-10)


@everything
def test_flat_means_flat(name: str) -> None:
    assert np.abs(bars(name).angles(0.0) - FLAT).max() < 1e-9


@everything
def test_flat_state_is_approached_without_a_jump(name: str) -> None:
    fold = np.logspace(-12, -3, 60)
    away = np.abs(bars(name).angles(fold) - FLAT).max(axis=(1, 2))
    assert (away <= 400.0 * fold + 1e-9).all()


@everything
def test_motion_is_smooth_on_one_branch(name: str) -> None:
    fold = np.linspace(0.0, 1.0, 2001)
    angles = bars(name).angles(fold)
    assert np.abs(np.diff(angles, n=2, axis=0))[5:].max() < 1e-2
    assert angles.min() >= 0.0
    assert angles[..., 2:].max() < np.pi


@everything
def test_angles_add_up_to_more_than_a_turn_by_the_links_area(name: str) -> None:
    s = cone(name)
    b = bars(name)
    fold = np.linspace(0.0, 1.0, 41)
    lean_at_c = np.arctan(np.cos(b.link) * np.tan(b.lean))
    poses = ConeMechanism(s).poses(fold)
    angles = b.angles(fold)
    for cell in range(s.layout.n_cells):
        # v1 and c' on the first panel, v3 on the second, d' on the fourth.
        at = [(0, 2), (0, 0), (1, 3), (3, 1)]
        corner = np.stack([poses.rotation[4 * cell + p] @ s.cells.crease[cell, k] for p, k in at], axis=1)
        links = angles[:, cell].sum(axis=-1) + b.lean[cell].sum() - lean_at_c[cell].sum()
        area = polygon_excess(corner, unit(corner.sum(axis=1, keepdims=True)))
        assert np.allclose(links - 2.0 * np.pi, area, atol=1e-11)


@pytest.mark.parametrize(
    "name",
    [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in CONES],  # the oracle builds each anew
)
def test_angles_agree_with_the_oracle(name: str) -> None:
    for at in (0.05, 0.6):
        v1, c, v3, d = solve(told(name), at)
        assert np.allclose(bars(name).angles(at)[0], [c, d, v1, v3], atol=1e-7)


@everything
def test_transmission_is_the_slope(name: str) -> None:
    b = bars(name)
    fold = np.linspace(0.05, 0.95, 40)
    step = 1e-4
    slope = (b.angles(fold + step) - b.angles(fold - step)) / (2 * step)
    assert np.allclose(b.transmission(fold), slope, atol=1e-2, rtol=1e-3)


@pytest.mark.parametrize("name", CATALOGUE)
def test_short_links_move_as_in_the_plane(name: str) -> None:
    plane = FourBars.of(structure(name).cells)
    fold = np.linspace(0.1, 1.0, 10)
    around = plane.link.sum(axis=1, keepdims=True)
    errors = [
        np.abs(
            SphericalFourBars(small * plane.link / around, plane.lean, plane.deployed).angles(fold)
            - plane.angles(fold)
        ).max()
        for small in (0.2, 0.1)
    ]
    assert errors[1] < 0.01
    assert errors[1] == pytest.approx(0.25 * errors[0], rel=0.15)


@pytest.mark.parametrize("fold", [-0.1, 1.0001, float("nan")])
def test_folds_outside_the_motion_are_refused(fold: float) -> None:
    with pytest.raises(MotionError, match="fold: outside the motion"):
        bars("circular 6").angles(fold)


@pytest.mark.parametrize("aspect", [1.0, 0.6])
def test_reference_cones_fold_flat_to_a_millionth_of_a_degree(aspect: float) -> None:
    s = build_cone(cone_ring(half(0.5, aspect), 6), 0.01)
    assert np.degrees(np.abs(SphericalFourBars.of(s.cells).angles(0.0) - FLAT).max()) < 1e-6


# --- poses ---------------------------------------------------------------------------------------------


def random_folds(s: ConeStructure, n: int = 20) -> np.ndarray:
    generator = np.random.default_rng(5)
    return np.concatenate([generator.random((n, s.layout.n_cells)), np.zeros((1, s.layout.n_cells))])


@everything
def test_deployed_pose_leaves_everything_in_place(name: str) -> None:
    assert np.abs(ConeMechanism(cone(name)).poses(1.0).rotation - np.eye(3)).max() < 1e-9


def check_rigid_and_closed(s: ConeStructure, folds: np.ndarray) -> None:
    rotation = ConeMechanism(s).poses(folds).rotation
    assert np.abs(rotation @ rotation.swapaxes(-1, -2) - np.eye(3)).max() < 1e-12
    assert np.linalg.det(rotation).min() > 0.5
    # Panels 0|1 meet at c, 1|2 at b, 2|3 at d, and 3|0 at a, where the loop has to close.
    for cell in range(s.layout.n_cells):
        for k, crease in enumerate(BETWEEN):
            one, two = 4 * cell + k, 4 * cell + (k + 1) % 4
            u = s.cells.crease[cell, crease]
            assert np.abs(rotation[one] @ u - rotation[two] @ u).max() < 1e-12
    for panel, other in enumerate(s.layout.bonded_to):
        if other >= 0:
            assert np.abs(rotation[panel] - rotation[other]).max() < 1e-12


@everything
def test_panels_stay_rigid_bonded_and_joined_at_their_creases(name: str) -> None:
    check_rigid_and_closed(cone(name), random_folds(cone(name)))


@everything
def test_links_keep_their_arcs(name: str) -> None:
    s = cone(name)
    rotation = ConeMechanism(s).poses(random_folds(s, 6)).rotation.reshape(s.layout.n_cells, 4, -1, 3, 3)
    places = {
        k: np.einsum("cpab,cb->cpa", rotation[:, p], s.cells.crease[:, k])
        for k, p in ((0, 0), (2, 0), (3, 1), (1, 3))
    }
    for link, (k, m) in enumerate(((2, 0), (0, 3), (3, 1), (1, 2))):
        assert np.abs(arc(places[k], places[m]) - s.cells.link[:, link, None]).max() < 1e-12


@everything
def test_folded_cells_are_two_slabs_with_one_inner_face_between_them(name: str) -> None:
    s = cone(name)
    flat = ConeMechanism(s).poses(0.0).rotation[:, 0]
    pole = np.einsum("pab,pb->pa", flat, s.cells.pole.reshape(-1, 3)).reshape(-1, 4, 3)
    outward = np.array([1.0, 1.0, -1.0, -1.0])[:, None]
    assert np.abs(pole * outward - pole[:, :1]).max() < 1e-9
    for p, outline in enumerate(s.panel_outlines()):
        assert (outline @ flat[p].T @ pole[p // 4, p % 4]).max() < 1e-9


@pytest.mark.parametrize("name", [n for n in CONES if n not in {"superellipse 4", "oblique 6"}])
def test_folded_panels_lie_side_by_side(name: str) -> None:
    s = cone(name)
    flat = ConeMechanism(s).poses(0.0).rotation[:, 0]
    outlines = [o @ turn.T for o, turn in zip(s.panel_outlines(), flat, strict=True)]
    middle = np.concatenate(outlines).mean(axis=0)
    frame = np.linalg.svd(middle[None])[2][[1, 2, 0]]
    local = [o @ frame.T for o in outlines]
    assert min(abs(u[:, 2]).min() for u in local) > 0.1
    shapes = [shapely.make_valid(shapely.Polygon(u[:, :2] / u[:, 2:])) for u in local]
    total = sum(shape.area for shape in shapes)
    assert shapely.union_all(shapes).area == pytest.approx(total, rel=2e-4)


@everything
def test_matrices_turn_the_users_space_about_the_apex(name: str) -> None:
    s = cone(name)
    poses = ConeMechanism(s).poses(random_folds(s, 2))
    matrices = poses.matrices()
    apex = np.append(s.profile.apex, 1.0)
    assert np.allclose(np.linalg.det(matrices), 1.0)
    assert np.allclose(matrices @ apex, apex, atol=1e-12)
    for panel in (0, 3, s.layout.n_panels - 1):
        u = s.cells.crease[panel // 4, 0]
        here = np.append(s.profile.apex + 0.7 * s.profile.to_user(u), 1.0)
        there = s.profile.apex + 0.7 * s.profile.to_user(poses.rotation[panel] @ u)
        assert np.allclose((matrices[:, panel] @ here)[:, :3], there, atol=1e-12)


def test_a_structure_finds_its_own_mechanism() -> None:
    assert isinstance(mechanism_of(cone("circular 6"), 0.4), ConeMechanism)
    assert isinstance(mechanism_of(structure("wing")), Mechanism)
    assert mechanism_of(cone("circular 6"), 0.4).size_m == pytest.approx(0.4)


@settings(max_examples=25)
@given(
    angle=st.floats(0.02, 1.25),
    aspect=st.floats(0.4, 1.0),
    n=st.integers(3, 9),
    phase=st.floats(0.0, 6.2),
    wall=st.floats(0.0, 0.03),
    off=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
    data=st.data(),
)
def test_any_ring_moves_rigidly_and_folds_flat(
    angle: float, aspect: float, n: int, phase: float, wall: float, off: tuple[float, float], data: st.DataObject
) -> None:
    profile = half(angle, aspect)
    centre = (off[0] * np.tan(angle), off[1] * np.tan(angle))
    try:
        s = build_cone(cone_ring(profile, n, phase=phase, centre=centre), wall * profile.size)
    except (CellError, LayoutError):
        assume(False)
    angles = SphericalFourBars.of(s.cells).angles(np.array([[0.0] * n, [1.0] * n]))
    assert np.abs(angles[0] - FLAT).max() < 1e-9
    assert np.allclose(angles[1], s.cells.angle, atol=1e-9)
    check_rigid_and_closed(s, np.array([data.draw(st.lists(st.floats(0.0, 1.0), min_size=n, max_size=n)), [0.0] * n]))


# --- the folded stack ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "r_min"), [("elliptic 6", 0.2), ("wide 5", 0.0), ("tapered wing", 0.5), ("one cell", 0.9)]
)
def test_stack_box_holds_the_stack_and_no_random_box_is_smaller(name: str, r_min: float) -> None:
    s = cone(name)
    mechanism = ConeMechanism(s)
    box = mechanism.stack_box_m(r_min, 1.0)
    assert list(box) == sorted(box, reverse=True)
    doubled = mechanism.stack_box_m(2.0 * r_min, 2.0)
    assert np.allclose(doubled, 2.0 * np.array(box), rtol=1e-9)
    solid = s.panel_areas.sum() * (1.0 - r_min**3) / 3.0
    assert solid < np.prod(box)
    flat = mechanism.poses(0.0).rotation[:, 0]
    corners = np.concatenate([o @ turn.T for o, turn in zip(s.panel_outlines(), flat, strict=True)])
    points = np.concatenate([corners, r_min * corners])
    generator = np.random.default_rng(4)
    others = np.linalg.qr(generator.normal(size=(4000, 3, 3)))[0]
    assert np.prod(box) <= 1.001 * np.ptp(points @ others, axis=1).prod(axis=1).min()
    # No box is smaller across its thinnest direction than the stack's least width.
    assert box[2] >= np.ptp(points @ others, axis=1).min() * 0.98 - 1e-3
