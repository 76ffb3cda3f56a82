"""Part numbers, engraved into inner faces beside the film: hidden in the void when deployed."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from shapely import Polygon
from shapely.geometry.polygon import orient

from ori_deploy.export.kernel import punch, triangulated
from ori_deploy.export.parts_spec import TextSpec
from ori_deploy.export.workpiece import Cut, Plane, Workpiece
from ori_deploy.profiles.profile import Reals

_EM = 0.76
"""Height of the tallest letters over the font's size."""


@cache
def _letters(text: str) -> tuple[tuple[Reals, ...], float]:
    """Outlines of a text of height 1, its middle in the origin, and its length; holes run clockwise."""
    path = TextPath((0.0, 0.0), text, size=1.0 / _EM, prop=FontProperties(family="DejaVu Sans"))
    rings = sorted(
        (Polygon(p) for p in map(np.asarray, path.to_polygons()) if len(p) > 3), key=lambda ring: -ring.area
    )
    solid = Polygon()
    for ring in rings:  # the larger ones first: what lies inside one is a hole
        solid = solid.symmetric_difference(ring.buffer(0.0))
    solid = solid.simplify(0.004)
    left, low, right, high = solid.bounds
    middle = 0.5 * np.array([left + right, low + high])
    loops = []
    for part in getattr(solid, "geoms", [solid]):
        whole = orient(part)
        loops += [np.asarray(ring.coords)[:-1] - middle for ring in (whole.exterior, *whole.interiors)]
    return tuple(loops), float(right - left)


def engrave(piece: Workpiece, spec: TextSpec, beside_m: float) -> None:
    """Cut a part's id into its inner face.

    Parameters
    ----------
    beside_m
        Width of the face along the closing crease that the film takes.
    """
    plane = piece.plane("inner", piece.shape.panel % 2 == 0)
    height, depth = 1e-3 * spec.height_mm, 1e-3 * spec.depth_mm
    loops, ratio = _letters(piece.id)
    length = ratio * height
    name = f"part number {piece.id}"
    if plane is None:
        piece.remark(name, "no inner face", f"{spec.height_mm:g} mm", "a larger wall_m")
        return
    found = {s: _room(piece, plane, s, (length, height), beside_m, depth) for s in _stations(piece, length)}
    s = next((s for s, (_, deep) in found.items() if deep >= depth + piece.wall_m), None)
    if s is None:
        width, deep = max(found.values(), key=lambda room: room[1], default=(0.0, 0.0))
        piece.remark(
            name,
            f"{1e3 * width:.1f} mm of face beside the film, {1e3 * deep:.2f} mm thick",
            f"{spec.height_mm + 2e3 * piece.wall_m:.1f} mm, {1e3 * (depth + piece.wall_m):.2f} mm",
            "smaller letters, or a narrower film.glue_mm",
        )
        return
    # A mirrored frame would show the letters from behind.
    mirrored = float(np.linalg.det(piece.to_user[:3, :3])) < 0.0
    drawn = [height * loop for loop in loops]
    if mirrored:
        drawn = [np.ascontiguousarray((loop * np.array([-1.0, 1.0]))[::-1]) for loop in drawn]
    at = plane.point(s, beside_m + 0.5 * (found[s][0]))
    up = np.cross(plane.outward, plane.along)
    flat = np.concatenate(drawn)[triangulated(drawn)].mean(axis=1)
    floor = at - depth * plane.outward + flat[:, :1] * plane.along + flat[:, 1:] * up
    tool = punch(drawn, at, plane.along, up, depth, depth)
    piece.take(Cut(tool, "text", name, at, floor=floor, into=-plane.outward))


def _stations(piece: Workpiece, length: float) -> list[float]:
    """Where along the span the text may have its middle: in the middle of the part, or nearer a cone's wide end."""
    high = piece.s_high - 0.5 * length - 2.0 * piece.wall_m
    middle = 0.5 * (piece.s_low + piece.s_high)
    return [s for s in (middle, 0.5 * (middle + high), high) if s - 0.5 * length > piece.s_low + piece.wall_m]


def _room(
    piece: Workpiece, plane: Plane, s: float, size: tuple[float, float], beside: float, depth: float
) -> tuple[float, float]:
    """Width of face beside the film, and the least thickness under the text; none where it is too narrow."""
    length, height = size
    x = 0.5 * length * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    width = min(plane.width(s + x[0]), plane.width(s + x[-1])) - beside
    if width < height + 2.0 * piece.wall_m:
        return max(width, 0.0), 0.0
    across = beside + 0.5 * width + 0.5 * height * np.array([-1.0, 0.0, 1.0])
    at = np.array([plane.point(s + dx, a) for dx in x for a in across])
    return width, float(piece.room(at, -plane.outward, depth).min())
