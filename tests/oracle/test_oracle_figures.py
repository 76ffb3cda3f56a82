"""The oracle reproduces the figures of geometry.md, section 7, that concern the plane.

The figures for the circle are too large there by up to 2e-5: the prototype sampled the rim thickness of a
curved panel and missed the middle of the arc. The closed form below and the oracle agree to 1e-8.
"""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq
from shapely.geometry import Polygon

from .cell import Cell, CellSpec, Vertex, build
from .curves import Outline, ellipse, shoelace
from .fold import Clash, cell_poses, clash, follow, placed, solve, worst_in_step
from .structure import Structure, collinear_error, outline_vertex, ring, wing

NOISE = 1e-12
"""Overlap depths below this, in chords, are rounding."""


@cache
def example_wing(t_min: float = 0.005, reading: str = "surface") -> Structure:
    return wing(t_min, reading=reading)


def circle_eta(n: int) -> float:
    """Closed form for n equal cells on the unit circle, t = 0: half a cell is a sector less a triangle."""
    half = np.pi / n
    crease = brentq(lambda x: np.sin(x) - 1.0 + np.cos(0.5 * (half - x)), 0.0, half, xtol=1e-16)
    v1 = np.array([np.sin(crease) / np.tan(half), np.sin(crease)])
    c = np.array([np.cos(crease), np.sin(crease)])
    v3 = np.array([np.cos(half), np.sin(half)])
    return 0.5 * half / (0.5 * half - shoelace(np.array([v1, c, v3])))


@pytest.mark.parametrize(
    ("n", "printed", "exact"),
    [
        (4, 4.23998, 4.2399217835),
        (6, 6.65261, 6.6524978948),
        (8, 9.11651, 9.1163497314),
        (12, 14.11313, 14.1128477486),
    ],
)
def test_circle(n: int, printed: float, exact: float) -> None:
    eta = ring(ellipse(1.0, 1.0), n).eta
    assert circle_eta(n) == pytest.approx(exact, rel=1e-10)
    assert eta == pytest.approx(exact, rel=1e-8)
    assert eta == pytest.approx(printed, rel=2.1e-5)


@pytest.mark.parametrize(("t_min", "printed", "exact"), [(0.005, 2.1311, 2.13106645), (0.003, 2.6235, 2.62352959)])
def test_wing(t_min: float, printed: float, exact: float) -> None:
    eta = example_wing(t_min).eta
    assert eta == pytest.approx(exact, abs=1e-8)
    assert round(eta, 4) == printed


@pytest.mark.parametrize(("t_min", "printed"), [(0.005, 2.1311), (0.003, 2.6235)])
def test_x_chord_is_that_of_the_surface_point(t_min: float, printed: float) -> None:
    assert abs(example_wing(t_min, "camber").eta - printed) > 5e-3


def test_wing_dead_centre_margin() -> None:
    margins = np.degrees([cell.margins for cell in example_wing().cells])
    assert margins.min() == pytest.approx(2.291792, abs=1e-5)
    assert np.unravel_index(margins.argmin(), margins.shape) == (2, 1)  # at v3 of the cell on the lower skin


def test_wing_tiles() -> None:
    structure = example_wing()
    voids = sum(shoelace(cell.void) for cell in structure.cells)
    assert structure.material_area + voids == pytest.approx(structure.area, rel=1e-10)


def peanut() -> Outline:
    """A hollow outline: a circle pinched above and below."""

    def point(s: np.ndarray) -> np.ndarray:
        angle = 2.0 * np.pi * np.asarray(s, dtype=float)
        radius = 1.0 + 0.25 * np.cos(2.0 * angle)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)

    return Outline("peanut", point)


def odd_cells() -> list[Cell]:
    """Return single cells of the other kinds: all arcs, all straight, both, on a hollow outline."""

    def cell(outline: Outline, s: tuple[float, ...], arcs: tuple[bool, ...], inner: dict[int, Vertex]) -> Cell:
        vertices = [inner.get(i, outline_vertex(outline, "acbd"[i], s[i])) for i in range(4)]
        return build(outline, CellSpec(tuple(vertices), arcs), 0.01)  # type: ignore[arg-type]

    circle, oval, straight = ellipse(1.0, 1.0), ellipse(1.0, 0.6), (False, False, False, False)
    p, q, o = Vertex("p", (0.3, 0.05)), Vertex("q", (-0.3, 0.0)), Vertex("o", (0.0, 0.0))
    return [
        cell(circle, (0.0, 0.25, 0.5, 0.75), (True,) * 4, {}),
        cell(oval, (0.0, 0.2, 0.47, 0.75), (True,) * 4, {}),
        cell(circle, (0.0, 0.27, 0.0, 0.72), straight, {0: p, 2: q}),
        cell(circle, (0.0, 0.25, 0.5, 0.75), (False, True, True, False), {0: p}),
        cell(peanut(), (0.0, 0.05, 0.2, 0.36), (False, True, True, False), {0: o}),
    ]


N_CELLS = 19


@cache
def all_cells() -> list[Cell]:
    """Made by the first test that needs them, not when tests are collected."""
    structures = [example_wing(0.005), example_wing(0.003), ring(ellipse(1.0, 0.6), 6, t_min=0.02)]
    return [*odd_cells(), *(cell for structure in structures for cell in structure.cells)]


def test_hollow_outline_dips() -> None:
    cell = odd_cells()[-1]
    dips = (cell.crease_c.dip, cell.crease_d.dip)
    assert max(dips) > 0.0
    assert all(t >= 0.01 + dip - 1e-15 for t, dip in zip(cell.t, dips, strict=True))


@pytest.fixture
def cell(which: int) -> Cell:
    return all_cells()[which]


def test_none_is_left_out() -> None:
    assert len(all_cells()) == N_CELLS


@pytest.mark.parametrize("which", range(N_CELLS))
def test_flat_state(cell: Cell) -> None:
    assert min(cell.margins) > 0.0
    assert cell.unfolded[0] == pytest.approx(cell.unfolded[1], rel=1e-12)
    assert np.abs(np.subtract(solve(cell, 0.0), (0.0, np.pi, 0.0, np.pi))).max() < 1e-10
    faces = [(cell.v1, cell.m_c), (cell.m_c, cell.v3), (cell.v3, cell.m_d), (cell.m_d, cell.v1)]
    lines = [pose.apply(np.array(face)) for pose, face in zip(cell_poses(cell, 0.0), faces, strict=True)]
    assert collinear_error(lines) < 1e-10


@pytest.mark.parametrize("which", range(N_CELLS))
def test_fold_closes_and_keeps_its_branch(cell: Cell) -> None:
    for lam in (0.0, 0.3, 0.9):
        assert follow(cell, lam) == pytest.approx(solve(cell, lam), abs=1e-9)
        panels = cell_poses(cell, lam)
        assert panels[1].apply(cell.v3) == pytest.approx(panels[2].apply(cell.v3), abs=1e-12)
        assert sum(solve(cell, lam)) == pytest.approx(2.0 * np.pi, abs=1e-12)
    assert solve(cell, 1.0) == pytest.approx(cell.angles, abs=1e-12)


@pytest.mark.parametrize("slit", ["T2", "B1"])
def test_in_step_is_free(slit: str) -> None:
    found, _, area = worst_in_step(example_wing(), [slit], np.linspace(0.0, 1.0, 201), 100)
    assert found.depth < NOISE
    assert area < NOISE


@pytest.mark.slow
@pytest.mark.parametrize(
    ("slit", "depth", "where", "pair"),
    [("T1", 2.6686e-3, 0.7924, ((0, 0), (3, 3))), ("B2", 1.6371e-3, 0.7754, ((0, 0), (2, 3)))],
)
def test_in_step_grazes(slit: str, depth: float, where: float, pair: object) -> None:
    found, at, _ = worst_in_step(example_wing(), [slit], np.linspace(0.7, 1.0, 301), 100)
    assert found.depth == pytest.approx(depth, rel=0.01)
    assert at == pytest.approx(where, abs=2e-3)
    assert found.pair == pair


@pytest.mark.parametrize(
    ("slit", "pair", "area"), [("T1", ((0, 0), (3, 3)), 2.63e-6), ("B2", ((2, 3), (3, 0)), 2.05e-6)]
)
def test_slit_panels_overlap_by_the_printed_area(slit: str, pair: tuple, area: float) -> None:
    """geometry.md: 2.6e-6 for either; at B2 it is only 2.1e-6."""
    largest = 0.0
    for lam in np.linspace(0.5, 1.0, 251):
        panels = placed(example_wing(), [float(lam)] * 4, [slit], 200)
        largest = max(largest, Polygon(panels[pair[0]]).intersection(Polygon(panels[pair[1]])).area)
    assert largest == pytest.approx(area, rel=0.01)


def worst_out_of_step(slit: str, gap: float) -> Clash:
    """Return the deepest clash near the deployed state over all patterns of leading and lagging cells."""
    worst = Clash(0.0, 0.0, None)
    for lag in (1.0 - gap, 1.0 - 1.5 * gap, 1.0 - 3.0 * gap):
        for pattern in itertools.product((0.0, gap), repeat=4):
            found = clash(placed(example_wing(), [min(1.0, lag + lead) for lead in pattern], [slit], 60))
            worst = max(worst, found, key=lambda item: item.depth)
    return worst


@pytest.mark.parametrize(("slit", "limit"), [("T2", 0.0030361), ("B1", 0.0030155)])
def test_out_of_step_limit(slit: str, limit: float) -> None:
    """The gap at which some pattern first cuts deeper than 1e-4 chord, at the deployed end of the motion."""
    assert worst_out_of_step(slit, 0.998 * limit).depth < 1e-4
    assert worst_out_of_step(slit, 1.002 * limit).depth > 1e-4
