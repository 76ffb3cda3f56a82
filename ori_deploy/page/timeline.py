"""A motion over time: of a design without times, of a plan, or as a flight log has it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby

import numpy as np

from ori_deploy.motion import Plan
from ori_deploy.page.latches import Latches, seen_in
from ori_deploy.page.thinning import Flags
from ori_deploy.profiles.profile import Reals
from ori_deploy.telemetry.read import Run

PREVIEW_S = 6.0
"""How long a design that has no plan takes to unfold on the page, and its span on top of that."""


@dataclass(frozen=True)
class Pose:
    """What is shown.

    Attributes
    ----------
    fold
        (n_cells,).
    span_folded
        0 straight, 1 stowed; None where nobody measured it.
    stage
        Its name.
    latches
        "open" or "closed" by latch point, where that is known.
    """

    fold: Reals
    span_folded: float | None
    stage: str
    latches: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Stage:
    """A stage from one time to another, seconds."""

    name: str
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Timeline:
    """Poses over time.

    Attributes
    ----------
    time_s
        (n,) increasing, from 0.
    fold
        (n, n_cells) fold of every cell.
    span_folded
        (n,) from 0, straight, to 1; None where nobody measured it.
    stage
        (n,) names.
    busy
        (n,) whether something is being carried out.
    latches
        What their sensors said; None where there are no sensors.
    """

    time_s: Reals
    fold: Reals
    span_folded: Reals | None
    stage: tuple[str, ...]
    busy: Flags
    latches: Latches | None = None

    @property
    def duration_s(self) -> float:
        """When it ends."""
        return float(self.time_s[-1])

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """In order; each ends where the next begins."""
        made, k = [], 0
        for name, rows in groupby(self.stage):
            n = len(list(rows))
            made.append(Stage(name, float(self.time_s[k]), float(self.time_s[min(k + n, len(self.time_s) - 1)])))
            k += n
        return tuple(made)

    def at(self, time_s: float) -> Pose:
        """The pose at a time, between its rows along straight lines; at the ends outside them."""
        t = float(np.clip(time_s, 0.0, self.duration_s))
        k = int(np.clip(np.searchsorted(self.time_s, t, side="right") - 1, 0, len(self.time_s) - 1))
        after = min(k + 1, len(self.time_s) - 1)
        gap = float(self.time_s[after] - self.time_s[k])
        part = (t - float(self.time_s[k])) / gap if gap > 0.0 else 0.0
        fold = (1.0 - part) * self.fold[k] + part * self.fold[after]
        span = None
        if self.span_folded is not None:
            span = float(np.clip((1.0 - part) * self.span_folded[k] + part * self.span_folded[after], 0.0, 1.0))
        latches = {} if self.latches is None else self.latches.at(t)
        return Pose(np.clip(fold, 0.0, 1.0), span, self.stage[k], latches)

    def when(self, fold: Reals, span_folded: float) -> float | None:
        """The first time of a pose in step, on the way there; None where there is no such."""
        if self.span_folded is None or np.ptp(fold) > 0.0:
            return None
        # The span unfolds to 0, and then the cells open to 1: together they only grow.
        along = self.fold[:, 0] - self.span_folded
        if (np.diff(along) < 0.0).any() or not along[0] <= float(fold[0]) - span_folded <= along[-1]:
            return None
        return float(np.interp(float(fold[0]) - span_folded, along, self.time_s))


def preview(n_cells: int, segments: int) -> Timeline:
    """From stowed to deployed, gently; for looking at, not for carrying out."""
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 121))
    time = PREVIEW_S * np.linspace(0.0, 1.0, 121)
    fold = np.repeat(ramp[:, None], n_cells, axis=1)
    opening = Timeline(time, fold, np.zeros(121), ("open",) * 121, np.ones(121, dtype=bool))
    return opening if segments == 1 else _after(time, 1.0 - ramp, opening)


def planned(plan: Plan) -> Timeline:
    """A plan's, its span's unfolding by hand included. Latches take as long as they take and have no time here."""
    n = len(plan.time_s)
    fold = np.repeat(plan.fold[:, None], len(plan.cell_ids), axis=1)
    opening = Timeline(plan.time_s, fold, np.zeros(n), ("open",) * n, np.ones(n, dtype=bool))
    return opening if plan.span is None else _after(plan.span.time_s, plan.span.angles_rad[:, 0] / np.pi, opening)


def _after(time_s: Reals, span_folded: Reals, opening: Timeline) -> Timeline:
    """The span first, then the cells."""
    n = len(time_s) - 1
    return Timeline(
        np.concatenate([time_s[:-1], time_s[-1] + opening.time_s]),
        np.concatenate([np.zeros((n, opening.fold.shape[1])), opening.fold]),
        np.concatenate([span_folded[:-1], np.zeros(len(opening.time_s))]),
        ("span_unfold",) * n + opening.stage,
        np.ones(n + len(opening.time_s), dtype=bool),
    )


def flown(run: Run, cell_ids: tuple[str, ...]) -> Timeline:
    """What a flight log measured, every cycle of it.

    Where a reading is missing, the one before it; before the first, the first. Nothing measures the span.
    """
    hinges = run.info["cell_ids"]
    fold = np.full((len(run.time_s), len(cell_ids)), np.nan)
    for i, cell in enumerate(cell_ids):
        own = [k for k, name in enumerate(hinges) if name == cell]
        measured = run.fold[:, own].mean(axis=1) if own else run.commanded_fold
        fold[:, i] = _held(measured, run.commanded_fold)
    stage = tuple(a or b for a, b in zip(run.stage, run.state, strict=True))
    return Timeline(
        run.time_s - run.time_s[0], np.clip(fold, 0.0, 1.0), None, stage, busy_in(run), seen_in(run, run.time_s[0])
    )


def busy_in(run: Run) -> Flags:
    """(n,) whether something was being carried out in a cycle."""
    return np.array([bool(stage) for stage in run.stage])


def _held(values: Reals, instead: Reals) -> Reals:
    """Without gaps: the value before, else the first one there is; `instead` where there is none at all."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return np.nan_to_num(instead, nan=0.0)
    at = np.maximum(np.searchsorted(known, np.arange(len(values)), side="right") - 1, 0)
    return np.asarray(values[known[at]])
