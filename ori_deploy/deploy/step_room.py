"""How fast cells may go when some are out of step, so that all can still be stopped in time.

One cell may be stuck where it is while the others follow the command to where it stops. So what counts is
the distance between that cell and the place where the command can be brought to rest, and the plan's step
tolerance everywhere on the way there.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ori_deploy.deploy.path import PathTable
from ori_deploy.motion.step_tolerance import StepTolerance

FloatArray = NDArray[np.float64]

REACTION_CYCLES = 2.0
"""Cycles between a cell's moving and the first command that takes it into account."""

USABLE = 0.9
"""Part of the step tolerance that is used; the rest is for noise, resolution and free play of the sensors."""


class StepRoom:
    """Room that the step tolerance leaves ahead of the command.

    Parameters
    ----------
    tolerance
        The plan's.
    table
        The path.
    slew_per_s
        Slope with which the path rate can be brought to zero.
    reaction_s
        Between a cell's moving and the first command that takes it into account.
    """

    def __init__(self, tolerance: StepTolerance, table: PathTable, slew_per_s: float, reaction_s: float) -> None:
        self._table = table
        self._end = np.asarray(tolerance.lead, dtype=np.float64)  # zone k: leads from begin to end
        self._begin = np.append(0.0, self._end[:-1])
        self._allowed = USABLE * np.array([tolerance.allowed(float(lead)) for lead in self._end])
        self._slew = slew_per_s
        self._reaction_s = reaction_s
        self._fold_rate = _largest_nearby(table, 0.5 / slew_per_s + self._reaction_s)

    def allowed(self, folds: FloatArray) -> float:
        """Largest spread that may be used with the cells where they are."""
        k = int(np.searchsorted(self._end, float(folds.max())))
        return float(self._allowed[min(k, len(self._end) - 1)])

    def ahead(self, folds: FloatArray, commanded: float) -> float:
        """How far the command can go on opening, in fold, with the hindmost cell stuck; 0 or more."""
        low, lead = float(folds.min()), max(float(folds.max()), commanded)
        begin = np.maximum(self._begin, lead)
        stop = np.maximum(begin, low + self._allowed)
        stops_inside = (stop < self._end) & (begin <= self._end)
        k = int(np.argmax(stops_inside))
        end = float(stop[k]) if stops_inside[k] else max(low + float(self._allowed[-1]), 1.0)
        if lead - low >= self.allowed(np.append(folds, commanded)):
            return 0.0
        return max(end - commanded, 0.0)

    def behind(self, folds: FloatArray, commanded: float) -> float:
        """How far the command can go on closing, in fold, with the foremost cell stuck; 0 or more."""
        lead = max(float(folds.max()), commanded)
        lowest = np.minimum(self._end, lead) - self._allowed
        concerned = self._begin < lead
        end = float(lowest[concerned].max()) if concerned.any() else -math.inf
        return max(min(float(folds.min()), commanded) - end, 0.0)

    def rate_limit(
        self, folds: FloatArray, commanded: float, path_time_s: float, direction: float, part: float = 1.0
    ) -> float:
        """Largest path rate, 0 to 1, from which the command can be stopped inside a part of the room it has.

        With fold rate F, slope s and reaction time t a stop from rate r takes `F (r t + r**2 / (2 s))`.
        """
        room = self.ahead(folds, commanded) if direction > 0.0 else self.behind(folds, commanded)
        fold_rate = self._fold_rate[self._table.row(path_time_s)]
        path_s, slew = part * room / fold_rate, self._slew
        reaction = slew * self._reaction_s
        return min(1.0, math.sqrt(reaction * reaction + 2.0 * slew * path_s) - reaction)


def _largest_nearby(table: PathTable, window_s: float) -> FloatArray:
    """(n,) largest fold rate at full rate within `window_s` of each row."""
    rate = np.diff(table.fold) / np.diff(table.time_s)
    rows = math.ceil(window_s / float(np.diff(table.time_s).max())) + 1
    padded = np.pad(np.append(rate, rate[-1]), rows, mode="edge")
    largest: FloatArray = sliding_window_view(padded, 2 * rows + 1).max(axis=1)
    return largest
