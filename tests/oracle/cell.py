"""One cell of a generalized cylinder, built by the plainest reading of equations (1) to (3).

A cell is the quadrilateral a, c, b, d, counter-clockwise: closing vertices a and b, opening vertices c and d.
Its edges a-c, c-b, b-d, d-a are numbered 0 to 3 and so are its panels. Creases and inner faces follow the
same order: v1 (edges 3 and 0), c (0 and 1), v3 (1 and 2), d (2 and 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from shapely.geometry import Polygon

from .curves import Array, Outline, bulge, shoelace


class CannotBuild(ValueError):
    """The cell has no construction."""


@dataclass(frozen=True)
class Vertex:
    """A vertex of the layout; `s` is its outline parameter, None when it lies inside."""

    name: str
    xy: tuple[float, float]
    s: float | None = None


@dataclass(frozen=True)
class CellSpec:
    """Vertices a, c, b, d of a cell and, for its edges a-c, c-b, b-d, d-a, whether each is an outline arc."""

    vertices: tuple[Vertex, Vertex, Vertex, Vertex]
    arcs: tuple[bool, bool, bool, bool]


@dataclass(frozen=True)
class Crease:
    """An opening crease: the point, its outline parameter, rim thickness and the dip of its curved panels."""

    xy: Array
    s: float
    h: float
    dip: float


@dataclass(frozen=True)
class Cell:
    """A built cell. See the module docstring for the order of things."""

    spec: CellSpec
    outline: Outline
    crease_c: Crease
    crease_d: Crease
    t: tuple[float, float]
    v1: Array
    m_c: Array
    v3: Array
    m_d: Array
    unfolded: tuple[float, float]

    @property
    def angles(self) -> tuple[float, float, float, float]:
        """Deployed face angles at v1, c, v3, d: the inner angles of the void v1, m_c, v3, m_d."""
        v1, m_c, v3, m_d = self.v1, self.m_c, self.v3, self.m_d
        return (
            inner_angle(m_d, v1, m_c),
            inner_angle(v1, m_c, v3),
            inner_angle(m_c, v3, m_d),
            inner_angle(v3, m_d, v1),
        )

    @property
    def link_angles(self) -> tuple[float, float, float, float]:
        """Deployed inner angles of the four-bar v1, c', v3, d' through the crease points."""
        c, d = self.crease_c.xy, self.crease_d.xy
        return (
            inner_angle(d, self.v1, c),
            inner_angle(self.v1, c, self.v3),
            inner_angle(c, self.v3, d),
            inner_angle(self.v3, d, self.v1),
        )

    @property
    def margins(self) -> tuple[float, float]:
        """Dead-centre margins at v1 and v3 in radians."""
        at_v1, _, at_v3, _ = self.link_angles
        return np.pi - at_v1, np.pi - at_v3

    def rim(self, edge: int, n: int) -> Array:
        """Return the outer side of panel `edge`, counter-clockwise, with n samples per outline arc."""
        a, c, b, d = self.spec.vertices
        before, after = ((a, c), (c, b), (b, d), (d, a))[edge]
        crease = self.crease_c if edge < 2 else self.crease_d
        starts_at_closing = edge in (0, 2)
        forward = self.outline.forward
        if self.spec.arcs[edge]:
            if starts_at_closing:
                return self.outline.arc(before.s, forward(before.s, crease.s), n)
            s = crease.s
            return self.outline.arc(s, forward(s, after.s), n)
        opening, closing = (after, before) if starts_at_closing else (before, after)
        q = np.asarray(closing.xy)[None, :]
        if np.hypot(*(np.asarray(opening.xy) - crease.xy)) < 1e-14:
            return np.vstack([q, crease.xy]) if starts_at_closing else np.vstack([crease.xy, q])
        if starts_at_closing:
            return np.vstack([q, self.outline.arc(opening.s, forward(opening.s, crease.s), n)])
        return np.vstack([self.outline.arc(crease.s, forward(crease.s, opening.s), n), q])

    def panel(self, edge: int, n: int = 400) -> Array:
        """Return the deployed panel of an edge as a counter-clockwise polygon (k, 2)."""
        inner = ((self.m_c, self.v1), (self.v3, self.m_c), (self.m_d, self.v3), (self.v1, self.m_d))[edge]
        points = np.vstack([self.rim(edge, n), *inner])
        keep = np.hypot(*(points - np.roll(points, 1, axis=0)).T) > 1e-14
        return points[keep]

    @property
    def void(self) -> Array:
        """The empty quadrilateral v1, m_c, v3, m_d."""
        return np.array([self.v1, self.m_c, self.v3, self.m_d])

    def material_area(self, n: int = 40_000) -> float:
        """Return the sum of the four panels' areas."""
        return sum(shoelace(self.panel(edge, n)) for edge in range(4))


def cross(u: Array, v: Array) -> float:
    """Return the z component of the cross product of two plane vectors."""
    return float(u[0] * v[1] - u[1] * v[0])


def inner_angle(before: Array, at: Array, after: Array) -> float:
    """Return the inner angle at a vertex of a counter-clockwise polygon, in [0, 2 pi)."""
    u, w = after - at, before - at
    return float(np.arctan2(cross(u, w), u @ w) % (2.0 * np.pi))


def left_distance(p: Array, q: Array, x: Array) -> float:
    """Return how far `x` lies to the left of the line from `p` to `q`."""
    return cross(q - p, x - p) / float(np.hypot(*(q - p)))


def find_crease(outline: Outline, before: Vertex, w: Vertex, after: Vertex, arcs: tuple[bool, bool]) -> Crease:
    """Return the opening crease at `w`: the outline point where its two panels' rim thicknesses are equal.

    `arcs` says whether the edges before-w and w-after are outline arcs. Between the ends of the arc on which
    the crease may lie the first change of sign counted from `w` is taken.
    """
    arc_in, arc_out = arcs
    p, q, x = (np.asarray(vertex.xy, dtype=float) for vertex in (before, w, after))
    if w.s is None:
        raise CannotBuild(f"opening vertex {w.name} is not on the outline")
    if not arc_in and not arc_out:
        return Crease(q, w.s, 0.0, 0.0)
    low = w.s - (outline.forward(before.s, w.s) - before.s) if arc_in else w.s
    high = outline.forward(w.s, after.s) if arc_out else w.s

    def thickness_in(s: float) -> float:
        return bulge(outline, low, s) if arc_in else left_distance(p, q, outline.at(s))

    def thickness_out(s: float) -> float:
        return bulge(outline, s, high) if arc_out else left_distance(q, x, outline.at(s))

    def difference(s: float) -> float:
        return thickness_in(s) - thickness_out(s)

    grid = np.linspace(low, high, 201)
    values = np.array([difference(s) for s in grid])
    changes = [i for i in range(200) if values[i] < 0.0 <= values[i + 1]]
    if not changes:
        raise CannotBuild(f"no crease at {w.name}: rim thicknesses differ by {np.abs(values).min():.3g} or more")
    i = min(changes, key=lambda j: abs(grid[j] - w.s))
    s = float(brentq(difference, grid[i], grid[i + 1], xtol=1e-15, rtol=1e-14))
    dips = [0.0]
    if arc_in:
        dips.append(bulge(outline, low, s, outward=False))
    if arc_out:
        dips.append(bulge(outline, s, high, outward=False))
    return Crease(outline.at(s), s, thickness_in(s), max(dips))


def meet(p: Array, u: Array, q: Array, v: Array) -> Array:
    """Return where the line through `p` along `u` meets the line through `q` along `v`."""
    sine = cross(u, v)
    if abs(sine) < 1e-12:
        raise CannotBuild("inner faces are parallel")
    return p + u * (cross(q - p, v) / sine)


def build(outline: Outline, spec: CellSpec, t_min: float = 0.0) -> Cell:
    """Return the cell with the smallest inner offsets that satisfy (3) and `t >= t_min + dip`."""
    a, c, b, d = spec.vertices
    crease_c = find_crease(outline, a, c, b, (spec.arcs[0], spec.arcs[1]))
    crease_d = find_crease(outline, b, d, a, (spec.arcs[2], spec.arcs[3]))
    at = [crease_c.xy, crease_c.xy, crease_d.xy, crease_d.xy]
    ends = [(a, c), (c, b), (b, d), (d, a)]
    along = []
    for edge, (start, end) in enumerate(ends):
        p, q = np.asarray(start.xy, dtype=float), np.asarray(end.xy, dtype=float)
        if spec.arcs[edge]:  # the chord from the closing point to the crease
            p, q = (p, at[edge]) if edge in (0, 2) else (at[edge], q)
        along.append((q - p) / np.hypot(*(q - p)))
    normal = [np.array([-u[1], u[0]]) for u in along]

    def construct(t_c: float, t_d: float) -> Cell:
        t = (t_c, t_c, t_d, t_d)
        base = [at[i] + t[i] * normal[i] for i in range(4)]
        v1, m_c, v3, m_d = (meet(base[i - 1], along[i - 1], base[i], along[i]) for i in range(4))
        side_c = (crease_c.xy - v1) @ along[0] + (v3 - crease_c.xy) @ along[1]
        side_d = (crease_d.xy - v3) @ along[2] + (v1 - crease_d.xy) @ along[3]
        return Cell(spec, outline, crease_c, crease_d, (t_c, t_d), v1, m_c, v3, m_d, (float(side_c), float(side_d)))

    def residual(t_c: float, t_d: float) -> float:
        side_c, side_d = construct(t_c, t_d).unfolded
        return side_c - side_d

    least = (t_min + crease_c.dip, t_min + crease_d.dip)
    size = float(np.hypot(*(crease_c.xy - crease_d.xy)))
    if abs(residual(*least)) < 1e-13 * size:
        return checked(construct(*least))
    found: list[tuple[float, Cell]] = []
    for which in (0, 1):
        raised = np.concatenate([[0.0], np.geomspace(1e-9, 1.0, 3000)]) * size
        values = [residual(*_raise(least, which, x)) for x in raised]
        for i in range(len(raised) - 1):
            if values[i] * values[i + 1] > 0.0:
                continue
            x = float(brentq(lambda x, k=which: residual(*_raise(least, k, x)), raised[i], raised[i + 1], xtol=1e-16))
            cell = construct(*_raise(least, which, x))
            if abs(cell.unfolded[0] - cell.unfolded[1]) < 1e-10 * size and min(cell.unfolded) > 0.0:
                found.append((x, cell))  # not a pole
                break
    if not found:
        raise CannotBuild("no inner offset satisfies (3)")
    return checked(min(found, key=lambda item: item[0])[1])


def _raise(least: tuple[float, float], which: int, by: float) -> tuple[float, float]:
    """Return `least` with one of its entries raised."""
    return (least[0] + by, least[1]) if which == 0 else (least[0], least[1] + by)


def checked(cell: Cell) -> Cell:
    """Return the cell if its panels and its void are simple polygons that do not overlap."""
    void = Polygon(cell.void)
    if not void.is_valid or shoelace(cell.void) <= 0.0:
        raise CannotBuild("the void crosses itself")
    for edge in range(4):
        points = cell.panel(edge, 200)
        panel = Polygon(points)
        if not panel.is_valid or shoelace(points) <= 0.0 or panel.intersection(void).area > 1e-12:
            raise CannotBuild(f"panel {edge} is not a simple polygon outside the void")
    return cell
