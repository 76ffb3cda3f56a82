"""An autopilot that nobody here wrote: MAVSDK's own servers, system 1 and component 1, told over standard input.

    python tests/mav/autopilot.py --link udpout://127.0.0.1:14550

Each line of input is answered with `ok` or `error: why`; what happens by itself is told as `event …`.

    armed 0|1            the armed flag of the heartbeat's base mode
    armable 0|1          whether a ground station's command to arm is accepted
    landed STATE         unknown, on_ground, in_air, taking_off, landing; `none` ends EXTENDED_SYS_STATE
    authorize COMPONENT  ask a component for leave to arm, once its heartbeat is heard; its answer comes as an event
    silent / speak       off the network and back
    quit                 as does the end of the input
"""

from __future__ import annotations

import argparse
import json
import threading
from typing import Any

from lines import acknowledged, say, serve
from mavsdk import Configuration, Mavsdk
from mavsdk.plugins.action_server import ActionServer
from mavsdk.plugins.mavlink_direct_server import MavlinkDirectServer, MavlinkMessage
from mavsdk.plugins.telemetry_server import LandedState, TelemetryServer, VtolState

SYSTEM, COMPONENT = 1, 1
ARM_AUTHORIZATION_REQUEST = 3001


class Autopilot:
    """Heartbeats by MAVSDK itself at 1 Hz; the landed state by a thread here."""

    def __init__(self, link: str, period: float) -> None:
        self._link = link
        self._mavsdk = Mavsdk(Configuration.create_manual(SYSTEM, COMPONENT, True))
        component = self._mavsdk.server_component()
        self._action = ActionServer(component)
        self._telemetry = TelemetryServer(component)
        self._direct = MavlinkDirectServer(component)
        self._landed: LandedState | None = LandedState.ON_GROUND
        self._connection: Any = None
        self._speaking = threading.RLock()
        self._heard: set[int] = set()
        self._heard_another = threading.Condition()
        self._ended = threading.Event()
        self._publisher = threading.Thread(target=self._publish, args=(period,))

    def start(self) -> None:
        """Before the link is there, so that the first heartbeat says what is so."""
        self._action.subscribe_arm_disarm(lambda _result, asked, _: say(f"event arm {int(asked.arm)}"))
        self._direct.subscribe_message("COMMAND_ACK", lambda message, _: say(f"event ack {acknowledged(message)}"))
        self._direct.subscribe_message("HEARTBEAT", lambda message, _: self._hear(message))
        self.armable("1")
        self.speak()
        self._publisher.start()

    def armed(self, flag: str) -> None:
        self._action.set_armed_state(bool(int(flag)))

    def armable(self, flag: str) -> None:
        self._action.set_armable(bool(int(flag)), False)
        self._action.set_disarmable(True, True)

    def landed(self, state: str) -> None:
        with self._speaking:
            self._landed = None if state == "none" else LandedState[state.upper()]
            self._publish_once()

    def authorize(self, component: str) -> None:
        """As PX4 asks before it arms when told to; MAVSDK has no call for this side of it.

        What MAVSDK is to send to a component it has not heard yet it drops, and reports success.
        """
        with self._heard_another:
            if not self._heard_another.wait_for(lambda: int(component) in self._heard, 10.0):
                raise LookupError(f"component {component} has sent no heartbeat; heard: {sorted(self._heard)}")
        fields: dict[str, float] = {f"param{k}": 0.0 for k in range(1, 8)}
        fields |= {"target_system": SYSTEM, "target_component": int(component), "confirmation": 0}
        fields |= {"command": ARM_AUTHORIZATION_REQUEST, "param1": float(SYSTEM)}
        self._direct.send_message(
            MavlinkMessage("COMMAND_LONG", SYSTEM, COMPONENT, SYSTEM, int(component), json.dumps(fields))
        )

    def silent(self) -> None:
        """Not even heartbeats: MAVSDK has no way to stop those but to take its link away."""
        with self._speaking:
            if self._connection is not None:
                self._mavsdk.remove_connection(self._connection)
                self._connection = None

    def speak(self) -> None:
        with self._speaking:
            if self._connection is None:
                self._connection = self._mavsdk.add_any_connection_with_handle(self._link)

    def close(self) -> None:
        self._ended.set()
        if self._publisher.is_alive():
            self._publisher.join()
        self._mavsdk.destroy()

    def _hear(self, message: MavlinkMessage) -> None:
        with self._heard_another:
            if message.system_id == SYSTEM:
                self._heard.add(message.component_id)
            self._heard_another.notify_all()

    def _publish(self, period: float) -> None:
        while not self._ended.wait(period):
            with self._speaking:
                self._publish_once()

    def _publish_once(self) -> None:
        if self._connection is not None and self._landed is not None:
            self._telemetry.publish_extended_sys_state(VtolState.UNDEFINED, self._landed)


def main() -> None:
    """Until the input ends."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--link", required=True, help="as MAVSDK writes them: udpout://, udpin://, tcpout://, …")
    arguments.add_argument("--period", type=float, default=0.25, help="seconds between EXTENDED_SYS_STATEs")
    asked = arguments.parse_args()
    autopilot = Autopilot(asked.link, asked.period)
    names = ("armed", "armable", "landed", "authorize", "silent", "speak")
    orders = {name: getattr(autopilot, name) for name in names}
    autopilot.start()
    try:
        serve(orders)
    finally:
        autopilot.close()


if __name__ == "__main__":
    main()
