"""Who else is on the network: the autopilot and what it says of itself, and the stations that may command."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from ori_deploy.mav.links import Heard
from ori_deploy.mav.words import Vehicle
from ori_deploy.wire.vehicle import dialect

ASK_AGAIN_S = 5.0
"""How often an autopilot that does not say whether it has landed is asked to."""
LANDED_EVERY_US = 500_000
TOLD_EVERY_S, CHANGE_EVERY_S = 0.2, 0.02


class Autopilot:
    """The vehicle's autopilot.

    Parameters
    ----------
    system, component
        Whose word counts.
    fresh_s
        How old its word may be.

    Attributes
    ----------
    vehicle
        What it said last.
    """

    def __init__(self, system: int, component: int, fresh_s: float) -> None:
        self._system, self._component, self._fresh_s = system, component, fresh_s
        self.vehicle = Vehicle()
        self._asked_s = self._told_s = -math.inf
        self._told = Vehicle()

    def heard(self, heard: Heard, now: float) -> None:
        """Any message; only the autopilot's own about itself count."""
        if (heard.system, heard.component) != (self._system, self._component):
            return
        message = heard.message
        if isinstance(message, dialect.MAVLink_heartbeat_message):
            armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
            self.vehicle = replace(self.vehicle, armed=armed, armed_s=now)
        elif isinstance(message, dialect.MAVLink_extended_sys_state_message):
            self.vehicle = replace(self.vehicle, landed=message.landed_state, landed_s=now)

    def news(self, now: float) -> Vehicle | None:
        """What the loop has to be told: changes in its next cycles, the rest a few times a second.

        However fast somebody makes the autopilot's word change, the loop is not kept busy with it.
        """
        vehicle, told = self.vehicle, self._told
        if vehicle == told:
            return None
        changed = (vehicle.armed, vehicle.landed) != (told.armed, told.landed)
        if now - self._told_s < (CHANGE_EVERY_S if changed else TOLD_EVERY_S):
            return None
        self._told, self._told_s = vehicle, now
        return vehicle

    def question(self, now: float) -> dialect.MAVLink_message | None:
        """What to ask of an autopilot that lives, and does not say whether it has landed."""
        lives = self.vehicle.armed_s is not None and now - self.vehicle.armed_s <= self._fresh_s
        told = self.vehicle.landed_s is not None and now - self.vehicle.landed_s <= self._fresh_s
        if not lives or told or now - self._asked_s < ASK_AGAIN_S:
            return None
        self._asked_s = now
        return dialect.MAVLink_command_long_message(
            target_system=self._system,
            target_component=self._component,
            command=dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
            confirmation=0,
            param1=dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
            param2=LANDED_EVERY_US,
            param3=0.0,
            param4=0.0,
            param5=0.0,
            param6=0.0,
            param7=0.0,
        )


class Stations:
    """When each system that may command was heard last."""

    def __init__(self, commanders: frozenset[int]) -> None:
        self._commanders = commanders
        self._heard_s: dict[int, float] = {}

    def heard(self, heard: Heard, now: float) -> None:
        """Any message is a sign of life."""
        if heard.system in self._commanders:
            self._heard_s[heard.system] = now

    def silent(self, systems: Iterable[int], timeout_s: float, now: float) -> bool:
        """Whether none of these has been heard for so long."""
        return all(now - self._heard_s.get(system, -math.inf) > timeout_s for system in systems)
