"""A tape as it is played to a controller: it gives what was recorded, and notes what is asked for otherwise.

From the first difference on it gives what is nearest until the cycle is over, so that what the difference comes to
can be told: the fault, the state, the goal. What would have followed nobody knows: nothing answered to it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from ori_deploy.actuators.bus import HealthReadings, HingeReadings
from ori_deploy.errors import FileError
from ori_deploy.telemetry.boundary import ASKS, BoundaryBus, BoundaryJournal
from ori_deploy.telemetry.tape import BROKEN_TAPE, PIECE, Entry, entries, rich_error

ROUNDING = 1e-9
"""Numbers this near are the same: another machine may round otherwise."""

_LOST_CALLS = 10_000
"""Beyond the first difference, before a cycle is given up that does not end."""

_NOT_CALLS = "spcefx"

_FROM_OUTSIDE = ("KeyboardInterrupt", "SystemExit")
"""What ends a command between two calls without the controller's doing. All else it has raised itself, and does so
again: a command that it refused then and goes on with now is a difference."""


@dataclass(frozen=True)
class Difference:
    """Where a controller first decides otherwise.

    Attributes
    ----------
    cycle
        Of the log, as the controller counts; 0 also before the first.
    time_s
        Since the first cycle; NaN before it.
    what
        "fault", "state", "goal", "call" and so on.
    here, logged
        What this controller does, and what the log says.
    """

    cycle: int
    time_s: float
    what: str
    here: str
    logged: str

    def __str__(self) -> str:
        return f"{self.what}: here {self.here}; in the log {self.logged}"


class Over(BaseException):
    """Nothing more can be held against the tape. No `except Exception` may swallow it."""


class Deck:
    """Plays a tape.

    Parameters
    ----------
    pieces
        Of the tape, with their numbers, in order.
    hinge_ids, latch_ids
        Of the bus that was recorded.

    Attributes
    ----------
    decisions
        Calls that commanded something, and the same.
    differences
        Of the first cycle that is different.
    gap
        Why the tape does not go on, or "".
    damage
        What is wrong with it, or None.
    """

    def __init__(self, pieces: Iterable[bytes], hinge_ids: tuple[str, ...], latch_ids: tuple[str, ...]) -> None:
        self._pieces = iter(pieces)
        self._number = 0
        self._piece: list[Entry] = []
        self._at = 0
        self.decisions = 0
        self.differences: list[Difference] = []
        self.gap = ""
        self.damage: FileError | None = None
        self.cycle, self.first_s = 0, math.nan
        self._lost_calls = 0
        self._last: dict[str, Any] = {
            "now": math.nan,
            "delay_s": 0.0,
            "brake_s": 0.0,
            "connected": True,
            "due_s": math.nan,
            "read_hinges": HingeReadings.none(len(hinge_ids)),
            "read_health": HealthReadings.none(len(hinge_ids)),
            "read_latches": (),
            "enable_torque": np.full(len(hinge_ids), np.nan),
            "brake": 0.0,
            "unvouched": (),
            "settled": True,
        }
        self.bus = _PlayedBus(self, hinge_ids, latch_ids)
        self.clock = _PlayedClock(self)
        self.journal = BoundaryJournal(lambda name, *arguments: self.call(name, arguments))

    def peek(self) -> Entry | None:
        """The entry that is next; None at the end."""
        while self._at >= len(self._piece):
            data = None if self.gap else next(self._pieces, None)
            if data is None:
                return None
            self._load(data)
        return self._piece[self._at]

    def take(self) -> Entry:
        """Take the next entry. Raises `Over` at the end."""
        entry = self.peek()
        if entry is None:
            raise Over
        self._at += 1
        return entry

    def differs(self, what: str, here: str, logged: str) -> None:
        """Note a difference in the present cycle."""
        time_s = self._last["now"] - self.first_s
        self.differences.append(Difference(self.cycle, time_s, what, here, logged))

    def call(self, name: str, arguments: tuple[Any, ...]) -> Any:
        """What a call gave then."""
        if self.differences:
            return self._anyhow(name)
        entry = self.peek()
        if entry is None:
            raise Over
        if entry.kind == "e" and entry.error is not None and entry.error["type"] in _FROM_OUTSIDE:
            raise rich_error(entry.error)  # the loop was interrupted about here
        if entry.kind in _NOT_CALLS or entry.name != name:
            self.differs("call", _call(name, arguments), _entry(entry))
            return self._anyhow(name)
        self.take()
        if not same(arguments, entry.arguments):
            what = "goal" if name == "command_hinges" else "call"
            self.differs(what, *_apart(name, arguments, entry.arguments))
        elif name not in ASKS and name != "sleep_until":
            self.decisions += 1
        return self._give(name, entry)

    def rest_of_cycle(self, kinds: str) -> Entry | None:
        """Pass over what is left until an entry of one of these kinds; not beyond the piece."""
        while self._at < len(self._piece) and self._piece[self._at].kind not in kinds:
            self._at += 1
        return self._piece[self._at] if self._at < len(self._piece) else None

    def _load(self, data: bytes) -> None:
        try:
            (number,) = PIECE.unpack_from(data)
            if number > self._number:
                missing = number - self._number
                pieces = "1 piece of the tape is" if missing == 1 else f"{missing} pieces of the tape are"
                self.gap = f"{pieces} missing {self._where()}, dropped by the recorder or damaged"
                return
            if number < self._number:  # no recorder writes one twice
                raise self._damaged(f"piece {number} where piece {self._number} is due")
            self._piece, self._at = list(entries(data[PIECE.size :])), 0
        except BROKEN_TAPE as error:
            raise self._damaged(f"{type(error).__name__}: {error}") from error
        self._number += 1

    def _damaged(self, found: str) -> Over:
        """Note that the tape is damaged; what to raise."""
        self.damage = FileError(
            f"the tape is damaged {self._where()}",
            value=found,
            limit="entries as ori-deploy writes them, every piece once and in order",
            remedy="give an undamaged copy",
        )
        return Over()

    def _where(self) -> str:
        return f"after cycle {self.cycle - 1}" if self.cycle else "before the first cycle"

    def _anyhow(self, name: str) -> Any:
        """Something to go on with until the cycle is over: the same call later in it, or what it gave last."""
        self._lost_calls += 1
        if self._lost_calls > _LOST_CALLS:
            raise Over
        if name in ASKS and name != "now":
            for at in range(self._at, len(self._piece)):
                if self._piece[at].name == name and self._piece[at].kind not in _NOT_CALLS:
                    self._at = at + 1
                    return self._give(name, self._piece[at])
        return self._last.get(name)

    def _give(self, name: str, entry: Entry) -> Any:
        if entry.error is not None:
            raise rich_error(entry.error)
        self._last[name] = entry.value
        return entry.value


class _PlayedClock:
    def __init__(self, deck: Deck) -> None:
        self._deck = deck

    def now(self) -> float:
        return float(self._deck.call("now", ()))

    def sleep_until(self, deadline: float) -> None:
        self._deck.call("sleep_until", (deadline,))


class _PlayedBus(BoundaryBus):
    def __init__(self, deck: Deck, hinge_ids: tuple[str, ...], latch_ids: tuple[str, ...]) -> None:
        super().__init__(hinge_ids, latch_ids)
        self._deck = deck

    def _call(self, name: str, *arguments: Any) -> Any:
        return self._deck.call(name, arguments)


# -- comparing, and saying ---------------------------------------------------------------------------------


def same(a: Any, b: Any) -> bool:
    """Whether two values are the same, numbers up to rounding."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.shape(a) == np.shape(b) and bool(np.allclose(a, b, rtol=ROUNDING, atol=ROUNDING, equal_nan=True))
    if isinstance(a, float | int) and isinstance(b, float | int):
        near = abs(a - b) <= ROUNDING * max(1.0, abs(b)) if math.isfinite(a) and math.isfinite(b) else False
        return near or a == b or (math.isnan(a) and math.isnan(b))
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if is_dataclass(a) and type(a) is type(b):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b)


_WORDS = {
    "now": "reads the clock",
    "sleep_until": "waits for the next cycle",
    "read_hinges": "reads the hinges",
    "read_health": "reads the health",
    "read_latches": "reads the latches",
    "command_hinges": "sends goals",
    "due_s": "asks when a goal is due",
    "enable_torque": "turns torque on",
    "disable_torque": "turns torque off",
    "brake": "brakes",
    "reset_errors": "resets errors",
    "connect": "opens the bus",
    "close": "closes the bus",
    "post": "leaves word in the journal",
    "settled": "looks at the journal",
}


def _call(name: str, arguments: tuple[Any, ...]) -> str:
    named = [a for a in arguments if isinstance(a, str)]
    return " ".join([_WORDS.get(name, name), *named])


def _entry(entry: Entry) -> str:
    if entry.kind in "xf":
        return "the cycle is over"
    if entry.kind == "e":
        return "the command is over"
    if entry.kind in "spc":
        return f"asked for {entry.name}"
    return _call(entry.name, entry.arguments)


def _apart(name: str, here: tuple[Any, ...], logged: tuple[Any, ...]) -> tuple[str, str]:
    """The first thing in which two calls differ."""
    for a, b in zip(here, logged, strict=True):
        if same(a, b):
            continue
        if isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and a.shape == b.shape:
            k = int(np.argmax(~np.isclose(a, b, rtol=ROUNDING, atol=ROUNDING, equal_nan=True)))
            return f"hinge {k + 1} {a[k]:.9g}", f"{b[k]:.9g}"
        if isinstance(a, float | int | str) and isinstance(b, float | int | str):
            return f"{_call(name, ())} {a:.9g}" if isinstance(a, float) else f"{_call(name, ())} {a}", f"{b}"
    return _call(name, here), f"{_call(name, logged)}, otherwise"
