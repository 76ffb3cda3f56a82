"""Local searches: as good as a slow one, blind to scale and mirror, bounds and pins kept in what is built."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.design import Embedding, build
from ori_deploy.errors import CellError
from ori_deploy.profiles import Profile, Superellipse
from ori_deploy.search import Solution, Wish, solve
from ori_deploy.search.shortfall import NoStructureError
from ori_deploy.search.starts import start_embedding
from tests.search.cases import CIRCLE, ELLIPSE, WING, at, mirrored_ring, ring_layout, scaled
from tests.search.slow import evolved, polished, unlaid
from tests.shapes import peanut, ring_on, two_inner_vertices, wing

TWO_DEG = float(np.radians(2.0))


def margin(found: Solution) -> float:
    return float(found.structure.cells.dead_centre_margin.min())


# --- how good -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("profile", "n", "wall_m"),
    [(ELLIPSE, 3, 0.0), (ELLIPSE, 4, 0.02), (WING, 4, 0.006)],
    ids=["ellipse 3", "ellipse 4", "wing"],
)
@pytest.mark.parametrize("step", [1e-3, 1e-5])
def test_no_simplex_search_gets_further(profile: Profile, n: int, wall_m: float, step: float) -> None:
    found = solve(profile, ring_layout(n), wall_m)
    place = found.structure.embedding
    still = np.zeros(len(unlaid(place)))
    if profile is WING:  # the trailing edge's vertex stays in its corner
        still[2 + int(np.argmin(np.abs(place.z[1:] - 1.0)))] = 1.0
    better = polished(place, wall_m, Wish(), 400, step, still)
    assert found.eta * (1.0 - 1e-12) <= better <= found.eta + 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("profile", "n", "wall_m"),
    [(ELLIPSE, 4, 0.02), (WING, 4, 0.006)],
    ids=["ellipse 4", "wing"],
)
def test_no_evolution_gets_further(profile: Profile, n: int, wall_m: float) -> None:
    """Thousands of structures built by chance: none beats the best of the default starts."""
    layout = ring_layout(n)
    best = max(solve(profile, layout, wall_m, start=k).eta for k in range(8))
    fixed = {2 + n: 0.0} if profile is WING else {}  # C1 in the trailing edge
    middle = np.array([0.45, 0.03] if profile is WING else [0.0, 0.0])
    other = evolved(profile, layout, wall_m, Wish(), middle, fixed, 40)
    assert other > 0.7 * best  # it has found something to compare with
    assert best >= other - 1e-6


def test_equal_angles_on_a_circle_are_a_fixed_point() -> None:
    for n in (4, 6, 8):
        begin = ring_on(CIRCLE, n)
        found = solve(CIRCLE, begin.layout, 0.0, start=begin)
        assert found.eta == pytest.approx(build(begin, 0.0).eta, abs=1e-8)
        turned = found.structure.embedding.z[1:] / begin.z[1:]
        assert np.abs(turned - turned[0]).max() < 1e-4
        assert found.settled


def test_it_is_a_hill_climb() -> None:
    """The result is never below a start that meets every condition."""
    for wall_m in (0.0, 0.01):
        begin = ring_on(ELLIPSE, 5, phase=0.3)
        assert solve(ELLIPSE, begin.layout, wall_m, start=begin).eta > build(begin, wall_m).eta


# --- what it is blind to --------------------------------------------------------------------------


@pytest.mark.parametrize("profile", [ELLIPSE, WING], ids=["ellipse", "wing"])
@pytest.mark.parametrize("factor", [1e-3, 37.0])
def test_scaling_the_profile_scales_the_solution(profile: Profile, factor: float) -> None:
    layout, wall = ring_layout(4), 0.004
    one = solve(profile, layout, wall)
    other = solve(scaled(profile, factor), layout, wall * factor)
    assert other.eta == pytest.approx(one.eta, abs=1e-8)
    assert np.abs(other.structure.embedding.z / factor - one.structure.embedding.z).max() < 1e-4 * profile.size
    assert {a for a in other.active if "wall" not in a} == {a for a in one.active if "wall" not in a}


@settings(max_examples=3)
@given(seed=st.integers(0, 1000), wall=st.sampled_from([0.0, 0.01]), n=st.integers(4, 6))
def test_a_mirrored_start_leads_to_a_mirrored_solution(seed: int, wall: float, n: int) -> None:
    begin = start_embedding(ELLIPSE, ring_layout(n), 2, seed)
    begin = Embedding(ELLIPSE, begin.layout, begin.s, np.where(np.isnan(begin.s), begin.z + 0.03 + 0.02j, begin.z))
    one = solve(ELLIPSE, begin.layout, wall, start=begin)
    other = solve(ELLIPSE, begin.layout, wall, start=mirrored_ring(begin))
    assert other.eta == pytest.approx(one.eta, abs=1e-6)


def test_turning_a_circle_changes_nothing() -> None:
    etas = [solve(CIRCLE, ring_layout(5), 0.01, start=ring_on(CIRCLE, 5, phase=p)).eta for p in (0.0, 0.4, 3.3)]
    assert np.ptp(etas) < 1e-8


def test_the_same_seed_gives_the_same_bits() -> None:
    one, other = (solve(ELLIPSE, ring_layout(5), 0.01, start=3, seed=11) for _ in range(2))
    assert np.array_equal(one.structure.embedding.z, other.structure.embedding.z)
    third = start_embedding(ELLIPSE, ring_layout(5), 3, 12)
    assert not np.array_equal(third.z, start_embedding(ELLIPSE, ring_layout(5), 3, 11).z)


# --- bounds ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("margin_deg", [0.5, 2.0, 3.0])
@pytest.mark.parametrize(("profile", "n", "wall_m"), [(WING, 4, 0.006), (ELLIPSE, 5, 0.03)])
def test_the_margin_holds_in_what_is_built(profile: Profile, n: int, wall_m: float, margin_deg: float) -> None:
    found = solve(profile, ring_layout(n), wall_m, Wish(margin_rad=float(np.radians(margin_deg))))
    assert np.degrees(margin(found)) >= margin_deg
    named = [a for a in found.active if a.startswith("margin of c")]
    assert bool(named) == (np.degrees(margin(found)) < margin_deg + 1e-4)
    assert profile is not WING or named


def test_more_margin_costs_material() -> None:
    etas = [solve(WING, ring_layout(4), 0.006, Wish(margin_rad=float(np.radians(m)))).eta for m in (0.5, 2.0, 3.0)]
    assert etas[0] > etas[1] > etas[2]


def test_panels_keep_their_least_length() -> None:
    free = solve(ELLIPSE, ring_layout(6), 0.01)
    shortest = min(_lengths(free))
    wish = Wish(panel_m=1.1 * shortest)
    found = solve(ELLIPSE, ring_layout(6), 0.01, wish)
    assert min(_lengths(found)) >= wish.panel_m
    assert found.eta < free.eta
    assert any(a.startswith("panel of c") for a in found.active)


def _lengths(found: Solution) -> list[float]:
    s, e = found.structure, found.structure.embedding
    lengths = []
    for i, (a, c, b, d) in enumerate(s.layout.cells):
        for k, (q, w, crease) in enumerate(((a, c, 0), (b, c, 0), (b, d, 1), (a, d, 1))):
            lengths.append(abs((s.cells.crease[i, crease] if e.curved[i, k] else e.z[w]) - e.z[q]))
    return [float(length) for length in lengths]


def test_the_wall_holds_and_is_named() -> None:
    found = solve(ELLIPSE, ring_layout(4), 0.02)
    assert found.structure.cells.offset.min() >= 0.02
    assert "wall 0.02 m" in found.active
    assert not solve(ELLIPSE, ring_layout(4), 0.0).active


# --- starts ---------------------------------------------------------------------------------------


def test_an_infeasible_start_is_repaired() -> None:
    """The example wing has 2.3 deg at wall 0.005; at 0.013 a cell is beyond its dead centre."""
    begin = wing().embedding
    with pytest.raises(CellError, match="dead centre"):
        build(begin, 0.013)
    found = solve(WING, begin.layout, 0.013, start=begin)
    assert margin(found) >= TWO_DEG
    assert found.start == -1


def test_any_layout_and_outline() -> None:
    for begin, wall_m in ((two_inner_vertices().embedding, 0.01), (ring_on(peanut(), 8, phase=0.0), 0.01)):
        found = solve(begin.profile, begin.layout, wall_m, start=begin)
        assert margin(found) >= TWO_DEG
        assert found.eta > build(begin, wall_m).eta


def test_an_inner_vertex_does_not_run_into_the_skin() -> None:
    """From this start eta grows until P stands on an opening vertex, and an inner edge has no length."""
    found = solve(ELLIPSE, ring_layout(3), 0.0, start=2)
    assert min(_lengths(found)) >= 1e-3 * ELLIPSE.size


def test_a_start_that_cannot_be_mended_says_which_condition_fails() -> None:
    with pytest.raises(CellError) as wrong:
        solve(ELLIPSE, ring_layout(6), 0.5)
    told = str(wrong.value)
    assert "start 0: no structure meets every condition" in told
    assert " of cell c" in told or "opening crease has no place" in told
    assert "wall 0.5 m" in told


@pytest.mark.parametrize(
    ("wish", "wall_m", "words", "remedy"),
    [
        (Wish(margin_rad=1.0), 0.01, "the dead-centre margin of c", "margin_rad"),
        (Wish(panel_m=0.9), 0.01, " mm too short", "panel_m"),
        (Wish(objective="wall", eta_at_least=50.0), 0.0, "eta reaches ", "eta_at_least"),
    ],
)
def test_a_failure_is_told_in_words_and_units(wish: Wish, wall_m: float, words: str, remedy: str) -> None:
    with pytest.raises(NoStructureError) as wrong:
        solve(ELLIPSE, ring_layout(6), wall_m, wish)
    assert words in str(wrong.value.value)
    assert remedy in str(wrong.value.remedy)
    assert 0.0 < wrong.value.short < np.inf


def test_an_eta_out_of_reach_names_the_one_without_any_wall() -> None:
    best = solve(ELLIPSE, ring_layout(4), 0.0).eta
    with pytest.raises(NoStructureError) as wrong:
        solve(ELLIPSE, ring_layout(4), 0.0, Wish(objective="wall", eta_at_least=50.0))
    assert str(wrong.value.value) == f"eta reaches {best:.4g}"


def test_failing_searches_make_no_noise() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for wall_m, start in ((0.5, 0), (0.3, 2), (0.3, 3), (0.3, 4)):
            with pytest.raises(CellError):
                solve(ELLIPSE, ring_layout(6), wall_m, start=start)


# --- pins: see test_wish.py -----------------------------------------------------------------------


def test_a_vertex_in_a_sharp_corner_stays_and_others_move() -> None:
    begin = wing().embedding
    found = solve(WING, begin.layout, 0.005, start=begin).structure.embedding
    assert at(found, "CE") == at(begin, "CE")
    for name in ("C2", "CN", "O1"):  # C2 begins where the two pieces of the camber line meet: no corner for a panel
        assert abs(at(found, name) - at(begin, name)) > 1e-3


def test_a_superellipse_that_is_nearly_a_diamond_or_a_rectangle() -> None:
    for exponent in (1.3, 6.0):
        profile = Superellipse(1.0, 0.7, exponent)
        found = max((solve(profile, ring_layout(4), 0.01, start=k) for k in (0, 1)), key=lambda s: s.eta)
        assert found.eta > 1.5
        assert margin(found) >= TWO_DEG


@pytest.mark.parametrize("first_wall", [0.0, 0.004])
def test_the_thickest_wall_is_that_at_which_the_best_eta_is_what_was_asked(first_wall: float) -> None:
    wish = Wish(objective="wall", eta_at_least=3.0)
    thickest = solve(ELLIPSE, ring_layout(6), first_wall, wish).cylinder
    assert thickest.eta == pytest.approx(3.0, abs=1e-5)
    best = solve(ELLIPSE, ring_layout(6), thickest.wall_m)
    assert best.eta == pytest.approx(3.0, abs=1e-5)
    assert solve(ELLIPSE, ring_layout(6), 1.02 * thickest.wall_m).eta < 3.0
