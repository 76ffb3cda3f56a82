"""Interference on the sphere against brute force, and against the plane where the cone is narrow."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ori_deploy.design import ConeStructure, build, build_cone
from ori_deploy.errors import MotionError
from ori_deploy.motion import ConeMechanism, Interference, Mechanism, plan_motion, step_tolerance
from ori_deploy.motion.slits import checked_folds, free_slits, with_free_slits, with_slits
from ori_deploy.motion.sphere_contact import SphereContact
from ori_deploy.motion.step_tolerance import SEATING_SPREAD, out_of_step_patterns
from ori_deploy.profiles import Cone, Superellipse
from ori_deploy.profiles.sphere import arc
from ori_deploy.tolerance import TOLERANCE
from tests.cones import CONES, cone, cone_ring, coned, half
from tests.oracle.cone import ConeCell
from tests.oracle.cone_bridge import cone_retold
from tests.oracle.cone_fold import boundary_points, clash, deepest, gap, placed
from tests.shapes import ring_on

FINE = np.linspace(0.0, 1.0, 101)
GRAZES = {"superellipse 4", "oblique 6"}
"""With the slit they were given the panels at it touch, about as deep as is allowed."""


@cache
def interference(name: str) -> Interference:
    return Interference(ConeMechanism(cone(name)))


@cache
def told(name: str) -> list[ConeCell]:
    return cone_retold(cone(name))


def contact(name: str) -> SphereContact:
    return ConeMechanism(cone(name)).contact(TOLERANCE)


@pytest.mark.parametrize("name", [n for n in CONES if n not in GRAZES])
def test_catalogue_unfolds_in_step_without_touching(name: str) -> None:
    assert interference(name).first_collision(FINE) is None


@pytest.mark.parametrize("aspect", [1.0, 0.6])
def test_reference_cones_are_free_in_step_at_every_checked_fold(aspect: float) -> None:
    mechanism = ConeMechanism(build_cone(cone_ring(half(0.5, aspect), 6), 0.01))
    check = Interference(mechanism)
    folds = checked_folds(mechanism)
    assert check.first_collision(folds) is None
    assert check.penetration_bound_m(folds) < 0.1 * check.allowed_m


@pytest.mark.parametrize(
    "name",
    ["wide 5", *(pytest.param(n, marks=pytest.mark.slow) for n in ("elliptic 6", "two inner vertices", "hollow 8"))],
)
def test_verdicts_and_depths_agree_with_the_oracle_out_of_step(name: str) -> None:
    s = cone(name)
    check = interference(name)
    n = s.layout.n_cells
    patterns = out_of_step_patterns(check)[: 2**n - 2]
    chosen = np.random.default_rng(3).choice(len(patterns), 5, replace=False)
    folds = np.concatenate([1.0 - 0.08 * patterns[chosen], np.random.default_rng(11).random((2, n))])
    verdicts = 0
    for fold in folds:
        depth = clash(placed(told(name), s.layout, fold)).depth
        found = check.first_collision(fold[None])
        if depth > 1.05 * check.allowed_m:
            assert found is not None, (fold, depth)
            assert found.depth_m == pytest.approx(depth, rel=0.03)
            verdicts += 1
        elif depth < 0.95 * check.allowed_m:
            assert found is None, (fold, depth)
    assert verdicts > 0


@pytest.mark.parametrize("name", ["superellipse 4", pytest.param("oblique 6", marks=pytest.mark.slow)])
def test_grazing_is_judged_as_the_oracle_does(name: str) -> None:
    s = cone(name)
    check = interference(name)
    collision = check.first_collision(FINE)
    assert collision is not None
    # The dip is short: points every 0.0001 rad find it.
    panels = placed(told(name), s.layout, collision.fold)
    one, two = (panels[s.layout.panel_ids.index(p)] for p in collision.panels)
    depth = max(deepest(boundary_points(one, 1e-4), two), deepest(boundary_points(two, 1e-4), one))
    assert collision.depth_m == pytest.approx(depth, rel=0.05)
    assert depth > check.allowed_m


# --- bounds ------------------------------------------------------------------------------------------------


def random_pairs(
    name: str, n: int
) -> tuple[SphereContact, ConeMechanism, object, np.ndarray, np.ndarray, np.ndarray]:
    mechanism = ConeMechanism(cone(name))
    generator = np.random.default_rng(8)
    poses = mechanism.poses(generator.random((12, mechanism.n_cells)))
    i, j = generator.integers(0, mechanism.layout.n_panels, (2, n))
    return mechanism.contact(TOLERANCE), mechanism, poses, generator.integers(0, 12, n), i, j


@pytest.mark.parametrize("name", ["elliptic 6", "wide 5", "hollow 8", "one cell", "tapered wing"])
def test_boxes_never_promise_more_than_the_distance(name: str) -> None:
    check, _, poses, pose, i, j = random_pairs(name, 600)
    distance = check.distances(poses, pose, i, j)
    assert (check.gaps(poses, pose, i, j) <= distance + 1e-9).all()
    assert np.allclose(distance, check.distances(poses, pose, j, i), atol=1e-12)
    assert (distance > 0.0).any()
    assert (distance[i == j] == 0.0).all()


@pytest.mark.parametrize("name", ["elliptic 6", "wide 5", "hollow 8"])
def test_distances_are_the_oracles(name: str) -> None:
    check, _, poses, pose, i, j = random_pairs(name, 40)
    distance = check.distances(poses, pose, i, j)
    outlines = cone(name).panel_outlines(check.tolerance.sagitta * cone(name).profile.size)
    for k in np.flatnonzero(distance > 0.0):
        one = outlines[i[k]] @ poses.rotation[i[k], pose[k]].T
        two = outlines[j[k]] @ poses.rotation[j[k], pose[k]].T
        assert distance[k] == pytest.approx(gap(one, two), rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("name", ["elliptic 6", "wide 5", "one cell"])
def test_no_point_travels_further_than_the_bound(name: str) -> None:
    s = cone(name)
    mechanism = ConeMechanism(s)
    check = mechanism.contact(TOLERANCE)
    generator = np.random.default_rng(2)
    i, j = np.array([(a, b) for a in range(s.layout.n_panels) for b in range(s.layout.n_panels) if a != b]).T
    for _ in range(6):
        start = generator.random(mechanism.n_cells)
        stop = np.clip(start + generator.normal(0.0, 0.1, mechanism.n_cells), 0.0, 1.0)
        along = mechanism.poses(start + np.linspace(0.0, 1.0, 7)[:, None] * (stop - start))
        bound = check.travel(along.part(slice(0, 1)), along.part(slice(6, 7)), np.zeros(len(i), dtype=np.intp), i, j)
        for k in generator.choice(len(i), 30):
            seen = along.rotation[j[k]].swapaxes(-1, -2) @ along.rotation[i[k]]
            points = s.panel_outlines()[i[k]] @ seen.swapaxes(-1, -2)
            moved = arc(points[:1], points)
            assert moved.max() <= bound[k] + 1e-12


@pytest.mark.parametrize("depth", [1e-4, 3e-3])
@pytest.mark.parametrize("name", ["circular 6", "wide 5", "hollow 8"])
def test_shrunk_panels_keep_what_is_deeper(name: str, depth: float) -> None:
    import shapely

    from tests.oracle.cone_fold import to_boundary

    check = contact(name)
    panels = np.arange(cone(name).layout.n_panels)
    cores = check.shrunk(np.full(len(panels), depth), panels)
    outlines = cone(name).panel_outlines(TOLERANCE.sagitta * cone(name).profile.size)
    seen = 0
    for p in panels[:4]:
        corners = shapely.get_coordinates(cores[p])
        if not len(corners):
            continue
        frame = check._boxes.frame[p]
        points = np.column_stack([corners, np.ones(len(corners))]) @ frame
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        inside = -to_boundary(points, outlines[p])
        assert inside.min() > 0.97 * depth
        assert np.median(inside) < 1.01 * depth
        seen += 1
    assert seen > 0


def test_panels_beyond_the_horizon_are_seen_as_far_as_they_show() -> None:
    # A wide cone whose chain of cells opens past a right angle: many a panel sinks below another's horizon.
    check, mechanism, _, _, _, _ = random_pairs("wide 5", 1)
    poses = mechanism.poses(np.linspace(0.0, 1.0, 9))
    i, j = np.array([(a, b) for a in range(20) for b in range(20) if a != b]).T
    pose = np.repeat(np.arange(9), len(i))
    i, j = np.tile(i, 9), np.tile(j, 9)
    outlines = check.outlines
    frame = check._boxes.frame
    lowest = np.array(
        [
            (frame[b, 2] @ poses.rotation[b, k].T @ poses.rotation[a, k] @ outlines[a].T).min()
            for k, a, b in zip(pose, i, j, strict=True)
        ]
    )
    sunk = np.flatnonzero(lowest < 0.0)
    assert len(sunk) > 50
    some = sunk[:: max(1, len(sunk) // 25)]
    distance = check.distances(poses, pose[some], i[some], j[some])
    for k, found in zip(some, distance, strict=True):
        one = outlines[i[k]] @ poses.rotation[i[k], pose[k]].T
        two = outlines[j[k]] @ poses.rotation[j[k], pose[k]].T
        if found > 0.0:
            assert found == pytest.approx(gap(one, two), rel=1e-3, abs=1e-6)
        else:
            assert gap(one, two) < 1e-9 or clash([one, two]).depth > 0.0


# --- along motions ------------------------------------------------------------------------------------------


def test_what_happens_between_coarse_poses_is_seen() -> None:
    check = interference("oblique 6")
    coarse = np.array([0.0, 0.3, 0.6, 1.0])
    assert check.first_collision(coarse, between=False) is None
    found = check.first_collision(coarse)
    assert found is not None
    assert 0.9 < found.fold[0] < 1.0


def test_clearance_is_the_smallest_distance() -> None:
    check = interference("circular 6")
    folds = np.linspace(0.2, 0.9, 4)
    found = check.clearance(folds)
    poses = check.mechanism.poses(folds)
    free = check.pairs[:, ~check.hinged]
    smallest = min(check.contact.distances(poses, np.full(free.shape[1], k), *free).min() for k in range(len(folds)))
    assert found.distance_m == pytest.approx(smallest, rel=1e-12)
    assert smallest > 0.0


def test_lengths_are_told_at_the_outer_radius() -> None:
    s = cone("elliptic 6")
    one, small = (Interference(ConeMechanism(s, r)) for r in (1.0, 0.3))
    folds = np.array([0.3, 0.6])
    assert small.allowed_m == pytest.approx(0.3 * one.allowed_m)
    assert small.clearance(folds).distance_m == pytest.approx(0.3 * one.clearance(folds).distance_m)
    pairs = [
        (one.first_collision(fold[None]), small.first_collision(fold[None]))
        for fold in 1.0 - 0.08 * out_of_step_patterns(one)[:20]
    ]
    assert all((a is None) == (b is None) for a, b in pairs)
    depths = np.array([(a.depth_m, b.depth_m) for a, b in pairs if a is not None and b is not None])
    assert len(depths) > 0
    assert np.allclose(depths[:, 1], 0.3 * depths[:, 0], rtol=0.03)


@pytest.mark.parametrize("aspect", [1.0, 0.6])
def test_a_narrow_cone_is_as_clear_as_the_plane(aspect: float) -> None:
    folds = np.array([0.2, 0.5, 0.8])
    plane = Interference(Mechanism(build(ring_on(Superellipse(1.0, aspect), 6), 0.02)))
    narrow = Interference(ConeMechanism(build_cone(cone_ring(half(0.01, aspect), 6), 2e-4), 100.0))
    ours, theirs = narrow.clearance(folds), plane.clearance(folds)
    assert ours.distance_m == pytest.approx(theirs.distance_m, rel=2e-3)
    fold = np.array([1.0, 1.0, 1.0, 0.93, 0.93, 0.93])
    deep = [check.first_collision(fold[None]) for check in (narrow, plane)]
    assert (deep[0] is None) == (deep[1] is None)
    if deep[0] is not None and deep[1] is not None:
        assert deep[0].panels == deep[1].panels
        assert deep[0].depth_m == pytest.approx(deep[1].depth_m, rel=0.02)


def test_verdicts_do_not_depend_on_how_thin_the_panels_are() -> None:
    def sheets(wall: float) -> Interference:
        return Interference(ConeMechanism(coned("two inner vertices", (0.0, 0.0, -2.0), wall)))

    states = np.random.default_rng(2).random((40, 5))
    thick, thin = sheets(2e-3), sheets(1e-5)
    verdicts = np.array([[c.first_collision(s[None]) is None for s in states] for c in (thick, thin)])
    assert not verdicts[0].all()
    assert (verdicts[0] == verdicts[1]).mean() > 0.9


def test_a_panel_too_large_for_its_chart_is_refused_by_name() -> None:
    s = cone("one cell")
    big = replace(s)
    object.__setattr__(big, "panel_outlines", lambda _: tuple(_spread(o) for o in s.panel_outlines()))
    with pytest.raises(MotionError, match=r"panel c1\.\w+: too large.*limit: below 1\.2 rad"):
        _ = SphereContact(big, TOLERANCE, 1.0).shapes


def _spread(points: np.ndarray) -> np.ndarray:
    """Points four times as far from their middle."""
    middle = points.mean(axis=0) / np.linalg.norm(points.mean(axis=0))
    away = points - (points @ middle)[:, None] * middle
    angle = arc(points, middle)[:, None]
    return np.cos(4.0 * angle) * middle + np.sin(4.0 * angle) * away / np.linalg.norm(away, axis=1, keepdims=True)


# --- slits, step tolerance, plans ----------------------------------------------------------------------------


def test_free_slits_are_found_for_cones() -> None:
    s = cone("superellipse 4")
    assert list(free_slits(s)) == [(("P", "O2"),), (("P", "O3"),)]
    freed = with_free_slits(s)
    assert isinstance(freed, ConeStructure)
    assert freed.layout.latch_points == ("slit:P-O2",)
    assert np.array_equal(with_slits(s, (("P", "O3"),)).cells.crease, s.cells.crease)


def test_random_states_within_the_tolerance_are_free() -> None:
    check = Interference(ConeMechanism(build_cone(cone_ring(half(0.8, 0.7), 3), 0.01)))
    steps = step_tolerance(check)
    assert steps.smallest >= SEATING_SPREAD
    assert 0.0 < steps.seating_fold <= 1.0
    generator = np.random.default_rng(3)
    states = []
    for _ in range(200):
        lead = generator.uniform(0.02, 1.0)
        index = int(np.searchsorted(steps.lead, lead))
        lag = generator.random(3) * min(steps.spread[index], lead)
        lag[generator.integers(3)] = 0.0
        states.append(lead - lag)
    assert check.first_collision(np.array(states), between=False) is None


def limits(n: int) -> tuple[np.ndarray, np.ndarray]:
    velocity, acceleration = np.full((n, 4), np.inf), np.full((n, 4), np.inf)
    velocity[:, 2], acceleration[:, 2] = 0.6, 1.2
    return velocity, acceleration


def test_plan_of_a_cone_holds_what_the_mechanism_does() -> None:
    s = build_cone(cone_ring(half(0.5, 0.6), 3), 0.01)
    plan = plan_motion(s, *limits(3), 100.0, r_max_m=0.4)
    bars = ConeMechanism(s).four_bars
    assert np.array_equal(plan.crease_angles_rad, bars.angles(plan.fold))
    assert plan.check.allowed_penetration_m == pytest.approx(0.4 * TOLERANCE.penetration * s.profile.size)
    assert plan.check.deepest_penetration_m <= plan.check.allowed_penetration_m
    assert 0.0 < plan.check.smallest_clearance_m < 0.4
    assert plan.latch_points == ("slit:P-O1",)


def test_colliding_cone_is_refused_with_slits_that_would_be_free() -> None:
    with pytest.raises(MotionError, match=r"panels c\d\.\w+ and c\d\.\w+ reach into each other") as refused:
        plan_motion(cone("superellipse 4"), *limits(4), 100.0)
    assert refused.value.remedy == 'slits = [["P", "O2"]] or [["P", "O3"]] would be free'


def test_cells_bonded_three_in_a_row_cannot_fold_flat_on_a_cone() -> None:
    s = with_slits(coned("two inner vertices", (0.0, 0.0, -2.0), 0.004), (("P", "Oleft"), ("Q", "Oright")))
    assert s.layout.overfull_vertices
    collision = Interference(ConeMechanism(s)).first_collision(FINE)
    assert collision is not None
    assert collision.fold[0] == 0.0


def test_an_apex_above_or_below_moves_alike() -> None:
    cones = [Cone(Superellipse(0.3, 0.2), (0.0, 0.0, z)) for z in (1.5, -1.5)]
    above, below = (Interference(ConeMechanism(build_cone(cone_ring(c, 5), 0.002))) for c in cones)
    folds = np.array([0.3, 0.7])
    assert above.clearance(folds).distance_m == pytest.approx(below.clearance(folds).distance_m, rel=1e-9)
