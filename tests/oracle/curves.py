"""Closed counter-clockwise outlines as plain functions of a parameter s in [0, 1).

Nothing here is fast. Every quantity is found by dense sampling and, where more digits are wanted, a
refinement of the best sample by a bracketing method of scipy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, minimize_scalar

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Outline:
    """A closed counter-clockwise curve.

    Attributes
    ----------
    name : str
        What the curve is, for messages.
    point : callable
        Maps an array of parameters (any real numbers, period 1) of shape (...) to points (..., 2).
    """

    name: str
    point: Callable[[ArrayLike], Array]

    def at(self, s: float) -> Array:
        """Return the point at parameter `s`, shape (2,)."""
        return self.point(np.float64(s))

    def arc(self, s0: float, s1: float, n: int) -> Array:
        """Return n + 1 points from `s0` to `s1`, both included, with `s1 >= s0`."""
        return self.point(np.linspace(s0, s1, n + 1))

    def area(self, n: int = 400_000) -> float:
        """Return the enclosed area by the shoelace formula on `n` samples."""
        return shoelace(self.point(np.arange(n) / n))

    def forward(self, s0: float, s1: float) -> float:
        """Return `s1` shifted by whole periods so that it lies in (s0, s0 + 1]."""
        return s1 + np.ceil(s0 - s1) if s0 >= s1 or s1 - s0 > 1.0 else s1


def shoelace(points: Array) -> float:
    """Return the signed area of a polygon given by its vertices (n, 2)."""
    x, y = points[:, 0] - points[0, 0], points[:, 1] - points[0, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def superellipse(a: float, b: float, exponent: float = 2.0) -> Outline:
    """Return the superellipse x = a sgn(cos) |cos|^(2/m), y = b sgn(sin) |sin|^(2/m), s = angle / 2 pi."""

    def point(s: ArrayLike) -> Array:
        angle = 2.0 * np.pi * np.asarray(s, dtype=float)
        cos, sin = np.cos(angle), np.sin(angle)
        x = a * np.sign(cos) * np.abs(cos) ** (2.0 / exponent)
        y = b * np.sign(sin) * np.abs(sin) ** (2.0 / exponent)
        return np.stack([x, y], axis=-1)

    return Outline(f"superellipse {a} x {b}, exponent {exponent}", point)


def ellipse(a: float, b: float) -> Outline:
    """Return an ellipse in its natural parameter."""
    return superellipse(a, b, 2.0)


def naca4(code: str = "2412", chord: float = 1.0) -> Outline:
    """Return a NACA 4-digit section with a closed trailing edge.

    s = 0 is the trailing edge, s = 1/2 the nose; the upper surface comes first. The camber-line station is
    cos(pi s)^2, so that its square root, the leading term of the thickness, is the smooth cos(pi s).
    """
    camber, place, thickness = int(code[0]) / 100.0, int(code[1]) / 10.0, int(code[2:]) / 100.0

    def point(s: ArrayLike) -> Array:
        s = np.mod(np.asarray(s, dtype=float), 1.0)
        x = np.cos(np.pi * s) ** 2
        side = np.where(s <= 0.5, 1.0, -1.0)
        polynomial = 0.2969 * np.sqrt(x) - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4
        half = 5.0 * thickness * polynomial
        if camber == 0.0:
            mean, slope = np.zeros_like(x), np.zeros_like(x)
        else:
            divisor = np.where(x < place, place**2, (1.0 - place) ** 2)
            mean = camber / divisor * (np.where(x < place, 0.0, 1.0 - 2.0 * place) + 2.0 * place * x - x**2)
            slope = 2.0 * camber / divisor * (place - x)
        theta = np.arctan(slope)
        return chord * np.stack([x - side * half * np.sin(theta), mean + side * half * np.cos(theta)], axis=-1)

    return Outline(f"NACA {code}, chord {chord}", point)


def naca_parameter(outline: Outline, x_chord: float, side: str, *, reading: str = "surface") -> float:
    """Return the parameter of a point on one side of a section of unit chord.

    Parameters
    ----------
    outline : Outline
        A section made by `naca4` with chord 1.
    x_chord : float
        Station, 0 < x < 1 (0 is the nose and 1 the trailing edge on either side).
    side : {"upper", "lower"}
    reading : {"surface", "camber"}
        Whether `x_chord` is the x of the surface point itself or of its foot on the camber line.
    """
    if x_chord in (0.0, 1.0):
        return 0.5 if x_chord == 0.0 else 0.0
    if reading == "camber":
        s = float(np.arccos(np.sqrt(x_chord)) / np.pi)
        return s if side == "upper" else 1.0 - s
    low, high = (0.0, 0.5) if side == "upper" else (0.5, 1.0)
    return float(brentq(lambda s: outline.at(s)[0] - x_chord, low, high, xtol=1e-15, rtol=1e-14))


def largest(f: Callable[[Array], Array], s0: float, s1: float, n: int = 1000) -> float:
    """Return the largest value of a scalar function on [s0, s1]: sample, then refine the best sample."""
    s = np.linspace(s0, s1, n + 1)
    values = f(s)
    best = int(np.argmax(values))
    low, high = s[max(best - 1, 0)], s[min(best + 1, n)]
    refined = minimize_scalar(
        lambda x: -float(f(np.float64(x))), bounds=(low, high), method="bounded", options={"xatol": 1e-13}
    )
    return max(float(values[best]), -float(refined.fun))


def bulge(outline: Outline, s0: float, s1: float, *, outward: bool = True) -> float:
    """Return the largest distance of the arc s0..s1 from its chord, outward or inward (never below 0).

    On a counter-clockwise outline the outside lies to the right of the chord taken from `s0` to `s1`.
    """
    p, q = outline.at(s0), outline.at(s1)
    length = float(np.hypot(*(q - p)))
    if length == 0.0:
        return 0.0
    unit = (q - p) / length
    sign = -1.0 if outward else 1.0

    def height(s: Array) -> Array:
        d = outline.point(s) - p
        return sign * (unit[0] * d[..., 1] - unit[1] * d[..., 0])

    return max(0.0, largest(height, s0, s1))
