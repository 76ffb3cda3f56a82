"""One cell of a generalized cone, built by the plainest reading of equations (4) to (6), with rotation matrices.

Order of things as in `tests/oracle/cell.py`: vertices a, c, b, d counter-clockwise, edges a-c, c-b, b-d, d-a
numbered 0 to 3. A curve is a function from a parameter of period 1 to unit vectors. Nothing here is fast: extremes
are found by dense sampling and a bracketing search, offsets by scanning.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.spatial.transform import Rotation

from .curves import Array

Curve = Callable[[Array], Array]


class CannotBuild(ValueError):
    """The cell has no construction."""


@dataclass(frozen=True)
class Ray:
    """A vertex of the layout; `s` is its outline parameter, None when it lies inside."""

    u: Array
    s: float | None = None


@dataclass(frozen=True)
class ConeCell:
    """A built cell: opening creases, their parameters, rims and offsets, closing creases, elbows, unfolded arcs."""

    curve: Curve
    vertices: tuple[Ray, Ray, Ray, Ray]
    arcs: tuple[bool, bool, bool, bool]
    c: Array
    d: Array
    s: tuple[float, float]
    h: tuple[float, float]
    t: tuple[float, float]
    v1: Array
    m_c: Array
    v3: Array
    m_d: Array
    opening_angles: tuple[float, float]
    unfolded: tuple[float, float]

    @property
    def closing_angles(self) -> tuple[float, float]:
        """Inner angles of the void at v1 and v3."""
        return angle_at(self.v1, self.m_c, self.m_d), angle_at(self.v3, self.m_d, self.m_c)

    @property
    def margins(self) -> tuple[float, float]:
        """Dead-centre margins at v1 and v3."""
        return np.pi - angle_at(self.v1, self.c, self.d), np.pi - angle_at(self.v3, self.d, self.c)

    def panel(self, edge: int, n: int = 2000) -> Array:
        """Return the deployed panel of an edge as a counter-clockwise spherical polygon (k, 3)."""
        a, c, b, d = self.vertices
        start, stop = ((a, c), (c, b), (b, d), (d, a))[edge]
        s_crease = self.s[0] if edge < 2 else self.s[1]
        towards = edge in (0, 2)  # from the closing vertex to the opening one
        opening, closing = (stop, start) if towards else (start, stop)
        outer = closing.s if self.arcs[edge] else opening.s
        assert outer is not None
        if towards:
            low = s_crease - (s_crease - outer) % 1.0 if self.arcs[edge] else min(near(outer, s_crease), s_crease)
            rim = self.curve(np.linspace(low, s_crease, n + 1))
        else:
            high = s_crease + (outer - s_crease) % 1.0 if self.arcs[edge] else max(near(outer, s_crease), s_crease)
            rim = self.curve(np.linspace(s_crease, high, n + 1))
        q = closing.u[None]
        inner = ((self.m_c, self.v1), (self.v3, self.m_c), (self.m_d, self.v3), (self.v1, self.m_d))[edge]
        loop = [q, rim, *inner] if towards else [rim, q, *inner]
        points = np.vstack(loop)
        return points[np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1) > 1e-12]

    def material(self, n: int = 2000) -> float:
        """Return the solid angle of the four panels together."""
        return sum(solid_angle(self.panel(edge, n)) for edge in range(4))


def near(s: float, to: float) -> float:
    """Return `s` shifted by whole periods to lie within half a period of `to`."""
    return s + np.round(to - s)


def angle_at(v: Array, first: Array, second: Array) -> float:
    """Return the angle at `v`, counter-clockwise from the arc towards `first` to that towards `second`."""
    p, q = first - (first @ v) * v, second - (second @ v) * v
    return float(np.arctan2(v @ np.cross(p, q), p @ q) % (2.0 * np.pi))


def solid_angle(points: Array) -> float:
    """Return the solid angle of a spherical polygon: the sum of its triangles from its middle by L'Huilier."""
    middle = points.sum(axis=0)
    middle /= np.linalg.norm(middle)
    total = 0.0
    for p, q in zip(points, np.roll(points, -1, axis=0), strict=True):
        sides = [between(p, q), between(q, middle), between(middle, p)]
        half = 0.5 * sum(sides)
        product = np.tan(0.5 * half) * np.prod([np.tan(0.5 * (half - x)) for x in sides])
        total += float(np.sign(middle @ np.cross(p, q)) * 4.0 * np.arctan(np.sqrt(max(product, 0.0))))
    return total


def between(p: Array, q: Array) -> float:
    """Return the arc between two unit vectors."""
    return float(2.0 * np.arcsin(min(1.0, 0.5 * float(np.linalg.norm(p - q)))))


def turned(points: Array, axis: Array, angle: float) -> Array:
    """Return points rotated about an axis through the apex."""
    return Rotation.from_rotvec(angle * axis).apply(points)


def unit(v: Array) -> Array:
    """Return the vector scaled to length 1."""
    return v / np.linalg.norm(v)


def smallest(f: Callable[[Array], Array], low: float, high: float, n: int = 600) -> float:
    """Return the smallest value of a function on [low, high]: sample, then refine the best sample."""
    s = np.linspace(low, high, n + 1)
    values = f(s)
    k = int(np.argmin(values))
    bracket = (s[max(k - 1, 0)], s[min(k + 1, n)])
    found = minimize_scalar(
        lambda x: float(f(np.array([x]))[0]), bounds=bracket, method="bounded", options={"xatol": 1e-13}
    )
    return min(float(values[k]), float(found.fun))


def face_pole(a: Ray, b: Ray, crease: Array, arc: bool, towards: bool) -> Array:
    """Return the pole, towards the void, of the inner face at offset 0 of the panel from `a` to `b`."""
    if arc:
        return unit(np.cross(a.u, crease) if towards else np.cross(crease, b.u))
    bond = unit(np.cross(a.u, b.u))
    foot = unit(crease - (crease @ bond) * bond)
    if np.linalg.norm(foot - crease) < 1e-13:  # the crease lies on the bond plane
        return unit(bond - (bond @ crease) * crease)
    # The shortest arc from the bond plane arrives at the crease in this direction; the face crosses it there.
    return unit(crease * (crease @ foot) - foot)


def find_crease(curve: Curve, before: Ray, w: Ray, after: Ray, arcs: tuple[bool, bool]) -> tuple[float, float]:
    """Return parameter and rim thickness of the opening crease at `w`: (4) or (5)."""
    assert w.s is not None
    if not any(arcs):
        return w.s, 0.0
    low = w.s - (w.s - before.s) % 1.0 if arcs[0] else w.s  # type: ignore[operator]
    high = w.s + (after.s - w.s) % 1.0 if arcs[1] else w.s  # type: ignore[operator]

    def poles(s: float) -> tuple[Array, Array, Array]:
        c = curve(np.array([s]))[0]
        return c, face_pole(before, w, c, arcs[0], True), face_pole(w, after, c, arcs[1], False)

    def straight(s: float, bond: Array) -> float:
        return float(np.arcsin(curve(np.array([s]))[0] @ bond))

    def rim(c: Array, pole: Array, span: tuple[float, float]) -> float:
        """Angle by which the face has to be tilted outwards to hold the whole arc, found by tilting."""

        def left_over(angle: float) -> float:
            side = turned(pole, np.cross(pole, c), angle)
            return smallest(lambda x: curve(x) @ side, *span)

        return float(brentq(left_over, -1e-9, 1.5, xtol=1e-15)) if left_over(-1e-9) < 0.0 else 0.0

    def difference(s: float) -> float:
        c, first, second = poles(s)
        if arcs == (True, True):
            return rim(c, first, (low, s)) - rim(c, second, (s, high))
        # Turned about the crease until both inner faces are one circle, the curved panel touches the bond plane.
        turn = float(np.arctan2(c @ np.cross(first, second), first @ second))
        if arcs[1]:
            bond = unit(np.cross(before.u, w.u))
            return smallest(lambda x: turned(curve(x), c, -turn) @ bond, s, high)
        bond = unit(np.cross(w.u, after.u))
        return -smallest(lambda x: turned(curve(x), c, turn) @ bond, low, s)

    if abs(difference(w.s)) < 1e-13:
        return w.s, 0.0  # nothing bulges: the crease stays at the vertex
    inset = 1e-7 * (high - low)
    grid = np.linspace(low + inset, high - inset, 41)
    values = np.array([difference(s) for s in grid])
    changes = [i for i in range(40) if values[i] < 0.0 <= values[i + 1]]
    if not changes:
        raise CannotBuild("no crease")
    i = min(changes, key=lambda j: abs(grid[j] - w.s))
    s = float(brentq(difference, grid[i], grid[i + 1], xtol=1e-15, rtol=1e-14))
    if arcs == (True, True):
        c, first, _ = poles(s)
        return s, rim(c, first, (low, s))
    return s, straight(s, unit(np.cross(before.u, w.u) if arcs[1] else np.cross(w.u, after.u)))


def dip(curve: Curve, c: Array, pole: Array, span: tuple[float, float]) -> float:
    """Return the angle by which a face has to be tilted inwards, about its crease, to leave the whole arc outside."""

    def left_inside(angle: float) -> float:
        side = turned(pole, np.cross(pole, c), -angle)
        return -smallest(lambda x: -(curve(x) @ side), *span)

    return float(brentq(left_inside, 1e-9, 1.0, xtol=1e-15)) if left_inside(1e-9) > 0.0 else 0.0


def smallest_pair(construct: Callable[[float, float], ConeCell], least: tuple[float, float]) -> ConeCell:
    """Return the cell that satisfies (6) with one offset raised above `least`, by as little as possible."""

    def residual(t_c: float, t_d: float) -> float:
        cell = construct(t_c, t_d)
        return cell.unfolded[0] - cell.unfolded[1]

    if abs(residual(*least)) < 1e-13:
        return construct(*least)
    found: list[tuple[float, ConeCell]] = []
    for which in (0, 1):
        raised = np.concatenate([[0.0], np.geomspace(1e-9, 0.5, 600)])

        def pair(x: float, k: int = which) -> tuple[float, float]:
            return (least[0] + x, least[1]) if k == 0 else (least[0], least[1] + x)

        values = [residual(*pair(x)) for x in raised]
        for i in range(len(raised) - 1):
            if values[i] * values[i + 1] > 0.0:
                continue
            x = float(brentq(lambda x, of=pair: residual(*of(x)), raised[i], raised[i + 1], xtol=1e-16))
            cell = construct(*pair(x))
            if abs(cell.unfolded[0] - cell.unfolded[1]) < 1e-10:  # not a pole
                found.append((x, cell))
                break
    if not found:
        raise CannotBuild("no inner offset satisfies (6)")
    return min(found, key=lambda item: item[0])[1]


def build(
    curve: Curve, vertices: tuple[Ray, Ray, Ray, Ray], arcs: tuple[bool, bool, bool, bool], t_min: float
) -> ConeCell:
    """Return the cell with the smallest inner offsets, at least `t_min` plus dip, that satisfy (6)."""
    a, c, b, d = vertices
    s_c, h_c = find_crease(curve, a, c, b, (arcs[0], arcs[1]))
    s_d, h_d = find_crease(curve, b, d, a, (arcs[2], arcs[3]))
    at_c, at_d = curve(np.array([s_c, s_d]))
    crease = (at_c, at_c, at_d, at_d)
    ends = ((a, c), (c, b), (b, d), (d, a))
    rest = [face_pole(*ends[k], crease[k], arcs[k], k in (0, 2)) for k in range(4)]
    dips = [0.0] * 4
    for k in range(4):
        s_crease, far = (s_c, s_d)[k // 2], ends[k][0 if k in (0, 2) else 1].s
        if arcs[k]:
            low = s_crease - (s_crease - far) % 1.0 if k in (0, 2) else s_crease
            high = s_crease if k in (0, 2) else s_crease + (far - s_crease) % 1.0
            dips[k] = dip(curve, crease[k], rest[k], (low, high))
    least = (t_min + max(dips[:2]), t_min + max(dips[2:]))
    turn_c, turn_d = (
        float(np.arctan2(p @ np.cross(m, n), m @ n)) for p, m, n in ((at_c, *rest[:2]), (at_d, *rest[2:]))
    )

    def construct(t_c: float, t_d: float) -> ConeCell:
        t = (t_c, t_c, t_d, t_d)
        pole = [turned(rest[k], np.cross(rest[k], crease[k]), -t[k]) for k in range(4)]
        v1, m_c, v3, m_d = (unit(np.cross(pole[k - 1], pole[k])) for k in range(4))
        if t_c == 0.0:
            m_c = at_c
        if t_d == 0.0:
            m_d = at_d
        # (6): turn u3 about each opening crease until that side is straight; its arc from u1.
        over_c = between(v1, turned(v3, at_c, -turn_c))
        over_d = between(v1, turned(v3, at_d, turn_d))
        return ConeCell(
            curve, vertices, arcs, at_c, at_d, (s_c, s_d), (h_c, h_d), (t_c, t_d), v1, m_c, v3, m_d,
            (np.pi - turn_c, np.pi - turn_d), (over_c, over_d),
        )  # fmt: skip

    return smallest_pair(construct, least)
