"""Strips: pieces make up the band, unrolling keeps lengths and areas, joints are what the layout says."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.design.band import HelixBand, SpiralBand
from ori_deploy.design.strip import Strip, helix, joints_of, spiral
from ori_deploy.errors import StripError
from tests import cones
from tests.shapes import CATALOGUE, structure

CYLINDERS = tuple(CATALOGUE)
SPAN = 3.0


def shoelace(points: NDArray[np.complex128]) -> float:
    return float(0.5 * (np.conj(points) * np.roll(points, -1)).imag.sum())


def cone() -> ConeStructure:
    return cones.cone("elliptic 6")


@st.composite
def helices(draw: st.DrawFn, name: str) -> tuple[Structure, Strip]:
    s = structure(name)
    turn = s.profile.perimeter
    turns = draw(st.floats(0.05, 3.5))
    width = draw(st.floats(0.002, 0.05)) * turn
    pitch = draw(st.sampled_from([-1.0, 1.0])) * draw(st.floats(0.08, 0.5)) * turn
    span = abs(pitch) * turns + 2.0 * width
    return s, helix(s, span, pitch_m=pitch, width_m=width, turns=turns, start_arc=draw(st.floats(0.0, 0.999)))


spirals = st.builds(
    lambda growth, width, turns, start, inwards: spiral(
        cone(),
        0.2,
        0.2 * growth ** (turns + 2.0),
        growth=1.0 / growth if inwards else growth,
        width_turns=width,
        turns=turns,
        start_arc=start,
    ),
    st.floats(1.05, 1.8),
    st.floats(0.05, 0.9),
    st.floats(0.1, 3.3),
    st.floats(0.0, 0.999),
    st.booleans(),
)


def strips(data: st.DataObject) -> Iterator[tuple[Structure | ConeStructure, Strip]]:
    yield data.draw(helices(data.draw(st.sampled_from(CYLINDERS))))
    yield cone(), data.draw(spirals)


@settings(max_examples=40)
@given(data=st.data())
def test_pieces_follow_each_other_without_gap_and_make_up_the_band(data: st.DataObject) -> None:
    for _, strip in strips(data):
        band, pieces = strip.band, strip.pieces
        ends = np.array([[p.start, p.stop] for p in pieces])
        tiny = 1e-5 * band.turn_arc
        assert ends[0, 0] == pytest.approx(band.first, abs=tiny)
        assert ends[-1, 1] == pytest.approx(band.last, abs=tiny)
        assert np.allclose(ends[1:, 0], ends[:-1, 1], atol=tiny, rtol=0.0)
        assert sum(p.area_m2 for p in pieces) == pytest.approx(strip.area_m2, rel=1e-4)


@settings(max_examples=40)
@given(data=st.data())
def test_a_piece_lies_on_its_panels_outline(data: st.DataObject) -> None:
    for s, strip in strips(data):
        turn = strip.band.turn_arc
        for piece in strip.pieces[:: max(1, len(strip.pieces) // 8)]:
            low, high = s.profile.arc_length(s.outline_pieces[piece.panel])
            own = strip.polygon(piece, 1e-4)[:, 0]
            shift = np.round((0.5 * (low + high) - 0.5 * (own.min() + own.max())) / turn) * turn
            assert own.min() + shift >= low - 1e-5 * turn
            assert own.max() + shift <= high + 1e-5 * turn


@settings(max_examples=30)
@given(data=st.data())
def test_unrolled_pieces_have_their_areas_and_the_band_its_own(data: st.DataObject) -> None:
    """Area by corners of the flat sheet, which knows nothing of the closed forms."""
    for _, strip in strips(data):
        # Clockwise or not: a left-running cone's sheet is a mirror image.
        areas = [abs(shoelace(strip.development(1e-6, p.start, p.stop))) for p in strip.pieces]
        assert areas == pytest.approx([p.area_m2 for p in strip.pieces], rel=2e-3, abs=1e-9)
        assert sum(areas) == pytest.approx(strip.area_m2, rel=1e-3)


@settings(max_examples=30)
@given(data=st.data())
def test_a_helix_is_a_straight_parallelogram_of_the_right_size(data: st.DataObject) -> None:
    s, strip = data.draw(helices(data.draw(st.sampled_from(CYLINDERS))))
    band = strip.band
    assert isinstance(band, HelixBand)
    assert band.length_m == pytest.approx(band.turns * np.hypot(s.profile.perimeter, band.pitch_m), rel=1e-12)
    corners = strip.development(1e-6)
    assert len(corners) == 4
    sides = np.diff(np.append(corners, corners[0]))
    assert sides[0] == pytest.approx(-sides[2], abs=1e-12)
    assert sides[0] == pytest.approx(band.length_m, rel=1e-12)  # along the real axis
    assert np.ptp(corners.imag) == pytest.approx(band.width_m, rel=1e-9)
    assert strip.area_m2 == pytest.approx(band.length_m * band.width_m, rel=1e-12)


def test_a_helix_has_its_length_in_space() -> None:
    s = structure("ellipse 4")
    strip = helix(s, 0.5, pitch_m=0.09, width_m=0.01, turns=2.3, start_arc=0.2)
    band, p = strip.band, s.profile
    arc = np.linspace(band.first, band.last, 40_001)
    s_of = np.linspace(0.0, p.period, 20_001)
    z = p.point(np.interp(arc % p.perimeter, p.arc_length(s_of), s_of))
    height = 0.5 * sum(band.edges(arc))
    walked = np.hypot(np.abs(np.diff(z)), np.diff(height)).sum()
    assert walked == pytest.approx(band.length_m, rel=1e-5)
    assert height[-1] - height[0] == pytest.approx(0.09 * 2.3)


@settings(max_examples=20)
@given(strip=spirals)
def test_a_spiral_crosses_every_ruling_under_one_angle_and_grows_alike_every_turn(strip: Strip) -> None:
    band = strip.band
    assert isinstance(band, SpiralBand)
    arc = np.linspace(band.first, band.last, 200)
    step = 1e-6 * band.turn_arc
    for k in (0, 1):
        edge = band.unrolled(arc, band.edges(arc)[k])
        along = band.unrolled(arc + step, band.edges(arc + step)[k]) - edge
        between = np.abs(np.angle(along / edge))
        assert np.minimum(between, np.pi - between) == pytest.approx(band.ruling_angle_rad, abs=1e-5)
        assert band.edges(arc + band.turn_arc)[k] == pytest.approx(band.growth * band.edges(arc)[k], rel=1e-12)
        # One edge is the other, turned about the axis.
    turned = arc + np.sign(band.rate) * band.width_turns * band.turn_arc
    assert band.edges(turned)[0] == pytest.approx(band.edges(arc)[1], rel=1e-12)
    fine = band.unrolled(a := np.linspace(band.first, band.last, 20_001), band.middle(a))
    assert np.abs(np.diff(fine)).sum() == pytest.approx(band.length_m, rel=1e-6)


def test_the_flat_sheet_keeps_distances_on_the_cone() -> None:
    """Neighbouring places of the band are as far apart on the sheet as in space."""
    s = cone()
    strip = spiral(s, 0.2, 1.0, growth=1.4, width_turns=0.3, turns=2.0, start_arc=0.3)
    band, g = strip.band, s.profile
    s_of = np.linspace(0.0, g.period, 40_001)
    arc = np.linspace(band.first, band.last, 3_001)
    direction = g.point(np.interp(arc % g.perimeter, g.arc_length(s_of), s_of))
    for height in band.edges(arc):
        space = np.linalg.norm(np.diff(direction * height[:, None], axis=0), axis=1)
        flat = np.abs(np.diff(band.unrolled(arc, height)))
        assert space == pytest.approx(flat, rel=1e-4)


@pytest.mark.parametrize("name", CYLINDERS)
def test_joints_are_creases_bonds_slits_and_closing_vertices(name: str) -> None:
    s = structure(name)
    layout, joints = s.layout, joints_of(s)
    assert (np.diff([joint.arc for joint in joints]) > 0.0).all()
    slits = {layout.vertices[w].id for _, w in layout.slits}
    role = {v.id: v for v in layout.vertices}
    creases = [joint.at for joint in joints if "." in joint.at]
    # Between two straight panels the crease lies at the vertex and no panel has a piece of outline there.
    assert len(creases) == len(set(creases)) <= 2 * layout.n_cells
    for joint in joints:
        if joint.at in role:
            vertex = [v.id for v in layout.vertices].index(joint.at)
            if role[joint.at].role == "opening":
                # Two cells there are bonded unless the slit is between them; of more, the outer ones are apart.
                one_body = joint.at not in slits and (layout.corners == vertex).sum() == 2
                assert joint.kind == ("rigid" if one_body else "part")
            else:
                cell, k = divmod(joint.before, 4)
                hinge = s.cells.crease[cell, 3 if k == 1 else 2]
                in_one_cell = joint.after // 4 == cell
                assert joint.kind == ("fold" if in_one_cell and abs(hinge - s.embedding.z[vertex]) < 1e-7 else "part")
                assert (joint.fold_rad < 0.0) == (joint.kind == "fold")
            assert abs(s.profile.point(joint.s) - s.embedding.z[vertex]) < 1e-5 * s.profile.size
        else:
            assert joint.kind == "fold"
            assert 0.0 < joint.fold_rad < np.pi


def test_without_wall_equal_sides_hinge_on_the_outline_and_the_band_folds_outwards_there() -> None:
    joints = {joint.at: joint for joint in joints_of(structure("circle 6 without wall"))}
    assert {joints[f"C{i}"].kind for i in range(1, 7)} == {"fold"}
    assert all(joints[f"C{i}"].fold_rad < 0.0 for i in range(1, 7))


@pytest.mark.parametrize(
    ("measures", "why"),
    [
        ({"pitch_m": 0.0}, "pitch_m"),
        ({"pitch_m": float("nan")}, "pitch_m"),
        ({"width_m": 0.0}, "width_m"),
        ({"turns": -1.0}, "turns"),
        ({"turns": float("inf")}, "turns"),
        ({"turns": 40.0}, "leaves the surface"),
        ({"start_m": 0.0}, "leaves the surface"),
        ({"width_m": 0.2, "start_m": 1.5}, "overlaps its own next turn"),
    ],
)
def test_a_helix_that_does_not_fit_is_refused(measures: dict[str, float], why: str) -> None:
    usual = {"pitch_m": 0.1, "width_m": 0.02, "turns": 2.0}
    with pytest.raises(StripError, match=why):
        helix(structure("ellipse 4"), SPAN, **{**usual, **measures})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("measures", "why"),
    [
        ({"growth": 1.0}, "growth"),
        ({"growth": -2.0}, "growth"),
        ({"width_turns": 0.0}, "width_turns"),
        ({"turns": 9.0}, "leaves the surface"),
        ({"start_m": 0.95}, "leaves the surface"),
        ({"width_turns": 1.1}, "overlaps its own next turn"),
    ],
)
def test_a_spiral_that_does_not_fit_is_refused(measures: dict[str, float], why: str) -> None:
    usual = {"growth": 1.4, "width_turns": 0.3, "turns": 2.0}
    with pytest.raises(StripError, match=why):
        spiral(cone(), 0.2, 1.0, **{**usual, **measures})  # type: ignore[arg-type]


def test_a_spiral_cannot_begin_at_the_apex() -> None:
    with pytest.raises(StripError, match="apex"):
        spiral(cone(), 0.0, 1.0, growth=1.4, width_turns=0.3, turns=1.0)


def test_less_than_a_turn_may_be_wider_than_the_rise() -> None:
    strip = helix(structure("ellipse 4"), SPAN, pitch_m=0.01, width_m=0.3, turns=0.9)
    assert sum(p.area_m2 for p in strip.pieces) == pytest.approx(strip.area_m2, rel=1e-4)


def test_a_band_too_short_for_any_panel_is_refused() -> None:
    with pytest.raises(StripError, match="shorter than any panel"):
        helix(structure("ellipse 4"), 0.5, pitch_m=0.1, width_m=0.05, turns=1e-9)


@given(st.floats(1e-15, 1e-3), st.floats(0.1, 3.0))
def test_a_spiral_that_hardly_grows_is_an_arc(growth: float, turns: float) -> None:
    band = SpiralBand(3.0, 1.0 + growth, 0.25, turns, 1.0)
    grown = band.growth - 1.0  # what of it the number 1 + growth can hold
    assert band.length_m == pytest.approx(3.0 * turns, rel=2.0 * turns * grown + 1e-12)
