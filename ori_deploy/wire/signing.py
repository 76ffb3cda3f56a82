"""MAVLink 2's signatures: made, and judged so that neither a stranger nor a recording is believed."""

from __future__ import annotations

import hashlib
import hmac
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, auto

KEY_BYTES = 32
SIGNATURE_BYTES = 13
"""What a signed frame has at its end: link id, timestamp, and six bytes of a SHA-256."""

TICKS_PER_S = 100_000
"""Timestamps count tens of microseconds since 2015."""

EPOCH_S = 1_420_070_400
LATEST = (1 << 48) - 1
FIRST_HEARD_TICKS = 60 * TICKS_PER_S
"""How far behind ours the first timestamp of a stream may be, by MAVLink's specification."""

MOST_STREAMS = 1024
"""Only who has the key adds a stream. The one whose timestamp is oldest goes, and has to begin anew."""

Stream = tuple[int, int, int]
"""System, component and link id of a signed frame."""


class Verdict(Enum):
    """On a signature."""

    GOOD = auto()
    WRONG = auto()
    REPLAYED = auto()


def ticks_now() -> int:
    """The wall clock as a timestamp; 0 where the clock was never set."""
    return max(0, time.time_ns() // 10_000 - EPOCH_S * TICKS_PER_S)


@dataclass
class Signing:
    """The key, and what was signed with it so far; shared by all readers and writers of a program.

    Attributes
    ----------
    key
        32 bytes that all parties share.
    link_id
        Of frames whose writer has none of its own.
    accept_unsigned
        Whether unsigned MAVLink 2 frames are believed, too. A wrong signature never is.
    timestamp
        The last one used or heard; the next is higher, whatever the clock says.
    streams
        Last timestamp heard of every system, component and link.
    clock
        The wall clock, as a timestamp.
    """

    key: bytes = field(repr=False)
    link_id: int = 0
    accept_unsigned: bool = False
    timestamp: int = 0
    streams: dict[Stream, int] = field(default_factory=dict)
    clock: Callable[[], int] = ticks_now

    def __post_init__(self) -> None:
        if len(self.key) != KEY_BYTES:
            raise ValueError(f"a key has {KEY_BYTES} bytes, not {len(self.key)}")

    def next_timestamp(self) -> int:
        """A timestamp higher than all before. A clock that stepped back does not hold it up."""
        self.timestamp = min(max(self.timestamp + 1, self.clock()), LATEST)
        return self.timestamp

    def judge(self, frame: bytes | bytearray, system: int, component: int) -> Verdict:
        """Judge a whole signed frame. Only a good one changes what is remembered.

        A forged timestamp therefore cannot make those refused that come after it.
        """
        signed, signature = frame[:-6], frame[-6:]
        if not hmac.compare_digest(hashlib.sha256(self.key + signed).digest()[:6], signature):
            return Verdict.WRONG
        timestamp = int.from_bytes(frame[-12:-6], "little")
        stream = (system, component, frame[-SIGNATURE_BYTES])
        last = self.streams.get(stream)
        if last is None:
            now = max(self.timestamp, self.clock())
            last = now - FIRST_HEARD_TICKS - 1
        if timestamp <= last:
            return Verdict.REPLAYED
        self._remember(stream, timestamp)
        self.timestamp = max(self.timestamp, timestamp)
        return Verdict.GOOD

    def _remember(self, stream: Stream, timestamp: int) -> None:
        self.streams[stream] = timestamp
        if len(self.streams) > MOST_STREAMS:
            del self.streams[min(self.streams, key=self.streams.__getitem__)]
