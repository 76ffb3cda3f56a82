"""The control loop's side of the MAVLink network: does what is wanted, and tells how the structure is.

It is looked at once per cycle. The words come from, and go to, the process that speaks MAVLink.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.result import CycleRecord, MotionResult, Outcome
from ori_deploy.deploy.states import State
from ori_deploy.mav.interlock import VehicleInterlock
from ori_deploy.mav.words import Answered, Ask, Attending, Ended, Failed, Hold, Snapshot, Tune, Vehicle, Word
from ori_deploy.operate.desk import Desk
from ori_deploy.operate.messages import LONGEST_WAIT_S, Code, Do, Request, too_late
from ori_deploy.wire.vehicle import dialect

STALE_ASK_S = LONGEST_WAIT_S
"""An order that waited longer than that is not carried out: who gave it is told that nothing answered. STOP is."""
BEAT_S = 1.0
SNAPSHOT_HZ = 10.0

REASONS: Mapping[Code, int] = MappingProxyType(
    {
        Code.NOT_NOW: dialect.ORI_REASON_BUSY,
        Code.REFUSED: dialect.ORI_REASON_REFUSED,
        Code.FAULT: dialect.ORI_REASON_FAULT,
        Code.ONE_COMMAND: dialect.ORI_REASON_REFUSED,
        Code.SPAN_WORD: dialect.ORI_REASON_REFUSED,
        Code.TOO_LATE: dialect.ORI_REASON_LOOP_SILENT,
        Code.AIRBORNE: dialect.ORI_REASON_AIRBORNE,
        Code.LANDED_UNKNOWN: dialect.ORI_REASON_LANDED_UNKNOWN,
        Code.ARMED: dialect.ORI_REASON_ARMED,
        Code.ARMING_UNKNOWN: dialect.ORI_REASON_ARMING_UNKNOWN,
        Code.FORCE_NOT_ALLOWED: dialect.ORI_REASON_FORCE_NOT_ALLOWED,
    }
)

STATES: Mapping[State, int] = MappingProxyType(
    {state: int(getattr(dialect, f"ORI_STRUCTURE_{state.name}")) for state in State}
)
"""HEARTBEAT.custom_mode and ORI_STRUCTURE.state of every state."""

log = logging.getLogger(__name__)


class Tunable(Protocol):
    """What parameters of the network change."""

    def limit_speed(self, part: float) -> None:
        """Go no faster than this part of the plan's speed."""


class Bridge:
    """Hands on what ground stations want, and tells them how the structure is; an observer of the cycles.

    Parameters
    ----------
    desk
        Does what is wanted.
    controller
        Takes the parameters that concern it.
    interlock
        Is told of the vehicle, and watched while the structure folds.
    rig
        Turns shaft angles into crease angles.
    say
        Passes a word on to the process that speaks MAVLink.
    now
        The monotonic clock.
    """

    def __init__(
        self,
        desk: Desk,
        controller: Tunable,
        interlock: VehicleInterlock,
        rig: ResolvedRig,
        say: Callable[[Word], None],
        now: Callable[[], float],
    ) -> None:
        self._desk, self._controller, self._interlock, self._rig = desk, controller, interlock, rig
        self._say, self._now = say, now
        self._token = 0  # of the order that is being carried out
        self._ordered: Do | None = None  # and what it was
        self._held_for = 0
        self._record: CycleRecord | None = None
        self._beat_due = self._snapshot_due = -math.inf
        self._hold_on_loss = True
        self._rested = True  # as it was told last

    def __call__(self, record: CycleRecord) -> None:
        """Remember a cycle."""
        self._record = record

    def cycle(self) -> None:
        """Once per cycle: look at the vehicle, and tell how things are when it is time."""
        self._watch_vehicle()
        self._watch_orders()
        now = self._now()
        beat = now >= self._beat_due
        begun_or_over = self._desk.at_rest != self._rested  # a STOP is judged by that: it is not to be late
        if not (beat or begun_or_over) and now < self._snapshot_due:
            return
        if beat:
            self._beat_due = max(self._beat_due, now - BEAT_S) + BEAT_S
        self._snapshot_due = now + 1.0 / SNAPSHOT_HZ
        self._say(self._snapshot(now, beat))

    def ended(self, result: MotionResult) -> None:
        """An order has ended."""
        text = "" if result.fault is None else f"{result.fault.kind}: {result.fault.thing}: {result.fault.detail}"
        self._say(self._snapshot(self._now(), False))  # known before the end is told: who asks then hears of it
        self._say(Ended(self._token, str(result.outcome), text))
        self._token = self._held_for = 0

    def attend(self, word: Word) -> None:
        """Do what a word asks for."""
        if isinstance(word, Ask):
            self._ask(word)
        elif isinstance(word, Vehicle):
            self._interlock.told(word)
        elif isinstance(word, Hold):
            self._hold(word.reason)
        elif isinstance(word, Tune):
            self._controller.limit_speed(word.speed)
            self._interlock.tune(word.deploy_when)
            self._hold_on_loss = word.hold_on_loss
        elif isinstance(word, Failed):  # one that was started again; of the first, `serve` ends
            log.error("the vehicle's network cannot be opened: %s", word.text)

    def cut_off(self) -> None:
        """The process that speaks MAVLink is gone: nobody on the network can stop the structure any more."""
        self._interlock.told(Vehicle())
        if self._hold_on_loss and self._token:
            self._hold(dialect.ORI_REASON_LINK_LOST)

    def _ask(self, ask: Ask) -> None:
        do = Do(ask.do)
        request = Request(do, force=ask.force, asked_s=ask.asked_s)
        if too_late(request, self._now()):
            self._say(Answered(ask.token, False, dialect.ORI_REASON_LOOP_SILENT, "the loop was too late for it"))
            return
        self._say(Attending(ask.token))
        answer = self._desk.answer(request, ask.who)
        if answer.took and do in (Do.DEPLOY, Do.STOW):
            if self._token:  # gone on with, or turned round: the older order is over
                self._say(Ended(self._token, str(Outcome.STOPPED), "another order took its place"))
            self._token, self._ordered, self._held_for = ask.token, do, 0
        if answer.took and ask.force:
            log.warning("%s went past the interlock: %s by force", ask.who, ask.do)
        log.info("%s asks for %s: %s", ask.who, ask.do, "taken" if answer.took else answer.why)
        reason = 0 if answer.code is None else REASONS[answer.code]
        self._say(Answered(ask.token, answer.took, reason, answer.why or ""))
        self._snapshot_due = -math.inf  # what changed is told at once

    def _hold(self, reason: int) -> None:
        if self._desk.answer(Request(Do.PAUSE), "the vehicle's network").took:
            self._held_for = reason
            log.warning("held: %s", dialect.enums["ORI_REASON"][reason].description)
            self._snapshot_due = -math.inf

    def _watch_vehicle(self) -> None:
        """Hold a structure that folds when the vehicle arms, takes off, or falls silent."""
        record, desk = self._record, self._desk
        if record is None or desk.forced or desk.command != "stow":
            return
        moving = record.state in (State.MOVING, State.LATCHING)
        if moving and self._interlock.refuses(Do.STOW, force=False) is not None:
            self._hold(dialect.ORI_REASON_VEHICLE_CHANGED)

    def _watch_orders(self) -> None:
        """Somebody at another terminal may turn round what a station wanted: its end is not the station's."""
        if self._token and self._desk.command != self._ordered:
            self._say(Ended(self._token, str(Outcome.STOPPED), "another order took its place"))
            self._token = self._held_for = 0

    def _snapshot(self, now: float, beat: bool) -> Snapshot:
        status, record, fault = self._desk.status(), self._record, self._desk.fault
        self._rested = status.at_rest
        folds: tuple[float, ...] = ()
        creases: tuple[float, ...] = (math.nan,) * len(self._rig.hinges)
        if record is not None:
            folds = tuple(record.folds.tolist())
            creases = tuple(np.asarray(self._rig.to_crease(record.readings.position_rad)).tolist())
        return Snapshot(
            time_s=now,
            beat=beat,
            state=STATES[status.state],
            stage=status.stage or "",
            fault="" if fault is None else str(fault.kind),
            fault_text="" if fault is None else str(fault),
            token=self._token,
            held_for=self._held_for if status.state is State.HOLD else 0,
            at_rest=status.at_rest,
            forced=self._desk.forced,
            may_fold=self._interlock.refuses(Do.STOW, force=False) is None,
            may_deploy=self._interlock.refuses(Do.DEPLOY, force=False) is None,
            fold=_or_nan(status.fold),
            rate=_or_nan(status.rate),
            remaining_s=_or_nan(status.remaining_s),
            progress=_or_nan(status.progress_percent) if self._token else math.nan,
            worst_tracking_rad=status.worst_tracking_rad,
            folds=folds,
            creases_rad=creases,
            commanded=tuple(one.engaged for one in status.latches),
            confirmed=tuple(one.confirmed is True for one in status.latches),
            sensed=tuple(one.confirmed is not None for one in status.latches),
        )


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
