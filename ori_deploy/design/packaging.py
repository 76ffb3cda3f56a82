"""How small the folded stack is."""

from __future__ import annotations

import numpy as np

from ori_deploy.profiles import xy
from ori_deploy.profiles.profile import Points


def smallest_box(points: Points) -> tuple[float, float]:
    """Sides (longer, shorter) of the smallest rectangle, in any direction, round points of the plane."""
    turned = np.conj(box_axis(points)) * points
    a, b = float(np.ptp(turned.real)), float(np.ptp(turned.imag))
    return max(a, b), min(a, b)


def box_axis(points: Points) -> complex:
    """Unit direction of a side of the smallest rectangle round points of the plane.

    One side of it lies on a side of the convex hull, so every hull side is tried.
    """
    from scipy.spatial import ConvexHull  # loaded by those who need it only: it takes 0.1 s

    hull = points[ConvexHull(xy(points)).vertices]
    side = np.roll(hull, -1) - hull
    axis = side / np.abs(side)
    turned = np.conj(axis)[:, None] * hull[None]
    length, height = np.ptp(turned.real, axis=1), np.ptp(turned.imag, axis=1)
    return complex(axis[int(np.argmin(length * height))])
