"""What happened in a run, and when: changes of state, latches, faults, and commands that changed no state."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from ori_deploy.telemetry.read import Run


@dataclass(frozen=True)
class RunEvent:
    """Something that happened.

    Attributes
    ----------
    time_s
        Since the run's first cycle; NaN where the log does not say.
    what
        "state", "fault", "command", or what a latch did: "latch confirmed", "latch engaged", "latch released",
        "latch not confirmed", "latch fault".
    thing
        The latch, the fault's kind, or the command; for states the new one.
    detail
        For people.
    """

    time_s: float
    what: str
    thing: str
    detail: str

    @property
    def is_confirmation(self) -> bool:
        return self.what == "latch confirmed"

    @property
    def kind(self) -> Literal["state", "latch", "fault", "command"]:
        """What to colour it by."""
        if self.what == "state":
            return "state"
        if self.what == "command":
            return "command"
        return "fault" if "fault" in self.what else "latch"

    @property
    def short(self) -> str:
        """A label for a plot."""
        return f"fault: {self.thing}" if self.what == "fault" else f"{self.thing} {self.what.removeprefix('latch ')}"


def run_events(run: Run) -> tuple[RunEvent, ...]:
    """All of them in the order of time, those without one at the end; a cause before its effect."""
    order = {"command": 0, "latch": 1, "fault": 2, "state": 3}
    events = (*_command_events(run), *latch_events(run), *fault_events(run), *_state_events(run))
    return tuple(sorted(events, key=lambda e: (math.inf if math.isnan(e.time_s) else e.time_s, order[e.kind])))


def _state_events(run: Run) -> list[RunEvent]:
    start = float(run.time_s[0])
    return [
        RunEvent(max(t.time_s - start, 0.0), "state", str(t.target), f"{t.source} → {t.target} ({t.event})")
        for t in run.transitions
    ]


_DRIVING = frozenset({"run", "close", "already"})
"""Calls of whoever drives the controller, not words of an operator."""


def _command_events(run: Run) -> list[RunEvent]:
    """Commands that no change of state tells of: those that were refused, and those that change something else."""
    start = float(run.time_s[0])
    told = {str(t.event) for t in run.transitions} | _DRIVING
    return [
        RunEvent(
            max(c["time_s"] - start, 0.0),
            "command",
            c["command"],
            _in_words(c),
        )
        for c in run.commands
        if c["outcome"] != "done" or not (c["command"] in told or _changes_nothing(c))
    ]


def _in_words(command: Mapping[str, Any]) -> str:
    """What was asked with it, and what became of it."""
    given = _given(command)
    if command["command"] == "limit_speed":
        given = [f"to {100.0 * part:g} % of the plan's" for part in given if isinstance(part, float)]
    told = " ".join([command["outcome"], *map(str, given)])
    return f"{told}: {command['detail']}" if command["detail"] else told


def _changes_nothing(command: Mapping[str, Any]) -> bool:
    """Every session says how fast it may go; the plan's own speed is no news."""
    return command["command"] == "limit_speed" and _given(command) == [1.0]


def _given(command: Mapping[str, Any]) -> list[Any]:
    """The arguments; those that have a name with it."""
    try:
        given = json.loads(command["arguments"] or "{}")
    except (ValueError, RecursionError):  # no JSON, or none that anybody would have written
        return [command["arguments"]]
    if not isinstance(given, dict):
        return [given]
    return [value if name.isdigit() else f"{name.replace('_', ' ')}: {value}" for name, value in given.items()]


def fault_events(run: Run) -> list[RunEvent]:
    """Faults, in order."""
    start = float(run.time_s[0])
    return [
        RunEvent(f.time_s - start, "fault", str(f.kind), f"{f.thing}: {f.detail}; remedy: {f.remedy}")
        for f in run.faults
    ]


def latch_events(run: Run) -> list[RunEvent]:
    """Changes of what latches were told and of what their sensors see; readings that were lost say nothing.

    A latch that is found confirmed at its first reading was so before: that is no event.
    """
    start = float(run.time_s[0])
    engaged: dict[str, bool] = {}
    confirmed: dict[str, bool] = {}
    tripped: dict[str, str | None] = {}
    events: list[RunEvent] = []
    for r in (r for r in run.latches if r.valid):
        now = r.time_s - start
        if r.engaged != engaged.get(r.id, r.engaged):
            events.append(RunEvent(now, "latch engaged" if r.engaged else "latch released", r.id, "commanded"))
        if r.confirmed is not None:
            closed = r.engaged and r.confirmed
            if closed and not confirmed.get(r.id, True):
                events.append(RunEvent(now, "latch confirmed", r.id, "its sensor sees it closed"))
            if not closed and r.engaged and confirmed.get(r.id, False):
                events.append(RunEvent(now, "latch not confirmed", r.id, "its sensor no longer sees it closed"))
            confirmed[r.id] = closed
        if r.fault is not None and r.fault != tripped.get(r.id):
            events.append(RunEvent(now, "latch fault", r.id, r.fault))
        engaged[r.id], tripped[r.id] = r.engaged, r.fault
    return events
