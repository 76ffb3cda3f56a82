"""What is under a crease's film, seen in sections of finished meshes: nothing here knows how recesses are made.

A section is taken across a crease. All plain panels together have an outline, on which opening creases lie, and voids
within their cells, on which closing ones do: from the crease along that line is what a film covers.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from shapely import LineString, Point, Polygon, unary_union
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from ori_deploy.design import Structure
from ori_deploy.export.parts import Part, Parts, build_parts
from ori_deploy.export.skeleton import Skeleton
from ori_deploy.motion import CREASES, NEXT_CREASE
from ori_deploy.profiles.profile import Reals

STEP = 0.02
"""Between the places that are looked at, millimetres."""
_NEAR = 1e-3


@dataclass(frozen=True)
class Columns:
    """What lies under places beside a crease, on one panel; millimetres.

    Attributes
    ----------
    x
        (n,) distances of the places from the crease.
    before, gap, left
        (n,) how thick the plain panel is, how far below its face the finished one begins, and how thick that is.
    """

    x: Reals
    before: Reals
    gap: Reals
    left: Reals


@dataclass(frozen=True)
class Films:
    """Sections of parts across their creases."""

    made: Parts
    known: dict[tuple[int, int, float, bool], BaseGeometry] = field(default_factory=dict)
    outlines: dict[tuple[float, int, int, int], LineString | None] = field(default_factory=dict)

    @cached_property
    def skeleton(self) -> Skeleton:
        return Skeleton(self.made.design)

    @cached_property
    def plain(self) -> Parts:
        return build_parts(self.made.design, self.made.spec, plain=True)

    @cached_property
    def whole(self) -> dict[tuple[int, int], Any]:
        return {(part.panel, part.segment): part.mesh(1e3) for part in self.plain.parts}

    @property
    def sides(self) -> list[tuple[Part, int]]:
        """Every part with the number of each of its two creases."""
        both = [
            (part, crease)
            for part in self.made.parts
            for crease in (NEXT_CREASE[part.panel % 4], NEXT_CREASE[part.panel % 4 - 1])
        ]
        # Sections of cones differ from crease to crease: one cell's are enough.
        return [(part, crease) for part, crease in both if part.panel < 4 or self.is_cylinder]

    @property
    def is_cylinder(self) -> bool:
        return isinstance(self.made.design.structure, Structure)

    def name(self, part: Part, crease: int) -> str:
        return self.skeleton.crease_names[part.panel // 4][crease]

    def _plane(self, part: Part, crease: int, s: float) -> tuple[Reals, Reals]:
        """A place `s` metres along a crease, millimetres, and the crease's direction."""
        near, far = 1e3 * self.skeleton.crease_ends[part.panel // 4, crease]
        axis = (far - near) / np.linalg.norm(far - near)
        low = 0.0 if self.is_cylinder else 1e3 * self.made.design.r_min_m
        return near + (1e3 * s - low) * axis, axis

    def _shape(self, part: Part, crease: int, s: float, plain: bool, of: Part) -> BaseGeometry:
        """A section of another part, or of that part when plain, about a crease."""
        origin, axis = self._plane(part, crease, s)
        if not self.is_cylinder:
            return _section(self.whole[of.panel, of.segment] if plain else of.mesh(1e3), origin, axis)
        key = of.panel, of.segment, s, plain
        if key not in self.known:
            mesh = self.whole[of.panel, of.segment] if plain else of.mesh(1e3)
            self.known[key] = _section(mesh, np.array([0.0, 0.0, origin[2]]), axis)
        return translate(self.known[key], *(-origin[:2]))

    def cut_mm2(self, part: Part, s: float) -> float:
        """How much of a part is gone in a section."""
        crease = NEXT_CREASE[part.panel % 4]
        before, after = (self._shape(part, crease, s, plain, part) for plain in (True, False))
        return float(before.area - after.area)

    def columns(self, part: Part, crease: int, s: float, width: float) -> Columns | None:
        """What is under the film's side on a part, `s` metres along the crease; None where it has no face there."""
        own, after = (self._shape(part, crease, s, plain, part) for plain in (True, False))
        key = s, part.segment, part.panel // 4, crease
        if key not in self.outlines:
            beside = [other for other in self.made.parts if other.segment == part.segment]
            around = unary_union([self._shape(part, crease, s, True, other).buffer(1e-4) for other in beside])
            self.outlines[key] = _line(around, CREASES[crease].startswith("open"))
        line = self.outlines[key]
        if line is None or line.distance(Point(0.0, 0.0)) > 0.01:
            return None
        found = _columns(_from_crease(line, own, width), own, after)
        return found if len(found.x) else None


def _section(mesh: Any, origin: Reals, axis: Reals) -> BaseGeometry:
    """A mesh's section as polygons about the origin."""
    right = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.5 else np.array([0.0, 1.0, 0.0])
    right = right - (right @ axis) * axis
    right /= np.linalg.norm(right)
    frame = np.eye(4)
    frame[:3, :3] = np.array([right, np.cross(axis, right), axis])
    frame[:3, 3] = -frame[:3, :3] @ origin
    path = mesh.section(plane_origin=origin, plane_normal=axis)
    if path is None:
        return Polygon()
    flat, _ = path.to_2D(to_2D=frame)
    # Holes are loops within loops: what lies in an odd number of them is material.
    out: BaseGeometry = Polygon()
    for loop in flat.polygons_closed:
        out = out.symmetric_difference(loop)
    return out


def _line(union: BaseGeometry, opening: bool) -> LineString | None:
    """The outline of all panels, or the void's nearest to the origin."""
    shapes = [shape for shape in getattr(union, "geoms", [union]) if isinstance(shape, Polygon)]
    rings = [shape.exterior for shape in shapes] if opening else [ring for s in shapes for ring in s.interiors]
    return min(rings, key=lambda ring: ring.distance(Point(0.0, 0.0)), default=None)


def _from_crease(ring: LineString, own: BaseGeometry, width: float) -> LineString:
    """The part of a ring that begins at the crease and runs along a panel."""
    at = ring.project(Point(0.0, 0.0))
    twice = LineString([*ring.coords, *ring.coords[1:], *ring.coords[1:]])
    middle = at + ring.length
    ways = [substring(twice, middle, middle + width), substring(twice, middle, middle - width)]
    wider = own.buffer(_NEAR)
    return max(ways, key=lambda way: substring(way, 0.0, 0.5).intersection(wider).length)


def _columns(way: LineString, own: BaseGeometry, after: BaseGeometry) -> Columns:
    found = []
    for x in np.arange(0.5 * STEP, way.length, STEP):
        a, b = (np.array(way.interpolate(float(x + dx)).coords[0]) for dx in (-1e-3, 1e-3))
        at, along = 0.5 * (a + b), (b - a) / np.linalg.norm(b - a)
        normal = np.array([-along[1], along[0]])
        into = next((n for n in (normal, -normal) if own.covers(Point(at + 2.0 * _NEAR * n))), None)
        if into is None:
            continue
        ray = LineString([at - _NEAR * into, at + 30.0 * into])
        before, left = _first_run(ray, own), _first_run(ray, after)
        found.append((float(x), before[1], left[0] - _NEAR, left[1]))
    return Columns(*np.array(found).reshape(-1, 4).T)


def _first_run(ray: LineString, shape: BaseGeometry) -> tuple[float, float]:
    """Where a line enters a shape and how far it goes through; infinitely far off where it does not."""
    runs = [
        sorted(ray.project(Point(p)) for p in (piece.coords[0], piece.coords[-1]))
        for piece in getattr(ray.intersection(shape), "geoms", [ray.intersection(shape)])
        if isinstance(piece, LineString) and not piece.is_empty
    ]
    if not runs:
        return np.inf, 0.0
    start, stop = min(runs)
    return start, stop - start
