"""The clock is a parameter: wall-paced on hardware, virtual in tests and in the demo.

Times are seconds on a monotonic scale whose zero means nothing. Wall-clock time is never read, so a
change of the system's date has no effect on a motion.
"""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """What the controller and the simulated devices know of time."""

    def now(self) -> float:
        """Seconds on a monotonic scale."""

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`, or at once when it has passed."""


class MonotonicClock:
    """Real time, for hardware and for `--realtime`."""

    def now(self) -> float:
        return time.monotonic()

    def sleep_until(self, deadline: float) -> None:
        remaining = deadline - time.monotonic()
        if remaining > 0.0:
            time.sleep(remaining)


class VirtualClock:
    """Time that passes only by sleeping: a deployment of a minute runs in a moment, repeatably."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        return self._now

    def sleep_until(self, deadline: float) -> None:
        self._now = max(self._now, deadline)
