"""Root search for opening creases, all corners at once: the same in the plane and on the sphere."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ori_deploy.profiles.profile import Reals

Rims = Callable[[Reals], tuple[Reals, Reals, Reals, Reals]]
"""Maps parameters (n,) to the rim thicknesses before and after, and their derivatives."""

_STEPS = 100
_LOOKS = 33


def newton(rims: Rims, lo: Reals, hi: Reals, s: Reals, floor: float, close: float) -> tuple[Reals, Reals, Reals]:
    """Newton's method kept inside brackets: before less after is negative at `lo`, positive at `hi`.

    Parameters
    ----------
    rims
        What is to be equal.
    lo, hi, s
        (n,) brackets, and where to begin in them.
    floor
        Step of the parameter below which there is nothing to gain.
    close
        Difference that counts as none.

    Returns
    -------
    s and the rim thicknesses before and after at it; (n,) each.
    """
    for _ in range(_STEPS):
        before, after, d_before, d_after = rims(s)
        gap, slope = before - after, d_before - d_after
        low = gap < 0.0
        lo, hi = np.where(low, s, lo), np.where(low, hi, s)
        found = (np.abs(gap) <= close) | (hi - lo <= floor)
        if found.all():
            break
        step = s - gap / np.where(slope == 0.0, 1.0, slope)
        usable = (slope > 0.0) & (step >= lo) & (step <= hi)
        new = np.where(found, s, np.where(usable, step, 0.5 * (lo + hi)))
        if (np.abs(new - s) <= floor).all():
            break
        s = new
    return s, before, after


def first_brackets(rims: Rims, lo: Reals, hi: Reals, forward: NDArray[np.bool_]) -> tuple[Reals, Reals]:
    """Narrow each bracket to its first sign change seen from the opening vertex, for outlines with hollows.

    `forward`: whether the opening vertex is at the lower end.
    """
    near, far = np.where(forward, lo, hi), np.where(forward, hi, lo)
    found, previous = far.copy(), near.copy()
    open_still = near != far
    for t in np.linspace(0.0, 1.0, _LOOKS)[1:]:
        s = near + t * (far - near)
        before, after, _, _ = rims(s)
        crossed = open_still & (np.where(forward, before - after, after - before) >= 0.0)
        found[crossed] = s[crossed]
        open_still &= ~crossed
        previous[open_still] = s[open_still]
        if not open_still.any():
            break
    return np.where(forward, previous, found), np.where(forward, found, previous)
