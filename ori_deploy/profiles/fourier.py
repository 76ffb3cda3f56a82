"""Outlines that are trigonometric polynomials: smooth everywhere, derivatives exact."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from ori_deploy.errors import ProfileError
from ori_deploy.profiles.profile import Points, Profile, Reals

MOST_LEAVES = 24
"""Of a clover: more are ripples."""


class FourierOutline(Profile):
    """`f(s) = sum of c_k exp(i k s)`, 0 <= s < 2 pi.

    Parameters
    ----------
    coefficients
        c_k in metres by harmonic k, positive and negative ones.
    """

    def __init__(self, coefficients: dict[int, complex], resolution: int) -> None:
        harmonics = np.array(sorted(coefficients))
        self._lowest = int(harmonics[0])
        dense = np.zeros(int(harmonics[-1]) - self._lowest + 1, dtype=complex)
        dense[harmonics - self._lowest] = [coefficients[int(k)] for k in harmonics]
        factor = 1j * (np.arange(len(dense)) + self._lowest)
        self._tables = np.stack([dense, factor * dense, factor * factor * dense], axis=1)
        super().__init__(2.0 * np.pi, [0.0], max(resolution, 64 * int(np.abs(harmonics).max())))

    @property
    @abstractmethod
    def kind(self) -> str: ...

    def at_natural(self, angle: float) -> float:
        return float(angle % self.period)

    def _evaluate(self, s: Reals, order: int) -> tuple[Points, ...]:
        turn = np.exp(1j * s)
        powers = np.empty((*np.shape(s), len(self._tables)), dtype=complex)
        powers[..., 0] = turn**self._lowest
        powers[..., 1:] = turn[..., None]
        np.multiply.accumulate(powers, axis=-1, out=powers)
        values = powers @ self._tables[:, : order + 1]
        return tuple(values[..., k] for k in range(order + 1))


class Clover(FourierOutline):
    """A clover: `r = radius (1 + depth cos(leaves θ))` over the polar angle θ, hollow between the leaves.

    Starts at the tip of the leaf on the x axis. The parameter and the natural parameter are θ.

    Parameters
    ----------
    radius_m
        Mean of the largest and the smallest radius, metres, > 0.
    depth
        In (0, 1): tips lie at radius (1 + depth), hollows at radius (1 - depth). An outline that is hollow
        between its leaves for `depth > 1 / (leaves² + 1)`, smaller depths make it round.
    leaves
        Whole number from 2 to 24.
    """

    def __init__(self, radius_m: float, depth: float, leaves: int = 3, *, resolution: int = 512) -> None:
        _check_length("radius_m", radius_m)
        if not 0.0 < depth < 1.0:
            raise ProfileError(
                "profile: depth of a clover",
                value=depth,
                limit="0 < depth < 1",
                remedy="0.3 is a clover of three leaves",
            )
        if isinstance(leaves, bool) or not isinstance(leaves, int) or not 2 <= leaves <= MOST_LEAVES:
            raise ProfileError(
                "profile: leaves of a clover",
                value=leaves,
                limit=f"a whole number, 2 <= leaves <= {MOST_LEAVES}",
                remedy="a clover has 3 or 4",
            )
        self.radius_m, self.depth, self.leaves = float(radius_m), float(depth), leaves
        half = 0.5 * self.radius_m * self.depth
        super().__init__({1: self.radius_m, 1 + leaves: half, 1 - leaves: half}, resolution)

    @property
    def kind(self) -> str:
        return "clover"

    def describe(self) -> dict[str, object]:
        return {"kind": "clover", "radius_m": self.radius_m, "depth": self.depth, "leaves": self.leaves}


class Heart(FourierOutline):
    """A heart: one notch at the top, a rounded tip at the bottom, smooth all round.

    In half widths, `x = 0.82 sin s - 0.18 sin 3s`, `y = -0.81 cos s - 0.25 cos 2s + 0.09 cos 3s - 0.04 cos 4s`:
    the well-known `16 sin^3` heart with the cusps at notch and tip rounded off (there its x has 3/4 and 1/4).
    Starts at the tip, symmetric about x = 0. The parameter and the natural parameter are s: tip 0, notch pi.

    Parameters
    ----------
    width_m
        Metres, > 0.
    """

    def __init__(self, width_m: float, *, resolution: int = 512) -> None:
        _check_length("width_m", width_m)
        self.width_m = float(width_m)
        coefficients: dict[int, complex] = {}
        for k, x in _HEART_X.items():
            coefficients[k] = coefficients.get(k, 0.0) - 0.25j * self.width_m * x
            coefficients[-k] = coefficients.get(-k, 0.0) + 0.25j * self.width_m * x
        for k, y in _HEART_Y.items():
            coefficients[k] = coefficients.get(k, 0.0) + 0.25j * self.width_m * y
            coefficients[-k] = coefficients.get(-k, 0.0) + 0.25j * self.width_m * y
        super().__init__(coefficients, resolution)

    @property
    def kind(self) -> str:
        return "heart"

    def describe(self) -> dict[str, object]:
        return {"kind": "heart", "width_m": self.width_m}


_HEART_X = {1: 0.82, 3: -0.18}
"""Sine terms of x in half widths. With less than a quarter in the third, x is largest, and 1, at s = pi/2."""
_HEART_Y = {1: -0.81, 2: -0.25, 3: 0.09, 4: -0.04}


def _check_length(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise ProfileError(
            f"profile: {name} must be a positive number", value=value, limit=f"{name} > 0", remedy="give metres"
        )
