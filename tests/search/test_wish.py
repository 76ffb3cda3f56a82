"""Pins hold exactly in what is built; those that cannot hold are named; slopes of pins are exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.design import Embedding
from ori_deploy.errors import LayoutError
from ori_deploy.search import Fixed, OnLine, Pin, Solution, Spar, Symmetric, Wish, solve
from ori_deploy.search.measures import Unknowns
from ori_deploy.search.nearest import nearest_parameter
from ori_deploy.search.solve import on_pins
from ori_deploy.search.starts import start_for
from tests.search.cases import ELLIPSE, WING, at, ring_layout
from tests.shapes import peanut, ring_on, two_cells, two_inner_vertices, wing

EXACT = 1e-9
PEANUT = peanut()


def pinned(begin: Embedding, wall_m: float, *pins: Pin, margin_deg: float = 2.0) -> Solution:
    wish = Wish(margin_rad=float(np.radians(margin_deg)), pins=pins)
    return solve(begin.profile, begin.layout, wall_m, wish, start=begin)


# --- each kind ------------------------------------------------------------------------------------


def test_a_fixed_vertex_stays() -> None:
    begin = ring_on(ELLIPSE, 5, phase=0.3)
    found = pinned(begin, 0.01, Fixed("P"), Fixed("O2")).structure.embedding
    for name in ("P", "O2"):
        assert abs(at(found, name) - at(begin, name)) < EXACT
    assert abs(at(found, "C1") - at(begin, "C1")) > 1e-3


def test_a_fixed_vertex_goes_where_it_is_sent() -> None:
    begin = ring_on(ELLIPSE, 5, phase=0.3)
    there = 0.13 - 0.07j
    assert abs(at(pinned(begin, 0.01, Fixed("P", there)).structure.embedding, "P") - there) < EXACT
    on_outline = complex(ELLIPSE.point(ELLIPSE.at_natural(0.5)))
    assert abs(at(pinned(begin, 0.01, Fixed("O1", on_outline)).structure.embedding, "O1") - on_outline) < EXACT


def test_vertices_keep_to_a_line() -> None:
    begin = ring_on(ELLIPSE, 6, phase=0.3)
    direction = 2.0 + 1.0j
    found = pinned(begin, 0.01, OnLine(("P", "O1"), 0.05 + 0.0j, direction)).structure.embedding
    for name in ("P", "O1"):
        off = np.conj(1j * direction / abs(direction)) * (at(found, name) - 0.05)
        assert abs(off.real) < EXACT


@pytest.mark.parametrize("x_m", [None, 0.1])
def test_a_spar_of_one_inner_edge_stands_upright(x_m: float | None) -> None:
    found = pinned(two_cells().embedding, 0.01, Spar(("O2", "CM"), x_m), margin_deg=0.5).structure.embedding
    assert abs(at(found, "O2").real - at(found, "CM").real) < EXACT
    assert x_m is None or abs(at(found, "O2").real - x_m) < EXACT


def test_a_spar_through_an_inner_vertex_stands_upright() -> None:
    begin = ring_on(ELLIPSE, 6, phase=0.5 * np.pi)
    found = pinned(begin, 0.01, Spar(("O1", "P", "O4"))).structure.embedding
    xs = [at(found, name).real for name in ("O1", "P", "O4")]
    assert np.ptp(xs) < EXACT


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_symmetric_structure_is_its_own_mirror_image(axis: str) -> None:
    begin = ring_on(ELLIPSE, 6, phase=0.0)
    nudged = Embedding(ELLIPSE, begin.layout, begin.s + np.where(np.arange(13) == 2, 0.02, 0.0), begin.z)
    pin = Symmetric.of(begin, axis)  # type: ignore[arg-type]
    found = pinned(nudged, 0.01, pin).structure.embedding
    for one, other in pin.pairs:
        assert abs(at(found, other) - pin.mirrored(at(found, one))) < EXACT


def test_symmetry_pairs_every_vertex_with_its_image() -> None:
    begin = ring_on(ELLIPSE, 6, phase=0.0)
    pairs = {frozenset(p) for p in Symmetric.of(begin, "x").pairs}
    assert pairs == {frozenset(p) for p in (("P",), ("O1",), ("O4",), ("O2", "O6"), ("O3", "O5"), ("C1", "C6"),
                                            ("C2", "C5"), ("C3", "C4"))}  # fmt: skip


def test_pins_cost_material() -> None:
    begin = ring_on(ELLIPSE, 5, phase=0.3)
    assert pinned(begin, 0.01, Fixed("P", 0.1 + 0.1j)).eta < pinned(begin, 0.01).eta - 1e-3


# --- what they say of themselves ------------------------------------------------------------------


def test_slopes_of_pins_are_those_of_differences() -> None:
    begin = ring_on(ELLIPSE, 6, phase=0.2, centre=(0.1, 0.05))
    pins = (
        Fixed("P", 0.1j), Fixed("O1", 0.2 + 0.1j), OnLine(("P", "C2"), 0.1j, 1.0 + 0.4j),
        Spar(("O2", "P", "O5"), 0.1), Symmetric.of(ring_on(ELLIPSE, 6, phase=0.0), "x"),
        replace(Symmetric.of(ring_on(ELLIPSE, 6, phase=0.0), "y"), at_m=0.01),
    )  # fmt: skip
    wish, unknowns = Wish(pins=pins), Unknowns(ELLIPSE, begin.layout)
    x = unknowns.pack(begin.s, begin.z, 0.0)
    exact = np.array([e.slope for e in wish.equations(unknowns, x, begin.z)])
    h = 1e-6
    for k in range(unknowns.n_places):
        step = h * np.eye(len(x))[k]
        up, down = (np.array([e.value for e in wish.equations(unknowns, y, begin.z)]) for y in (x + step, x - step))
        # The normals of pins on the outline turn with it: where the pin holds that is nothing, and here a little.
        bending = np.array(
            [e.name.startswith(("fixed O1", "symmetric")) for e in wish.equations(unknowns, x, begin.z)]
        )
        assert np.abs((up - down) / (2.0 * h) - exact[:, k])[~bending].max() < 1e-8


def test_slopes_of_pins_that_hold_are_exact_too() -> None:
    begin = ring_on(ELLIPSE, 6, phase=0.0)
    wish = Wish(pins=(Fixed("O2"), Symmetric.of(begin, "x"), Symmetric.of(begin, "y")))
    unknowns = Unknowns(ELLIPSE, begin.layout)
    x = unknowns.pack(begin.s, begin.z, 0.0)
    exact = wish.equations(unknowns, x, begin.z)
    assert max(abs(e.value) for e in exact) < 1e-12
    h = 1e-6
    for k in range(unknowns.n_places):
        step = h * np.eye(len(x))[k]
        up, down = (np.array([e.value for e in wish.equations(unknowns, y, begin.z)]) for y in (x + step, x - step))
        assert np.abs((up - down) / (2.0 * h) - np.array([e.slope[k] for e in exact])).max() < 1e-8


# --- refused --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pins", "named"),
    [
        ((Fixed("P", 0.1 + 0.0j), Fixed("P", -0.1 + 0.0j)), ("fixed P",)),
        ((Fixed("P", 0.1 + 0.0j), OnLine(("P",), -0.2 + 0.0j, 1j)), ("fixed P", "line P")),
        ((Spar(("O1", "P", "O4"), 0.2), Fixed("P", 0.0j)), ("spar O1-P-O4", "fixed P")),
        ((OnLine(("P",), 0.1j, 1.0), OnLine(("P",), -0.1j, 1.0)), ("line P",)),
    ],
)  # fmt: skip
def test_pins_that_contradict_each_other_are_named(pins: tuple[Pin, ...], named: tuple[str, ...]) -> None:
    with pytest.raises(LayoutError) as wrong:
        pinned(ring_on(ELLIPSE, 6, phase=0.5 * np.pi), 0.01, *pins)
    told = str(wrong.value)
    assert "cannot hold" in told
    assert wrong.value.remedy is not None
    for name in named:
        assert name in told


@pytest.mark.parametrize(
    ("pin", "told"),
    [
        (Fixed("O9"), "O9"),
        (OnLine(("P", "Q"), 0j, 1j), "Q"),
        (Spar(("O1", "P", "O2", "X")), "X"),
        (Spar(("O1", "C3")), "C3-O1 is no inner edge"),
        (Spar(("O1", "P")), "an end lies inside"),
        (Symmetric("x", (("O1", "Z"),)), "Z"),
    ],
)
def test_pins_on_what_is_not_there(pin: Pin, told: str) -> None:
    with pytest.raises(LayoutError) as wrong:
        pinned(ring_on(ELLIPSE, 6), 0.01, pin)
    assert told in str(wrong.value)
    assert pin.name in str(wrong.value)


def test_a_place_off_the_outline_names_the_nearest_on_it() -> None:
    begin, on = ring_on(ELLIPSE, 6, phase=0.5), complex(ELLIPSE.point(0.7))
    outwards = -1j * complex(ELLIPSE.tangents(0.7)[0])
    with pytest.raises(LayoutError, match="fixed O1: not on the outline") as wrong:
        pinned(begin, 0.01, Fixed("O1", on + 0.01 * outwards))
    told = str(wrong.value)
    assert "0.01 m away" in told
    assert f"at_m = [{on.real:.6g}" in told
    Wish(pins=(Fixed("O1", on + 1e-7 * outwards),)).check(begin.layout, ELLIPSE)


def test_a_vertex_is_sent_to_the_near_side_of_the_outline() -> None:
    """Along the tangent a vertex at the far end of the ellipse would be just as near."""
    begin = ring_on(ELLIPSE, 6, phase=0.6)
    goal = complex(ELLIPSE.point(0.0))
    far = Embedding(ELLIPSE, begin.layout, begin.s + np.pi - 0.6, begin.z)
    place = on_pins(far, Wish(pins=(Fixed("O1", goal),)))
    assert abs(at(place, "O1") - goal) < EXACT


def test_a_spar_with_one_cell_on_a_side_is_refused() -> None:
    with pytest.raises(LayoutError, match="spar O1-P-O2: cannot be straight") as wrong:
        pinned(ring_on(ELLIPSE, 6), 0.01, Spar(("O1", "P", "O2")))
    assert "1 cell on one side of it at P" in str(wrong.value)
    assert "O1-P-O3" in str(wrong.value)


@given(k=st.integers(0, 10**6), which=st.sampled_from(["ellipse", "wing", "peanut"]))
@settings(max_examples=60)
def test_the_nearest_parameter_is_that_of_a_fine_grid(k: int, which: str) -> None:
    profile = {"ellipse": ELLIPSE, "wing": WING, "peanut": PEANUT}[which]
    s = profile.period * k / 1e6
    on = complex(profile.point(s))
    assert abs(complex(profile.point(nearest_parameter(profile, on))) - on) < 1e-12 * profile.size
    off = on * 1.3 + 0.05
    fine = np.abs(profile.point(np.linspace(0.0, profile.period, 20001)) - off).min()
    assert abs(complex(profile.point(nearest_parameter(profile, off))) - off) <= fine + 1e-12


@pytest.mark.parametrize("start", range(5))
@pytest.mark.parametrize("begin_turned", [0, 1, 2])
def test_numbered_starts_are_turned_to_their_pins(start: int, begin_turned: int) -> None:
    """Whatever opening vertex a spar is named from: its pins can hold, upright."""
    names = tuple(f"O{(begin_turned + k) % 6 + 1}" for k in (0, 3))
    wish = Wish(pins=(Spar((names[0], "P", names[1])),))
    place = on_pins(start_for(ELLIPSE, ring_layout(6), wish, start, 3), wish)
    heights = [at(place, name).imag for name in names]
    assert abs(at(place, names[0]).real - at(place, names[1]).real) < EXACT
    assert min(abs(h) for h in heights) > 0.2
    assert heights[0] * heights[1] < 0.0


@pytest.mark.parametrize(
    "wish",
    [
        Wish(margin_rad=-0.1),
        Wish(margin_rad=1.6),
        Wish(margin_rad=float("nan")),
        Wish(panel_m=-1.0),
        Wish(panel_m=2.5),
        Wish(objective="wall", eta_at_least=0.0),
    ],
)
def test_bounds_nothing_can_keep(wish: Wish) -> None:
    with pytest.raises(LayoutError) as wrong:
        solve(ELLIPSE, ring_layout(4), 0.0, wish)
    assert wrong.value.limit is not None


@pytest.mark.parametrize("axis", ["x", "y"])
def test_what_is_not_symmetric_is_refused(axis: str) -> None:
    with pytest.raises(LayoutError, match="not its own mirror image") as wrong:
        Symmetric.of(wing().embedding, axis)  # type: ignore[arg-type]
    assert wrong.value.value is not None


def test_a_cambered_profile_is_not_its_own_mirror_image() -> None:
    begin = ring_on(WING, 4, phase=0.0, centre=(0.44, 0.03))
    with pytest.raises(LayoutError, match="not its own mirror image") as wrong:
        Symmetric.of(begin, "x")
    assert "the profile, 0.04 m off" in str(wrong.value)


def test_where_pins_already_hold_nothing_moves() -> None:
    begin = two_inner_vertices().embedding
    place = on_pins(begin, Wish(pins=(Fixed("P"), Fixed("Q"))))
    assert np.abs(place.z - begin.z).max() < 1e-15
    assert on_pins(begin, Wish()) is begin


def test_a_vertex_in_the_trailing_edge_cannot_be_sent_elsewhere() -> None:
    begin = wing().embedding
    with pytest.raises(LayoutError, match="fixed CE"):
        pinned(begin, 0.005, Fixed("CE", complex(WING.point(0.1))))
