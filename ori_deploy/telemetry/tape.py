"""The tape: all that went over the controller's boundary, in order and exact, so that a run can be decided again.

A tape is a row of entries. The first byte of an entry says what it is; numbers are little-endian, float64 to the
last bit. What happens every cycle is packed; what is rare is JSON with a length in front.

====  ==========================================================================================================
n     the clock was read: value
w     slept: deadline
r     the hinges were read: n, position, velocity, current, time (n float64 each), alert, valid (n bytes each)
h     the health was read: n, temperature, voltage, time (n float64 each), error, torque, valid (n bytes each)
l     the latches were read: JSON, a list of the fields of each
g     goals were sent: n, whether with velocities, positions, velocities
d     `due_s`: now, value
j     any other call of bus or journal, or one that raised: JSON [name, arguments, "value" or "error", what came]
s     `step` was called
p     a property of the controller was read, and read the clock: its name
c     any other command: JSON [name, positional arguments, named arguments]
e     the command ended, unless it was a step that did not raise: JSON, see `Tape.ended`
f     since the record before: JSON {"fault": ..., "transitions": [...]}
x     a cycle was decided: index; time, path time, rate, rate limit, commanded fold; folds; state, stage, fault or not
====  ==========================================================================================================
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from struct import Struct
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators import bus as bus_module
from ori_deploy.actuators.bus import ActuatorFault, BusError, HealthReadings, HingeReadings, LatchReading
from ori_deploy.deploy.journal import Entry as JournalEntry
from ori_deploy.deploy.result import CycleRecord, Fault
from ori_deploy.motion.recovery import Recovery

FloatArray = NDArray[np.float64]

_NUMBER = Struct("<cd")
_PAIR = Struct("<cdd")
_COUNT = Struct("<cH")
_GOALS = Struct("<cH?")
_TEXT = Struct("<cI")
_NAME = Struct("<cB")
_DECIDED = Struct("<cIdddddHBB?")
PIECE = Struct("<Q")
"""In front of every piece of a tape: its number, so that a missing one is noticed."""


class _Nowhere(bytearray):
    """What is written here is gone."""

    def __iadd__(self, _: Any, /) -> Self:  # type: ignore[misc]  # nothing else of `bytearray` is used of it
        return self

    def __setitem__(self, at: Any, written: Any, /) -> None:
        """Nothing is kept."""


class Tape:
    """Takes down what happens, until `take` hands it over.

    Attributes
    ----------
    data
        Entries that were not handed over yet.
    woke, wait_s, read_s, send_s
        When the last sleep ended, how long it was, and how long the bus was read and written since; on
        `time.perf_counter`.
    """

    def __init__(self) -> None:
        self.data = bytearray()
        self.woke = self.wait_s = self.read_s = self.send_s = 0.0
        self._pieces = 0
        self._fault: Fault | None = None

    def take(self) -> bytes:
        """What was taken down since the last time, as one piece."""
        piece = PIECE.pack(self._pieces) + self.data
        self._pieces += 1
        self.data.clear()
        return piece

    def stop(self) -> None:
        """Nobody takes what is taken down any more: keep nothing."""
        self.data = _Nowhere()

    def now(self, value: float) -> None:
        """The clock was read."""
        self.data += _NUMBER.pack(b"n", value)

    def slept(self, deadline: float) -> None:
        """The controller slept."""
        self.data += _NUMBER.pack(b"w", deadline)

    def read_hinges(self, r: HingeReadings) -> None:
        """The hinges were read."""
        self.data += b"".join(
            (
                _COUNT.pack(b"r", len(r.position_rad)),
                *(_floats(a) for a in (r.position_rad, r.velocity_rad_s, r.current_a, r.time_s)),
                _bytes(r.alert),
                _bytes(r.valid),
            )
        )

    def read_health(self, r: HealthReadings) -> None:
        """The health was read."""
        self.data += b"".join(
            (
                _COUNT.pack(b"h", len(r.valid)),
                *(_floats(a) for a in (r.temperature_c, r.voltage_v, r.time_s)),
                *(_bytes(a) for a in (r.hardware_error, r.torque_on, r.valid)),
            )
        )

    def read_latches(self, latches: tuple[LatchReading, ...]) -> None:
        """The latches were read."""
        rows = [(r.id, r.engaged, r.confirmed, r.valid, r.time_s, r.fault) for r in latches]
        self._text(b"l", [[plain(item) for item in row] for row in rows])

    def command_hinges(self, position: FloatArray, velocity: FloatArray | None) -> None:
        """Goals were sent."""
        head = _GOALS.pack(b"g", len(position), velocity is not None)
        self.data += head + _floats(position) + (b"" if velocity is None else _floats(velocity))

    def due(self, now: float, value: float) -> None:
        """The bus was asked when a goal is due."""
        self.data += _PAIR.pack(b"d", now, value)

    def called(self, name: str, arguments: tuple[Any, ...], value: Any) -> None:
        """Another call of the bus came back."""
        self._text(b"j", [name, [plain(a) for a in arguments], "value", plain(value)])

    def raised(self, name: str, arguments: tuple[Any, ...], error: BaseException) -> None:
        """A call of the bus or the clock raised."""
        self._text(b"j", [name, [plain(a) for a in arguments], "error", plain_error(error)])

    def stepping(self) -> None:
        """`step` was called."""
        self.data += b"s"

    def looked(self, at: int, name: str) -> None:
        """A property was read; what that needed begins at `at`."""
        text = name.encode()
        self.data[at:at] = _NAME.pack(b"p", len(text)) + text

    def begun(self, name: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> None:
        """A command was given."""
        self._text(b"c", [name, plain(arguments), {key: plain(value) for key, value in named.items()}])

    def ended(self, state: str, error: BaseException | None, value: Any = None) -> None:
        """It ended: the state it left, what it raised or None, and a result as a dictionary or None."""
        self._text(b"e", {"state": state, "error": None if error is None else plain_error(error), "value": value})

    def decided(self, record: CycleRecord) -> None:
        """A cycle is over."""
        if record.transitions or record.fault is not self._fault:
            self._fault = record.fault
            fault = None if record.fault is None else asdict(record.fault)
            self._text(b"f", {"fault": fault, "transitions": [asdict(change) for change in record.transitions]})
        state, stage = str(record.state).encode(), str(record.stage or "").encode()
        head = _DECIDED.pack(
            b"x",
            record.index,
            record.time_s,
            record.path_time_s,
            record.rate,
            record.rate_limit,
            record.commanded_fold,
            len(record.folds),
            len(state),
            len(stage),
            record.fault is not None,
        )
        self.data += b"".join((head, _floats(record.folds), state, stage))

    def _text(self, kind: bytes, content: Any) -> None:
        text = json.dumps(content).encode()
        self.data += _TEXT.pack(kind, len(text)) + text


def _floats(values: FloatArray) -> bytes:
    return np.asarray(values, dtype="<f8").tobytes()


def _bytes(values: NDArray[Any]) -> bytes:
    return np.asarray(values, dtype=np.uint8).tobytes()


# -- values that are not packed --------------------------------------------------------------------------

_CLASSES: dict[str, Any] = {
    "HingeReadings": HingeReadings,
    "HealthReadings": HealthReadings,
    "LatchReading": LatchReading,
    "Recovery": Recovery,
    "JournalEntry": JournalEntry,
}
"""Classes that may be on a tape."""

_NAMES = {kind: name for name, kind in _CLASSES.items()}

_DTYPES = frozenset({"<f8", "|b1", "|u1", "<i8"})


def plain(value: Any) -> Any:
    """A value as JSON has it, with its type where that is not plain; NaN and infinity as Python writes them.

    What has no such form is only named: taking things down must not end a motion.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        return {"array": value.tolist(), "dtype": value.dtype.newbyteorder("<").str}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if type(value) in _NAMES:
        return {_NAMES[type(value)]: {f.name: plain(getattr(value, f.name)) for f in fields(value)}}
    return {"unknown": type(value).__name__}


def rich(value: Any) -> Any:
    """What `plain` was given; lists become tuples."""
    if isinstance(value, list):
        return tuple(rich(item) for item in value)
    if not isinstance(value, dict):
        return value
    if "array" in value:
        if value["dtype"] not in _DTYPES:
            raise ValueError(f"an array of {value['dtype']}")
        return np.array(value["array"], dtype=value["dtype"])
    ((name, content),) = value.items()
    if name == "unknown":
        raise ValueError(f"a {content} has no form on a tape")
    return _CLASSES[name](**{key: rich(item) for key, item in content.items()})


class Interrupted(Exception):
    """An exception of no bus's: the loop was interrupted, or something in it broke."""


def plain_error(error: BaseException) -> dict[str, str]:
    """An exception by name, with its text, and the actuator it is about."""
    known = type(error).__name__
    if isinstance(error, BusError):
        known = next(kind.__name__ for kind in type(error).__mro__ if kind.__name__ in _BUS_ERRORS)
    return {"type": known, "text": str(error), "actuator": getattr(error, "actuator_id", "")}


_BUS_ERRORS: dict[str, type[BusError]] = {
    name: kind for name, kind in vars(bus_module).items() if isinstance(kind, type) and issubclass(kind, BusError)
}


def rich_error(told: dict[str, str]) -> BaseException:
    """An exception that the controller cannot tell from the one that was raised."""
    name, text = str(told["type"]), str(told["text"])
    if name == "KeyboardInterrupt":  # of its own, so that one from the keyboard can be told from it
        own: type[BaseException] = type(name, (KeyboardInterrupt,), {})
        return own(*([text] if text else []))
    kind = _BUS_ERRORS.get(name)
    if kind is None:
        other: type[BaseException] = type(name, (Interrupted,), {})
        return other(text)
    error: BusError = kind.__new__(kind)
    Exception.__init__(error, text)
    if isinstance(error, ActuatorFault):
        error.actuator_id = str(told["actuator"])
    return error


# -- reading ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Decided:
    """What a cycle came to; as in `CycleRecord`."""

    index: int
    time_s: float
    path_time_s: float
    rate: float
    rate_limit: float
    commanded_fold: float
    folds: FloatArray
    state: str
    stage: str
    faulted: bool


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry: its kind, and what it holds.

    Attributes
    ----------
    kind
        The letter of the table above.
    name
        What was called.
    arguments
        With what.
    value
        What came back.
    error
        What it raised, or None.
    """

    kind: str
    name: str = ""
    arguments: tuple[Any, ...] = ()
    value: Any = None
    error: dict[str, str] | None = None


BROKEN_TAPE = (struct.error, ValueError, KeyError, TypeError, IndexError, RecursionError)
"""What reading bytes can end in that are no tape."""


def entries(data: bytes) -> Iterator[Entry]:
    """The entries of one piece, without its number. Raises one of `BROKEN_TAPE` where it is none."""
    at = 0
    while at < len(data):
        entry, at = _KINDS[data[at : at + 1]](data, at)
        if at > len(data):
            raise ValueError("an entry goes beyond its piece")
        yield entry


_Read = tuple[Entry, int]


def _array(data: bytes, at: int, count: int) -> tuple[FloatArray, int]:
    return np.frombuffer(data, dtype="<f8", count=count, offset=at).astype(np.float64), at + 8 * count


def _bools(data: bytes, at: int, count: int) -> tuple[NDArray[np.bool_], int]:
    return np.frombuffer(data, dtype=np.uint8, count=count, offset=at) != 0, at + count


def _json(data: bytes, at: int) -> tuple[Any, int]:
    _, length = _TEXT.unpack_from(data, at)
    begin = at + _TEXT.size
    if begin + length > len(data):
        raise ValueError("a text goes beyond its piece")
    return json.loads(data[begin : begin + length]), begin + length


def _read_now(data: bytes, at: int) -> _Read:
    return Entry("n", "now", (), _NUMBER.unpack_from(data, at)[1]), at + _NUMBER.size


def _read_slept(data: bytes, at: int) -> _Read:
    return Entry("w", "sleep_until", (_NUMBER.unpack_from(data, at)[1],)), at + _NUMBER.size


def _read_due(data: bytes, at: int) -> _Read:
    _, now, value = _PAIR.unpack_from(data, at)
    return Entry("d", "due_s", (now,), value), at + _PAIR.size


def _read_hinges(data: bytes, at: int) -> _Read:
    _, count = _COUNT.unpack_from(data, at)
    at += _COUNT.size
    arrays = []
    for _ in range(4):
        values, at = _array(data, at, count)
        arrays.append(values)
    alert, at = _bools(data, at, count)
    valid, at = _bools(data, at, count)
    position, velocity, current, time_s = arrays
    return Entry("r", "read_hinges", (), HingeReadings(position, velocity, current, alert, valid, time_s)), at


def _read_health(data: bytes, at: int) -> _Read:
    _, count = _COUNT.unpack_from(data, at)
    at += _COUNT.size
    temperature, at = _array(data, at, count)
    voltage, at = _array(data, at, count)
    time_s, at = _array(data, at, count)
    error = np.frombuffer(data, dtype=np.uint8, count=count, offset=at).copy()
    torque, at = _bools(data, at + count, count)
    valid, at = _bools(data, at, count)
    return Entry("h", "read_health", (), HealthReadings(temperature, voltage, error, torque, valid, time_s)), at


def _read_latches(data: bytes, at: int) -> _Read:
    rows, at = _json(data, at)
    return Entry("l", "read_latches", (), tuple(LatchReading(*row) for row in rows)), at


def _read_goals(data: bytes, at: int) -> _Read:
    _, count, moving = _GOALS.unpack_from(data, at)
    position, at = _array(data, at + _GOALS.size, count)
    if not moving:
        return Entry("g", "command_hinges", (position, None)), at
    velocity, at = _array(data, at, count)
    return Entry("g", "command_hinges", (position, velocity)), at


def _read_call(data: bytes, at: int) -> _Read:
    (name, arguments, how, what), at = _json(data, at)
    if how == "error":
        return Entry("j", str(name), rich(arguments), None, dict(what)), at
    return Entry("j", str(name), rich(arguments), rich(what)), at


def _read_command(data: bytes, at: int) -> _Read:
    (name, arguments, named), at = _json(data, at)
    return Entry("c", str(name), rich(arguments), {key: rich(value) for key, value in named.items()}), at


def _read_end(data: bytes, at: int) -> _Read:
    told, at = _json(data, at)
    return Entry("e", str(told["state"]), (), told["value"], told["error"]), at


def _read_change(data: bytes, at: int) -> _Read:
    told, at = _json(data, at)
    return Entry("f", "", (), {"fault": told["fault"], "transitions": told["transitions"]}), at


def _read_step(data: bytes, at: int) -> _Read:
    del data
    return Entry("s", "step"), at + 1


def _read_look(data: bytes, at: int) -> _Read:
    _, length = _NAME.unpack_from(data, at)
    begin = at + _NAME.size
    return Entry("p", data[begin : begin + length].decode()), begin + length


def _read_decided(data: bytes, at: int) -> _Read:
    _, index, time_s, path_s, rate, limit, fold, count, n_state, n_stage, faulted = _DECIDED.unpack_from(data, at)
    folds, at = _array(data, at + _DECIDED.size, count)
    state, stage = data[at : at + n_state].decode(), data[at + n_state : at + n_state + n_stage].decode()
    decided = Decided(index, time_s, path_s, rate, limit, fold, folds, state, stage, faulted)
    return Entry("x", "decided", (), decided), at + n_state + n_stage


_KINDS = {
    b"n": _read_now,
    b"w": _read_slept,
    b"r": _read_hinges,
    b"h": _read_health,
    b"l": _read_latches,
    b"g": _read_goals,
    b"d": _read_due,
    b"j": _read_call,
    b"s": _read_step,
    b"p": _read_look,
    b"c": _read_command,
    b"e": _read_end,
    b"f": _read_change,
    b"x": _read_decided,
}
