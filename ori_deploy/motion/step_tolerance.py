"""How far cells may fall out of step before panels can touch: the safe step tolerance.

It depends on where along the motion the structure is. Mid-way cells may be a sixth of the whole
motion apart and more. Towards the deployed end the slits' faces close on each other, and there the
tolerance falls to the fold at which the allowed penetration is used up: that last stretch is the
seating, where contact at the slits is not an accident but what the latches are for.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ori_deploy.motion.interference import Interference
from ori_deploy.profiles.profile import Reals

_SPREADS = np.concatenate([np.geomspace(0.0025, 0.64, 17), [0.8, 1.0]])
_LEADS = np.concatenate(
    [np.linspace(0.0, 0.9, 19)[1:], [0.92, 0.94, 0.95, 0.96, 0.97, 0.98, 0.985, 0.99, 0.995, 1.0]]
)
_EXHAUSTIVE_CELLS = 6
_FINE_CELLS = 8
_PATTERNS = 48

SEATING_SPREAD = 0.02
"""Spread of fold a controller can hold with hobby-grade feedback (a degree on a cell that opens by 50).
Where less than this is free, the structure is seating."""


@dataclass(frozen=True)
class StepTolerance:
    """Safe step tolerance along the motion.

    Attributes
    ----------
    lead
        (m,) increasing fold of the cell that is furthest open, the last 1.
    spread
        (m,) largest difference of fold between any two cells that is free of interference, for leads
        from the previous entry to this one. 1.0 where any spread is.
    seating_fold
        Lead beyond which less than `SEATING_SPREAD` is free.
    seating_depth_m
        Deepest contact that cells up to `SEATING_SPREAD` apart can make beyond it.
    """

    lead: NDArray[np.float64]
    spread: NDArray[np.float64]
    seating_fold: float
    seating_depth_m: float

    @property
    def smallest(self) -> float:
        """Smallest tolerance before seating begins: one number for people."""
        before = self.lead <= self.seating_fold
        return float(self.spread[before].min()) if before.any() else 0.0

    def allowed(self, lead: float) -> float:
        """Largest spread a controller may let happen when the furthest cell is at `lead`.

        While seating, where less is free of contact, it is `SEATING_SPREAD`: contact at the slits is
        then expected, `seating_depth_m` deep at most.
        """
        index = min(int(np.searchsorted(self.lead, lead)), len(self.lead) - 1)
        return max(float(self.spread[index]), SEATING_SPREAD)


def out_of_step_patterns(interference: Interference, seed: int = 0) -> Reals:
    """Ways in which cells lead (1) or lag (0), (n_patterns, n_cells), each with some cell at 0 and some at 1.

    Up to 6 cells: every choice of leading cells, and as many graded ones, seeded. Beyond: every cell
    alone leading or lagging, every bond with all cells on one side of it leading, and seeded choices.
    """
    n = interference.mechanism.n_cells
    if n == 1:
        return np.empty((0, 1))
    generator = np.random.default_rng(seed)
    if n <= _EXHAUSTIVE_CELLS:
        sharp = np.array(list(product((0.0, 1.0), repeat=n))[1:-1])
    else:
        single = np.eye(n)
        sides = np.zeros((n, n))
        for cell, _, bonded in reversed(interference.mechanism.layout.folding_order):
            sides[cell, cell] = 1.0
            if bonded >= 0:
                sides[bonded // 4] = np.maximum(sides[bonded // 4], sides[cell])
        sides = sides[~(sides == 1.0).all(axis=1)]
        chosen = generator.integers(0, 2, (_PATTERNS, n)).astype(float)
        chosen = chosen[np.ptp(chosen, axis=1) > 0.0]
        sharp = np.unique(np.concatenate([single, 1.0 - single, sides, 1.0 - sides, chosen]), axis=0)
        sharp = sharp[np.sort(generator.permutation(len(sharp))[: 2 * _PATTERNS])]
    graded = generator.random((min(len(sharp), _PATTERNS), n))
    low, high = graded.min(axis=1, keepdims=True), graded.max(axis=1, keepdims=True)
    return np.concatenate([sharp, (graded - low) / (high - low)])


def _free(interference: Interference, patterns: Reals, lead: float, spread: float) -> bool:
    folds = np.clip(lead - spread * (1.0 - patterns), 0.0, 1.0)
    return interference.first_collision(folds, between=False) is None


def _largest_free(interference: Interference, patterns: Reals, lead: float, ladder: Reals) -> float:
    """Largest spread on the ladder with it and all smaller ones free; 1.0 where all that fit below `lead` are."""
    safe = 0.0
    for spread in ladder[ladder < lead]:
        if not _free(interference, patterns, lead, spread):
            return safe
        safe = float(spread)
    return 1.0 if _free(interference, patterns, lead, lead) else safe


def step_tolerance(interference: Interference, seed: int = 0) -> StepTolerance:
    """The safe step tolerance along the whole motion.

    Parameters
    ----------
    interference
        Of the mechanism; its tolerance judges.
    seed
        Of the patterns that are drawn at random.
    """
    patterns = out_of_step_patterns(interference, seed)
    if not len(patterns):
        return StepTolerance(np.array([1.0]), np.array([1.0]), 1.0, 0.0)
    # Many cells: every second rung and lead keeps planning a matter of seconds. Coarser is safer, not riskier.
    stride = 1 if interference.mechanism.n_cells <= _FINE_CELLS else 2
    leads, ladder = _LEADS[::-stride][::-1], _SPREADS[::stride]
    at_lead = np.array([_largest_free(interference, patterns, float(lead), ladder) for lead in leads])
    # Between two leads the smaller of both counts.
    spread = np.minimum(at_lead, np.append(at_lead[0], at_lead[:-1]))
    tight = np.flatnonzero(spread < SEATING_SPREAD)
    if not len(tight):
        return StepTolerance(leads, spread, 1.0, 0.0)
    seating_fold = float(leads[tight[0] - 1]) if tight[0] > 0 else 0.0
    late = leads[leads >= seating_fold]
    folds = np.clip(late[:, None, None] - SEATING_SPREAD * (1.0 - patterns), 0.0, 1.0).reshape(-1, patterns.shape[1])
    depth = max(interference.penetration_bound_m(some) for some in np.array_split(folds, 1 + len(folds) // 2000))
    return StepTolerance(leads, spread, seating_fold, depth)
