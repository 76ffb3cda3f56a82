"""Hours of deploying and stowing with random faults in simulated time: memory stays flat, the log can be read."""

from __future__ import annotations

import gc
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ori_deploy.actuators.bus import BusError
from ori_deploy.cli.flight import versions
from ori_deploy.deploy.result import StartRefused
from ori_deploy.deploy.states import Event, IllegalCommand, State
from ori_deploy.telemetry.frames import plan_info
from ori_deploy.telemetry.read import read_run
from ori_deploy.telemetry.recorder import Recorder
from tests.campaign.faults import CAUSES
from tests.campaign.grounds import STOWED, Ground, mock
from tests.campaign.trial import recover

WARM_UP = 0.2
"""Part of the time after which memory is first looked at: caches are full by then."""

LEAK_BYTES = 2_000_000
"""Growth after that which is none: fragments of the allocator."""

FAULT_EVERY = 2
"""Commands per fault, on average."""


@dataclass
class Soak:
    """What came of it."""

    simulated_s: float = 0.0
    commands: int = 0
    succeeded: int = 0
    recovered: int = 0
    faults: dict[str, int] = field(default_factory=dict)
    refused: int = 0
    grown_bytes: int = 0
    log_cycles: int = 0
    violations: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        faults = ", ".join(f"{name} {count}" for name, count in sorted(self.faults.items()))
        return (
            f"soak: {self.simulated_s:.0f} s simulated, {self.commands} commands, {self.succeeded} succeeded, "
            f"{self.refused} refused, {self.recovered} brought into step; "
            f"faults: {faults or 'none'}; memory grew by {self.grown_bytes / 1e6:.2f} MB; "
            f"{self.log_cycles} cycles in the log; violations: {self.violations or 'none'}"
        )


def soak(duration_s: float, seed: int, log: Path | None = None) -> Soak:
    """Deploy and stow for so long, on the mock, with a fault in every other command."""
    told, generator = Soak(), np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = log or Path(folder) / "soak.mcap"
        with mock(Path(folder), STOWED, seed) as ground, _recorder(ground, path) as recorder:
            ground.controller.add_observer(recorder)
            begun, base = ground.watch.now(), None
            while ground.watch.now() - begun < duration_s:
                _one_command(told, ground, generator)
                ground.records.clear()  # the log has them
                if base is None and ground.watch.now() - begun > WARM_UP * duration_s:
                    base = _memory()
            told.simulated_s = ground.watch.now() - begun
            told.grown_bytes = _memory() - (base or 0)
        run = read_run(path)
        told.log_cycles = len(run.time_s)
        if not run.complete:
            told.violations.append("the log is not complete")
    if told.grown_bytes > LEAK_BYTES:
        told.violations.append(f"memory grew by {told.grown_bytes} bytes; limit: {LEAK_BYTES}")
    if told.succeeded == 0 or not told.faults:
        told.violations.append("nothing succeeded, or nothing failed: it tried too little")
    return told


def _recorder(ground: Ground, path: Path) -> Recorder:
    info = plan_info(ground.plan, ground.rig, plan_sha256="")
    return Recorder(path, info, ground.watch, versions=versions(ground.watch), files={}, waits=True)


def _memory() -> int:
    """Bytes that this process has in use."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096


def _one_command(told: Soak, ground: Ground, generator: np.random.Generator) -> None:
    controller = ground.controller
    _bring_to_work(ground)
    told.commands += 1
    try:
        if controller.state is State.DEPLOYED or (controller.state is State.ARMED and generator.random() < 0.5):
            controller.stow()
        else:
            controller.deploy()
    except (StartRefused, BusError, IllegalCommand):
        told.refused += 1
        if generator.random() < 0.5 or not _recovers(ground):
            _push_into_step(ground)
            return
    spoil_after = int(generator.integers(1, 250)) if generator.integers(FAULT_EVERY) == 0 else -1
    cause = CAUSES[int(generator.integers(len(CAUSES)))].name
    for k in range(4000):
        if not controller.under_way:
            break
        if k == spoil_after and cause in ground.faults:
            ground.faults[cause](int(generator.integers(ground.n)))
        if k == spoil_after and cause == "emergency stop":
            controller.emergency_stop("the soak")
        controller.step()
    else:
        told.violations.append(f"a command does not end: {controller.state}")
    if controller.fault is not None:
        kind = str(controller.fault.kind)
        told.faults[kind] = told.faults.get(kind, 0) + 1
    elif controller.state is State.ARMED and controller.result().command == Event.RECOVER:
        told.recovered += controller.result().succeeded
    elif controller.state in (State.DEPLOYED, State.STOWED):
        told.succeeded += 1
        if controller.state is State.DEPLOYED and not all(ground.closed(latch) for latch in ground.latches):
            told.violations.append("deployed with an open latch")


def _bring_to_work(ground: Ground) -> None:
    """Heal, clear, connect, arm: until it can be commanded again."""
    controller = ground.controller
    ground.heal()
    for _ in range(20):
        try:
            if controller.state is State.FAULT:
                controller.clear_fault()
            elif controller.state is State.DISCONNECTED:
                controller.connect()
            elif controller.state is State.READY:
                controller.arm()
            elif controller.state is State.HOLD:
                controller.stop()
            else:
                return
            for _ in range(5):
                if controller.state is not State.DISCONNECTED:
                    controller.step()
        except (BusError, IllegalCommand):
            if controller.state is not State.DISCONNECTED:
                controller.step()
            ground.watch.sleep_until(ground.watch.now() + 1.0)


def _recovers(ground: Ground) -> bool:
    """Command a way back into step, with whatever is to go wrong on it."""
    try:
        recover(ground)
    except (StartRefused, BusError, IllegalCommand):
        return False
    return True


def _push_into_step(ground: Ground) -> None:
    """What is off its path is put back by hand, as the refusal says; torque off first."""
    controller = ground.controller
    if controller.state in (State.ARMED, State.DEPLOYED, State.STOWED):
        controller.disarm()
    goal = ground.rig.to_actuator(ground.plan.crease_angles_rad[0])
    for k, away in enumerate(goal - ground.shafts()):
        ground.push(k, float(away))
