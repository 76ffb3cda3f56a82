"""Integrals along an outline to a stated accuracy, whatever the integrand does at the outline's breaks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ori_deploy.errors import ProfileError
from ori_deploy.profiles.profile import Points, Profile, Reals

Integrand = Callable[[Reals], Points | Reals]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(15)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
_ROUNDS = 60
_MOST_PIECES = 200_000
_RESOLVED = 1e-12
"""Shortest piece, over the period, in which rounding leaves some digits of the distance from a break."""
_UNRESOLVED = 1e-6
"""Share of the integral that may lie in doubt in shorter ones; more means that there is no integral."""


@dataclass(frozen=True)
class OutlineIntegral:
    """An integral over a whole outline, in pieces that follow each other.

    Each piece is Gauss-Legendre in a variable t in [0, 1] between two breaks, `s = break + width w(t)`
    with w = 35 t⁴ - 84 t⁵ + 70 t⁶ - 20 t⁷: dw vanishes like t³ at both ends, which makes an integrand
    like `|s - break|^a` tame for every a > -1.

    Attributes
    ----------
    integrand
        Of the profile's parameter, an array of any shape.
    origin, width
        (n,) the break before each piece and the distance to the next.
    start, stop
        (n,) the piece's ends in t.
    value
        (n,) the integral over each piece.
    """

    integrand: Integrand
    origin: Reals
    width: Reals
    start: Reals
    stop: Reals
    value: Points

    @property
    def total(self) -> complex:
        return complex(self.value.sum())

    def parameters(self, shares: Reals) -> Reals:
        """Parameters up to which the integral, a positive real one, has the given values; shaped like `shares`."""
        below = np.append(0.0, np.cumsum(self.value.real))
        k = np.clip(np.searchsorted(below, shares, side="right") - 1, 0, len(self.value) - 1)
        origin, width, start = self.origin[k], self.width[k], self.start[k]
        lo, hi = start.copy(), self.stop[k]
        for _ in range(52):
            middle = 0.5 * (lo + hi)
            reached = below[k] + _gauss(self.integrand, origin, width, start, middle).real
            short = reached < shares
            lo, hi = np.where(short, middle, lo), np.where(short, hi, middle)
        return origin + width * _clustered(0.5 * (lo + hi))[0]


def integrate(profile: Profile, integrand: Integrand, goal: float = 1e-10) -> OutlineIntegral:
    """Integrate along the whole outline, halving pieces until each is good enough.

    Parameters
    ----------
    profile
        The outline; its breaks are the only places where the integrand may be singular.
    integrand
        Of the profile's parameter; real or complex, an array shaped like its argument.
    goal
        Error relative to the integral of the absolute value.

    Raises
    ------
    ProfileError
        The integral does not settle: the integrand is too singular.
    """
    ends = np.append(profile.breaks, profile.period)
    origin, width = ends[:-1], np.diff(ends)
    start, stop = np.zeros_like(origin), np.ones_like(origin)
    whole = _gauss(integrand, origin, width, start, stop)
    done: list[tuple[Reals, Reals, Reals, Reals, Points]] = []
    settled = unresolved = 0.0
    for _ in range(_ROUNDS):
        middle = 0.5 * (start + stop)
        halves = np.stack([
            _gauss(integrand, origin, width, start, middle),
            _gauss(integrand, origin, width, middle, stop),
        ])  # fmt: skip
        scale = settled + float(np.abs(halves).sum())
        # A half is far better than what the whole and its halves differ by.
        off = np.abs(halves.sum(axis=0) - whole)
        good = off <= goal * scale / len(profile.breaks)
        # Next to a break the parameter has no more digits to tell places apart by.
        short = ~good & (width * (_clustered(stop)[0] - _clustered(start)[0]) <= _RESOLVED * profile.period)
        unresolved += float(off[short].sum())
        if unresolved > _UNRESOLVED * scale:
            break
        good |= short
        for half, a, b in ((halves[0], start, middle), (halves[1], middle, stop)):
            done.append((origin[good], width[good], a[good], b[good], half[good]))
            settled += float(np.abs(half[good]).sum())
        if good.all():
            parts = [np.concatenate(part) for part in zip(*done, strict=True)]
            order = np.lexsort((parts[2], parts[0]))
            return OutlineIntegral(integrand, *(part[order] for part in parts))
        again = ~good
        origin, width = np.tile(origin[again], 2), np.tile(width[again], 2)
        start, stop = np.append(start[again], middle[again]), np.append(middle[again], stop[again])
        whole = halves[:, again].ravel()
        if not np.isfinite(whole).all() or len(whole) > _MOST_PIECES:
            break
    raise ProfileError(
        "profile: an integral along the outline does not settle",
        value=f"near s = {float(origin[0] + width[0] * _clustered(start[:1])[0][0]):.6g}",
        limit=f"relative error {goal:.0e}",
        remedy="a smoother outline",
    )


def _clustered(t: Reals) -> tuple[Reals, Reals]:
    """w(t) and its derivative."""
    return t**4 * (35.0 + t * (-84.0 + t * (70.0 - 20.0 * t))), 140.0 * (t * (1.0 - t)) ** 3


def _gauss(integrand: Integrand, origin: Reals, width: Reals, start: Reals, stop: Reals) -> Points:
    """(n,) integral over each piece by one Gauss-Legendre rule."""
    t = start[..., None] + (stop - start)[..., None] * _NODES
    share, density = _clustered(t)
    first, last = origin[..., None], (origin + width)[..., None]
    # Rounded onto a break, a place would belong to the next piece, or have no finite value.
    s = np.clip(first + width[..., None] * share, first + 4.0 * np.spacing(last), last - 4.0 * np.spacing(last))
    value = integrand(s) * density
    return np.asarray((value @ _WEIGHTS) * width * (stop - start), dtype=np.complex128)
