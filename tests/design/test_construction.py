"""The construction, checked by what must hold for every structure, and against the slow oracle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from ori_deploy.design import Structure, build
from ori_deploy.errors import CellError, InputError, LayoutError
from ori_deploy.profiles import PointOutline, Superellipse, xy
from tests.oracle.bridge import retold
from tests.shapes import CATALOGUE, peanut, ring_on, structure, wing

everything = pytest.mark.parametrize("name", CATALOGUE)

QUICK = {"wing", "circle 3", "ellipse 7 off centre", "one cell", "two inner vertices"}
by_the_oracle = pytest.mark.parametrize(
    "name",
    [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in CATALOGUE],  # which builds each anew
)


def polygons(s: Structure, sagitta: float = 1e-6) -> np.ndarray:
    outlines = s.panel_outlines(sagitta * s.profile.size)
    return np.array([shapely.Polygon(xy(o)) if len(o) > 2 else shapely.Polygon() for o in outlines])


def attempt(make: Callable[[], Structure]) -> tuple[InputError | None, Structure | None]:
    """What came out: the refusal, or the structure."""
    try:
        return None, make()
    except (CellError, LayoutError) as refused:
        return refused, None


# --- figures ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [3, 4, 6, 8, 12, 24])
def test_circle_ring_has_its_closed_form_eta(n: int) -> None:
    # Half a cell: the crease at angle b from the straight panel has height sin b over it, and the arc from
    # there to the closing point, half a cell away, rises 1 - cos of half its angle over its chord.
    half = np.pi / n
    b = brentq(lambda x: np.sin(x) - (1.0 - np.cos(0.5 * (half - x))), 0.0, half, xtol=1e-16)
    height = np.sin(b)
    corner = np.array([[height / np.tan(half), height], [np.cos(b), height], [np.cos(half), np.sin(half)]])
    x, y = corner.T
    void = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    expected = 0.5 * half / (0.5 * half - void)
    built = build(ring_on(Superellipse(1.0, 1.0), n), 0.0)
    assert built.eta == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize(("wall", "eta"), [(0.005, 2.1311), (0.003, 2.6235)])
def test_example_wing_has_the_published_eta(wall: float, eta: float) -> None:
    assert round(wing(wall).eta, 4) == eta


def test_example_wing_has_the_published_dead_centre_margin() -> None:
    assert np.degrees(wing().cells.dead_centre_margin.min()) == pytest.approx(2.3, abs=0.05)


# --- what holds for every structure ---------------------------------------------------------------------


@everything
def test_cells_tile_the_profile(name: str) -> None:
    s = structure(name)
    assert s.cell_areas.sum() == pytest.approx(s.profile.area, rel=1e-12)
    assert (s.cell_areas > 0.0).all()
    assert (s.panel_areas >= 0.0).all()


@everything
def test_panels_and_void_tile_each_cell(name: str) -> None:
    s = structure(name)
    e = s.embedding
    for i in range(s.layout.n_cells):
        # The cell's own boundary: straight inner edges and outline arcs, independent of any panel.
        boundary = 0.0
        for k in range(4):
            t, h = s.layout.corners[i, k], s.layout.corners[i, (k + 1) % 4]
            if e.curved[i, k]:
                stop = e.s[t] + (e.s[h] - e.s[t]) % e.profile.period
                boundary += float(e.profile.swept_area(stop) - e.profile.swept_area(e.s[t]))
            else:
                boundary += 0.5 * float((np.conj(e.z[t]) * e.z[h]).imag)
        void = shapely.Polygon(xy(s.cells.void[i])).area
        assert s.panel_areas[4 * i : 4 * i + 4].sum() + void == pytest.approx(boundary, rel=1e-9)


@everything
def test_panels_are_simple_counter_clockwise_and_do_not_overlap(name: str) -> None:
    s = structure(name)
    shapes = polygons(s)
    solid = np.flatnonzero(~shapely.is_empty(shapes))
    assert shapely.is_valid(shapes).all()
    assert all(shapely.is_ccw(shapes[i].exterior) for i in solid)
    assert np.allclose(
        shapely.area(shapes), s.panel_areas, rtol=0.0, atol=1e-6 * s.profile.size * s.profile.perimeter
    )
    i, j = np.triu_indices(len(shapes), 1)
    grid = 1e-11 * s.profile.size
    overlap = shapely.area(shapely.intersection(shapes[i], shapes[j], grid_size=grid))
    assert overlap.max() < 1e-8 * s.profile.area
    target = shapely.Polygon(xy(s.profile.sample(0.0, s.profile.period, 1e-6 * s.profile.size)))
    outside = shapely.area(shapely.difference(shapes, target, grid_size=grid))
    assert outside.max() < 1e-6 * s.profile.area


@everything
def test_void_is_a_convex_quadrilateral_whose_corners_are_the_deployed_angles(name: str) -> None:
    cells = structure(name).cells
    void = cells.void
    ahead, behind = np.roll(void, -1, axis=1) - void, np.roll(void, 1, axis=1) - void
    inner = np.angle(behind / ahead)
    assert np.allclose(inner, cells.angle[:, [2, 0, 3, 1]], atol=1e-9)
    assert np.allclose(cells.angle.sum(axis=1), 2.0 * np.pi, atol=1e-12)
    assert ((cells.angle > 0.0) & (cells.angle < np.pi)).all()


@everything
def test_wall_is_at_least_as_thick_as_asked(name: str) -> None:
    s = structure(name)
    inside = (s.cells.offset - s.wall_m - s.opening.dip.reshape(-1, 2)).ravel()
    assert inside.min() >= -1e-15
    # Only one offset of a cell is ever raised above its minimum.
    raised = (s.cells.offset - s.wall_m - s.opening.dip.reshape(-1, 2)) > 1e-12 * s.profile.size
    assert (raised.sum(axis=1) <= 1).all()


@by_the_oracle
def test_construction_agrees_with_the_oracle(name: str) -> None:
    s = structure(name)
    told, _ = retold(s)
    size = s.profile.size
    for i, other in enumerate(told.cells):
        theirs = np.array([other.crease_c.xy, other.crease_d.xy, other.v1, other.v3])
        assert np.abs(xy(s.cells.crease[i]) - theirs).max() < 2e-7 * size, s.layout.cell_ids[i]
        assert np.allclose(s.cells.offset[i], other.t, atol=1e-7 * size)
        assert np.allclose(s.cells.rim[i], [other.crease_c.h, other.crease_d.h], atol=1e-7 * size)
        assert np.allclose(s.cells.dead_centre_margin[i], other.margins, atol=2e-5)


@everything
def test_result_does_not_depend_on_the_tables_resolution(name: str) -> None:
    s = structure(name)
    e = s.embedding
    described = {k: v for k, v in e.profile.describe().items() if k != "kind"}
    finer = type(e.profile)(**described, resolution=1024)  # type: ignore[arg-type]
    again = build(type(e)(finer, e.layout, e.s, e.z), s.wall_m)
    assert again.eta == pytest.approx(s.eta, rel=1e-9)
    assert np.allclose(again.cells.crease, s.cells.crease, atol=1e-9 * s.profile.size)


@everything
@pytest.mark.parametrize("factor", [1e-3, 40.0])
def test_scaling_changes_lengths_and_nothing_else(name: str, factor: float) -> None:
    s = structure(name)
    described = s.profile.describe()
    for key in ("a_m", "b_m", "chord_m"):
        if key in described:
            described[key] = float(described[key]) * factor  # type: ignore[arg-type]
    kind = described.pop("kind")
    scaled = type(s.profile)(**described)  # type: ignore[arg-type]
    stretch = factor if kind == "points" else 1.0
    again = build(
        type(s.embedding)(scaled, s.layout, s.embedding.s * stretch, s.embedding.z * factor), s.wall_m * factor
    )
    assert again.eta == pytest.approx(s.eta, rel=1e-9)
    assert np.allclose(again.cells.angle, s.cells.angle, atol=1e-9)


@pytest.mark.parametrize("n", [4, 5, 6])
def test_mirrored_ring_is_the_mirror_image(n: int) -> None:
    p = Superellipse(1.0, 0.6)
    one, two = (
        build(ring_on(p, n, phase=0.3, centre=(0.1, 0.05)), 0.01),
        build(ring_on(p, n, phase=-0.3, centre=(0.1, -0.05)), 0.01),
    )
    assert one.eta == pytest.approx(two.eta, rel=1e-12)
    theirs = np.conj(two.cells.crease[:, [1, 0, 2, 3]])
    for crease in one.cells.crease:
        assert np.abs(theirs - crease).max(axis=1).min() < 1e-12


def test_hollow_outline_gets_its_dip() -> None:
    s = structure("peanut 8")
    assert s.opening.dip.max() > 1e-3
    again = build(ring_on(peanut(2048), 8, phase=0.0), 0.01)
    assert again.eta == pytest.approx(s.eta, rel=1e-8)


@settings(max_examples=150)
@given(
    aspect=st.floats(0.3, 1.0),
    exponent=st.floats(1.2, 5.0),
    n=st.integers(3, 14),
    phase=st.floats(0.0, 6.2),
    x=st.floats(-0.3, 0.3),
    y=st.floats(-0.3, 0.3),
    wall=st.floats(0.0, 0.08),
)
def test_any_ring_is_built_soundly_or_refused_with_a_reason(
    aspect: float, exponent: float, n: int, phase: float, x: float, y: float, wall: float
) -> None:
    p = Superellipse(1.0, aspect, exponent)
    refused, s = attempt(lambda: build(ring_on(p, n, phase=phase, centre=(x, y * aspect)), wall))
    if s is None:
        assert refused is not None
        assert refused.limit
        assert refused.remedy
        assert "nan" not in str(refused)
        return
    assert np.isfinite(s.cells.crease).all()
    assert s.cell_areas.sum() == pytest.approx(p.area, rel=1e-9)
    assert (s.cells.dead_centre_margin > 0.0).all()
    assert s.eta > 1.0
    assert shapely.is_valid(polygons(s, 1e-4)).all()


@pytest.mark.slow
@settings(max_examples=15)
@given(n=st.integers(3, 8), phase=st.floats(0.0, 6.2), aspect=st.floats(0.5, 1.0), wall=st.floats(0.0, 0.03))
def test_random_rings_agree_with_the_oracle(n: int, phase: float, aspect: float, wall: float) -> None:
    try:
        s = build(ring_on(Superellipse(1.0, aspect), n, phase=phase), wall)
    except InputError:
        assume(False)
    told, _ = retold(s)
    theirs = np.array([[c.crease_c.xy, c.crease_d.xy, c.v1, c.v3] for c in told.cells])
    assert np.abs(xy(s.cells.crease) - theirs).max() < 1e-6


# --- refusals --------------------------------------------------------------------------------------------


def test_wall_that_does_not_fit_is_refused_with_cell_and_numbers() -> None:
    with pytest.raises(CellError, match=r"cell c\d+: .*wall 0\.02 m.*remedy"):
        wing(0.02)


def test_cell_beyond_its_dead_centre_is_refused() -> None:
    # Many short panels with a thick wall: the links run nearly straight through the closing crease.
    with pytest.raises(CellError, match=r"cell c1: beyond its dead centre at closing crease b.*margin -3\.099 deg"):
        build(ring_on(Superellipse(1.0, 0.6), 12, phase=0.3), 0.02)
    assert build(ring_on(Superellipse(1.0, 0.6), 12, phase=0.3), 0.004).cells.dead_centre_margin.min() > 0.0


@pytest.mark.parametrize("wall", [-0.001, float("nan"), float("inf"), 5.0])
def test_nonsense_wall_is_refused(wall: float) -> None:
    with pytest.raises(CellError, match="wall_m"):
        build(ring_on(Superellipse(1.0, 0.6), 4), wall)


def test_structure_of_air_is_refused() -> None:
    square = PointOutline([[0, 0], [1, 0], [1, 1], [0, 1]], smooth=False)
    e = ring_on(square, 4, phase=0.25 * np.pi, centre=(0.5, 0.5))
    with pytest.raises(CellError, match="no panel has any thickness"):
        build(e, 0.0)
    assert build(e, 0.01).eta > 1.0
