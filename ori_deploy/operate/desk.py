"""The operator's desk: what is asked of a controller, and what it truthfully answers. No sockets here."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import ActuatorBus
from ori_deploy.actuators.claim import held_devices
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.result import CycleRecord, Fault
from ori_deploy.deploy.span import SpanMayBeFolded
from ori_deploy.deploy.states import Event, IllegalCommand, State, allowed_commands
from ori_deploy.errors import OriDeployError
from ori_deploy.motion.plan import Plan
from ori_deploy.operate.due import DueGoals
from ori_deploy.operate.messages import MAY_MOVE, Answer, Code, Do, LatchStatus, Request, Status

_EVENTS = {
    Event.HOLD: Do.PAUSE,
    Event.RESUME: Do.RESUME,
    Event.STOP: Do.STOP,
    Event.EMERGENCY_STOP: Do.ESTOP,
}
"""The controller's names of what an operator may do in every session."""

_ORDERS = {
    Event.ARM: Do.ARM,
    Event.DEPLOY: Do.DEPLOY,
    Event.STOW: Do.STOW,
    Event.CLEAR_FAULT: Do.CLEAR_FAULT,
}
"""And in one that takes orders."""

_SPAN_WORD = (
    "the span may be folded; remedy: unfold it by hand, see that every hinge is straight, then say so for this "
    "deployment, with `ori-deploy span-unfolded` or on the operator's page"
)


class Operable(Protocol):
    """What the desk needs of a controller."""

    @property
    def state(self) -> State:
        """Its state."""

    @property
    def fault(self) -> Fault | None:
        """Its latched fault."""

    @property
    def concern(self) -> Fault | None:
        """What the motion is paused for, and becomes a fault if it lasts."""

    @property
    def under_way(self) -> bool:
        """Whether anything moves or is being worked on."""

    def hold(self) -> None:
        """Come to rest along the path and stay."""

    def resume(self) -> None:
        """Go on with what was held."""

    def stop(self) -> None:
        """Come to rest along the path and give the command up."""

    def emergency_stop(self, who: str) -> None:
        """Come to rest along the path at once, and latch that as a fault."""


class Orders(Protocol):
    """What the desk needs of a session that takes orders, instead of being started for one command."""

    def arm(self) -> None:
        """Hold where measured; nothing moves."""

    def deploy(self, *, span_unfolded: bool = False) -> None:
        """Begin to deploy; `span_unfolded` is somebody's word for this deployment."""

    def stow(self) -> None:
        """Begin to stow."""

    def clear_fault(self) -> None:
        """Forget the latched fault."""

    def span_is_unfolded(self) -> None:
        """Somebody's word for it, for the next deployment."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why an interlock does not let something be done."""

    code: Code
    text: str


class Interlock(Protocol):
    """What has to be so around the structure before it may move."""

    def refuses(self, do: Do, force: bool) -> Refusal | None:
        """Why DEPLOY or STOW may not be begun, or gone on with, now; None where it may."""


@dataclass(frozen=True, slots=True)
class Session:
    """What is being carried out, from which files: absolute paths; no log is None."""

    plan_path: Path
    rig_path: Path
    log_path: Path | None


class Desk:
    """Gives an operator's commands to a controller and tells how it is; an observer of its cycles.

    Parameters
    ----------
    controller
        Connected.
    session
        What the status names.
    plan, rig, bus
        What the controller was made with.
    now
        Seconds on the controller's clock.
    orders
        Takes orders to deploy and to stow; None where the session was started for one command.
    interlock
        Is asked before every motion that somebody orders or resumes; None on a bench.
    noted
        Called with what was asked, by whom, and what became of it, for the log; not for a status.

    Attributes
    ----------
    stopped_by
        Who took the command back with `stop`, or None.
    command
        "deploy" or "stow", whichever was carried out last; None before the first.
    forced
        Whether the last order went past the interlock.
    closing
        Whether the session ends as soon as all is at rest: stops are carried out still, what may move is not.
    """

    def __init__(
        self,
        controller: Operable,
        session: Session,
        plan: Plan,
        rig: ResolvedRig,
        bus: ActuatorBus,
        now: float,
        orders: Orders | None = None,
        interlock: Interlock | None = None,
        noted: Callable[[Request, str, Answer], None] | None = None,
    ) -> None:
        self._controller, self._session = controller, session
        self._orders = orders
        self._interlock = interlock
        self._noted = noted
        self._duration_s = float(plan.time_s[-1])
        self._stows = frozenset(plan.stow_stages)
        self._secures = {latch.id: latch.secures for latch in rig.latches + rig.stow_locks}
        self._due = DueGoals(rig, bus.delay_s, bus.due_s)
        self._began, self._now = now, now
        self._last: CycleRecord | None = None
        self.command: str | None = None
        self.forced = self.closing = False
        self._latches: tuple[LatchStatus, ...] = ()
        self._temperature_c: tuple[float | None, ...] = ()
        self.stopped_by: str | None = None

    def __call__(self, record: CycleRecord) -> None:
        """Remember a cycle."""
        self._last, self._now = record, record.time_s
        self._due.note(record)
        if record.stage is not None:
            self.command = "stow" if record.stage in self._stows else "deploy"
        if record.health is not None:
            self._temperature_c = _told(record.health.temperature_c, 1)
        if record.latches is not None:
            self._latches = tuple(
                LatchStatus(one.id, one.engaged, one.confirmed, self._secures.get(one.id)) for one in record.latches
            )

    @property
    def fault(self) -> Fault | None:
        """The controller's latched fault."""
        return self._controller.fault

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves and nothing is being worked on."""
        return not self._controller.under_way

    def answer(self, request: Request, who: str, late: str | None = None) -> Answer:
        """Do what is asked, and say what became of it.

        Parameters
        ----------
        request
            What.
        who
            Whom an emergency stop names in the fault.
        late
            Why nobody counts on it any more: it is then not done where it may lead to a motion.
        """
        if request.do is Do.STATUS:
            return self.told(self.status())
        if late is not None and request.do in MAY_MOVE:
            answer = self._refused(Code.TOO_LATE, late)
        elif self.closing and request.do in MAY_MOVE:
            answer = self._refused(Code.NOT_NOW, "the session has been told to end, and does at rest")
        else:
            answer = self._judged(request, who)
        if self._controller.state is State.DISCONNECTED:
            self._let_go()
        if self._noted is not None:
            self._noted(request, who, answer)
        return answer

    def _judged(self, request: Request, who: str) -> Answer:
        """Done, or not and why."""
        refusal = self._interlocked(request)
        if refusal is not None:
            return self._refused(refusal.code, refusal.text)
        try:
            answer = self._carry_out(request, who)
        except IllegalCommand as refused:
            reason = str(refused).removeprefix(f"{refused.command}: ").partition("; allowed in ")[0]
            return self._refused(Code.NOT_NOW if self._controller.fault is None else Code.FAULT, reason)
        except SpanMayBeFolded:
            return self._refused(Code.SPAN_WORD, _SPAN_WORD)
        except OriDeployError as failed:
            return self._refused(Code.REFUSED, str(failed))
        if answer.took and request.do in (Do.DEPLOY, Do.STOW):
            self.command, self.forced = str(request.do), request.force
        return answer

    def _interlocked(self, request: Request) -> Refusal | None:
        """What an interlock has against a motion; going on with one that was held is one."""
        do = request.do
        if do is Do.RESUME and self.command is not None:
            do = Do.STOW if self.command == "stow" else Do.DEPLOY
            if self.forced:
                return None
        if do is Do.ARM:
            do = Do.DEPLOY  # nothing is powered where nothing may move
        if self._interlock is None or do not in (Do.DEPLOY, Do.STOW):
            return None
        return self._interlock.refuses(do, request.force)

    def told(self, status: Status | None = None) -> Answer:
        """That it was taken, and how things are now."""
        return Answer(True, self._controller.state, self.at_rest, fault=self._fault(), status=status)

    def _carry_out(self, request: Request, who: str) -> Answer:
        do = request.do
        if do is Do.PAUSE and self._controller.state is State.HOLD:
            return replace(self.told(), why="paused already")
        if do is Do.PAUSE:
            self._controller.hold()
        elif do is Do.RESUME:
            self._controller.resume()
        elif do is Do.STOP:
            self._controller.stop()
            self.stopped_by = who
        elif do is Do.ESTOP:
            self._controller.emergency_stop(who)
        elif self._orders is None:
            return self._refused(Code.ONE_COMMAND, "this session was started for one command")
        else:
            _order(self._orders, request)
        return self.told()

    def _refused(self, code: Code, why: str) -> Answer:
        state = self._controller.state
        known = _EVENTS if self._orders is None else _EVENTS | _ORDERS
        allowed = tuple(known[event] for event in allowed_commands(state) if event in known)
        return Answer(False, state, self.at_rest, why, (Do.STATUS, *allowed), self._fault(), code=code)

    def _fault(self) -> str | None:
        return None if self._controller.fault is None else str(self._controller.fault)

    def _let_go(self) -> None:
        """Without a link nothing is known of the structure; what was counted stays true."""
        self._latches, self._temperature_c = (), ()
        if self._last is not None:
            nowhere = replace(self._last.readings, current_a=np.empty(0))
            self._last = replace(self._last, stage=None, commanded_fold=math.nan, folds=np.empty(0), readings=nowhere)

    def status(self) -> Status:
        """How things are."""
        if self._controller.state is State.DISCONNECTED:
            self._let_go()
        last, session = self._last, self._session
        concern = self._controller.concern
        fold = rate = progress = remaining = None
        if last is not None and math.isfinite(last.commanded_fold):
            fold, rate = round(last.commanded_fold, 6), round(last.rate, 6)
            progress, remaining = self._progress(last.path_time_s)
        return Status(
            pid=os.getpid(),
            plan=str(session.plan_path),
            rig=str(session.rig_path),
            log=None if session.log_path is None else str(session.log_path),
            ports=held_devices(),
            uptime_s=round(self._now - self._began, 3),
            state=self._controller.state,
            stage=None if last is None else last.stage,
            command=self.command,
            at_rest=self.at_rest,
            fold=fold,
            rate=rate,
            progress_percent=progress,
            remaining_s=remaining,
            fault=self._fault(),
            worst_tracking_rad=round(self._due.worst_rad, 6),
            worst_tracking_hinge=self._due.worst_hinge,
            lost_replies=0 if last is None else last.lost_replies,
            overruns=0 if last is None else last.overruns,
            cycles=0 if last is None else last.index + 1,
            latches=self._latches,
            takes_orders=self._orders is not None,
            folds=() if last is None else _told(last.folds, 5),
            current_a=() if last is None else _told(last.readings.current_a, 3),
            temperature_c=self._temperature_c,
            concern=None if concern is None else str(concern),
        )

    def _progress(self, path_time_s: float) -> tuple[float | None, float | None]:
        """Percent of the path's time that is done, and seconds of it that are left."""
        if self.command is None or not np.isfinite(path_time_s):
            return None, None
        done = path_time_s if self.command == "deploy" else self._duration_s - path_time_s
        return round(100.0 * done / self._duration_s, 2), round(max(self._duration_s - done, 0.0), 3)


def _order(orders: Orders, request: Request) -> None:
    """Give an order."""
    if request.do is Do.ARM:
        orders.arm()
    elif request.do is Do.DEPLOY:
        orders.deploy(span_unfolded=request.span_unfolded)
    elif request.do is Do.STOW:
        orders.stow()
    elif request.do is Do.SPAN_UNFOLDED:
        orders.span_is_unfolded()
    else:
        orders.clear_fault()


def _told(values: NDArray[np.float64], digits: int) -> tuple[float | None, ...]:
    """Numbers for JSON, which has no NaN."""
    return tuple(round(x, digits) if math.isfinite(x) else None for x in values.tolist())
