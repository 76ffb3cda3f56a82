"""Interference and step tolerance against brute force."""

from __future__ import annotations

import numpy as np
import pytest

from ori_deploy.design import build, embed
from ori_deploy.motion import Interference, Mechanism, step_tolerance
from ori_deploy.motion.slits import checked_folds
from ori_deploy.motion.step_tolerance import SEATING_SPREAD, out_of_step_patterns
from ori_deploy.profiles import PointOutline, Superellipse
from tests.oracle.bridge import retold
from tests.oracle.fold import clash, placed
from tests.shapes import CATALOGUE, overfull, ring_on, structure, two_inner_vertices, wing

FINE = np.linspace(0.0, 1.0, 201)


def interference(name: str) -> Interference:
    return Interference(Mechanism(structure(name)))


@pytest.mark.parametrize("name", CATALOGUE)
def test_catalogue_unfolds_in_step_without_touching(name: str) -> None:
    assert interference(name).first_collision(FINE) is None


@pytest.mark.parametrize(("slit", "free"), [("O1", False), ("O2", True), ("O3", True), ("O4", False)])
def test_wing_slits_behave_as_published(slit: str, free: bool) -> None:
    collision = Interference(Mechanism(wing(slit=slit))).first_collision(FINE)
    assert (collision is None) == free
    if collision is not None:
        assert 0.5 < collision.fold[0] < 1.0
        assert collision.depth_m > 1e-4


def test_collision_error_names_pair_fold_and_depth() -> None:
    check = Interference(Mechanism(wing(slit="O1")))
    collision = check.first_collision(FINE)
    assert collision is not None
    text = str(collision.error(check.allowed_m, 1.0, "do this"))
    for part in (*collision.panels, "fold 0.7", "depth", "limit", "remedy: do this"):
        assert part in text


def test_three_cells_bonded_at_an_opening_vertex_cannot_fold_flat() -> None:
    s = overfull()
    assert {v for v, _ in s.layout.overfull_vertices} == {"Otop", "Obot"}
    collision = Interference(Mechanism(s)).first_collision(FINE)
    assert collision is not None
    assert collision.fold[0] == 0.0
    assert not structure("two inner vertices").layout.overfull_vertices


@pytest.mark.parametrize(
    "name", ["wing", "ellipse 4", "circle 3", "two inner vertices", pytest.param("peanut 8", marks=pytest.mark.slow)]
)
def test_verdicts_agree_with_the_oracle_out_of_step(name: str) -> None:
    s = structure(name)
    told, slits = retold(s)
    check = interference(name)
    generator = np.random.default_rng(11)
    n = s.layout.n_cells
    late = 1.0 - 0.08 * out_of_step_patterns(check)[: 2**n - 2 : max(1, 2**n // 16)]
    folds = np.concatenate([generator.random((12, n)), late])
    verdicts = 0
    for fold in folds:
        depth = clash(placed(told, list(fold), slits, 120)).depth
        hit = check.first_collision(fold[None]) is not None
        if depth > 1.3 * check.allowed_m:
            assert hit, (fold, depth)
            verdicts += 1
        elif depth < 0.5 * check.allowed_m:
            assert not hit, (fold, depth)
    assert verdicts > 0


def test_depth_agrees_with_the_oracle() -> None:
    s = wing(slit="O1")
    told, slits = retold(s)
    check = Interference(Mechanism(s))
    for at in (0.76, 0.79, 0.85):
        found = clash(placed(told, [at] * 4, slits, 300))
        assert found.pair is not None
        (i, k), (j, m) = found.pair
        pair = next(p for p, ij in enumerate(check.pairs.T) if set(ij) == {4 * i + k, 4 * j + m})
        assert check.depth_m(np.full(4, at), pair) == pytest.approx(found.depth, rel=0.03, abs=2e-5)


def test_what_happens_between_coarse_poses_is_seen() -> None:
    check = Interference(Mechanism(wing(slit="O1")))
    coarse = np.array([0.0, 0.3, 0.6, 1.0])
    assert check.first_collision(coarse, between=False) is None
    found = check.first_collision(coarse)
    assert found is not None
    assert 0.6 < found.fold[0] < 1.0


def test_penetration_bound_brackets_the_true_depth() -> None:
    check = Interference(Mechanism(wing(slit="O1")))
    bound = check.penetration_bound_m(np.array([0.79]))
    deepest = max(check.depth_m(np.full(4, 0.79), p) for p in range(check.pairs.shape[1]))
    assert 0.5 * bound <= deepest * 1.01
    assert deepest <= bound * 1.01
    assert interference("wing").penetration_bound_m(FINE) < 0.1 * check.allowed_m


def test_clearance_is_the_smallest_distance() -> None:
    from shapely import Polygon, distance

    check = interference("wing")
    folds = np.linspace(0.1, 0.9, 9)
    found = check.clearance(folds)
    poses = check.mechanism.poses(folds)
    outlines = check.mechanism.structure.panel_outlines()
    smallest = np.inf
    for k in range(len(folds)):
        shapes = []
        for p, outline in enumerate(outlines):
            z = poses.turn[p, k] * outline + poses.shift[p, k]
            shapes.append(Polygon(np.stack([z.real, z.imag], axis=1)))
        for (i, j), hinged in zip(check.pairs.T, check.hinged, strict=True):
            if not hinged:
                smallest = min(smallest, distance(shapes[i], shapes[j]))
    assert found.distance_m == pytest.approx(smallest, rel=1e-9)


# --- step tolerance --------------------------------------------------------------------------------------


def test_step_tolerance_of_the_wing_is_the_published_one_at_the_end() -> None:
    # Brute force over all patterns gave 0.003036 for this slit when the leading cells are deployed.
    steps = step_tolerance(interference("wing"))
    assert 0.0024 < steps.spread[-1] < 0.0031
    assert steps.seating_fold > 0.9
    assert steps.smallest >= SEATING_SPREAD
    assert steps.seating_depth_m < 0.003


@pytest.mark.parametrize(
    "name",
    [
        "wing",
        "ellipse 4",
        pytest.param("ellipse 7 off centre", marks=pytest.mark.slow),
        "two inner vertices",
        "two cells",
    ],
)
def test_random_states_within_the_tolerance_are_free(name: str) -> None:
    check = interference(name)
    steps = step_tolerance(check)
    generator = np.random.default_rng(3)
    n = check.mechanism.n_cells
    states = []
    for _ in range(600):
        lead = generator.uniform(0.02, 1.0)
        index = int(np.searchsorted(steps.lead, lead))
        lag = generator.random(n) * min(steps.spread[index], lead)
        lag[generator.integers(n)] = 0.0
        states.append(lead - lag)
    assert check.first_collision(np.array(states), between=False) is None


def test_more_than_the_tolerance_collides_somewhere() -> None:
    check = interference("ellipse 4")
    steps = step_tolerance(check)
    patterns = out_of_step_patterns(check)
    tight = [k for k in range(len(steps.lead)) if steps.spread[k] < 0.05]
    assert tight
    for k in tight:
        beyond = np.clip(steps.lead[k] - 3.0 * max(steps.spread[k], 0.0025) * (1.0 - patterns), 0.0, 1.0)
        assert check.first_collision(beyond, between=False) is not None


def test_one_cell_cannot_be_out_of_step() -> None:
    steps = step_tolerance(interference("one cell"))
    assert steps.allowed(0.5) == 1.0
    assert steps.seating_fold == 1.0


@pytest.mark.parametrize("name", ["wing", "ellipse 7 off centre", "ellipse 12"])
def test_patterns_have_a_first_and_a_last_cell(name: str) -> None:
    patterns = out_of_step_patterns(interference(name))
    assert np.allclose(patterns.min(axis=1), 0.0)
    assert np.allclose(patterns.max(axis=1), 1.0)
    assert len(np.unique(patterns, axis=0)) == len(patterns)


def thin_sheets(wall: float) -> Interference:
    """Two inner vertices in an octagon: all panels of the middle cell are sheets of the wall's thickness."""
    t = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    octagon = PointOutline(np.stack([np.cos(t), np.sin(t)], axis=1), smooth=False)
    e = two_inner_vertices().embedding
    names = [v.id for v in e.layout.vertices]
    places = {n: octagon.at_natural(float(e.s[i])) for i, n in enumerate(names) if np.isfinite(e.s[i])}
    inner = {n: (float(e.z[i].real), float(e.z[i].imag)) for i, n in enumerate(names) if np.isnan(e.s[i])}
    return Interference(Mechanism(build(embed(octagon, e.layout, places, inner), wall)))


@pytest.mark.parametrize("wall", [3e-4, 1e-4, 2e-5])
def test_thin_sheets_cannot_pass_through_each_other(wall: float) -> None:
    # The verdict on grossly crossing states may not depend on how thin the panels are.
    states = np.random.default_rng(2).random((60, 5))
    thick, thin = thin_sheets(1e-3), thin_sheets(wall)
    verdicts = np.array([[c.first_collision(s[None]) is None for s in states] for c in (thick, thin)])
    assert not verdicts[0].all()
    assert (verdicts[0] == verdicts[1]).mean() > 0.9


def test_poses_do_not_depend_on_where_the_profile_lies() -> None:
    f = Superellipse(1.0, 0.6).table_f
    shape = np.stack([f.real, f.imag], axis=1)
    counts = []
    for offset in (0.0, 100.0):
        e = ring_on(PointOutline(shape + offset), 4, centre=(offset, offset))
        counts.append(len(checked_folds(Mechanism(build(e, 0.01)))))
    assert counts[1] <= 1.1 * counts[0]
