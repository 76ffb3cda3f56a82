"""Contact of panels on the unit sphere about a cone's apex.

A panel's chart is the gnomonic projection from its own centre: arcs of great circles are straight there,
so that polygons and their intersections are exact, without sampling. It shows the near half of the
sphere; a panel that reaches beyond is cut off well outside of what the chart's own panel covers. Depths,
distances and boxes are arcs, measured on the sphere itself and told in metres at the outer radius.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from ori_deploy.design.cone import ConeStructure
from ori_deploy.errors import MotionError
from ori_deploy.motion.contact import Contact, Indices, Shapes, polygons
from ori_deploy.motion.poses import ConePoses
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.profiles.sphere import Vectors, arc, cross, unit
from ori_deploy.tolerance import Tolerance

_LARGEST_PANEL_RAD = 1.2
"""Largest angle between a panel's centre and a point of it that charts are made for."""

_HORIZON = 0.05
"""Least height of the points that a chart shows: 87 degrees from its centre."""

_STEP_RAD = 0.2
"""Longest piece of a side whose neighbourhood is drawn with straight flanks: wrong by 1 in 200 of its width."""

_ROUND = 0.125 * np.pi * np.arange(16)
"""Directions of the points that stand for a small circle."""

_BATCH = 2048
"""Pairs whose distances are measured at a time: bounds memory, not results."""

_BLOCK = 4096
"""Pairs whose boxes are compared at a time: their coordinates stay in the processor's cache."""


@dataclass(frozen=True)
class _Sides:
    """The sides of a panel, (k, 3) each: first ends, poles, and directions along them at both ends."""

    start: Vectors
    pole: Vectors
    leaves: Vectors
    arrives: Vectors


@dataclass(frozen=True)
class _Boxes:
    """Quadrilaterals of great circles round panels, in the panels' deployed places.

    Attributes
    ----------
    frame
        (n, 3, 3) rows: axes of the panel's chart, the last its centre.
    corner, pole
        (n, 4, 3) corners counter-clockwise, and outward poles of the sides.
    reach
        (n,) largest angle between the centre and a corner.
    """

    frame: Reals
    corner: Vectors
    pole: Vectors
    reach: Reals


@dataclass(frozen=True)
class SphereContact(Contact[ConePoses]):
    """Panels of a cone's structure on the sphere.

    Attributes
    ----------
    structure
        Whose panels.
    tolerance
        `sagitta` counts here.
    r_max_m
        Outer radius, at which arcs are told in metres.

    Raises
    ------
    MotionError
        On first use: a panel too large for its chart.
    """

    structure: ConeStructure
    tolerance: Tolerance
    r_max_m: float

    @cached_property
    def outlines(self) -> tuple[Vectors, ...]:
        """Corners of all panels, deployed."""
        return self.structure.panel_outlines(self.tolerance.sagitta * self.structure.profile.size)

    @cached_property
    def _boxes(self) -> _Boxes:
        frames, corners = [], []
        for panel, points in enumerate(self.outlines):
            pole = self.structure.cells.pole[panel // 4, panel % 4]
            middle = unit(points.sum(axis=0))
            self._refuse_large(panel, arc(points, middle))
            for _ in range(4):
                along = unit(cross(pole, middle))
                frame = np.stack([along, cross(middle, along), middle])
                local = points @ frame.T
                place = local[:, :2] / local[:, 2:]
                lo, hi = place.min(axis=0), place.max(axis=0)
                middle = unit(np.append(0.5 * (lo + hi), 1.0) @ frame)
            box = np.array([[lo[0], lo[1], 1.0], [hi[0], lo[1], 1.0], [hi[0], hi[1], 1.0], [lo[0], hi[1], 1.0]])
            frames.append(frame)
            corners.append(unit(box @ frame))
        corner, frame = np.array(corners), np.array(frames)
        reach = arc(corner, frame[:, None, 2])
        for panel, angle in enumerate(reach):
            self._refuse_large(panel, angle)
        return _Boxes(frame, corner, unit(cross(np.roll(corner, -1, axis=1), corner)), reach.max(axis=1))

    def _refuse_large(self, panel: int, angle: Reals) -> None:
        if not angle.max() < _LARGEST_PANEL_RAD:
            raise MotionError(
                f"panel {self.structure.layout.panel_ids[panel]}: too large, seen from the apex, to be checked",
                value=f"{float(angle.max()):.3g} rad from its middle to its end",
                limit=f"below {_LARGEST_PANEL_RAD} rad",
                remedy="use more cells or a narrower cone",
            )

    @cached_property
    def _sides(self) -> tuple[_Sides, ...]:
        made = []
        for start in self.outlines:
            stop = np.roll(start, -1, axis=0)
            pole = unit(cross(start, stop))
            made.append(_Sides(start, pole, cross(pole, start), cross(pole, stop)))
        return tuple(made)

    @cached_property
    def shapes(self) -> Shapes:
        return polygons(tuple(_chart(o @ f.T) for o, f in zip(self.outlines, self._boxes.frame, strict=True)))

    @property
    def widest_m(self) -> Reals:
        return self._boxes.reach * self.r_max_m

    def shrunk(self, depth_m: Reals, panels: Indices) -> Shapes:
        depth = np.asarray(depth_m) / self.r_max_m
        rims = np.array([self._rim(p, float(d)) for p, d in zip(panels, depth, strict=True)], dtype=object)
        return np.asarray(shapely.difference(self.shapes[panels], rims))

    def _rim(self, panel: int, depth: float) -> shapely.Geometry:
        """What is nearer to a panel's boundary than `depth`, in its chart: hulls of small circles along the sides."""
        start, pole = self._sides[panel].start, self._sides[panel].pole
        stop = np.roll(start, -1, axis=0)
        count = np.ceil(arc(start, stop) / _STEP_RAD).astype(int)
        side = np.repeat(np.arange(len(start)), count)
        part = (np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)) / count[side]
        ends = np.stack([part, part + 1.0 / count[side]])[..., None]
        centre = unit((1.0 - ends) * start[side] + ends * stop[side])  # (2, m, 3)
        across = np.broadcast_to(pole[side], centre.shape)
        along = cross(across, centre)
        ring = np.cos(_ROUND)[:, None] * across[..., None, :] + np.sin(_ROUND)[:, None] * along[..., None, :]
        circle = np.cos(depth) * centre[..., None, :] + np.sin(depth) * ring  # (2, m, 16, 3)
        local = circle.transpose(1, 0, 2, 3).reshape(-1, 3) @ self._boxes.frame[panel].T
        which = np.repeat(np.arange(len(side)), 2 * len(_ROUND))
        return shapely.union_all(shapely.convex_hull(shapely.multipoints(local[:, :2] / local[:, 2:], indices=which)))

    def moved(self, poses: ConePoses, pose: Indices, moving: Indices, fixed: Indices) -> Shapes:
        if not len(moving):
            return np.empty(0, dtype=object)
        seen = self._boxes.frame[fixed] @ _relative(poses, pose, moving, fixed)
        which, points = self._corners_of(moving)
        local = np.einsum("kab,kb->ka", seen[which], points)
        hidden = np.zeros(len(moving), dtype=bool)
        if (local[:, 2] <= _HORIZON).any():
            which, local = _cut(which, local)
            hidden[np.setdiff1d(np.arange(len(moving)), which)] = True
        number = np.cumsum(~hidden) - 1
        shapes = np.full(len(moving), shapely.Polygon(), dtype=object)
        shapes[~hidden] = shapely.polygons(shapely.linearrings(local[:, :2] / local[:, 2:], indices=number[which]))
        return shapes

    def _corners_of(self, panels: Indices) -> tuple[Indices, Vectors]:
        """All corners of panels, one after the other, and the index into `panels` of each."""
        count = np.array([len(o) for o in self.outlines])[panels]
        return np.repeat(np.arange(len(panels)), count), np.concatenate([self.outlines[p] for p in panels])

    def gaps(self, poses: ConePoses, pose: Indices, i: Indices, j: Indices) -> Reals:
        box = self._boxes
        flat = poses.rotation.reshape(-1, 3, 3)
        panel = np.repeat(np.arange(len(box.reach)), poses.n_poses)
        one, two = i * poses.n_poses + pose, j * poses.n_poses + pose
        centre = np.einsum("nab,nb->an", flat, box.frame[panel, 2])
        between = centre[0, one] * centre[0, two] + centre[1, one] * centre[1, two] + centre[2, one] * centre[2, two]
        gap = np.arccos(np.clip(between, -1.0, 1.0)) - box.reach[i] - box.reach[j]
        near = np.flatnonzero(gap <= 0.0)  # the others' caps are apart, which says enough
        # All panels at all poses, coordinates far apart: pairs run along memory.
        corner = np.einsum("nab,nkb->akn", flat, box.corner[panel])
        pole = np.einsum("nab,nkb->akn", flat, box.pole[panel])
        for start in range(0, len(near), _BLOCK):
            some = near[start : start + _BLOCK]
            a, b = one[some], two[some]
            sine = np.maximum(
                _beyond(pole[..., a], corner[..., b], box.reach[j[some]]),
                _beyond(pole[..., b], corner[..., a], box.reach[i[some]]),
            )
            gap[some] = np.arcsin(sine)
        return np.asarray(gap * self.r_max_m)

    def distances(self, poses: ConePoses, pose: Indices, i: Indices, j: Indices) -> Reals:
        out = np.zeros(len(i))
        apart = np.flatnonzero(~shapely.intersects(self.shapes[j], self.moved(poses, pose, i, j)))
        for start in range(0, len(apart), _BATCH):
            some = apart[start : start + _BATCH]
            p, one, two = pose[some], i[some], j[some]
            out[some] = np.minimum(
                self._to_sides(_relative(poses, p, one, two), one, two),
                self._to_sides(_relative(poses, p, two, one), two, one),
            )
        return out * self.r_max_m

    def _to_sides(self, seen: Reals, moving: Indices, fixed: Indices) -> Reals:
        """Smallest arc between a corner of `moving[k]`, turned by `seen[k]`, and a side of `fixed[k]`."""
        out = np.empty(len(moving))
        for f in np.unique(fixed):
            rows = np.flatnonzero(fixed == f)
            which, points = self._corners_of(moving[rows])
            points = np.einsum("kab,kb->ka", seen[rows][which], points)
            sides = self._sides[f]
            over = np.abs(points @ sides.pole.T)
            # Rounding must not lose a corner that lies on a corner.
            beside = (points @ sides.leaves.T >= -1e-12) & (points @ sides.arrives.T <= 1e-12)
            # A corner beside no side is nearest to a corner, more than 90 degrees away perhaps.
            sine = np.where(beside, over, np.inf).min(axis=1)
            to_side = np.where(np.isfinite(sine), np.arcsin(np.minimum(sine, 1.0)), np.inf)
            nearest = (points @ sides.start.T).argmax(axis=1)
            to_corner = arc(points, sides.start[nearest])
            out[rows] = np.minimum.reduceat(
                np.minimum(to_side, to_corner), np.searchsorted(which, np.arange(len(rows)))
            )
        return out

    def travel(self, a: ConePoses, b: ConePoses, pose: Indices, i: Indices, j: Indices) -> Reals:
        one, two = _relative(a, pose, i, j), _relative(b, pose, i, j)
        centre = self._boxes.frame[i, 2]
        moved = arc(np.einsum("kab,kb->ka", one, centre), np.einsum("kab,kb->ka", two, centre))
        sine = np.linalg.norm(two - one, axis=(-2, -1)) / np.sqrt(8.0)
        turned = 2.0 * np.arcsin(np.minimum(sine, 1.0))
        # The path between the poses need not be the shortest one; a tenth covers what it is longer.
        return np.asarray(1.1 * (moved + turned * self._boxes.reach[i]) * self.r_max_m)


def _relative(poses: ConePoses, pose: Indices, moving: Indices, fixed: Indices) -> Reals:
    """(n, 3, 3) rotations of panels `moving` as seen from panels `fixed`."""
    return np.asarray(poses.rotation[fixed, pose].transpose(0, 2, 1) @ poses.rotation[moving, pose])


def _chart(local: Vectors) -> Points:
    """Gnomonic projection of points given along a chart's axes."""
    return np.asarray((local[:, 0] + 1j * local[:, 1]) / local[:, 2])


def _beyond(pole: Reals, corner: Reals, reach: Reals) -> Reals:
    """(n,) sine of the least height of a quadrilateral's corners over the farthest side of another.

    Parameters
    ----------
    pole, corner
        (3, 4, n) outward poles of the one's sides, and the other's corners.
    reach
        (n,) largest angle between the other's centre and a corner.
    """
    farthest = np.full(len(reach), -np.inf)
    for side in range(4):
        height = pole[0, side] * corner[0] + pole[1, side] * corner[1] + pole[2, side] * corner[2]
        np.maximum(farthest, height.min(axis=0), out=farthest)
    # Between corners an arc may dip below both, by no more than this.
    return np.asarray(np.where(farthest < 0.0, np.maximum(farthest / np.cos(reach), -1.0), farthest))


def _cut(which: Indices, local: Vectors) -> tuple[Indices, Vectors]:
    """The parts of closed polygons that are above a chart's horizon.

    Parameters
    ----------
    which
        (n,) rising number of the polygon that each corner belongs to.
    local
        (n, 3) corners along the axes of their charts.

    Returns
    -------
    The same of what is left; nothing of polygons below the horizon.
    """
    first = np.searchsorted(which, which)
    last = np.searchsorted(which, which, side="right") - 1
    index = np.arange(len(which))
    ahead = local[np.where(index == last, first, index + 1)]
    above, above_ahead = local[:, 2] > _HORIZON, ahead[:, 2] > _HORIZON
    crosses = above != above_ahead
    rise = np.where(crosses, ahead[:, 2] - local[:, 2], 1.0)
    crossing = local + (ahead - local) * ((_HORIZON - local[:, 2]) / rise)[:, None]
    keep = np.stack([above, crosses], axis=1).ravel()
    return np.repeat(which, 2)[keep], np.stack([local, crossing], axis=1).reshape(-1, 3)[keep]
