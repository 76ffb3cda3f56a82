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
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from ori_deploy.errors import MotionError
from ori_deploy.motion.contact import Contact, Indices, Shapes
from ori_deploy.motion.mechanism import Linkage
from ori_deploy.motion.poses import Placement
from ori_deploy.profiles.profile import Reals
from ori_deploy.tolerance import TOLERANCE, Tolerance

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

    mechanism: Linkage[Any]
    tolerance: Tolerance = TOLERANCE

    # --- what is fixed ------------------------------------------------------------------------------

    @property
    def allowed_m(self) -> float:
        """Allowed penetration, metres."""
        return self.tolerance.penetration * self.mechanism.size_m

    @cached_property
    def contact(self) -> Contact[Any]:
        """The panels as shapes."""
        return self.mechanism.contact(self.tolerance)

    def _shrunk(self, depth_m: float, panels: Indices) -> Shapes:
        """(n_panels,) the given panels without their rim of this depth; the others empty."""
        shapes = np.full(len(self.contact.shapes), shapely.Polygon(), dtype=object)
        shapes[panels] = self.contact.shrunk(np.full(len(panels), depth_m), panels)
        shapely.prepare(shapes)
        return shapes

    @cached_property
    def allowed_each_m(self) -> Reals:
        """(n_panels,) allowed penetration into each panel, metres: less where the panel is thin.

        A panel shrunk by half its thickness is gone and would let anything through; so a panel is shrunk by
        less until most of it is left.
        """
        allowed = np.full(len(self.contact.shapes), self.allowed_m)
        whole = shapely.area(self.contact.shapes)
        thin = np.flatnonzero(whole > 0.0)
        for _ in range(_THINNING):
            left = shapely.area(self.contact.shrunk(allowed[thin], thin))
            thin = thin[left < 0.5 * whole[thin]]
            if not len(thin):
                break
            allowed[thin] *= 0.5
        return allowed

    @cached_property
    def _core(self) -> Shapes:
        core = self.contact.shrunk(self.allowed_each_m, np.arange(len(self.contact.shapes)))
        shapely.prepare(core)
        return core

    def _allowed(self, pair: Indices) -> Reals:
        """The smaller of both panels' allowed penetrations."""
        return np.asarray(self.allowed_each_m[self.pairs[:, pair]].min(axis=0))

    @cached_property
    def pairs(self) -> Indices:
        """(2, n_pairs) panels of different bodies, both with material."""
        bodies = self.mechanism.layout.bodies
        i, j = np.triu_indices(len(bodies), 1)
        thick = ~shapely.is_empty(self.contact.shapes)
        keep = (bodies[i] != bodies[j]) & thick[i] & thick[j]
        return np.stack([i[keep], j[keep]])

    @cached_property
    def hinged(self) -> NDArray[np.bool_]:
        """(n_pairs,) whether the pair's bodies share a crease."""
        return np.asarray(self.mechanism.shared_crease[self.pairs[0], self.pairs[1]])

    # --- one pose at a time, many at once -----------------------------------------------------------

    def _gaps(self, poses: Placement, pose: Indices, pair: Indices) -> Reals:
        """Lower bound of the distance of `pair[k]` at `pose[k]`; negative: overlap."""
        return self.contact.gaps(poses, pose, *self.pairs[:, pair])

    def _distances(self, poses: Placement, pose: Indices, pair: Indices) -> Reals:
        return self.contact.distances(poses, pose, *self.pairs[:, pair])

    def _overlap(self, poses: Placement, pose: Indices, pair: Indices, core: Shapes) -> NDArray[np.bool_]:
        """Whether a panel of `pair[k]` meets the core of the other at `pose[k]`."""
        i, j = self.pairs[:, pair]
        hit = np.zeros(len(pair), dtype=bool)
        for moving, fixed in ((i, j), (j, i)):
            todo = np.flatnonzero(~hit & ~shapely.is_empty(core[fixed]))
            if len(todo):
                moved = self.contact.moved(poses, pose[todo], moving[todo], fixed[todo])
                hit[todo] = shapely.intersects(core[fixed[todo]], moved)
        return hit

    def hits(self, poses: Placement, pose: Indices, pair: Indices) -> NDArray[np.bool_]:
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
            core = self._shrunk(deepest, np.unique(self.pairs[:, pair[touching]]))
            hit = self._overlap(poses, pose[touching], pair[touching], core)
            if not hit.any():
                break
            deepest *= 2.0
            touching = touching[hit & (gap[touching] < -deepest)]
        return deepest

    def _rows(self, fold: ArrayLike) -> Reals:
        rows = np.asarray(fold, dtype=float)
        return np.repeat(rows[:, None], self.mechanism.n_cells, axis=1) if rows.ndim == 1 else rows

    def depth_m(self, fold: ArrayLike, pair: int) -> float:
        """Depth to which a point of one panel of a pair lies inside the other at one fold, metres.

        At most half the thicker panel's thickness, however far the panels cross.
        """
        poses = self.mechanism.poses(np.atleast_2d(np.asarray(fold, dtype=float)))
        at, which = np.zeros(1, dtype=np.intp), np.array([pair], dtype=np.intp)
        panels = self.pairs[:, pair]
        lo, hi = 0.0, float(self.contact.widest_m[panels].max())
        while hi - lo > 0.01 * max(lo, 1e-3 * self.allowed_m):
            middle = 0.5 * (lo + hi)
            if self._overlap(poses, at, which, self._shrunk(middle, panels))[0]:
                lo = middle
            else:
                hi = middle
        return 0.5 * (lo + hi)

    def deepest(self, fold: Reals, pairs: Indices, most: int) -> tuple[Indices, Indices]:
        """Of pairs that reach into each other at one fold (n_cells,), the deepest, at most so many, and the rest.

        A depth is looked for that at most so many exceed: none of the rest is deeper than any of those, but for a
        thousandth of the allowed penetration.
        """
        poses = self.mechanism.poses(fold[None, :])
        low, high = 0.0, float(self.contact.widest_m[np.unique(self.pairs[:, pairs])].max(initial=0.0))
        deep, left, rest = pairs[:0], pairs, pairs[:0]
        while len(deep) + len(left) > most and high - low > 1e-3 * self.allowed_m:
            middle = 0.5 * (low + high)
            core = self._shrunk(middle, np.unique(self.pairs[:, left]))
            over = self._overlap(poses, np.zeros_like(left), left, core)
            if len(deep) + over.sum() > most:
                left, rest, low = left[over], np.concatenate([rest, left[~over]]), middle
            else:
                deep, left, high = np.concatenate([deep, left[over]]), left[~over], middle
        room = most - len(deep)
        return np.concatenate([deep, left[:room]]), np.concatenate([rest, left[room:]])

    # --- motions -------------------------------------------------------------------------------------

    def touching(self, fold: Reals) -> Indices:
        """Pairs that reach into each other deeper than allowed at one fold (n_cells,)."""
        pair = np.arange(self.pairs.shape[1])
        return pair[self.hits(self.mechanism.poses(fold[None, :]), np.zeros_like(pair), pair)]

    def first_collision(
        self, fold: ArrayLike, *, between: bool = True, pairs: Indices | None = None
    ) -> Collision | None:
        """The deepest collision found at a motion's first colliding pose, or None.

        Parameters
        ----------
        fold
            (n_poses, n_cells), or (n_poses,) all in step: poses along the motion, straight lines between.
        between
            Whether the intervals between poses are certified too.
        pairs
            Which of `pairs` are judged; all by default.
        """
        rows = self._rows(fold)
        judged = np.arange(self.pairs.shape[1]) if pairs is None else pairs
        block = max(2, _BLOCK // max(len(judged), 1))
        for start in range(0, max(len(rows) - 1, 1), block - 1):
            some = rows[start : start + block]  # one pose more than intervals: blocks share their ends
            poses = self.mechanism.poses(some)
            pose, pair = (a.ravel() for a in np.meshgrid(np.arange(len(some)), judged, indexing="ij"))
            hit = self.hits(poses, pose, pair)
            if hit.any():
                first = pose[hit].min()
                return self._worst(some[first], pair[hit & (pose == first)])
            if between and len(some) > 1:
                found = self._between(some, poses, judged)
                if found is not None:
                    return found
        return None

    def _worst(self, fold: Reals, pairs: Indices) -> Collision:
        depths = [self.depth_m(fold, int(p)) for p in pairs]
        k = int(np.argmax(depths))
        ids = self.mechanism.layout.panel_ids
        i, j = self.pairs[:, pairs[k]]
        return Collision((ids[i], ids[j]), tuple(float(x) for x in fold), depths[k])

    def _between(self, rows: Reals, poses: Placement, judged: Indices) -> Collision | None:
        """Certify every interval for every judged pair that shares no crease, halving where needed."""
        free = judged[~self.hinged[judged]]
        interval, pair = (a.ravel() for a in np.meshgrid(np.arange(len(rows) - 1), free, indexing="ij"))
        low, high = rows[:-1], rows[1:]
        at_low, at_high = poses.part(slice(None, -1)), poses.part(slice(1, None))
        while len(pair):
            travel = self.contact.travel(at_low, at_high, interval, *self.pairs[:, pair])
            need = travel - 2.0 * self._allowed(pair)
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

    def _always_touching(self, poses: Placement) -> NDArray[np.bool_]:
        """(n_pairs,) pairs that touch first, half-way and last: they turn about a point both have, at a flat skin."""
        touching = np.ones(self.pairs.shape[1], dtype=bool)
        n = poses.n_poses
        for k in (0, n // 2, n - 1):
            pair = np.flatnonzero(touching)
            if len(pair):
                distance = self._distances(poses, np.full(len(pair), k), pair)
                touching[pair] = distance <= 1e-9 * self.mechanism.size_m
        return touching

    def first_deeper(self, fold: Reals, pair: int, depth_m: float) -> Collision | None:
        """Where a pair that touches first gets deeper than a depth along a motion, or None.

        Poses lie so near to each other that a point of one panel moves no farther in the other than the allowed
        penetration: between two of them it is within half of that.

        Parameters
        ----------
        fold
            (n_poses, n_cells), straight lines between.
        pair
            Number of the pair.
        depth_m
            The depth; half the allowed penetration on top of it is still taken for it.
        """
        core = self._shrunk(depth_m + 0.5 * self.allowed_m, self.pairs[:, pair])
        if shapely.is_empty(core[self.pairs[:, pair]]).all():  # so thin, nothing could get deeper
            return self._worst(fold[0], np.array([pair]))
        for low, high in pairwise(fold):
            rows = self._near_each_other(low, high, pair)
            at = np.arange(len(rows))
            deeper = self._overlap(self.mechanism.poses(rows), at, np.full(len(rows), pair), core)
            if deeper.any():
                return self._worst(rows[int(np.argmax(deeper))], np.array([pair]))
        return None

    def _near_each_other(self, low: Reals, high: Reals, pair: int) -> Reals:
        """Poses from `low` to `high` between which a pair moves by no more than the allowed penetration."""
        count = 1
        while True:
            rows = low + np.linspace(0.0, 1.0, count + 1)[:, None] * (high - low)
            poses = self.mechanism.poses(rows)
            i, j = (np.full(count, panel) for panel in self.pairs[:, pair])
            ends = poses.part(slice(None, -1)), poses.part(slice(1, None))
            most = float(self.contact.travel(*ends, np.arange(count), i, j).max())
            if most <= self.allowed_m:
                return rows
            count *= max(2, int(np.ceil(most / self.allowed_m)))

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
        ids = self.mechanism.layout.panel_ids
        if not np.isfinite(best):
            return Clearance(float("inf"), ("", ""), float(at[0]))
        i, j = self.pairs[:, pair[where]]
        return Clearance(best, (ids[i], ids[j]), float(at[pose[where]]))
