"""The motion plan: what motion hands to the controller, and nothing else does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ori_deploy.motion.step_tolerance import StepTolerance

CREASES: tuple[str, str, str, str] = ("open_c", "open_d", "close_a", "close_b")
"""Order of the four creases of a cell on every array axis of length 4."""

StageName = Literal[
    "unlock", "span_unfold", "open", "latch", "unlatch", "close", "span_fold", "lock", "free", "recover"
]

DEPLOY_STAGES: tuple[StageName, ...] = ("unlock", "open", "latch")
STOW_STAGES: tuple[StageName, ...] = ("unlatch", "close", "lock")
"""What the controller carries out. A span in segments is folded by hand, see `Plan.deploy_stages`."""


@dataclass(frozen=True)
class MotionCheck:
    """What the interference check of a planned motion found.

    Attributes
    ----------
    n_poses
        Poses that were looked at, refinement included.
    deepest_penetration_m
        A depth that no two panels exceed, within a factor of 2; at most `allowed_penetration_m`.
    allowed_penetration_m
        The tolerance it was judged by.
    smallest_clearance_m
        Smallest distance between two panels that do not share a crease, `fold` between
        `clearance_fold_range`: at the two ends panels touch by design.
    clearance_fold_range
        Fold interval over which the clearance was taken.
    clearance_panels, clearance_fold
        The pair of panels and the fold at which the smallest clearance occurs. Without such a pair they are empty,
        and the clearance is infinite.
    """

    n_poses: int
    deepest_penetration_m: float
    allowed_penetration_m: float
    smallest_clearance_m: float
    clearance_fold_range: tuple[float, float]
    clearance_panels: tuple[str, str]
    clearance_fold: float

    @property
    def has_clearance(self) -> bool:
        """Whether there are panels that could meet: all of one cell may share creases, or have no thickness."""
        return self.clearance_panels[0] != ""


@dataclass(frozen=True)
class SpanStage:
    """The checked unfolding of a span in segments, from folded zig-zag to straight; stowing runs it backwards.

    Only the flat stack folds so: this comes before the cells open, and after they have closed.

    Attributes
    ----------
    segments
        How many; two or more.
    hinge_ids
        (segments - 1) names of the piano hinges, along the span.
    time_s
        (n,) times from 0, spaced at the plan's rate.
    angles_rad
        (n, segments - 1) hinge angles, from pi (folded) to 0, all in step.
    free_orders
        Orders in which the hinges can be folded, checked in space: "in_step", one by one "from_first" or
        "from_last".
    deepest_penetration_m, allowed_penetration_m
        A depth that no two segments exceed in step, within a factor of 2, and what is allowed.
    stowed_box_m
        Sides of the box round the stowed structure: across (longer, shorter), along the span.
    """

    segments: int
    hinge_ids: tuple[str, ...]
    time_s: NDArray[np.float64]
    angles_rad: NDArray[np.float64]
    free_orders: tuple[str, ...]
    deepest_penetration_m: float
    allowed_penetration_m: float
    stowed_box_m: tuple[float, float, float]

    @property
    def duration_s(self) -> float:
        """Time from folded to straight."""
        return float(self.time_s[-1])


@dataclass(frozen=True)
class Plan:
    """A checked motion from stowed (fold 0) to deployed (fold 1), all cells in step.

    Stowing is the same table backwards: velocity and acceleration limits are symmetric.

    Attributes
    ----------
    design_sha256
        Digest of the design file the plan was made from.
    design_name
        A name for people.
    cell_ids
        Cell ids in the order of the cell axis; length n_cells.
    rate_hz
        Sampling rate of the table and of the control loop.
    time_s
        (n,) times from 0, uniformly spaced at `1/rate_hz` but for the last interval, which may be shorter.
    fold
        (n,) fold variable, strictly increasing from 0 to 1.
    crease_angles_rad, crease_rates_rad_s
        (n, n_cells, 4) inner angle of every crease and its rate, creases in the order of `CREASES`.
    step_tolerance
        How far cells may fall out of step; the controller must stop before it.
    transmission
        (n, n_cells, 4) rate of each crease's angle per unit of fold, radians.
    latch_points
        Ids of what must be secured for the deployed state to be locked: slits as "slit:P-T2", cells
        that touch no inner vertex as "cell:c3".
    check
        Interference figures.
    span
        How the span unfolds, where it is in segments.
    """

    design_sha256: str
    design_name: str
    cell_ids: tuple[str, ...]
    rate_hz: float
    time_s: NDArray[np.float64]
    fold: NDArray[np.float64]
    crease_angles_rad: NDArray[np.float64]
    crease_rates_rad_s: NDArray[np.float64]
    transmission: NDArray[np.float64]
    step_tolerance: StepTolerance
    latch_points: tuple[str, ...]
    check: MotionCheck
    span: SpanStage | None = None

    @property
    def duration_s(self) -> float:
        """Time from fold 0 to fold 1 at full rate."""
        return float(self.time_s[-1])

    @property
    def deploy_stages(self) -> tuple[StageName, ...]:
        """All stages of deploying, those worked by hand included."""
        return DEPLOY_STAGES if self.span is None else ("unlock", "span_unfold", "open", "latch")

    @property
    def stow_stages(self) -> tuple[StageName, ...]:
        """All stages of stowing, those worked by hand included."""
        return STOW_STAGES if self.span is None else ("unlatch", "close", "span_fold", "lock")
