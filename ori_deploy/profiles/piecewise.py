"""Piecewise polynomials with points of the plane as values: one cheap way to evaluate many curves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Points = NDArray[np.complex128]


class PiecewisePolynomial:
    """A curve given by a polynomial on each interval between knots.

    All derivatives come from one gather and one product, whatever the degree: for a dozen points the
    number of array operations is what costs, not the arithmetic.

    Parameters
    ----------
    knots
        (n + 1,) increasing.
    coefficients
        (n, degree + 1) of the powers 0, 1, … of the distance from each interval's first knot.
    """

    def __init__(self, knots: Reals, coefficients: Points) -> None:
        self.knots = knots
        power = np.arange(coefficients.shape[1])
        first = np.zeros_like(coefficients)
        first[:, :-1] = (power * coefficients)[:, 1:]
        second = np.zeros_like(coefficients)
        second[:, :-1] = (power * first)[:, 1:]
        self._tables = np.stack([coefficients, first, second], axis=1)
        self._inner = knots[1:-1]
        self._degree = coefficients.shape[1] - 1

    def evaluate(self, s: Reals, order: int) -> tuple[Points, ...]:
        """Value and the first `order` (0 to 2) derivatives at `s` inside the knots; right-hand ones at knots."""
        index = self._inner.searchsorted(s, side="right")
        powers = np.empty((*np.shape(s), self._degree + 1, 1))
        powers[..., 0, 0] = 1.0
        powers[..., 1:, 0] = (s - self.knots[index])[..., None]
        np.multiply.accumulate(powers, axis=-2, out=powers)
        values = self._tables[index, : order + 1] @ powers
        return tuple(values[..., k, 0] for k in range(order + 1))


_DEGREE = 9
_FIRST_PIECES = 32
_HALVINGS = 12


def interpolated(
    curve: Callable[[Reals], Points], breaks: Reals, stop: float, tolerance: float
) -> PiecewisePolynomial:
    """A curve that is analytic between breaks, as polynomials through Chebyshev points.

    Parameters
    ----------
    curve
        Maps parameters of any shape to points.
    breaks
        Increasing, the first 0: no polynomial runs across one.
    stop
        End of the last piece.
    tolerance
        Distance from the curve at which a piece is good enough; others are halved, a dozen times at most.
    """
    # In [0, 1], clear of the ends: a curve's values at a break belong to one side only.
    node = 0.5 * (1.0 - np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1)))
    probe = 0.5 * (node[1:] + node[:-1])
    fit = np.vander(node, increasing=True)
    look = np.vander(probe, _DEGREE + 1, increasing=True).T
    ends = np.append(breaks, stop)
    counts = np.maximum(np.round(_FIRST_PIECES * np.diff(ends) / stop), 1).astype(int)
    start = np.concatenate(
        [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(breaks, ends[1:], counts, strict=True)]
    )
    width = np.diff(start, append=stop)
    for _ in range(_HALVINGS):
        unit = np.linalg.solve(fit, curve(start[:, None] + width[:, None] * node).T).T
        off = np.abs(unit @ look - curve(start[:, None] + width[:, None] * probe)).max(axis=1)
        coarse = np.flatnonzero(off > tolerance)
        if not len(coarse):
            break
        width[coarse] *= 0.5
        start, width = (
            np.insert(start, coarse + 1, start[coarse] + width[coarse]),
            np.insert(width, coarse + 1, width[coarse]),
        )
    unit = np.linalg.solve(fit, curve(start[:, None] + width[:, None] * node).T).T
    return PiecewisePolynomial(np.append(start, stop), np.asarray(unit / width[:, None] ** np.arange(_DEGREE + 1)))
