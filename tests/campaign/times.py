"""How soon a fault is noticed, goals rest and shafts stay, against the limits; and what the machine adds to it.

On a virtual clock nothing is added, and the limits are those of docs/safety.md at 100 Hz. A backend in real time is
allowed what its rig says: a cycle in which somebody does not answer lasts as long as the rig waits, a board goes on
with what it has queued. And when the machine itself was late by more than a time is above its limit, nobody can tell:
that is said and not judged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ori_deploy.actuators.mcu.settings import FRAME_S
from ori_deploy.deploy.result import CycleRecord, Fault, FaultKind
from ori_deploy.deploy.states import State
from tests.campaign.faults import AT_REST, Cause
from tests.campaign.grounds import Ground
from tests.campaign.outcome import Trial
from tests.campaign.watch import Watch

STATED_HZ = 100.0
"""At which the limits are stated; at other rates they are so many cycles."""

ABORT_LIMIT_S = 0.1
"""From a stall or a crease off its path to rest."""

AT_ONCE = frozenset(
    {
        FaultKind.EMERGENCY_STOP, FaultKind.HARDWARE_ERROR, FaultKind.TORQUE_LOST, FaultKind.RESTARTED,
        FaultKind.LOST_REPLIES, FaultKind.WATCHDOG, FaultKind.BUS_CLOSED, FaultKind.BUS_ERROR,
    }
)  # fmt: skip
AT_ONCE_CYCLES = 2
"""What is at rest so soon. Stated here and not taken from the controller, which is what is judged."""

STAYS_RAD = float(np.deg2rad(0.25))
"""A crease so near to where it stays is there: shafts come to rest exponentially."""

ENOUGH = 1000
"""Of trials for a 99.9 % quantile."""


def judge_times(trial: Trial, cause: Cause, ground: Ground, after: Sequence[CycleRecord], injected_s: float) -> None:
    """Note the times of a trial, and judge them.

    Parameters
    ----------
    trial
        Takes them.
    cause
        What was injected.
    ground
        Its watch looked on from the injection to the end.
    after
        Records since the injection.
    injected_s
        On the controller's clock.
    """
    first = next((k for k, record in enumerate(after) if record.state in (State.FAULT, State.HOLD)), None)
    if first is None:
        return
    noticed = after[first].time_s
    trial.noticed_s = noticed - injected_s
    moving = max((k for k, record in enumerate(after) if record.rate != 0.0), default=-1)
    if moving + 1 == len(after):
        trial.violations.append("never came to rest")
        return
    resting = after[moving + 1].time_s
    trial.rested_s, trial.within_s = max(0.0, resting - noticed), resting - injected_s
    judge = Judge(trial, ground.watch)
    notice = _notice_limit(cause, ground)
    if notice is not None and trial.stage not in AT_REST:
        judge("noticed", trial.noticed_s, notice, injected_s)
    rest = _rest_limit(cause, after[first].fault, ground)
    if not ground.bus.delay_s:  # where a device brakes by itself, no goals are sent any more
        judge("goals at rest", trial.rested_s, rest, noticed)
    _judge_shafts(judge, ground, after[first], rest)


def _judge_shafts(judge: Judge, ground: Ground, noticing: CycleRecord, rest_s: float) -> None:
    """Shafts follow within their lag, which they may need once more to be as near as that to where they stay."""
    still, unseen = ground.watch.still_from(STAYS_RAD * np.abs(ground.rig.shaft_per_crease))
    judge.trial.still_s = max(0.0, still - noticing.time_s)
    limit = rest_s + lag_s(ground) + unseen
    if ground.bus.delay_s:
        limit = _device_limit(noticing, ground) + lag_s(ground) + unseen
    judge("shafts at rest", judge.trial.still_s, limit, noticing.time_s)


def lag_s(ground: Ground) -> float:
    """From the goals' rest until shafts that were as fast as can be are `STAYS_RAD` from it."""
    lag_rad = float(np.abs(ground.plan.crease_rates_rad_s).max()) * ground.lag_s
    return ground.lag_s * math.log(max(math.e, lag_rad / STAYS_RAD))


def _notice_limit(cause: Cause, ground: Ground) -> float | None:
    """Cycles to notice, and the one that is under way; the rig's patience in each."""
    if cause.notice_s is None:
        return None
    return _cycles(cause.notice_s, ground) * (ground.period_s + ground.patience_s) + _under_way(ground)


def _under_way(ground: Ground) -> float:
    """In real time a reading may have been taken before the injection and be judged after it."""
    return ground.period_s if ground.real_time else 0.0


def _cycles(limit_s: float, ground: Ground) -> int:
    return round(limit_s * STATED_HZ) if ground.real_time else round(limit_s * ground.rig.rate_hz)


def _rest_limit(cause: Cause, fault: Fault | None, ground: Ground) -> float:
    """Of goals, from the cycle that notices."""
    if fault is None or cause.pauses:
        return ground.rig.controller.hold_ramp_s * 1.3
    cycle = ground.period_s + ground.patience_s
    if fault.kind in AT_ONCE:
        return AT_ONCE_CYCLES * cycle
    return ABORT_LIMIT_S if not ground.patience_s else _cycles(ABORT_LIMIT_S, ground) * cycle


def _device_limit(noticing: CycleRecord, ground: Ground) -> float:
    """Of a device that brakes along what it has queued: told in the cycle that notices, it begins two frames later.

    What it is not told any more it notices by the silence. A pause goes through the queue.
    """
    if noticing.fault is None:
        return ground.bus.delay_s + ground.rig.controller.hold_ramp_s * 1.3 + ground.period_s
    told = ground.deaf_s if noticing.fault.kind in (FaultKind.BUS_CLOSED, FaultKind.WATCHDOG) else 0.0
    return told + ground.bus.brake_s + 2.0 * FRAME_S + ground.patience_s


class Judge:
    """Compares a time with its limit; what is above it by less than the machine was late cannot be told.

    Parameters
    ----------
    trial
        Takes what broke, and what could not be judged.
    watch
        Looked on meanwhile.
    """

    def __init__(self, trial: Trial, watch: Watch) -> None:
        self.trial, self._watch = trial, watch

    def __call__(self, what: str, seen_s: float, limit_s: float, since_s: float) -> None:
        if seen_s <= limit_s + 1e-9:
            return
        late_s = self._watch.late_s(since_s, since_s + seen_s)
        told = f"{what} after {seen_s:.3f} s; limit: {limit_s:.3f} s"
        if seen_s - late_s <= limit_s:
            self.trial.not_judged.append(f"{told}; the machine was late by {late_s:.3f} s")
        else:
            self.trial.violations.append(f"{told}" + (f" (machine late by {late_s:.3f} s)" if late_s > 0.0 else ""))


def worst(times: Sequence[float | None]) -> tuple[str, str]:
    """What can be said of the longest of these, and which quantile that is."""
    known = [value for value in times if value is not None]
    if not known:
        return "-", "-"
    if len(known) < ENOUGH:
        return f"{max(known):.3f}", f"worst of {len(known)}"
    return f"{np.quantile(known, 0.999, method='higher'):.3f}", f"p99.9 of {len(known)}"
