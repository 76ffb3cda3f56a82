"""How it ended, in a sentence: nothing is called deployed that the controller did not call so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ori_deploy.deploy.result import Fault, MotionResult, Outcome
from ori_deploy.deploy.states import IN_MOTION, Event, State
from ori_deploy.motion.plan import Plan
from ori_deploy.telemetry.log import CLOSED
from ori_deploy.telemetry.read import Run

Tone = Literal["good", "bad", "neutral"]

_DONE = {
    "deploy": (State.DEPLOYED, Event.DEPLOYMENT_SECURED, "Deployed with every latch confirmed"),
    "stow": (State.STOWED, Event.STOWAGE_SECURED, "Stowed"),
    "recover": (State.ARMED, Event.RECOVERED, "Cells back in step"),
}
"""By command: the state and the event that it ends with, and the words for it."""
_LET_GO = {State.READY, State.DISCONNECTED}
"""States in which a session may end after all went well: nothing has moved, and nobody watches any more."""
_NOT_DONE = {"deploy": "Not deployed", "stow": "Not stowed", "recover": "Not in step"}
_WHY = {
    Outcome.SUCCEEDED: "the result and the final state contradict each other",
    Outcome.HELD: "held on the operator's word",
    Outcome.STOPPED: "stopped on the operator's word",
    Outcome.EMERGENCY_STOPPED: "stopped by the emergency stop",
    Outcome.PATH_TOLERANCE: "stopped off its path",
    Outcome.GOAL_TOLERANCE: "stopped short of the end of its path",
    Outcome.SEATING: "its slits did not close as they should",
    Outcome.ABORTED: "stopped by a fault",
}


@dataclass(frozen=True)
class Verdict:
    """A headline, whether it is good news, and the reasons."""

    tone: Tone
    headline: str
    reasons: tuple[str, ...]


def verdict(plan: Plan | None, run: Run | None, *, mixed: bool = False) -> Verdict:
    """Judge what is at hand: the last command's end counts, whatever went well before.

    Parameters
    ----------
    mixed
        Design, plan and log do not belong together: whatever the log says, it says of something else.
    """
    judged = _judged(plan, run)
    if not mixed:
        return judged
    alone = () if run is None else (f"The log by itself, of another design or plan: {judged.headline}.",)
    return Verdict("bad", "Not one run: files that do not belong together", alone + judged.reasons)


def _judged(plan: Plan | None, run: Run | None) -> Verdict:
    if run is None:
        if plan is None:
            return Verdict("neutral", "A design: not planned, not carried out", ())
        return Verdict("neutral", "A checked plan: not carried out", ())
    reasons = [_fault_sentence(f, float(run.time_s[0])) for f in run.faults]
    for result in run.results:
        reasons += [f"Recording failed during {result.command}: {e}" for e in result.observer_errors]
    final, where = run.state[-1], _where(run)
    if run.dropped:
        reasons.append(f"{run.dropped} records were dropped: the recorder was too far behind, the log has gaps.")
    if run.unread:
        reasons.append(f"The log is damaged: {run.unread}, and what is in it is not known.")
    elif not run.complete:
        why = "" if run.ending in ("", CLOSED) else f" ({run.ending})"
        reasons.append(f"The log was cut off in state {final}{where}{why}: what came after is not known.")
    if not run.results and _is_idle(run):
        return Verdict("neutral", f"Nothing was carried out: the log ends in state {final}{where}", tuple(reasons))
    if not run.results:
        return Verdict("bad", f"No result recorded: the log ends in state {final}{where}", tuple(reasons))
    tone, since = _since(run) if _is_done(run.results[-1]) else ("bad", "")
    headline = ", then ".join(_sentence(r, first=k == 0) for k, r in enumerate(run.results)) + since
    return Verdict(tone if run.complete else "bad", headline, tuple(reasons))


def _is_idle(run: Run) -> bool:
    """Whether a session ended in good order in which nothing was asked for, or nothing that moves."""
    moved = IN_MOTION & {*map(State, run.state), *(t.target for t in run.transitions)}
    return run.complete and not run.faults and not moved and State(run.state[-1]) in _LET_GO


def _since(run: Run) -> tuple[Tone, str]:
    """What became of it after the last command was done: a fault that came then counts, cleared or not.

    A result has no time of its own; the event that it ends with does. Where records were dropped that may be lost:
    then all that is known counts.
    """
    state, done, _ = _DONE[run.results[-1].command]
    at = max((k for k, t in enumerate(run.transitions) if t.event is done), default=-1)
    later = run.transitions[at + 1 :]
    # A time that is not known is no time before.
    faults = [f for f in run.faults if at < 0 or not f.time_s < run.transitions[at].time_s]
    final, ends = State(run.state[-1]), f"; the log ends in state {run.state[-1]}{_where(run)}"
    if faults or final is State.FAULT or any(t.target is State.FAULT for t in later):
        kinds = " and ".join(dict.fromkeys(str(f.kind) for f in faults))
        text = f"; then fault {kinds}" if kinds else "; then a fault"
        if final is State.FAULT:
            return "bad", text
        return "bad", text + (", cleared" if any(t.event is Event.CLEAR_FAULT for t in later) else "") + ends
    if final is state:
        return "good", ""
    if final in IN_MOTION or any(t.target in IN_MOTION for t in later):
        return "bad", ends
    return ("good", "") if final in _LET_GO else ("neutral", ends)


def _where(run: Run) -> str:
    """Where every cell was measured last, for whoever goes there to look; of old news it is said how old they are."""
    known = np.isfinite(run.fold)
    ever = np.logical_or.reduce(known, axis=0)
    if not ever.any():
        return ""
    newest = len(known) - 1
    rows = newest - known[::-1].argmax(axis=0)
    last = run.fold[rows, np.arange(len(rows))][ever]
    low, high = f"{last.min():.3f}", f"{last.max():.3f}"
    where = f" at fold {low}" if low == high else f" at fold {low} to {high}"
    silent: dict[str, list[str]] = {}
    for i, (cell, row) in enumerate(zip(run.info["cell_ids"], rows.tolist(), strict=True)):
        if not ever[i]:
            silent.setdefault("never", []).append(cell)
        elif row < newest:
            silent.setdefault(f"not since {run.time_s[row] - run.time_s[0]:.2f} s", []).append(cell)
    told = [
        f"no cell {when.removeprefix('not ')}" if len(cells) == len(rows) else f"{', '.join(cells)} {when}"
        for when, cells in silent.items()
    ]
    return f"{where} ({'; '.join(told)})" if told else where


def _is_done(result: MotionResult) -> bool:
    wanted = _DONE.get(result.command)
    return wanted is not None and result.succeeded and result.state is wanted[0] and result.fault is None


def _sentence(result: MotionResult, *, first: bool) -> str:
    if _is_done(result):
        text = _DONE[result.command][-1]
    else:
        text = f"{_NOT_DONE.get(result.command, 'Not done')}: {_WHY[result.outcome]}"
        if result.fault is not None:
            text += f" ({result.fault.kind}, {result.fault.thing})"
    return text if first else text[0].lower() + text[1:]


def _fault_sentence(fault: Fault, start_s: float) -> str:
    when = f" after {fault.time_s - start_s:.2f} s" if np.isfinite(fault.time_s) else ""
    return f"Fault {fault.kind}{when}: {fault.thing}: {fault.detail}. Remedy: {fault.remedy}."
