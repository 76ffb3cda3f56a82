"""Simulated devices on a busy machine: real ones wait for no processor."""

from __future__ import annotations

import contextlib
import os

PRIORITY = 40


def wait_for_no_processor(pid: int) -> None:
    """Give a process that mostly sleeps real-time priority, where that is allowed."""
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(pid, os.SCHED_FIFO, os.sched_param(PRIORITY))
