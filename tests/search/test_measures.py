"""Measures agree with the construction, and their derivatives with differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ori_deploy.design import Embedding, Structure, build
from ori_deploy.errors import InputError
from ori_deploy.profiles import Superellipse
from ori_deploy.profiles.profile import Reals
from ori_deploy.search.problem import Problem, Values
from ori_deploy.search.wish import Wish
from tests.shapes import CATALOGUE, ring_on, structure

ALL_BOUNDS = Wish(margin_rad=0.05, panel_m=1e-3)


def problem_at(place: Embedding, wall_m: float) -> tuple[Problem, Reals]:
    """The problem and its unknowns, every raise a little off its bound so that its derivatives are seen too."""
    problem = Problem(place, wall_m, ALL_BOUNDS)
    x = problem.first.copy()
    x[problem.unknowns.n_places :] += 2e-3
    return problem, x


def values(problem: Problem, x: Reals) -> Values:
    found = problem.values(x)
    assert found is not None
    return found


def stacked(v: Values) -> Reals:
    """Objective and conditions of a place in one row."""
    return np.concatenate([[v.objective], v.inequality])


def difference(problem: Problem, x: Reals, k: int, h: float) -> Reals:
    """Fourth-order central difference of everything by one unknown."""

    def at(steps: float) -> Reals:
        moved = x.copy()
        moved[k] += steps * h
        return stacked(values(problem, moved))

    return (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * h)


def worst_slope(problem: Problem, x: Reals, h: float = 2e-5) -> float:
    """Largest disagreement of a derivative with differences, over the largest derivative of its kind."""
    here = values(problem, x)
    exact = np.concatenate([here.gradient[None], here.inequality_slope])
    scale = 1.0 + np.abs(exact).max(axis=1)
    free = np.flatnonzero(problem.free)
    return max(float((np.abs(difference(problem, x, k, h) - exact[:, k]) / scale).max()) for k in free)


@pytest.mark.parametrize("name", CATALOGUE)
def test_measures_of_a_built_structure_are_its_own(name: str) -> None:
    s = structure(name)
    problem = Problem(s.embedding, s.wall_m, Wish())
    measures = problem.measures(problem.first)
    assert measures is not None
    size = s.profile.size
    unfolded = np.abs(s.cells.link)
    assert np.abs(measures.material.value - s.panel_areas).max() <= 1e-12 * s.profile.area
    for ours, theirs in (
        (measures.cells.offset, s.cells.offset),
        (measures.cells.rim, s.cells.rim),
        (measures.cells.crease, s.cells.crease),
        (measures.cells.elbow, s.cells.elbow),
        (measures.cells.face, s.cells.face),
        (measures.cells.link, unfolded),
        (measures.thickness, s.cells.rim + s.cells.offset),
        (measures.length, panel_lengths(s)),
    ):
        assert np.abs(ours.value - theirs).max() <= 1e-12 * size  # type: ignore[union-attr]
    for ours, theirs in (
        (measures.cells.angle, s.cells.angle),
        (measures.cells.dead_centre_margin, s.cells.dead_centre_margin),
    ):
        assert np.abs(ours.value - theirs).max() <= 1e-12 * max(1.0, 0.02 * size / np.min(s.cells.link))  # type: ignore[attr-defined]
    here = problem.values(problem.first)
    assert here is not None
    assert 1.0 / here.objective == pytest.approx(s.eta, rel=1e-12)


def panel_lengths(s: Structure) -> Reals:
    """(n_cells, 4) from closing vertex to opening vertex, or to the opening crease where the panel is curved."""
    e = s.embedding
    length = np.empty((s.layout.n_cells, 4))
    for i, (a, c, b, d) in enumerate(e.layout.cells):
        for k, (q, w, crease) in enumerate(((a, c, 0), (b, c, 0), (b, d, 1), (a, d, 1))):
            far = s.cells.crease[i, crease] if e.curved[i, k] else e.z[w]
            length[i, k] = abs(far - e.z[q])
    return length


@pytest.mark.parametrize("name", CATALOGUE)
def test_derivatives_are_those_of_differences(name: str) -> None:
    s = structure(name)
    problem, x = problem_at(s.embedding, s.wall_m)
    if "wing" in name:  # curvature jumps at the nose, where a vertex stands: differences across it lie
        moving = problem.free & (np.arange(len(x)) < problem.unknowns.n_places)
        x[moving] += 0.013
    assert worst_slope(problem, x) < 1e-8


@st.composite
def rings(draw: st.DrawFn) -> tuple[Embedding, float]:
    aspect = draw(st.floats(0.35, 1.0))
    exponent = draw(st.sampled_from([1.6, 2.0, 2.0, 3.0]))
    n = draw(st.integers(3, 8))
    profile = Superellipse(1.0, aspect, exponent)
    phase = draw(st.floats(0.0, 6.28))
    centre = (draw(st.floats(-0.2, 0.2)), draw(st.floats(-0.2, 0.2)) * aspect)
    try:
        place = ring_on(profile, n, phase=phase, centre=centre)
        build(place, wall_m := draw(st.floats(0.0, 0.03)))
    except InputError:
        assume(False)
    # The curvature of a superellipse is 0 or infinite on its axes: differences across them say nothing.
    if exponent != 2.0:
        assume(np.abs((place.s[1:] + 0.25 * np.pi) % (0.5 * np.pi) - 0.25 * np.pi).min() > 0.02)
    return place, wall_m


@settings(max_examples=6)
@given(rings())
def test_derivatives_on_drawn_rings(drawn: tuple[Embedding, float]) -> None:
    problem, x = problem_at(*drawn)
    assert worst_slope(problem, x, 5e-6) < 1e-6


@pytest.mark.parametrize("name", ["wing", "ellipse 7 off centre", "two inner vertices", "one cell", "peanut 8"])
def test_curvature_is_that_of_gradients(name: str) -> None:
    s = structure(name)
    problem, x = problem_at(s.embedding, s.wall_m)
    here = values(problem, x)
    weight = np.random.default_rng(5).random(len(here.inequality))
    exact = problem.curvature(x, weight, np.zeros(0))
    assert np.abs(exact - exact.T).max() <= 1e-9 * np.abs(exact).max()
    free = np.flatnonzero(problem.free)
    h = 1e-5
    for k in free:
        moved = []
        for sign in (1.0, -1.0):
            there = x.copy()
            there[k] += sign * h
            v = values(problem, there)
            moved.append(v.gradient - weight @ v.inequality_slope)
        bend = (moved[0] - moved[1]) / (2.0 * h)
        assert np.abs(bend - exact[k])[free].max() <= 1e-4 * np.abs(exact).max()


def test_a_crease_without_a_place_measures_nothing() -> None:
    """Closing vertices drawn together until the corner between them is hollow: None, not a number."""
    s = structure("peanut 8")
    problem = Problem(s.embedding, s.wall_m, Wish())
    x = problem.first.copy()
    inner = problem.unknowns.column[np.flatnonzero(problem.unknowns.inner)[0]]
    x[inner] += 3.0
    assert problem.values(x) is None
