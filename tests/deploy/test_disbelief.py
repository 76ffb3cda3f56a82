"""What cannot be believed is not acted on: not a number, of long ago, or never said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.deploy.result import FaultKind, StartRefused
from ori_deploy.deploy.states import State
from tests.deploy.synthetic import bench
from tests.deploy.test_faults import ends_in_fault, under_way


def test_a_reading_that_is_not_a_number_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    b = bench()
    sound = b.bus._read_hinges()
    position = sound.position_rad.copy()
    position[2] = np.nan
    monkeypatch.setattr(b.bus, "_read_hinges", lambda: replace(sound, position_rad=position))
    with pytest.raises(StartRefused, match="no valid position from servo_c3"):
        b.controller.deploy()
    with pytest.raises(CommandRefused, match="servo_c3"):
        b.bus.enable_torque()


def test_torque_does_not_go_on_at_an_old_position(monkeypatch: pytest.MonkeyPatch) -> None:
    b = bench(armed=False)
    b.controller.connect()
    old = b.bus.read_hinges()
    b.clock.sleep_until(b.clock.now() + 60.0)
    monkeypatch.setattr(b.bus, "_read_hinges", lambda: old)
    with pytest.raises(CommandRefused, match="torque stays off"):
        b.controller.arm()
    assert not b.bus.true_torque_on.any()
    assert b.controller.state is State.READY


@pytest.mark.parametrize("what", ["temperature_c", "voltage_v"])
def test_health_that_is_not_a_number_is_none(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    b = under_way()
    health = replace(b.bus.read_health(), **{what: np.array([20.0, 20.0, 20.0, np.nan])})
    monkeypatch.setattr(b.bus, "_read_health", lambda: health)
    ends_in_fault(b, FaultKind.LOST_REPLIES, "servo_c4")


def test_health_that_never_comes_is_a_fault_and_no_start() -> None:
    b = under_way()
    b.bus.silence_health(10**6)
    ends_in_fault(b, FaultKind.LOST_REPLIES, "servo_c1")
    b = bench()
    b.bus.silence_health(10**6)
    with pytest.raises(StartRefused, match="no valid health"):
        b.controller.deploy()


def test_latches_that_raise_are_a_timeout_and_revoke_deployed() -> None:
    b = bench()
    b.controller.deploy()
    while b.controller.step().stage != "latch":
        pass
    b.bus.silence_latches(10**6)
    ends_in_fault(b, FaultKind.LATCH_TIMEOUT, "latch_slit:P-T2")
    b = bench()
    b.controller.deploy()
    assert b.controller.run().succeeded
    b.bus.silence_latches(10**6)
    assert b.steps(20).state is State.FAULT
    assert b.controller.fault is not None
    assert b.controller.fault.kind is FaultKind.LOST_REPLIES


def test_a_reply_lost_in_the_first_cycle_has_no_effect() -> None:
    b = bench()
    b.controller.deploy()
    b.bus.drop_replies("servo_c2", 1)
    assert b.controller.run().succeeded


@pytest.mark.parametrize("command", ["deploy", "stow"])
def test_nothing_is_secured_before_a_look_at_the_health(command: str) -> None:
    b = bench(start="deployed" if command == "stow" else "stowed", controller={"health_period_s": 10.0})
    getattr(b.controller, command)()
    b.step_until_fold(0.5)
    b.bus.sag(4.0)
    ends_in_fault(b, FaultKind.LOW_VOLTAGE, "servo_c1")
    assert not {State.DEPLOYED, State.STOWED} & {record.state for record in b.records}
