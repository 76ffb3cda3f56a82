"""Example structures: rings on a circle or ellipse and the example wing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cell import Cell, CellSpec, Vertex, build
from .curves import Outline, naca4, naca_parameter

Side = tuple[int, int]  # (cell, edge)


@dataclass(frozen=True)
class Structure:
    """Cells on an outline; `joints` maps the name of an inner edge's opening vertex to its two panels."""

    outline: Outline
    cells: list[Cell]
    joints: dict[str, tuple[Side, Side]]

    @property
    def area(self) -> float:
        """Area of the whole cross-section."""
        return self.outline.area()

    @property
    def material_area(self) -> float:
        """Sum of all panel areas."""
        return sum(cell.material_area() for cell in self.cells)

    @property
    def eta(self) -> float:
        """Packaging ratio."""
        return self.area / self.material_area


def ring_of(
    outline: Outline, centre: Vertex, opening: list[Vertex], closing: list[Vertex], t_min: float
) -> Structure:
    """Return the ring of cells (centre, opening[i], closing[i], opening[i + 1]), counter-clockwise."""
    n = len(opening)
    arcs = (False, True, True, False)
    cells = [
        build(outline, CellSpec((centre, opening[i], closing[i], opening[(i + 1) % n]), arcs), t_min)
        for i in range(n)
    ]
    joints = {opening[i].name: ((i - 1) % n, 3) for i in range(n)}
    return Structure(outline, cells, {name: (side, (i, 0)) for i, (name, side) in enumerate(joints.items())})


def outline_vertex(outline: Outline, name: str, s: float) -> Vertex:
    """Return a vertex on the outline."""
    x, y = outline.at(s)
    return Vertex(name, (float(x), float(y)), s)


def ring(
    outline: Outline,
    n: int,
    *,
    t_min: float = 0.0,
    centre: tuple[float, float] = (0.0, 0.0),
    phase: float = 0.0,
) -> Structure:
    """Return the ring with opening vertices at s = phase + i / n and closing ones half-way between."""
    s = [(phase + i / n, phase + (i + 0.5) / n) for i in range(n)]
    opening = [outline_vertex(outline, f"T{i + 1}", pair[0]) for i, pair in enumerate(s)]
    closing = [outline_vertex(outline, f"C{i + 1}", pair[1]) for i, pair in enumerate(s)]
    return ring_of(outline, Vertex("P", centre), opening, closing, t_min)


def wing(t_min: float = 0.005, *, reading: str = "surface") -> Structure:
    """Return the example wing, chord 1.

    Opening vertices T1 (upper 0.68), T2 (upper 0.16), B1 (lower 0.055), B2 (lower 0.80); closing vertices U
    (upper 0.39), nose, L (lower 0.40), trailing edge; inner vertex P. The cells, in order, lie between T1 and
    T2, T2 and B1, B1 and B2, B2 and T1.
    """
    outline = naca4("2412")

    def vertex(name: str, x: float, side: str) -> Vertex:
        return outline_vertex(outline, name, naca_parameter(outline, x, side, reading=reading))

    opening = [
        vertex("T1", 0.68, "upper"),
        vertex("T2", 0.16, "upper"),
        vertex("B1", 0.055, "lower"),
        vertex("B2", 0.80, "lower"),
    ]
    closing = [
        vertex("U", 0.39, "upper"),
        vertex("nose", 0.0, "upper"),
        vertex("L", 0.40, "lower"),
        vertex("TE", 1.0, "upper"),
    ]
    return ring_of(outline, Vertex("P", (0.44, 0.04)), opening, closing, t_min)


def collinear_error(polygons: list[np.ndarray]) -> float:
    """Return the largest distance of points from the best straight line through all of them."""
    points = np.vstack(polygons)
    centred = points - points.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][1]
    return float(np.abs(centred @ normal).max())
