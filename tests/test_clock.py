"""Sleeping to a moment, and what the operating system grants."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from ori_deploy import realtime
from ori_deploy.clock import MonotonicClock, VirtualClock


@pytest.mark.parametrize("ahead_s", [-1.0, 0.0, 0.001, 0.05])
def test_sleep_never_ends_before_the_deadline(ahead_s: float) -> None:
    clock = MonotonicClock()
    deadline = clock.now() + ahead_s
    clock.sleep_until(deadline)
    assert clock.now() >= deadline


def test_a_signal_is_handled_and_the_sleep_goes_on() -> None:
    clock, heard = MonotonicClock(), []
    before = signal.signal(signal.SIGUSR1, lambda *_: heard.append(clock.now()))
    timer = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGUSR1))
    try:
        deadline = clock.now() + 0.3
        timer.start()
        clock.sleep_until(deadline)
    finally:
        timer.join()
        signal.signal(signal.SIGUSR1, before)
    assert clock.now() >= deadline
    assert len(heard) == 1
    assert heard[0] < deadline


def test_a_change_of_the_date_has_no_effect() -> None:
    """Nothing that moves reads the date: it would find a clock that stands still."""
    words = "import time; time.time = None; from ori_deploy.clock import MonotonicClock as C; c = C(); "
    words += "c.sleep_until(c.now() + 0.01); print('slept')"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "slept\n"


def test_virtual_time_passes_by_sleeping_only() -> None:
    clock = VirtualClock(5.0)
    clock.sleep_until(7.0)
    clock.sleep_until(6.0)
    time.sleep(0.01)
    assert clock.now() == 7.0


CHILD = """
import os, threading
from ori_deploy import realtime
granted = realtime.ask()
seen = []
thread = threading.Thread(target=lambda: seen.append(os.sched_getscheduler(0)))
thread.start(); thread.join()
policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
locked = next(line for line in open("/proc/self/status") if line.startswith("VmLck")).split()[1]
print(granted.fifo, policy == os.SCHED_FIFO, seen[0] == os.SCHED_OTHER, granted.locked, int(locked) > 0)
print(granted)
realtime.give_back()
print(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER)
"""


def test_what_is_granted_is_so_and_stays_with_the_loop() -> None:
    done = subprocess.run([sys.executable, "-c", CHILD], capture_output=True, text=True, timeout=60, check=True)
    flags, words, back = done.stdout.splitlines()
    fifo, is_fifo, child_ordinary, locked, is_locked = (word == "True" for word in flags.split())
    assert fifo == is_fifo
    assert child_ordinary
    assert locked == is_locked
    assert ("refused" in words) == (not (fifo and locked))
    assert back == "True"


def test_a_refusal_is_told_and_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(realtime.ctypes, "CDLL", lambda *_, **__: object())
    granted = realtime.ask()
    assert (granted.fifo, granted.locked) == (False, False)
    assert "Operation not permitted" in str(granted)
    assert "limits.d" in str(granted)


NOBODY = """
import os
from ori_deploy import realtime
realtime.ask()
os.setuid(65534)
realtime.give_back()
print("went on")
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become nobody")
def test_giving_back_is_no_error_for_who_may_not() -> None:
    """Whoever was granted a priority by limits.d cannot take its reset-on-fork back."""
    done = subprocess.run([sys.executable, "-c", NOBODY], capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout == "went on\n", done.stderr


def test_memory_that_may_not_grow_is_not_locked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(realtime.resource, "getrlimit", lambda _: (8_000_000, 8_000_000))
    monkeypatch.setattr(os, "sched_setscheduler", lambda *_: None)
    granted = realtime.ask()
    assert granted.fifo
    assert not granted.locked
    assert "memlock is limited" in str(granted)
