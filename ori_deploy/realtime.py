"""What the operating system grants a loop that must not be late: a priority above all others, memory that stays."""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
from dataclasses import dataclass

PRIORITY = 50
"""Of SCHED_FIFO, 1 to 99: above what is ordinary, below the kernel's own threads for interrupts on most machines."""

_MCL_CURRENT, _MCL_FUTURE = 1, 2


@dataclass(frozen=True, slots=True)
class Granted:
    """What was asked of the operating system, and what it said.

    Attributes
    ----------
    fifo
        Whether the thread runs before every ordinary one.
    locked
        Whether its memory stays in RAM.
    refused
        Why not, in words; empty when both were granted.
    """

    fifo: bool
    locked: bool
    refused: tuple[str, ...] = ()

    def __str__(self) -> str:
        if self.fifo and self.locked:
            return "real-time priority, memory locked"
        return "no real-time guarantees: " + "; ".join(self.refused or ("not asked for",))


ORDINARY = Granted(fifo=False, locked=False)
"""Nothing was asked for."""


def ask(priority: int = PRIORITY) -> Granted:
    """Ask for SCHED_FIFO for the calling thread, not for what it starts, and for memory that is never paged out.

    Refusal is no error: the loop runs all the same, and says so.
    """
    refused = []
    fifo = locked = False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
        fifo = True
    except (AttributeError, OSError) as error:
        refused.append(f"SCHED_FIFO refused ({_why(error)}; rtprio in /etc/security/limits.d grants it)")
    lock = getattr(ctypes.CDLL(None, use_errno=True), "mlockall", None)
    if lock is None:
        reason = "not on this system"
    elif not _may_lock_all():  # beyond the limit every allocation fails: worse than memory that is paged out
        reason = "memlock is limited"
    else:
        locked = lock(_MCL_CURRENT | _MCL_FUTURE) == 0
        reason = os.strerror(ctypes.get_errno())
    if not locked:
        refused.append(f"mlockall refused ({reason}; memlock unlimited in /etc/security/limits.d grants it)")
    return Granted(fifo, locked, tuple(refused))


def _why(error: Exception) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else "not on this system"


def _may_lock_all() -> bool:
    """Whether memory that is locked may grow without end."""
    return os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY


def give_back() -> None:
    """An ordinary thread with ordinary memory again, as far as the system lets it go back."""
    with contextlib.suppress(AttributeError, OSError):  # without privileges, reset-on-fork cannot be taken back
        os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
    unlock = getattr(ctypes.CDLL(None), "munlockall", None)
    if unlock is not None:
        unlock()
