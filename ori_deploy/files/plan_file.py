"""Plan files (JSON, schema ori-deploy/plan/1): a checked motion, ready to be carried out."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from ori_deploy.errors import FileError
from ori_deploy.files.design_schema import first_fault
from ori_deploy.files.plan_schema import PlanFile
from ori_deploy.files.text import read_json, write_atomically
from ori_deploy.motion import CREASES, MotionCheck, Plan, StepTolerance
from ori_deploy.motion.plan import SpanStage

PLAN_SCHEMA = "ori-deploy/plan/1"


def plan_data(plan: Plan) -> dict[str, Any]:
    """Everything a plan file holds, as plain data."""
    steps = plan.step_tolerance
    return {
        "schema": PLAN_SCHEMA,
        "design_name": plan.design_name,
        "design_sha256": plan.design_sha256,
        "cell_ids": list(plan.cell_ids),
        "creases": list(CREASES),
        "stages": {"deploy": list(plan.deploy_stages), "stow": list(plan.stow_stages)},
        "rate_hz": plan.rate_hz,
        "duration_s": plan.duration_s,
        "latch_points": list(plan.latch_points),
        "step_tolerance": {
            "lead": steps.lead.tolist(),
            "spread": steps.spread.tolist(),
            "smallest": steps.smallest,
            "seating_fold": steps.seating_fold,
            "seating_depth_m": steps.seating_depth_m,
        },
        "check": _check_data(plan.check),
        **({} if plan.span is None else {"span": _span_data(plan.span)}),
        "time_s": plan.time_s.tolist(),
        "fold": plan.fold.tolist(),
        "crease_angles_rad": plan.crease_angles_rad.tolist(),
        "crease_rates_rad_s": plan.crease_rates_rad_s.tolist(),
        "transmission": plan.transmission.tolist(),
    }


def _span_data(span: SpanStage) -> dict[str, Any]:
    return {
        "segments": span.segments,
        "hinge_ids": list(span.hinge_ids),
        "duration_s": span.duration_s,
        "free_orders": list(span.free_orders),
        "deepest_penetration_m": span.deepest_penetration_m,
        "allowed_penetration_m": span.allowed_penetration_m,
        "stowed_box_m": list(span.stowed_box_m),
        "time_s": span.time_s.tolist(),
        "angles_rad": span.angles_rad.tolist(),
    }


def _check_data(check: MotionCheck) -> dict[str, Any]:
    """As JSON has it, which knows no infinity: where no two panels could ever meet there is no clearance."""
    if check.has_clearance:
        return asdict(check)
    return {**asdict(check), "smallest_clearance_m": None, "clearance_panels": None}


def save_plan(plan: Plan, path: Path) -> None:
    """Write a plan file, whole or not at all."""
    write_atomically(path, json.dumps(plan_data(plan), allow_nan=False) + "\n")


def load_plan(path: Path) -> Plan:
    """Read a plan file.

    Raises
    ------
    FileError
        Unreadable, entries missing, tables of the wrong shape, numbers that are not finite, or a fold
        that does not run from 0 to 1.
    """
    data = read_json(path, PLAN_SCHEMA)
    try:
        PlanFile.model_validate(data)
        plan = _plan(data)
    except ValidationError as wrong:
        raise FileError(
            f"{path}: not a whole plan",
            value=first_fault(wrong.errors()),
            remedy="make it again with ori-deploy plan",
        ) from wrong
    except (KeyError, TypeError, ValueError, OverflowError) as wrong:
        raise FileError(
            f"{path}: not a whole plan",
            value=f"{type(wrong).__name__}: {wrong}",
            remedy="make it again with ori-deploy plan",
        ) from wrong
    n, cells = len(plan.time_s), len(plan.cell_ids)
    for name, table in (
        ("crease_angles_rad", plan.crease_angles_rad),
        ("crease_rates_rad_s", plan.crease_rates_rad_s),
        ("transmission", plan.transmission),
    ):
        if table.shape != (n, cells, 4) or not np.isfinite(table).all():
            raise FileError(
                f"{path}: {name} is damaged",
                value=f"shape {table.shape}",
                limit=f"finite, {(n, cells, 4)}",
                remedy="make the plan again",
            )
    steps = plan.step_tolerance
    if not (
        len(steps.lead) == len(steps.spread) > 0
        and steps.lead[-1] == 1.0
        and (np.diff(steps.lead) > 0.0).all()
        and ((steps.spread >= 0.0) & (steps.spread <= 1.0)).all()
        and 0.0 <= steps.seating_fold <= 1.0
        and steps.seating_depth_m >= 0.0
    ):
        raise FileError(
            f"{path}: step_tolerance is damaged", limit="as ori-deploy plan writes it", remedy="make the plan again"
        )
    if not (plan.latch_points and all(isinstance(name, str) for name in (*plan.latch_points, *plan.cell_ids))):
        raise FileError(
            f"{path}: latch_points or cell_ids are damaged", limit="lists of names", remedy="make the plan again"
        )
    rising = n > 1 and plan.fold.shape == (n,) and plan.fold[0] == 0.0 and plan.fold[-1] == 1.0
    if not (rising and (np.diff(plan.fold) >= 0.0).all() and (np.diff(plan.time_s) > 0.0).all()):
        raise FileError(f"{path}: fold does not run from 0 to 1 over increasing times", remedy="make the plan again")
    _check_span(path, plan.span)
    if data.get("stages") != {"deploy": list(plan.deploy_stages), "stow": list(plan.stow_stages)}:
        raise FileError(
            f"{path}: stages",
            value=data.get("stages"),
            limit="those of a plan with a span entry, or of one without",
            remedy="make the plan again",
        )
    return plan


def _check_span(path: Path, span: SpanStage | None) -> None:
    """Refuse a span stage that is damaged: a plan that lost one would open cells of a folded span."""
    if span is None:
        return
    angles, n = span.angles_rad, span.time_s.size
    whole = (
        span.segments >= 2
        and n > 1
        and span.time_s.shape == (n,)
        and angles.shape == (n, span.segments - 1)
        and len(span.hinge_ids) == span.segments - 1
        and np.isfinite(span.time_s).all()
        and np.isfinite(angles).all()
        and (np.diff(span.time_s) > 0.0).all()
        and (np.diff(angles, axis=0) <= 0.0).all()
        and (angles[0] == np.pi).all()
        and (angles[-1] == 0.0).all()
    )
    if not whole:
        raise FileError(
            f"{path}: span is damaged", limit="hinge angles from pi to 0 over time", remedy="make the plan again"
        )


def _span(data: dict[str, Any] | None) -> SpanStage | None:
    if data is None:
        return None
    longer, shorter, along = (float(side) for side in data["stowed_box_m"])
    return SpanStage(
        segments=int(data["segments"]),
        hinge_ids=tuple(str(name) for name in data["hinge_ids"]),
        time_s=np.array(data["time_s"], dtype=float),
        angles_rad=np.array(data["angles_rad"], dtype=float),
        free_orders=tuple(str(order) for order in data["free_orders"]),
        deepest_penetration_m=float(data["deepest_penetration_m"]),
        allowed_penetration_m=float(data["allowed_penetration_m"]),
        stowed_box_m=(longer, shorter, along),
    )


def _plan(data: dict[str, Any]) -> Plan:
    steps, check = data["step_tolerance"], dict(data["check"])
    if check["clearance_panels"] is None:
        check |= {"smallest_clearance_m": float("inf"), "clearance_panels": ("", "")}
    for key in ("clearance_fold_range", "clearance_panels"):
        check[key] = tuple(check[key])
    return Plan(
        design_sha256=str(data["design_sha256"]),
        design_name=str(data["design_name"]),
        cell_ids=tuple(list(data["cell_ids"]) if isinstance(data["cell_ids"], list) else ()),
        rate_hz=float(data["rate_hz"]),
        time_s=np.array(data["time_s"], dtype=float),
        fold=np.array(data["fold"], dtype=float),
        crease_angles_rad=np.array(data["crease_angles_rad"], dtype=float),
        crease_rates_rad_s=np.array(data["crease_rates_rad_s"], dtype=float),
        transmission=np.array(data["transmission"], dtype=float),
        step_tolerance=StepTolerance(
            np.array(steps["lead"], dtype=float),
            np.array(steps["spread"], dtype=float),
            float(steps["seating_fold"]),
            float(steps["seating_depth_m"]),
        ),
        latch_points=tuple(data["latch_points"]),
        check=MotionCheck(**check),
        span=_span(data.get("span")),
    )
