"""Reading a flight log back, whole or cut off by a crash."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Footer, Message
from mcap.stream_reader import CRCValidationError, StreamReader
from numpy.typing import NDArray
from zstandard import ZstdError

from ori_deploy.actuators.bus import LatchReading
from ori_deploy.deploy.result import Fault, FaultKind, MotionResult, Outcome
from ori_deploy.deploy.states import Event, State, Transition
from ori_deploy.errors import FileError
from ori_deploy.telemetry.schema import SCHEMA

FloatArray = NDArray[np.float64]

_CUT_OFF = (EndOfFile, struct.error, ZstdError, CRCValidationError)


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
        with Path(path).open("rb") as stream:
            complete = _collect(stream, messages)
    except OSError as error:
        raise FileError(
            "the log cannot be read", value=error.strerror, remedy="check the path", source=source
        ) from error
    except (McapError, ValueError) as error:
        raise FileError("this is not a flight log", value=error, remedy="give an .mcap log", source=source) from error
    info = messages.get("/plan_info", [{}])[0]
    if info.get("schema") != SCHEMA or not messages.get("/cycle"):
        raise FileError(
            "this is not a flight log with cycles in it",
            value=info.get("schema"),
            limit=f"schema {SCHEMA}",
            remedy="give a log written by ori-deploy",
            source=source,
        )
    return _run(complete, info, messages)


def _collect(stream: IO[bytes], messages: dict[str, list[dict[str, Any]]]) -> bool:
    """Sort all messages by channel; whether the file was complete."""
    topics: dict[int, str] = {}
    try:
        for record in StreamReader(stream, validate_crcs=True).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                messages.setdefault(topics[record.channel_id], []).append(json.loads(record.data))
            elif isinstance(record, Footer):
                return True
    except _CUT_OFF:
        pass  # by a crash, mostly in the middle of a chunk: what came before is whole
    return False


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
            Transition(row["time_s"], State(row["source"]), Event(row["event"]), State(row["target"]))
            for row in messages.get("/state", [])
        ),
        latches=tuple(LatchReading(**row) for row in messages.get("/latch", [])),
        faults=tuple(_fault(row) for row in messages.get("/fault", [])),
        results=tuple(_result(row) for row in messages.get("/result", [])),
    )


def _fault(row: dict[str, Any]) -> Fault:
    return Fault(**{**row, "kind": FaultKind(row["kind"])})


def _result(row: dict[str, Any]) -> MotionResult:
    typed = {
        "outcome": Outcome(row["outcome"]),
        "state": State(row["state"]),
        "fault": _fault(row["fault"]) if row["fault"] else None,
        "observer_errors": tuple(row["observer_errors"]),
    }
    return MotionResult(**{**row, **typed})
