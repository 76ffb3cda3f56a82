"""What is shown while a motion runs: a bar on a terminal, a line per change of state elsewhere."""

from __future__ import annotations

import math
from types import TracebackType
from typing import Self

import numpy as np
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.cli.frame import console
from ori_deploy.deploy.result import CycleRecord, MotionResult
from ori_deploy.motion import Plan

_REFRESH_S = 0.1


class Live:
    """An observer of the controller that shows where it is.

    Parameters
    ----------
    plan, rig
        What is being carried out.
    """

    def __init__(self, plan: Plan, rig: ResolvedRig) -> None:
        self._plan, self._rig = plan, rig
        self._progress = Progress(
            TextColumn("{task.description:<7}"),
            BarColumn(bar_width=28),
            TextColumn("{task.percentage:>3.0f} % open"),
            TextColumn("{task.fields[state]:<9} t = {task.fields[at]:5.2f} s  off path {task.fields[off]:4.2f} deg"),
            TextColumn("{task.fields[latches]}"),
            console=console,
            auto_refresh=False,
            disable=not console.is_terminal,
        )
        self._task: TaskID | None = None
        self._silent = False
        self._since = 0.0
        self._due = -math.inf
        self._latches = ""

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def begin(self, command: str) -> None:
        """A command was given."""
        self._task = self._progress.add_task(command, total=1.0, state="", at=0.0, off=0.0, latches="")
        self._since, self._due = math.nan, -math.inf

    def end(self, result: MotionResult) -> None:
        """A command ended."""
        if self._task is not None:
            self._progress.update(self._task, state=str(result.state), at=result.duration_s, refresh=True)
        verdict = f"{result.command}: {result.outcome} in {result.duration_s:.2f} s, state {result.state}"
        verdict = verdict if result.fault is None else f"{verdict}; {result.fault}"
        try:
            console.print(verdict, markup=False, soft_wrap=True)
        except OSError:
            self._silent = console.quiet = True

    def __call__(self, record: CycleRecord) -> None:
        if self._silent:
            return
        try:
            self._show(record)
        except OSError:
            # A full disk or a closed pipe behind the output: the motion is what matters, and it has its log.
            self._silent = console.quiet = True

    def _show(self, record: CycleRecord) -> None:
        if math.isnan(self._since):
            self._since = record.time_s
        at = record.time_s - self._since
        if record.latches is not None:
            closed = sum(latch.confirmed is True for latch in record.latches)
            self._latches = f"latches {closed}/{len(record.latches)}"
        if not console.is_terminal:
            for change in record.transitions:
                console.print(f"  {max(at, 0.0):7.2f} s  {change.source} -> {change.target}", markup=False)
            return
        if record.time_s >= self._due and self._task is not None:
            self._due = record.time_s + _REFRESH_S
            folds = record.folds[np.isfinite(record.folds)]
            self._progress.update(
                self._task,
                completed=float(folds.mean()) if len(folds) else 0.0,
                state=str(record.state),
                at=at,
                off=math.degrees(self._off_path(record)),
                latches=self._latches,
                refresh=True,
            )

    def _off_path(self, record: CycleRecord) -> float:
        off = self._rig.to_crease(record.readings.position_rad) - self._rig.to_crease(record.commanded_rad)
        off = np.abs(off[np.isfinite(off)])
        return float(off.max()) if len(off) else 0.0
