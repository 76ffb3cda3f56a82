"""The messages in a flight log's file, by channel: of one that is whole, cut off by a crash, or damaged."""

from __future__ import annotations

import json
import struct
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Statistics
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray
from zstandard import ZstdError

from ori_deploy.telemetry.schema import CHANNELS, TAPE

FloatArray = NDArray[np.float64]

BROKEN = (
    McapError,
    struct.error,
    ZstdError,
    KeyError,
    TypeError,
    ValueError,
    OverflowError,
    RuntimeError,  # from lz4, and RecursionError
)
"""What parsing bytes can end in when they are not what was written."""

_FRAME = struct.Struct("<BQ")
_LARGEST_CHUNK = 2**28
"""Bytes that a chunk may say that it unpacks to; ours are far smaller."""

_OFTEN = ("/cycle", "/health", "/timing")
"""Channels with a message in every cycle, or nearly."""

_BLOCK = 1024
_TEXTS = {"state", "stage"}
_TYPES: Mapping[str, Any] = {"valid": np.bool_, "lost_replies": np.int64, "overruns": np.int64}
_UNUSED = {"index", "hardware_error", "torque_on"}


class Columns:
    """The messages of a channel on which there is one per cycle, as arrays: as objects they would fill the memory.

    Parameters
    ----------
    channel
        Its topic, one of `CHANNELS`.
    """

    def __init__(self, channel: str) -> None:
        self._names = [name for name in CHANNELS[channel] if name not in _UNUSED]
        self._rows: list[dict[str, Any]] = []
        self._blocks: dict[str, list[NDArray[Any]]] = {name: [] for name in self._names}
        self._texts: dict[str, list[str]] = {name: [] for name in _TEXTS}
        self._wrong: Exception | None = None

    def __bool__(self) -> bool:
        return bool(self._rows or any(self._blocks.values()))

    def add(self, row: dict[str, Any]) -> None:
        """One more message. What is wrong with it is told by whoever asks for a column."""
        self._rows.append(row)
        if len(self._rows) == _BLOCK:
            try:
                self._pack()
            except BROKEN as error:
                self._wrong, self._rows = self._wrong or error, []

    def numbers(self, name: str) -> NDArray[Any]:
        """(n, ...) of one property; null is NaN. Raises what is in `BROKEN` for messages that nobody wrote so."""
        self._finish()
        blocks = self._blocks[name]
        return np.concatenate(blocks) if blocks else np.array([], dtype=_TYPES.get(name, np.float64))

    def texts(self, name: str) -> tuple[str, ...]:
        """Of one property. Raises as `numbers`."""
        self._finish()
        return tuple(self._texts[name])

    def _finish(self) -> None:
        if self._rows:
            self._pack()
        if self._wrong is not None:
            raise self._wrong

    def _pack(self) -> None:
        for name in self._names:
            values = [row[name] for row in self._rows]
            if name in _TEXTS:
                self._texts[name] += map(sys.intern, values)
            else:
                self._blocks[name].append(np.array(values, dtype=_TYPES.get(name, np.float64)))
        self._rows = []


@dataclass
class Found:
    """What is in a file.

    Attributes
    ----------
    begins
        Its first bytes.
    messages
        Of channels with few messages, by topic.
    columns
        Of those with one per cycle, by topic.
    tape
        The pieces of the tape.
    finished
        Whether its end was written.
    unread
        What of it could not be read, for people.
    cause
        The first thing that was wrong.
    """

    begins: bytes
    messages: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    columns: dict[str, Columns] = field(
        default_factory=lambda: {t: Columns(t) for t in ("/cycle", "/health", "/timing")}
    )
    tape: list[bytes] = field(default_factory=list)
    finished: bool = False
    unread: str = ""
    cause: Exception | None = None

    @property
    def info(self) -> Mapping[str, Any]:
        """The message of `/plan_info`, or nothing."""
        return self.messages.get("/plan_info", [{}])[0]

    @property
    def is_a(self) -> str:
        """What sort of file it is, for people, where it is none of ours or hardly begun."""
        if not self.begins:
            return "an empty file"
        if self.begins != MCAP0_MAGIC:
            return "a file of another kind"
        return "another program's MCAP file" if self.finished else "one that was cut off before its first message"


def collect(data: bytes, *, with_tape: bool) -> Found:
    """Sort all messages by channel.

    A record that cannot be read is passed over: what comes behind it is as good as before. After a crash the file
    ends in the middle of one.
    """
    found = Found(data[: len(MCAP0_MAGIC)])
    if found.begins != MCAP0_MAGIC:
        return found
    topics = _topics(data)
    passed_over, end = 0, len(MCAP0_MAGIC)
    seen, counted = 0, 0
    for opcode, begin, end in _records(data):
        try:
            for record in _opened(opcode, data[begin:end]):
                if isinstance(record, Statistics):
                    counted = record.message_count
                    continue
                seen += isinstance(record, Message)
                passed_over += not _take(found, topics, record, with_tape=with_tape)
        except BROKEN as error:
            found.cause = found.cause or error
            passed_over += 1
        if opcode == Opcode.FOOTER:
            found.finished = True
            break
    told = _damage(passed_over, counted - seen, counted)
    found.unread = ", and ".join(told + _end(data, found.finished, end, damaged=bool(told)))
    return found


def _records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of the content of every record that is all there."""
    at = len(MCAP0_MAGIC)
    while at + _FRAME.size <= len(data):
        opcode, length = _FRAME.unpack_from(data, at)
        begin, at = at + _FRAME.size, at + _FRAME.size + length
        if at > len(data):
            return
        yield opcode, begin, at


def _topics(data: bytes) -> dict[int, str]:
    """Topics by channel as the end of the file repeats them: the chunk that has them may be lost."""
    topics: dict[int, str] = {}
    for opcode, begin, end in _records(data):
        if opcode == Opcode.CHANNEL:
            try:
                channel = Channel.read(ReadDataStream(BytesIO(data[begin:end])))
            except BROKEN:
                continue  # told of when it is read for its own sake
            topics[channel.id] = channel.topic
    return topics


def _opened(opcode: int, content: bytes) -> list[Any]:
    """Channels and messages of a record, or what the file says of itself."""
    Opcode(opcode)  # nobody wrote a record of any other kind
    stream = ReadDataStream(BytesIO(content))
    if opcode == Opcode.CHANNEL:
        return [Channel.read(stream)]
    if opcode == Opcode.MESSAGE:
        return [Message.read(stream, len(content))]
    if opcode == Opcode.STATISTICS:
        return [Statistics.read(stream)]
    if opcode != Opcode.CHUNK:
        return []
    chunk = Chunk.read(stream)
    if chunk.uncompressed_size > _LARGEST_CHUNK:
        raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes")
    return breakup_chunk(chunk, validate_crc=True)


def _take(found: Found, topics: dict[int, str], record: Any, *, with_tape: bool) -> bool:
    """Put a record where it belongs; False for a message that cannot be decoded."""
    if isinstance(record, Channel):
        topics[record.id] = record.topic
    elif isinstance(record, Message):
        try:
            topic = topics[record.channel_id]
            if topic == TAPE:
                if with_tape:
                    found.tape.append(record.data)
                return True
            message = _decode(record.data)
        except BROKEN as error:
            found.cause = found.cause or error
            return False
        if topic in found.columns:
            found.columns[topic].add(message)
        else:
            found.messages.setdefault(topic, []).append(message)
    return True


def _decode(data: bytes) -> dict[str, Any]:
    message = json.loads(data)
    if not isinstance(message, dict):
        raise TypeError(f"a message is a {type(message).__name__}, not an object")
    return message


def _damage(passed_over: int, missing: int, of: int) -> list[str]:
    """What is not right with the records that were read; the file counts its messages at its end."""
    told = [f"{passed_over} of its parts {'is' if passed_over == 1 else 'are'} damaged"] if passed_over else []
    if missing > 0:
        told.append(f"{missing} of its {of} messages {'is' if missing == 1 else 'are'} missing")
    return told


def _end(data: bytes, finished: bool, end: int, *, damaged: bool) -> list[str]:
    """What is not right with the end of a file whose records end at a byte; a crash's cut is no damage."""
    rest = len(data) - end - (len(MCAP0_MAGIC) if finished else 0)
    if finished:
        return [f"{rest} bytes follow its end"] if rest > 0 else []
    if data.endswith(MCAP0_MAGIC) and rest > 0:
        return [f"its last {rest} bytes make no sense"]
    return ["its end is missing"] if damaged else []
