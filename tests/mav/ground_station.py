"""A ground station that nobody here wrote: MAVSDK, system 255 and component 190, told over standard input.

    python tests/mav/ground_station.py --link udpout://127.0.0.1:14550

Waits for the vehicle (`event ready`), then answers each line with `ok …` or `error: why`; what comes by itself is
told as `event …`: every COMMAND_ACK, every STATUSTEXT, and the `final` answer to a command or that there was none.

    long COMPONENT COMMAND [PARAM…]  COMMAND_LONG, sent again by MAVSDK until it is acknowledged
    int COMPONENT COMMAND [PARAM…]   COMMAND_INT likewise; four parameters, then x, y and z
    send NAME JSON                   any message of the dialect, once
    get COMPONENT NAME               a parameter
    set COMPONENT NAME VALUE         a whole number is set as one; 1.0 is not
    dialect FILE                     learn the messages of a dialect's XML
    watch NAME                       tell every message of a name as `event message NAME JSON`
    quit                             as does the end of the input
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

from lines import Order, acknowledged, say, serve
from mavsdk import Configuration, Mavsdk, System
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.param import Param, ParamError, ParamResult, ProtocolVersion

SYSTEM, COMPONENT, VEHICLE = 255, 190, 1


class Station:
    """What a line of input can ask for."""

    def __init__(self, vehicle: System) -> None:
        self._vehicle = vehicle
        self._direct = MavlinkDirect(vehicle)
        self._params: dict[int, Param] = {}
        self._direct.subscribe_message("COMMAND_ACK", lambda message, _: say(f"event ack {acknowledged(message)}"))
        self._direct.subscribe_message("STATUSTEXT", lambda message, _: say(f"event text {_text(message)}"))

    def command_long(self, component: str, command: str, *params: str) -> None:
        names = [f"param{k}" for k in range(1, 8)]
        self._command("COMMAND_LONG", component, command, _named(names, params) | {"confirmation": 0})

    def command_int(self, component: str, command: str, *params: str) -> None:
        fields = _named([*(f"param{k}" for k in range(1, 5)), "x", "y", "z"], params)
        fields |= {name: int(fields[name]) for name in "xy"}
        self._command("COMMAND_INT", component, command, fields | {"frame": 0, "current": 0, "autocontinue": 0})

    def send(self, name: str, *fields: str) -> None:
        self._direct.send_message(_message(name, json.loads(" ".join(fields))))

    def param_get(self, component: str, name: str) -> str:
        params = self._of(int(component))
        try:
            return repr(params.get_param_float(name))
        except ParamError as error:
            if error.result != ParamResult.WRONG_TYPE:
                raise
            return repr(params.get_param_int(name))

    def param_set(self, component: str, name: str, value: str) -> None:
        params = self._of(int(component))
        if value.lstrip("-").isdigit():
            params.set_param_int(name, int(value))
        else:
            params.set_param_float(name, float(value))

    def dialect(self, file: str) -> None:
        self._direct.load_custom_xml(Path(file).read_text())

    def watch(self, name: str) -> None:
        self._direct.subscribe_message(name, lambda message, _: say(f"event message {name} {message.fields_json}"))

    def _command(self, name: str, component: str, command: str, fields: dict[str, Any]) -> None:
        fields |= {"target_system": VEHICLE, "target_component": int(component), "command": int(command)}
        self._direct.send_command_async(_message(name, fields), lambda result, ack, _: say(_final(result, ack)))

    def _of(self, component: int) -> Param:
        """A plugin per component: MAVSDK keeps the values it has seen."""
        if component not in self._params:
            params = Param(self._vehicle)
            try:
                params.select_component(component, ProtocolVersion.V1)
            except ParamError as error:  # 4.1.0 selects it and says UNKNOWN all the same
                if error.result != ParamResult.UNKNOWN:
                    raise
            self._params[component] = params
        return self._params[component]


def _named(names: list[str], values: tuple[str, ...]) -> dict[str, Any]:
    padded = [float(value) for value in values] + [0.0] * (len(names) - len(values))
    return dict(zip(names, padded, strict=True))


def _message(name: str, fields: dict[str, Any]) -> MavlinkMessage:
    to = (fields.get("target_system", 0), fields.get("target_component", 0))
    return MavlinkMessage(name, SYSTEM, COMPONENT, *to, json.dumps(fields))


def _text(message: MavlinkMessage) -> str:
    fields = json.loads(message.fields_json)
    return f"component={message.component_id} severity={fields['severity']} {fields['text']}"


def _final(result: Any, ack: MavlinkMessage) -> str:
    return f"event final {acknowledged(ack) if ack.fields_json else result.name}"


def find(mavsdk: Mavsdk) -> System:
    """The vehicle, as soon as anything of it has sent a heartbeat."""
    while True:
        for system in mavsdk.get_systems():
            if system.get_system_id() == VEHICLE:
                return system
        time.sleep(0.05)


def main() -> None:
    """Until the input ends."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--link", required=True, help="as MAVSDK writes them: udpout://, udpin://, tcpout://, …")
    asked = arguments.parse_args()
    with Mavsdk(Configuration.create_manual(SYSTEM, COMPONENT, True)) as mavsdk:
        mavsdk.add_any_connection_with_handle(asked.link)
        station = Station(find(mavsdk))
        orders: dict[str, Order] = {
            "long": station.command_long,
            "int": station.command_int,
            "send": station.send,
            "get": station.param_get,
            "set": station.param_set,
            "dialect": station.dialect,
            "watch": station.watch,
        }
        serve(orders)


if __name__ == "__main__":
    main()
