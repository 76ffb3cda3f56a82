"""A way back onto the path for cells that are out of step: every pose of it checked for interference.

Cells that are out of step while seating stand with a slit's face pressed against what it closes on. That contact is
by design, and no way out begins without it; so it alone is let be while it parts: from pose to pose it may not get
deeper, and soon it has to be over. Everything else is checked from the first pose on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, permutations

import numpy as np

from ori_deploy.errors import MotionError
from ori_deploy.motion.contact import Indices
from ori_deploy.motion.interference import Collision, Interference
from ori_deploy.profiles.profile import Reals

SAMPLE = 0.005
"""Fold between two poses that are checked; between them the check halves where it has to."""

SEATING_WAY = 0.02
"""Fold in which seating slits have to come apart; until then no contact of theirs may get deeper."""

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
    touching = _contact_by_design(interference, start, contact_m)
    first: Collision | None = None
    for corners in _ways(start):
        poses = _dense(corners)
        found = _in_the_way(interference, poses, touching)
        if found is None:
            return Recovery(corners, len(poses))
        first = first or found
    if first is None:
        raise ValueError("no way was tried")
    remedy = "with torque off, bring the cells into step by hand"
    raise first.error(interference.allowed_m, interference.mechanism.size_m, remedy)


def _contact_by_design(interference: Interference, start: Reals, contact_m: float) -> Indices:
    """Pairs that touch where the cells stand: slits' faces and what they close on, no deeper than they may."""
    touching = interference.touching(start)
    faces = np.flatnonzero(interference.mechanism.layout.is_slit)
    at_slit = np.asarray(np.isin(interference.pairs[:, touching], faces).any(axis=0))
    depth_m = np.array([interference.depth_m(start, int(pair)) for pair in touching])
    wrong = depth_m > np.where(at_slit, contact_m, 0.0)
    found = interference.first_collision(start[None, :], pairs=touching[wrong])
    if found is not None:
        limit_m = max(interference.allowed_m, contact_m if at_slit[wrong].all() else 0.0)
        remedy = "check zero_rad of both, or bring them apart by hand"
        raise found.error(limit_m, interference.mechanism.size_m, remedy)
    return touching


def _in_the_way(interference: Interference, poses: Reals, touching: Indices) -> Collision | None:
    """What collides along a way on which pairs that touch at its beginning may part."""
    others = np.setdiff1d(np.arange(interference.pairs.shape[1]), touching)
    found = interference.first_collision(poses, pairs=others)
    for pair in touching:
        found = found or _holding_on(interference, poses, int(pair))
    return found


def _holding_on(interference: Interference, poses: Reals, pair: int) -> Collision | None:
    """Where a pair that touches at first gets deeper, or touches too long, or again."""
    one, parted = np.array([pair]), min(int(SEATING_WAY / SAMPLE), len(poses) - 1)
    for k in range(parted):
        depth_m = interference.depth_m(poses[k], pair)
        if depth_m <= interference.allowed_m:
            return interference.first_collision(poses[k:], pairs=one)
        found = interference.first_deeper(poses[k : k + 2], pair, depth_m)
        if found is not None:
            return found
    return interference.first_collision(poses[parted:], pairs=one)


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
