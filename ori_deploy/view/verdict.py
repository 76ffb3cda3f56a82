"""How it ended, in a sentence: nothing is called deployed that the controller did not call so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ori_deploy.deploy.result import Fault, MotionResult, Outcome
from ori_deploy.deploy.states import State
from ori_deploy.motion.plan import Plan
from ori_deploy.telemetry.log import CLOSED
from ori_deploy.telemetry.read import Run

Tone = Literal["good", "bad", "neutral"]

_DONE = {
    "deploy": (State.DEPLOYED, "Deployed with every latch confirmed"),
    "stow": (State.STOWED, "Stowed"),
    "recover": (State.ARMED, "Cells back in step"),
}
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
    if not run.complete:
        why = "" if run.ending in ("", CLOSED) else f" ({run.ending})"
        reasons.append(f"The log was cut off in state {final}{where}{why}: what came after is not known.")
    if not run.results:
        return Verdict("bad", f"No result recorded: the log ends in state {final}{where}", tuple(reasons))
    good = _is_done(run.results[-1]) and final != State.FAULT and run.complete
    headline = ", then ".join(_sentence(r, first=k == 0) for k, r in enumerate(run.results))
    if final == State.FAULT and _is_done(run.results[-1]):
        headline += "; then a fault"
    return Verdict("good" if good else "bad", headline, tuple(reasons))


def _where(run: Run) -> str:
    """Where every cell was measured last, for whoever goes there to look."""
    known = np.isfinite(run.fold).all(axis=1)
    if not known.any():
        return ""
    last = run.fold[known][-1]
    low, high = f"{last.min():.3f}", f"{last.max():.3f}"
    return f" at fold {low}" if low == high else f" at fold {low} to {high}"


def _is_done(result: MotionResult) -> bool:
    wanted, _ = _DONE.get(result.command, (None, ""))
    return result.succeeded and result.state is wanted and result.fault is None


def _sentence(result: MotionResult, *, first: bool) -> str:
    if _is_done(result):
        text = _DONE[result.command][1]
    else:
        text = f"{_NOT_DONE.get(result.command, 'Not done')}: {_WHY[result.outcome]}"
        if result.fault is not None:
            text += f" ({result.fault.kind}, {result.fault.thing})"
    return text if first else text[0].lower() + text[1:]


def _fault_sentence(fault: Fault, start_s: float) -> str:
    return (
        f"Fault {fault.kind} after {fault.time_s - start_s:.2f} s: {fault.thing}: {fault.detail}. "
        f"Remedy: {fault.remedy}."
    )
