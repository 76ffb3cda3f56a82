"""The controller: carries a plan out on a bus, one cycle at a time.

What it promises: it moves only when it knows where it is; it starts where it stands; whatever goes wrong, it
stops along the path, all cells in step; a fault stays until it is cleared; "deployed" means that every latch
says so.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import ActuatorBus, HealthReadings, HingeReadings
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import Clock
from ori_deploy.deploy.fit import check_fit
from ori_deploy.deploy.latching import Latches, LatchWork
from ori_deploy.deploy.link import Link
from ori_deploy.deploy.localise import Localiser, locate
from ori_deploy.deploy.monitor import Monitor
from ori_deploy.deploy.motion import Motion
from ori_deploy.deploy.observers import Observer, Observers
from ori_deploy.deploy.pacer import Pacer
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.result import OUTCOMES, CycleRecord, Fault, FaultKind, MotionResult, StartRefused
from ori_deploy.deploy.span import require_unfolded
from ori_deploy.deploy.states import IN_MOTION, Event, IllegalCommand, Machine, State
from ori_deploy.deploy.tracking import Tracking
from ori_deploy.motion.plan import DEPLOY_STAGES, STOW_STAGES, Plan, StageName

FloatArray = NDArray[np.float64]

log = logging.getLogger(__name__)

_ENDINGS: dict[StageName | None, Event] = {"latch": Event.DEPLOYMENT_SECURED, "lock": Event.STOWAGE_SECURED}


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
        self._plan, self._rig, self._clock = plan, rig, clock
        self._settings = rig.controller
        self._attempts = self._settings.lost_replies_allowed + 1
        self._pacer = Pacer(clock, rig.rate_hz, bus.delay_s)
        self._table = PathTable.build(plan, rig)
        self._localiser = Localiser(self._table)
        self._motion = Motion(self._table, rig)
        self._monitor = Monitor(plan, rig)
        self._tracking = Tracking(plan, self._table, self._motion, rig, bus, self._monitor)
        self._link = Link(bus, self._trip, clock, self._settings.max_reading_age_s)
        self._machine = Machine()
        self._fault: Fault | None = None
        self._observers = Observers(observers)

        self._command: Event | None = None
        self._stages: tuple[StageName, ...] = ()
        self._stage: StageName | None = None
        self._stage_started = 0.0
        self._work: LatchWork | None = None

        self._cycles, self._health_due = 0, -np.inf
        self._was_under_way = False  # at the end of the last cycle
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
        return active or not self._at_rest

    def add_observer(self, observer: Observer) -> None:
        """Call `observer` with the record of every cycle from now on."""
        self._observers.add(observer)

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
        self._tracking.stand(self._link.torque_on(self._attempts), self._clock.now())
        self._monitor.restart()
        self._command = self._stage = None
        self._fire(Event.ARM)

    def disarm(self) -> None:
        """Let the hinges go limp; a latched fault stays. Refused while anything moves."""
        self._require_rest(Event.DISARM)
        self._link.bus.disable_torque()
        self._motion.let_go()
        self._fire(Event.DISARM)

    def deploy(self, *, span_unfolded: bool = False) -> None:
        """Begin to deploy from wherever on the path the structure stands; `step` or `run` carries it out.

        A span in segments is unfolded by hand: `span_unfolded` is somebody's word for it, wanted every time.

        Raises
        ------
        StartRefused
            Its place is not known or off the path, an actuator is not fit to move, or the span may be
            folded; nothing moved, the state is unchanged.
        IllegalCommand
            In this state.
        """
        require_unfolded(self._plan, span_unfolded)
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
        """Come to rest along the path and give the command up; electromagnets are let go of with it."""
        self._machine.require(Event.STOP)
        if self._stage in ("latch", "lock"):
            self._link.relax_magnets(self._rig.latches + self._rig.stow_locks, self._clock.now())
        if self.state is not State.FAULT:  # a magnet could not be let go of
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
            goal = self._link.reset_actuators(self._attempts, self._motion.holding)
            self._tracking.stand(goal, self._clock.now())
            target = State.ARMED if self._motion.holding else State.READY
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

    def result(self) -> MotionResult:
        """How the last command ended. Raises `IllegalCommand` when there was none or it has not ended."""
        if self._command is None or self.under_way or self.state not in OUTCOMES:
            raise IllegalCommand(self.state, "result", "no command has ended")
        time_s, cycles, overruns, lost = self._since
        return MotionResult(
            command=str(self._command),
            outcome=OUTCOMES[self.state],
            state=self.state,
            fault=self._fault,
            duration_s=self._clock.now() - time_s,
            cycles=self._cycles - cycles,
            overruns=self._pacer.overruns - overruns,
            lost_replies=self._monitor.lost_replies - lost,
            worst_tracking_rad=self._monitor.worst_tracking_rad,
            worst_tracking_hinge=self._monitor.worst_tracking_hinge,
            observer_errors=tuple(self._observers.errors),
        )

    # -- one cycle -----------------------------------------------------------------------------------

    def step(self) -> CycleRecord:
        """Wait for the cycle's time and do it: read, judge, advance, command, report."""
        if self.state is State.DISCONNECTED:
            raise IllegalCommand(self.state, "step")
        deadline = self._pacer.wait(self._was_under_way)
        now = self._clock.now()
        readings = self._link.read_hinges(now)
        folds = self._localiser.folds(readings.position_rad)
        self._judge(readings, folds, now)
        health = self._check_health(readings, now)
        latches = self._check_latches(now)
        self._send(now)
        health = self._finish_stage(readings, health, latches, now)
        record = self._record(now, deadline, readings, folds, health, latches)
        self._cycles += 1
        self._was_under_way = self.under_way
        self._observers.notify(record)
        return record

    def _judge(self, readings: HingeReadings, folds: FloatArray, now: float) -> None:
        self._trip(self._monitor.judge_replies(readings, folds, self._clock.now()))
        if self._following:
            self._tracking.judge(readings, self.state, now, self._trip)

    def _check_health(self, readings: HingeReadings, now: float) -> HealthReadings | None:
        if now < self._health_due and not readings.alert.any():
            return None
        return self._read_health(now)

    def _read_health(self, now: float) -> HealthReadings | None:
        health = self._link.read_health(now)
        if health is not None:
            self._trip(self._monitor.judge_health(health, self._holding, now))
        return health

    def _check_latches(self, now: float) -> Latches | None:
        """Read the latches, every cycle while they are worked on and as often as the health otherwise."""
        if now >= self._health_due:
            self._health_due = now + self._settings.health_period_s - 0.5 * self._pacer.period_s
        elif self.state is not State.LATCHING:
            return None
        latches = self._link.read_latches(now)
        if latches is not None:
            self._trip(self._monitor.judge_latches(self.state, latches, now))
        return latches

    def _send(self, now: float) -> None:
        """Command the next place; at rest the same one again, so that no watchdog trips."""
        if self._link.lost or self._link.braked:
            self._motion.halt()
            return
        if self._pacer.sent():
            self._motion.halt()  # the servos stand at the last goal: from there, and gently
        else:
            self._motion.advance(self._tracking.rate_limit if self.state is State.MOVING else 0.0)
        if self._following:
            self._link.command_hinges(self._motion.goal, self._motion.velocity, now)
            self._tracking.sent(now)

    def _finish_stage(
        self, readings: HingeReadings, health: HealthReadings | None, latches: Latches | None, now: float
    ) -> HealthReadings | None:
        """See whether what is going on has come to its end, and go on to what follows.

        Returns the health, which is read for any claim that the structure is secured.
        """
        if self.state is State.STOPPING and self._at_rest:
            self._fire(Event.AT_REST)
        elif self.state is State.MOVING and self._motion.arrived:
            self._next_stage(Event.ARRIVED, now)
        elif self.state is State.LATCHING and latches is not None:
            return self._work_latches(readings, health, latches, now)
        return health

    def _work_latches(
        self, readings: HingeReadings, health: HealthReadings | None, latches: Latches, now: float
    ) -> HealthReadings | None:
        closing = self._stage in ("latch", "lock")
        settled = not closing or self._settled(readings, now)
        if self._work is None and settled:
            here, others = self._rig.latches, self._rig.stow_locks
            if self._stage in ("unlock", "lock"):
                here, others = others, here
            self._work = LatchWork(here, closing, now, () if closing else others)
            self._link.command_latches(self._work, now)
        elif self._work is not None and self._work.pending(latches):
            self._trip(self._work.judge(latches, now))
        elif self._work is not None and settled:
            return self._secure(health, latches, now)
        return health

    def _secure(self, health: HealthReadings | None, latches: Latches, now: float) -> HealthReadings | None:
        """Go on from the latches; nothing is called deployed or stowed before a look at everything."""
        ending = _ENDINGS.get(self._stage, Event.RELEASED)
        if ending is not Event.RELEASED:
            self._trip(self._monitor.judge_impossible_latches(latches, now))
            health = self._read_health(now) if health is None else health
            if health is None or not health.sound.all():
                return health  # in the next cycle; silence ends in a fault
        if self.state is State.LATCHING:
            self._next_stage(ending, now)
        return health

    def _settled(self, readings: HingeReadings, now: float) -> bool:
        """Whether every crease is measured at the end of the path; a fault when it is not for too long."""
        goal = self._motion.goal
        if self._monitor.at_goal(readings, goal):
            self._stage_started = now
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
        latches: Latches | None,
    ) -> CycleRecord:
        return CycleRecord(
            index=self._cycles,
            time_s=now,
            deadline_s=deadline,
            state=self.state,
            stage=self._stage,
            path_time_s=self._motion.path_time_s,
            rate=self._motion.rate,
            rate_limit=self._tracking.rate_limit,
            commanded_fold=self._motion.fold,
            commanded_rad=self._motion.goal,
            readings=readings,
            folds=folds,
            health=health,
            latches=latches,
            lost_replies=self._monitor.lost_replies,
            overruns=self._pacer.overruns,
            transitions=self._machine.take_transitions(),
            fault=self._fault,
        )

    # -- inside --------------------------------------------------------------------------------------

    @property
    def _at_rest(self) -> bool:
        """Whether nothing moves: no goal does, and none that is still queued."""
        return self._tracking.at_rest(self._clock.now()) or (self._link.lost and self._motion.at_rest)

    @property
    def _holding(self) -> bool:
        """Whether the hinges were told to hold, and can be told more."""
        return self._motion.holding and not self._link.lost

    @property
    def _following(self) -> bool:
        """Whether the hinges follow goals."""
        return self._holding and not self._link.braked

    def _fire(self, event: Event, target: State | None = None) -> None:
        self._machine.fire(event, self._clock.now(), target)

    def _require_rest(self, command: Event) -> None:
        self._machine.require(command)
        if not self._at_rest:
            raise IllegalCommand(self.state, command, "still slowing down")

    def _trip(self, fault: Fault | None) -> None:
        """Latch a fault; the first one stays."""
        if fault is None or self.state is State.FAULT:
            return
        log.error("%s", fault)
        self._fault = fault
        self._fire(Event.FAULT)
        if self._link.bus.delay_s > 0.0:
            now = self._clock.now()
            self._tracking.cut(now, self._link.brake(now))

    def _begin(self, command: Event, direction: float, stages: tuple[StageName, ...]) -> None:
        """Start a command from the measured place; every hinge has to say where it is, and be fit."""
        self._machine.require(command)
        now = self._clock.now()
        readings = self._link.fresh_readings(self._attempts)
        unfit = self._monitor.judge_health(self._link.fresh_health(self._attempts), True, now)
        if unfit is not None:
            raise StartRefused(f"{unfit.thing}: {unfit.detail}", remedy=unfit.remedy)
        folds = self._localiser.folds(readings.position_rad)
        place = locate(readings.position_rad, folds, self._tracking.allowed(folds), self._table, self._rig)
        self._motion.go(place, direction)
        self._monitor.restart()
        self._monitor.seed(folds)
        self._command, self._stages, self._stage = command, stages, stages[0]
        self._start_stage_clock(now)
        self._since = (now, self._cycles, self._pacer.overruns, self._monitor.lost_replies)
        self._fire(command)

    def _next_stage(self, event: Event, now: float) -> None:
        following = self._stages[self._stages.index(self._stage) + 1 :] if self._stage else ()
        self._stage = following[0] if following else None
        self._start_stage_clock(now)
        self._fire(event)

    def _start_stage_clock(self, now: float) -> None:
        self._work = None
        self._stage_started = now

    def _interrupt(self, reason: str) -> None:
        """Latch a fault and come to rest along the path, as far as the bus still lets us."""
        fault = Fault(FaultKind.INTERRUPTED, "controller", reason, "clear the fault", self._clock.now())
        if self.state in IN_MOTION:
            self._trip(fault)
        why = "not at rest after twice the time of the ramp"
        patience_s = 2.0 / self._motion.slew_per_s + self._link.bus.delay_s
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
