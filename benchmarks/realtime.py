"""How late the control loop is, beside a plain loop: `python -m benchmarks.realtime` from the repository's root.

The controller deploys on a bus that answers at once, in a process of its own, at 200 and 500 Hz, with the machine
idle and with a busy process per processor. Beside it runs what everybody writes first: `time.sleep` of what is left
of the period. Lateness is that of the cycle's begin against its absolute deadline.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

import numpy as np

from benchmarks.control import NullBus, example_plan, example_rig
from ori_deploy import realtime
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import MonotonicClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import CycleRecord

RATES_HZ = (200.0, 500.0)
SECONDS = 6.0


def _controller(rate_hz: float, privileged: bool) -> tuple[np.ndarray, int, str]:
    """Lateness of every cycle, s; missed periods; what the system granted."""
    from dataclasses import replace

    plan = example_plan(duration_s=SECONDS, rate_hz=rate_hz)
    rig: ResolvedRig = replace(example_rig(plan), rate_hz=rate_hz)
    clock = MonotonicClock()
    bus = NullBus(rig, clock, rig.to_actuator(plan.crease_angles_rad[0]))  # type: ignore[arg-type]
    late: list[float] = []

    def note(record: CycleRecord) -> None:
        late.append(record.time_s - record.deadline_s)

    controller = Controller(plan, rig, bus, clock, [note])
    granted = realtime.ask() if privileged else realtime.ORDINARY
    controller.connect()
    controller.arm()
    controller.deploy()
    result = controller.run()
    return np.array(late[1:]), result.overruns, str(granted)


def _plain(rate_hz: float) -> tuple[np.ndarray, int, str]:
    """The same number of cycles with `time.sleep`, each a period after the end of the one before."""
    period, late, missed = 1.0 / rate_hz, [], 0
    begun = time.monotonic()
    deadline = begun
    for _ in range(int(SECONDS * rate_hz)):
        work_until = time.monotonic() + 150e-6  # about what a cycle of the controller takes
        while time.monotonic() < work_until:
            pass
        deadline += period
        time.sleep(max(0.0, deadline - time.monotonic()))
        late.append(time.monotonic() - deadline)
        if late[-1] > period:
            missed += int(late[-1] / period)
            deadline = time.monotonic()
    return np.array(late), missed, "time.sleep"


def _child(end: Connection, kind: str, rate_hz: float) -> None:
    if kind == "plain":
        end.send(_plain(rate_hz))
    else:
        end.send(_controller(rate_hz, kind == "real-time"))


@contextmanager
def _busy(count: int) -> Iterator[None]:
    workers = [multiprocessing.Process(target=_spin, daemon=True) for _ in range(count)]
    for worker in workers:
        worker.start()
    try:
        yield
    finally:
        for worker in workers:
            worker.kill()
            worker.join()


def _spin() -> None:
    while True:
        pass


def measure(kind: str, rate_hz: float, load: int) -> tuple[np.ndarray, int, str]:
    """One loop in a process of its own, with so many busy processes beside it."""
    mine, theirs = multiprocessing.Pipe()
    with _busy(load):
        time.sleep(0.3)
        process = multiprocessing.Process(target=_child, args=(theirs, kind, rate_hz))
        process.start()
        found: tuple[np.ndarray, int, str] = mine.recv()
        process.join()
    return found


def main() -> None:
    cores = os.cpu_count() or 1
    print(f"control loop, {SECONDS:g} s each; lateness in ms: median, p99, p99.9, worst; missed periods")
    for rate_hz in RATES_HZ:
        for load, words in ((0, "idle"), (cores, f"{cores} busy processes")):
            for kind in ("plain", "controller", "real-time"):
                late, missed, granted = measure(kind, rate_hz, load)
                p50, p99, p999 = 1e3 * np.quantile(late, (0.5, 0.99, 0.999))
                print(
                    f"  {rate_hz:3.0f} Hz, {words:16} {kind:10} {p50:7.3f} {p99:7.3f} {p999:7.3f} "
                    f"{1e3 * late.max():7.3f}  missed {missed:4d}  ({granted})"
                )


if __name__ == "__main__":
    main()
