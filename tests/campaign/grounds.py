"""The backends on which faults are injected, each with its own way of injecting them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import ActuatorBus
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import Clock, MonotonicClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import CycleRecord
from ori_deploy.motion.plan import Plan
from sim_backends.microcontroller.build import missing_tools
from tests.actuators.dynamixel.virtual import PIN as SERVO_PIN
from tests.actuators.dynamixel.virtual import servos
from tests.deploy.on_board import on_board
from tests.deploy.synthetic import bench, synthetic_plan

FloatArray = NDArray[np.float64]

DURATION_S = 2.0

LATCHES = [
    {"id": "pin", "secures": "slit:P-T2", "kind": "lock_pin", "travel_s": 0.3, "timeout_s": 1.0},
    {
        "id": "coil",
        "secures": "cell:c1",
        "kind": "electromagnet",
        "max_on_s": 60.0,
        "duty_cycle": 0.5,
        "timeout_s": 1.0,
    },
    {"id": "lock", "secures": "stow", "kind": "lock_pin", "travel_s": 0.3, "timeout_s": 1.0},
]


@dataclass
class Ground:
    """A structure, its controller, and what can be done to it.

    Attributes
    ----------
    faults
        Name of a fault, and what injects it into the hinge of a given number.
    heal
        Takes every injected fault away again.
    shafts
        (n_hinges,) where the shafts truly are.
    closed
        Whether a latch is truly closed; None where the simulation cannot tell.
    real_time
        Whether it is paced to the wall, so that what else the machine does shows in its times.
    """

    plan: Plan
    rig: ResolvedRig
    bus: ActuatorBus
    controller: Controller
    clock: Clock
    records: list[CycleRecord]
    faults: Mapping[str, Callable[[int], object]]
    heal: Callable[[], object]
    shafts: Callable[[], FloatArray]
    closed: Callable[[str], bool | None]
    real_time: bool
    latches: tuple[str, ...] = field(default=("pin", "coil"))

    @property
    def n(self) -> int:
        """Hinges."""
        return len(self.bus.hinge_ids)


def _blocked(ground_clock: Clock, rate_hz: float) -> None:
    """The computer does something else for longer than any queue or watchdog waits."""
    ground_clock.sleep_until(ground_clock.now() + 60.0 / rate_hz)


@contextmanager
def mock(folder: Path, start: str, seed: int) -> Iterator[Ground]:
    """The simulation in this process, on a virtual clock."""
    del folder
    b = bench(
        synthetic_plan(4, duration_s=DURATION_S, curvature=0.2),
        start=start,
        latch=LATCHES,
        mock={"seed": seed},
        controller={"settle_timeout_s": 0.5, "pause_patience_s": 0.5},
    )
    bus, names = b.bus, b.rig.hinge_ids

    def heal() -> None:
        for name in names:
            bus.unmute(name)
            bus.free(name)
            bus.overheat(name, 30.0)
        bus.sag(0.0)
        bus.replug()
        for latch in ("pin", "coil", "lock"):
            bus.latch_mend(latch)

    faults: dict[str, Callable[[int], object]] = {
        "one lost reply": lambda k: bus.drop_replies(names[k], 1),
        "one corrupt reply": lambda k: bus.corrupt_replies(names[k], 1),
        "silence": lambda k: bus.mute(names[k]),
        "garbage": lambda k: bus.corrupt_replies(names[k], 10),
        "unplugged": lambda _: bus.unplug(),
        "hardware error": lambda k: bus.overload(names[k]),
        "jam": lambda k: bus.jam(names[k]),
        "reboot": lambda k: bus.reboot(names[k]),
        "heat": lambda k: bus.overheat(names[k], 75.0),
        "low supply": lambda _: bus.sag(3.0),
        "stuck latch": lambda _: [bus.latch_stuck(latch) for latch in ("pin", "lock")],
        "blind latch": lambda _: [bus.latch_blind(latch) for latch in ("pin", "lock")],
        "late loop": lambda _: _blocked(b.clock, b.rig.rate_hz),
    }
    with b.controller:
        yield Ground(
            b.plan, b.rig, bus, b.controller, b.clock, b.records, faults, heal,
            lambda: bus.true_shaft_rad, bus.truly_closed, False,
        )  # fmt: skip


@contextmanager
def dynamixel(folder: Path, start: str, seed: int) -> Iterator[Ground]:
    """Virtual servos behind a pseudo-terminal."""
    controller = {"settle_timeout_s": 1.0, "pause_patience_s": 0.5, "max_reading_age_s": 0.2}
    pin = {**SERVO_PIN, "timeout_s": 1.0}
    with servos(
        folder,
        start_fold=0.0 if start == "stowed" else 1.0,
        rig={"controller": controller, "latch": [pin]},
        spec={"seed": seed},
    ) as setup:
        virtual, clock = setup.virtual, MonotonicClock()
        records: list[CycleRecord] = []
        servo = {k: k + 1 for k in range(3)}

        def heal() -> None:
            for k in servo.values():
                virtual.mute(k, on=False)
                virtual.jam(k, on=False)
                virtual.heat(k, 30.0)
            virtual.jam(20, on=False)
            virtual.sag(0.0)
            virtual.replug()
            time.sleep(0.4)  # a servo that restarts says nothing meanwhile

        faults: dict[str, Callable[[int], object]] = {
            "one lost reply": lambda k: virtual.drop(servo[k], 1),
            "one corrupt reply": lambda k: virtual.corrupt(servo[k], 1),
            "silence": lambda k: virtual.mute(servo[k]),
            "garbage": lambda k: virtual.corrupt(servo[k], 10),
            "unplugged": lambda _: virtual.unplug(),
            "hardware error": lambda k: virtual.overload(servo[k]),
            "jam": lambda k: virtual.jam(servo[k]),
            "reboot": lambda k: virtual.reboot(servo[k]),
            "heat": lambda k: virtual.heat(servo[k], 75.0),
            "low supply": lambda _: virtual.sag(3.0),
            "stuck latch": lambda _: virtual.jam(20),
            "late loop": lambda _: _blocked(clock, setup.rig.rate_hz),
        }
        with Controller(setup.plan, setup.rig, setup.bus, clock, [records.append]) as controlled:
            controlled.connect()
            if start == "deployed":
                virtual.push(20, 1.5)
            controlled.arm()
            yield Ground(
                setup.plan, setup.rig, setup.bus, controlled, clock, records, faults, heal,
                lambda: np.array([virtual.truth()[i].shaft_rad for i in servo.values()]),
                lambda name: abs(virtual.truth()[20].shaft_rad - 1.0) < 0.1 if name == "pin" else None,
                True, ("pin",),
            )  # fmt: skip


@contextmanager
def board(folder: Path, start: str, seed: int) -> Iterator[Ground]:
    """The firmware on the simulated board `port_host`."""
    with on_board(
        folder,
        start_fold=0.0 if start == "stowed" else 1.0,
        seed=seed,
        controller={"settle_timeout_s": 1.0, "pause_patience_s": 0.5, "lost_replies_allowed": 2},
    ) as setup:
        device, clock = setup.board, MonotonicClock()
        coil = setup.rig.latch_ids.index("coil")

        def heal() -> None:
            for k in range(4):
                device.jam(k, False)
                device.wire(k, "good")
            for way in ("to_device", "from_device"):
                device.cut(way, False)  # type: ignore[arg-type]
            device.supply(6.0)
            device.estop(False)
            for k in range(2):
                device.latch_stuck(k, False)
            device.replug()
            time.sleep(0.3)

        faults: dict[str, Callable[[int], object]] = {
            "silence": lambda k: device.open_wire(k),
            "garbage": lambda k: device.short_wire(k),
            "unplugged": lambda _: device.unplug(),
            "jam": lambda k: device.jam(k),
            "reboot": lambda _: device.reset("external"),
            "low supply": lambda _: device.supply(4.5),
            "stuck latch": lambda _: [device.latch_stuck(k) for k in range(2)],
            "late loop": lambda _: _blocked(clock, setup.rig.rate_hz),
            "board's emergency stop": lambda _: device.estop(True),
            "board hangs": lambda _: device.hang(),
        }
        setup.controller.connect()
        setup.controller.arm()
        yield Ground(
            setup.plan, setup.rig, setup.bus, setup.controller, clock, setup.records, faults, heal,
            setup.shafts, lambda name: device.truth().latches[coil].closed if name == "coil" else None,
            True, ("coil",),
        )  # fmt: skip


Factory = Callable[[Path, str, int], AbstractContextManager[Ground]]

GROUNDS: Mapping[str, Factory] = {"mock": mock, "dynamixel": dynamixel, "board": board}


def available() -> dict[str, str]:
    """Every backend, and why it cannot be had; empty where it can."""
    missing: tuple[Any, ...] = missing_tools("host")
    return {"mock": "", "dynamixel": "", "board": f"missing: {', '.join(missing)}" if missing else ""}
