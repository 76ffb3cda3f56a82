"""Every backend, set up alike: four hinges half-way open, a magnet per latch point, a lock pin on the stack."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ori_deploy.actuators.bus import ActuatorBus, HingeReadings
from ori_deploy.actuators.dynamixel.bus import DynamixelBus
from ori_deploy.actuators.mcu.bus import McuBus
from ori_deploy.actuators.mcu.configure import write_config
from ori_deploy.actuators.mcu.records import records
from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.bench.board import board as bench_board
from ori_deploy.clock import Clock, MonotonicClock, VirtualClock
from sim_backends.dynamixel.from_rig import spec_from_rig
from sim_backends.dynamixel_bus import VirtualBus
from sim_backends.microcontroller.build import Port
from sim_backends.microcontroller.from_rig import world_from_rig
from sim_backends.microcontroller.launcher import Microcontroller, Wire
from sim_backends.mock import MockBus
from tests.deploy.synthetic import synthetic_plan, synthetic_rig
from tests.sim_backends.microcontroller.bench import need

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
    senses_current: bool = True
    effort: Callable[[], list[float]] | None = None
    """Part of its strength that every hinge may truly use; None where nothing can limit it."""

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
    faults = bus.drop_replies, bus.corrupt_replies, bus.mute, bus.overload, bus.unplug, bus.replug
    yield Subject(bus, clock, *faults, effort=lambda: list(bus.true_effort))


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
                effort=lambda: [virtual.register(i, "goal_pwm") / 885 for i in ids.values()],
            )
        finally:
            bus.close()


@dataclass
class BoardSubject(Subject):
    """A microcontroller: it brakes when it hears nothing, so whoever waits goes on asking it, as a loop does."""

    def wait(self, duration_s: float) -> None:
        end = self.clock.now() + duration_s
        while self.clock.now() < end:
            if self.bus.connected:
                self.bus.read_hinges()
            self.clock.sleep_until(min(end, self.clock.now() + 0.02))


class WireFaults:
    """Feedback wires that are broken, or shorted, for as many readings as were ordered."""

    SEEN_S = 0.05
    """By then the device has converted every input anew."""

    def __init__(self, board: Microcontroller, bus: McuBus) -> None:
        self._board, self._bus = board, bus
        self._left: dict[int, int] = {}
        self._read = bus._read_hinges
        bus._read_hinges = self._counted  # type: ignore[method-assign]

    def order(self, hinge: int, kind: Wire, count: int) -> None:
        self._board.wire(hinge, kind)
        self._left[hinge] = count
        time.sleep(self.SEEN_S)

    def _counted(self) -> HingeReadings:
        try:
            return self._read()
        finally:
            done = [hinge for hinge, count in self._left.items() if count == 1]
            self._left = {hinge: count - 1 for hinge, count in self._left.items() if count > 1}
            for hinge in done:
                self._board.wire(hinge, "good")
            if done:
                time.sleep(self.SEEN_S)


BOARD_RIG = {
    "supply_divider": 3.0,
    "min_supply_v": 4.8,
    "silence_s": 0.5,
    "brake_s": 0.05,
    "lead_s": 0.75,
    "min_lead_s": 0.65,
    "reply_timeout_s": 0.2,
    "stall_s": 0.1,
    "each_hinge": {
        "pulse_zero_us": 1500.0,
        "pulse_us_per_rad": 300.0,
        "pulse_min_us": 500.0,
        "pulse_max_us": 2500.0,
        "feedback_zero_rad": -3.48,
        "feedback_rad_per_count": 0.0068,
        "feedback_low": 20,
        "feedback_high": 1010,
    },
    "each_latch": {"engaged_us": 2000.0, "released_us": 1000.0},
}
"""Servos of half a turn each way. Silence is long: the machine that runs the tests has other things to do as well."""


@contextmanager
def mcu(folder: Path, *, port: Port) -> Iterator[Subject]:
    """The firmware on a simulated board, in a process of its own."""
    need(port)
    plan = synthetic_plan(N)
    actuator = {"max_velocity_rad_s": 4.0, "max_torque_nm": 0.5, "min_position_rad": -3.1, "max_position_rad": 3.1}
    each_cell = {"zero_rad": 2.6, "gear_ratio": 4.0, "actuator": {**actuator, "max_acceleration_rad_s2": 60.0}}
    link = folder / "ttyMCU"
    settings = {"port": str(link), **BOARD_RIG}
    rig = synthetic_rig(plan, backend="mcu", rate_hz=20.0, each_cell=each_cell, latch=[PIN], mcu=settings)
    assert rig.mcu is not None
    angles = plan.crease_angles_rad
    world = world_from_rig(rig, angles[0], angles[-1], start_rad=angles[len(angles) // 2])
    with Microcontroller(world, link, port=port) as board:
        board.wait_ready()
        clock = MonotonicClock()
        configure(link, clock, rig.mcu)
        bus = McuBus(rig.mcu, clock, rig.rate_hz)
        wires = WireFaults(board, bus)
        index = {name: k for k, name in enumerate(bus.hinge_ids)}

        def overload(name: str) -> None:
            board.jam(index[name])
            board.push(index[name], 0.5)
            time.sleep(0.5)
            board.jam(index[name], False)

        try:
            yield BoardSubject(
                bus,
                clock,
                lambda name, count: wires.order(index[name], "open", count),
                lambda name, count: wires.order(index[name], "short", count),
                lambda name: wires.order(index[name], "open", 0),
                overload,
                board.unplug,
                board.replug,
                senses_current=False,
            )
        finally:
            bus.close()


def configure(link: Path, clock: Clock, wiring: McuWiring) -> None:
    """Write a rig's configuration into a device."""
    with bench_board(str(link), wiring.settings.baud, clock) as found:
        write_config(found.line, records(wiring))


BACKENDS: Mapping[str, Factory] = {
    "mock": mock,
    "dynamixel-fast": partial(
        dynamixel, model="XM430-W350", firmware=48, pin_model="XL330-M288", baud=4_000_000, timing=False
    ),
    "dynamixel-plain": partial(
        dynamixel, model="XL430-W250", firmware=41, pin_model="XL430-W250", baud=1_000_000, timing=True
    ),
    "mcu-host": partial(mcu, port="host"),
    "mcu-atmega2560": partial(mcu, port="atmega2560"),
}

SLOW = frozenset({"dynamixel-plain", "mcu-atmega2560"})
"""Backends whose turn comes with the slow tests."""
