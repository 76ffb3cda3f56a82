"""Programs told over standard input: what the autopilot and the ground station, run as scripts, have in common."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any

Order = Callable[..., str | None]

_output = threading.Lock()


def say(line: str) -> None:
    """A whole line at once: MAVSDK calls back on threads of its own."""
    with _output:
        print(line, flush=True)


def serve(orders: Mapping[str, Order]) -> None:
    """Answer line after line, until `quit` or the end of the input."""
    say("event ready")
    for line in sys.stdin:
        if line.strip() == "quit":
            break
        if line.strip():
            say(_obey(orders, line))


def acknowledged(message: Any) -> str:
    """A COMMAND_ACK in a line."""
    fields = json.loads(message.fields_json)
    names = ("command", "result", "progress", "result_param2")
    return " ".join([f"component={message.component_id}", *(f"{name}={fields.get(name)}" for name in names)])


def _obey(orders: Mapping[str, Order], line: str) -> str:
    name, *words = line.split()
    if name not in orders:
        return f"error: no order {name!r}; one of {', '.join(orders)}"
    try:
        told = orders[name](*words)
    except Exception as error:  # noqa: BLE001 - whoever typed the line is told, whatever it is
        return f"error: {error!r}"
    return "ok" if told is None else f"ok {told}"
