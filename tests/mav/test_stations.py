"""The stations of others, against a component that is nothing but pymavlink."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pymavlink import mavutil

from tests.mav.stations import WING, Autopilot, MavProxy, MavsdkStation

mavlink = mavutil.mavlink
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
USER_1 = 31010
DENIED = mavlink.MAV_RESULT_DENIED


class Component:
    """Acknowledges USER_1 with progress, denies anything else, has one parameter and remembers what it heard."""

    def __init__(self) -> None:
        self._link = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=1, source_component=WING)
        self.port: int = self._link.port.getsockname()[1]
        self.value = 1.5
        self.heard: list[Any] = []
        self._cursor = 0
        self._changed = threading.Condition()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._link.close()

    def hears(self, kind: str, right: Callable[[Any], bool] = lambda _: True, within: float = 20.0) -> Any:
        """The next such message after the last one that was waited for."""
        deadline = time.monotonic() + within
        with self._changed:
            while True:
                for number in range(self._cursor, len(self.heard)):
                    if self.heard[number].get_type() == kind and right(self.heard[number]):
                        self._cursor = number + 1
                        return self.heard[number]
                left = deadline - time.monotonic()
                assert left > 0.0, f"no such {kind} among {[str(m) for m in self.heard[self._cursor :]]}"
                self._changed.wait(left)

    def catches_up(self) -> None:
        """Whatever was sent to it by now has been heard: the datagrams of the loopback keep their order."""
        marker = mavutil.mavlink_connection(f"udpout:127.0.0.1:{self.port}", source_system=99)
        marker.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4)
        self.hears("HEARTBEAT", lambda message: message.get_srcSystem() == 99)
        marker.close()

    def since(self) -> list[str]:
        """The kinds of messages after the last one that was waited for."""
        return [message.get_type() for message in self.heard[self._cursor :]]

    def arm(self, flag: int) -> None:
        """Command the autopilot as a ground station does."""
        self._link.mav.command_long_send(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, flag, 0, 0, 0, 0, 0, 0)

    def _serve(self) -> None:
        beat = mavutil.periodic_event(2.0)
        while not self._ended.is_set():
            if beat.trigger() and self._link.clients:
                self._link.mav.heartbeat_send(mavlink.MAV_TYPE_SERVO, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4)
            message = self._link.recv_match(blocking=True, timeout=0.1)
            if message is not None:
                self._answer(message)
                with self._changed:
                    self.heard.append(message)
                    self._changed.notify_all()

    def _answer(self, message: Any) -> None:
        if getattr(message, "target_component", 0) != WING:
            return
        kind, sender = message.get_type(), (message.get_srcSystem(), message.get_srcComponent())
        if kind in ("COMMAND_LONG", "COMMAND_INT"):
            final = mavlink.MAV_RESULT_ACCEPTED if message.command == USER_1 else DENIED
            for result, percent in ((mavlink.MAV_RESULT_IN_PROGRESS, 40), (final, 100)):
                self._link.mav.command_ack_send(message.command, result, percent, 7, *sender)
        if kind == "PARAM_SET":
            self.value = message.param_value
        if kind.startswith("PARAM_"):
            self._link.mav.param_value_send(b"ORI_TEST", self.value, mavlink.MAV_PARAM_TYPE_REAL32, 1, 0)


@pytest.fixture
def component() -> Iterator[Component]:
    made = Component()
    yield made
    made.close()


def _from_autopilot(message: Any) -> bool:
    return (message.get_srcSystem(), message.get_srcComponent()) == (1, 1)


def _armed(flag: bool) -> Callable[[Any], bool]:
    return lambda message: _from_autopilot(message) and bool(message.base_mode & ARMED) is flag


def _landed(state: int) -> Callable[[Any], bool]:
    return lambda message: _from_autopilot(message) and message.landed_state == state


@pytest.mark.slow
def test_the_autopilot_says_whether_it_is_armed_and_where(component: Component) -> None:
    with Autopilot(component.port) as autopilot:
        component.hears("HEARTBEAT", _armed(False))
        component.hears("EXTENDED_SYS_STATE", _landed(mavlink.MAV_LANDED_STATE_ON_GROUND))
        autopilot.landed("in_air")
        component.hears("EXTENDED_SYS_STATE", _landed(mavlink.MAV_LANDED_STATE_IN_AIR))
        autopilot.armed(True)
        component.hears("HEARTBEAT", _armed(True))
        autopilot.armed(False)
        component.hears("HEARTBEAT", _armed(False))


@pytest.mark.slow
def test_the_autopilot_falls_silent_and_comes_back(component: Component) -> None:
    with Autopilot(component.port) as autopilot:
        component.hears("HEARTBEAT", _armed(False))
        autopilot.landed("none")
        component.catches_up()
        before = len(component.heard)
        for _ in range(2):
            component.hears("HEARTBEAT", _from_autopilot)
        assert "EXTENDED_SYS_STATE" not in [message.get_type() for message in component.heard[before:]]
        autopilot.silent()
        component.catches_up()
        time.sleep(2.2)  # room for two heartbeats
        assert component.since() == []
        autopilot.speak()
        component.hears("HEARTBEAT", _from_autopilot)


def test_the_autopilot_asks_for_leave_to_arm(component: Component) -> None:
    with Autopilot(component.port) as autopilot:
        component.hears("HEARTBEAT", _from_autopilot)
        assert autopilot.authorize() == DENIED


def test_the_autopilot_arms_when_told_to_unless_it_may_not(component: Component) -> None:
    with Autopilot(component.port) as autopilot:
        component.hears("HEARTBEAT", _armed(False))
        autopilot.tell("armable 0")
        component.arm(1)
        assert component.hears("COMMAND_ACK").result != mavlink.MAV_RESULT_ACCEPTED
        autopilot.tell("armable 1")
        component.arm(1)
        assert component.hears("COMMAND_ACK").result == mavlink.MAV_RESULT_ACCEPTED
        autopilot.wait_for("^event arm 1")
        component.hears("HEARTBEAT", _armed(True))


def test_an_order_the_autopilot_does_not_know_is_an_error(component: Component) -> None:
    with Autopilot(component.port) as autopilot, pytest.raises(AssertionError, match="no order 'loop'"):
        autopilot.tell("loop")


@pytest.mark.slow
def test_mavproxy_commands_the_component_and_shows_its_answers(component: Component) -> None:
    with MavProxy(component.port) as station:
        station.command(USER_1, 1, 2)
        asked = component.hears("COMMAND_LONG")
        assert (asked.target_system, asked.target_component, asked.command) == (1, WING, USER_1)
        assert (asked.param1, asked.param2) == (1.0, 2.0)
        assert [station.acknowledged() for _ in range(2)] == ["IN_PROGRESS", "ACCEPTED"]


@pytest.mark.slow
def test_mavproxy_sets_and_shows_parameters(component: Component) -> None:
    with MavProxy(component.port) as station:
        assert station.parameters() == 1
        assert station.parameter("ORI_TEST") == 1.5
        station.send("param set ORI_TEST 2.5")
        component.hears("PARAM_SET")
        assert component.value == 2.5


@pytest.mark.parametrize("kind", ["long", "int"])
def test_mavsdk_commands_the_component_and_shows_its_answers(component: Component, kind: Any) -> None:
    with MavsdkStation(component.port) as station:
        station.command(USER_1, 1, kind=kind)
        station.wait_for(f"^event ack component={WING} command={USER_1} result=5 progress=40 result_param2=7")
        assert station.final() == mavlink.MAV_RESULT_ACCEPTED
        station.command(31011, kind=kind)
        assert station.final() == DENIED


def test_mavsdk_sets_and_gets_parameters(component: Component) -> None:
    with MavsdkStation(component.port) as station:
        assert station.tell(f"get {WING} ORI_TEST") == "1.5"
        station.tell(f"set {WING} ORI_TEST 2.5")
        assert component.value == 2.5
