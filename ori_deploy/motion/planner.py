"""From a structure and crease limits to a checked plan."""

from __future__ import annotations

from itertools import islice

import numpy as np

from ori_deploy.errors import MotionError
from ori_deploy.motion.interference import Interference
from ori_deploy.motion.mechanism import AnyStructure
from ori_deploy.motion.mechanism_of import mechanism_of
from ori_deploy.motion.plan import MotionCheck, Plan
from ori_deploy.motion.slits import TRIED, checked_folds, free_slits
from ori_deploy.motion.step_tolerance import step_tolerance
from ori_deploy.motion.timing import check_limits, time_path
from ori_deploy.profiles.profile import Reals
from ori_deploy.tolerance import TOLERANCE, Tolerance

_CLEARANCE_RANGE = (0.05, 0.95)
_CLEARANCE_POSES = 181


def _remedy(interference: Interference) -> str:
    free = list(islice(free_slits(interference.mechanism.structure, interference.tolerance), 3))
    if not free:
        return f"thinner walls, or move the vertices of these cells: none of up to {TRIED} choices of slits is free"
    written = [str([list(pair) for pair in slits]).replace("'", '"') for slits in free]
    return f"slits = {' or '.join(written)} would be free"


def check_motion(interference: Interference) -> MotionCheck:
    """Check the motion with all cells in step, flat to deployed.

    Raises
    ------
    MotionError
        Two panels reach into each other deeper than allowed: names the pair, the fold and the depth.
    """
    folds = checked_folds(interference.mechanism, interference.tolerance)
    collision = interference.first_collision(folds)
    if collision is not None:
        size_m = interference.mechanism.size_m
        raise collision.error(interference.allowed_m, size_m, _remedy(interference))
    clearance = interference.clearance(np.linspace(*_CLEARANCE_RANGE, _CLEARANCE_POSES))
    return MotionCheck(
        n_poses=len(folds),
        deepest_penetration_m=interference.penetration_bound_m(folds),
        allowed_penetration_m=interference.allowed_m,
        smallest_clearance_m=clearance.distance_m,
        clearance_fold_range=_CLEARANCE_RANGE,
        clearance_panels=clearance.panels,
        clearance_fold=clearance.fold,
    )


def plan_motion(
    structure: AnyStructure,
    velocity: Reals,
    acceleration: Reals,
    rate_hz: float,
    *,
    r_max_m: float = 1.0,
    design_sha256: str = "",
    design_name: str = "",
    tolerance: Tolerance = TOLERANCE,
) -> Plan:
    """Plan the deployment of a structure: check it, find its step tolerance, time it.

    Parameters
    ----------
    structure
        What moves.
    velocity, acceleration
        (n_cells, 4) limits of every crease's angle, rad/s and rad/s2, creases in the order of
        `CREASES`; inf where there is none.
    rate_hz
        Sampling rate of the plan and of the control loop.
    r_max_m
        Outer radius of a truncated cone, at which the check's lengths are told; of no meaning to a cylinder.
    design_sha256, design_name
        Where the structure comes from.

    Raises
    ------
    MotionError
        The motion collides, cells have to be in step more closely than any controller can, or no
        timing satisfies the limits.
    """
    layout = structure.layout
    shape = (layout.n_cells, 4)
    for limits, what in ((velocity, "velocity"), (acceleration, "acceleration")):
        if limits.shape != shape:
            raise MotionError(
                f"{what} limits: wrong shape", value=limits.shape, limit=f"{shape}", remedy="one per crease"
            )
        check_limits(limits, what, layout.cell_ids)
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise MotionError("rate_hz: not a positive number", value=rate_hz, limit="> 0", remedy="for example 100")
    mechanism = mechanism_of(structure, r_max_m)
    interference = Interference(mechanism, tolerance)
    check = check_motion(interference)
    steps = step_tolerance(interference)
    if steps.seating_fold <= 0.0:
        raise MotionError(
            "step tolerance: panels touch as soon as cells fall out of step, at every fold",
            value=f"{float(steps.spread.max()):.3g} of the motion at most",
            limit="at least 0.02 somewhere",
            remedy="choose another slit or thinner walls",
        )
    time, fold, fold_rate = time_path(mechanism.four_bars, velocity, acceleration, rate_hz)
    transmission = mechanism.four_bars.transmission(fold)
    return Plan(
        design_sha256=design_sha256,
        design_name=design_name,
        cell_ids=layout.cell_ids,
        rate_hz=rate_hz,
        time_s=time,
        fold=fold,
        crease_angles_rad=mechanism.four_bars.angles(fold),
        crease_rates_rad_s=transmission * fold_rate[:, None, None],
        transmission=transmission,
        step_tolerance=steps,
        latch_points=layout.latch_points,
        check=check,
    )
