"""What touches what at one pose: interference with its depth, of panels and of span segments, and the clearance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.motion import Collision, Interference, Linkage, SpanFolding
from ori_deploy.motion.contact import Indices
from ori_deploy.motion.spanwise_contact import SegmentCollision
from ori_deploy.profiles.profile import Reals

_MOST = 6
"""Collisions whose depth is told, the deepest; where everything crosses everything, nobody reads more."""

_PROBED = (0.2, 0.5, 0.8)
_BATCH = 128


@dataclass(frozen=True)
class Verdict:
    """What a pose is like.

    Attributes
    ----------
    collisions
        The deepest, deepest first.
    clearance_m, clearance_panels
        The smallest distance between two panels that are not joined; None where there are no such.
    others
        Pairs that reach into each other besides, none deeper.
    segments
        The deepest collision of two span segments, or None.
    """

    collisions: tuple[Collision, ...]
    clearance_m: float | None
    clearance_panels: tuple[str, str]
    others: tuple[tuple[str, str], ...] = ()
    segments: SegmentCollision | None = None

    @property
    def red(self) -> frozenset[str]:
        """All panels that reach into another one."""
        told = (one.panels for one in self.collisions)
        return frozenset(name for pair in (*told, *self.others) for name in pair)


@dataclass(frozen=True)
class Judge:
    """Judges poses of one mechanism.

    Attributes
    ----------
    mechanism
        Whose.
    span
        How it folds across the span; None where that is in one piece.
    """

    mechanism: Linkage[Any]
    span: SpanFolding | None = None

    @cached_property
    def _interference(self) -> Interference:
        return Interference(self.mechanism)

    @cached_property
    def _free(self) -> Indices:
        """Pairs that share no crease and do not always touch, as panels at a flat skin do."""
        i = self._interference
        pairs = np.flatnonzero(~i.hinged)
        poses = self.mechanism.poses(np.array(_PROBED))
        always = np.ones(len(pairs), dtype=bool)
        for k in range(len(_PROBED)):
            at = np.full(len(pairs), k)
            always &= i.contact.distances(poses, at, *i.pairs[:, pairs]) <= 1e-9 * self.mechanism.size_m
        return np.asarray(pairs[~always])

    def judge(self, fold: ArrayLike, span_folded: float = 0.0) -> Verdict:
        """At one fold per cell (n_cells,), and the span folded from 0, straight, to 1."""
        row = np.asarray(fold, dtype=float)
        i = self._interference
        deep, others = i.deepest(row, i.touching(row), _MOST)
        told = [Collision(self._ids(pair), tuple(row.tolist()), i.depth_m(row, int(pair))) for pair in deep]
        distance, panels = self._clearance(row)
        return Verdict(
            tuple(sorted(told, key=lambda one: -one.depth_m)),
            distance,
            panels,
            tuple(self._ids(pair) for pair in others),
            self._segments(span_folded),
        )

    def _segments(self, folded: float) -> SegmentCollision | None:
        """Segments of which one reaches into another, as `plan` judges them: by the boxes round slices of each."""
        if self.span is None or folded <= 0.0:
            return None  # side by side they share nothing but their ends
        angles = np.full((1, self.span.segments - 1), np.pi * folded)
        return self.span.chain.first_collision(angles, between=False)

    def _ids(self, pair: np.intp) -> tuple[str, str]:
        ids = self.mechanism.layout.panel_ids
        a, b = self._interference.pairs[:, pair]
        return ids[a], ids[b]

    def _clearance(self, row: Reals) -> tuple[float | None, tuple[str, str]]:
        """Nearest first by the boxes round them, until the boxes are farther apart than the nearest panels."""
        i, pairs = self._interference, self._free
        poses = self.mechanism.poses(row[None, :])
        bound = i.contact.gaps(poses, np.zeros_like(pairs), *i.pairs[:, pairs])
        order = np.argsort(bound)
        best, where = np.inf, -1
        for start in range(0, len(order), _BATCH):
            batch = order[start : start + _BATCH]
            if bound[batch[0]] >= best:
                break
            distance = i.contact.distances(poses, np.zeros_like(batch), *i.pairs[:, pairs[batch]])
            if distance.min() < best:
                best, where = float(distance.min()), int(batch[np.argmin(distance)])
        if where < 0:
            return None, ("", "")
        a, b = i.pairs[:, pairs[where]]
        ids = self.mechanism.layout.panel_ids
        return best, (ids[a], ids[b])
