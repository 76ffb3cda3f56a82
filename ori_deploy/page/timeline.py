"""A motion over time: of a design without times, of a plan, or as a flight log has it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from ori_deploy.motion import Plan
from ori_deploy.profiles.profile import Reals
from ori_deploy.telemetry.read import Run

PREVIEW_S = 6.0
"""How long a design that has no plan takes to unfold on the page, and its span on top of that."""

_MOST_ROWS = 3000


@dataclass(frozen=True)
class Pose:
    """What is shown: a fold per cell, how far the span is folded (0 straight, 1 stowed), and the stage."""

    fold: Reals
    span_folded: float
    stage: str


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
        (n,) from 0, straight, to 1.
    stage
        (n,) names.
    """

    time_s: Reals
    fold: Reals
    span_folded: Reals
    stage: tuple[str, ...]

    @property
    def duration_s(self) -> float:
        """When it ends."""
        return float(self.time_s[-1])

    @property
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
        span = (1.0 - part) * self.span_folded[k] + part * self.span_folded[after]
        return Pose(np.clip(fold, 0.0, 1.0), float(np.clip(span, 0.0, 1.0)), self.stage[k])


def preview(n_cells: int, segments: int) -> Timeline:
    """From stowed to deployed, gently; for looking at, not for carrying out."""
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 121))
    time = PREVIEW_S * np.linspace(0.0, 1.0, 121)
    fold = np.repeat(ramp[:, None], n_cells, axis=1)
    opening = Timeline(time, fold, np.zeros(121), ("open",) * 121)
    return opening if segments == 1 else _after(time, 1.0 - ramp, opening)


def planned(plan: Plan) -> Timeline:
    """A plan's, its span's unfolding by hand included. Latches take as long as they take and have no time here."""
    n = len(plan.time_s)
    fold = np.repeat(plan.fold[:, None], len(plan.cell_ids), axis=1)
    opening = Timeline(plan.time_s, fold, np.zeros(n), ("open",) * n)
    return opening if plan.span is None else _after(plan.span.time_s, plan.span.angles_rad[:, 0] / np.pi, opening)


def _after(time_s: Reals, span_folded: Reals, opening: Timeline) -> Timeline:
    """The span first, then the cells."""
    n = len(time_s) - 1
    return Timeline(
        np.concatenate([time_s[:-1], time_s[-1] + opening.time_s]),
        np.concatenate([np.zeros((n, opening.fold.shape[1])), opening.fold]),
        np.concatenate([span_folded[:-1], opening.span_folded]),
        ("span_unfold",) * n + opening.stage,
    )


def flown(run: Run, cell_ids: tuple[str, ...]) -> Timeline:
    """What a flight log measured; where a reading is missing, the one before it, and before the first, the first."""
    rows = rows_of(run)
    hinges = run.info["cell_ids"]
    fold = np.full((len(rows), len(cell_ids)), np.nan)
    for i, cell in enumerate(cell_ids):
        own = [k for k, name in enumerate(hinges) if name == cell]
        if own:
            fold[:, i] = _held(run.fold[rows][:, own].mean(axis=1), run.commanded_fold[rows])
        else:
            fold[:, i] = _held(run.commanded_fold[rows], run.commanded_fold[rows])
    time = run.time_s[rows] - run.time_s[rows[0]]
    stage = tuple(run.stage[k] or run.state[k] for k in rows)
    return Timeline(time, np.clip(fold, 0.0, 1.0), np.zeros(len(rows)), stage)


def rows_of(run: Run) -> list[int]:
    """Which cycles of a log are shown: as many as a screen can tell apart, the first and the last among them."""
    n = len(run.time_s)
    return sorted({round(x) for x in np.linspace(0, n - 1, min(n, _MOST_ROWS))})


def _held(values: Reals, instead: Reals) -> Reals:
    """Without gaps: the value before, else the first one there is; `instead` where there is none at all."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return np.nan_to_num(instead, nan=0.0)
    at = np.maximum(np.searchsorted(known, np.arange(len(values)), side="right") - 1, 0)
    return np.asarray(values[known[at]])
