"""When cycles run: at a fixed rate, and after a delay at that rate again, never two at once."""

from __future__ import annotations

import numpy as np

from ori_deploy.clock import Clock

GAP_PERIODS = 3.0
"""Periods without a command after which the servos have come to rest and the motion starts from rest."""


class Pacer:
    """Deadlines of the cycles.

    Parameters
    ----------
    clock
        Where time comes from.
    rate_hz
        Of the cycles.
    queued_s
        For so long the servos go on without a command.

    Attributes
    ----------
    period_s
        Time between two cycles.
    overruns
        Deadlines that passed while a motion was under way.
    late_in_a_row
        Cycles without one in time between them.
    """

    def __init__(self, clock: Clock, rate_hz: float, queued_s: float = 0.0) -> None:
        self._clock = clock
        self.period_s = 1.0 / rate_hz
        self.overruns = self.late_in_a_row = 0
        self._patience_s = max((GAP_PERIODS + 0.01) * self.period_s, queued_s)
        self._deadline = -np.inf
        self._sent = -np.inf

    def wait(self, under_way: bool) -> float:
        """Sleep to the deadline, set the next one, and return the one that was kept or missed."""
        now = self._clock.now()
        missed = start = self._deadline
        if now > self._deadline and not under_way:
            missed = start = now  # nobody was waiting for the cycles in between
            self.late_in_a_row = 0
        elif now > self._deadline:
            self.overruns += 1 + int((now - self._deadline) / self.period_s)
            self.late_in_a_row += 1
            # The late cycle's command may have gone out just now: the next one a whole period after it.
            start = max(now, self._sent + self.period_s)
        else:
            self.late_in_a_row = 0
        self._clock.sleep_until(start)
        self._deadline = start + self.period_s
        return missed

    def sent(self) -> bool:
        """Note that a command goes out now; True when none has for so long that the servos stand."""
        now = self._clock.now()
        gap = now - self._sent > self._patience_s
        self._sent = now
        return gap
