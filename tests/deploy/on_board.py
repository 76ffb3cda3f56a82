"""The controller on a simulated microcontroller, and what its servos were told, frame by frame."""

from __future__ import annotations

import copy
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ori_deploy.actuators.mcu.bus import McuBus
from ori_deploy.actuators.mcu.grid import Knot
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import MonotonicClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import CycleRecord
from ori_deploy.motion.plan import Plan
from sim_backends.microcontroller.build import Port
from sim_backends.microcontroller.from_rig import world_from_rig
from sim_backends.microcontroller.launcher import Microcontroller, Pulses
from sim_backends.microcontroller.spec import WorldSpec
from tests.contract.backends import BOARD_RIG, configure
from tests.deploy.synthetic import synthetic_plan, synthetic_rig
from tests.sim_backends.microcontroller.bench import need

N = 4
FRAME_S = 0.02
QUEUE = {"silence_s": 0.4, "lead_s": 0.6, "min_lead_s": 0.5, "reply_timeout_s": 0.05}

PIN = {"id": "pin", "secures": "stow", "kind": "lock_pin", "travel_s": 0.2, "timeout_s": 2.0}
COIL = {
    "id": "coil", "secures": "slit:P-T2", "kind": "electromagnet", "timeout_s": 2.0, "capture_range_rad": 0.03,
    "max_on_s": 20.0, "duty_cycle": 0.5,
}  # fmt: skip
CELL = {
    "zero_rad": 2.2,
    "gear_ratio": 3.0,
    "actuator": {
        "max_velocity_rad_s": 6.0,
        "max_acceleration_rad_s2": 40.0,
        "max_torque_nm": 0.5,
        "min_position_rad": -3.1,
        "max_position_rad": 3.1,
    },
}


@dataclass
class Setup:
    """A rig, the board it describes, and a controller that is not connected yet."""

    plan: Plan
    rig: ResolvedRig
    board: Microcontroller
    bus: McuBus
    controller: Controller
    records: list[CycleRecord]
    sent: list[tuple[int, Knot]] = field(default_factory=list)
    """Knots, each with the number of records that were there when it was queued."""

    def shafts(self) -> np.ndarray:
        return np.array(self.board.truth().shaft_rad)

    def go_on(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.controller.step()

    def again(self) -> Controller:
        """Another controller on the same board, as after a restart of the host."""
        assert self.rig.mcu is not None
        clock = MonotonicClock()
        bus = McuBus(self.rig.mcu, clock, self.rig.rate_hz)
        return Controller(self.plan, self.rig, bus, clock)


@contextmanager
def on_board(
    folder: Path,
    *,
    port: Port = "host",
    plan: Plan | None = None,
    rig: ResolvedRig | None = None,
    start_fold: float | None = None,
    rate_hz: float = 25.0,
    seed: int = 1,
    mcu: dict[str, Any] | None = None,
    stops: dict[int, float] | None = None,
    **tables: Any,
) -> Iterator[Setup]:
    """Stowed, its configuration written; `mcu` and `tables` change the rig; `stops` are folds no cell gets beyond.

    A slow loop, a long queue and a patient board: the machine that runs the tests has other things to do as well.
    """
    need(port)
    plan = plan or synthetic_plan(N, duration_s=3.0, rate_hz=rate_hz)
    link = folder / "ttyMCU"
    if rig is None:
        document = {**copy.deepcopy(BOARD_RIG), "port": str(link), **QUEUE, **(mcu or {})}
        controller = {"lost_replies_allowed": 5, "max_reading_age_s": 0.2, **tables.pop("controller", {})}
        rig = synthetic_rig(
            plan, backend="mcu", rate_hz=rate_hz, each_cell=CELL, latch=[COIL, PIN], mcu=document,
            controller={"min_voltage_v": 4.8, **controller}, **tables,
        )  # fmt: skip
    assert rig.mcu is not None
    angles = plan.crease_angles_rad
    start = None if start_fold is None else angles[int(np.searchsorted(plan.fold, start_fold))]
    world = world_from_rig(rig, angles[0], angles[-1], start_rad=start, seed=seed)
    for cell, fold in (stops or {}).items():
        world = _stopped(world, cell, plan, rig, fold)
    with Microcontroller(world, link, port=port) as board:
        board.wait_ready()
        clock = MonotonicClock()
        configure(link, clock, rig.mcu)
        bus = McuBus(rig.mcu, clock, rig.rate_hz, str(link))
        records: list[CycleRecord] = []
        controlled = Controller(plan, rig, bus, clock, [records.append])
        setup = Setup(plan, rig, board, bus, controlled, records)
        _listen(setup)
        try:
            yield setup
        finally:
            controlled.close()


def _stopped(world: WorldSpec, cell: int, plan: Plan, rig: ResolvedRig, fold: float) -> WorldSpec:
    """The same with an end stop in a cell's way."""
    shaft = rig.to_actuator(plan.crease_angles_rad)[:, cell]
    end = {"upper_rad" if shaft[-1] > shaft[0] else "lower_rad": float(np.interp(fold, plan.fold, shaft))}
    hinges = list(world.hinges)
    hinges[cell] = replace(hinges[cell], **end)
    return replace(world, hinges=tuple(hinges))


def _listen(setup: Setup) -> None:
    """Keep every knot that the bus queues."""
    following = setup.bus._grid.next

    def heard(*args: Any) -> tuple[Knot, ...]:
        knots = following(*args)
        setup.sent.extend((len(setup.records), knot) for knot in knots)
        return knots

    setup.bus._grid.next = heard  # type: ignore[method-assign]


def frames(setup: Setup, pulses: Pulses, output: int) -> tuple[np.ndarray, np.ndarray]:
    """Device times at which the frames of an output began, s, and the pulses in them, ns."""
    mine = pulses.of(output)
    # Frames begin at whole multiples of 20 ms of the device's clock; which, its reports tell.
    # The board goes on between its answer and the look at its clock, on a busy machine for long: the least counts.
    answers = ((setup.bus._ask_state(), setup.board.truth()) for _ in range(10))
    offset = min(truth.time_us * 1e-6 - report.time_us * 1e-6 for report, truth in answers)
    number = np.rint((mine.time_s - offset) / FRAME_S)
    assert np.abs(mine.time_s - offset - number * FRAME_S).max() < 0.4 * FRAME_S
    return number * FRAME_S, 1e9 * mine.width_s


def spline(knots: list[Knot], time_s: np.ndarray) -> np.ndarray:
    """(n, n_hinges) positions on the knots' cubic splines, in floating point; ends are held."""
    times = np.array([knot.time_s for knot in knots])
    places = np.array([knot.position_rad for knot in knots])
    speeds = np.array([knot.velocity_rad_s for knot in knots])
    i = np.clip(np.searchsorted(times, time_s, side="right") - 1, 0, len(times) - 2)
    width = times[i + 1] - times[i]
    u = np.clip((time_s - times[i]) / width, 0.0, 1.0)[:, None]
    width = width[:, None]
    return np.asarray(
        (1 + 2 * u) * (1 - u) ** 2 * places[i]
        + u * (1 - u) ** 2 * width * speeds[i]
        + u**2 * (3 - 2 * u) * places[i + 1]
        + u**2 * (u - 1) * width * speeds[i + 1]
    )


def pulse_ns(setup: Setup, hinge: int, position_rad: np.ndarray) -> np.ndarray:
    """What the rig says that a position's pulse is."""
    assert setup.rig.mcu is not None
    servo = setup.rig.mcu.hinges[hinge].servo
    return 1e3 * (servo.pulse_zero_us + servo.pulse_us_per_rad * position_rad)
