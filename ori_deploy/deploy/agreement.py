"""Whether the journal and the measured pose tell the same of where the structure is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.journal import Entry
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.result import StartRefused
from ori_deploy.motion.plan import Plan

FloatArray = NDArray[np.float64]

LOOK = "look at the structure; if it stands as measured, start with --trust-measured"


def check_agreement(entry: Entry, folds: FloatArray, plan: Plan, table: PathTable, rig: ResolvedRig) -> None:
    """Refuse to start where the last entry of the journal and the measured folds disagree.

    Parameters
    ----------
    entry
        What was being done when somebody last wrote.
    folds
        (n_cells,) measured.

    Raises
    ------
    StartRefused
        The journal is another structure's, or a driven crease is measured farther than
        `start_tolerance_rad` from every fold that the entry allows.
    """
    if entry.design_sha256 and plan.design_sha256 and entry.design_sha256 != plan.design_sha256:
        raise StartRefused(
            "the journal is of another design",
            value=f"{entry.design_sha256[:12]}, {entry}",
            limit=f"{plan.design_sha256[:12]}, the plan's",
            remedy=f"give the plan that fits, or {LOOK}",
            source=rig.source,
        )
    low, high = entry.folds
    allowed = np.clip(folds, low, high)
    away = np.abs(rig.to_crease(_shafts(folds, table)) - rig.to_crease(_shafts(allowed, table)))
    worst = int(np.argmax(away))
    if not away[worst] <= rig.controller.start_tolerance_rad:
        raise StartRefused(
            f"cell {rig.cell_ids[worst]} is not where the journal says",
            value=f"fold {folds[worst]:.4f}, {away[worst]:.4f} rad of its crease off; the journal: {entry}",
            limit=f"start_tolerance_rad = {rig.controller.start_tolerance_rad:.4f}",
            remedy=LOOK,
            source=rig.source,
        )


def _shafts(folds: FloatArray, table: PathTable) -> FloatArray:
    """(n_hinges,) shaft positions of cells that each have a fold of their own, beyond the ends as at the ends."""
    return np.array([np.interp(fold, table.fold, table.shaft_rad[:, i]) for i, fold in enumerate(folds)])
