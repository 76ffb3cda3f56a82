"""The slower readings: health and latches, when they are due, and what follows from them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ori_deploy.actuators.bus import HealthReadings
from ori_deploy.actuators.rig import ControllerSettings
from ori_deploy.deploy.latching import Latches
from ori_deploy.deploy.link import Link
from ori_deploy.deploy.monitor import Monitor
from ori_deploy.deploy.result import Fault
from ori_deploy.deploy.states import State
from ori_deploy.deploy.stopping import EMERGENCY_CYCLES, PAUSING


class Checks:
    """Reads health and latches as often as the rig says, and has them judged.

    Parameters
    ----------
    link, monitor, settings
        Where readings come from, who judges them, how often and how patiently.
    period_s
        Of the loop.
    trip
        Receives every fault, at once.
    pause
        Called when a motion has to rest for something that may pass.

    Attributes
    ----------
    concern
        What is paused for, and becomes a fault if it lasts: heat, or a low supply. None otherwise.
    """

    def __init__(
        self,
        link: Link,
        monitor: Monitor,
        settings: ControllerSettings,
        period_s: float,
        trip: Callable[[Fault | None], None],
        pause: Callable[[], None],
    ) -> None:
        self._link, self._monitor, self._settings = link, monitor, settings
        self._early_s = 0.5 * period_s
        # As long as it takes to notice that a hinge is silent, and to rest.
        self._put_off_s = (settings.lost_replies_allowed + 1 + EMERGENCY_CYCLES) * period_s
        self._trip, self._pause = trip, pause
        self._due = -np.inf
        self._hurry = False
        self.concern: Fault | None = None

    def health_if_due(self, alerted: bool, holding: bool, hurry: bool, now: float) -> HealthReadings | None:
        """Health when it is time, or when a hinge says that something is wrong; None otherwise.

        In a `hurry` what is due is put off a little, the latches as well: who did not answer when asked for a
        position lets this cycle wait once more with every further question, while the motion goes on.
        """
        self._hurry = hurry and now < self._due + self._put_off_s
        return self.health(holding, now) if alerted or (now >= self._due and not self._hurry) else None

    def health(self, holding: bool, now: float) -> HealthReadings | None:
        """Health now; None when the bus failed."""
        health = self._link.read_health(now)
        if health is not None:
            self._weigh(self._monitor.judge_health(health, holding, now), bool(health.sound.all()), now)
        return health

    def latches_if_due(self, state: State, in_step: bool, now: float) -> Latches | None:
        """Latches, every cycle while they are worked on and as often as the health otherwise.

        While cells are out of step, `in_step` false, any latch may say anything.
        """
        if now >= self._due and not self._hurry:
            self._due = now + self._settings.health_period_s - self._early_s
        elif state is not State.LATCHING:
            return None
        latches = self._link.read_latches(now)
        if latches is not None and in_step:
            self._trip(self._monitor.judge_latches(state, latches, now))
        return latches

    def _weigh(self, found: Fault | None, everybody_answered: bool, now: float) -> None:
        """Heat and a low supply pause a motion first, since they may pass; everything else is a fault.

        That one who does not answer has cooled is not known.
        """
        if found is None:
            self.concern = None if everybody_answered else self.concern
        elif found.kind not in PAUSING:
            self._trip(found)
        else:
            self.concern = self.concern or found
            self._pause()  # whatever began to move since it was found
            if now - self.concern.time_s > self._settings.pause_patience_s:
                self._trip(found)
