"""The backends on which faults are injected, each with its own way of injecting them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
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
from ori_deploy.motion.step_tolerance import StepTolerance
from sim_backends.microcontroller.build import missing_tools
from tests.actuators.dynamixel.virtual import PIN as SERVO_PIN
from tests.actuators.dynamixel.virtual import N as N_SERVOS
from tests.actuators.dynamixel.virtual import servos
from tests.campaign.watch import Watch
from tests.deploy.on_board import QUEUE, on_board
from tests.deploy.on_board import N as N_ON_BOARD
from tests.deploy.synthetic import NARROWING, bench, synthetic_plan

FloatArray = NDArray[np.float64]

DURATION_S = 2.0
SEATING_S = 6.0
"""A plan in which slits close takes its time there."""

WIDE = StepTolerance(np.array([0.6, 0.8, 0.9, 1.0]), np.array([0.5, 0.2, 0.1, 0.03]), 0.9, 1e-4)
"""As `NARROWING`, for sensors that do not see as finely as the mock's: slits close from fold 0.9 on."""

LAG_S = {"mock": 0.03, "dynamixel": 0.02, "board": 0.03}
"""Time constant with which simulated shafts follow their goals; the simulations' default."""

EARLY, UNEVEN = 0.96, (0.966, 0.974)
"""Folds at which something is in the way of a slit."""

REPLIES_S = 3.0 * (0.001 + 0.03 + 0.004)
"""What a silent servo costs a cycle of the virtual servos' rig: `usb_latency_s`, `reply_slack_s` and the wire's time,
for its position, its health and as a latch."""

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


@dataclass(frozen=True, slots=True)
class Start:
    """How the structure is found: stowed at fold 0, deployed at 1, else half-way with every latch open.

    Attributes
    ----------
    fold
        Of all cells.
    slits
        Whether the plan has slits that close at its end.
    """

    fold: float = 0.0
    slits: bool = False


STOWED, DEPLOYED = Start(0.0), Start(1.0)


@dataclass
class Ground:
    """A structure, its controller, and what can be done to it.

    Attributes
    ----------
    watch
        The controller's clock, which sees where the shafts truly are.
    faults
        Name of a fault, and what injects it into the hinge of a given number.
    heal
        Takes every injected fault away again.
    push
        Turns the shaft of a limp hinge by hand.
    closed
        Whether a latch is truly closed; None where the simulation cannot tell.
    lag_s
        Time constant with which shafts follow their goals.
    patience_s
        How much longer than its period a cycle may take in which somebody does not answer. That is the tests'
        patience with a machine that has other things to do, and no promise of the controller's.
    deaf_s
        For so long shafts go on when nobody tells them anything any more.
    """

    plan: Plan
    rig: ResolvedRig
    bus: ActuatorBus
    controller: Controller
    watch: Watch
    records: list[CycleRecord]
    faults: Mapping[str, Callable[[int], object]]
    heal: Callable[[], object]
    push: Callable[[int, float], object]
    closed: Callable[[str], bool | None]
    lag_s: float
    latches: tuple[str, ...]
    patience_s: float = 0.0
    deaf_s: float = 0.0

    @property
    def n(self) -> int:
        """Hinges."""
        return len(self.bus.hinge_ids)

    @property
    def period_s(self) -> float:
        """Of the cycles."""
        return 1.0 / self.rig.rate_hz

    @property
    def real_time(self) -> bool:
        """Whether it is paced to the wall, so that what else the machine does shows in its times."""
        return self.watch.simulation is not None

    def shafts(self) -> FloatArray:
        """(n_hinges,) where the shafts truly are."""
        return self.watch.shafts()


def _blocked(ground_clock: Clock, rate_hz: float) -> None:
    """The computer does something else for longer than any queue or watchdog waits."""
    ground_clock.sleep_until(ground_clock.now() + 60.0 / rate_hz)


def _plan(n_cells: int, start: Start, duration_s: float, tolerance: StepTolerance, **more: Any) -> Plan:
    if start.slits:
        return synthetic_plan(n_cells, duration_s=SEATING_S, tolerance=tolerance, **more)
    return synthetic_plan(n_cells, duration_s=duration_s, **more)


def _row(plan: Plan, start: Start) -> float:
    """The place of a fold among the plan's rows, from 0 to 1."""
    return int(np.searchsorted(plan.fold, start.fold)) / (len(plan.fold) - 1)


@contextmanager
def mock(folder: Path, start: Start, seed: int) -> Iterator[Ground]:
    """The simulation in this process, on a virtual clock."""
    del folder
    b = bench(
        _plan(4, start, DURATION_S, NARROWING, curvature=0.2),
        start="deployed" if start.fold == 1.0 else "stowed",
        start_fold=start.fold if 0.0 < start.fold < 1.0 else None,
        armed=False,
        latch=LATCHES,
        mock={"seed": seed},
        controller={"settle_timeout_s": 0.5, "pause_patience_s": 0.5, "seating_tolerance": 0.005},
    )
    bus, names = b.bus, b.rig.hinge_ids
    shafts = b.rig.to_actuator(b.plan.crease_angles_rad)

    def stop_at(k: int, fold: float) -> None:
        bus.end_stop(names[k], float(np.interp(fold, b.plan.fold, shafts[:, k])))

    def heal() -> None:
        for name in names:
            bus.unmute(name)
            bus.free(name)
            bus.overheat(name, 30.0)
        bus.sag(0.0)
        bus.replug()
        bus.clear_stops()
        for latch in ("pin", "coil", "lock"):
            bus.latch_mend(latch)

    def uneven(k: int) -> None:
        stop_at(k, UNEVEN[0])
        stop_at((k + 1) % len(names), UNEVEN[1])

    def each_pin(spoil: Callable[[str], object]) -> None:
        for latch in ("pin", "lock"):
            spoil(latch)

    faults: dict[str, Callable[[int], object]] = {
        "one lost reply": lambda k: bus.drop_replies(names[k], 1),
        "one corrupt reply": lambda k: bus.corrupt_replies(names[k], 1),
        "two lost in a row": lambda k: bus.drop_replies(names[k], 2),
        "silence": lambda k: bus.mute(names[k]),
        "garbage": lambda k: bus.corrupt_replies(names[k], 10),
        "unplugged": lambda _: bus.unplug(),
        "hardware error": lambda k: bus.overload(names[k]),
        "jam": lambda k: bus.jam(names[k]),
        "reboot": lambda k: bus.reboot(names[k]),
        "heat": lambda k: bus.overheat(names[k], 75.0),
        "low supply": lambda _: bus.sag(3.0),
        "stuck latch": lambda _: each_pin(bus.latch_stuck),
        "blind latch": lambda _: each_pin(bus.latch_blind),
        "late loop": lambda _: _blocked(b.clock, b.rig.rate_hz),
        "slit touches early": lambda k: stop_at(k, EARLY),
        "slits touch unevenly": uneven,
        "slit does not close": lambda _: bus.latch_stuck("pin"),
    }
    records: list[CycleRecord] = []
    watch = Watch(b.clock, lambda: bus.true_shaft_rad)
    with Controller(b.plan, b.rig, bus, watch, [records.append]) as controlled:
        controlled.connect()
        controlled.arm()
        yield Ground(
            b.plan, b.rig, bus, controlled, watch, records, faults, heal,
            lambda k, by_rad: bus.push(names[k], by_rad), bus.truly_closed, LAG_S["mock"], ("pin", "coil"),
        )  # fmt: skip


@contextmanager
def dynamixel(folder: Path, start: Start, seed: int) -> Iterator[Ground]:
    """Virtual servos behind a pseudo-terminal."""
    controller = {"settle_timeout_s": 1.0, "pause_patience_s": 0.5, "max_reading_age_s": 0.2}
    pin = {**SERVO_PIN, "timeout_s": 1.0}
    plan = _plan(N_SERVOS, start, 3.0, WIDE)
    with servos(
        folder,
        start_fold=_row(plan, start),
        plan=plan,
        rig={"controller": controller, "latch": [pin]},
        spec={"seed": seed},
    ) as setup:
        virtual = setup.virtual
        records: list[CycleRecord] = []
        servo = {k: k + 1 for k in range(N_SERVOS)}

        def shafts() -> FloatArray:
            truth = virtual.truth()
            return np.array([truth[i].shaft_rad for i in servo.values()])

        watch = Watch(MonotonicClock(), shafts, lambda: virtual.pid)

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
            "two lost in a row": lambda k: virtual.drop(servo[k], 2),
            "silence": lambda k: virtual.mute(servo[k]),
            "garbage": lambda k: virtual.corrupt(servo[k], 10),
            "unplugged": lambda _: virtual.unplug(),
            "hardware error": lambda k: virtual.overload(servo[k]),
            "jam": lambda k: virtual.jam(servo[k]),
            "reboot": lambda k: virtual.reboot(servo[k]),
            "heat": lambda k: virtual.heat(servo[k], 75.0),
            "low supply": lambda _: virtual.sag(3.0),
            "stuck latch": lambda _: virtual.jam(20),
            "late loop": lambda _: _blocked(watch, setup.rig.rate_hz),
            "slit touches early": lambda k: virtual.jam(servo[k]),
            "slit does not close": lambda _: virtual.jam(20),
        }
        with Controller(setup.plan, setup.rig, setup.bus, watch, [records.append]) as controlled:
            controlled.connect()
            if start == DEPLOYED:
                virtual.push(20, 1.5)
            controlled.arm()
            yield Ground(
                setup.plan, setup.rig, setup.bus, controlled, watch, records, faults, heal,
                lambda k, by_rad: virtual.push(servo[k], by_rad),
                lambda name: abs(virtual.truth()[20].shaft_rad - 1.0) < 0.1 if name == "pin" else None,
                LAG_S["dynamixel"], ("pin",), REPLIES_S,
            )  # fmt: skip


@contextmanager
def board(folder: Path, start: Start, seed: int) -> Iterator[Ground]:
    """The firmware on the simulated board `port_host`."""
    plan = _plan(N_ON_BOARD, start, 3.0, WIDE, rate_hz=25.0)
    with on_board(
        folder,
        plan=plan,
        start_fold=start.fold,
        seed=seed,
        controller={"settle_timeout_s": 1.0, "pause_patience_s": 0.5, "lost_replies_allowed": 2},
    ) as setup:
        device = setup.board
        coil = setup.rig.latch_ids.index("coil")
        watch = Watch(MonotonicClock(), setup.shafts, lambda: device.pid)
        records: list[CycleRecord] = []

        def heal() -> None:
            for k in range(4):
                device.jam(k, False)
                device.wire(k, "good")
            device.cut("to_device", False)
            device.cut("from_device", False)
            device.supply(6.0)
            device.estop(False)
            for k in range(2):
                device.latch_stuck(k, False)
            device.replug()
            time.sleep(0.3)

        def stick(_: int) -> None:
            for k in range(2):
                device.latch_stuck(k)

        faults: dict[str, Callable[[int], object]] = {
            "silence": lambda k: device.open_wire(k),
            "garbage": lambda k: device.short_wire(k),
            "unplugged": lambda _: device.unplug(),
            "jam": lambda k: device.jam(k),
            "reboot": lambda _: device.reset("external"),
            "low supply": lambda _: device.supply(4.5),
            "stuck latch": stick,
            "late loop": lambda _: _blocked(watch, setup.rig.rate_hz),
            "board's emergency stop": lambda _: device.estop(True),
            "board hangs": lambda _: device.hang(),
            "slit does not close": stick,
        }
        # Not the controller of the setup: this one's clock watches the shafts.
        with Controller(setup.plan, setup.rig, setup.bus, watch, [records.append]) as controlled:
            controlled.connect()
            controlled.arm()
            yield Ground(
                setup.plan, setup.rig, setup.bus, controlled, watch, records, faults, heal,
                device.push, lambda name: device.truth().latches[coil].closed if name == "coil" else None,
                LAG_S["board"], ("coil",), QUEUE["reply_timeout_s"], QUEUE["silence_s"],
            )  # fmt: skip


Factory = Callable[[Path, Start, int], AbstractContextManager[Ground]]

GROUNDS: Mapping[str, Factory] = {"mock": mock, "dynamixel": dynamixel, "board": board}


def available() -> dict[str, str]:
    """Every backend, and why it cannot be had; empty where it can."""
    missing: tuple[Any, ...] = missing_tools("host")
    return {"mock": "", "dynamixel": "", "board": f"missing: {', '.join(missing)}" if missing else ""}
