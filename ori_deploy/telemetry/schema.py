"""What is in a log: one JSON schema per channel, as Foxglove reads them.

Numbers that are not known are null. Times are seconds on the controller's monotonic clock, as are the
message times, in nanoseconds.
"""

from __future__ import annotations

from typing import Any

_NUMBER = {"type": "number"}
_INTEGER = {"type": "integer"}
_STRING = {"type": "string"}
_BOOLEAN = {"type": "boolean"}


def _list_of(item: dict[str, str]) -> dict[str, Any]:
    return {"type": "array", "items": item}


_FAULT: dict[str, dict[str, Any]] = {
    "time_s": _NUMBER,
    "kind": _STRING,
    "thing": _STRING,
    "detail": _STRING,
    "remedy": _STRING,
}

CHANNELS: dict[str, dict[str, dict[str, Any]]] = {
    "/plan_info": {
        "schema": _STRING,
        "version": _STRING,
        "design_name": _STRING,
        "design_sha256": _STRING,
        "plan_sha256": _STRING,
        "rig_sha256": _STRING,
        "rig_file": _STRING,
        "seed": _INTEGER,
        "rate_hz": _NUMBER,
        "cell_ids": _list_of(_STRING),
        "hinge_ids": _list_of(_STRING),
        "latch_ids": _list_of(_STRING),
        "driven_creases": _list_of(_STRING),
        "shaft_per_crease": _list_of(_NUMBER),
        "zero_rad": _list_of(_NUMBER),
    },
    "/cycle": {
        "index": _INTEGER,
        "time_s": _NUMBER,
        "lateness_s": _NUMBER,
        "state": _STRING,
        "stage": _STRING,
        "path_time_s": _NUMBER,
        "rate": _NUMBER,
        "rate_limit": _NUMBER,
        "commanded_fold": _NUMBER,
        "lost_replies": _INTEGER,
        "overruns": _INTEGER,
        "valid": _list_of(_BOOLEAN),
        "fold": _list_of(_NUMBER),
        "commanded_rad": _list_of(_NUMBER),
        "position_rad": _list_of(_NUMBER),
        "velocity_rad_s": _list_of(_NUMBER),
        "current_a": _list_of(_NUMBER),
        "age_s": _list_of(_NUMBER),
    },
    "/health": {
        "time_s": _NUMBER,
        "valid": _list_of(_BOOLEAN),
        "temperature_c": _list_of(_NUMBER),
        "voltage_v": _list_of(_NUMBER),
        "hardware_error": _list_of(_INTEGER),
        "torque_on": _list_of(_BOOLEAN),
    },
    "/state": {"time_s": _NUMBER, "source": _STRING, "event": _STRING, "target": _STRING},
    "/latch": {
        "time_s": _NUMBER,
        "id": _STRING,
        "engaged": _BOOLEAN,
        "confirmed": _BOOLEAN,
        "valid": _BOOLEAN,
        "fault": _STRING,
    },
    "/fault": _FAULT,
    "/result": {
        "command": _STRING,
        "outcome": _STRING,
        "state": _STRING,
        "fault": {"type": "object", "properties": _FAULT},
        "duration_s": _NUMBER,
        "cycles": _INTEGER,
        "overruns": _INTEGER,
        "lost_replies": _INTEGER,
        "worst_tracking_rad": _NUMBER,
        "worst_tracking_hinge": _STRING,
        "observer_errors": _list_of(_STRING),
    },
}
"""Properties of the messages of every channel."""

SCHEMA = "ori-deploy/log/1"
"""Written into `/plan_info`; a reader refuses any other."""


def json_schema(channel: str) -> dict[str, Any]:
    """The JSON schema of a channel's messages."""
    return {"title": channel, "type": "object", "properties": CHANNELS[channel]}
