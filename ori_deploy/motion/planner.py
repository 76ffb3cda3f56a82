"""From a structure and crease limits to a checked plan."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice, product

import numpy as np

from ori_deploy.design import Structure
from ori_deploy.errors import LayoutError, MotionError
from ori_deploy.layout import make_layout
from ori_deploy.motion.interference import Interference
from ori_deploy.motion.plan import MotionCheck, Plan
from ori_deploy.motion.poses import Mechanism
from ori_deploy.motion.step_tolerance import step_tolerance
from ori_deploy.motion.timing import check_limits, time_path
from ori_deploy.profiles.profile import Reals
from ori_deploy.tolerance import TOLERANCE, Tolerance

_CLEARANCE_RANGE = (0.05, 0.95)
_CLEARANCE_POSES = 181


def checked_folds(mechanism: Mechanism, tolerance: Tolerance = TOLERANCE) -> Reals:
    """Folds in step, 0 to 1, close enough that no panel moves more than `motion_step` between two of them."""
    coarse = np.linspace(0.0, 1.0, 201)
    poses = mechanism.poses(coarse)
    reach = np.abs(mechanism.structure.embedding.z).max() + mechanism.structure.profile.size
    step = np.abs(np.diff(poses.shift, axis=1)) + np.abs(np.diff(poses.turn, axis=1)) * reach
    longest = step.max(axis=0) / (tolerance.motion_step * mechanism.structure.profile.size)
    pieces = [
        np.linspace(a, b, int(np.ceil(n)) if n > 1.0 else 1, endpoint=False)
        for a, b, n in zip(coarse, coarse[1:], longest, strict=False)
    ]
    return np.append(np.concatenate(pieces), 1.0)


def free_slits(interference: Interference, limit: int = 64) -> list[tuple[tuple[str, str], ...]]:
    """Choices of slits with which the same cells deploy in step without touching, at most `limit` tried.

    Returns
    -------
    For each: (inner vertex, opening vertex) ids, one pair per inner vertex.
    """
    structure = interference.mechanism.structure
    layout = structure.layout
    ids = [v.id for v in layout.vertices]
    cells = [tuple(ids[v] for v in cell) for cell in layout.cells]
    choices = [
        sorted({int(cell[k]) for cell in layout.cells if inner in cell for k in (1, 3)}) for inner, _ in layout.slits
    ]
    found = []
    for chosen in islice(product(*choices), limit):
        slits = tuple((ids[inner], ids[opening]) for (inner, _), opening in zip(layout.slits, chosen, strict=True))
        try:
            other = make_layout(layout.vertices, cells, slits)  # type: ignore[arg-type]
        except LayoutError:
            continue  # these slits leave a cell loose
        embedding = replace(structure.embedding, layout=other)
        mechanism = Mechanism(replace(structure, embedding=embedding))
        if not other.overfull_vertices:
            check = Interference(mechanism, interference.tolerance)
            if check.first_collision(checked_folds(mechanism, interference.tolerance)) is None:
                found.append(slits)
    return found


def _remedy(interference: Interference) -> str:
    free = free_slits(interference)
    if not free:
        return "thinner walls, or move the vertices of these cells: no other choice of slits is free either"
    written = [str([list(pair) for pair in slits]).replace("'", '"') for slits in free[:3]]
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
        size_m = interference.mechanism.structure.profile.size
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
    structure: Structure,
    velocity: Reals,
    acceleration: Reals,
    rate_hz: float,
    *,
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
    mechanism = Mechanism(structure)
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
