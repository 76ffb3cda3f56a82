"""Panels as ruled prisms: each corner of a panel's cross-section runs along a straight line.

On a cylinder the lines are parallel to its axis, on a cone they are rays from the apex. Everything here is told in
the design's own frame: a cylinder's section is the plane of x and y, its span runs along z; a cone's apex is the
origin, and corners run counter-clockwise about z. A place on a line is told by `s`: z, or the distance from the apex.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.motion.mechanism import AnyStructure
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors, polygon_excess

Kind = Literal["skin", "inner", "joint_open", "joint_close", "back"]
"""Faces of a panel: the outer surface; the inner face; those that meet the next panel's at its opening and its
closing crease; and the one on an inner edge, bonded or slit."""


@dataclass(frozen=True)
class Rulings:
    """Straight lines in a row, each joined to the next by a plane facet.

    Attributes
    ----------
    base, direction
        (n, 3) a point of each line, metres, and unit vectors: `base + s direction`.
    """

    base: Vectors
    direction: Vectors

    def __len__(self) -> int:
        return len(self.base)

    def at(self, s: float) -> Vectors:
        """(n, 3) points of all lines."""
        return self.base + s * self.direction

    def reversed(self) -> Rulings:
        """The other way round."""
        return Rulings(self.base[::-1], self.direction[::-1])

    def normals(self, s: float) -> Vectors:
        """(n - 1, 3) unit normals of the facets, to the row's right: outwards where it runs counter-clockwise."""
        edge = np.diff(self.at(s), axis=0)
        normal = np.cross(edge, self.direction[:-1])
        return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])

    def widths(self, s: float) -> Reals:
        """(n - 1,) breadths of the facets at `s`, metres."""
        return np.asarray(np.linalg.norm(np.diff(self.at(s), axis=0), axis=1))

    def offset(self, distance: float, s: float) -> Rulings:
        """All facets moved along their normals; lines between two of them stay where both meet."""
        normal = self.normals(s)
        before, after = np.vstack([normal[:1], normal]), np.vstack([normal, normal[-1:]])
        shared = 1.0 + np.einsum("ij,ij->i", before, after)
        return Rulings(self.base + distance * (before + after) / shared[:, None], self.direction)

    def first(self, width: float, s: float) -> Rulings:
        """The beginning of the row, as wide as said at `s`; all of it where it is narrower."""
        along = np.append(0.0, np.cumsum(self.widths(s)))
        if width >= along[-1] * (1.0 - 1e-12):
            return self
        k = int(np.searchsorted(along, width, side="right")) - 1
        share = (width - along[k]) / (along[k + 1] - along[k])
        if share <= 1e-9 and k > 0:
            return Rulings(self.base[: k + 1], self.direction[: k + 1])
        base = (1.0 - share) * self.base[k] + share * self.base[k + 1]
        at = (1.0 - share) * self.at(s)[k] + share * self.at(s)[k + 1]
        direction = (at - base) / np.linalg.norm(at - base)
        return Rulings(np.vstack([self.base[: k + 1], base]), np.vstack([self.direction[: k + 1], direction]))

    def extended(self, before: float, after: float, s: float) -> Rulings:
        """The outermost facets widened by so much beyond the row's ends."""
        normal = self.normals(s)
        ahead = -np.cross(normal[[0, -1]], self.direction[[0, -1]])
        base = self.base.copy()
        base[0] -= before * ahead[0]
        base[-1] += after * ahead[1]
        return Rulings(base, self.direction)


@dataclass(frozen=True)
class Face:
    """One face of a panel, its lines counter-clockwise round the panel.

    Attributes
    ----------
    kind
        Which.
    rulings
        At least two lines.
    turn_before, turn_after
        Angles by which the panel's outline turns left at the face's ends, radians; negative at a notch.
    """

    kind: Kind
    rulings: Rulings
    turn_before: float
    turn_after: float


@dataclass(frozen=True)
class PanelShape:
    """A panel's cross-section with its faces named.

    Attributes
    ----------
    panel
        Its number.
    points
        (n, 2) corners in metres on a cylinder, (n, 3) unit vectors on a cone; counter-clockwise.
    kinds
        (n,) kind of the side from each corner to the next.
    """

    panel: int
    points: Reals
    kinds: tuple[Kind, ...]

    @property
    def on_cone(self) -> bool:
        """Whether its corners are rays."""
        return bool(self.points.shape[1] == 3)

    @property
    def rulings(self) -> Rulings:
        """(n) lines."""
        if self.on_cone:
            return Rulings(np.zeros_like(self.points), self.points)
        n = len(self.points)
        base = np.column_stack([self.points, np.zeros(n)])
        return Rulings(base, np.tile([0.0, 0.0, 1.0], (n, 1)))

    def face(self, kind: Kind, s: float) -> Face | None:
        """A face by its kind; None where the panel has none."""
        n = len(self.kinds)
        of_kind = [i for i in range(n) if self.kinds[i] == kind]
        if not of_kind:
            return None
        start = next((i for i in of_kind if self.kinds[i - 1] != kind), of_kind[0])
        index = (start + np.arange(len(of_kind) + 1)) % n
        all_lines = self.rulings
        row = Rulings(all_lines.base[index], all_lines.direction[index])
        around = np.concatenate([[index[0] - 1], index, [(index[-1] + 1) % n]])
        normal = Rulings(all_lines.base[around], all_lines.direction[around]).normals(s)
        turns = [_turn(normal[i], normal[i + 1], row.direction[i]) for i in (0, len(row) - 1)]
        return Face(kind, row, turns[0], turns[1])


def _turn(before: Vectors, after: Vectors, axis: Vectors) -> float:
    return float(np.arctan2(np.cross(before, after) @ axis, before @ after))


def panel_shape(structure: AnyStructure, panel: int, chord: float) -> PanelShape | None:
    """A panel's cross-section as a polygon of exactly its area; None where it has no material.

    Along the skin the polygon's corners stand off the true outline, by less than `chord`, so that what chords cut
    off a bulge is put back on.

    Parameters
    ----------
    chord
        Largest distance of the polygon from the true outline: metres, radians on a cone.
    """
    points, kinds = _labelled(structure, panel, 0.5 * chord)
    if len(points) < 3 or structure.panel_areas[panel] <= 0.0:
        return None
    skin = [i for i in range(len(kinds)) if kinds[i] == kinds[i - 1] == "skin"]
    points = _with_area(points, np.array(skin, dtype=int), float(structure.panel_areas[panel]))
    return PanelShape(panel, points, kinds)


def _labelled(structure: AnyStructure, panel: int, sagitta: float) -> tuple[Reals, tuple[Kind, ...]]:
    """Corners without repetitions, and the kind of side that leaves each."""
    cell, k = divmod(panel, 4)
    even = k % 2 == 0
    q = (structure.corner.q_before if even else structure.corner.q_after)[panel // 2]
    v = structure.cells.crease[cell, (2, 3, 3, 2)[k]]
    m = structure.cells.elbow[cell, k // 2]
    start, stop = (float(x) for x in structure.outline_pieces[panel])
    curve = _curve(structure, start, stop, sagitta)
    skin: list[Kind] = ["skin"] * (len(curve) - 1)
    row = (q, *curve, m, v) if even else (*curve, q, v, m)
    named: list[Kind]
    if even:
        named = ["back", *skin, "joint_open", "inner", "joint_close"]
    else:
        named = [*skin, "back", "joint_close", "inner", "joint_open"]
    corners = [_plain(p) for p in row]
    size = structure.profile.size
    kept = [
        i for i in range(len(corners)) if np.linalg.norm(corners[(i + 1) % len(corners)] - corners[i]) > 1e-9 * size
    ]
    return np.array([corners[i] for i in kept]).reshape(len(kept), -1), tuple(named[i] for i in kept)


def _plain(p: Any) -> Reals:
    return np.array([p.real, p.imag]) if np.ndim(p) == 0 else np.asarray(p)


def _curve(structure: AnyStructure, start: float, stop: float, sagitta: float) -> Any:
    """Samples of a piece of outline, with at least one between its ends."""
    profile = structure.profile
    if stop <= start:
        return np.asarray(profile.point(np.array([start])))
    curve = np.asarray(profile.sample(start, stop, sagitta))
    return np.asarray(profile.point(np.array([start, 0.5 * (start + stop), stop]))) if len(curve) == 2 else curve


def _area(points: Reals) -> float:
    if points.shape[1] == 3:
        return float(polygon_excess(points, _middle(points)))
    near = points - points[0]  # small numbers: no digits lost far from the origin
    ahead = np.roll(near, -1, axis=0)
    return 0.5 * float((near[:, 0] * ahead[:, 1] - near[:, 1] * ahead[:, 0]).sum())


def _middle(points: Vectors) -> Vectors:
    total = points.sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))


def _with_area(points: Reals, movable: Reals, area: float) -> Reals:
    """The polygon with some of its corners moved outwards, all by the same distance, so that its area is exact."""
    if not len(movable):
        return points
    along = points[(movable + 1) % len(points)] - points[movable - 1]
    if points.shape[1] == 3:
        outward = np.cross(along, points[movable])
    else:
        outward = np.column_stack([along[:, 1], -along[:, 0]])
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    reach = 0.5 * float(np.linalg.norm(along, axis=1).sum())
    out, missing = points, area - _area(points)
    for _ in range(8):  # area grows with the distance by `reach`, nearly: each step leaves a small part of the last
        if abs(missing) <= 1e-15 * abs(area):
            break
        out = out.copy()
        out[movable] += missing / reach * outward
        if out.shape[1] == 3:
            out[movable] /= np.linalg.norm(out[movable], axis=1)[:, None]
        missing = area - _area(out)
    return out


def s_range(structure: AnyStructure, span_m: float, r_min_m: float) -> tuple[float, float]:
    """`s` at both ends of the span."""
    return (r_min_m, r_min_m + span_m) if isinstance(structure, ConeStructure) else (0.0, span_m)


def to_user(structure: AnyStructure) -> Reals:
    """(4, 4) from the design's own frame to the user's coordinates; a mirror image where a cone's frame is one."""
    out = np.eye(4)
    if not isinstance(structure, Structure):
        out[:3, :3], out[:3, 3] = structure.profile.frame, structure.profile.apex
    return out
