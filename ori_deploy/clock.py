"""The clock is a parameter: wall-paced on hardware, virtual in tests and in the demo.

Times are seconds on a monotonic scale whose zero means nothing. Wall-clock time is never read, so a
change of the system's date has no effect on a motion.
"""

from __future__ import annotations

import ctypes
import errno
import os
import time
from collections.abc import Callable
from typing import Protocol


class Clock(Protocol):
    """What the controller and the simulated devices know of time."""

    def now(self) -> float:
        """Seconds on a monotonic scale."""

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`, or at once when it has passed."""


class MonotonicClock:
    """Real time, for hardware and for `--realtime`.

    It sleeps to a moment, not for a while: what comes between reading the clock and falling asleep delays
    nobody.
    """

    def now(self) -> float:
        return time.monotonic()

    def sleep_until(self, deadline: float) -> None:
        _sleep_until(deadline)


class _TimeSpec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


_TIMER_ABSTIME = 1


def _absolute_sleep() -> Callable[[float], None]:
    """`clock_nanosleep` of the C library with an absolute deadline; where there is none, `time.sleep`."""
    nanosleep = getattr(ctypes.CDLL(None, use_errno=True), "clock_nanosleep", None)

    def relative(deadline: float) -> None:
        remaining = deadline - time.monotonic()
        if remaining > 0.0:
            time.sleep(remaining)

    if nanosleep is None:
        return relative

    def absolute(deadline: float) -> None:
        """A signal's handler runs, and then it sleeps on."""
        whole = int(deadline)
        until = ctypes.byref(_TimeSpec(whole, int((deadline - whole) * 1e9)))
        while deadline > time.monotonic():
            failed = nanosleep(time.CLOCK_MONOTONIC, _TIMER_ABSTIME, until, None)
            if failed not in (0, errno.EINTR):
                raise OSError(failed, f"clock_nanosleep: {os.strerror(failed)}")

    return absolute


_sleep_until = _absolute_sleep()


class VirtualClock:
    """Time that passes only by sleeping: a deployment of a minute runs in a moment, repeatably."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        return self._now

    def sleep_until(self, deadline: float) -> None:
        self._now = max(self._now, deadline)
