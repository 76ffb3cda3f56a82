"""A way back onto the path for cells that are out of step: every pose of it checked for interference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, permutations

import numpy as np

from ori_deploy.errors import MotionError
from ori_deploy.motion.interference import Collision, Interference
from ori_deploy.profiles.profile import Reals

SAMPLE = 0.005
"""Fold between two poses that are checked; between them the check halves where it has to."""

SEATING_WAY = 0.02
"""Fold in which seating slits have to come apart."""

_ORDERS_UP_TO = 4


@dataclass(frozen=True, eq=False)
class Recovery:
    """A checked way from where the cells stand to a fold that all of them have.

    Attributes
    ----------
    fold
        (m, n_cells) corners of the way, straight lines between; the first is where the cells stand, in the
        last all are alike.
    n_poses
        Poses that were checked, those between them not counted.
    """

    fold: Reals
    n_poses: int

    @property
    def target(self) -> float:
        """Fold at which all cells are in step again."""
        return float(self.fold[-1, 0])


def find_recovery(interference: Interference, measured: Reals, *, contact_m: float = 0.0) -> Recovery:
    """The first free way found, shortest first: all cells at once, or one after the other.

    Parameters
    ----------
    interference
        Of the mechanism; its tolerance judges.
    measured
        (n_cells,) folds where the cells stand; what noise puts beyond an end counts as the end.
    contact_m
        Contact that the measured pose may have: what seating slits do to each other.

    Raises
    ------
    MotionError
        The measured pose itself is impossible, or no way was found; names the panels that are in the way.
    """
    if not np.isfinite(measured).all():
        raise MotionError("recovery: not every cell says where it stands", remedy="see to its sensor first")
    start = np.clip(measured, 0.0, 1.0)
    touching = interference.first_collision(start[None, :])
    if touching is not None and touching.depth_m > contact_m:
        size_m = interference.mechanism.size_m
        raise touching.error(
            max(interference.allowed_m, contact_m),
            size_m,
            "check zero_rad of both, or bring them apart by hand",
        )
    first: Collision | None = None
    for corners in _ways(start):
        poses = _dense(corners)
        # Where seating slits touch, the way has to lead out of it; only its beginning may.
        free_from = 1 + int(SEATING_WAY / SAMPLE) if touching is not None else 0
        found = interference.first_collision(poses[min(free_from, len(poses) - 1) :])
        if found is None:
            return Recovery(corners, len(poses))
        first = first or found
    if first is None:
        raise ValueError("no way was tried")
    remedy = "with torque off, bring the cells into step by hand"
    raise first.error(interference.allowed_m, interference.mechanism.size_m, remedy)


def _targets(start: Reals) -> list[float]:
    """Common folds, the one nearest to all cells first."""
    middle = 0.5 * (start.min() + start.max())
    some = {float(x) for x in (middle, np.median(start), start.min(), start.max(), 0.0, 1.0)}
    return sorted(some, key=lambda target: float(np.abs(start - target).max()))


def _ways(start: Reals) -> Iterator[Reals]:
    """Corners of ways to try."""
    targets = _targets(start)
    for target in targets:
        yield np.stack([start, np.full_like(start, target)])
    for target in targets:
        away = np.argsort(-np.abs(start - target))
        orders = permutations(range(len(start))) if len(start) <= _ORDERS_UP_TO else (away, away[::-1])
        for order in orders:
            yield _one_by_one(start, target, order)


def _one_by_one(start: Reals, target: float, order: object) -> Reals:
    corners = [start]
    for cell in np.asarray(order, dtype=np.intp):
        following = corners[-1].copy()
        following[cell] = target
        corners.append(following)
    return np.stack(corners)


def _dense(corners: Reals) -> Reals:
    """Poses along straight lines between corners, `SAMPLE` apart or less."""
    parts = []
    for a, b in pairwise(corners):
        count = max(1, int(np.ceil(np.abs(b - a).max() / SAMPLE)))
        parts.append(a + (np.arange(count) / count)[:, None] * (b - a))
    return np.concatenate([*parts, corners[-1:]])
