"""The controller: carries a plan out on a bus, one cycle at a time.

What it promises: it moves only when it knows where it is; it starts where it stands; whatever goes wrong, it
stops along the path, all cells in step; a fault stays until it is cleared; "deployed" means that every latch
says so.
"""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import ActuatorBus, BusError, HingeReadings
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import Clock
from ori_deploy.deploy.agreement import check_agreement
from ori_deploy.deploy.cycle import Cycle
from ori_deploy.deploy.errand import Counts
from ori_deploy.deploy.journal import Journal
from ori_deploy.deploy.localise import locate
from ori_deploy.deploy.observers import Observer
from ori_deploy.deploy.result import Fault, FaultKind, MotionResult, StartRefused
from ori_deploy.deploy.span import require_unfolded
from ori_deploy.deploy.states import IN_MOTION, Action, Event, Guard, IllegalCommand, State
from ori_deploy.deploy.stopping import stop_ramp
from ori_deploy.deploy.way import Way
from ori_deploy.errors import InputError
from ori_deploy.motion.plan import Plan
from ori_deploy.motion.recovery import Recovery

FloatArray = NDArray[np.float64]

log = logging.getLogger(__name__)

WAY_TOLERANCE = 0.01
"""Fold by which cells may stand off the beginning of a checked way."""


class Controller(Cycle):
    """Carries a plan out.

    Commands change what is being done; `step` does one cycle of it, at its time; `run` steps until it is
    done. Commands may come between any two steps.

    Parameters
    ----------
    plan
        The motion.
    rig
        Resolved for the plan's cells and latch points.
    bus
        Its hinges and latches are the rig's, in the rig's order.
    clock
        Paces the cycles.
    observers
        Called with the record of every cycle, in order. One that raises is not called again; the motion
        goes on, and the result tells.
    journal
        Where word is left before each stage; what is there at the start has to agree with what is measured.

    Raises
    ------
    RigError, MotionError
        Plan, rig and bus do not fit each other.
    """

    def __init__(
        self,
        plan: Plan,
        rig: ResolvedRig,
        bus: ActuatorBus,
        clock: Clock,
        observers: Sequence[Observer] = (),
        journal: Journal | None = None,
    ) -> None:
        super().__init__(plan, rig, bus, clock, observers, journal)
        self._pressed_by = ""
        self._recovery: Recovery | None = None
        self._left_word = None if journal is None else journal.last
        self._guards |= {
            Guard.AT_REST: lambda _: None if self._at_rest else "still slowing down",
            Guard.OTHER_WAY: lambda event: f"already under way to {event}" if self._errand.command is event else None,
            Guard.NO_CONCERN: lambda _: None if self.concern is None else str(self.concern),
        }
        self._actions |= {
            Action.OPEN_BUS: self._open_bus,
            Action.CLOSE_BUS: self._close_bus,
            Action.TORQUE_ON: self._torque_on,
            Action.TORQUE_OFF: self._torque_off,
            Action.BEGIN: self._begin,
            Action.FOLLOW: self._follow,
            Action.TURN: self._turn,
            Action.GO_ON: self._go_on,
            Action.RELAX_MAGNETS: self._relax_magnets,
            Action.PRESS: self._press,
            Action.CLEAR: self._clear,
        }

    # -- commands ------------------------------------------------------------------------------------

    def connect(self) -> None:
        """Open the bus. Nothing moves, torque stays as it is, a latched fault stays.

        Raises what `ActuatorBus.connect` raises.
        """
        self._do(Event.CONNECT)

    def arm(self) -> None:
        """Hold every hinge where it stands. Raises `CommandRefused` when one does not say where it is."""
        self._do(Event.ARM)

    def disarm(self) -> None:
        """Let the hinges go limp; a latched fault stays. Refused while anything moves."""
        self._do(Event.DISARM)

    def deploy(self, *, span_unfolded: bool = False) -> None:
        """Begin to deploy from wherever on the path the structure stands; `step` or `run` carries it out.

        A stow that is under way, or held, turns round where it is. A span in segments is unfolded by hand:
        `span_unfolded` is somebody's word for it, wanted every time.

        Raises
        ------
        StartRefused
            Its place is not known or off the path, an actuator is not fit to move, or the span may be
            folded; nothing moved, the state is unchanged.
        IllegalCommand
            In this state.
        """
        require_unfolded(self._plan, span_unfolded)
        self._do(Event.DEPLOY)

    def require_unfolded(self, span_unfolded: bool) -> None:
        """Raise `StartRefused` as `deploy` would where nobody says that the span is unfolded; moves nothing."""
        require_unfolded(self._plan, span_unfolded)

    def stow(self) -> None:
        """Begin to stow, as `deploy`."""
        self._do(Event.STOW)

    def recover(self, recovery: Recovery) -> None:
        """Begin to bring cells that are out of step back onto the path, along a way that was checked.

        Ends in ARMED. Raises `StartRefused` when the cells do not stand where the way begins.
        """
        self._recovery = recovery
        self._do(Event.RECOVER)

    def trust_measured(self) -> None:
        """Somebody looked: the structure stands as measured, whatever the journal says. Moves nothing."""
        self._left_word = None

    def already(self, command: str) -> bool:
        """Whether the structure is where "deploy" or "stow" would end: measured, locked, and no word against it.

        Nothing moves and no torque goes on. False whenever that is not known: the command then says why.
        """
        latches, end = len(self._rig.latches), 0 if command == Event.STOW else -1
        try:
            readings, _ = self._fit_to_move(self._clock.now(), holding=False)
            locks = self._link.bus.read_latches()
        except (BusError, StartRefused):
            return False
        here, there = (locks[latches:], locks[:latches]) if end == 0 else (locks[:latches], locks[latches:])
        away = self._rig.to_crease(readings.position_rad) - self._rig.to_crease(self._table.shaft_rad[end])
        return (
            bool((np.abs(away) <= self._settings.goal_tolerance_rad).all())
            and all(lock.valid and lock.confirmed is True for lock in here)
            and not any(lock.confirmed for lock in there)
        )

    def hold(self) -> None:
        """Come to rest along the path and stay."""
        self._do(Event.HOLD)

    def resume(self) -> None:
        """Go on with what was held. Latches that were being worked on get their full time again."""
        self._do(Event.RESUME)

    def limit_speed(self, part: float) -> None:
        """Go no faster than this part of the plan's speed, above 0 and up to 1, from now on. In every state."""
        if not 0.0 < part <= 1.0:
            raise InputError(
                "speed: not a part of the plan's", value=part, limit="above 0, up to 1", remedy="0.5 is half as fast"
            )
        self._speed = part

    def stop(self) -> None:
        """Come to rest along the path and give the command up; electromagnets are let go of with it."""
        self._do(Event.STOP)

    def emergency_stop(self, who: str = "the operator") -> None:
        """Bring every goal to rest along the path within two cycles, and latch that as a fault. In every state.

        Hinges go on holding: what goes limp may fall. Only `clear_fault` leads on.
        """
        self._pressed_by = who
        self._do(Event.EMERGENCY_STOP)

    def clear_fault(self) -> None:
        """Forget the fault, once at rest. Nothing moves, and no torque goes on that is off.

        Leads to ARMED when every hinge holds, to READY when one is limp, to DISCONNECTED when the link was
        lost. A cause that persists is found again.

        Raises
        ------
        CommandRefused
            An actuator does not let its error be cleared; the fault stays.
        """
        self._do(Event.CLEAR_FAULT)

    def disconnect(self) -> None:
        """Let go of the bus; hinges hold or go limp as the rig's `at_close` says."""
        self._do(Event.DISCONNECT)

    def close(self) -> None:
        """Come to rest if need be, then let go of the bus. From every state, any number of times."""
        if self.state is State.DISCONNECTED:
            return
        if self.state in IN_MOTION or self.under_way:
            self._interrupt("the controller was closed during a command")
        self.disconnect()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def run(self) -> MotionResult:
        """Step until the command is done, held, stopped or ended by a fault, and at rest.

        Whatever is raised meanwhile, KeyboardInterrupt included, first brings the structure to rest along
        the path, is logged, leaves a latched fault, and is raised again.
        """
        try:
            while self.under_way:
                self.step()
        except BaseException as error:
            log.error("run ended by %r in state %s", error, self.state)
            self._interrupt(f"{type(error).__name__}: {error}")
            raise
        return self.result()

    # -- actions of the table ------------------------------------------------------------------------

    def _open_bus(self, _: Event) -> State:
        self._link.connect()
        return State.READY if self._fault is None else State.FAULT

    def _close_bus(self, _: Event) -> None:
        try:
            if not self._link.lost and self._settings.at_close == "relax":
                self._link.bus.disable_torque()
        finally:
            self._link.bus.close()
            self._motion.let_go()

    def _torque_on(self, _: Event) -> None:
        try:
            goal = self._link.torque_on(self._attempts)
        except BusError:
            with contextlib.suppress(BusError):  # the first error is the one that gets raised
                self._link.bus.disable_torque()
            raise
        self._tracking.stand(goal, self._clock.now())
        self._monitor.restart()
        self._errand.drop()

    def _torque_off(self, _: Event) -> None:
        self._link.bus.disable_torque()
        self._motion.let_go()

    def _counts(self, now: float) -> Counts:
        return Counts(now, self._cycles, self._pacer.overruns, self._monitor.lost_replies)

    def _begin(self, command: Event) -> None:
        """Start a command from the measured place; every hinge has to say where it is, and be fit."""
        now = self._clock.now()
        readings, folds = self._fit_to_move(now)
        place = locate(readings.position_rad, folds, self._tracking.allowed(folds), self._table, self._rig)
        self._motion.go(place, -1.0 if command is Event.STOW else 1.0)
        self._way = None
        self._set_out(command, folds, now)

    def _follow(self, command: Event) -> None:
        """Start on a checked way; it has to begin where the cells are measured."""
        now = self._clock.now()
        _, folds = self._fit_to_move(now)
        if self._recovery is None:
            raise ValueError("no way to follow")
        away = np.abs(np.clip(folds, 0.0, 1.0) - self._recovery.fold[0])
        worst = int(np.argmax(away))
        if not away[worst] <= WAY_TOLERANCE:
            raise StartRefused(
                f"cell {self._rig.cell_ids[worst]} is not where the way begins",
                value=f"fold {folds[worst]:.4f} against {self._recovery.fold[0, worst]:.4f}",
                limit=f"{WAY_TOLERANCE:g}",
                remedy="it has moved since; look for a way again",
            )
        self._way = Way(self._recovery, self._motion.goal, self._plan, self._rig, self._motion.gentle)
        self._motion.follow(self._way)
        self._set_out(command, folds, now)

    def _fit_to_move(self, now: float, *, holding: bool = True) -> tuple[HingeReadings, FloatArray]:
        """Readings of every hinge and the folds they mean, once every actuator is fit to move."""
        readings = self._link.fresh_readings(self._attempts)
        unfit = self._monitor.judge_health(self._link.fresh_health(self._attempts), holding, now)
        if unfit is not None:
            raise StartRefused(f"{unfit.thing}: {unfit.detail}", remedy=unfit.remedy)
        folds = self._localiser.folds(readings.position_rad)
        if self._left_word is not None:
            check_agreement(self._left_word, folds, self._plan, self._table, self._rig)
        return readings, folds

    def _set_out(self, command: Event, folds: FloatArray, now: float) -> None:
        self._monitor.restart()
        self._monitor.seed(folds)
        self._errand.begin(command, now, self._counts(now))
        self._left_word = None  # from here on it is ours
        self._checks.concern = None  # every actuator was found fit just now
        self._note(self._errand.state)

    def _turn(self, command: Event) -> State:
        """From where the motion is, the other way; or on, when it was held."""
        if self._errand.command is command:
            return self._go_on(command)
        if self._errand.recovering:
            raise IllegalCommand(self.state, command, "cells are being brought into step; stop that first")
        now = self._clock.now()
        self._errand.turn(command, now, self._counts(now))
        self._motion.turn(self._errand.direction)
        self._note(self._errand.state)
        return self._errand.state

    def _go_on(self, _: Event) -> State:
        self._errand.restart_clock(self._clock.now())
        return self._errand.state

    def _relax_magnets(self, _: Event) -> None:
        if self._errand.closing:
            self._link.relax_magnets(self._rig.latches + self._rig.stow_locks, self._clock.now())

    def _press(self, _: Event) -> None:
        """Stop at once; a fault that was there before keeps its name."""
        pressed = Fault(
            FaultKind.EMERGENCY_STOP,
            "controller",
            f"pressed by {self._pressed_by}",
            "see why it was pressed",
            self._clock.now(),
        )
        if self._fault is None:
            self._latch(pressed)
        else:
            self._stop_ramp = stop_ramp(pressed.kind, self._pacer.period_s)

    def _clear(self, _: Event) -> State:
        if self._link.lost:
            self._link.bus.close()
            self._motion.let_go()
            target = State.DISCONNECTED
        else:
            goal = self._link.reset_actuators(self._attempts, self._motion.holding)
            self._tracking.stand(goal, self._clock.now())
            target = State.ARMED if self._motion.holding else State.READY
        self._fault = self._checks.concern = None
        self._errand.drop()
        self._monitor.restart()
        return target

    # -- coming to rest whatever happens -------------------------------------------------------------

    def _interrupt(self, reason: str) -> None:
        """Latch a fault and come to rest along the path, as far as the bus still lets us."""
        fault = Fault(FaultKind.INTERRUPTED, "controller", reason, "see what ended it", self._clock.now())
        if self.state in IN_MOTION:
            self._trip(fault)
        why = "not at rest after twice the time of the ramp"
        patience_s = 2.0 * self._motion.gentle.longest_s + self._link.bus.delay_s
        try:
            self.step()  # at rest as well: observers must see the fault
            for _ in range(math.ceil(patience_s * self._rig.rate_hz) + 10):
                if self._at_rest:
                    return
                self.step()
        except BaseException as error:  # noqa: BLE001  the first error is the one that gets raised
            why = f"could not come to rest along the path ({error!r})"
        log.error("%s: goals stay as last sent", why)
        self._motion.halt()
