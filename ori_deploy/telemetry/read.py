"""Reading a flight log back, whole or cut off by a crash."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Footer, Message
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray
from zstandard import ZstdError

from ori_deploy.actuators.bus import LatchReading
from ori_deploy.deploy.result import Fault, FaultKind, MotionResult, Outcome
from ori_deploy.deploy.states import Event, State, Transition
from ori_deploy.errors import FileError
from ori_deploy.telemetry.log import CLOSED
from ori_deploy.telemetry.schema import CHANNELS, READABLE, TAPE

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
    commands
        What the operator asked for, in order: messages of `/command`.
    timing
        Where the time of the cycles went: arrays over cycles, by the names of `/timing`; none in old logs.
    versions
        What it ran on: the message of `/versions`; empty in old logs.
    dropped
        Records that did not get through to the recorder.
    ending
        "closed", why the log ended otherwise, or "" where it does not say.
    files
        Plan and rig as they were, by name; none in old logs.
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
    commands: tuple[Mapping[str, Any], ...]
    timing: Mapping[str, FloatArray]
    versions: Mapping[str, Any]
    dropped: int
    ending: str
    files: Mapping[str, str]

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
        """(n, n_hinges) measured at the driven creases, minus what was due then; NaN where that is not known."""
        return self.measured_crease_rad - self._due_crease_rad()

    def _due_crease_rad(self) -> FloatArray:
        """What is measured in a cycle answers to the goals of the cycle before, or to those that were queued then.

        Behind a queue nothing is known after a fault, until goals that were sent since are due: a device brakes
        along goals that nobody sent.
        """
        commanded, time_s = self.commanded_crease_rad, self.time_s
        delay_s = float(self.info.get("delay_s", 0.0))  # old logs do not say
        due = np.full_like(commanded, np.nan)
        if delay_s == 0.0:
            due[1:] = commanded[:-1]
            if self.dropped:  # the row before may be of another cycle than the one before
                due[1:][np.diff(time_s) > 1.5 / float(self.info["rate_hz"])] = np.nan
            return due
        sent = np.isfinite(commanded)
        for hinge, there in enumerate(sent.T):
            if there.any():
                due[:, hinge] = np.interp(
                    time_s - delay_s, time_s[there], commanded[there, hinge], left=np.nan, right=np.nan
                )
                due[np.interp(time_s - delay_s, time_s, there) < 1.0, hinge] = np.nan
        faulted = np.array([state == State.FAULT for state in self.state])
        due[time_s - np.maximum.accumulate(np.where(faulted, time_s, -np.inf)) <= delay_s] = np.nan
        return due

    def _crease(self, shaft_rad: FloatArray) -> FloatArray:
        crease: FloatArray = (shaft_rad - np.array(self.info["zero_rad"])) / np.array(self.info["shaft_per_crease"])
        return crease


@dataclass(frozen=True)
class Recording:
    """What a log holds to decide its run again.

    Attributes
    ----------
    info, versions
        As in `Run`.
    files
        Plan and rig as they were, by name; texts whose digests are right.
    tape
        The pieces of the tape, in order.
    cut_off
        Whether the log ends before its session did.
    """

    info: Mapping[str, Any]
    versions: Mapping[str, Any]
    files: Mapping[str, str]
    tape: tuple[bytes, ...]
    cut_off: bool


def read_run(path: str | Path) -> Run:
    """Read a log.

    Raises
    ------
    FileError
        The file cannot be read, is not a log of this program, or holds no cycle.
    """
    source = str(path)
    found = _read(source)
    if not found.messages.get("/cycle"):
        raise _no_log(source, found, "with cycles in it")
    try:
        run = _run(found.complete, found.info, found.messages)
        _check(run)
    except _BROKEN as error:
        raise _damaged(source, error) from error
    return run


def read_recording(path: str | Path) -> Recording:
    """Read the tape of a log, and what it was made with.

    Raises
    ------
    FileError
        As `read_run`; the log is an old one that has no tape; or a file in it is not what its digest says.
    """
    source = str(path)
    found = _read(source)
    if found.info["schema"] == READABLE[0]:
        raise FileError(
            "this log holds no tape",
            value=found.info["schema"],
            limit=READABLE[-1],
            remedy="only runs recorded since then can be replayed; ori-deploy report reads it",
            source=source,
        )
    if not found.tape:
        raise _no_log(source, found, "with a tape in it")
    try:
        files = {str(row["name"]): _whole_text(row) for row in found.messages.get("/file", [])}
        complete = found.complete and _ending(found.messages) in ("", CLOSED)
        return Recording(found.info, _versions(found.messages), files, tuple(found.tape), not complete)
    except _BROKEN as error:
        raise _damaged(source, error) from error


@dataclass
class _Found:
    """Messages by channel, the tape, whether the file was complete and whole, and what ended it if not."""

    messages: dict[str, list[dict[str, Any]]]
    tape: list[bytes]
    complete: bool = False
    cause: Exception | None = None
    begins: bytes = b""

    @property
    def info(self) -> Mapping[str, Any]:
        return self.messages.get("/plan_info", [{}])[0]

    @property
    def is_a(self) -> str:
        """What sort of file it is, for people."""
        if not self.begins:
            return "an empty file"
        if self.begins != MCAP0_MAGIC:
            return "a file of another kind"
        if "schema" not in self.info:
            return "another program's MCAP file" if self.complete else "one that was cut off before its first message"
        schema = str(self.info["schema"])
        return schema if schema not in READABLE else f"{schema}, in which nothing was carried out"


def _read(source: str) -> _Found:
    try:
        data = Path(source).read_bytes()
    except OSError as error:
        raise FileError(
            "the log cannot be read", value=error.strerror, remedy="check the path", source=source
        ) from error
    found = _collect(data)
    if found.info.get("schema") not in READABLE:
        raise _no_log(source, found, "with cycles in it")
    return found


def _no_log(source: str, found: _Found, what: str) -> FileError:
    error = FileError(
        f"this is not a flight log {what}",
        value=found.is_a,
        limit=f"MCAP, schema {' or '.join(READABLE)}",
        remedy="give a log that deploy, stow or recover wrote with --log",
        source=source,
    )
    error.__cause__ = found.cause
    return error


def _damaged(source: str, error: Exception) -> FileError:
    return FileError(
        "the log is damaged",
        value=f"{type(error).__name__}: {error}",
        limit="messages as ori-deploy writes them",
        remedy="give an undamaged copy",
        source=source,
    )


def _whole_text(row: Mapping[str, Any]) -> str:
    text = str(row["text"])
    if sha256(text.encode()).hexdigest() != row["sha256"]:
        raise ValueError(f"{row['name']} is not what its digest says")
    return text


def _collect(data: bytes) -> _Found:
    """Sort all messages by channel.

    A message that cannot be decoded is left out. What cannot be read as a record ends the log: after a
    crash that is mostly in the middle of a chunk, and what came before is whole.
    """
    topics: dict[int, str] = {}
    found = _Found({}, [], begins=data[: len(MCAP0_MAGIC)])
    try:
        for record in StreamReader(BytesIO(data), validate_crcs=True).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                try:
                    if (topic := topics[record.channel_id]) == TAPE:
                        found.tape.append(record.data)
                    else:
                        found.messages.setdefault(topic, []).append(_decode(record.data))
                except _BROKEN as error:
                    found.cause = found.cause or error
            elif isinstance(record, Footer):
                found.complete = found.cause is None
                return found
    except _BROKEN as error:
        found.cause = found.cause or error
    return found


def _decode(data: bytes) -> dict[str, Any]:
    message = json.loads(data)
    if not isinstance(message, dict):
        raise TypeError(f"a message is a {type(message).__name__}, not an object")
    return message


_LATELY = {"delay_s"}
"""Of `/plan_info`, what older logs do not have."""


def _check(run: Run) -> None:
    """Raise ValueError, TypeError or KeyError for what no writer of logs would have written."""
    if missing := CHANNELS["/plan_info"].keys() - run.info.keys() - _LATELY:
        raise KeyError(*sorted(missing))
    count = len(run.info["hinge_ids"])
    for name in ("cell_ids", "zero_rad", "shaft_per_crease"):
        _check_shape(f"{name} of the plan", np.shape(run.info[name]), (count,))
    np.array([run.info["zero_rad"], run.info["shaft_per_crease"]], dtype=np.float64)
    np.array([run.info["rate_hz"], run.info.get("delay_s", 0.0)], dtype=np.float64)
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

    timing = messages.get("/timing", [])
    ending = _ending(messages)
    return Run(
        complete=complete and ending in ("", CLOSED),
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
        commands=tuple(_command(row) for row in messages.get("/command", [])),
        timing={name: numbers(timing, name) for name in (CHANNELS["/timing"] if timing else ())},
        versions=_versions(messages),
        dropped=max((int(row["dropped"]) for row in messages.get("/recorder", [])), default=0),
        ending=ending,
        files={str(row["name"]): str(row["text"]) for row in messages.get("/file", [])},
    )


def _ending(messages: Mapping[str, list[dict[str, Any]]]) -> str:
    rows = messages.get("/recorder", [])
    return str(rows[-1]["ending"]) if rows else ""


def _versions(messages: Mapping[str, list[dict[str, Any]]]) -> Mapping[str, Any]:
    return messages.get("/versions", [{}])[0]


def _command(row: dict[str, Any]) -> Mapping[str, Any]:
    """A command, with all its keys and nothing but texts in them."""
    return {key: _number(row[key]) if key == "time_s" else str(row[key]) for key in CHANNELS["/command"]}


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
