"""The controller: carries a plan out on a bus, one cycle at a time.

What it promises: it moves only when it knows where it is; it starts where it stands; whatever goes wrong, it
stops along the path, all cells in step; a fault stays until it is cleared; "deployed" means that every latch
says so.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import ActuatorBus, HealthReadings, HingeReadings, LatchReading
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import Clock
from ori_deploy.deploy.fit import check_fit
from ori_deploy.deploy.latching import LatchWork
from ori_deploy.deploy.link import Link
from ori_deploy.deploy.localise import Localiser, locate
from ori_deploy.deploy.monitor import Monitor
from ori_deploy.deploy.motion import Motion
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.result import CycleRecord, Fault, FaultKind, MotionResult, Outcome, StartRefused
from ori_deploy.deploy.states import IN_MOTION, Event, IllegalCommand, Machine, State
from ori_deploy.deploy.step_room import StepRoom
from ori_deploy.motion.plan import DEPLOY_STAGES, STOW_STAGES, Plan, StageName

FloatArray = NDArray[np.float64]
Observer = Callable[[CycleRecord], None]

log = logging.getLogger(__name__)

_OUTCOMES = {
    State.DEPLOYED: Outcome.SUCCEEDED,
    State.STOWED: Outcome.SUCCEEDED,
    State.HOLD: Outcome.HELD,
    State.ARMED: Outcome.STOPPED,
    State.FAULT: Outcome.FAULT,
}


class Controller:
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
    ) -> None:
        check_fit(plan, rig, bus)
        self._rig, self._clock = rig, clock
        self._settings = rig.controller
        self._period_s = 1.0 / rig.rate_hz
        self._table = PathTable.build(plan, rig)
        self._localiser = Localiser(self._table)
        self._motion = Motion(self._table, rig)
        self._monitor = Monitor(plan, rig)
        self._room = StepRoom(plan.step_tolerance, self._table, self._motion.slew_per_s, rig.rate_hz)
        self._link = Link(bus, self._trip)
        self._machine = Machine()
        self._fault: Fault | None = None
        self._observers = list(observers)
        self._observer_errors: list[str] = []

        self._command: Event | None = None
        self._stages: tuple[StageName, ...] = ()
        self._stage: StageName | None = None
        self._stage_started = 0.0
        self._work: LatchWork | None = None
        self._rate_limit = 1.0

        self._cycles = self._overruns = 0
        self._deadline = -np.inf
        self._was_under_way = False  # at the end of the last cycle
        self._health_due = -np.inf
        self._since = (0.0, 0, 0, 0)  # time, cycles, overruns and lost replies when the command came

    # -- what it is doing ----------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """Where in the table of `ori_deploy.deploy.states` it is."""
        return self._machine.state

    @property
    def fault(self) -> Fault | None:
        """The latched fault."""
        return self._fault

    @property
    def under_way(self) -> bool:
        """Whether `step` still has something to bring to its end."""
        active = self.state in (State.MOVING, State.LATCHING, State.STOPPING)
        return active or not self._motion.at_rest

    def add_observer(self, observer: Observer) -> None:
        """Call `observer` with the record of every cycle from now on."""
        self._observers.append(observer)

    # -- commands ------------------------------------------------------------------------------------

    def connect(self) -> None:
        """Open the bus. Nothing moves, torque stays as it is, a latched fault stays.

        Raises what `ActuatorBus.connect` raises.
        """
        self._machine.require(Event.CONNECT)
        self._link.connect()
        self._fire(Event.CONNECT, State.READY if self._fault is None else State.FAULT)

    def arm(self) -> None:
        """Hold every hinge where it stands. Raises `CommandRefused` when one does not say where it is."""
        self._machine.require(Event.ARM)
        self._motion.stand(self._link.bus.enable_torque())
        self._monitor.restart()
        self._command = self._stage = None
        self._fire(Event.ARM)

    def disarm(self) -> None:
        """Let the hinges go limp; a latched fault stays. Refused while anything moves."""
        self._require_rest(Event.DISARM)
        self._link.bus.disable_torque()
        self._motion.let_go()
        self._fire(Event.DISARM)

    def deploy(self) -> None:
        """Begin to deploy from wherever on the path the structure stands; `step` or `run` carries it out.

        Raises
        ------
        StartRefused
            Its place is not known or off the path, or an actuator is not fit to move; nothing moved, the
            state is unchanged.
        IllegalCommand
            In this state.
        """
        self._begin(Event.DEPLOY, 1.0, DEPLOY_STAGES)

    def stow(self) -> None:
        """Begin to stow, as `deploy`."""
        self._begin(Event.STOW, -1.0, STOW_STAGES)

    def hold(self) -> None:
        """Come to rest along the path and stay."""
        self._machine.require(Event.HOLD)
        self._fire(Event.HOLD)

    def resume(self) -> None:
        """Go on with what was held. Latches that were being worked on get their full time again."""
        self._machine.require(Event.RESUME)
        self._start_stage_clock(self._clock.now())
        self._fire(Event.RESUME, State.MOVING if self._stage in ("open", "close") else State.LATCHING)

    def stop(self) -> None:
        """Come to rest along the path and give the command up."""
        self._machine.require(Event.STOP)
        self._fire(Event.STOP)

    def clear_fault(self) -> None:
        """Forget the fault, once at rest. Nothing moves, and no torque goes on that is off.

        Leads to ARMED when every hinge holds, to READY when one is limp, to DISCONNECTED when the link was
        lost. A cause that persists is found again.

        Raises
        ------
        CommandRefused
            An actuator does not let its error be cleared; the fault stays.
        """
        self._require_rest(Event.CLEAR_FAULT)
        if self._link.lost:
            self._link.bus.close()
            self._motion.let_go()
            target = State.DISCONNECTED
        else:
            target = self._reset_actuators()
        self._fault = None
        self._command = self._stage = None
        self._monitor.restart()
        self._fire(Event.CLEAR_FAULT, target)

    def disconnect(self) -> None:
        """Let go of the bus; hinges hold or go limp as the rig's `at_close` says."""
        self._require_rest(Event.DISCONNECT)
        try:
            if not self._link.lost and self._settings.at_close == "relax":
                self._link.bus.disable_torque()
        finally:
            self._link.bus.close()
            self._motion.let_go()
            self._fire(Event.DISCONNECT)

    def close(self) -> None:
        """Come to rest if need be, then let go of the bus. From every state, any number of times."""
        if self.state is State.DISCONNECTED:
            return
        if self.state in IN_MOTION or self.under_way:
            self._interrupt("the controller was closed during a command")
        self.disconnect()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
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

    def result(self) -> MotionResult:
        """How the last command ended. Raises `IllegalCommand` when there was none or it has not ended."""
        if self._command is None or self.under_way or self.state not in _OUTCOMES:
            raise IllegalCommand(self.state, "result", "no command has ended")
        time_s, cycles, overruns, lost = self._since
        return MotionResult(
            command=str(self._command),
            outcome=_OUTCOMES[self.state],
            state=self.state,
            fault=self._fault,
            duration_s=self._clock.now() - time_s,
            cycles=self._cycles - cycles,
            overruns=self._overruns - overruns,
            lost_replies=self._monitor.lost_replies - lost,
            worst_tracking_rad=self._monitor.worst_tracking_rad,
            worst_tracking_hinge=self._monitor.worst_tracking_hinge,
            observer_errors=tuple(self._observer_errors),
        )

    # -- one cycle -----------------------------------------------------------------------------------

    def step(self) -> CycleRecord:
        """Wait for the cycle's time and do it: read, judge, advance, command, report."""
        if self.state is State.DISCONNECTED:
            raise IllegalCommand(self.state, "step")
        deadline = self._wait()
        now = self._clock.now()
        readings = self._link.read_hinges(now)
        folds = self._localiser.folds(readings.position_rad)
        self._judge(readings, folds, now)
        health = self._check_health(readings, now)
        latches = self._check_latches(now)
        self._send(now)
        self._finish_stage(readings, latches, now)
        record = self._record(now, deadline, readings, folds, health, latches)
        self._cycles += 1
        self._was_under_way = self.under_way
        self._notify(record)
        return record

    def _wait(self) -> float:
        """Sleep to the deadline and set the next one; deadlines that have passed are overruns."""
        now = self._clock.now()
        if now > self._deadline and not self._was_under_way:
            self._deadline = now  # nobody was waiting for the cycles in between
        elif now > self._deadline:
            late = int((now - self._deadline) / self._period_s)
            self._overruns += 1 + late
            self._deadline += late * self._period_s
        deadline = self._deadline
        self._clock.sleep_until(deadline)
        self._deadline = deadline + self._period_s
        return deadline

    def _judge(self, readings: HingeReadings, folds: FloatArray, now: float) -> None:
        self._trip(self._monitor.judge_replies(readings, folds, self._clock.now()))
        if self._holding:
            self._trip(self._monitor.judge_tracking(readings, self._motion.goal, now))
        self._rate_limit = 1.0
        if self.state not in IN_MOTION:
            return
        motion, cells = self._motion, self._monitor.folds
        if self.state is State.MOVING and motion.on_path:
            self._rate_limit = self._room.rate_limit(cells, motion.fold, motion.path_time_s, motion.direction)
        self._trip(self._monitor.judge_step(motion.fold, self._rate_limit, self._room.allowed(cells), now))

    def _check_health(self, readings: HingeReadings, now: float) -> HealthReadings | None:
        if now < self._health_due and not readings.alert.any():
            return None
        health = self._link.read_health(now)
        if health is not None:
            self._trip(self._monitor.judge_health(health, self._holding, now))
        return health

    def _check_latches(self, now: float) -> tuple[LatchReading, ...] | None:
        """Read the latches, every cycle while they are worked on and as often as the health otherwise."""
        due = now >= self._health_due
        if due:
            self._health_due = now + self._settings.health_period_s - 0.5 * self._period_s
        if not (due or self.state is State.LATCHING):
            return None
        latches = self._link.read_latches(now)
        if latches is None:
            return None
        if self.state is State.MOVING:
            self._trip(self._monitor.judge_impossible_latches(latches, now))
        elif self.state in (State.DEPLOYED, State.STOWED):
            held = self._rig.latches if self.state is State.DEPLOYED else self._rig.stow_locks
            self._trip(self._monitor.judge_held_latches(latches, held, now))
        return latches

    def _send(self, now: float) -> None:
        """Command the next place; at rest the same one again, so that no watchdog trips."""
        if self._link.lost:
            self._motion.halt()
            return
        self._motion.advance(self._rate_limit if self.state is State.MOVING else 0.0)
        if self._holding:
            self._link.command_hinges(self._motion.goal, now)

    def _finish_stage(self, readings: HingeReadings, latches: tuple[LatchReading, ...] | None, now: float) -> None:
        """See whether what is going on has come to its end, and go on to what follows."""
        if self.state is State.STOPPING and self._motion.at_rest:
            self._fire(Event.AT_REST)
        elif self.state is State.MOVING and self._motion.arrived:
            self._next_stage(Event.ARRIVED, now)
        elif self.state is State.LATCHING and latches is not None:
            self._work_latches(readings, latches, now)

    def _work_latches(self, readings: HingeReadings, latches: tuple[LatchReading, ...], now: float) -> None:
        closing = self._stage in ("latch", "lock")
        if self._work is None:
            if closing and not self._settled(readings, now):
                return
            deployed = self._stage in ("latch", "unlatch")
            self._work = LatchWork(self._rig.latches if deployed else self._rig.stow_locks, closing, now)
            self._link.command_latches(self._work, now)
        elif self._work.pending(latches):
            self._trip(self._work.judge(latches, now))
        else:
            endings = {"latch": Event.DEPLOYMENT_SECURED, "lock": Event.STOWAGE_SECURED}
            self._next_stage(endings.get(str(self._stage), Event.RELEASED), now)

    def _settled(self, readings: HingeReadings, now: float) -> bool:
        """Whether every crease is measured at the end of the path; a fault when that takes too long."""
        goal = self._motion.goal
        if self._monitor.at_goal(readings, goal):
            return True
        if now - self._stage_started > self._settings.settle_timeout_s:
            self._trip(self._monitor.goal_fault(readings, goal, now))
        return False

    def _record(
        self,
        now: float,
        deadline: float,
        readings: HingeReadings,
        folds: FloatArray,
        health: HealthReadings | None,
        latches: tuple[LatchReading, ...] | None,
    ) -> CycleRecord:
        return CycleRecord(
            index=self._cycles,
            time_s=now,
            deadline_s=deadline,
            state=self.state,
            stage=self._stage,
            path_time_s=self._motion.path_time_s,
            rate=self._motion.rate,
            rate_limit=self._rate_limit,
            commanded_fold=self._motion.fold,
            commanded_rad=self._motion.goal,
            readings=readings,
            folds=folds,
            health=health,
            latches=latches,
            lost_replies=self._monitor.lost_replies,
            overruns=self._overruns,
            transitions=self._machine.take_transitions(),
            fault=self._fault,
        )

    def _notify(self, record: CycleRecord) -> None:
        for observer in tuple(self._observers):
            try:
                observer(record)
            except Exception as error:  # noqa: BLE001  a full disk must not stop a structure half-way
                log.error("observer %r failed in cycle %d: %r", observer, record.index, error)
                self._observers.remove(observer)
                self._observer_errors.append(f"{type(error).__name__}: {error}")

    # -- inside --------------------------------------------------------------------------------------

    @property
    def _holding(self) -> bool:
        """Whether the hinges were told to hold, and can be told more."""
        return self._motion.holding and not self._link.lost

    def _fire(self, event: Event, target: State | None = None) -> None:
        self._machine.fire(event, self._clock.now(), target)

    def _require_rest(self, command: Event) -> None:
        self._machine.require(command)
        if not self._motion.at_rest:
            raise IllegalCommand(self.state, command, "still slowing down")

    def _trip(self, fault: Fault | None) -> None:
        """Latch a fault; the first one stays."""
        if fault is None or self.state is State.FAULT:
            return
        log.error("%s", fault)
        self._fault = fault
        self._fire(Event.FAULT)

    def _begin(self, command: Event, direction: float, stages: tuple[StageName, ...]) -> None:
        """Start a command from the measured place; every hinge has to say where it is, and be fit."""
        self._machine.require(command)
        now = self._clock.now()
        readings = self._link.fresh_readings(self._settings.lost_replies_allowed + 1)
        unfit = self._monitor.judge_health(self._link.bus.read_health(), True, now)
        if unfit is not None:
            raise StartRefused(f"{unfit.thing}: {unfit.detail}", remedy=unfit.remedy)
        folds = self._localiser.folds(readings.position_rad)
        place = locate(readings.position_rad, folds, self._room.allowed(folds), self._table, self._rig)
        self._monitor.restart()
        self._motion.go(place, direction)
        self._command, self._stages, self._stage = command, stages, stages[0]
        self._start_stage_clock(now)
        self._since = (now, self._cycles, self._overruns, self._monitor.lost_replies)
        self._fire(command)

    def _next_stage(self, event: Event, now: float) -> None:
        following = self._stages[self._stages.index(self._stage) + 1 :] if self._stage else ()
        self._stage = following[0] if following else None
        self._start_stage_clock(now)
        self._fire(event)

    def _start_stage_clock(self, now: float) -> None:
        self._work = None
        self._stage_started = now

    def _reset_actuators(self) -> State:
        """Clear the actuators' own errors. Those that hold go on holding, where they are measured now."""
        self._link.bus.reset_errors()
        if self._motion.holding and self._link.bus.read_health().torque_on.all():
            self._motion.stand(self._link.bus.enable_torque())
            return State.ARMED
        self._motion.let_go()
        return State.READY

    def _interrupt(self, reason: str) -> None:
        """Latch a fault and come to rest along the path, as far as the bus still lets us."""
        fault = Fault(FaultKind.INTERRUPTED, "controller", reason, "clear the fault", self._clock.now())
        if self.state in IN_MOTION:
            self._trip(fault)
        try:
            while not self._motion.at_rest:
                self.step()
        except BaseException as error:  # noqa: BLE001  the first error is the one that gets raised
            log.error("could not come to rest along the path (%r): goals stay as last sent", error)
            self._motion.halt()
