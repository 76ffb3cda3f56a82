"""Folding by brute force: the four-bar by circle intersections, panels by chains of rigid rotations.

A pose is an angle and a shift: x -> R(angle) x + shift. Interference is judged on dense polygons.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import Polygon

from .cell import Cell, inner_angle, left_distance
from .curves import Array
from .structure import Side, Structure


@dataclass(frozen=True)
class Pose:
    """A rigid motion of the plane."""

    angle: float
    shift: Array

    def apply(self, points: Array) -> Array:
        """Move points (n, 2) or (2,)."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        return points @ np.array([[cos, sin], [-sin, cos]]) + self.shift

    def after(self, first: Pose) -> Pose:
        """Return the motion that does `first` and then this one."""
        return Pose(self.angle + first.angle, self.apply(first.shift))

    def inverse(self) -> Pose:
        """Return the motion that undoes this one."""
        turned = Pose(-self.angle, np.zeros(2))
        return Pose(-self.angle, -turned.apply(self.shift))


STILL = Pose(0.0, np.zeros(2))


def turn(centre: Array, angle: float) -> Pose:
    """Return the rotation about a point."""
    rotation = Pose(angle, np.zeros(2))
    return Pose(angle, centre - rotation.apply(centre))


def _distance(p: Array, q: Array) -> float:
    return float(np.hypot(*(p - q)))


def _circles(p: Array, r: float, q: Array, s: float) -> tuple[Array, Array]:
    """Return the two intersections of the circle (p, r) with the circle (q, s); touching ones count."""
    gap = _distance(p, q)
    along = (gap**2 + r**2 - s**2) / (2.0 * gap)
    rise_squared = r**2 - along**2
    if rise_squared < -1e-10 * r**2:
        raise ValueError(f"the four-bar does not close: {rise_squared}")
    rise = np.sqrt(max(rise_squared, 0.0))
    unit = (q - p) / gap
    normal = np.array([-unit[1], unit[0]])
    return p + along * unit + rise * normal, p + along * unit - rise * normal


def solve(cell: Cell, lam: float) -> tuple[float, float, float, float]:
    """Return the face angles at v1, c, v3, d when the angle at v1 is `lam` times its deployed value.

    d' is turned about v1; v3 is where the circles about c' and d' meet. Its two positions are mirror images
    in the line c'd'; a motion changes from one to the other only through that line, where v3 is at a dead
    centre. So v3 is taken on the side on which it is deployed. At a change point (offsets zero, lam = 0) both
    positions coincide.
    """
    v1, c, v3, d = cell.v1, cell.crease_c.xy, cell.v3, cell.crease_d.xy
    d_now = turn(v1, -(1.0 - lam) * cell.angles[0]).apply(d)
    left, right = _circles(c, _distance(c, v3), d_now, _distance(d, v3))
    return _face_angles(cell, d_now, left if left_distance(c, d, v3) > 0.0 else right)


def follow(cell: Cell, lam: float, steps: int = 2000) -> tuple[float, float, float, float]:
    """Return the same as `solve`, by following the linkage from the deployed state in small steps.

    v3 is advanced by the velocity (no choice of side is made anywhere), and then
    drawn back onto the two circles by Newton's method.
    """
    v1, c, v3, d = cell.v1, cell.crease_c.xy, cell.v3, cell.crease_d.xy
    r, s = _distance(c, v3), _distance(d, v3)
    step = -(1.0 - lam) * cell.angles[0] / steps
    now, d_now = v3, d
    for i in range(1, steps + 1):
        swing = d_now - v1
        pull = step * (now - d_now) @ np.array([-swing[1], swing[0]])
        now = now + np.linalg.solve(np.array([now - c, now - d_now]), np.array([0.0, pull]))
        d_now = turn(v1, step * i).apply(d)
        for _ in range(20):
            error = np.array([(now - c) @ (now - c) - r**2, (now - d_now) @ (now - d_now) - s**2])
            if np.abs(error).max() < 1e-15:
                break
            now = now - np.linalg.solve(2.0 * np.array([now - c, now - d_now]), error)
    return _face_angles(cell, d_now, now)


def _face_angles(cell: Cell, d_now: Array, v3_now: Array) -> tuple[float, float, float, float]:
    """Return the face angles that go with positions of d' and v3 (v1 and c' at rest)."""
    v1, c = cell.v1, cell.crease_c.xy
    changed = (
        inner_angle(d_now, v1, c),
        inner_angle(v1, c, v3_now),
        inner_angle(c, v3_now, d_now),
        inner_angle(v3_now, d_now, v1),
    )
    angles = [f + _wrap(now - then) for f, now, then in zip(cell.angles, changed, cell.link_angles, strict=True)]
    return angles[0], angles[1], angles[2], angles[3]


def _wrap(angle: float) -> float:
    """Return an angle shifted into [-pi, pi)."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def cell_poses(cell: Cell, lam: float) -> list[Pose]:
    """Return the poses of panels 0..3 with panel 0 held still."""
    at_v1, at_c, _, at_d = solve(cell, lam)
    face = cell.angles
    fourth = turn(cell.v1, at_v1 - face[0])  # panel 3, counter-clockwise ahead of panel 0 at v1
    second = turn(cell.crease_c.xy, -(at_c - face[1]))  # opening the crease c turns panel 1 clockwise
    third = fourth.after(turn(cell.crease_d.xy, at_d - face[3]))
    return [STILL, second, third, fourth]


def poses(structure: Structure, lams: list[float], slits: Iterable[str]) -> dict[Side, Pose]:
    """Return the pose of every panel, panel 0 of cell 0 held still.

    Parameters
    ----------
    structure : Structure
    lams : list of float
        One fold variable per cell.
    slits : names of the inner edges (by opening vertex) that are not bonded.
    """
    own = [cell_poses(cell, lam) for cell, lam in zip(structure.cells, lams, strict=True)]
    base: dict[int, Pose] = {0: STILL}
    bonds = [pair for name, pair in structure.joints.items() if name not in set(slits)]
    while len(base) < len(structure.cells):
        before = len(base)
        for one, two in [*bonds, *[(b, a) for a, b in bonds]]:
            if one[0] in base and two[0] not in base:
                base[two[0]] = base[one[0]].after(own[one[0]][one[1]]).after(own[two[0]][two[1]].inverse())
        if len(base) == before:
            raise ValueError("the bonds do not join all cells")
    return {(i, edge): base[i].after(own[i][edge]) for i in base for edge in range(4)}


def placed(structure: Structure, lams: list[float], slits: Iterable[str], n: int = 200) -> dict[Side, Array]:
    """Return every panel's polygon at a fold state."""
    return {
        (i, edge): pose.apply(structure.cells[i].panel(edge, n))
        for (i, edge), pose in poses(structure, lams, slits).items()
    }


@dataclass(frozen=True)
class Clash:
    """The worst overlap of a state: by area and by depth, and the pair of panels of each."""

    area: float
    depth: float
    pair: tuple[Side, Side] | None


NO_CLASH = Clash(0.0, 0.0, None)


def overlap(one: Polygon, two: Polygon) -> shapely.Geometry:
    """Return the common part of two panels.

    The grid makes GEOS round coordinates to 1e-12 on the way. Without it the overlay of two bonded panels,
    whose common edge differs by rounding, is now and then a whole panel (locationtech/jts issue 1000).
    """
    return shapely.intersection(one, two, grid_size=1e-12)


def overlap_depth(one: Polygon, two: Polygon) -> float:
    """Return how far a point of either outline lies inside the other panel, at most.

    For a corner or a sliver that dips into the other panel this is the distance by which it must back out.
    The sides of the common part are cut up finely: its corners alone may all lie on both outlines.
    """
    common = overlap(one, two)
    if common.is_empty or common.area == 0.0:
        return 0.0
    fine = shapely.segmentize(common, common.length / 2000.0)
    points = shapely.points(shapely.get_coordinates(fine))
    to_one, to_two = shapely.distance(points, one.exterior), shapely.distance(points, two.exterior)
    return float(max(to_one.max(), to_two.max()))


def clash(panels: Mapping[Side, Array]) -> Clash:
    """Return the worst overlap among all pairs of panels: total area, greatest depth, the deepest pair."""
    shapes = {side: Polygon(points) for side, points in panels.items()}
    total, worst, pair = 0.0, 0.0, None
    for one, two in itertools.combinations(shapes, 2):
        if not shapely.box(*shapes[one].bounds).intersects(shapely.box(*shapes[two].bounds)):
            continue
        total += overlap(shapes[one], shapes[two]).area
        depth = overlap_depth(shapes[one], shapes[two])
        if depth > worst:
            worst, pair = depth, (one, two)
    return Clash(total, worst, pair)


def worst_in_step(
    structure: Structure, slits: Iterable[str], lams: Iterable[float], n: int = 200
) -> tuple[Clash, float, float]:
    """Return the deepest clash of the in-step motion, where it is, and the largest total overlap area."""
    slits = list(slits)
    best, where, area = NO_CLASH, float("nan"), 0.0
    for lam in lams:
        found = clash(placed(structure, [float(lam)] * len(structure.cells), slits, n))
        area = max(area, found.area)
        if found.depth > best.depth:
            best, where = found, float(lam)
    return best, where, area
