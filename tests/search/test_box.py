"""The smallest folded stack: the model's box is the one the mechanism folds to, and the search makes it smaller."""

from __future__ import annotations

import numpy as np
import pytest

from ori_deploy.design import Structure, build
from ori_deploy.errors import LayoutError
from ori_deploy.layout import make_layout
from ori_deploy.motion import Mechanism
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Reals
from ori_deploy.search import Fixed, Solution, Wish, solve
from ori_deploy.search.box import BoxProblem
from ori_deploy.search.many import worth
from ori_deploy.search.problem import Values
from ori_deploy.search.stack import Stack
from ori_deploy.tolerance import TOLERANCE
from tests.search.cases import CIRCLE, ELLIPSE, WING, at, ring_layout
from tests.shapes import CATALOGUE, overfull, ring_on, structure

SMALL = Wish(objective="box_ratio")


def box_of(s: Structure) -> tuple[float, float]:
    problem = BoxProblem(s.embedding, s.wall_m, SMALL)
    box = problem.box_m(problem.first)
    assert box is not None
    return box


def folded(s: Structure) -> tuple[float, float]:
    """Length along the stack and height of what the mechanism folds to."""
    flat = Mechanism(s).poses(0.0)
    z = np.concatenate([flat.turn[p, 0] * o + flat.shift[p, 0] for p, o in enumerate(s.panel_outlines())])
    z = np.conj(flat.turn[0, 0] * s.cells.direction[0, 0]) * z
    return float(np.ptp(z.real)), float(np.ptp(z.imag))


def ratio(found: Solution) -> float:
    long, short = Mechanism(found.structure).stack_box_m
    return found.structure.profile.area / (long * short)


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_models_box_is_the_folded_stacks(name: str) -> None:
    """To the sagitta with which curved panels are drawn: none of these bulges beyond its closing vertex."""
    s = structure(name)
    length, height = box_of(s)
    true_length, true_height = folded(s)
    drawn = 2.0 * TOLERANCE.sagitta * s.profile.size
    assert length == pytest.approx(true_length, abs=1e-9 * s.profile.size)
    assert true_height - 1e-9 * s.profile.size <= height <= true_height + drawn
    long, short = Mechanism(s).stack_box_m
    assert long * short <= (length * height) * (1.0 + 1e-9)


def test_every_slit_has_its_own_stack() -> None:
    """The chain begins at the slit: another slit, other shifts, another length; the height stays."""
    begin = ring_on(ELLIPSE, 5, phase=0.2, centre=(0.1, 0.05))
    ids = [v.id for v in begin.layout.vertices]
    cells = [tuple(ids[i] for i in cell) for cell in begin.layout.cells]
    boxes = []
    for k in range(1, 6):
        layout = make_layout(begin.layout.vertices, cells, [("P", f"O{k}")])  # type: ignore[arg-type]
        s = build(type(begin)(begin.profile, layout, begin.s, begin.z), 0.01)
        boxes.append(box_of(s))
        assert boxes[-1][0] == pytest.approx(folded(s)[0], abs=1e-9)
    lengths, heights = np.array(boxes).T
    assert np.ptp(lengths) > 1e-3
    assert np.ptp(heights) < 1e-12


def values(problem: BoxProblem, x: Reals) -> Values:
    found = problem.values(x)
    assert found is not None
    return found


@pytest.mark.parametrize("name", ["ellipse 7 off centre", "two inner vertices", "two cells", "peanut 8", "wing"])
def test_derivatives_are_those_of_differences(name: str) -> None:
    s = structure(name)
    problem = BoxProblem(s.embedding, s.wall_m, Wish(objective="box_ratio", panel_m=1e-3))
    x = problem.first.copy()
    x[problem.unknowns.n_places : problem.unknowns.wall] += 2e-3
    if name == "wing":  # off the nose, where curvature jumps
        x[problem.free & (np.arange(len(x)) < problem.unknowns.n_places)] += 0.013
    here = values(problem, x)
    assert len(problem.rows) == len(here.inequality)
    weight = np.random.default_rng(3).random(len(here.inequality))
    values(problem, x)
    exact = problem.curvature(x, weight, np.zeros(0))
    h = 1e-5
    for k in np.flatnonzero(problem.free):
        step = h * np.eye(len(x))[k]
        up, down = values(problem, x + step), values(problem, x - step)
        scale = 1.0 + np.abs(here.inequality_slope[:, k]).max()
        assert abs((up.objective - down.objective) / (2.0 * h) - here.gradient[k]) < 1e-6 * scale
        difference = (up.inequality - down.inequality) / (2.0 * h)
        assert np.abs(difference - here.inequality_slope[:, k]).max() < 2e-6 * scale
        bend = (up.gradient - weight @ up.inequality_slope) - (down.gradient - weight @ down.inequality_slope)
        assert np.abs(bend / (2.0 * h) - exact[k])[problem.free].max() <= 1e-6 * np.abs(exact).max()


@pytest.mark.parametrize(
    ("profile", "n", "wall_m", "start"),
    [(ELLIPSE, 4, 0.0, 0), (ELLIPSE, 6, 0.01, 2), (WING, 4, 0.004, 0), (CIRCLE, 5, 0.02, 3)],
)
def test_the_box_is_never_larger_than_where_eta_is_largest(
    profile: Profile, n: int, wall_m: float, start: int
) -> None:
    most = solve(profile, ring_layout(n), wall_m, start=start)
    small = solve(profile, ring_layout(n), wall_m, SMALL, start=start)
    assert ratio(small) >= ratio(most) * (1.0 - 1e-8)
    assert small.eta <= most.eta + 1e-8
    assert worth(small, SMALL) == ratio(small)
    assert small.structure.cells.dead_centre_margin.min() >= SMALL.margin_rad
    problem = BoxProblem(small.structure.embedding, wall_m, SMALL)
    assert 1.0 / values(problem, problem.first).objective == pytest.approx(ratio(small), rel=3e-4)


def test_a_wing_packs_much_smaller_than_where_eta_is_largest() -> None:
    """eta counts no gaps: the wing of the largest eta leaves a staircase that is mostly air."""
    most, small = solve(WING, ring_layout(4), 0.004), solve(WING, ring_layout(4), 0.004, SMALL)
    assert ratio(small) > 1.3 * ratio(most)


def test_no_step_by_chance_gives_a_smaller_box() -> None:
    """Judged only by what the mechanism folds to."""
    found = solve(ELLIPSE, ring_layout(4), 0.02, SMALL)
    e, generator = found.structure.embedding, np.random.default_rng(8)
    best, step = ratio(found), 1e-2
    for _ in range(120):
        s = e.s + step * generator.normal(size=len(e.s))
        z = np.where(
            np.isnan(s), e.z + step * (generator.normal() + 1j * generator.normal()), ELLIPSE.point(np.nan_to_num(s))
        )
        other = build(type(e)(ELLIPSE, e.layout, s, z), 0.02)
        length, height = folded(other)
        assert ELLIPSE.area / (length * height) <= best * (1.0 + 1e-4)  # the height is drawn to its sagitta
        step = 10.0 ** generator.uniform(-4.0, -1.3)


def test_pins_hold_in_the_smallest_box_too() -> None:
    begin = ring_on(ELLIPSE, 5, phase=0.3)
    wish = Wish(objective="box_ratio", pins=(Fixed("P"), Fixed("O2")))
    found = solve(ELLIPSE, begin.layout, 0.01, wish, start=begin)
    for name in ("P", "O2"):
        assert abs(at(found.structure.embedding, name) - at(begin, name)) < 1e-9


def test_what_does_not_fold_flat_has_no_stack() -> None:
    broken = overfull().embedding
    with pytest.raises(LayoutError, match="does not fold flat"):
        Stack(broken.layout)
    with pytest.raises(LayoutError, match="does not fold flat"):
        solve(broken.profile, broken.layout, 0.01, SMALL, start=broken)
