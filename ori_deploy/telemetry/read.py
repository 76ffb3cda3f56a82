"""Reading a flight log back, whole or cut off by a crash."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Footer, Message
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray
from zstandard import ZstdError

from ori_deploy.actuators.bus import LatchReading
from ori_deploy.deploy.result import Fault, FaultKind, MotionResult, Outcome
from ori_deploy.deploy.states import Event, State, Transition
from ori_deploy.errors import FileError
from ori_deploy.telemetry.schema import CHANNELS, SCHEMA

FloatArray = NDArray[np.float64]

_BROKEN = (
    McapError,
    struct.error,
    ZstdError,
    KeyError,
    TypeError,
    ValueError,
    OverflowError,
    MemoryError,
    RuntimeError,  # from lz4, and RecursionError
)
"""What parsing bytes can end in when they are not what was written."""


@dataclass(frozen=True, eq=False)
class Run:
    """A flight log as arrays over cycles, (n,) or (n, n_hinges); NaN where nothing was known.

    Attributes
    ----------
    complete
        False for a log that was cut off.
    info
        Design, plan, rig, versions: the message of `/plan_info`.
    time_s, lateness_s
        Begin of every cycle, and how late it was.
    state, stage
        Names, per cycle; a stage is "" when nothing was being carried out.
    path_time_s, rate, rate_limit, commanded_fold, lost_replies, overruns
        As in `CycleRecord`.
    valid, fold, position_rad, velocity_rad_s, current_a, age_s
        Measured at the begin of the cycle.
    commanded_rad
        Shaft goals sent in the cycle, after measuring.
    health_time_s, temperature_c, voltage_v
        (m,) and (m, n_hinges), at their own rate.
    transitions, latches, faults, results
        In order; times of latch readings are those of the cycle.
    """

    complete: bool
    info: Mapping[str, Any]
    time_s: FloatArray
    lateness_s: FloatArray
    state: tuple[str, ...]
    stage: tuple[str, ...]
    path_time_s: FloatArray
    rate: FloatArray
    rate_limit: FloatArray
    commanded_fold: FloatArray
    lost_replies: NDArray[np.int64]
    overruns: NDArray[np.int64]
    valid: NDArray[np.bool_]
    fold: FloatArray
    commanded_rad: FloatArray
    position_rad: FloatArray
    velocity_rad_s: FloatArray
    current_a: FloatArray
    age_s: FloatArray
    health_time_s: FloatArray
    temperature_c: FloatArray
    voltage_v: FloatArray
    transitions: tuple[Transition, ...]
    latches: tuple[LatchReading, ...]
    faults: tuple[Fault, ...]
    results: tuple[MotionResult, ...]

    @property
    def commanded_crease_rad(self) -> FloatArray:
        """(n, n_hinges) goals as angles of the driven creases."""
        return self._crease(self.commanded_rad)

    @property
    def measured_crease_rad(self) -> FloatArray:
        """(n, n_hinges) measured angles of the driven creases."""
        return self._crease(self.position_rad)

    @property
    def tracking_error_rad(self) -> FloatArray:
        """(n, n_hinges) measured minus commanded at the driven creases; NaN in the first cycle.

        What is measured in a cycle answers to the goals of the cycle before.
        """
        error = np.full_like(self.position_rad, np.nan)
        error[1:] = self.measured_crease_rad[1:] - self.commanded_crease_rad[:-1]
        return error

    def _crease(self, shaft_rad: FloatArray) -> FloatArray:
        crease: FloatArray = (shaft_rad - np.array(self.info["zero_rad"])) / np.array(self.info["shaft_per_crease"])
        return crease


def read_run(path: str | Path) -> Run:
    """Read a log.

    Raises
    ------
    FileError
        The file cannot be read, is not a log of this program, or holds no cycle.
    """
    source = str(path)
    messages: dict[str, list[dict[str, Any]]] = {}
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise FileError(
            "the log cannot be read", value=error.strerror, remedy="check the path", source=source
        ) from error
    complete, cause = _collect(data, messages)
    info = messages.get("/plan_info", [{}])[0]
    if info.get("schema") != SCHEMA or not messages.get("/cycle"):
        raise FileError(
            "this is not a flight log with cycles in it",
            value=info.get("schema", repr(cause) if cause else None),
            limit=f"schema {SCHEMA}",
            remedy="give a log written by ori-deploy",
            source=source,
        ) from cause
    try:
        run = _run(complete, info, messages)
        _check(run)
    except _BROKEN as error:
        raise FileError(
            "the log is damaged",
            value=f"{type(error).__name__}: {error}",
            limit="messages as ori-deploy writes them",
            remedy="give an undamaged copy",
            source=source,
        ) from error
    return run


def _collect(data: bytes, messages: dict[str, list[dict[str, Any]]]) -> tuple[bool, Exception | None]:
    """Sort all messages by channel; whether the file was complete and whole, and what ended it if not.

    A message that cannot be decoded is left out. What cannot be read as a record ends the log: after a
    crash that is mostly in the middle of a chunk, and what came before is whole.
    """
    topics: dict[int, str] = {}
    first: Exception | None = None
    try:
        for record in StreamReader(BytesIO(data), validate_crcs=True).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                try:
                    messages.setdefault(topics[record.channel_id], []).append(_decode(record.data))
                except _BROKEN as error:
                    first = first or error
            elif isinstance(record, Footer):
                return first is None, first
    except _BROKEN as error:
        return False, first or error
    return False, first


def _decode(data: bytes) -> dict[str, Any]:
    message = json.loads(data)
    if not isinstance(message, dict):
        raise TypeError(f"a message is a {type(message).__name__}, not an object")
    return message


def _check(run: Run) -> None:
    """Raise ValueError, TypeError or KeyError for what no writer of logs would have written."""
    if missing := CHANNELS["/plan_info"].keys() - run.info.keys():
        raise KeyError(*sorted(missing))
    count = len(run.info["hinge_ids"])
    for name in ("cell_ids", "zero_rad", "shaft_per_crease"):
        _check_shape(f"{name} of the plan", np.shape(run.info[name]), (count,))
    np.array([run.info["zero_rad"], run.info["shaft_per_crease"]], dtype=np.float64)
    for name in ("valid", "fold", "commanded_rad", "position_rad", "velocity_rad_s", "current_a", "age_s"):
        _check_shape(name, getattr(run, name).shape, (len(run.time_s), count))
    for name in ("lateness_s", "path_time_s", "rate", "rate_limit", "commanded_fold", "lost_replies", "overruns"):
        _check_shape(name, getattr(run, name).shape, (len(run.time_s),))
    if len(run.health_time_s):
        for name in ("temperature_c", "voltage_v"):
            _check_shape(name, getattr(run, name).shape, (len(run.health_time_s), count))
    for state in set(run.state):
        State(state)


def _check_shape(name: str, found: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    if found != wanted:
        raise ValueError(f"{name} has shape {found}, not {wanted}")


def _run(complete: bool, info: Mapping[str, Any], messages: dict[str, list[dict[str, Any]]]) -> Run:
    cycles, health = messages["/cycle"], messages.get("/health", [])

    def numbers(rows: list[dict[str, Any]], name: str) -> FloatArray:
        return np.array([row[name] for row in rows], dtype=np.float64)  # null becomes NaN

    return Run(
        complete=complete,
        info=info,
        state=tuple(row["state"] for row in cycles),
        stage=tuple(row["stage"] for row in cycles),
        lost_replies=np.array([row["lost_replies"] for row in cycles], dtype=np.int64),
        overruns=np.array([row["overruns"] for row in cycles], dtype=np.int64),
        valid=np.array([row["valid"] for row in cycles], dtype=np.bool_),
        time_s=numbers(cycles, "time_s"),
        lateness_s=numbers(cycles, "lateness_s"),
        path_time_s=numbers(cycles, "path_time_s"),
        rate=numbers(cycles, "rate"),
        rate_limit=numbers(cycles, "rate_limit"),
        commanded_fold=numbers(cycles, "commanded_fold"),
        fold=numbers(cycles, "fold"),
        commanded_rad=numbers(cycles, "commanded_rad"),
        position_rad=numbers(cycles, "position_rad"),
        velocity_rad_s=numbers(cycles, "velocity_rad_s"),
        current_a=numbers(cycles, "current_a"),
        age_s=numbers(cycles, "age_s"),
        health_time_s=numbers(health, "time_s"),
        temperature_c=numbers(health, "temperature_c"),
        voltage_v=numbers(health, "voltage_v"),
        transitions=tuple(
            Transition(_number(row["time_s"]), State(row["source"]), Event(row["event"]), State(row["target"]))
            for row in messages.get("/state", [])
        ),
        latches=tuple(
            LatchReading(**{**row, "time_s": _number(row["time_s"])}) for row in messages.get("/latch", [])
        ),
        faults=tuple(_fault(row) for row in messages.get("/fault", [])),
        results=tuple(_result(row) for row in messages.get("/result", [])),
    )


def _number(value: Any) -> float:
    """A number of a message: null becomes NaN."""
    return math.nan if value is None else float(value)


def _fault(row: dict[str, Any]) -> Fault:
    return Fault(**{**row, "kind": FaultKind(row["kind"]), "time_s": _number(row["time_s"])})


def _result(row: dict[str, Any]) -> MotionResult:
    typed = {
        "outcome": Outcome(row["outcome"]),
        "state": State(row["state"]),
        "fault": _fault(row["fault"]) if row["fault"] else None,
        "duration_s": _number(row["duration_s"]),
        "worst_tracking_rad": _number(row["worst_tracking_rad"]),
        "observer_errors": tuple(row["observer_errors"]),
    }
    return MotionResult(**{**row, **typed})
