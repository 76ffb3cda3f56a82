"""Long logs as curves of few points: lows and highs are kept, and what moves gets more room than what rests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ori_deploy.profiles.profile import Reals

Flags = NDArray[np.bool_]

MOST = 800
"""Stretches of rows that a curve is cut into; each is told by its lowest and its highest value."""
_REST = 0.5
"""Of the room of what moves, the most that what rests gets: hours of it are a straight line."""


def thinned(x: Reals, y: Reals, busy: Flags, most: int = MOST) -> tuple[Reals, Reals]:
    """Curves through the lows and highs of the stretches, as they are where they have few points.

    Parameters
    ----------
    x
        (n,) increasing.
    y
        (n, n_curves); NaN where nothing is known.
    busy
        (n,) whether something moves.
    """
    if len(x) <= 2 * most:
        return x, y
    starts = _stretches(busy, most)
    lasts = np.append(starts[1:], len(x)) - 1
    low, high = np.fmin.reduceat(y, starts), np.fmax.reduceat(y, starts)
    falls = y[lasts] < y[starts]
    ends = np.stack([np.where(falls, high, low), np.where(falls, low, high)], axis=1)
    keep = np.column_stack([np.ones(len(starts), dtype=bool), lasts > starts])
    return np.column_stack([x[starts], x[lasts]])[keep], ends[keep]


def _stretches(busy: Flags, most: int) -> NDArray[np.intp]:
    """First rows of the stretches; none has both what moves and what rests."""
    moves, rests = int(busy.sum()), int((~busy).sum())
    weight = np.where(busy, 1.0, min(1.0, _REST * max(moves, 1) / max(rests, 1)))
    until = np.cumsum(weight)
    number = np.floor(most * (until - weight) / until[-1]).astype(int)
    new = np.concatenate([[True], (np.diff(number) > 0) | (np.diff(busy.astype(int)) != 0)])
    return np.flatnonzero(new)
