"""What is told of a motion while it runs: where it is on a terminal, a line per change of state elsewhere."""

from __future__ import annotations

import math
from types import TracebackType
from typing import Self

import numpy as np

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.cli.frame import console
from ori_deploy.cli.screen import Screen, screen
from ori_deploy.deploy.result import CycleRecord, MotionResult
from ori_deploy.operate.due import DueGoals

_REFRESH_S = 0.1


class Live:
    """An observer of the controller that tells a screen where it is.

    Parameters
    ----------
    rig
        What is being driven.
    real
        Whether time is real: then drawing is left to another process.
    """

    def __init__(self, rig: ResolvedRig, *, real: bool = False) -> None:
        self._real = real
        self._screen: Screen | None = None
        self._since = 0.0
        self._due = -math.inf
        self._latches = ""
        self._goals = DueGoals(rig, rig.delay_s)

    def __enter__(self) -> Self:
        self._screen = screen(real=self._real)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._screen is not None:
            self._screen.close()

    def begin(self, command: str) -> None:
        """A command was given."""
        if self._screen is not None:
            self._screen.begin(command)
        self._since, self._due = math.nan, -math.inf

    def end(self, result: MotionResult) -> None:
        """A command ended."""
        verdict = f"{result.command}: {result.outcome} in {result.duration_s:.2f} s, state {result.state}"
        verdict = verdict if result.fault is None else f"{verdict}; {result.fault}"
        if self._screen is not None:
            self._screen.end(str(result.state), float(result.duration_s), verdict)

    def line(self, text: str) -> None:
        """Something to keep, whatever moves."""
        if self._screen is not None:
            self._screen.line(text)

    def __call__(self, record: CycleRecord) -> None:
        if self._screen is None:
            return
        self._goals.note(record)
        if math.isnan(self._since):
            self._since = record.time_s
        at = record.time_s - self._since
        if record.latches is not None:
            closed = sum(latch.confirmed is True for latch in record.latches)
            self._latches = f"latches {closed}/{len(record.latches)}"
        if not console.is_terminal:
            for change in record.transitions:
                self._screen.line(f"  {max(at, 0.0):7.2f} s  {change.source} -> {change.target}")
        elif record.time_s >= self._due:
            self._due = record.time_s + _REFRESH_S
            folds = record.folds[np.isfinite(record.folds)]
            opened = float(folds.mean()) if len(folds) else 0.0
            off = math.degrees(self._goals.off_rad)
            self._screen.show(str(record.state), opened, float(at), off, self._latches)
