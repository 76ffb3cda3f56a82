"""What a cycle of the controller costs, 12 hinges: `python -m benchmarks.control` from the repository's root.

The null bus answers at once with what it was told, so its figure is the controller's own work; the mock's
figure includes the simulation of the servos.
"""

from __future__ import annotations

import platform
import time

import numpy as np

from ori_deploy.actuators.bus import ActuatorBus, HealthReadings, HingeReadings, LatchReading
from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import parse_rig
from ori_deploy.clock import VirtualClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.motion.plan import MotionCheck, Plan
from ori_deploy.motion.step_tolerance import StepTolerance
from sim_backends.mock import MockBus

N_HINGES = 12
RUNS = 5
TARGET_US = 200.0
SEED = 1


class NullBus(ActuatorBus):
    """Perfect actuators without physics: every goal is reached before it is read back."""

    def __init__(self, rig: ResolvedRig, clock: VirtualClock, start: np.ndarray) -> None:
        super().__init__(rig.hinge_ids, rig.latch_ids, rig.position_limits_rad)
        self._clock = clock
        self._position = start
        self._zeros = np.zeros(len(start))
        self._false = np.zeros(len(start), dtype=np.bool_)
        self._true = np.ones(len(start), dtype=np.bool_)
        self._errors = np.zeros(len(start), dtype=np.uint8)
        self._engaged = [False] * len(rig.latch_ids)

    def _open(self) -> None: ...

    def _close(self) -> None: ...

    def _write_goals(self, position_rad: np.ndarray, velocity_rad_s: np.ndarray | None) -> None:
        del velocity_rad_s
        self._position = position_rad

    def _set_torque(self, on: bool) -> None: ...

    def _read_hinges(self) -> HingeReadings:
        times = np.full(len(self._zeros), self._clock.now())
        return HingeReadings(self._position, self._zeros, self._zeros, self._false, self._true, times)

    def _read_health(self) -> HealthReadings:
        times = np.full(len(self._zeros), self._clock.now())
        warm, volts = self._zeros + 25.0, self._zeros + 12.0
        return HealthReadings(warm, volts, self._errors, self._true, self._true, times)

    def _reset_errors(self) -> None: ...

    def _set_latch(self, index: int, engaged: bool) -> None:
        self._engaged[index] = engaged

    def _read_latches(self) -> tuple[LatchReading, ...]:
        now = self._clock.now()
        return tuple(
            LatchReading(name, engaged, engaged, True, now)
            for name, engaged in zip(self.latch_ids, self._engaged, strict=True)
        )


def example_plan(n_cells: int = N_HINGES, duration_s: float = 8.0, rate_hz: float = 100.0) -> Plan:
    """A smooth opening with no geometry behind it."""
    time_s = np.linspace(0.0, duration_s, round(duration_s * rate_hz) + 1)
    u = time_s / duration_s
    fold = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    fold[-1] = 1.0
    fold_rate = 30.0 * u**2 * (1.0 - u) ** 2 / duration_s
    opening = np.linspace(0.9, 1.3, n_cells)[:, None] * np.array([-1.0, -0.9, 1.0, 0.8])
    return Plan(
        design_sha256="0" * 64,
        design_name="benchmark",
        cell_ids=tuple(f"c{i + 1}" for i in range(n_cells)),
        rate_hz=rate_hz,
        time_s=time_s,
        fold=fold,
        crease_angles_rad=np.array([np.pi, np.pi, 0.0, 0.0]) + opening * fold[:, None, None],
        crease_rates_rad_s=opening * fold_rate[:, None, None],
        transmission=np.broadcast_to(opening, (len(fold), n_cells, 4)),
        step_tolerance=StepTolerance(np.linspace(0.04, 1.0, 25), np.full(25, 0.1), 1.0, 0.0),
        latch_points=("slit:P-T1", "slit:Q-T2"),
        check=MotionCheck(2, 0.0, 1e-6, 1e-3, (0.1, 0.9), ("a", "b"), 0.5),
    )


def example_rig(plan: Plan) -> ResolvedRig:
    actuator = {
        "max_velocity_rad_s": 4.0,
        "max_acceleration_rad_s2": 20.0,
        "max_torque_nm": 2.0,
        "min_position_rad": -1.0,
        "max_position_rad": 26.0,
    }
    document = {
        "schema": "ori-deploy/rig/1",
        "backend": "mock",
        "rate_hz": 100.0,
        "each_cell": {"crease": "close_a", "gear_ratio": 4.0, "actuator": actuator},
        "each_latch_point": {"kind": "magnet"},
        "mock": {"seed": SEED},
    }
    return resolve_rig(parse_rig(document), plan.cell_ids, plan.latch_points)


def cycle_times_us(plan: Plan, rig: ResolvedRig, kind: str) -> np.ndarray:
    """Time of every cycle of one deployment, in microseconds."""
    clock = VirtualClock()
    angles = plan.crease_angles_rad
    bus: ActuatorBus
    if kind == "mock":
        bus = MockBus.from_rig(rig, clock, angles[0], angles[-1])
    else:
        bus = NullBus(rig, clock, rig.to_actuator(angles[0]))
    controller = Controller(plan, rig, bus, clock)
    controller.connect()
    controller.arm()
    controller.deploy()
    times = []
    while controller.under_way:
        start = time.perf_counter_ns()
        controller.step()
        times.append(time.perf_counter_ns() - start)
    if not controller.result().succeeded:
        raise RuntimeError(f"the benchmark's deployment failed: {controller.fault}")
    return np.array(times) / 1e3


def main() -> None:
    plan = example_plan()
    rig = example_rig(plan)
    print(f"controller cycle, {N_HINGES} hinges, {platform.machine()}, Python {platform.python_version()}")
    medians = {}
    for kind, label in (("null", "controller alone (null bus)"), ("mock", "with the mock's physics")):
        cycle_times_us(plan, rig, kind)  # warm-up
        times = np.concatenate([cycle_times_us(plan, rig, kind) for _ in range(RUNS)])
        medians[kind] = float(np.median(times))
        print(f"  {label:28s} median {medians[kind]:6.1f} us, p99 {np.percentile(times, 99):6.1f} us")
    ratio = medians["null"] / TARGET_US
    print(f"  controller / target of {TARGET_US:.0f} us: {ratio:.2f}")
    print(f"  mock / controller: {medians['mock'] / medians['null']:.2f}")


if __name__ == "__main__":
    main()
