"""The room that a cone's folded stack takes: the smallest box found round it.

The stack is what spherical polygons sweep between two radii. A box about three axes is measured exactly:
the farthest point in a direction lies on the outer sphere, at a corner, on a side, or, where the direction
itself lies in a panel, in the middle of it.

The search is a local one from many starts. For a given axis the smallest rectangle across it is known exactly; so
starts are the directions in which the stack is thin, faces of its convex hull, and each is turned about
its own three axes in turn until no turn makes it smaller.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ori_deploy.design.packaging import box_axis
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors, arc, cross, dot, unit

_SIDE_STEP_RAD = 0.02
"""Longest piece of a side between points that guide the search; its box is then measured exactly."""

_STARTS = 24
_SETTLED = 6
"""Directions that are tried, and the best of them that are followed to the smallest box near by."""

_APART_RAD = 0.02
"""Directions nearer to each other than this lead to the same box."""

_GAIN = 1e-7
"""Relative gain in volume below which a box is the smallest of its surroundings."""


def stack_box(outlines: tuple[Vectors, ...], r_min_m: float, r_max_m: float) -> tuple[float, float, float]:
    """Sides (longest first) of the smallest box found round polygons extruded between two radii.

    Parameters
    ----------
    outlines
        (k, 3) corners of each polygon on the unit sphere, counter-clockwise, joined by arcs of great circles.
    r_min_m, r_max_m
        Radii, metres.
    """
    from scipy.spatial import ConvexHull  # loaded by those who need it only: it takes 0.1 s

    start = np.concatenate(outlines)
    stop = np.concatenate([np.roll(o, -1, axis=0) for o in outlines])
    owner = np.repeat(np.arange(len(outlines)), [len(o) for o in outlines])
    rim = _along_sides(start, stop)
    points = np.concatenate([rim * r_max_m, rim * r_min_m] if r_min_m > 0.0 else [rim * r_max_m, np.zeros((1, 3))])
    points = points[ConvexHull(points).vertices]
    starts = sorted(_starts(points), key=lambda axes: _volume(points, axes))[:_SETTLED]
    best = min((_settled(points, axes) for axes in starts), key=lambda axes: _volume(points, axes))
    sides = [
        _support(start, stop, owner, a, r_min_m, r_max_m) + _support(start, stop, owner, -a, r_min_m, r_max_m)
        for a in best
    ]
    longest, middle, shortest = sorted(sides, reverse=True)
    return longest, middle, shortest


def _along_sides(start: Vectors, stop: Vectors) -> Vectors:
    count = np.maximum(np.ceil(arc(start, stop) / _SIDE_STEP_RAD), 1.0).astype(int)
    side = np.repeat(np.arange(len(start)), count)
    part = ((np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)) / count[side])[:, None]
    return unit((1.0 - part) * start[side] + part * stop[side])


def _support(
    start: Vectors, stop: Vectors, owner: NDArray[np.intp], axis: Vectors, r_min_m: float, r_max_m: float
) -> float:
    """Largest coordinate along an axis, exactly."""
    pole = unit(cross(start, stop))
    beside = (dot(cross(pole, start), axis) > 0.0) & (dot(cross(pole, stop), axis) < 0.0)
    on_side = np.sqrt(np.maximum(1.0 - (pole @ axis) ** 2, 0.0))
    most = float(np.where(beside, on_side, np.maximum(start @ axis, stop @ axis)).max())
    # A polygon holds the axis where its sides, seen from the axis, go round once.
    turn = np.arctan2(cross(start, stop) @ axis, dot(start, stop) - (start @ axis) * (stop @ axis))
    if (np.bincount(owner, turn) > np.pi).any():
        most = 1.0
    return most * (r_max_m if most > 0.0 else r_min_m)


def _volume(points: Reals, axes: Reals) -> float:
    return float(np.prod(np.ptp(points @ axes.T, axis=0)))


def _starts(points: Reals) -> list[Reals]:
    """Boxes that stand on faces of the hull, thin ones first."""
    from scipy.spatial import ConvexHull

    normals = ConvexHull(points).equations[:, :3]
    order = np.argsort(np.ptp(points @ normals.T, axis=0), kind="stable")
    chosen: list[Reals] = []
    for k in order:
        if all(abs(float(normals[k] @ other)) < np.cos(_APART_RAD) for other in chosen):
            chosen.append(normals[k])
        if len(chosen) == _STARTS:
            break
    return [_turned(points, _frame(normal), 0) for normal in chosen]


def _frame(normal: Reals) -> Reals:
    """(3, 3) orthonormal rows, the first along `normal`."""
    side = unit(cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))]))
    return np.stack([normal, side, cross(normal, side)])


def _turned(points: Reals, axes: Reals, about: int) -> Reals:
    """The smallest box about the same one axis."""
    b, c = axes[(about + 1) % 3], axes[(about + 2) % 3]
    along = box_axis(points @ b + 1j * (points @ c))
    new = axes.copy()
    new[(about + 1) % 3] = along.real * b + along.imag * c
    new[(about + 2) % 3] = -along.imag * b + along.real * c
    return new


def _settled(points: Reals, axes: Reals) -> Reals:
    """Turned about each axis in turn until none gains."""
    volume, about, idle = _volume(points, axes), 1, 0
    while idle < 3:
        new = _turned(points, axes, about % 3)
        smaller = _volume(points, new)
        if smaller < volume * (1.0 - _GAIN):
            axes, volume, idle = new, smaller, 0
        else:
            idle += 1
        about += 1
    return axes
