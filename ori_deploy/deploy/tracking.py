"""What is measured against what is due: tracking errors, cells out of step, and how fast the motion may go on."""

from __future__ import annotations

from collections.abc import Callable

from ori_deploy.actuators.bus import ActuatorBus, HingeReadings
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.monitor import CRAWL, FloatArray, Monitor
from ori_deploy.deploy.motion import Motion
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.queued import Queued
from ori_deploy.deploy.result import Fault
from ori_deploy.deploy.states import IN_MOTION, State
from ori_deploy.deploy.step_room import SOFT, StepRoom
from ori_deploy.motion.plan import Plan


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
        self._queued = Queued(bus.delay_s)
        self._queues = bus.delay_s > 0.0
        self._room = StepRoom.of(plan.step_tolerance, table, motion, rig, bus)
        self.rate_limit = 1.0

    def stand(self, goal: FloatArray, now: float) -> None:
        """Hold these positions from now on; NaN to hold none."""
        self._motion.stand(goal)
        self._queued.restart(self._motion.place(), now)

    def sent(self, now: float) -> None:
        """The motion's goal went out."""
        self._queued.note(self._motion.place(), now)

    def cut(self, now: float, stop_s: float) -> None:
        """The bus brakes: nothing that is queued will be carried out."""
        self._queued.cut(now, stop_s)

    def at_rest(self, now: float) -> bool:
        """Whether no goal moves, and none that is still queued."""
        return self._motion.at_rest and self._queued.at_rest(now)

    def allowed(self, folds: FloatArray) -> float:
        """Largest spread of cells that may be used where they are."""
        return self._room.allowed(folds)

    def judge(self, readings: HingeReadings, state: State, now: float, trip: Callable[[Fault | None], None]) -> None:
        """Judge one cycle's readings; every fault goes to `trip`."""
        due, cells = self._queued.due(now), self._monitor.folds
        trip(self._monitor.judge_tracking(readings, due.goal_rad, now))
        self.rate_limit = 1.0
        if state not in IN_MOTION:
            return
        limit = 1.0
        if state is State.MOVING and due.on_path:
            where = (cells, due.fold, due.path_time_s, self._motion.direction)
            limit = self._room.rate_limit(*where)
            self.rate_limit = self._room.rate_limit(*where, SOFT) if self._queues else limit
        # What is queued can only be braked: it has to be slower than that allows.
        least = max(CRAWL, abs(due.rate)) if self._queues else CRAWL
        trip(self._monitor.judge_step(due.fold, limit, self._room.allowed(cells), now, least))
