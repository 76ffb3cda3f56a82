"""NACA 4-digit airfoils with a closed trailing edge."""

from __future__ import annotations

import re

import numpy as np

from ori_deploy.errors import ProfileError
from ori_deploy.profiles.profile import Points, Profile, Reals, Side

_THICKNESS = np.array([0.2969, -0.1260, -0.3516, 0.2843, -0.1036])
"""Coefficients of sqrt(x), x, x^2, x^3, x^4 (Abbott & von Doenhoff, sec. 6.4); the last is the usual
-0.1036 in place of -0.1015, which closes the trailing edge."""
_POWERS = np.array([1, 2, 4, 6, 8])


class Naca4(Profile):
    """A NACA 4-digit section of given chord, nose at the origin, trailing edge at (chord, 0).

    Starts at the trailing edge, runs over the upper side to the nose and back along the lower side.
    The parameter is `1 - sqrt(x_c)` above and `1 + sqrt(x_c)` below, `x_c` along the camber line: the
    outline is smooth in it round the nose.

    Parameters
    ----------
    code
        Four digits: camber in hundredths, its place in tenths, thickness in hundredths of the chord.
    chord_m
        Metres, > 0.
    """

    def __init__(self, code: str, chord_m: float, *, resolution: int = 512) -> None:
        if not re.fullmatch(r"\d{4}", code) or code[2:] == "00":
            raise ProfileError(
                "profile: code is not a NACA 4-digit section",
                value=repr(code),
                limit="four digits, the last two not 00",
                remedy='for example code = "2412"',
            )
        if not (np.isfinite(chord_m) and chord_m > 0.0):
            raise ProfileError(
                "profile: chord_m must be a positive number",
                value=chord_m,
                limit="chord_m > 0",
                remedy="give metres",
            )
        self.code, self.chord_m = code, float(chord_m)
        self._camber, self._place = int(code[0]) / 100.0, int(code[1]) / 10.0
        if self._camber == 0.0 or self._place == 0.0:
            self._camber, self._place = 0.0, 0.0
        self._thickness = int(code[2:]) / 100.0
        root = np.sqrt(self._place)
        breaks = [0.0, 1.0] if root == 0.0 else [0.0, 1.0 - root, 1.0, 1.0 + root]
        super().__init__(2.0, breaks, resolution)

    @property
    def kind(self) -> str:
        return "naca"

    def describe(self) -> dict[str, object]:
        return {"kind": "naca", "code": self.code, "chord_m": self.chord_m}

    def at_chord(self, x_chord: float, side: Side) -> float:
        if x_chord == 0.0:
            return 1.0
        if x_chord == 1.0:
            return 0.0
        return chord_crossing(self, x_chord, side, nose=1.0)

    def _camber_line(self, x: Reals) -> tuple[Reals, Reals, Reals]:
        """Height, slope and second derivative of the camber line at `x` chords."""
        if self._camber == 0.0:
            zero = np.zeros_like(x)
            return zero, zero, zero
        fore = x < self._place
        factor = self._camber / np.where(fore, self._place, 1.0 - self._place) ** 2
        constant = np.where(fore, 0.0, 1.0 - 2.0 * self._place)
        return (
            factor * (constant + 2.0 * self._place * x - x * x),
            2.0 * factor * (self._place - x),
            -2.0 * factor,
        )

    def _evaluate(self, s: Reals, order: int) -> tuple[Points, ...]:
        sign = np.where(s < 1.0, -1.0, 1.0)
        r = np.abs(s - 1.0)
        x = r * r
        y, slope, bend = self._camber_line(x)
        powers = [r ** (p - 1) for p in _POWERS]
        scale = 5.0 * self._thickness
        half = scale * sum(c * q for c, q in zip(_THICKNESS, powers, strict=True)) * r
        # The side's normal: +i e^(i theta) above, -i e^(i theta) below.
        normal = -1j * sign * (1.0 + 1j * slope) / np.sqrt(1.0 + slope * slope)
        f = x + 1j * y + half * normal
        if order == 0:
            return (self.chord_m * f,)
        d_half = scale * sum(c * p * q for c, p, q in zip(_THICKNESS, _POWERS, powers, strict=True))
        turn = bend * 2.0 * r / (1.0 + slope * slope)
        d_normal = 1j * turn * normal
        df = 2.0 * r * (1.0 + 1j * slope) + d_half * normal + half * d_normal
        if order == 1:
            return self.chord_m * f, self.chord_m * sign * df
        terms = zip(_THICKNESS[1:], _POWERS[1:], powers[1:], strict=True)
        # r^(p - 2): one power less than d_half has; the square-root term has none left.
        dd_half = scale * sum(c * p * (p - 1) * (q / np.maximum(r, 1e-300)) for c, p, q in terms)
        d_turn = 2.0 * bend / (1.0 + slope * slope) - 2.0 * slope * turn * turn
        dd_normal = (1j * d_turn - turn * turn) * normal
        ddf = (
            2.0 * (1.0 + 1j * slope) + 4.0j * x * bend + dd_half * normal + 2.0 * d_half * d_normal + half * dd_normal
        )
        return self.chord_m * f, self.chord_m * sign * df, self.chord_m * ddf


def chord_crossing(profile: Profile, x_chord: float, side: Side, nose: float, chord_m: float | None = None) -> float:
    """Parameter where an airfoil's side has `x = x_chord * chord`.

    Parameters
    ----------
    profile
        An outline that starts at the trailing edge and runs over the upper side first.
    x_chord
        In chords.
    side
        "upper": from the start to the nose; "lower": from the nose to the end.
    nose
        Parameter at which the sides meet.
    chord_m
        Metres; the profile's own `chord_m` where left out.

    Raises
    ------
    ProfileError
        No place, or more than one, has this `x` on this side.
    """
    chord = float(getattr(profile, "chord_m", 1.0)) if chord_m is None else chord_m
    target = x_chord * chord
    ends = np.append(profile.table_s, profile.period)
    start, stop = (0.0, nose) if side == "upper" else (nose, profile.period)
    inside = ends[(ends > start) & (ends < stop)]
    s = np.concatenate([[start], inside, [stop]])
    gap = profile.point(s).real - target
    found = np.flatnonzero(gap[:-1] * gap[1:] <= 0.0)
    roots: list[float] = []
    for k in found:
        lo, hi, g_lo = float(s[k]), float(s[k + 1]), float(gap[k])
        for _ in range(80):
            middle = 0.5 * (lo + hi)
            g = float(profile.point(middle).real) - target
            if (g <= 0.0) == (g_lo <= 0.0):
                lo = middle
            else:
                hi = middle
        roots.append(0.5 * (lo + hi))
    distinct = [r for k, r in enumerate(roots) if k == 0 or r - roots[k - 1] > 1e-9 * profile.period]
    if len(distinct) != 1:
        x = profile.point(s).real / chord
        raise ProfileError(
            f"x_chord: {len(distinct) or 'no'} places on the {side} side",
            value=x_chord,
            limit=f"exactly one place, {x.min():.6g} <= x_chord <= {x.max():.6g}",
            remedy="use arc = (fraction of the outline's length) instead" if distinct else "give x over chord",
        )
    return distinct[0] % profile.period
