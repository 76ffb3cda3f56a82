"""Working the latches of a stage: settle, command, wait."""

from __future__ import annotations

from collections.abc import Callable

from ori_deploy.actuators.bus import HingeReadings
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.errand import Errand
from ori_deploy.deploy.latching import Latches, LatchWork
from ori_deploy.deploy.link import Link
from ori_deploy.deploy.monitor import Monitor
from ori_deploy.deploy.motion import FloatArray
from ori_deploy.deploy.result import Fault


class StageWork:
    """Does what a latching stage wants, one look at the readings at a time.

    Parameters
    ----------
    errand, rig, link, monitor
        What is carried out, with what, and who judges.
    trip
        Receives every fault, at once.
    """

    def __init__(
        self, errand: Errand, rig: ResolvedRig, link: Link, monitor: Monitor, trip: Callable[[Fault | None], None]
    ) -> None:
        self._errand, self._rig, self._link, self._monitor = errand, rig, link, monitor
        self._trip = trip

    def done(self, readings: HingeReadings, latches: Latches, goal_rad: FloatArray, now: float) -> bool:
        """Go on working; whether every latch of the stage is as it should be, and every crease in place.

        Parameters
        ----------
        readings, latches
            Of this cycle.
        goal_rad
            (n_hinges,) end of the path: latches close on creases that are measured there.
        now
            For patience that ends in a fault.
        """
        errand = self._errand
        settled = not errand.closing or self.settled(readings, goal_rad, now)
        if errand.work is None:
            if settled:
                here, others = errand.latches(self._rig)
                errand.work = LatchWork(here, errand.closing, now, others)
                self._link.command_latches(errand.work, now)
            return False
        if errand.work.pending(latches):
            self._trip(errand.work.judge(latches, now))
            return False
        return settled

    def settled(self, readings: HingeReadings, goal_rad: FloatArray, now: float) -> bool:
        """Whether every crease is measured where it was to go; a fault when it is not for too long."""
        if self._monitor.at_goal(readings, goal_rad):
            self._errand.started_s = now
            return True
        if now - self._errand.started_s > self._rig.controller.settle_timeout_s:
            self._trip(self._monitor.goal_fault(readings, goal_rad, now))
        return False
