"""Hinges on Dynamixel servos, latches on a microcontroller: two ports, one controller, one clock."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from ori_deploy.actuators.hardware import hardware_bus
from ori_deploy.actuators.mcu.mixed import MixedBus
from ori_deploy.clock import MonotonicClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import FaultKind, Outcome
from ori_deploy.deploy.states import State
from sim_backends.dynamixel.from_rig import spec_from_rig
from sim_backends.dynamixel.launcher import VirtualBus
from sim_backends.microcontroller.from_rig import servo_ids, world_from_rig
from sim_backends.microcontroller.launcher import Microcontroller
from sim_backends.microcontroller.linked import LinkedStructure
from tests.contract.backends import BOARD_RIG, configure
from tests.deploy.on_board import CELL, COIL, PIN
from tests.deploy.synthetic import synthetic_plan, synthetic_rig
from tests.sim_backends.microcontroller.bench import need

pytestmark = pytest.mark.slow


@dataclass
class Mixed:
    servos: VirtualBus
    board: Microcontroller
    bus: MixedBus
    controller: Controller


COILS = {"kind": "electromagnet", "timeout_s": 2.0, "max_on_s": 20.0, "duty_cycle": 0.5}


@contextmanager
def mixed(folder: Path, points: dict[str, object] = COILS, *, linked: bool = False) -> Iterator[Mixed]:
    """Stowed, connected and armed. Without a link between the simulations coils close when they are energised."""
    need("host")
    plan = synthetic_plan(3, duration_s=3.0, rate_hz=50.0)
    board_rig = {key: value for key, value in copy.deepcopy(BOARD_RIG).items() if key != "each_hinge"}
    rig = synthetic_rig(
        plan,
        backend="dynamixel",
        rate_hz=50.0,
        each_cell={**CELL, "actuator": {**CELL["actuator"], "max_velocity_rad_s": 4.0}},
        latch=[COIL, PIN],
        each_latch_point=points,
        controller={"lost_replies_allowed": 5, "max_reading_age_s": 0.2, "min_voltage_v": 4.8},
        dynamixel={
            "port": str(folder / "ttyDXL"), "baud": 4_000_000, "model": "XM430-W350",
            "reply_slack_s": 0.03, "watchdog_s": 0.5,
        },
        mcu={**board_rig, "port": str(folder / "ttyMCU")},
    )  # fmt: skip
    assert rig.mcu is not None
    ends = plan.crease_angles_rad[[0, -1]]
    clock = MonotonicClock()
    with (
        VirtualBus(spec_from_rig(rig, ends[0], ends[1]), link=folder / "ttyDXL") as servos,
        Microcontroller(
            world_from_rig(rig, ends[0], ends[1], turned=linked), folder / "ttyMCU", port="host"
        ) as board,
    ):
        board.wait_ready()
        structure = LinkedStructure(board, servos.control, servo_ids(rig)) if linked else None
        if structure is not None:
            structure.step()
        configure(folder / "ttyMCU", clock, rig.mcu)
        bus = hardware_bus(rig, clock, ends[0], ends[1])
        assert isinstance(bus, MixedBus)
        with Controller(plan, rig, bus, clock) as controller:
            if structure is not None:
                controller.add_observer(lambda _: structure.step())
            controller.connect()
            controller.arm()
            yield Mixed(servos, board, bus, controller)


def test_deploys_and_stows_with_one_controller(tmp_path: Path) -> None:
    with mixed(tmp_path) as setup:
        assert setup.bus.latch_ids == ("coil", "latch_cell:c1", "pin")
        setup.controller.deploy()
        result = setup.controller.run()
        assert result.outcome is Outcome.SUCCEEDED, result
        assert [latch.closed for latch in setup.board.truth().latches] == [True, True, False]
        deployed = [servo.output_rad for servo in setup.servos.truth().values()]
        setup.controller.step()
        assert setup.servos.register(1, "goal_pwm") == round(0.5 * 885)  # what is latched is held with less
        setup.controller.stow()
        assert setup.controller.run().succeeded
        assert [latch.closed for latch in setup.board.truth().latches] == [False, False, True]
        stowed = [servo.output_rad for servo in setup.servos.truth().values()]
        assert (np.abs(np.subtract(deployed, stowed)) > 1.0).all()


def test_passive_magnets_close_where_servos_on_the_other_bus_stand(tmp_path: Path) -> None:
    """Without the link their sensors would say closed all the way, which is a fault at once."""
    with mixed(tmp_path, {"kind": "magnet", "timeout_s": 2.0, "capture_range_rad": 0.05}, linked=True) as setup:
        for command, closed in ((setup.controller.deploy, True), (setup.controller.stow, False)):
            command()
            result = setup.controller.run()
            assert result.outcome is Outcome.SUCCEEDED, result
            assert setup.board.truth().latches[1].closed is closed


def test_a_latch_board_that_falls_silent_stops_the_servos_along_the_path(tmp_path: Path) -> None:
    with mixed(tmp_path) as setup:
        setup.controller.deploy()
        for _ in range(50):
            setup.controller.step()
        assert setup.controller.state is State.MOVING
        setup.board.unplug()
        result = setup.controller.run()
        assert result.fault is not None
        assert result.fault.kind is FaultKind.BUS_CLOSED
        folds = [servo.output_rad for servo in setup.servos.truth().values()]
        assert len(folds) == 3
        setup.board.replug()
        setup.controller.clear_fault()
        assert setup.controller.state is State.DISCONNECTED
        setup.controller.connect()
        setup.controller.arm()
        setup.controller.deploy()
        assert setup.controller.run().succeeded


def test_the_boards_emergency_stop_stops_the_servos(tmp_path: Path) -> None:
    with mixed(tmp_path) as setup:
        setup.controller.deploy()
        for _ in range(50):
            setup.controller.step()
        setup.board.estop()
        place = setup.controller.step().commanded_fold
        result = setup.controller.run()
        assert result.fault is not None
        assert "emergency stop" in str(result.fault)
        last = setup.controller.step()
        assert place < last.commanded_fold < place + 0.2  # along the path, and no farther
        assert np.ptp(last.folds) < 0.02  # all in step
        setup.board.estop(False)
        for _ in range(10):
            setup.controller.step()
        setup.controller.clear_fault()
        setup.controller.deploy()
        assert setup.controller.run().succeeded
