"""Magnet pockets in both faces of every slit, with a mark of polarity beside each.

Facing pockets share one axis, and their magnets attract: north (+) looks out of the one face, south (−) out of the
other, by turns along the slit so that it cannot close a step out of place. The turns go on from one span segment to
the next, so that faces which meet when the span is folded attract, too: a magnet's partner there is as far behind the
cut as it is before it, an odd number of magnets further.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ori_deploy.export.kernel import circle, punch
from ori_deploy.export.parts_spec import PartsSpec
from ori_deploy.export.recesses import film_row
from ori_deploy.export.workpiece import Cut, Plane, Workpiece, take_together
from ori_deploy.profiles.profile import Reals

_RIM = 8
"""Places round a pocket at which the panel's thickness is looked at."""
_BARE = 1e-6
"""How far below a finished face, metres, a shape begins that has to lie within the panel."""
_FIRM = 0.95
"""Part of a wall that is asked for beside another pocket: holes are polygons, their corners stand off the circle."""
_ON_FACE = 1e-9
"""How far a film may be from a face, metres, to lie on it; and how far one minus the cosine of their directions."""


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
    segment
        Which of the span, from 0.
    """

    name: str
    pieces: tuple[Workpiece, Workpiece]
    clear_m: float
    segment: int

    def planes(self) -> tuple[Plane, Plane] | None:
        """Their faces, both told from the opening vertex; None where a panel has none."""
        first, second = self.pieces[0].plane("back", True), self.pieces[1].plane("back", False)
        return None if first is None or second is None else (first, second)

    def sides(self, planes: tuple[Plane, Plane]) -> Iterator[tuple[Workpiece, Plane]]:
        """Each part with its face."""
        return zip(self.pieces, planes, strict=True)


def set_magnets(slit: Slit, spec: PartsSpec) -> None:
    """Cut pockets and marks along a slit, each as near to the opening vertex as both panels are thick enough."""
    planes = slit.planes()
    if planes is None:
        for piece in slit.pieces:
            piece.remark(f"magnets {slit.name}", "no face at the slit", "a face of both panels", "another slit")
        return
    made, best = 0, 0.0
    stations = _stations(slit, spec)
    for number, s in enumerate(stations):
        a, thick = _place(slit, planes, s, spec)
        if a is None:
            best = max(best, thick)
            continue
        # Signs go on over all segments, names begin anew in each.
        signs = ("+", "−") if (slit.segment * len(stations) + number) % 2 == 0 else ("−", "+")
        sides = [(*side, sign) for side, sign in zip(slit.sides(planes), signs, strict=True)]
        named = [(piece, plane, f"{slit.name} {number + 1} {sign}", sign) for piece, plane, sign in sides]
        if take_together([(piece, _pocket(plane, s, a, spec, f"magnet {name}")) for piece, plane, name, _ in named]):
            made += 1
            for piece, plane, name, sign in named:
                _mark(piece, plane, s, a, sign, spec, f"mark {name}")
    if made < len(stations):
        _tell(slit, spec, made, len(stations), best)


def _tell(slit: Slit, spec: PartsSpec, made: int, wanted: int, best: float) -> None:
    """Say of both panels how many magnets are missing."""
    needed = 1e3 * _depth_m(spec) + spec.print.wall_mm
    beside = ", other pockets beside it" if 1e3 * best >= needed else ""
    for piece in slit.pieces:
        piece.remark(
            f"magnets {slit.name}: {wanted - made} of {wanted}",
            f"{1e3 * best:.2f} mm of panel in one place{beside}",
            f"{needed:.2f} mm over {spec.magnet.pocket_mm + 2.0 * spec.print.wall_mm:.1f} mm",
            "smaller or thinner magnets, a larger wall_m in the specification, or another slit",
        )


def _depth_m(spec: PartsSpec) -> float:
    """Depth of a pocket below the design's face: what the finished face lies back, and the pocket below that."""
    return 1e-3 * (spec.clearance.slit_mm + spec.magnet.pocket_depth_mm)


def _stations(slit: Slit, spec: PartsSpec) -> Reals:
    """Places along the span, spread evenly."""
    piece = slit.pieces[0]
    end = slit.clear_m + 0.5e-3 * spec.magnet.pocket_mm + piece.wall_m
    low, high = piece.s_low + end, piece.s_high - end
    if high < low:
        return np.array([0.5 * (piece.s_low + piece.s_high)])
    count = max(2, round((high - low) / (1e-3 * spec.magnet.spacing_mm)))
    count = max(1, min(count, int((high - low) / (1e-3 * spec.magnet_pitch_mm))))
    step = (high - low) / count
    return np.asarray(low + step * (np.arange(count) + 0.5))


def _place(slit: Slit, planes: tuple[Plane, Plane], s: float, spec: PartsSpec) -> tuple[float | None, float]:
    """How far from the opening vertex a pocket fits into both panels; or None, and how deep the best place is."""
    wall, radius, depth = slit.pieces[0].wall_m, 0.5e-3 * spec.magnet.pocket_mm, _depth_m(spec)
    reach = radius + wall
    first = reach + max(_under_film(piece, plane, s, 1e-3 * spec.film.glue_mm) for piece, plane in slit.sides(planes))
    last = min(plane.width(s) for plane in planes) - reach
    angle = 2.0 * np.pi * np.arange(_RIM) / _RIM
    ring = np.vstack([np.zeros((1, 2)), reach * np.column_stack([np.cos(angle), np.sin(angle)])])
    guard, best = circle(radius + _FIRM * wall), 0.0
    for a in np.arange(first, last, 0.25 * radius):
        thick = min(_room(piece, plane, s, float(a), ring, depth) for piece, plane in slit.sides(planes))
        best = max(best, thick)
        if thick >= depth + wall and all(
            _held(*side, s, float(a), [guard], depth, spec) for side in slit.sides(planes)
        ):
            return float(a), best
    return None, best


def _under_film(piece: Workpiece, plane: Plane, s: float, glue_m: float) -> float:
    """How much of the face's width, at a place along the span, the opening crease's film covers; 0 if none."""
    strip, _ = film_row(piece.shape, True, glue_m, piece.s_high)
    if strip is None or len(strip) != 2:
        return 0.0
    turned = 1.0 - float(strip.normals(piece.s_high)[0] @ plane.outward)
    off = (strip.at(piece.s_high) - plane.point(piece.s_high, 0.0)) @ plane.outward
    if turned > _ON_FACE or np.abs(off).max() > _ON_FACE:
        return 0.0
    return float(strip.widths(piece.s_high)[0]) * (s / piece.s_high if piece.shape.on_cone else 1.0)


def _room(piece: Workpiece, plane: Plane, s: float, a: float, ring: Reals, depth: float) -> float:
    """The least thickness under a floor round a place on a face, at places (n, 2) from its middle."""
    at = plane.point(s, a) + ring[:, :1] * plane.along + ring[:, 1:] * plane.across
    return float(piece.room(at, -plane.outward, depth).min())


def _held(
    piece: Workpiece, plane: Plane, s: float, a: float, drawn: list[Reals], depth: float, spec: PartsSpec
) -> bool:
    """Whether a shape and a wall below it lie within the panel, from its finished face on."""
    under = 1e-3 * spec.clearance.slit_mm + _BARE
    up = np.cross(plane.outward, plane.along)
    return piece.holds(punch(drawn, plane.point(s, a), plane.along, up, depth + piece.wall_m, -under))


def _pocket(plane: Plane, s: float, a: float, spec: PartsSpec, name: str) -> Cut:
    """A magnet's pocket."""
    at, radius, depth = plane.point(s, a), 0.5e-3 * spec.magnet.pocket_mm, _depth_m(spec)
    tool = punch([circle(radius)], at, plane.along, np.cross(plane.outward, plane.along), depth, depth)
    angle = 2.0 * np.pi * np.arange(_RIM) / _RIM
    rim = 0.95 * radius * np.vstack([[[0.0, 0.0]], np.column_stack([np.cos(angle), np.sin(angle)])])
    floor = at - depth * plane.outward + rim[:, :1] * plane.along + rim[:, 1:] * plane.across
    return Cut(tool, "magnet", name, at, floor=floor, into=-plane.outward)


def _mark(piece: Workpiece, plane: Plane, s: float, a: float, sign: str, spec: PartsSpec, name: str) -> None:
    """A plus or a minus beside a pocket, along the span."""
    half, bar = 0.5e-3 * spec.magnet.mark_mm, 0.125e-3 * spec.magnet.mark_mm
    if half == 0.0:
        return
    depth = 1e-3 * (spec.clearance.slit_mm + spec.text.depth_mm)
    away = float(circle(0.5e-3 * spec.magnet.pocket_mm).max()) + piece.wall_m + half
    corners = (half + _FIRM * piece.wall_m) * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    at = next((x for x in (s + away, s - away) if _held(piece, plane, x, a, [corners], depth, spec)), None)
    if at is None:
        piece.remark(
            name,
            "no room beside the pocket",
            f"{spec.magnet.mark_mm:g} mm, a wall round it and {1e3 * depth + spec.print.wall_mm:.2f} mm of panel",
            "a smaller magnet.mark_mm or text.depth_mm",
        )
        return
    where = plane.point(at, a)
    up = np.cross(plane.outward, plane.along)
    tool = punch([_sign(half, bar, sign)], where, plane.along, up, depth, depth)
    floor = (where - depth * plane.outward)[None]
    piece.take(Cut(tool, "mark", name, where, floor=floor, into=-plane.outward))


def _sign(half: float, bar: float, sign: str) -> Reals:
    """(n, 2) outline of a plus or a minus, counter-clockwise."""
    if sign != "+":
        return np.array([[-half, -bar], [half, -bar], [half, bar], [-half, bar]])
    arm = [[half, -bar], [half, bar], [bar, bar], [bar, half], [-bar, half], [-bar, bar]]
    corners = np.array(arm)
    return np.vstack([corners, -corners])
