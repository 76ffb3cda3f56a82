"""What the bus says goes into a fault once, and a bus that fails while it brakes is no further fault."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from ori_deploy.actuators.bus import ActuatorBus, ActuatorFault, BusClosed, BusError, BusTimeout
from ori_deploy.clock import VirtualClock
from ori_deploy.deploy.link import Link
from ori_deploy.deploy.result import Fault


class Failing:
    """A bus of which every call fails in one way."""

    hinge_ids: tuple[str, ...] = ("a",)
    latch_ids: tuple[str, ...] = ()
    delay_s = 0.3

    def __init__(self, error: BusError) -> None:
        self._error = error

    def command_hinges(self, *_: object) -> None:
        raise self._error

    def brake(self) -> float:
        raise self._error


def link(error: BusError) -> tuple[Link, list[Fault]]:
    faults: list[Fault] = []

    def trip(fault: Fault) -> None:
        """As the controller: whatever trips brakes."""
        faults.append(fault)
        made.brake()

    made = Link(cast(ActuatorBus, Failing(error)), trip, VirtualClock(), 0.1)
    return made, faults


def test_a_fault_says_who_what_and_the_remedy_once() -> None:
    one, faults = link(ActuatorFault("servo_1", "did not follow; limit: 0.3 rad; remedy: free it"))
    one.command_hinges(np.zeros(1), np.zeros(1), 0.0)
    assert str(faults[0]) == "hardware_error: servo_1: did not follow; limit: 0.3 rad; remedy: free it"


def test_without_a_remedy_it_points_to_the_message() -> None:
    one, faults = link(BusTimeout("nobody answers"))
    one.command_hinges(np.zeros(1), np.zeros(1), 0.0)
    assert str(faults[0]) == "bus_error: bus: nobody answers; remedy: see the message"


@pytest.mark.parametrize(("error", "lost"), [(BusTimeout("silent"), False), (BusClosed("gone"), True)])
def test_a_bus_that_fails_to_brake_is_no_further_fault(error: BusError, lost: bool) -> None:
    one, faults = link(error)
    assert one.brake() == 0.3
    assert one.lost is lost
    assert faults == []
