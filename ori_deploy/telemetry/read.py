"""Reading a flight log back, whole or cut off by a crash."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import LatchReading
from ori_deploy.deploy.result import Fault, FaultKind, MotionResult, Outcome
from ori_deploy.deploy.states import Event, State, Transition
from ori_deploy.errors import FileError
from ori_deploy.telemetry.log import CLOSED
from ori_deploy.telemetry.messages import BROKEN, FloatArray, Found, collect
from ori_deploy.telemetry.schema import CHANNELS, FAMILY, READABLE


@dataclass(frozen=True, eq=False)
class Run:
    """A flight log as arrays over cycles, (n,) or (n, n_hinges); NaN where nothing was known.

    Attributes
    ----------
    complete
        False for a log that was cut off or is damaged.
    unread
        What of its file is damaged and was not read, for people; "" for all that was written.
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
    unread: str
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

    @property
    def after_gap(self) -> NDArray[np.int64]:
        """Rows before which rows are missing, or the link was given up: goals of the rows before them are void."""
        left = [t.time_s for t in self.transitions if t.target is State.DISCONNECTED]
        rows = np.searchsorted(self.time_s, left, side="right")
        if self.dropped or self.unread:
            rows = np.append(rows, 1 + np.flatnonzero(np.diff(self.time_s) > 1.5 / float(self.info["rate_hz"])))
        rows = np.unique(rows)
        return rows[(rows > 0) & (rows < len(self.time_s))]

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
            due[self.after_gap] = np.nan
            return due
        for rows in np.split(np.arange(len(time_s)), self.after_gap):
            due[rows] = _queued(time_s[rows], commanded[rows], delay_s)
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
    unread
        As in `Run`.
    """

    info: Mapping[str, Any]
    versions: Mapping[str, Any]
    files: Mapping[str, str]
    tape: tuple[bytes, ...]
    cut_off: bool
    unread: str


def read_run(path: str | Path) -> Run:
    """Read a log.

    Raises
    ------
    FileError
        The file cannot be read, is not a log of this program, or holds no cycle.
    """
    source = str(path)
    try:
        found = _read(source, with_tape=False)
        if not found.columns["/cycle"]:
            raise _no_log(source, found, "cycles")
        run = _run(found)
        _check(run)
    except BROKEN as error:
        raise _damaged(source, error) from error
    except MemoryError as error:
        raise _too_large(source) from error
    return run


def read_recording(path: str | Path) -> Recording:
    """Read the tape of a log, and what it was made with.

    Raises
    ------
    FileError
        As `read_run`; the log is an old one that has no tape; or a file in it is not what its digest says.
    """
    source = str(path)
    try:
        found = _read(source, with_tape=True)
        if found.info["schema"] == READABLE[0]:
            raise FileError(
                "this log holds no tape",
                value=found.info["schema"],
                limit=READABLE[-1],
                remedy="only runs recorded since then can be replayed; ori-deploy report reads it",
                source=source,
            )
        if not found.tape:
            raise _no_log(source, found, "tape")
        _check_info(found.info)
        files = {str(row["name"]): _whole_text(row) for row in found.messages.get("/file", [])}
        complete = found.finished and _ending(found.messages) in ("", CLOSED)
        return Recording(found.info, _versions(found.messages), files, tuple(found.tape), not complete, found.unread)
    except BROKEN as error:
        raise _damaged(source, error) from error
    except MemoryError as error:
        raise _too_large(source) from error


def _read(source: str, *, with_tape: bool) -> Found:
    try:
        data = Path(source).read_bytes()
    except OSError as error:
        raise FileError(
            "the log cannot be read", value=error.strerror, remedy="check the path", source=source
        ) from error
    found = collect(data, with_tape=with_tape)
    if found.info.get("schema") not in READABLE:
        raise _no_log(source, found, "cycles")
    return found


def _no_log(source: str, found: Found, what: str) -> FileError:
    schema = str(found.info.get("schema", ""))
    limit = f"MCAP, schema {' or '.join(READABLE)}"
    if schema in READABLE:
        thing = f"this log has no {what}"
        value, remedy = "a session in which nothing was carried out", "there is nothing to tell; see what it said"
    elif schema.startswith(FAMILY):
        thing, value, remedy = "a log of another version", schema, "read it with the ori-deploy that wrote it"
    elif found.unread:
        thing, value = "the log is damaged: what says of what it is is lost", found.unread
        remedy = "give an undamaged copy"
    else:
        thing, value = "this is not a flight log", found.is_a
        remedy = "give a log that deploy, stow, recover or serve wrote with --log"
    error = FileError(thing, value=value, limit=limit, remedy=remedy, source=source)
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


def _too_large(source: str) -> FileError:
    return FileError(
        "too little memory to read the log",
        value=f"{1e-6 * Path(source).stat().st_size:.0f} MB packed",
        remedy="close other programs, or read it on a larger machine",
        source=source,
    )


def _whole_text(row: Mapping[str, Any]) -> str:
    text = str(row["text"])
    if sha256(text.encode()).hexdigest() != row["sha256"]:
        raise ValueError(f"{row['name']} is not what its digest says")
    return text


_PER_CYCLE = CHANNELS["/cycle"].keys() - {"index", "state", "stage"}

_LATELY = {"delay_s"}
"""Of `/plan_info`, what older logs do not have."""


def _check(run: Run) -> None:
    """Raise ValueError, TypeError or KeyError for what no writer of logs would have written."""
    _check_info(run.info)
    count = len(run.info["hinge_ids"])
    if not (np.isfinite(run.time_s).all() and (np.diff(run.time_s) >= 0.0).all()):
        raise ValueError("cycles are not in the order of their times")
    for name in ("valid", "fold", "commanded_rad", "position_rad", "velocity_rad_s", "current_a", "age_s"):
        _check_shape(name, getattr(run, name).shape, (len(run.time_s), count))
    for name in ("lateness_s", "path_time_s", "rate", "rate_limit", "commanded_fold", "lost_replies", "overruns"):
        _check_shape(name, getattr(run, name).shape, (len(run.time_s),))
    if len(run.health_time_s):
        for name in ("temperature_c", "voltage_v"):
            _check_shape(name, getattr(run, name).shape, (len(run.health_time_s), count))
    for state in set(run.state):
        State(state)


def _check_info(info: Mapping[str, Any]) -> None:
    """As `_check`, of `/plan_info` alone."""
    if missing := CHANNELS["/plan_info"].keys() - info.keys() - _LATELY:
        raise KeyError(*sorted(missing))
    count = len(info["hinge_ids"])
    if not count:
        raise ValueError("a run without hinges")
    for name in ("cell_ids", "driven_creases", "zero_rad", "shaft_per_crease"):
        _check_shape(f"{name} of the plan", np.shape(info[name]), (count,))
    for name in ("cell_ids", "hinge_ids", "driven_creases", "latch_ids"):
        if not all(isinstance(one, str) for one in info[name]):
            raise TypeError(f"{name} of the plan are not all texts")
    numbers = np.array([info["zero_rad"], info["shaft_per_crease"]], dtype=np.float64)
    if not np.isfinite(numbers).all() or not numbers[1].all():
        raise ValueError("zero_rad and shaft_per_crease of the plan have to be numbers, and the second not 0")
    np.array([info["rate_hz"], info.get("delay_s", 0.0)], dtype=np.float64)


def _check_shape(name: str, found: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    if found != wanted:
        raise ValueError(f"{name} has shape {found}, not {wanted}")


def _queued(time_s: FloatArray, commanded: FloatArray, delay_s: float) -> FloatArray:
    """(n, n_hinges) goals that are due at times, of those that were sent so long before; NaN where none was."""
    due = np.full_like(commanded, np.nan)
    for hinge, there in enumerate(np.isfinite(commanded).T):
        if there.any():
            at = time_s - delay_s
            due[:, hinge] = np.interp(at, time_s[there], commanded[there, hinge], left=np.nan, right=np.nan)
            due[np.interp(at, time_s, there) < 1.0, hinge] = np.nan
    return due


def _run(found: Found) -> Run:
    messages, cycles = found.messages, found.columns["/cycle"]
    health, timing = found.columns["/health"], found.columns["/timing"]
    ending = _ending(messages)
    return Run(
        complete=found.finished and not found.unread and ending in ("", CLOSED),
        unread=found.unread,
        info=found.info,
        state=cycles.texts("state"),
        stage=cycles.texts("stage"),
        **{name: cycles.numbers(name) for name in _PER_CYCLE},
        health_time_s=health.numbers("time_s"),
        temperature_c=health.numbers("temperature_c"),
        voltage_v=health.numbers("voltage_v"),
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
        timing={name: timing.numbers(name) for name in (CHANNELS["/timing"] if timing else ())},
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
    if not isinstance(row["command"], str):
        raise TypeError("the command of a result is no text")
    typed = {
        "outcome": Outcome(row["outcome"]),
        "state": State(row["state"]),
        "fault": _fault(row["fault"]) if row["fault"] else None,
        "duration_s": _number(row["duration_s"]),
        "worst_tracking_rad": _number(row["worst_tracking_rad"]),
        "observer_errors": tuple(row["observer_errors"]),
    }
    return MotionResult(**{**row, **typed})
