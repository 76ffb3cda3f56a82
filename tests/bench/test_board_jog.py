"""One servo of a scripted board is turned in virtual time, and nothing else is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ori_deploy.actuators.bus import ActuatorFault, BusTimeout, CommandRefused
from ori_deploy.actuators.mcu.line import McuLine
from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.bench.board import Board, board_on, release
from ori_deploy.bench.board_jog import Jog, Jogged, carry_out, plan_jog
from ori_deploy.wire.generated import ori_deploy as d
from tests.actuators.mcu.scripted import ScriptedDevice, SteppedClock, VirtualPort
from tests.actuators.mcu.setups import SERVO, config, electromagnet, wiring


class Setup:
    """A board with three hinges that stand at 0."""

    def __init__(self, made: McuWiring | None = None, **script: Any) -> None:
        self.wiring = made or wiring()
        self.clock = SteppedClock()
        self.device = ScriptedDevice(config(self.wiring), self.clock.now, **script)
        port = VirtualPort(self.device, self.clock)
        port.open()
        hinges = [hinge.name for hinge in self.wiring.hinges]
        latches = [latch.name for latch in self.wiring.latches]
        line = McuLine(port, self.clock, 0.03)  # type: ignore[arg-type]
        self.board: Board = board_on(line, self.clock, 0.3, hinges, latches)

    def plan(self, name: str = "b", rate: float = 0.5, by: float | None = None, to: float | None = None) -> Jog:
        return plan_jog(self.board, self.wiring, name, rate, by_rad=by, to_rad=to)

    def go(self, jog: Jog, stop_after: int = 10**6, *, let_go: bool = False) -> Jogged:
        looks = iter(range(10**7))
        stop = lambda: next(looks) >= stop_after  # noqa: E731
        return carry_out(self.board, self.wiring, jog, 50.0, self.clock, stop, release=let_go)

    def later(self, delay_s: float, what: Any) -> None:
        self.device._later.append((self.clock.now() + delay_s, what))


def test_one_hinge_goes_a_smooth_way_and_holds_while_the_others_stay_off() -> None:
    one = Setup()
    done = one.go(one.plan(by=-0.4))
    assert (done.arrived, done.holds, done.told_rad) == (True, True, -0.4)
    assert done.measured_rad == pytest.approx(-0.4)
    assert one.device.outputs_on == 0b010
    assert one.device.fault == d.ORI_FAULT_NONE
    places = 1e-6 * np.array([knot.position[:3] for knot in one.device.taken])
    speeds = 1e-3 * np.array([knot.velocity[:3] for knot in one.device.taken])
    assert not np.delete(speeds, 1, axis=1).any()
    assert np.ptp(np.delete(places, 1, axis=1), axis=0).max() == 0.0
    assert (np.diff(places[:, 1]) <= 0.0).all()
    assert 0.4 < np.abs(speeds).max() < 0.51
    assert not speeds[-1].any()


def test_what_holds_goes_on_holding_where_it_is() -> None:
    one = Setup()
    one.go(one.plan("a", to=0.3))
    jog = one.plan("b", by=0.2)
    assert jog.others_on == ("a",)
    one.go(jog, let_go=True)
    assert one.device.outputs_on == 0b001
    assert one.device.asked[:2] == [300_000, 200_000]


def test_stopping_brakes_and_leaves_no_fault() -> None:
    one = Setup()
    done = one.go(one.plan(by=1.0), stop_after=60)
    assert not done.arrived
    assert done.holds
    assert 0.0 < done.told_rad < 0.9
    assert done.told_rad == pytest.approx(1e-6 * one.device.asked[1])
    assert one.device.fault == d.ORI_FAULT_NONE


@pytest.mark.parametrize(
    ("way", "words"),
    [
        ({"name": "x", "by": 0.1}, "no hinge 'x'.*limit: one of a, b, c"),
        ({"to": 2.5}, r"would go to 2\.5000 rad; limit: -2 to 2 rad"),
        ({"by": 0.1, "rate": 4.0}, "limit: more than 0, to max_velocity_rad_s = 3 rad/s"),
    ],
)
def test_what_leaves_the_limits_of_the_rig_is_refused(way: dict[str, Any], words: str) -> None:
    one = Setup()
    with pytest.raises(CommandRefused, match=words):
        one.plan(**way)
    assert one.device.outputs_on == 0


def test_a_fault_or_a_missing_wire_is_refused() -> None:
    for script, words in (
        ({"fault": d.ORI_FAULT_ESTOP, "state": d.ORI_FAULTED}, "nothing moves: .*emergency stop"),
        ({"silent": 0b010}, "b does not say where it is.* at A1"),
    ):
        with pytest.raises(CommandRefused, match=words):
            Setup(**script).plan(by=0.1)
    blind = wiring(hinge=[{"actuator": "b", "output": 5, "open_loop": True, **SERVO}])
    with pytest.raises(CommandRefused, match="no feedback wire, and would jump"):
        Setup(blind).plan(by=0.1)


def test_a_stall_and_silence_are_told() -> None:
    one = Setup()
    jog = one.plan(by=1.0)
    one.later(1.0, lambda: one.device.stall(1))
    with pytest.raises(ActuatorFault, match=r"^b: did not follow"):
        one.go(jog)
    one = Setup()
    jog = one.plan(by=1.0)
    one.later(1.0, lambda: setattr(one.device, "dead", True))
    with pytest.raises(BusTimeout):
        one.go(jog)


def test_torque_off_releases_every_hinge_and_latches_on_request() -> None:
    one = Setup(wiring(latches=(electromagnet("em"),)))
    one.go(one.plan(by=0.1))
    one.device.latches[0].engaged = True
    assert one.board.hinges_on() == ("b",)
    assert release(one.board, with_latches=False) == ()
    assert one.device.outputs_on == 0
    assert one.device.latches[0].engaged
    assert release(one.board, with_latches=True) == ("em",)
    assert not one.device.latches[0].engaged


def test_torque_stays_on_while_anything_moves() -> None:
    one = Setup()
    jog = one.plan(by=1.0)
    refused: list[str] = []

    def stop() -> bool:
        if one.device.state != d.ORI_STREAMING or refused:
            return False
        for what in (lambda: release(one.board, with_latches=False), lambda: one.plan(by=0.1)):
            with pytest.raises(CommandRefused, match="the microcontroller is streaming") as told:
                what()
            refused.append(str(told.value))
        return True

    carry_out(one.board, one.wiring, jog, 50.0, one.clock, stop)
    assert len(refused) == 2
    assert one.device.outputs_on == 0b010
