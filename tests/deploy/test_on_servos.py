"""The controller on virtual Dynamixel servos: faults, clearing them, and going on."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ori_deploy.clock import MonotonicClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import CycleRecord, FaultKind, Outcome
from ori_deploy.deploy.states import State
from tests.actuators.dynamixel.virtual import Setup, servos
from tests.deploy.synthetic import NARROWING, synthetic_plan


@contextmanager
def controlled(folder: Path, **changes: Any) -> Iterator[tuple[Setup, Controller]]:
    """Stowed, connected and armed."""
    with (
        servos(folder, start_fold=0.0, **changes) as setup,
        Controller(setup.plan, setup.rig, setup.bus, MonotonicClock()) as controller,
    ):
        controller.connect()
        controller.arm()
        yield setup, controller


def go_on(controller: Controller, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        controller.step()


def shafts(setup: Setup) -> np.ndarray:
    truth = setup.virtual.truth()
    return np.array([truth[i].shaft_rad for i in (1, 2, 3)])


@pytest.mark.slow
def test_deploys_with_a_pin_and_magnets_and_stows_again(tmp_path: Path) -> None:
    with controlled(tmp_path) as (setup, controller):
        controller.deploy()
        result = controller.run()
        assert result.outcome is Outcome.SUCCEEDED, result
        pin = setup.virtual.truth()[20]
        assert pin.shaft_rad == pytest.approx(1.0, abs=0.1)
        controller.stow()
        assert controller.run().succeeded
        assert setup.virtual.truth()[20].shaft_rad == pytest.approx(-0.5, abs=0.1)
        np.testing.assert_allclose(shafts(setup), setup.rig.to_actuator(setup.plan.crease_angles_rad[0]), atol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spoil", "mend", "kinds"),
    [
        (lambda bus: bus.overload(2), None, {FaultKind.HARDWARE_ERROR}),
        (lambda bus: bus.reboot(2), None, {FaultKind.LOST_REPLIES, FaultKind.RESTARTED}),
        (lambda bus: bus.mute(2), lambda bus: bus.mute(2, on=False), {FaultKind.LOST_REPLIES}),
    ],
    ids=["overload", "reboot", "silence"],
)
def test_a_fault_is_cleared_and_the_motion_begun_again(
    tmp_path: Path, spoil: Any, mend: Any, kinds: set[FaultKind]
) -> None:
    with controlled(tmp_path) as (setup, controller):
        controller.deploy()
        go_on(controller, 0.8)
        spoil(setup.virtual)
        result = controller.run()
        assert result.fault is not None
        assert result.fault is not None
        assert result.fault.kind in kinds, result.fault
        assert result.fault.thing == "servo_c2"
        before = shafts(setup)
        if mend is not None:
            mend(setup.virtual)
        time.sleep(0.4)  # a servo that restarts says nothing meanwhile
        controller.clear_fault()
        if controller.state is State.READY:
            controller.arm()
        assert controller.state is State.ARMED
        np.testing.assert_allclose(shafts(setup), before, atol=0.02)
        controller.deploy()
        assert controller.run().succeeded


@pytest.mark.slow
@pytest.mark.parametrize("mode", [{}, {"operating_mode": "current_based_position", "current_limit_a": 1.5}])
def test_slits_are_closed_with_a_part_of_the_strength_and_then_held_with_less(
    tmp_path: Path, mode: dict[str, Any]
) -> None:
    plan = synthetic_plan(3, duration_s=6.0, tolerance=NARROWING)
    register = "goal_current" if mode else "goal_pwm"
    with controlled(tmp_path, plan=plan, **mode) as (setup, controller):
        full = setup.virtual.register(1, register)
        found: dict[str, set[int]] = {}

        def look(record: CycleRecord) -> None:
            if record.index % 20 == 0:
                found.setdefault(str(record.stage), set()).add(setup.virtual.register(1, register))

        controller.add_observer(look)
        controller.deploy()
        result = controller.run()
        assert result.succeeded, result
        assert found["open"] == {full, round(0.6 * full)}
        controller.step()
        assert setup.virtual.register(1, register) == round(0.5 * full)
        controller.stow()
        assert controller.run().succeeded
        assert setup.virtual.register(1, register) == full


@pytest.mark.slow
@pytest.mark.parametrize("hinge", [0, 2])
def test_a_slit_that_closes_too_early_names_its_cell(tmp_path: Path, hinge: int) -> None:
    plan = synthetic_plan(3, duration_s=6.0, tolerance=NARROWING)
    with controlled(tmp_path, plan=plan, stops={hinge: 0.955}) as (setup, controller):
        controller.deploy()
        result = controller.run()
        assert result.fault is not None
        assert (result.fault.kind, result.fault.thing) == (FaultKind.SEATING_EARLY, f"c{hinge + 1}"), result.fault
        assert result.outcome is Outcome.SEATING
        assert all(setup.virtual.truth()[i].hardware_error == 0 for i in (1, 2, 3))


@pytest.mark.slow
def test_an_unplugged_bus_is_found_again_where_it_stood(tmp_path: Path) -> None:
    with controlled(tmp_path) as (setup, controller):
        controller.deploy()
        go_on(controller, 0.8)
        setup.virtual.unplug()
        result = controller.run()
        assert result.fault is not None
        assert result.fault.kind is FaultKind.BUS_CLOSED
        time.sleep(0.8)
        stood = shafts(setup)
        assert all(setup.virtual.truth()[i].frozen for i in (1, 2, 3))
        controller.clear_fault()
        assert controller.state is State.DISCONNECTED
        setup.virtual.replug()
        controller.connect()
        controller.arm()
        np.testing.assert_allclose(shafts(setup), stood, atol=0.02)
        controller.deploy()
        assert controller.run().succeeded


@pytest.mark.slow
def test_a_host_that_hangs_finds_its_servos_stopped_and_says_so(tmp_path: Path) -> None:
    with controlled(tmp_path, watchdog_s=0.2) as (setup, controller):
        controller.deploy()
        go_on(controller, 0.8)
        time.sleep(0.5)
        assert all(setup.virtual.truth()[i].frozen for i in (1, 2, 3))
        result = controller.run()
        assert result.fault is not None
        assert result.fault.kind is FaultKind.WATCHDOG
        controller.clear_fault()
        if controller.state is State.READY:
            controller.arm()
        controller.deploy()
        assert controller.run().succeeded


def test_an_exception_brings_it_to_rest_and_leaves_it_holding(tmp_path: Path) -> None:
    with servos(tmp_path, start_fold=0.0) as setup:

        def fails_late() -> None:
            with Controller(setup.plan, setup.rig, setup.bus, MonotonicClock()) as controller:
                controller.connect()
                controller.arm()
                controller.deploy()
                go_on(controller, 0.8)
                raise RuntimeError("a bug elsewhere")

        with pytest.raises(RuntimeError):
            fails_late()
        time.sleep(0.2)  # the servos' own lag behind the last goal
        truth = setup.virtual.truth()
        assert all(truth[i].torque_on and not truth[i].frozen for i in (1, 2, 3))
        assert max(abs(truth[i].velocity_rad_s) for i in (1, 2, 3)) < 0.05
        assert not setup.bus.connected


@pytest.mark.slow
def test_spoilt_replies_are_counted_and_nothing_else(tmp_path: Path) -> None:
    with controlled(tmp_path) as (setup, controller):
        controller.deploy()
        for k in range(12):
            go_on(controller, 0.05)
            (setup.virtual.corrupt if k % 2 else setup.virtual.drop)(1 + k % 3, 1)
        result = controller.run()
        assert result.succeeded, result
        assert result.lost_replies >= 12
