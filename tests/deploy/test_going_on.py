"""Every fault ends with the command that leads on, on the backend that it is of."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.going_on import reset_command, with_next_step
from ori_deploy.deploy.result import Fault, FaultKind
from ori_deploy.deploy.states import State
from tests.deploy.synthetic import bench

FAULT = Fault(FaultKind.PATH_TOLERANCE, "servo_1", "is off", "free it", 0.0)


def rig(backend: str) -> ResolvedRig:
    wiring = SimpleNamespace(hinges=(SimpleNamespace(id=7),)) if backend == "dynamixel" else None
    made: Any = SimpleNamespace(backend=backend, wiring=wiring, source="rig.toml")
    return cast(ResolvedRig, made)


@pytest.mark.parametrize(
    ("backend", "told"),
    [
        ("mock", "free it, then give the command again"),
        ("dynamixel", "free it, then give the command again"),
        ("mcu", "free it, then ori-deploy mcu clear-fault --rig rig.toml, then give the command again"),
    ],
)
def test_a_remedy_ends_with_what_leads_on(backend: str, told: str) -> None:
    assert with_next_step(FAULT, rig(backend)).remedy == told


def test_what_a_board_says_already_is_not_said_twice() -> None:
    own = replace(FAULT, remedy="release it, then ori-deploy mcu clear-fault --port /dev/ttyACM0")
    assert with_next_step(own, rig("mcu")).remedy == f"{own.remedy}, then give the command again"
    restarted = replace(FAULT, remedy="check the supply, then give the command again")
    assert with_next_step(restarted, rig("mock")).remedy == restarted.remedy


def test_an_error_of_a_servos_own_has_the_command_that_resets_it() -> None:
    assert reset_command(rig("dynamixel"), 0) == "ori-deploy bus reset-error 7 --rig rig.toml"
    assert reset_command(rig("mcu"), 0) == "ori-deploy mcu clear-fault --rig rig.toml"
    assert reset_command(rig("mock"), 0) is None


def test_cells_out_of_step_are_sent_to_recover() -> None:
    remedy = with_next_step(replace(FAULT, kind=FaultKind.OUT_OF_STEP), rig("dynamixel")).remedy
    assert "give the command again; " in remedy
    assert remedy.endswith("ori-deploy recover")


def test_every_latched_fault_is_told_so() -> None:
    b = bench()
    b.controller.deploy()
    b.step_until_fold(0.3)
    b.controller.emergency_stop()
    b.step_to_rest()
    assert b.controller.state is State.FAULT
    assert b.controller.fault is not None
    assert b.controller.fault.remedy == "see why it was pressed, then give the command again"
