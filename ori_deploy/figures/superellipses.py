"""Packaging ratio per cell of superellipses: the paper's Fig. 4d."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ori_deploy.design.continuum import superellipse_table
from ori_deploy.figures.table import Table
from ori_deploy.profiles.profile import Reals

EXPONENTS = (2.0, 8.0)
ASPECTS = (0.1, 1.0)
"""First and last of the superellipses of Fig. 4d."""


@dataclass(frozen=True)
class EfficiencyMap:
    """Equation (8) per cell over superellipses.

    Attributes
    ----------
    exponent
        (k,) m, increasing.
    aspect
        (n,) height over width, increasing.
    eta_per_cell
        (n, k).
    """

    exponent: Reals
    aspect: Reals
    eta_per_cell: Reals


def efficiency_map(n_exponents: int = 61, n_aspects: int = 46) -> EfficiencyMap:
    """The data of Fig. 4d on an even grid."""
    exponent, aspect = np.linspace(*EXPONENTS, n_exponents), np.linspace(*ASPECTS, n_aspects)
    return EfficiencyMap(exponent, aspect, superellipse_table(aspect, exponent))


def efficiency_table(found: EfficiencyMap) -> Table:
    """One row per superellipse."""
    return Table(
        ("exponent", "aspect", "eta_per_cell"),
        [
            (float(m), float(aspect), float(found.eta_per_cell[j, i]))
            for j, aspect in enumerate(found.aspect)
            for i, m in enumerate(found.exponent)
        ],
    )
