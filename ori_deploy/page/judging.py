"""What touches what at one pose: interference with its depth, and the smallest clearance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.motion import Collision, Interference, Linkage
from ori_deploy.motion.contact import Indices
from ori_deploy.profiles.profile import Reals

_MOST = 6
"""Collisions whose depth is told; where everything crosses everything, nobody reads more."""

_PROBED = (0.2, 0.5, 0.8)
_BATCH = 128


@dataclass(frozen=True)
class Verdict:
    """What a pose is like.

    Attributes
    ----------
    collisions
        Deepest first.
    clearance_m, clearance_panels
        The smallest distance between two panels that are not joined; None where there are no such.
    """

    collisions: tuple[Collision, ...]
    clearance_m: float | None
    clearance_panels: tuple[str, str]

    @property
    def red(self) -> frozenset[str]:
        """Panels that reach into each other."""
        return frozenset(name for one in self.collisions for name in one.panels)


@dataclass(frozen=True)
class Judge:
    """Judges poses of one mechanism.

    Attributes
    ----------
    mechanism
        Whose.
    """

    mechanism: Linkage[Any]

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

    def judge(self, fold: ArrayLike) -> Verdict:
        """At one fold per cell (n_cells,)."""
        row = np.asarray(fold, dtype=float)
        i, ids = self._interference, self.mechanism.layout.panel_ids
        deep = [
            Collision((ids[a], ids[b]), tuple(row.tolist()), i.depth_m(row, int(pair)))
            for pair in i.touching(row)[:_MOST]
            for a, b in [i.pairs[:, pair]]
        ]
        distance, panels = self._clearance(row)
        return Verdict(tuple(sorted(deep, key=lambda one: -one.depth_m)), distance, panels)

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
