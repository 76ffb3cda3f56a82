"""Drag polars: C_D = C_D0 + k (C_L - C_L0)²."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.errors import InputError
from ori_deploy.profiles.profile import Reals


@dataclass(frozen=True)
class Polar:
    """A parabola of drag over lift.

    Attributes
    ----------
    cd0, k, cl0
        Least drag, its curvature, and the lift at which drag is least.
    """

    cd0: float
    k: float
    cl0: float

    def drag(self, lift: ArrayLike) -> Reals:
        """C_D at C_L, elementwise."""
        return np.asarray(self.cd0 + self.k * (np.asarray(lift, dtype=float) - self.cl0) ** 2)

    @property
    def best_lift(self) -> float:
        """C_L at which C_L / C_D is largest: where a line from the origin touches the parabola."""
        return float(np.sqrt(self.cd0 / self.k + self.cl0**2))

    def oswald(self, aspect_ratio: float) -> float:
        """The span efficiency that k would stand for were it all induced drag: 1 / (π A k)."""
        return 1.0 / (np.pi * aspect_ratio * self.k)


def fitted(lift: ArrayLike, drag: ArrayLike) -> tuple[Polar, float]:
    """The parabola nearest to points of a polar.

    Parameters
    ----------
    lift, drag
        (n,) coefficients, n >= 3.

    Returns
    -------
    The parabola, and its largest distance in C_D from the points.

    Raises
    ------
    InputError
        Too few points, all at the same lift, or drag that does not grow to both sides.
    """
    cl, cd = np.asarray(lift, dtype=float), np.asarray(drag, dtype=float)
    if len(np.unique(cl)) < 3:
        raise InputError(
            "polar: too few points for a parabola", value=len(np.unique(cl)), limit="3 different lift coefficients",
            remedy="look at more of them",
        )  # fmt: skip
    k, slope, constant = np.polyfit(cl, cd, 2)
    if not k > 0.0:
        raise InputError(
            "polar: drag does not grow with lift", value=f"k = {k:.3g}", limit="k > 0",
            remedy="check the section and the speed: the flow may be separated everywhere",
        )  # fmt: skip
    cl0 = -slope / (2.0 * k)
    polar = Polar(float(constant - k * cl0**2), float(k), float(cl0))
    return polar, float(np.abs(polar.drag(cl) - cd).max())
