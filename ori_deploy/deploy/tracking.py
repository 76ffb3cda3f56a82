"""What is measured against what is due: tracking errors, cells out of step, and how fast the motion may go on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ori_deploy.actuators.bus import ActuatorBus, HingeReadings
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.monitor import CRAWL, FloatArray, Monitor
from ori_deploy.deploy.motion import Motion
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.queued import Place, Queued
from ori_deploy.deploy.result import Fault
from ori_deploy.deploy.states import IN_MOTION, State
from ori_deploy.deploy.step_room import REACTION_CYCLES, StepRoom
from ori_deploy.deploy.stopping import ABORT
from ori_deploy.motion.plan import Plan

BRAKE_REACTION_S = 0.04
"""Where a device brakes by itself: its frame in which it is told, and the one before the pulses change."""

SOFT = 0.75
"""Part of the room for a fault's stop that a motion may use; at the whole of it, it is a fault."""

LATE = 0.5
"""Of a ramp's build-up: how far a rate that follows a falling limit is behind it."""

TURN_ROUND = 1.5
"""Of a ramp's build-up: what a slope that still points up costs before it points down."""


class Tracking:
    """Judges a motion against the goals that are due: the last ones, unless the bus queues them ahead.

    Attributes
    ----------
    rate_limit
        Largest path rate at which the motion may go on, 0 to 1.
    """

    def __init__(
        self, plan: Plan, table: PathTable, motion: Motion, rig: ResolvedRig, bus: ActuatorBus, monitor: Monitor
    ) -> None:
        self._motion, self._monitor = motion, monitor
        self._bus = bus
        self._queues = bus.delay_s > 0.0
        self._queued = Queued(self._queues)
        cycles_s = REACTION_CYCLES / rig.rate_hz
        stop, reaction_s = ABORT.slew_per_s, cycles_s + TURN_ROUND * ABORT.build_up_s
        if self._queues:
            stop, reaction_s = 1.0 / bus.brake_s, 1.0 / rig.rate_hz + BRAKE_REACTION_S
        slowing_s = cycles_s + LATE * motion.gentle.build_up_s
        self._room = StepRoom(plan.step_tolerance, table, motion.gentle.slew_per_s, slowing_s)
        self._stop_room = StepRoom(plan.step_tolerance, table, stop, reaction_s)
        self.rate_limit = 1.0

    def stand(self, goal: FloatArray, now: float) -> None:
        """Hold these positions from now on; NaN to hold none."""
        self._motion.stand(goal)
        self._queued.restart(self._motion.place(), now)

    def sent(self, now: float) -> None:
        """The motion's goal went out."""
        self._queued.note(self._motion.place(), self._bus.due_s(now))

    def cut(self, now: float, stop_s: float) -> None:
        """The bus brakes: nothing that is queued will be carried out."""
        self._queued.cut(now, stop_s)

    def at_rest(self, now: float) -> bool:
        """Whether no goal moves, and none that is still queued."""
        return self._motion.at_rest and self._queued.at_rest(now)

    def due(self, now: float) -> Place:
        """Where the motion should be now, once goals were sent or `stand` was called."""
        return self._queued.due(now)

    def allowed(self, folds: FloatArray) -> float:
        """Largest spread of cells that may be used where they are."""
        return self._room.allowed(folds)

    def judge(self, readings: HingeReadings, state: State, now: float, trip: Callable[[Fault | None], None]) -> None:
        """Judge one cycle's readings; every fault goes to `trip`."""
        due, cells = self._queued.due(now), self._monitor.folds
        trip(self._monitor.judge_tracking(readings, due.goal_rad, now))
        self.rate_limit = 1.0
        if state not in IN_MOTION or not self._motion.placed:  # cells on their way into step are out of it
            return
        limit, motion = 1.0, self._motion
        if state is State.MOVING and motion.on_path:
            self.rate_limit = self._next_rate(due, cells)
        if state is State.MOVING and due.on_path:
            limit = self._stop_room.rate_limit(cells, due.fold, due.path_time_s, motion.direction)
        # What can no longer be slowed down in time is stopped as a fault while that still is in time.
        least = max(CRAWL, abs(due.rate))
        trip(self._monitor.judge_step(due.fold, limit, self._room.allowed(cells), now, least))

    def _next_rate(self, due: Place, cells: FloatArray) -> float:
        """Largest rate for the next goal."""
        motion = self._motion
        # Cells will be as far behind the next goal as they are behind the one due now; first they are brought
        # onto the path.
        later = cells + (motion.fold - due.fold) if due.on_path else np.full_like(cells, motion.fold)
        where = (later, motion.fold, motion.path_time_s, motion.direction)
        slowing = self._room.rate_limit(*where, SOFT if self._queues else 1.0)
        return min(slowing, self._stop_room.rate_limit(*where, SOFT))
