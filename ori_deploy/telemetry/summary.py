"""What a flight log amounts to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ori_deploy.deploy.result import Fault, MotionResult
from ori_deploy.deploy.states import Transition
from ori_deploy.telemetry.messages import FloatArray
from ori_deploy.telemetry.read import Run


@dataclass(frozen=True)
class TrackingWorst:
    """The worst moment of one hinge, at its driven crease; NaN where its error was never known."""

    hinge_id: str
    cell_id: str
    error_rad: float
    time_s: float


@dataclass(frozen=True)
class Summary:
    """Figures of a run. Times are seconds since its first cycle.

    Attributes
    ----------
    duration_s, cycles, overruns, lost_replies
        Of the whole log.
    worst_lateness_s
        Latest begin of a cycle after its deadline; NaN when never told.
    tracking
        Worst tracking error of every hinge, in the order of the cells.
    largest_spread
        Largest difference of measured fold between any two cells.
    latch_confirmed_s
        When each latch was first confirmed after it was engaged; latches that never were are missing.
    hottest_c, lowest_v
        Extremes over all hinges; NaN when never read.
    transitions
        With times as in the log.
    faults, results
        In order.
    complete
        False for a log that was cut off or is damaged.
    """

    duration_s: float
    cycles: int
    overruns: int
    lost_replies: int
    worst_lateness_s: float
    tracking: tuple[TrackingWorst, ...]
    largest_spread: float
    latch_confirmed_s: dict[str, float]
    hottest_c: float
    lowest_v: float
    transitions: tuple[Transition, ...]
    faults: tuple[Fault, ...]
    results: tuple[MotionResult, ...]
    complete: bool

    @property
    def worst_tracking(self) -> TrackingWorst | None:
        """The hinge with the largest error; None where none is known: that is no error of 0."""
        known = [worst for worst in self.tracking if np.isfinite(worst.error_rad)]
        return max(known, key=lambda worst: worst.error_rad, default=None)


def summarise(run: Run) -> Summary:
    """Work out the figures of a run."""
    start = float(run.time_s[0])
    spread = run.fold.max(axis=1) - run.fold.min(axis=1)  # NaN where a cell was silent
    confirmed: dict[str, float] = {}
    for reading in run.latches:
        if reading.engaged and reading.confirmed:
            confirmed.setdefault(reading.id, reading.time_s - start)
    return Summary(
        duration_s=float(run.time_s[-1]) - start,
        cycles=len(run.time_s),
        overruns=int(run.overruns[-1]),
        lost_replies=int(run.lost_replies[-1]),
        worst_lateness_s=_extreme(run.lateness_s, 1.0),
        tracking=_tracking(run, start),
        largest_spread=_extreme(spread, 1.0),
        latch_confirmed_s=confirmed,
        hottest_c=_extreme(run.temperature_c, 1.0),
        lowest_v=-_extreme(run.voltage_v, -1.0),
        transitions=run.transitions,
        faults=run.faults,
        results=run.results,
        complete=run.complete,
    )


def _tracking(run: Run, start_s: float) -> tuple[TrackingWorst, ...]:
    error = np.abs(run.tracking_error_rad)
    rows = np.where(np.isfinite(error), error, -1.0).argmax(axis=0)
    worst, time_s = error[rows, np.arange(error.shape[1])], run.time_s[rows] - start_s
    unknown = ~np.isfinite(worst)
    worst[unknown] = time_s[unknown] = np.nan
    return tuple(
        TrackingWorst(hinge, cell, error_rad, at_s)
        for hinge, cell, error_rad, at_s in zip(
            run.info["hinge_ids"], run.info["cell_ids"], worst.tolist(), time_s.tolist(), strict=True
        )
    )


def _extreme(values: FloatArray, sign: float) -> float:
    """Largest of `sign * values`; NaN when there is none."""
    known = sign * values[np.isfinite(values)]
    return float(known.max()) if known.size else float("nan")
