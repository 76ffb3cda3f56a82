"""Magnet pockets in both faces of every slit, with a mark of polarity beside each.

Facing pockets share one axis, and their magnets attract: north (+) looks out of the one face, south (−) out of the
other, by turns along the slit so that it cannot close a step out of place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ori_deploy.export.kernel import circle, punch
from ori_deploy.export.parts_spec import MagnetSpec
from ori_deploy.export.workpiece import Plane, Workpiece
from ori_deploy.profiles.profile import Reals

_RIM = 8
"""Places round a pocket at which the panel's thickness is looked at."""


@dataclass(frozen=True)
class Slit:
    """Both parts that meet at a slit.

    Attributes
    ----------
    name
        "slit:P-O1".
    pieces
        First the even panel's, whose face runs towards the opening vertex.
    clear_m
        Part of the ends of the span that is taken by something else.
    """

    name: str
    pieces: tuple[Workpiece, Workpiece]
    clear_m: float

    def planes(self) -> tuple[Plane, Plane] | None:
        """Their faces, both told from the opening vertex; None where a panel has none."""
        first, second = self.pieces[0].plane("back", True), self.pieces[1].plane("back", False)
        return None if first is None or second is None else (first, second)


def set_magnets(slit: Slit, spec: MagnetSpec, mark_depth_m: float) -> None:
    """Cut pockets and marks along a slit, each as near to the opening vertex as both panels are thick enough."""
    planes = slit.planes()
    if planes is None:
        return
    radius, depth = 0.5e-3 * spec.pocket_mm, 1e-3 * spec.depth_mm
    made, best = 0, 0.0
    stations = _stations(slit, spec)
    for number, s in enumerate(stations):
        a, thick = _place(slit, planes, s, radius, depth)
        best = max(best, thick)
        if a is None:
            continue
        made += 1
        for side, (piece, plane) in enumerate(zip(slit.pieces, planes, strict=True)):
            sign = "+" if (number + side) % 2 == 0 else "−"
            at = plane.point(s, a)
            up = np.cross(plane.outward, plane.along)
            tool = punch([circle(radius)], at, plane.along, up, depth, depth)
            piece.cut(tool, "magnet", f"magnet {slit.name} {number + 1} {sign}", at)
            _mark(piece, plane, s, a, radius, sign, spec, mark_depth_m, f"mark {slit.name} {number + 1} {sign}")
    if made < len(stations):
        for piece in slit.pieces:
            piece.remark(
                f"magnets {slit.name}: {len(stations) - made} of {len(stations)}",
                f"{1e3 * best:.2f} mm of panel in one place",
                f"{spec.depth_mm + 1e3 * piece.wall_m:.2f} mm over {spec.pocket_mm + 2e3 * piece.wall_m:.1f} mm",
                "smaller or thinner magnets, a larger wall_m in the specification, or another slit",
            )


def _stations(slit: Slit, spec: MagnetSpec) -> Reals:
    """Places along the span, spread evenly."""
    piece = slit.pieces[0]
    end = slit.clear_m + 0.5e-3 * spec.pocket_mm + piece.wall_m
    low, high = piece.s_low + end, piece.s_high - end
    if high < low:
        return np.array([0.5 * (piece.s_low + piece.s_high)])
    count = max(2, round((high - low) / (1e-3 * spec.spacing_mm)))
    step = (high - low) / count
    return np.asarray(low + step * (np.arange(count) + 0.5))


def _place(
    slit: Slit, planes: tuple[Plane, Plane], s: float, radius: float, depth: float
) -> tuple[float | None, float]:
    """How far from the opening vertex a pocket fits into both panels; or None, and how deep the best place is."""
    wall = slit.pieces[0].wall_m
    reach = radius + wall
    last = min(plane.width(s) for plane in planes) - reach
    angle = 2.0 * np.pi * np.arange(_RIM) / _RIM
    ring = np.vstack([np.zeros((1, 2)), reach * np.column_stack([np.cos(angle), np.sin(angle)])])
    best = 0.0
    for a in np.arange(reach, last, 0.25 * radius):
        thick = min(_depth(piece, plane, s, float(a), ring) for piece, plane in zip(slit.pieces, planes, strict=True))
        best = max(best, thick)
        if thick >= depth + wall:
            return float(a), thick
    return None, best


def _depth(piece: Workpiece, plane: Plane, s: float, a: float, ring: Reals) -> float:
    """The least thickness under places (n, 2) round a place on a face."""
    at = plane.point(s, a) + ring[:, :1] * plane.along + ring[:, 1:] * plane.across
    return float(piece.depth(at, -plane.outward).min())


def _mark(
    piece: Workpiece,
    plane: Plane,
    s: float,
    a: float,
    radius: float,
    sign: str,
    spec: MagnetSpec,
    depth_m: float,
    name: str,
) -> None:
    """A plus or a minus beside a pocket, along the span."""
    half, bar = 0.5e-3 * spec.mark_mm, 0.125e-3 * spec.mark_mm
    if half == 0.0:
        return
    away = radius + piece.wall_m + half
    at = next(
        (x for x in (s + away, s - away) if piece.s_low + half < x < piece.s_high - half), None
    )  # fmt: skip
    if at is None:
        piece.remark(name, "no room beside the pocket", f"{spec.mark_mm:g} mm", "a smaller magnet.mark_mm")
        return
    ring = half * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    thick = _depth(piece, plane, at, a, ring)
    if thick < depth_m + piece.wall_m:
        limit = f"{1e3 * (depth_m + piece.wall_m):.2f} mm"
        piece.remark(name, f"{1e3 * thick:.2f} mm of panel", limit, "a smaller text.depth_mm")
        return
    where = plane.point(at, a)
    up = np.cross(plane.outward, plane.along)
    piece.cut(punch([_sign(half, bar, sign)], where, plane.along, up, depth_m, depth_m), "mark", name, where)


def _sign(half: float, bar: float, sign: str) -> Reals:
    """(n, 2) outline of a plus or a minus, counter-clockwise."""
    if sign != "+":
        return np.array([[-half, -bar], [half, -bar], [half, bar], [-half, bar]])
    arm = [[half, -bar], [half, bar], [bar, bar], [bar, half], [-bar, half], [-bar, bar]]
    corners = np.array(arm)
    return np.vstack([corners, -corners])
