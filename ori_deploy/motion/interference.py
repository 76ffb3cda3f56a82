"""Interference: do panels reach into each other anywhere along a motion?

Depth is what counts. A pair of panels interferes when a point of one lies deeper than the allowed
penetration inside the other, that is, when one panel meets the other shrunk by that depth. Bonded
panels share whole edges and folded ones lie face to face, so bare contact says nothing.

Between two poses a pair that does not share a crease is clear when the gaps at both ends exceed what
the pair can move; otherwise the interval is halved. Bodies that share a crease only turn about it:
what they overlap grows as the crease goes on, so the poses themselves, ends included, decide.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from ori_deploy.errors import MotionError
from ori_deploy.motion.poses import Mechanism, Poses
from ori_deploy.profiles import xy
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.tolerance import TOLERANCE, Tolerance

Indices = NDArray[np.intp]

_THINNING = 20
"""Halvings of the allowed penetration: a millionth of it is far above rounding, far below any sheet."""

_BLOCK = 400_000
"""Pairs times poses judged at a time: bounds memory, not results."""


@dataclass(frozen=True)
class Collision:
    """Two panels that reach into each other.

    Attributes
    ----------
    panels
        Their ids.
    fold
        (n_cells,) fold variables at which they do.
    depth_m
        How deep a point of one lies inside the other.
    """

    panels: tuple[str, str]
    fold: tuple[float, ...]
    depth_m: float

    def error(self, allowed_m: float, size_m: float, remedy: str) -> MotionError:
        """The error that refuses a motion because of this collision."""
        fold = self.fold[0] if len(set(self.fold)) == 1 else "[" + ", ".join(f"{x:.4g}" for x in self.fold) + "]"
        return MotionError(
            f"panels {self.panels[0]} and {self.panels[1]} reach into each other at fold {fold}",
            value=f"depth {1e3 * self.depth_m:.3g} mm",
            limit=f"{1e3 * allowed_m:.3g} mm, a {allowed_m / size_m:.0e} part of the profile's size",
            remedy=remedy,
        )


@dataclass(frozen=True)
class Clearance:
    """The smallest distance between two panels whose bodies share no crease."""

    distance_m: float
    panels: tuple[str, str]
    fold: float


@dataclass(frozen=True)
class Interference:
    """Interference checks of one mechanism.

    Attributes
    ----------
    mechanism
        What moves.
    tolerance
        `penetration`, `sagitta` and `motion_step` count here.
    """

    mechanism: Mechanism
    tolerance: Tolerance = TOLERANCE

    # --- what is fixed ------------------------------------------------------------------------------

    @property
    def allowed_m(self) -> float:
        """Allowed penetration, metres."""
        return self.tolerance.penetration * self.mechanism.structure.profile.size

    @cached_property
    def outlines(self) -> tuple[Points, ...]:
        """Panel polygons, deployed."""
        size = self.mechanism.structure.profile.size
        return self.mechanism.structure.panel_outlines(self.tolerance.sagitta * size)

    @cached_property
    def _shapes(self) -> NDArray[np.object_]:
        shapes = np.array([shapely.Polygon(xy(o)) if len(o) > 2 else shapely.Polygon() for o in self.outlines])
        bad = ~shapely.is_valid(shapes)  # outlines that touch themselves where a hollow is as deep as the wall
        shapes[bad] = shapely.make_valid(shapes[bad])
        return shapes

    def _shrunk(self, depth_m: float) -> NDArray[np.object_]:
        shrunk = shapely.buffer(self._shapes, -depth_m)
        shapely.prepare(shrunk)
        return np.asarray(shrunk)

    @cached_property
    def allowed_each_m(self) -> Reals:
        """(n_panels,) allowed penetration into each panel, metres: less where the panel is thin.

        A panel shrunk by half its thickness is gone and would let anything through; so a panel is shrunk by
        less until most of it is left.
        """
        allowed = np.full(len(self._shapes), self.allowed_m)
        whole = shapely.area(self._shapes)
        for _ in range(_THINNING):
            left = shapely.area(shapely.buffer(self._shapes, -allowed))
            thin = (left < 0.5 * whole) & (whole > 0.0)
            if not thin.any():
                break
            allowed[thin] *= 0.5
        return allowed

    @cached_property
    def _core(self) -> NDArray[np.object_]:
        core = shapely.buffer(self._shapes, -self.allowed_each_m)
        shapely.prepare(core)
        return np.asarray(core)

    def _allowed(self, pair: Indices) -> Reals:
        """The smaller of both panels' allowed penetrations."""
        return np.asarray(self.allowed_each_m[self.pairs[:, pair]].min(axis=0))

    @cached_property
    def pairs(self) -> Indices:
        """(2, n_pairs) panels of different bodies, both with material."""
        bodies = self.mechanism.structure.layout.bodies
        i, j = np.triu_indices(len(bodies), 1)
        thick = ~shapely.is_empty(self._shapes)
        keep = (bodies[i] != bodies[j]) & thick[i] & thick[j]
        return np.stack([i[keep], j[keep]])

    @cached_property
    def hinged(self) -> NDArray[np.bool_]:
        """(n_pairs,) whether the pair's bodies share a crease."""
        return np.asarray(self.mechanism.shared_crease[self.pairs[0], self.pairs[1]])

    @cached_property
    def _boxes(self) -> tuple[Points, Points, Reals]:
        """Per panel: unit axis along its inner face, centre and half extents of its box along it."""
        axis = self.mechanism.structure.cells.direction.ravel()
        centre = np.empty(len(axis), dtype=complex)
        half = np.empty((len(axis), 2))
        for p, outline in enumerate(self.outlines):
            local = outline * np.conj(axis[p])
            lo = complex(local.real.min(), local.imag.min())
            hi = complex(local.real.max(), local.imag.max())
            centre[p] = 0.5 * (lo + hi) * axis[p]
            half[p] = 0.5 * (hi - lo).real, 0.5 * (hi - lo).imag
        return axis, centre, half

    # --- one pose at a time, many at once -----------------------------------------------------------

    def _gaps(self, poses: Poses, pose: Indices, pair: Indices) -> Reals:
        """Lower bound, from the panels' boxes, of the distance of `pair[k]` at `pose[k]`; negative: overlap."""
        i, j = self.pairs[:, pair]
        axis, centre, half = self._boxes
        ui, uj = poses.turn[i, pose] * axis[i], poses.turn[j, pose] * axis[j]
        between = poses.turn[j, pose] * centre[j] + poses.shift[j, pose]
        between -= poses.turn[i, pose] * centre[i] + poses.shift[i, pose]
        rel = np.conj(ui) * uj
        c, s = np.abs(rel.real), np.abs(rel.imag)
        hi, hj = half[i].T, half[j].T
        d = between * np.conj(ui)
        gap = np.maximum(
            np.abs(d.real) - (hi[0] + c * hj[0] + s * hj[1]), np.abs(d.imag) - (hi[1] + s * hj[0] + c * hj[1])
        )
        d = between * np.conj(uj)
        gap = np.maximum(gap, np.abs(d.real) - (hj[0] + c * hi[0] + s * hi[1]))
        return np.asarray(np.maximum(gap, np.abs(d.imag) - (hj[1] + s * hi[0] + c * hi[1])))

    def _moved(self, poses: Poses, pose: Indices, moving: Indices, fixed: Indices) -> NDArray[np.object_]:
        """Shapes of panels `moving` as seen from panels `fixed`."""
        turn = np.conj(poses.turn[fixed, pose]) * poses.turn[moving, pose]
        shift = np.conj(poses.turn[fixed, pose]) * (poses.shift[moving, pose] - poses.shift[fixed, pose])
        count = np.array([len(o) for o in self.outlines])[moving]
        which = np.repeat(np.arange(len(moving)), count)
        points = np.concatenate([self.outlines[m] for m in moving]) if len(moving) else np.empty(0, complex)
        return np.asarray(
            shapely.polygons(shapely.linearrings(xy(turn[which] * points + shift[which]), indices=which))
        )

    def _overlap(self, poses: Poses, pose: Indices, pair: Indices, core: NDArray[np.object_]) -> NDArray[np.bool_]:
        """Whether a panel of `pair[k]` meets the core of the other at `pose[k]`."""
        i, j = self.pairs[:, pair]
        hit = np.zeros(len(pair), dtype=bool)
        for moving, fixed in ((i, j), (j, i)):
            todo = np.flatnonzero(~hit & ~shapely.is_empty(core[fixed]))
            if len(todo):
                moved = self._moved(poses, pose[todo], moving[todo], fixed[todo])
                hit[todo] = shapely.intersects(core[fixed[todo]], moved)
        return hit

    def hits(self, poses: Poses, pose: Indices, pair: Indices) -> NDArray[np.bool_]:
        """Whether `pair[k]` penetrates deeper than allowed at `pose[k]`."""
        hit = np.zeros(len(pair), dtype=bool)
        # Boxes that overlap by no more than the allowed depth along one axis cannot hide a deeper point.
        near = np.flatnonzero(self._gaps(poses, pose, pair) < -self._allowed(pair))
        hit[near] = self._overlap(poses, pose[near], pair[near], self._core)
        return hit

    def penetration_bound_m(self, fold: ArrayLike) -> float:
        """A depth that no two panels exceed at any of these folds, within a factor of 2, metres.

        Parameters
        ----------
        fold
            (n_poses, n_cells), or (n_poses,) all in step.
        """
        rows = self._rows(fold)
        poses = self.mechanism.poses(rows)
        pose, pair = (a.ravel() for a in np.indices((len(rows), self.pairs.shape[1])))
        gap = self._gaps(poses, pose, pair)
        deepest = self.allowed_m / 64.0
        touching = np.flatnonzero(gap < -deepest)
        while len(touching):
            hit = self._overlap(poses, pose[touching], pair[touching], self._shrunk(deepest))
            if not hit.any():
                break
            deepest *= 2.0
            touching = touching[hit & (gap[touching] < -deepest)]
        return deepest

    def _rows(self, fold: ArrayLike) -> Reals:
        rows = np.asarray(fold, dtype=float)
        return np.repeat(rows[:, None], self.mechanism.n_cells, axis=1) if rows.ndim == 1 else rows

    def _distances(self, poses: Poses, pose: Indices, pair: Indices) -> Reals:
        i, j = self.pairs[:, pair]
        return np.asarray(shapely.distance(self._shapes[j], self._moved(poses, pose, i, j)))

    def depth_m(self, fold: ArrayLike, pair: int) -> float:
        """Depth to which a point of one panel of a pair lies inside the other at one fold, metres.

        At most half the thicker panel's thickness, however far the panels cross.
        """
        poses = self.mechanism.poses(np.atleast_2d(np.asarray(fold, dtype=float)))
        at, which = np.zeros(1, dtype=np.intp), np.array([pair], dtype=np.intp)
        lo, hi = 0.0, float(self._boxes[2][self.pairs[:, pair]].max())
        while hi - lo > 0.01 * max(lo, 1e-3 * self.allowed_m):
            middle = 0.5 * (lo + hi)
            if self._overlap(poses, at, which, self._shrunk(middle))[0]:
                lo = middle
            else:
                hi = middle
        return 0.5 * (lo + hi)

    # --- motions -------------------------------------------------------------------------------------

    def first_collision(self, fold: ArrayLike, *, between: bool = True) -> Collision | None:
        """The deepest collision found at a motion's first colliding pose, or None.

        Parameters
        ----------
        fold
            (n_poses, n_cells), or (n_poses,) all in step: poses along the motion, straight lines between.
        between
            Whether the intervals between poses are certified too.
        """
        rows = self._rows(fold)
        n_pairs = self.pairs.shape[1]
        block = max(2, _BLOCK // max(n_pairs, 1))
        for start in range(0, max(len(rows) - 1, 1), block - 1):
            some = rows[start : start + block]  # one pose more than intervals: blocks share their ends
            poses = self.mechanism.poses(some)
            pose, pair = (a.ravel() for a in np.indices((len(some), n_pairs)))
            hit = self.hits(poses, pose, pair)
            if hit.any():
                first = pose[hit].min()
                return self._worst(some[first], pair[hit & (pose == first)])
            if between and len(some) > 1:
                found = self._between(some, poses)
                if found is not None:
                    return found
        return None

    def _worst(self, fold: Reals, pairs: Indices) -> Collision:
        depths = [self.depth_m(fold, int(p)) for p in pairs]
        k = int(np.argmax(depths))
        ids = self.mechanism.structure.layout.panel_ids
        i, j = self.pairs[:, pairs[k]]
        return Collision((ids[i], ids[j]), tuple(float(x) for x in fold), depths[k])

    def _travel(self, a: Poses, b: Poses, row: Indices, pair: Indices) -> Reals:
        """Bound of how far a panel of the pair moves, seen from the other, between two poses."""
        i, j = self.pairs[:, pair]
        _, centre, half = self._boxes

        def seen(p: Poses) -> tuple[Points, Points]:
            turn = np.conj(p.turn[j, row]) * p.turn[i, row]
            return turn, turn * centre[i] + np.conj(p.turn[j, row]) * (p.shift[i, row] - p.shift[j, row])

        turn_a, place_a = seen(a)
        turn_b, place_b = seen(b)
        radius = np.hypot(half[i, 0], half[i, 1])
        # The path between the poses is an arc; a tenth covers what it is longer than its chord.
        return np.asarray(1.1 * (np.abs(place_b - place_a) + np.abs(turn_b - turn_a) * radius))

    def _between(self, rows: Reals, poses: Poses) -> Collision | None:
        """Certify every interval for every pair that shares no crease, halving where needed."""
        free = np.flatnonzero(~self.hinged)
        interval, pair = (a.ravel() for a in np.meshgrid(np.arange(len(rows) - 1), free, indexing="ij"))
        low, high = rows[:-1], rows[1:]
        at_low = Poses(poses.turn[:, :-1], poses.shift[:, :-1])
        at_high = Poses(poses.turn[:, 1:], poses.shift[:, 1:])
        while len(pair):
            need = self._travel(at_low, at_high, interval, pair) - 2.0 * self._allowed(pair)
            have = np.maximum(self._gaps(at_low, interval, pair), 0.0) + np.maximum(
                self._gaps(at_high, interval, pair), 0.0
            )
            open_still = np.flatnonzero(have < need)
            interval, pair, need = interval[open_still], pair[open_still], need[open_still]
            have = self._distances(at_low, interval, pair) + self._distances(at_high, interval, pair)
            open_still = np.flatnonzero(have < need)
            interval, pair = interval[open_still], pair[open_still]
            if not len(pair):
                return None
            used, back = np.unique(interval, return_inverse=True)
            low, high = low[used], high[used]
            middle = 0.5 * (low + high)
            at_middle = self.mechanism.poses(middle)
            hit = self.hits(at_middle, back, pair)
            if hit.any():
                first = back[hit].min()
                return self._worst(middle[first], pair[hit & (back == first)])
            n = len(used)
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
            at_low, at_high = self.mechanism.poses(low), self.mechanism.poses(high)
            interval, pair = np.concatenate([back, back + n]), np.concatenate([pair, pair])
        return None

    def _always_touching(self, poses: Poses) -> NDArray[np.bool_]:
        """(n_pairs,) pairs that touch first, half-way and last: they turn about a point both have, at a flat skin."""
        touching = np.ones(self.pairs.shape[1], dtype=bool)
        n = poses.turn.shape[1]
        for k in (0, n // 2, n - 1):
            pair = np.flatnonzero(touching)
            if len(pair):
                distance = self._distances(poses, np.full(len(pair), k), pair)
                touching[pair] = distance <= 1e-9 * self.mechanism.structure.profile.size
        return touching

    def clearance(self, fold: ArrayLike) -> Clearance:
        """Smallest distance between two panels whose bodies share no crease nor always touch, over poses in step.

        Parameters
        ----------
        fold
            (n_poses,); leave out the ends of the motion, where panels touch by design.
        """
        at = np.asarray(fold, dtype=float)
        poses = self.mechanism.poses(at)
        free = np.flatnonzero(~self.hinged & ~self._always_touching(poses))
        pose, pair = (a.ravel() for a in np.meshgrid(np.arange(len(at)), free, indexing="ij"))
        bound = self._gaps(poses, pose, pair)
        order = np.argsort(bound)
        best, where = np.inf, 0
        for start in range(0, len(order), 256):
            batch = order[start : start + 256]
            if bound[batch[0]] >= best:
                break
            distance = self._distances(poses, pose[batch], pair[batch])
            if distance.min() < best:
                best, where = float(distance.min()), int(batch[np.argmin(distance)])
        ids = self.mechanism.structure.layout.panel_ids
        if not np.isfinite(best):
            return Clearance(float("inf"), ("", ""), float(at[0]))
        i, j = self.pairs[:, pair[where]]
        return Clearance(best, (ids[i], ids[j]), float(at[pose[where]]))
