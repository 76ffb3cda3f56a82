"""How small the folded stack is."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from ori_deploy.profiles import xy
from ori_deploy.profiles.profile import Points


def smallest_box(points: Points) -> tuple[float, float]:
    """Sides (longer, shorter) of the smallest rectangle, in any direction, round points of the plane.

    One side of it lies on a side of the convex hull, so every hull side is tried.
    """
    hull = points[ConvexHull(xy(points)).vertices]
    side = np.roll(hull, -1) - hull
    axis = np.conj(side / np.abs(side))
    turned = axis[:, None] * hull[None]
    length, height = np.ptp(turned.real, axis=1), np.ptp(turned.imag, axis=1)
    best = int(np.argmin(length * height))
    a, b = float(length[best]), float(height[best])
    return max(a, b), min(a, b)
