"""One cycle of the controller: read, judge, advance, command, report."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import ActuatorBus, HealthReadings, HingeReadings
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import Clock
from ori_deploy.deploy.checks import Checks
from ori_deploy.deploy.errand import Errand
from ori_deploy.deploy.fit import check_fit
from ori_deploy.deploy.going_on import with_next_step
from ori_deploy.deploy.journal import Entry, Journal
from ori_deploy.deploy.latching import Latches
from ori_deploy.deploy.link import Link
from ori_deploy.deploy.localise import Localiser
from ori_deploy.deploy.monitor import Monitor
from ori_deploy.deploy.motion import Motion
from ori_deploy.deploy.observers import Observer, Observers
from ori_deploy.deploy.pacer import Pacer
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.result import ENDED, CycleRecord, Fault, FaultKind, MotionResult, outcome
from ori_deploy.deploy.seating import Seating
from ori_deploy.deploy.stage_work import StageWork
from ori_deploy.deploy.states import Action, Event, Guard, IllegalCommand, Machine, State
from ori_deploy.deploy.stopping import stop_ramp
from ori_deploy.deploy.tracking import Tracking
from ori_deploy.deploy.way import Way
from ori_deploy.motion.plan import Plan

FloatArray = NDArray[np.float64]

log = logging.getLogger(__name__)

JOURNAL_PATIENCE_S = 3.0
"""How long the structure waits, at rest, for the disk to have what is about to be done."""


class Cycle:
    """Does what the present state asks for, once per period of the rig; commands come from `Controller`.

    Parameters are those of `Controller`.
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
        self._seating = Seating(plan, self._table, rig, self._link, self._monitor)
        self._machine = Machine()
        self._fault: Fault | None = None
        self._observers = Observers(observers)
        self._journal = journal
        self._journal_since: float | None = None  # when the entry was posted that is not known to be on the disk

        self._errand = Errand()
        self._stage_work = StageWork(self._errand, rig, self._link, self._monitor, self._trip)
        self._checks = Checks(
            self._link, self._monitor, self._settings, self._pacer.period_s, self._trip, self._pause
        )
        self._speed = 1.0
        self._way: Way | None = None  # that is being followed, when cells are brought into step
        self._stop_ramp = self._motion.gentle
        self._cycles = 0
        self._was_under_way = False  # at the end of the last cycle
        self._guards: dict[Guard, Callable[[Event], str | None]] = {}
        self._actions: dict[Action, Callable[[Event], State | None]] = {Action.NEXT_STAGE: self._next_stage}

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
    def concern(self) -> Fault | None:
        """What the motion is paused for, and becomes a fault if it lasts: heat, or a low supply."""
        return self._checks.concern

    @property
    def under_way(self) -> bool:
        """Whether `step` still has something to bring to its end."""
        active = self.state in (State.MOVING, State.LATCHING, State.STOPPING)
        waits = self.state is State.HOLD and self.concern is not None
        return active or waits or not self._at_rest

    def add_observer(self, observer: Observer) -> None:
        """Call `observer` with the record of every cycle from now on."""
        self._observers.add(observer)

    def result(self) -> MotionResult:
        """How the last command ended. Raises `IllegalCommand` when there was none or it has not ended."""
        command, since, monitor = self._errand.command, self._errand.since, self._monitor
        if command is None or self.under_way or self.state not in ENDED:
            raise IllegalCommand(self.state, "result", "no command has ended")
        return MotionResult(
            command=str(command),
            outcome=outcome(self.state, self._fault, done=self._errand.stage is None),
            state=self.state,
            fault=self._fault,
            duration_s=self._clock.now() - since.time_s,
            cycles=self._cycles - since.cycles,
            overruns=self._pacer.overruns - since.overruns,
            lost_replies=monitor.lost_replies - since.lost_replies,
            worst_tracking_rad=monitor.worst_tracking_rad,
            worst_tracking_hinge=monitor.worst_tracking_hinge,
            observer_errors=tuple(self._observers.errors),
        )

    # -- one cycle -----------------------------------------------------------------------------------

    def step(self) -> CycleRecord:
        """Wait for the cycle's time and do it: read, judge, advance, command, report."""
        if self.state is State.DISCONNECTED:
            raise IllegalCommand(self.state, "step")
        deadline = self._pacer.wait(self._was_under_way)
        now = self._clock.now()
        self._judge_lateness(now)
        readings = self._link.read_hinges(now)
        folds = self._localiser.folds(readings.position_rad)
        self._judge(readings, folds, now)
        hurry = not (readings.valid.all() or self._motion.at_rest)
        health = self._checks.health_if_due(bool(readings.alert.any()), self._holding, hurry, now)
        latches = self._checks.latches_if_due(self.state, not self._errand.recovering, now)
        self._send(now)
        health = self._finish_stage(readings, health, latches, now)
        self._seating.limit(self.state, self._errand.stage, self._motion.place(), self._fault, now)
        record = self._record(now, deadline, readings, folds, health, latches)
        self._cycles += 1
        self._was_under_way = self.under_way
        self._observers.notify(record)
        return record

    def _judge_lateness(self, now: float) -> None:
        late, allowed = self._pacer.late_in_a_row, self._settings.overruns_allowed
        if late > allowed:
            self._trip(
                Fault(
                    FaultKind.OVERRUN,
                    "control loop",
                    f"late {late} cycles in a row, by a whole one or more; limit: overruns_allowed = {allowed}",
                    "see what else loads the computer, or lower rate_hz and plan again",
                    now,
                )
            )

    def _judge(self, readings: HingeReadings, folds: FloatArray, now: float) -> None:
        self._trip(self._monitor.judge_replies(readings, folds, self._clock.now()))
        if self._following:
            self._seating.watch(readings, self._tracking.due(now), self.state, self._errand.stage)
            self._tracking.judge(readings, self.state, now, self._trip)

    def _send(self, now: float) -> None:
        """Command the next place; at rest the same one again, so that no watchdog trips."""
        if self._link.lost or self._link.braked:
            self._motion.halt()
            return
        if self._pacer.sent():
            self._motion.halt()  # the servos stand at the last goal: from there, and gently
        elif self._fault is not None:
            self._motion.advance(0.0, self._stop_ramp)
        else:
            going = self.state is State.MOVING and self._written()
            self._motion.advance(min(self._speed, self._tracking.rate_limit) if going else 0.0)
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
            self._note(State.ARMED)
        elif self.state is State.MOVING and self._errand.recovering:
            if not self._motion.followed:
                self._errand.started_s = now  # settling begins when the way ends
            elif self._stage_work.settled(readings, self._motion.goal, now):
                self._do(Event.RECOVERED)
        elif self.state is State.MOVING and self._motion.arrived:
            self._do(Event.ARRIVED)
        elif (
            self.state is State.LATCHING
            and latches is not None
            and self._written()
            and self._stage_work.done(readings, latches, self._motion.goal, now)
        ):
            return self._secure(health, latches, now)
        return health

    def _secure(self, health: HealthReadings | None, latches: Latches, now: float) -> HealthReadings | None:
        """Go on from the latches; nothing is called deployed or stowed before a look at everything."""
        ending = self._errand.ending
        if ending is not Event.RELEASED:
            self._trip(self._monitor.judge_impossible_latches(latches, now))
            health = self._checks.health(self._holding, now) if health is None else health
            if health is None or not health.sound.all():
                return health  # in the next cycle; silence ends in a fault
        if self.state is State.LATCHING:
            self._do(ending)
        return health

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
            stage=self._errand.stage,
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

    def _do(self, event: Event) -> None:
        """What the table says of an event: guard, action, new state."""
        rule = self._machine.require(event)
        because = None if rule.guard is None else self._guards[rule.guard](event)
        if because is not None:
            raise IllegalCommand(self.state, event, because)
        try:
            target = None if rule.action is None else self._actions[rule.action](event)
        finally:
            if rule.action is Action.CLOSE_BUS:  # whatever it raised, the bus is let go of
                self._fire(event)
        if rule.action is not Action.CLOSE_BUS and self.state is rule.source:  # the action may have tripped
            self._fire(event, target)

    def _fire(self, event: Event, target: State | None = None) -> None:
        self._machine.fire(event, self._clock.now(), target)

    def _trip(self, fault: Fault | None) -> None:
        """Latch a fault; the first one stays."""
        if fault is None or self.state is State.FAULT:
            return
        self._latch(self._seating.named(fault))
        self._fire(Event.FAULT)

    def _pause(self) -> None:
        """Rest along the path until what is wrong has passed, and somebody says to go on."""
        if self.state in (State.MOVING, State.LATCHING):
            self._fire(Event.CONCERN)

    def _latch(self, fault: Fault) -> None:
        fault = with_next_step(fault, self._rig)
        log.error("%s", fault)
        self._fault, self._checks.concern = fault, None
        self._stop_ramp = stop_ramp(fault.kind, self._pacer.period_s)
        if self._link.bus.delay_s > 0.0:
            now = self._clock.now()
            self._tracking.cut(now, self._link.brake())

    def _next_stage(self, event: Event) -> None:
        self._errand.next_stage(self._clock.now())
        ended = {
            Event.DEPLOYMENT_SECURED: State.DEPLOYED,
            Event.STOWAGE_SECURED: State.STOWED,
            Event.RECOVERED: State.ARMED,
        }
        self._note(ended.get(event, self._errand.state))

    # -- the journal ---------------------------------------------------------------------------------

    def _note(self, state: State) -> None:
        """Leave word of what is about to be done; nothing is, before that is on the disk."""
        if self._journal is None:
            return
        begin, end = self._range(state)
        entry = Entry(
            command=str(self._errand.command or ""),
            stage="" if state is State.ARMED else self._errand.stage or "",
            state=str(state),
            from_fold=begin,
            to_fold=end,
            design_sha256=self._plan.design_sha256,
            rig_sha256=self._rig.sha256,
        )
        self._journal.post(entry)
        self._journal_since = self._clock.now()

    def _range(self, state: State) -> tuple[float, float]:
        """Folds between which the cells will be while the entry stands."""
        motion = self._motion
        if motion.placed and state is State.ARMED:
            return motion.fold, motion.fold
        if motion.placed:
            # What turns round goes on a little before it comes back; before the path there is no rate on it.
            rate = motion.rate if motion.on_path else 0.0
            return self._errand.folds(self._table.fold_at(motion.path_time_s + rate * motion.gentle.longest_s))
        follows = self._way is not None and state is not State.ARMED
        folds = self._way.corners if follows and self._way is not None else self._monitor.folds
        return float(folds.min()), float(folds.max())

    def _written(self) -> bool:
        """Whether the journal has it; a disk that fails is told, and does not strand the structure half-way."""
        if self._journal is None or self._journal_since is None:
            return True
        if self._journal.settled():
            failure = self._journal.failure
        elif self._clock.now() - self._journal_since <= JOURNAL_PATIENCE_S:
            return False
        else:
            failure = f"no answer from the disk for {JOURNAL_PATIENCE_S:g} s"
        self._journal_since = None
        if failure is not None:
            self._observers.note(f"journal: {failure}")
        return True
