"""Small made-up plans and rigs, with no geometry behind them."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import parse_rig
from ori_deploy.clock import VirtualClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import CycleRecord
from ori_deploy.motion.plan import MotionCheck, Plan
from ori_deploy.motion.step_tolerance import StepTolerance
from sim_backends.mock import MockBus

CHECK = MotionCheck(
    n_poses=2,
    deepest_penetration_m=0.0,
    allowed_penetration_m=1e-6,
    smallest_clearance_m=1e-3,
    clearance_fold_range=(0.1, 0.9),
    clearance_panels=("c1.a", "c2.b"),
    clearance_fold=0.5,
)

NARROWING = StepTolerance(
    np.array([0.6, 0.7, 0.8, 0.85, 0.9, 1.0]), np.array([0.5, 0.3, 0.2, 0.11, 0.05, 0.0025]), 0.9, 1e-4
)
"""Much as that of an ellipse of six cells: slits close from fold 0.9 on."""


def synthetic_plan(
    n_cells: int = 4,
    *,
    duration_s: float = 2.0,
    rate_hz: float = 100.0,
    curvature: float = 0.0,
    tolerance: StepTolerance | float = 0.2,
) -> Plan:
    """A plan in which every crease opens smoothly from rest to rest.

    With `curvature` the creases' angles are not linear in the fold.
    """
    time_s = np.append(np.arange(0.0, duration_s - 0.4 / rate_hz, 1.0 / rate_hz), duration_s)
    u = time_s / duration_s
    fold = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    fold_rate = 30.0 * u**2 * (1.0 - u) ** 2 / duration_s
    fold[0], fold[-1] = 0.0, 1.0
    opening = np.linspace(0.9, 1.3, n_cells)[:, None] * np.array([-1.0, -0.9, 1.0, 0.8])
    closed = np.array([np.pi, np.pi, 0.0, 0.0])
    f = fold[:, None, None]
    transmission = opening * (1.0 + curvature * (1.0 - 2.0 * f))
    if isinstance(tolerance, float):
        tolerance = StepTolerance(np.array([1.0]), np.array([tolerance]), 1.0, 0.0)
    return Plan(
        design_sha256="0" * 64,
        design_name="synthetic",
        cell_ids=tuple(f"c{i + 1}" for i in range(n_cells)),
        rate_hz=rate_hz,
        time_s=time_s,
        fold=fold,
        crease_angles_rad=closed + opening * (f + curvature * f * (1.0 - f)),
        crease_rates_rad_s=transmission * fold_rate[:, None, None],
        transmission=transmission,
        step_tolerance=tolerance,
        latch_points=("slit:P-T2", "cell:c1"),
        check=CHECK,
    )


RIG: dict[str, Any] = {
    "schema": "ori-deploy/rig/1",
    "backend": "mock",
    "rate_hz": 100.0,
    "each_cell": {
        "crease": "close_a",
        "gear_ratio": 4.0,
        "zero_rad": 0.5,
        "direction": -1,
        "actuator": {
            "max_velocity_rad_s": 8.0,
            "max_acceleration_rad_s2": 60.0,
            "max_torque_nm": 2.0,
            "min_position_rad": -20.0,
            "max_position_rad": 20.0,
        },
    },
    "each_latch_point": {"kind": "magnet", "timeout_s": 0.5},
    "mock": {"seed": 3},
}


def synthetic_rig(plan: Plan, **tables: Any) -> ResolvedRig:
    """The rig above for a plan; `tables` replace or extend its tables."""
    document = copy.deepcopy(RIG)
    for key, value in tables.items():
        if isinstance(value, dict) and key in document:
            document[key] = {**document[key], **value}
        else:
            document[key] = value
    return resolve_rig(parse_rig(document), plan.cell_ids, plan.latch_points)


@dataclass
class Bench:
    """A controller with everything round it, on a virtual clock, its records kept."""

    plan: Plan
    rig: ResolvedRig
    clock: VirtualClock
    bus: MockBus
    controller: Controller
    records: list[CycleRecord]

    def steps(self, count: int) -> CycleRecord:
        for _ in range(count):
            record = self.controller.step()
        return record

    def step_until_fold(self, fold: float) -> CycleRecord:
        """Step until the command passes a fold, in either direction."""
        before = self.controller.step().commanded_fold
        for _ in range(5000):
            record = self.controller.step()
            if (record.commanded_fold - fold) * (before - fold) <= 0.0:
                return record
            before = record.commanded_fold
        raise AssertionError(f"never reached fold {fold}: {self.records[-1]}")

    def step_to_rest(self) -> CycleRecord:
        record = self.controller.step()
        for _ in range(1000):
            if record.rate == 0.0:
                return record
            record = self.controller.step()
        raise AssertionError("never came to rest")


def bench(
    plan: Plan | None = None,
    *,
    start: str = "stowed",
    start_fold: float | None = None,
    armed: bool = True,
    **tables: Any,
) -> Bench:
    """A bench with a mock; `tables` as in `synthetic_rig`."""
    plan = plan if plan is not None else synthetic_plan()
    rig = synthetic_rig(plan, **tables)
    clock = VirtualClock(100.0)
    angles = plan.crease_angles_rad
    start_rad = None
    if start_fold is not None:
        start_rad = angles[int(np.searchsorted(plan.fold, start_fold))]
    bus = MockBus.from_rig(
        rig,
        clock,
        angles[0],
        angles[-1],
        start="deployed" if start == "deployed" else "stowed",
        start_rad=start_rad,
    )
    records: list[CycleRecord] = []
    controller = Controller(plan, rig, bus, clock, [records.append])
    if armed:
        controller.connect()
        controller.arm()
    return Bench(plan, rig, clock, bus, controller, records)
