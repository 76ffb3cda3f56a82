"""What the bar says of a controller: what is measured, what is only commanded, and what nobody may overlook."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ori_deploy.deploy.states import State
from ori_deploy.deploy.step_room import USABLE
from ori_deploy.motion import Plan
from ori_deploy.operate.messages import Answer, Status
from ori_deploy.page.judging import Verdict
from ori_deploy.page.latches import told as told_of_point
from ori_deploy.page.line import LineLost
from ori_deploy.page.panel import TOUCH_M
from ori_deploy.profiles.profile import Reals

WAITING = "waiting for the controller"
SILENT = "the controller does not answer: it may be moving"
ENDED = "the controller has ended"

_GOES_ON = "it may be moving. Stop it with Ctrl-C in its own terminal."

_MM = 1e3
_MISSES = 3
"""Askings in a row without a reading of a cell that was read before: a reply may be lost now and then."""
_GROWN_S = 10.0
"""For so long it is told that replies were lost or cycles late."""


@dataclass(frozen=True)
class Seen:
    """What is known of the structure.

    Attributes
    ----------
    fold
        (n_cells,) as measured last; as commanded where an older controller tells nothing else.
    measured
        Whether that is so of all cells, and now.
    missing
        Cells without a reading for a while, or that were not read since the link came up.
    growing
        What has gone wrong on the way lately, in words.
    """

    fold: Reals
    measured: bool
    missing: tuple[str, ...] = ()
    growing: tuple[str, ...] = ()


class Watch:
    """Remembers what one status alone does not tell.

    Parameters
    ----------
    cell_ids
        Of the plan.
    """

    def __init__(self, cell_ids: tuple[str, ...]) -> None:
        self._cell_ids = cell_ids
        self._fold: Reals = np.zeros(len(cell_ids))
        self._read = np.zeros(len(cell_ids), dtype=bool)  # since the link came up
        self._misses = np.zeros(len(cell_ids), dtype=int)
        self._counts: dict[str, int] = {}
        self._grew_s: dict[str, float] = {}

    def note(self, status: Status) -> Seen:
        """What is known with this status."""
        self._fold = folds_of(status, self._fold)
        told = status.state is not State.DISCONNECTED and len(status.folds) == len(self._cell_ids)
        if not told:
            self.forget()
            return Seen(self._fold, measured=False, growing=self._growing(status))
        there = ~np.isnan(readings(status, len(self._cell_ids)))
        self._read |= there
        self._misses = np.where(there, 0, self._misses + 1)
        lacking = ~self._read | (self._misses >= _MISSES)
        missing = tuple(cell for cell, lacks in zip(self._cell_ids, lacking, strict=True) if lacks)
        return Seen(self._fold, not missing, missing, self._growing(status))

    def forget(self) -> None:
        """Nothing that was read before counts any more: the link or the controller was lost."""
        self._read[:] = False
        self._misses[:] = 0

    def _growing(self, status: Status) -> tuple[str, ...]:
        counts = {"replies lost": status.lost_replies, "cycles late": status.overruns}
        for what, count in counts.items():
            if count > self._counts.setdefault(what, count):
                self._grew_s[what] = status.uptime_s
        self._counts = counts
        recent = (what for what, at in self._grew_s.items() if status.uptime_s - at <= _GROWN_S)
        return tuple(f"{counts[what]} {what}" for what in recent)


def readings(status: Status, n_cells: int) -> Reals:
    """(n_cells,) measured folds; NaN where there is no reading."""
    told = status.folds if len(status.folds) == n_cells else (None,) * n_cells
    fold: Reals = np.array([np.nan if value is None else min(max(value, 0.0), 1.0) for value in told])
    return fold


def folds_of(status: Status, before: Reals) -> Reals:
    """(n_cells,) what is measured; where it is not, what was before, or what is commanded while nothing was told."""
    if len(status.folds) != len(before) and status.fold is not None:
        return np.full(len(before), np.clip(status.fold, 0.0, 1.0))
    now = readings(status, len(before))
    return np.where(np.isnan(now), before, now)


def latch_states(status: Status) -> Mapping[str, str]:
    """What is known of every latch point of the design."""
    at: dict[str, list[bool | None]] = {}
    for one in status.latches:
        at.setdefault(one.id if one.secures is None else one.secures, []).append(one.confirmed)
    return {point: told_of_point(confirmed) for point, confirmed in at.items()}


def lost(wrong: LineLost, was_there: bool) -> dict[str, Any]:
    """What the bar says while nobody answers."""
    if wrong.ended and wrong.last is not None:
        return _ended(wrong.last)
    if wrong.ended:
        return {"link": ENDED, "alarms": ["The controller has ended, and did not say how. See its own terminal."]}
    if wrong.shut and not was_there:
        return {"link": WAITING, "alarms": []}
    how = "takes no commands any more" if wrong.shut else "does not answer"
    return {"link": SILENT, "alarms": [f"The controller {how}: {_GOES_ON}"]}


def _ended(last: Answer) -> dict[str, Any]:
    """With a last word: how it ended."""
    alarms = [] if last.fault is None else [f"Fault: {last.fault}"]
    if not last.at_rest:
        alarms.append("It ended before it was at rest. See its own terminal.")
    return {"link": f"ended: {last.state}", "alarms": alarms}


def news(answer: Answer, status: Status, verdict: Verdict | None, plan: Plan, seen: Seen) -> dict[str, Any]:
    """What the bar shows."""
    return {
        "link": "ok",
        "state": str(status.state),
        "stage": status.stage,
        "at_rest": answer.at_rest and seen.measured,
        "fold": float(np.mean(seen.fold)) if seen.measured else None,
        "takes_orders": status.takes_orders,
        "facts": [] if status.state is State.DISCONNECTED else _facts(status, verdict, seen),
        "alarms": alarms_of(status, verdict, plan, seen),
    }


def _facts(status: Status, verdict: Verdict | None, seen: Seen) -> list[str]:
    facts = []
    if seen.measured:
        low, high = 100.0 * float(seen.fold.min()), 100.0 * float(seen.fold.max())
        facts.append(f"measured {low:.1f} to {high:.1f} % open")
    if status.fold is not None:
        facts.append(f"commanded {100.0 * status.fold:.1f} %")
    if status.remaining_s is not None and not status.at_rest:
        facts.append(f"{status.remaining_s:.1f} s left")
    if seen.measured and verdict is not None and verdict.clearance_m is not None:
        touching = verdict.clearance_m < TOUCH_M
        facts.append("panels touch" if touching else f"clearance {_MM * verdict.clearance_m:.2f} mm")
    if seen.measured:
        facts.append(f"out of step {np.ptp(seen.fold):.3f}")
    closed, latches = status.secured
    if latches and seen.measured:  # as read last, which nobody knows when that was
        facts.append(f"latches {closed}/{latches}")
    return [*facts, *seen.growing]


def alarms_of(status: Status, verdict: Verdict | None, plan: Plan, seen: Seen) -> list[str]:
    """What an operator must not overlook."""
    alarms = [] if status.fault is None else [f"Fault: {status.fault}"]
    if status.concern is not None:
        alarms.append(f"Paused, and a fault if it lasts: {status.concern}")
    if status.state is State.DISCONNECTED:
        alarms.append("No link to the actuators: nothing is measured.")
    if seen.missing:
        alarms.append(f"No reading from {', '.join(seen.missing)}")
    if not seen.measured:
        return alarms
    if verdict is not None and verdict.collisions:
        worst = verdict.collisions[0]
        alarms.append(f"{worst.panels[0]} and {worst.panels[1]} reach {_MM * worst.depth_m:.2f} mm into each other")
    allowed = USABLE * plan.step_tolerance.allowed(float(seen.fold.max()))  # as the controller reckons
    if np.ptp(seen.fold) > allowed:
        alarms.append(f"Cells are out of step by {np.ptp(seen.fold):.3f}; {allowed:.3f} is allowed")
    return alarms
