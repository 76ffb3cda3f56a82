"""Whether a plan, a rig and a bus belong together, and the plan can be carried out at all."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import ActuatorBus
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.errors import MotionError, RigError
from ori_deploy.motion.plan import CREASES, Plan

FloatArray = NDArray[np.float64]

REST_RATE_RAD_S = 1e-3
"""Shaft speed up to which the end of a plan counts as at rest."""

RATE_SLACK = 0.01
"""Part of a crease's largest rate by which its claimed rates may differ from the table's differences."""

LIMIT_SLACK = 1e-3
"""Part by which a plan may exceed a limit: roundings of its file, nothing more."""


def check_fit(plan: Plan, rig: ResolvedRig, bus: ActuatorBus) -> None:
    """Check everything that can be known before anything is connected.

    Raises
    ------
    RigError
        Cells, hinges, latches or latch points are not each other's, or a shaft cannot reach all of the
        motion.
    MotionError
        The plan holds a value that is not finite, does not start and end at rest, or turns a driven crease
        back somewhere, so that its angle would not tell where the cell is, or is faster than the rig allows.
    """
    _check_names(plan, rig, bus)
    crease = rig.driven(plan.crease_angles_rad)
    rate = rig.shaft_per_crease * rig.driven(plan.crease_rates_rad_s)
    _check_finite(plan, crease, rate)
    _check_monotone(plan, rig, crease)
    _check_rest(plan, rig, rate)
    rig.check_range(plan.crease_angles_rad)
    _check_limits(plan, rig)
    _check_rates(plan)


def _check_names(plan: Plan, rig: ResolvedRig, bus: ActuatorBus) -> None:
    for what, found, wanted in (
        ("the rig's cells", rig.cell_ids, plan.cell_ids),
        ("the bus's hinges", bus.hinge_ids, rig.hinge_ids),
        ("the bus's latches", bus.latch_ids, rig.latch_ids),
    ):
        if found != wanted:
            raise RigError(
                f"{what} are not those wanted",
                value=", ".join(found),
                limit=", ".join(wanted),
                remedy="resolve the rig for this plan, and build the bus from the resolved rig",
                source=rig.source,
            )
    if not math.isclose(plan.rate_hz, rig.rate_hz):
        raise RigError(
            "plan and rig have different rates",
            value=f"rate_hz = {rig.rate_hz:g} in the rig",
            limit=f"{plan.rate_hz:g}, as the plan was made",
            remedy="plan again with this rig",
            source=rig.source,
        )
    if not plan.latch_points:
        raise MotionError(
            f"plan {plan.design_name} has no latch point: nothing locks the deployed state", remedy="plan again"
        )
    secured = {latch.secures for latch in rig.latches}
    for point in plan.latch_points:
        if point not in secured:
            raise RigError(
                f"latch point {point} has no latch in the resolved rig",
                remedy="resolve the rig for this plan",
                source=rig.source,
            )


def _check_finite(plan: Plan, crease: FloatArray, rate: FloatArray) -> None:
    for name, array in (("time_s", plan.time_s), ("fold", plan.fold), ("angles", crease), ("rates", rate)):
        if not np.isfinite(array).all():
            raise MotionError(
                f"plan {plan.design_name}: {name} is not finite", limit="finite numbers", remedy="plan again"
            )
    for name, array in (("time_s", plan.time_s), ("fold", plan.fold)):
        if len(array) < 2 or (np.diff(array) <= 0.0).any():
            raise MotionError(
                f"plan {plan.design_name}: {name} does not increase", limit="strictly", remedy="plan again"
            )


def _check_monotone(plan: Plan, rig: ResolvedRig, crease: FloatArray) -> None:
    steps = np.diff(crease, axis=0)
    turning = ~((steps > 0.0).all(axis=0) | (steps < 0.0).all(axis=0))
    for i in np.flatnonzero(turning):
        forward = np.sign(crease[-1, i] - crease[0, i])
        row = int(np.argmax(steps[:, i] * forward <= 0.0))
        raise MotionError(
            f"driven crease {rig.hinges[i].crease} of cell {plan.cell_ids[i]} turns back along the plan",
            value=f"{crease[row, i]:.6g} then {crease[row + 1, i]:.6g} rad at fold {plan.fold[row]:.4g}",
            limit="strictly rising or falling, or its angle does not tell where the cell is",
            remedy="drive another crease of this cell",
            source=rig.source,
        )


def _check_rest(plan: Plan, rig: ResolvedRig, rate: FloatArray) -> None:
    for end, row in (("start", rate[0]), ("end", rate[-1])):
        i = int(np.argmax(np.abs(row)))
        if abs(row[i]) > REST_RATE_RAD_S:
            raise MotionError(
                f"plan {plan.design_name} is not at rest at its {end}",
                value=f"{row[i]:.4g} rad/s at the shaft of {rig.hinge_ids[i]}",
                limit=f"{REST_RATE_RAD_S} rad/s",
                remedy="plan again with zero rates at both ends",
            )


def _check_limits(plan: Plan, rig: ResolvedRig) -> None:
    """The table's own differences, not the rates it claims, against this rig's limits."""
    step = np.diff(plan.time_s)[:, None, None]
    velocity = np.diff(plan.crease_angles_rad, axis=0) / step
    acceleration = np.diff(velocity, axis=0) / (0.5 * (step[1:] + step[:-1]))
    top_velocity, top_acceleration = rig.crease_limits()
    for what, unit, table, limit in (
        ("velocity", "rad/s", velocity, top_velocity),
        ("acceleration", "rad/s2", acceleration, top_acceleration),
    ):
        if not len(table):
            continue
        worst = np.abs(table).max(axis=0) / limit
        cell, crease = np.unravel_index(int(np.argmax(worst)), worst.shape)
        if worst[cell, crease] > 1.0 + LIMIT_SLACK:
            raise MotionError(
                f"plan {plan.design_name}: {what} of crease {CREASES[crease]} of cell {plan.cell_ids[cell]} "
                "is beyond what this rig allows",
                value=f"{float(np.abs(table[:, cell, crease]).max()):.4g} {unit}",
                limit=f"{float(limit[cell, crease]):.4g} {unit}",
                remedy="plan again with this rig",
                source=rig.source,
            )


def _check_rates(plan: Plan) -> None:
    """The rates a table claims against its own differences: the path is interpolated with both."""
    step = np.diff(plan.time_s)[:, None, None]
    slope = np.diff(plan.crease_angles_rad, axis=0) / step
    jerk = np.abs(np.diff(slope, axis=0)).max(axis=0) if len(slope) > 1 else np.zeros(slope.shape[1:])
    allowed = jerk + RATE_SLACK * np.abs(slope).max(axis=0) + REST_RATE_RAD_S
    rates = plan.crease_rates_rad_s
    off = np.maximum(np.abs(rates[:-1] - slope), np.abs(rates[1:] - slope))
    if (off <= allowed).all():
        return
    row, cell, crease = np.argwhere(~(off <= allowed))[0]
    raise MotionError(
        f"plan {plan.design_name}: the rate of crease {CREASES[crease]} of cell {plan.cell_ids[cell]} "
        "is not that of its angle",
        value=f"{off[row, cell, crease]:.4g} rad/s apart at fold {plan.fold[row]:.4g}",
        limit=f"{allowed[cell, crease]:.4g} rad/s",
        remedy="plan again",
    )
