"""Arithmetic of points on the unit sphere.

A point is a unit vector, the last axis of an array; a great circle is its pole, the unit normal of its
plane. A point `p` lies left of a great circle with pole `n`, seen from outside, where `n·p > 0`.
Everything here is plain arithmetic, so numbers that carry derivatives may run through it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vectors = NDArray[np.float64]
"""(..., 3)."""
Reals = NDArray[np.float64]


def dot(a: Vectors, b: Vectors) -> Reals:
    """(...,) dot products."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def cross(a: Vectors, b: Vectors) -> Vectors:
    """(..., 3) cross products."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )


def length(a: Vectors) -> Reals:
    """(...,) lengths."""
    size: Reals = np.sqrt(dot(a, a))
    return size


def unit(a: Vectors) -> Vectors:
    """(..., 3) vectors scaled to length 1."""
    return a / length(a)[..., None]


def arc(a: Vectors, b: Vectors) -> Reals:
    """(...,) arcs between points, radians; as good for near points as for far ones."""
    angle: Reals = np.arctan2(length(cross(a, b)), dot(a, b))
    return angle


def excess(a: Vectors, b: Vectors, c: Vectors) -> Reals:
    """(...,) signed solid angles of spherical triangles, steradians; positive counter-clockwise.

    Van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125.
    """
    half: Reals = np.arctan2(dot(a, cross(b, c)), 1.0 + dot(a, b) + dot(b, c) + dot(c, a))
    return 2.0 * half


def polygon_excess(corners: Vectors, centre: Vectors) -> Reals:
    """(...,) signed solid angles of polygons (..., k, 3) whose sides are arcs of great circles.

    `centre` is any point within a right angle of all corners: sides are swept from it, so polygons
    that share sides add up without gaps.
    """
    ahead = np.concatenate([corners[..., 1:, :], corners[..., :1, :]], axis=-2)
    total: Reals = excess(centre, corners, ahead).sum(axis=-1)
    return total
