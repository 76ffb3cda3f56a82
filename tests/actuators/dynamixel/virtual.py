"""Rigs on virtual servos, for tests of what this backend alone promises."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ori_deploy.actuators.dynamixel.bus import DynamixelBus
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import MonotonicClock
from ori_deploy.motion.plan import Plan
from sim_backends.dynamixel.from_rig import spec_from_rig
from sim_backends.dynamixel.launcher import VirtualBus
from sim_backends.dynamixel.spec import ServoSpec
from tests.deploy.synthetic import synthetic_plan, synthetic_rig

N = 3
PIN = {"id": "pin", "secures": "slit:P-T2", "kind": "lock_pin", "travel_s": 0.2, "timeout_s": 2.0}
PIN_SERVO = {"latch": "pin", "id": 20, "model": "XL330-M288", "engaged_rad": 1.0, "released_rad": -0.5}


@dataclass
class Setup:
    """A rig, the virtual bus that it describes, and the backend on it."""

    plan: Plan
    rig: ResolvedRig
    virtual: VirtualBus
    bus: DynamixelBus

    def again(self, **settings: Any) -> DynamixelBus:
        """Another backend on the same servos, as after a restart of the host; other settings if wished."""
        assert self.rig.wiring is not None
        wiring = replace(self.rig.wiring, settings=replace(self.rig.wiring.settings, **settings))
        return make_bus(replace(self.rig, wiring=wiring), self.plan)


def make_bus(rig: ResolvedRig, plan: Plan) -> DynamixelBus:
    ends = plan.crease_angles_rad[[0, -1]]
    return DynamixelBus.from_rig(rig, MonotonicClock(), ends[0], ends[1])


def _stopped(servo: ServoSpec, k: int, rig: ResolvedRig, plan: Plan, stops: Mapping[int, float]) -> ServoSpec:
    """A servo with the end of its crease's travel at a fold, if it is one of those."""
    if k not in stops:
        return servo
    shaft = rig.to_actuator(plan.crease_angles_rad)[:, k]
    stop = float(np.interp(stops[k], plan.fold, shaft))
    return replace(servo, upper_stop_rad=stop) if shaft[-1] > shaft[0] else replace(servo, lower_stop_rad=stop)


@contextmanager
def servos(
    folder: Path,
    *,
    start_fold: float | None = 0.5,
    model: str = "XM430-W350",
    turns: bool = False,
    servo: dict[str, Any] | None = None,
    spec: dict[str, Any] | None = None,
    rig: dict[str, Any] | None = None,
    plan: Plan | None = None,
    stops: Mapping[int, float] | None = None,
    **settings: Any,
) -> Iterator[Setup]:
    """Three hinges, a lock pin on the slit and a magnet on a cell; `turns` for a range of several turns.

    `servo` and `spec` change all virtual servos and the bus, `rig` the rig's tables, `settings` [dynamixel]. In the
    way of some hinges, by row, something stands at a fold of `stops`.
    """
    plan = plan or synthetic_plan(N, duration_s=3.0)
    low, high, gear, zero = (-20.0, 20.0, 10.0, 1.0) if turns else (-3.1, 3.1, 4.0, 2.6)
    actuator = {"max_velocity_rad_s": 4.0, "max_torque_nm": 0.2, "min_position_rad": low, "max_position_rad": high}
    tables: dict[str, Any] = {
        "backend": "dynamixel",
        "each_cell": {
            "zero_rad": zero,
            "gear_ratio": gear,
            "actuator": {**actuator, "max_acceleration_rad_s2": 60.0},
        },
        "latch": [PIN],
        "controller": {"lost_replies_allowed": 3},
        "dynamixel": {
            "port": str(folder / "ttyDXL"),
            "baud": 4_000_000,
            "model": model,
            "magnets": "by_hinges",
            "servo": [PIN_SERVO],
            "reply_slack_s": 0.03,
            "watchdog_s": 0.5,  # the machine that runs the tests has other things to do as well
            **settings,
        },
    }
    resolved = synthetic_rig(plan, **{**tables, **(rig or {})})
    angles = plan.crease_angles_rad
    rows = None if start_fold is None else angles[round(start_fold * (len(angles) - 1))]
    made = spec_from_rig(resolved, angles[0], angles[-1], start_rad=rows)
    made = replace(made, servos=tuple(replace(one, **(servo or {})) for one in made.servos), **(spec or {}))
    made = replace(
        made, servos=tuple(_stopped(one, k, resolved, plan, stops or {}) for k, one in enumerate(made.servos))
    )
    with VirtualBus(made, link=folder / "ttyDXL") as virtual:
        bus = make_bus(resolved, plan)
        try:
            yield Setup(plan, resolved, virtual, bus)
        finally:
            bus.close()
