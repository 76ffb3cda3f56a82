"""Panels as convex pieces that may touch: prisms of a cylinder, pieces of shell of a cone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, affinity, box
from shapely.geometry.base import BaseGeometry

from ori_deploy.design import ConeStructure, Structure

FloatArray = NDArray[np.float64]

SAGITTA = 1e-3
"""Of the outlines, relative to the profile's size."""

CLEARANCE = 4e-4
"""By how much panels are made smaller, relative to the profile's size: faces that touch by design do not push."""

_BULGE = 0.01
"""Share of a piece's area by which its hull may be larger."""
_DEEPEST = 5


def panel_pieces(structure: Structure | ConeStructure, panel: int, r_min_m: float, span_m: float) -> list[FloatArray]:
    """Corners (k, 3) of the convex pieces of one panel, deployed, in the design's coordinates, metres.

    A panel that is thinner than twice the clearance has none.
    """
    size = structure.profile.size
    if isinstance(structure, Structure):
        z = structure.panel_outline(panel, SAGITTA * size)
        flat = convex_pieces(np.stack([z.real, z.imag], axis=1), CLEARANCE * size)
        return [np.concatenate([_at(p, 0.0), _at(p, span_m)]) for p in flat]
    u = structure.panel_outline(panel, SAGITTA * size)
    profile = structure.profile
    # Seen from the apex on the plane z = 1 great circles are straight, so what is convex stays so.
    flat = convex_pieces(u[:, :2] / u[:, 2:], CLEARANCE * size)
    made = []
    for piece in flat:
        ray = _at(piece, 1.0)
        ray = profile.to_user(ray / np.linalg.norm(ray, axis=1)[:, None])
        made.append(np.concatenate([profile.apex + r * ray for r in (max(r_min_m, 0.02 * span_m), r_min_m + span_m)]))
    return made


def _at(points: FloatArray, z: float) -> FloatArray:
    return np.column_stack([points, np.full(len(points), z)])


def convex_pieces(outline: FloatArray, clearance: float) -> list[FloatArray]:
    """Corners (k, 2) of convex pieces that cover a simple polygon (n, 2) made smaller by `clearance`."""
    small = Polygon(outline).buffer(-clearance, join_style="mitre")
    return [piece for part in _polygons(small) for piece in _cut(part, clearance, 0)]


def _cut(polygon: Polygon, clearance: float, depth: int) -> list[FloatArray]:
    hull = polygon.convex_hull
    if polygon.area <= clearance**2 or not isinstance(hull, Polygon):
        return []
    if hull.area - polygon.area <= _BULGE * polygon.area or depth == _DEEPEST:
        return [np.array(hull.exterior.coords)[:-1]]
    corners = np.array(polygon.minimum_rotated_rectangle.exterior.coords)
    sides = np.diff(corners[:3], axis=0)
    angle = float(np.arctan2(*sides[np.argmax(np.hypot(*sides.T))][::-1]))
    middle = polygon.minimum_rotated_rectangle.centroid
    reach = 2.0 * float(np.hypot(*sides.T).max())
    half = box(middle.x, middle.y - reach, middle.x + reach, middle.y + reach)
    half = affinity.rotate(half, angle, origin=middle, use_radians=True)
    parts = [*_polygons(polygon.intersection(half)), *_polygons(polygon.difference(half))]
    return [piece for part in parts for piece in _cut(part, clearance, depth + 1)]


def _polygons(shape: BaseGeometry) -> list[Polygon]:
    parts = getattr(shape, "geoms", [shape])
    return [part for part in parts if isinstance(part, Polygon) and not part.is_empty]
