"""NACA 4-digit and 5-digit airfoils with a closed trailing edge."""

from __future__ import annotations

import re
from abc import abstractmethod

import numpy as np

from ori_deploy.errors import ProfileError
from ori_deploy.profiles.piecewise import interpolated
from ori_deploy.profiles.profile import Points, Profile, Reals, Side

_THICKNESS = np.array([0.2969, -0.1260, -0.3516, 0.2843, -0.1036])
"""Coefficients of sqrt(x), x, x^2, x^3, x^4 (Abbott & von Doenhoff, sec. 6.4); the last is the usual
-0.1036 in place of -0.1015, which closes the trailing edge."""

_ROUNDING = 4e-15
"""Distance in chords between the formulas and the polynomials that stand in for them: a few roundings."""


class NacaSection(Profile):
    """A camber line with the NACA thickness set off on both sides, nose at the origin, trailing edge at (chord, 0).

    Starts at the trailing edge, runs over the upper side to the nose and back along the lower side.
    The parameter is `1 - sqrt(x_c)` above and `1 + sqrt(x_c)` below, `x_c` along the camber line: the
    outline is smooth in it round the nose.

    Parameters
    ----------
    code
        Checked by the family; the last two digits are the thickness in hundredths of the chord.
    chord_m
        Metres, > 0.
    joint
        Where the camber line's two pieces meet, in chords; 0 where there is one piece.
    """

    def __init__(self, code: str, chord_m: float, joint: float, resolution: int) -> None:
        if not (np.isfinite(chord_m) and chord_m > 0.0):
            raise ProfileError(
                "profile: chord_m must be a positive number",
                value=chord_m,
                limit="chord_m > 0",
                remedy="give metres",
            )
        self.code, self.chord_m = code, float(chord_m)
        self._thickness = int(code[-2:]) / 100.0
        root = np.sqrt(joint)
        breaks = [0.0, 1.0] if root == 0.0 else [0.0, 1.0 - root, 1.0, 1.0 + root]
        self._curve = interpolated(
            lambda s: self.chord_m * self._surface(s), np.array(breaks), 2.0, _ROUNDING * self.chord_m
        )
        super().__init__(2.0, breaks, resolution)

    @property
    def kind(self) -> str:
        return "naca"

    def describe(self) -> dict[str, object]:
        return {"kind": "naca", "code": self.code, "chord_m": self.chord_m}

    def at_chord(self, x_chord: float, side: Side) -> float:
        if x_chord in (0.0, 1.0):
            return 1.0 - x_chord
        return chord_crossing(self, x_chord, side, nose=1.0)

    @abstractmethod
    def _camber_line(self, x: Reals) -> tuple[Reals, Reals]:
        """Height and slope of the camber line at `x` chords."""

    def _surface(self, s: Reals) -> Points:
        """The section in chords at `s`, from the textbook's formulas."""
        sigma = s - 1.0
        r = np.abs(sigma)
        x = r * r
        y, slope = self._camber_line(x)
        c0, c1, c2, c3, c4 = 5.0 * self._thickness * _THICKNESS
        half = r * (c0 + r * (c1 + x * (c2 + x * (c3 + x * c4))))
        # Thickness is set off along the camber line's normal: upwards above, downwards below.
        normal = np.where(sigma < 0.0, 1.0, -1.0) * (1j - slope) / np.sqrt(1.0 + slope * slope)
        return np.asarray(x + 1j * y + half * normal)

    def _evaluate(self, s: Reals, order: int) -> tuple[Points, ...]:
        return self._curve.evaluate(s, order)


class Naca4(NacaSection):
    """A NACA 4-digit section. See `NacaSection`.

    Parameters
    ----------
    code
        Four digits: camber in hundredths, its place in tenths, thickness in hundredths of the chord.
    chord_m
        Metres, > 0.
    """

    def __init__(self, code: str, chord_m: float, *, resolution: int = 512) -> None:
        if not re.fullmatch(r"\d{4}", code) or code[2:] == "00" or (code[0] != "0" and code[1] == "0"):
            raise ProfileError(
                "profile: code is not a NACA 4-digit section",
                value=repr(code),
                limit="four digits, the last two not 00, no camber without its place",
                remedy='for example code = "2412"',
            )
        self._camber, self._place = int(code[0]) / 100.0, int(code[1]) / 10.0
        if self._camber == 0.0 or self._place == 0.0:
            self._camber, self._place = 0.0, 0.0
        super().__init__(code, chord_m, self._place, resolution)

    def _camber_line(self, x: Reals) -> tuple[Reals, Reals]:
        if self._camber == 0.0:
            return np.zeros_like(x), np.zeros_like(x)
        fore = x < self._place
        factor = self._camber / np.where(fore, self._place, 1.0 - self._place) ** 2
        constant = np.where(fore, 0.0, 1.0 - 2.0 * self._place)
        height = factor * (constant + 2.0 * self._place * x - x * x)
        return height, 2.0 * factor * (self._place - x)


class Naca5(NacaSection):
    """A NACA 5-digit section, with standard (…0..) or reflex (…1..) camber line. See `NacaSection`.

    The constants are those of the tables (Jacobs & Pinkerton, NACA report 537; Abbott & von Doenhoff,
    sec. 6.5), for a design lift coefficient of 0.3; others scale the camber.

    Parameters
    ----------
    code
        Five digits: design lift coefficient over 0.15, place of the largest camber in twentieths of the chord,
        0 for standard and 1 for reflex camber, thickness in hundredths of the chord.
    chord_m
        Metres, > 0.
    """

    def __init__(self, code: str, chord_m: float, *, resolution: int = 512) -> None:
        table = _FIVE_DIGIT.get(code[1:3])
        if not re.fullmatch(r"\d{5}", code) or code[0] == "0" or code[3:] == "00" or table is None:
            raise ProfileError(
                "profile: code is not a NACA 5-digit section",
                value=repr(code),
                limit=f"five digits, the first and the last two not 0, the middle two {' '.join(_FIVE_DIGIT)}",
                remedy='for example code = "23012"',
            )
        self._joint, k1, self._aft = table
        self._sixth = k1 / 6.0 * int(code[0]) / 2.0
        super().__init__(code, chord_m, self._joint, resolution)

    def _camber_line(self, x: Reals) -> tuple[Reals, Reals]:
        m, aft = self._joint, self._aft
        factor = np.where(x < m, 1.0, aft)
        fall = aft * (1.0 - m) ** 3 + m**3
        return (
            self._sixth * (factor * (x - m) ** 3 - fall * x + m**3),
            self._sixth * (3.0 * factor * (x - m) ** 2 - fall),
        )


_FIVE_DIGIT = {
    "10": (0.0580, 361.400, 0.0),
    "20": (0.1260, 51.640, 0.0),
    "30": (0.2025, 15.957, 0.0),
    "40": (0.2900, 6.643, 0.0),
    "50": (0.3910, 3.230, 0.0),
    "21": (0.1300, 51.990, 0.000764),
    "31": (0.2170, 15.793, 0.00677),
    "41": (0.3180, 6.520, 0.0303),
    "51": (0.4410, 3.191, 0.1355),
}
"""Joint of the camber line's two cubics, k1, and k2/k1 of the one behind, by the code's middle digits."""


def naca_section(code: str, chord_m: float) -> NacaSection:
    """The NACA section of four or five digits. See `Naca4`, `Naca5`.

    Raises
    ------
    ProfileError
        No such section.
    """
    if not re.fullmatch(r"\d{4,5}", code):
        raise ProfileError(
            "profile: code is not a NACA section",
            value=repr(code),
            limit="four or five digits",
            remedy='for example code = "2412" or "23012"',
        )
    return Naca5(code, chord_m) if len(code) == 5 else Naca4(code, chord_m)


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
    roots = [float(root) for root in s[gap == 0.0]]
    for k in np.flatnonzero(gap[:-1] * gap[1:] < 0.0):
        lo, hi, rising = float(s[k]), float(s[k + 1]), gap[k] < 0.0
        for _ in range(80):
            middle = 0.5 * (lo + hi)
            if (float(profile.point(middle).real) < target) == rising:
                lo = middle
            else:
                hi = middle
        roots.append(0.5 * (lo + hi))
    roots.sort()
    distinct = [r for k, r in enumerate(roots) if k == 0 or r - roots[k - 1] > 1e-9 * profile.period]
    if len(distinct) != 1:
        x = np.round(profile.point(s).real / chord, 9) + 0.0  # for people: no roundings of 0, no -0
        raise ProfileError(
            f"x_chord: {len(distinct) or 'no'} places on the {side} side",
            value=x_chord,
            limit=f"exactly one place, {x.min():.6g} <= x_chord <= {x.max():.6g}",
            remedy="use arc = (fraction of the outline's length) instead" if distinct else "give x over chord",
        )
    return distinct[0] % profile.period
