"""Pockets for piano hinges between span segments: a groove for the pin's knuckles, and one for a leaf on each side.

The pin's axis lies in the panel's face at the cut (`motion.spanwise`), so that segments fold face onto face; half of
the knuckles stands out of it. Where the face meets another panel's when deployed, that one has a groove, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from ori_deploy.export.kernel import Body, around, punch
from ori_deploy.export.parts_spec import SpanHingeSpec
from ori_deploy.export.workpiece import Cut, Workpiece, take_together
from ori_deploy.motion import Mechanism
from ori_deploy.motion.spanwise import SpanHinge
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

_PLACES = 41
"""Places along a hinge's line at which the panel's thickness is looked at."""
_FOLDS = 1.0 - np.linspace(0.0, 1.0, 41) ** 2
"""Folds at which the knuckles' way is looked at: most of them where faces part."""
_CRUMB = 1e-3
"""Part of the knuckles' section that may run into a panel: rounding, and no more."""
_REMEDY = "a thinner hinge, or a larger wall_m in the specification"

Segment = Mapping[int, Workpiece]
"""Parts of a span segment, by panel."""


@dataclass(frozen=True)
class _Line:
    """A hinge's line: ends (3,), a unit vector along it and one out of the panel that carries it."""

    first: Vectors
    last: Vectors
    along: Vectors
    outward: Vectors

    @property
    def length(self) -> float:
        return float((self.last - self.first) @ self.along)

    @property
    def middle(self) -> Vectors:
        return np.asarray(0.5 * (self.first + self.last))

    def bar(self, radius: float, before: float, after: float) -> Body:
        """A round bar about the line, reaching beyond its ends."""
        up = np.cross(self.along, self.outward)
        return punch([around(radius)], self.first, self.outward, up, before, self.length + after)

    def strip(self, half: float) -> Reals:
        """(4, 2) corners of the bar, seen along the span."""
        ends = np.array([self.first, self.last, self.last, self.first])
        return np.asarray((ends + half * np.array([[-1.0], [-1.0], [1.0], [1.0]]) * self.outward)[:, :2])


def let_in_hinge(
    segments: tuple[Segment, Segment], panel: int, hinge: SpanHinge, mechanism: Mechanism, spec: SpanHingeSpec
) -> None:
    """Cut a hinge's pockets into the panel that carries it, in both segments, and room for it into what faces it.

    Parameters
    ----------
    segments
        Before the cut, and behind it.
    panel
        The panel that carries it.
    """
    pin, leaf, thick = (1e-3 * x for x in (0.5 * spec.pin_diameter_mm, spec.leaf_width_mm, spec.leaf_thickness_mm))
    radius = pin + 1e-3 * spec.clearance_mm
    own = [segment[panel] for segment in segments]
    whole = _whole(own[0], hinge, leaf)
    others = [p for p in segments[0] if p != panel]
    across = int(mechanism.layout.neighbour[panel])
    faced = [p for p in others if p == across and _overlap(segments[0][p], whole, pin)]
    line, found = _fitted(segments, panel, faced, whole, radius, leaf)
    if line.length < leaf:
        value = f"{1e3 * float(np.median(found)):.2f} mm of panel, {1e3 * line.length:.1f} mm of it thick enough"
        needed = f"{1e3 * (radius + own[0].wall_m):.2f} mm: hinge and thinnest wall, over {1e3 * leaf:g} mm"
        return _tell(own, hinge, value, needed, _REMEDY)
    cuts = _own_cuts(own, line, hinge, radius, leaf, thick)
    for other in others:
        way = _way(segments[0][other], panel, other, line, pin, mechanism)
        if way is None:
            continue
        before, after, deep = way
        if other not in faced or deep > radius:
            value = f"its knuckles run {1e3 * deep:.2f} mm into {segments[0][other].id} while the cells fold"
            limit = f"{1e3 * radius if other in faced else 0.0:.2f} mm"
            return _tell(own, hinge, value, limit, "a thinner hinge, or a larger span_hinge.clearance_mm")
        gap = 1e-3 * spec.clearance_mm
        for segment in segments:
            tool = line.bar(radius, max(before, 0.0) + gap, max(after, 0.0) + gap)
            cuts.append((segment[other], Cut(tool, "pin", f"room for the pin of {hinge.id}", line.middle)))
    if take_together(cuts) and line.length < hinge.length_m - 2.0 * own[0].wall_m:
        value, limit = (
            f"{1e3 * line.length:.1f} mm of thick enough panel",
            f"{1e3 * hinge.length_m:.1f} mm of flat face",
        )
        _tell(own, hinge, value, limit, _REMEDY, left_out=False)
    return None


def _tell(
    own: list[Workpiece], hinge: SpanHinge, value: str, limit: str, remedy: str, *, left_out: bool = True
) -> None:
    for piece in own:
        piece.remark(f"piano hinge {hinge.id}", value, limit, remedy, left_out=left_out)


def _fitted(
    segments: tuple[Segment, Segment], panel: int, faced: list[int], line: _Line, radius: float, leaf: float
) -> tuple[_Line, Reals]:
    """The longest part of a line where all parts are thick enough, and (n,) the least thickness along all of it."""
    places = line.first + np.linspace(0.0, 1.0, _PLACES)[:, None] * (line.last - line.first)
    found = np.full(_PLACES, np.inf)
    for segment in segments:
        for p in (panel, *faced):
            into = -line.outward if p == panel else line.outward
            at = places + 0.5 * leaf * _up(segment[p], line.first)
            found = np.minimum(found, segment[p].room(at, into, radius))
    run = _longest(found >= radius + segments[0][panel].wall_m)
    return _Line(places[run[0]], places[run[1]], line.along, line.outward), found


def _whole(piece: Workpiece, hinge: SpanHinge, leaf: float) -> _Line:
    """The hinge along all of its panel's flat face."""
    ends = hinge.line_m
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    up = _up(piece, ends[0])
    outward = _outward(piece, ends.mean(axis=0) + 0.5 * leaf * up, np.cross(along, up))
    return _Line(ends[0], ends[1], along, outward)


def _up(piece: Workpiece, at: Vectors) -> Vectors:
    """(3,) along the span, from a cut into a part."""
    return np.array([0.0, 0.0, 1.0 if abs(piece.s_low - at[2]) < abs(piece.s_high - at[2]) else -1.0])


def _own_cuts(
    own: list[Workpiece], line: _Line, hinge: SpanHinge, radius: float, leaf: float, thick: float
) -> list[tuple[Workpiece, Cut]]:
    """Leaf and groove in the carrying panel's parts."""
    cuts = []
    drawn = np.array([[0.0, -leaf], [line.length, -leaf], [line.length, leaf], [0.0, leaf]])
    share = np.linspace(0.1, 0.9, 9)[:, None]
    for piece in own:
        up = _up(piece, line.first)
        tool = punch([drawn], line.first, line.along, np.cross(line.outward, line.along), thick, thick)
        under = line.first + share * (line.last - line.first) - thick * line.outward
        floor = under + 0.5 * (leaf + radius) * up
        name = f"leaf of {hinge.id}"
        cuts.append((piece, Cut(tool, "leaf", name, line.middle, line.length, floor=floor, into=-line.outward)))
        cuts.append((piece, Cut(line.bar(radius, 0.0, 0.0), "pin", f"pin of {hinge.id}", line.middle)))
    return cuts


def _overlap(piece: Workpiece, line: _Line, half: float) -> bool:
    """Whether knuckles run into a panel when deployed."""
    shared = Polygon(line.strip(half)).intersection(Polygon(piece.shape.points))
    return bool(shared.area > _CRUMB * half * line.length)


def _way(
    piece: Workpiece, panel: int, other: int, line: _Line, half: float, mechanism: Mechanism
) -> tuple[float, float, float] | None:
    """How far knuckles run into another panel on their way.

    Returns
    -------
    Beyond the first and the last end of the line, told on the other panel when deployed, and away from the line;
    None where they never touch it.
    """
    poses = mechanism.poses(_FOLDS)
    corners = line.strip(half) @ np.array([1.0, 1.0j])
    there = poses.turn[panel][:, None] * corners + poses.shift[panel][:, None]
    seen = np.conj(poses.turn[other])[:, None] * (there - poses.shift[other][:, None])
    section = Polygon(piece.shape.points)
    found = []
    for moved in seen:
        shared = Polygon(np.column_stack([moved.real, moved.imag])).intersection(section)
        if shared.area > _CRUMB * half * line.length:
            found.append(np.concatenate([np.asarray(p.exterior.coords) for p in getattr(shared, "geoms", [shared])]))
    if not found:
        return None
    away = np.concatenate(found) - line.first[:2]
    along, out = away @ line.along[:2], away @ line.outward[:2]
    return float(-along.min()), float(along.max()) - line.length, float(np.abs(out).max())


def _longest(fits: NDArray[np.bool_]) -> tuple[int, int]:
    """First and last place of the longest run of places that fit; the same twice where none does."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], fits, [False]]).astype(int)))
    runs = edges.reshape(-1, 2)
    if not len(runs):
        return 0, 0
    start, stop = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
    return int(start), int(stop) - 1


def _outward(piece: Workpiece, at: Vectors, either: Vectors) -> Vectors:
    """The direction, of two opposite ones, that leaves the panel at a place on its face."""
    inside: Reals = piece.depth(np.array([at, at]), np.array([either, -either]))
    return -either if inside[0] > inside[1] else either
