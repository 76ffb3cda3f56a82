"""Interference between span segments while the flat stack folds zig-zag.

All hinges are parallel to the stack's `x`, so segments only move in the plane of `z` (along the span)
and `y` (through the thickness), and what two of them share at one `x` depends on their cross-sections
at that `x` alone. So `x` is cut into bins, a segment in a bin is the rectangle that holds it, and
solids in space become rectangles in the plane. Points are complex numbers `z + iy`, metres.

Depth is what counts, as for panels (see `interference`): two segments interfere when one meets the
other shrunk by the allowed penetration. Between two poses a pair that shares no hinge is clear when the
gaps at both ends exceed what the pair can move; otherwise the interval is halved. Neighbours only turn
about their hinge, and what they overlap grows with the angle: their poses decide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ori_deploy.profiles.profile import Points, Reals

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class SegmentCollision:
    """Two segments, counted from 0, that reach into each other, the hinge angles at which they do, and how deep."""

    segments: tuple[int, int]
    angles_rad: tuple[float, ...]
    depth_m: float


@dataclass(frozen=True)
class SegmentChain:
    """Equal segments of one stack in a row, hinged to each other on one face or the other.

    Attributes
    ----------
    low, high
        (n_bins,) least and greatest `y` of the stack over equal bins of `x`; (inf, -inf) where it is empty.
    length_m
        Length of a segment along `z`.
    hinge_y
        (n_segments - 1,) height of each hinge: that of the face it sits on.
    hinge_sign
        (n_segments - 1,) +1 where the free end swings towards +y (hinge on the upper face), -1 towards -y.
    allowed_m
        Depth that does not count yet.
    """

    low: Reals
    high: Reals
    length_m: float
    hinge_y: Reals
    hinge_sign: Reals
    allowed_m: float

    @property
    def n_segments(self) -> int:
        return len(self.hinge_y) + 1

    def placed(self, angles: Reals) -> tuple[Points, Points]:
        """Where the segments are.

        Parameters
        ----------
        angles
            (n_poses, n_segments - 1) hinge angles: 0 straight, pi folded back.

        Returns
        -------
        (n_segments, n_poses) turn and shift: a point `w` of the unfolded row is at `turn * w + shift`.
        """
        turn = np.ones((self.n_segments, len(angles)), dtype=complex)
        shift = np.zeros_like(turn)
        for k in range(self.n_segments - 1):
            hinge = (k + 1) * self.length_m + 1j * self.hinge_y[k]
            swing = np.exp(1j * self.hinge_sign[k] * angles[:, k])
            turn[k + 1] = turn[k] * swing
            shift[k + 1] = shift[k] + turn[k] * hinge * (1.0 - swing)
        return turn, shift

    @cached_property
    def _boxes(self) -> tuple[NDArray[np.complexfloating[Any, Any]], Reals, Reals]:
        """Centre (n_bins,) of segment 0's rectangles, half heights (n_bins,) and how far each is shrunk."""
        filled = self.high > self.low
        low, high = self.low[filled], self.high[filled]
        half = 0.5 * (high - low)
        # Half of a thin part is left, or shrinking would let anything through it.
        return 0.5 * self.length_m + 0.5j * (low + high), half, np.minimum(self.allowed_m, 0.5 * half)

    @cached_property
    def _boxed(self) -> SegmentChain:
        """The same with one bin, and no more allowed in it than in the thinnest of all."""
        low, high = np.array([self.low.min()]), np.array([self.high.max()])
        return replace(self, low=low, high=high, allowed_m=float(self._boxes[2].min()))

    @cached_property
    def pairs(self) -> Indices:
        """(2, n_pairs) segments, the lower number first."""
        return np.stack(np.triu_indices(self.n_segments, 1))

    def _gaps(self, angles: Reals, pose: Indices, i: Indices, j: Indices, depth: Reals | float = 0.0) -> Reals:
        """(n, n_bins) at most the distance of segment i from segment j shrunk by `depth`; negative: they meet."""
        turn, shift = self.placed(angles)
        centre, half_y, _ = self._boxes

        def seen(k: Indices) -> Points:
            middle = centre[None] + (k * self.length_m)[:, None]
            return turn[k, pose][:, None] * middle + shift[k, pose][:, None]

        half_z = 0.5 * self.length_m
        small_y, small_z = half_y - depth, half_z - np.broadcast_to(depth, half_y.shape)
        rel = (np.conj(turn[i, pose]) * turn[j, pose])[:, None]
        c, s = np.abs(rel.real), np.abs(rel.imag)
        between = seen(j) - seen(i)
        d = between * np.conj(turn[i, pose])[:, None]
        gap = np.abs(d.real) - (half_z + c * small_z + s * small_y)
        gap = np.maximum(gap, np.abs(d.imag) - (half_y + s * small_z + c * small_y))
        d = between * np.conj(turn[j, pose])[:, None]
        gap = np.maximum(gap, np.abs(d.real) - (small_z + c * half_z + s * half_y))
        return np.asarray(np.maximum(gap, np.abs(d.imag) - (small_y + s * half_z + c * half_y)))

    def hits(
        self, angles: Reals, pose: Indices, pair: Indices, depth: Reals | float | None = None
    ) -> NDArray[np.bool_]:
        """Whether `pair[k]` reaches deeper into each other at `pose[k]` than allowed, or than `depth`."""
        i, j = self.pairs[:, pair]
        within = self._boxes[2] if depth is None else depth
        first = self._gaps(angles, pose, i, j, within) < 0.0
        return np.asarray((first | (self._gaps(angles, pose, j, i, within) < 0.0)).any(axis=1))

    def depth_m(self, angles: Reals, pair: int) -> float:
        """Depth to which a point of one segment of a pair lies inside the other at one pose (n_segments - 1,)."""
        at, which = np.zeros(1, dtype=np.intp), np.array([pair], dtype=np.intp)
        lo, hi = 0.0, min(float(self._boxes[1].max()), 0.5 * self.length_m)
        while hi - lo > 0.01 * max(lo, 1e-3 * self.allowed_m):
            middle = 0.5 * (lo + hi)
            within = np.minimum(middle, 0.999 * self._boxes[1])
            if self.hits(angles[None], at, which, within)[0]:
                lo = middle
            else:
                hi = middle
        return 0.5 * (lo + hi)

    def deepest_m(self, angles: Reals) -> float:
        """A depth that no two segments exceed at any of these poses, within a factor of 2, metres."""
        pose, pair = (a.ravel() for a in np.indices((len(angles), self.pairs.shape[1])))
        deepest = self.allowed_m / 64.0
        while len(pose):
            hit = self.hits(angles, pose, pair, np.minimum(deepest, 0.5 * self._boxes[1]))
            pose, pair = pose[hit], pair[hit]
            if not hit.any() or deepest > self.length_m:
                break
            deepest *= 2.0
        return deepest

    def first_collision(self, angles: Reals, *, between: bool = True) -> SegmentCollision | None:
        """The deepest collision at a motion's first colliding pose, or None.

        Parameters
        ----------
        angles
            (n_poses, n_segments - 1) poses along the motion, straight lines between.
        between
            Whether the intervals between poses are certified too.
        """
        # What holds for the box round a whole segment holds for all of it, and is a bin instead of many.
        if len(self.low) > 1 and self._boxed.first_collision(angles, between=between) is None:
            return None
        low, high = angles[:-1], angles[1:]
        pose, pair = (a.ravel() for a in np.indices((len(angles), self.pairs.shape[1])))
        found = self._worst(angles, pose, pair)
        if found is not None or not between:
            return found
        apart = np.flatnonzero(self.pairs[1] > self.pairs[0] + 1)
        interval, pair = (a.ravel() for a in np.meshgrid(np.arange(len(low)), apart, indexing="ij"))
        while len(pair):
            need = self._travel(low, high, interval, pair) - 2.0 * float(self._boxes[2].min())
            i, j = self.pairs[:, pair]
            have = np.maximum(self._gaps(low, interval, i, j), 0.0) + np.maximum(
                self._gaps(high, interval, i, j), 0.0
            )
            still = (have < need[:, None]).any(axis=1)
            interval, pair = interval[still], pair[still]
            used, back = np.unique(interval, return_inverse=True)
            low, high = low[used], high[used]
            middle = 0.5 * (low + high)
            found = self._worst(middle, back, pair)
            if found is not None:
                return found
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
            interval, pair = np.concatenate([back, back + len(used)]), np.concatenate([pair, pair])
        return None

    def _worst(self, angles: Reals, pose: Indices, pair: Indices) -> SegmentCollision | None:
        hit = self.hits(angles, pose, pair)
        if not hit.any():
            return None
        first = pose[hit].min()
        touching = pair[hit & (pose == first)]
        depths = [self.depth_m(angles[first], int(p)) for p in touching]
        worst = int(np.argmax(depths))
        i, j = self.pairs[:, touching[worst]]
        return SegmentCollision((int(i), int(j)), tuple(float(a) for a in angles[first]), depths[worst])

    def _travel(self, low: Reals, high: Reals, interval: Indices, pair: Indices) -> Reals:
        """Bound of how far a segment moves, seen from the other, over an interval.

        Seen from the first, a point of the second is no farther from the hinge after segment `k` than the
        diagonals of the segments between, and turning about it by an angle moves it that far times the angle.
        """
        i, j = self.pairs[:, pair]
        height = float(np.max(self.high[self.high > self.low]) - np.min(self.low[self.high > self.low]))
        hinge = np.arange(self.n_segments - 1)
        reach = np.hypot(self.length_m, height) * (j[:, None] - hinge[None])
        turns = np.abs(high - low)[interval]
        return np.asarray((turns * reach * ((hinge >= i[:, None]) & (hinge < j[:, None]))).sum(axis=1))
