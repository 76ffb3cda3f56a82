"""What recording costs the control loop per cycle, 12 hinges: `python -m benchmarks.recording`.

In real time at the rig's 100 Hz, since that is what counts: with the recorder's process on another core, or on the
same one. The time is that of the observer, which packs and hands over, and of the tape under way.
"""

from __future__ import annotations

import gc
import platform
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.control import N_HINGES, NullBus, example_plan, example_rig
from ori_deploy.clock import MonotonicClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.telemetry.frames import plan_info
from ori_deploy.telemetry.read import read_recording, read_run
from ori_deploy.telemetry.recorder import Recorder
from ori_deploy.telemetry.taped import taped

TARGET_US = 200.0


def step_times_us(step: Callable[[], object], under_way: Callable[[], bool], slept: list[float]) -> np.ndarray:
    """Time of every cycle but for its sleep, in microseconds."""
    times = []
    while under_way():
        slept.clear()
        start = time.perf_counter()
        step()
        times.append(time.perf_counter() - start - sum(slept))
    return 1e6 * np.array(times)


class WatchedClock(MonotonicClock):
    """A clock that tells how long it slept."""

    def __init__(self) -> None:
        self.slept: list[float] = []

    def sleep_until(self, deadline: float) -> None:
        start = time.perf_counter()
        super().sleep_until(deadline)
        self.slept.append(time.perf_counter() - start)


def fly(log: Path | None) -> np.ndarray:
    """One deployment, recorded or not."""
    plan = example_plan()
    rig = example_rig(plan)
    clock = WatchedClock()
    bus = NullBus(rig, clock, rig.to_actuator(plan.crease_angles_rad[0]))  # type: ignore[arg-type]
    if log is None:
        controller = Controller(plan, rig, bus, clock)
    else:
        recorder = Recorder(log, plan_info(plan, rig), clock, versions=dict, files={}, waits=False)
        controller = taped(
            recorder, lambda bus, clock, journal: Controller(plan, rig, bus, clock, (recorder,), journal), bus, clock
        )
    controller.connect()
    controller.arm()
    controller.deploy()
    gc.collect()
    times = step_times_us(controller.step, lambda: controller.under_way, clock.slept)
    controller.close()
    if log is not None:
        recorder.close()
    return times


def main() -> None:
    print(f"recording, {N_HINGES} hinges, 100 Hz, {platform.machine()}, Python {platform.python_version()}")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        plain, recorded = fly(None), fly(log)
        run, size = read_run(log), log.stat().st_size
        tape = sum(len(piece) for piece in read_recording(log).tape)
    for name, times in (("not recorded", plain), ("recorded", recorded)):
        print(f"  {name:28s} median {np.median(times):6.1f} us, p99 {np.percentile(times, 99):6.1f} us")
    cost = 1e6 * run.timing["record_s"]
    print(f"  {'of it in the observer':28s} median {np.median(cost):6.1f} us, p99 {np.percentile(cost, 99):6.1f} us")
    cycles = len(run.time_s)
    print(f"  bytes per cycle: {size / cycles:.0f} in the log, {tape / cycles:.0f} of tape before compression")
    print(f"  recording / target of {TARGET_US:.0f} us: {(np.median(recorded) - np.median(plain)) / TARGET_US:.2f}")


if __name__ == "__main__":
    main()
