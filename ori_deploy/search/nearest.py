"""Where on an outline a place is, or nearest to it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ori_deploy.profiles import Profile

_SEEDS = 6
"""Stretches of the outline's table that are looked at closely: more than it has equally near ones."""

_STEPS = 60


@lru_cache(maxsize=256)
def nearest_parameter(profile: Profile, place: complex) -> float:
    """Parameter of the outline's point nearest to a place.

    Parameters
    ----------
    profile
        The outline.
    place
        Metres. Where it lies on the outline the answer is exact to rounding.
    """
    n, away = len(profile.table_s), np.abs(profile.table_f - place)
    valleys = np.flatnonzero((away <= np.roll(away, 1)) & (away <= np.roll(away, -1)))
    best_s, best = 0.0, np.inf
    for k in valleys[np.argsort(away[valleys])][:_SEEDS]:
        middle = float(profile.table_s[k])
        left = float(profile.table_s[k - 1]) - (profile.period if k == 0 else 0.0)
        right = float(profile.table_s[(k + 1) % n]) + (profile.period if k == n - 1 else 0.0)
        # A corner is a point of the table: each side of it is followed by itself.
        for low, high in ((left, middle), (middle, right)):
            s = _followed(profile, place, low, high)
            for candidate in (s, middle):
                distance = abs(complex(profile.point(candidate)) - place)
                if distance < best:
                    best_s, best = candidate % profile.period, distance
    return best_s


def _followed(profile: Profile, place: complex, low: float, high: float) -> float:
    """Newton steps from the middle of a stretch, halving it wherever they leave what is left of it."""
    s = 0.5 * (low + high)
    for _ in range(_STEPS):
        f, along, bend = (complex(z) for z in profile.evaluate(s, 2))
        fall = ((f - place) * along.conjugate()).real
        low, high = (low, s) if fall > 0.0 else (s, high)
        steep = abs(along) ** 2 + ((f - place) * bend.conjugate()).real
        moved = s - fall / steep if steep > 0.0 else low - 1.0
        if not low <= moved <= high:
            moved = 0.5 * (low + high)
        if abs(moved - s) <= 1e-16 * profile.period:
            break
        s = moved
    return s
