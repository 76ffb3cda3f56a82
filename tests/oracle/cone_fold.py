"""Folding a cone by brute force: loop closure by root finding, interference by sampling points.

Nothing is known here of spherical trigonometry: panels are turned about their creases one after the
other, and the angles are right when the fourth turn brings the first panel back to where it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from ori_deploy.layout import Layout

from .cone import ConeCell, between
from .curves import Array

STEP = 0.02
"""Fold from one root to the next: the root nearest to the last one is the same branch."""


def deployed_angles(cell: ConeCell) -> Array:
    """Return the angles about v1, c, v3, d of the deployed cell."""
    (a, b), (c, d) = cell.closing_angles, cell.opening_angles
    return np.array([a, c, b, d])


def chain(cell: ConeCell, change: Array) -> list[Rotation]:
    """Return the rotations of panels 0..3 and of 0 again, after angles about v1, c, v3, d grew by `change`."""
    at_v1, at_c, at_v3, at_d = change
    placed = [Rotation.identity()]
    for crease, angle in ((cell.c, at_c), (cell.v3, at_v3), (cell.d, at_d), (cell.v1, at_v1)):
        placed.append(placed[-1] * Rotation.from_rotvec(-angle * crease))
    return placed


def solve(cell: ConeCell, lam: float) -> Array:
    """Return the angles about v1, c, v3, d when that at v1 is `lam` times its deployed value.

    Followed from the deployed state in steps, so that no branch is ever chosen.
    """
    rest = deployed_angles(cell)
    change = np.zeros(4)
    for at in np.append(np.arange(1.0, lam, -STEP)[1:], lam):
        first = -(1.0 - at) * rest[0]
        found = root(lambda x, a=first: chain(cell, np.array([a, *x]))[4].as_rotvec(), change[1:], tol=1e-14)
        change = np.array([first, *found.x])
        if np.abs(chain(cell, change)[4].as_rotvec()).max() > 1e-11:
            raise ValueError(f"the loop does not close at {at}")
    return rest + change


def panels_of(cells: Sequence[ConeCell], layout: Layout, lams: Sequence[float]) -> list[Rotation]:
    """Return the rotation of every panel, panel 0 held still: cells hang on each other by what is bonded."""
    own = [chain(cell, solve(cell, lam) - deployed_angles(cell))[:4] for cell, lam in zip(cells, lams, strict=True)]
    base: dict[int, Rotation] = {0: Rotation.identity()}
    while len(base) < len(cells):
        before = len(base)
        for panel, other in enumerate(layout.bonded_to):
            (i, k), (j, m) = divmod(panel, 4), divmod(int(other), 4)
            if other >= 0 and i in base and j not in base:
                base[j] = base[i] * own[i][k] * own[j][m].inv()
        if len(base) == before:
            raise ValueError("the bonds do not join all cells")
    return [base[i] * own[i][k] for i in range(len(cells)) for k in range(4)]


def placed(cells: Sequence[ConeCell], layout: Layout, lams: Sequence[float], n: int = 60) -> list[Array]:
    """Return every panel's spherical polygon at a fold state."""
    turns = panels_of(cells, layout, lams)
    return [turn.apply(cells[p // 4].panel(p % 4, n)) for p, turn in enumerate(turns)]


def to_boundary(points: Array, polygon: Array) -> Array:
    """Return the arcs between points and the nearest point of a polygon's sides; negative inside the polygon."""
    p, q = polygon, np.roll(polygon, -1, axis=0)
    pole = np.cross(p, q)
    pole /= np.linalg.norm(pole, axis=1, keepdims=True)
    on_side = (points @ np.cross(pole, p).T >= 0.0) & (points @ np.cross(pole, q).T <= 0.0)
    across = np.abs(np.arcsin(np.clip(points @ pole.T, -1.0, 1.0)))
    apart = np.linalg.norm(points[:, None] - p, axis=2)
    to_end = 2.0 * np.arcsin(np.minimum(0.5 * apart, 1.0))
    nearest = np.minimum(np.where(on_side, across, np.inf).min(axis=1), to_end.min(axis=1))
    # Seen from a point inside, the sides go round once.
    turn = np.arctan2(points @ np.cross(p, q).T, (p * q).sum(axis=1) - (points @ p.T) * (points @ q.T)).sum(axis=1)
    return np.where(turn > np.pi, -nearest, nearest)


def boundary_points(polygon: Array, step: float) -> Array:
    """Return points on a polygon's sides, at most a step apart, all corners among them."""
    pieces = []
    for p, q in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        part = np.linspace(0.0, 1.0, max(1, int(np.ceil(between(p, q) / step))), endpoint=False)[:, None]
        pieces.append((1.0 - part) * p + part * q)
    points = np.concatenate(pieces)
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@dataclass(frozen=True)
class Clash:
    """The deepest point of one panel's boundary inside another panel, and the pair."""

    depth: float
    pair: tuple[int, int] | None


def deepest(points: Array, polygon: Array, parts: int = 40) -> float:
    """Return how deep a closed row of points dips into a polygon; between points inside it is looked at again."""
    depth = -to_boundary(points, polygon)
    ahead = np.roll(points, -1, axis=0)
    inside = (depth > 1e-9) | (np.roll(depth, -1) > 1e-9)  # bonded panels share whole sides
    if not inside.any():
        return 0.0
    part = np.linspace(0.0, 1.0, parts)[:, None, None]
    fine = ((1.0 - part) * points[inside] + part * ahead[inside]).reshape(-1, 3)
    return max(0.0, float(-to_boundary(fine / np.linalg.norm(fine, axis=1, keepdims=True), polygon).min()))


def clash(panels: Sequence[Array], step: float = 0.002) -> Clash:
    """Return the worst overlap among all pairs of panels."""
    points = [boundary_points(p, step) for p in panels]
    middles = [p.mean(axis=0) / np.linalg.norm(p.mean(axis=0)) for p in panels]
    reach = [max(between(m, q) for q in p) for m, p in zip(middles, panels, strict=True)]
    worst, pair = 0.0, None
    for i, moving in enumerate(points):
        for j, fixed in enumerate(panels):
            if i != j and between(middles[i], middles[j]) < reach[i] + reach[j]:
                depth = deepest(moving, fixed)
                if depth > worst:
                    worst, pair = depth, (min(i, j), max(i, j))
    return Clash(worst, pair)


def gap(one: Array, two: Array, step: float = 0.002) -> float:
    """Return the smallest arc between the boundaries of two panels."""
    return min(
        float(np.abs(to_boundary(boundary_points(one, step), two)).min()),
        float(np.abs(to_boundary(boundary_points(two, step), one)).min()),
    )
