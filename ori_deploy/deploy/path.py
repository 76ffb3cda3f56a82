"""The path: a checked plan as shaft positions over path time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.motion.plan import Plan

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PathTable:
    """A plan as shaft positions over path time; (n,) and (n, n_hinges) arrays.

    Attributes
    ----------
    time_s, fold
        As in the plan.
    shaft_rad, shaft_rate_rad_s
        Position and rate of every shaft at full rate.
    peak_crease_rate_rad_s
        (n_cells, 4) largest rate of every crease, driven or not, at full rate.
    """

    time_s: FloatArray
    fold: FloatArray
    shaft_rad: FloatArray
    shaft_rate_rad_s: FloatArray
    peak_crease_rate_rad_s: FloatArray

    @classmethod
    def build(cls, plan: Plan, rig: ResolvedRig) -> PathTable:
        """Translate a plan for a rig that fits it (see `ori_deploy.deploy.fit`)."""
        return cls(
            time_s=plan.time_s,
            fold=plan.fold,
            shaft_rad=rig.to_actuator(plan.crease_angles_rad),
            shaft_rate_rad_s=rig.shaft_per_crease * rig.driven(plan.crease_rates_rad_s),
            peak_crease_rate_rad_s=np.abs(plan.crease_rates_rad_s).max(axis=0),
        )

    @property
    def duration_s(self) -> float:
        """Path time at fold 1."""
        return float(self.time_s[-1])

    def shaft_at(self, path_time_s: float) -> FloatArray:
        """(n_hinges,) shaft positions, by cubic Hermite interpolation."""
        i, width, u = self._locate(path_time_s)
        v = 1.0 - u
        h01 = u * u * (3.0 - 2.0 * u)
        position: FloatArray = (
            (1.0 - h01) * self.shaft_rad[i]
            + h01 * self.shaft_rad[i + 1]
            + (width * u * v * v) * self.shaft_rate_rad_s[i]
            - (width * u * u * v) * self.shaft_rate_rad_s[i + 1]
        )
        return position

    def shaft_rate_at(self, path_time_s: float) -> FloatArray:
        """(n_hinges,) shaft rates at full rate: the derivative of `shaft_at`."""
        i, width, u = self._locate(path_time_s)
        way = (6.0 * u * (1.0 - u) / width) * (self.shaft_rad[i + 1] - self.shaft_rad[i])
        begin, end = (1.0 - u) * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
        rate: FloatArray = way + begin * self.shaft_rate_rad_s[i] + end * self.shaft_rate_rad_s[i + 1]
        return rate

    def fold_at(self, path_time_s: float) -> float:
        """Fold variable, by linear interpolation."""
        i, _, u = self._locate(path_time_s)
        return float((1.0 - u) * self.fold[i] + u * self.fold[i + 1])

    def time_at(self, fold: float) -> float:
        """Path time at a fold; folds outside [0, 1] give the nearest end."""
        return float(np.interp(fold, self.fold, self.time_s))

    def row(self, path_time_s: float) -> int:
        """Row at which the interval around a path time begins."""
        i = int(np.searchsorted(self.time_s, path_time_s, side="right")) - 1
        return min(max(i, 0), len(self.time_s) - 2)

    def _locate(self, path_time_s: float) -> tuple[int, float, float]:
        """Row, width of the interval that begins there, and the part of it that has passed."""
        i = self.row(path_time_s)
        start = float(self.time_s[i])
        width = float(self.time_s[i + 1]) - start
        return i, width, min(max((path_time_s - start) / width, 0.0), 1.0)
