"""Where the structure is: the fold of every cell, from what its driven crease measures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.result import StartRefused

FloatArray = NDArray[np.float64]


class Localiser:
    """Inverse of the plan's table, one strictly monotone column per hinge.

    All columns are searched at once: column i is scaled onto [2 i, 2 i + 1] and all of them are laid end to
    end in one sorted array.
    """

    def __init__(self, table: PathTable) -> None:
        shaft = table.shaft_rad
        n, n_hinges = shaft.shape
        self._first = shaft[0]
        self._span = shaft[-1] - shaft[0]
        self._offset = 2.0 * np.arange(n_hinges)
        scaled = (shaft - self._first) / self._span + self._offset
        self._keys = np.ascontiguousarray(scaled.T).ravel()
        self._fold = np.tile(table.fold, n_hinges)
        self._low = n * np.arange(n_hinges)
        self._high = self._low + n - 2

    def folds(self, shaft_rad: FloatArray) -> FloatArray:
        """Fold of every cell.

        Parameters
        ----------
        shaft_rad
            (n_hinges,) measured positions; NaN where there is none.

        Returns
        -------
        (n_hinges,) folds; NaN for NaN. Beyond the ends of the table the first and last interval are
        continued as straight lines, so that what is out of range shows as a fold below 0 or above 1.
        """
        key = (shaft_rad - self._first) / self._span + self._offset
        i = np.searchsorted(self._keys, key, side="right") - 1
        i = np.minimum(np.maximum(i, self._low), self._high)
        left, fold = self._keys[i], self._fold[i]
        folds: FloatArray = fold + (key - left) * ((self._fold[i + 1] - fold) / (self._keys[i + 1] - left))
        return folds


def locate(
    shaft_rad: FloatArray, folds: FloatArray, allowed_spread: float, table: PathTable, rig: ResolvedRig
) -> float:
    """Path time of the place nearest to where the structure stands.

    Parameters
    ----------
    shaft_rad, folds
        (n_hinges,) measured positions and the folds they mean, all valid.
    allowed_spread
        Largest difference of fold between any two cells.

    Raises
    ------
    StartRefused
        Cells are out of step by `allowed_spread` or more, or a crease is farther from the path
        than `start_tolerance_rad`.
    """
    low, high = int(np.argmin(folds)), int(np.argmax(folds))
    spread = float(folds[high] - folds[low])
    if not spread < allowed_spread:  # true for NaN as well
        middle = float(np.median(folds))
        worst = low if middle - folds[low] > folds[high] - middle else high
        raise StartRefused(
            f"cell {rig.cell_ids[worst]} is out of step with the others",
            value=f"fold {folds[worst]:.4f} against {middle:.4f}; "
            f"spread of all cells {spread:.4f} ({rig.cell_ids[low]} to {rig.cell_ids[high]})",
            limit=f"the plan's step tolerance, here {allowed_spread:.4f}",
            remedy=f"`ori-deploy recover` looks for a safe way back; or, with torque off, move cell "
            f"{rig.cell_ids[worst]} to the fold of the others",
        )
    path_time = table.time_at(float(folds.mean()))
    away = np.abs(rig.to_crease(shaft_rad) - rig.to_crease(table.shaft_at(path_time)))
    worst = int(np.argmax(away))
    if not away[worst] <= rig.controller.start_tolerance_rad:
        raise StartRefused(
            f"crease {rig.hinges[worst].crease} of cell {rig.cell_ids[worst]} is off the path",
            value=f"{away[worst]:.4f} rad from fold {folds.mean():.4f}",
            limit=f"start_tolerance_rad = {rig.controller.start_tolerance_rad:.4f}",
            remedy=f"`ori-deploy recover` looks for a safe way back; or, with torque off, move cell "
            f"{rig.cell_ids[worst]} to the path; or correct zero_rad of its hinge",
            source=rig.source,
        )
    return path_time
