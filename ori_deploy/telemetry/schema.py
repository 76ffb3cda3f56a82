"""What is in a log: one JSON schema per channel, as Foxglove reads them, and one channel of bytes.

Numbers that are not known are null. Times are seconds on the controller's monotonic clock, as are the
message times, in nanoseconds. What the controller was told and what it did about it is on the channel `TAPE`,
in the form of `ori_deploy.telemetry.tape`: exact, and safe to read whoever wrote it.
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
        "delay_s": _NUMBER,
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
    "/command": {
        "time_s": _NUMBER,
        "command": _STRING,
        "arguments": _STRING,
        "outcome": _STRING,
        "detail": _STRING,
        "state": _STRING,
    },
    "/timing": {
        "time_s": _NUMBER,
        "lateness_s": _NUMBER,
        "wait_s": _NUMBER,
        "read_s": _NUMBER,
        "send_s": _NUMBER,
        "decide_s": _NUMBER,
        "record_s": _NUMBER,
    },
    "/versions": {
        "ori_deploy": _STRING,
        "python": _STRING,
        "numpy": _STRING,
        "platform": _STRING,
        "machine": _STRING,
        "processors": _INTEGER,
        "affinity": _list_of(_INTEGER),
        "scheduling": _STRING,
        "clock": _STRING,
        "begun_utc": _STRING,
    },
    "/file": {"name": _STRING, "sha256": _STRING, "text": _STRING},
    "/recorder": {"time_s": _NUMBER, "dropped": _INTEGER, "ending": _STRING},
}
"""Properties of the messages of every channel.

`/command`: what the operator asked for; `outcome` is "done", "refused" or "interrupted", `arguments` JSON.
`/timing`: where the time of a cycle went, on the wall whatever the controller's clock; `record_s` is what handing
the cycle before to the recorder took. `/file`: the plan and the rig as they were. `/recorder`: records that were
dropped since the log began, whenever that changes, and at the end how the log ended: "closed", or why not.
"""

TAPE = "/tape"
TAPE_ENCODING = "ori-deploy-tape"

FAMILY = "ori-deploy/log/"
SCHEMA = f"{FAMILY}2"
"""Written into `/plan_info`."""

READABLE = (f"{FAMILY}1", SCHEMA)
"""Schemas that are read; the first has no tape, and knows nothing of commands, timing and dropped records."""


def json_schema(channel: str) -> dict[str, Any]:
    """The JSON schema of a channel's messages."""
    return {"title": channel, "type": "object", "properties": CHANNELS[channel]}
