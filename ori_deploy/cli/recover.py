"""Looking for a way back into step, from where the cells are measured."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click
import numpy as np

from ori_deploy.deploy.controller import Controller
from ori_deploy.errors import InputError
from ori_deploy.files import load_design
from ori_deploy.motion import Interference, Plan
from ori_deploy.motion.mechanism_of import mechanism_of
from ori_deploy.motion.recovery import find_recovery

LOOKS = 10
"""Cycles whose readings are averaged: a way begins where the cells stand, not where one reading says."""


def recovering(design_file: Path | None, plan: Plan) -> Callable[[Controller], None]:
    """What finds a way for an armed controller and starts it on that way.

    Raises
    ------
    InputError
        The design is not the plan's.
    """
    if design_file is None:
        raise InputError("--design: needed to look for a way", remedy="give the design file that was planned")
    design = load_design(design_file)
    if plan.design_sha256 and design.sha256 != plan.design_sha256:
        raise InputError(
            f"{design_file}: not the design of this plan",
            value=design.sha256[:12],
            limit=f"{plan.design_sha256[:12]}, the plan's",
            remedy="give the design file that was planned",
        )
    interference = Interference(mechanism_of(design.structure, design.r_max_m))

    def start(controller: Controller) -> None:
        measured = np.array([controller.step().folds for _ in range(LOOKS)])
        folds = np.nanmean(measured, axis=0)
        found = find_recovery(interference, folds, contact_m=plan.step_tolerance.seating_depth_m)
        stands = ", ".join(f"{name} {fold:.3f}" for name, fold in zip(plan.cell_ids, folds, strict=True))
        click.echo(f"cells stand at fold {stands}; all go to {found.target:.3f}, {found.n_poses} poses checked")
        controller.recover(found)

    return start
