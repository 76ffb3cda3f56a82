"""What a plan file holds, key by key; `load_plan` refuses whatever does not fit, `ori-deploy schema` prints it.

That tables are of one length and the fold rises is `load_plan`'s business; keys that are not known are let pass.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ori_deploy.files.design_schema import Count, Name, Number, Pair, Size, Written
from ori_deploy.motion.plan import StageName

Share = Annotated[float, Field(strict=True, ge=0.0, le=1.0)]
PerCrease = tuple[Number, Number, Number, Number]
"""In the order of `creases`."""
Table = list[list[PerCrease]]
"""One row per time, in it one entry per cell."""


class Stages(Written):
    """Which stages each way has, in order."""

    deploy: list[StageName]
    stow: list[StageName]


class StepToleranceEntry(Written):
    """How far cells may be out of step: `spread` behind the leading cell's fold `lead`."""

    lead: Annotated[list[Share], Field(min_length=1)]
    spread: Annotated[list[Share], Field(min_length=1)]
    smallest: Share
    seating_fold: Share
    seating_depth_m: Size


class CheckEntry(Written):
    """What the interference check found."""

    n_poses: Count
    deepest_penetration_m: Size
    allowed_penetration_m: Size
    smallest_clearance_m: Number | None
    clearance_fold_range: Pair
    clearance_panels: tuple[Name, Name] | None
    clearance_fold: Share


class SpanStageEntry(Written):
    """How a span in segments unfolds, by hand."""

    segments: Annotated[int, Field(strict=True, ge=2)]
    hinge_ids: Annotated[list[Name], Field(min_length=1)]
    duration_s: Size
    free_orders: list[Name]
    deepest_penetration_m: Size
    allowed_penetration_m: Size
    stowed_box_m: tuple[Size, Size, Size]
    time_s: Annotated[list[Number], Field(min_length=2)]
    angles_rad: Annotated[list[list[Number]], Field(min_length=2)]


class PlanFile(Written):
    """A checked motion from stowed (fold 0) to deployed (fold 1). Seconds, radians, metres."""

    schema_: Annotated[Literal["ori-deploy/plan/1"], Field(alias="schema")]
    design_name: Annotated[str, Field(strict=True)]
    design_sha256: Annotated[str, Field(strict=True)]
    cell_ids: Annotated[list[Name], Field(min_length=1)]
    creases: tuple[Literal["open_c"], Literal["open_d"], Literal["close_a"], Literal["close_b"]]
    stages: Stages
    rate_hz: Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=False)]
    duration_s: Size
    latch_points: Annotated[list[Name], Field(min_length=1)]
    step_tolerance: StepToleranceEntry
    check: CheckEntry
    span: SpanStageEntry | None = None
    time_s: Annotated[list[Number], Field(min_length=2)]
    fold: Annotated[list[Share], Field(min_length=2)]
    crease_angles_rad: Table
    crease_rates_rad_s: Table
    transmission: Table
