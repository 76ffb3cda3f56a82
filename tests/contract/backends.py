"""Every backend, set up alike: four hinges half-way open, a magnet per latch point, a lock pin on the stack."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ori_deploy.actuators.bus import ActuatorBus
from ori_deploy.actuators.dynamixel.bus import DynamixelBus
from ori_deploy.clock import Clock, MonotonicClock, VirtualClock
from sim_backends.dynamixel.from_rig import spec_from_rig
from sim_backends.dynamixel_bus import VirtualBus
from sim_backends.mock import MockBus
from tests.deploy.synthetic import synthetic_plan, synthetic_rig

N = 4
STEP_RAD = 0.2


@dataclass
class Subject:
    """A backend under test, its structure half-way open, with one magnet per latch point and a stow pin."""

    bus: ActuatorBus
    clock: Clock
    drop: Callable[[str, int], None]
    corrupt: Callable[[str, int], None]
    mute: Callable[[str], None]
    overload: Callable[[str], None]
    unplug: Callable[[], None]
    replug: Callable[[], None]

    def wait(self, duration_s: float) -> None:
        self.clock.sleep_until(self.clock.now() + duration_s)

    def positions(self) -> np.ndarray:
        return self.bus.read_hinges().position_rad


Factory = Callable[[Path], AbstractContextManager[Subject]]
PIN = {"id": "pin", "secures": "stow", "kind": "lock_pin", "travel_s": 0.2}


@contextmanager
def mock(folder: Path) -> Iterator[Subject]:
    del folder
    plan = synthetic_plan(N)
    rig = synthetic_rig(plan, latch=[PIN])
    clock = VirtualClock()
    angles = plan.crease_angles_rad
    bus = MockBus.from_rig(rig, clock, angles[0], angles[-1], start_rad=angles[len(angles) // 2])
    yield Subject(bus, clock, bus.drop_replies, bus.corrupt_replies, bus.mute, bus.overload, bus.unplug, bus.replug)


@contextmanager
def dynamixel(
    folder: Path, *, model: str, firmware: int, pin_model: str, baud: int, timing: bool
) -> Iterator[Subject]:
    """Servos of one model on the virtual bus, in a process of its own.

    The watchdog is long: the suite looks away for a second at a time.
    """
    plan = synthetic_plan(N)
    actuator = {"max_velocity_rad_s": 4.0, "max_torque_nm": 0.5, "min_position_rad": -3.1, "max_position_rad": 3.1}
    each_cell = {"zero_rad": 2.6, "gear_ratio": 4.0, "actuator": {**actuator, "max_acceleration_rad_s2": 60.0}}
    pin_servo = {"latch": "pin", "id": 20, "model": pin_model, "engaged_rad": 1.0, "released_rad": -0.5}
    settings = {
        "port": str(folder / "ttyDXL"),
        "baud": baud,
        "model": model,
        "watchdog_s": 2.54,
        "magnets": "by_hinges",
        "servo": [pin_servo],
        "reply_slack_s": 0.05,
    }
    rig = synthetic_rig(plan, backend="dynamixel", rate_hz=50.0, each_cell=each_cell, latch=[PIN], dynamixel=settings)
    angles = plan.crease_angles_rad
    spec = spec_from_rig(rig, angles[0], angles[-1], start_rad=angles[len(angles) // 2])
    spec = replace(spec, wire_timing=timing, servos=tuple(replace(s, firmware=firmware) for s in spec.servos))
    with VirtualBus(spec, link=folder / "ttyDXL") as virtual:
        bus = DynamixelBus.from_rig(rig, MonotonicClock(), angles[0], angles[-1])
        ids = {servo.name: servo.id for servo in rig.wiring.hinges} if rig.wiring else {}
        try:
            yield Subject(
                bus,
                MonotonicClock(),
                lambda name, count: virtual.drop(ids[name], count),
                lambda name, count: virtual.corrupt(ids[name], count),
                lambda name: virtual.mute(ids[name]),
                lambda name: virtual.overload(ids[name]),
                virtual.unplug,
                virtual.replug,
            )
        finally:
            bus.close()


BACKENDS: Mapping[str, Factory] = {
    "mock": mock,
    "dynamixel-fast": partial(
        dynamixel, model="XM430-W350", firmware=48, pin_model="XL330-M288", baud=4_000_000, timing=False
    ),
    "dynamixel-plain": partial(
        dynamixel, model="XL430-W250", firmware=41, pin_model="XL430-W250", baud=1_000_000, timing=True
    ),
}

SLOW = frozenset({"dynamixel-plain"})
"""Backends whose turn comes with the slow tests."""
