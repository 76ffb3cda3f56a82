"""Packets of Protocol 2.0, from their definition: header, stuffing, length, CRC."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

HEADER = b"\xff\xff\xfd\x00"
PATTERN, STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"
BROADCAST = 0xFE
STATUS = 0x55
LONGEST = 1024 + 16


def _crc_table() -> tuple[int, ...]:
    table = []
    for high in range(256):
        crc = high << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        table.append(crc & 0xFFFF)
    return tuple(table)


_TABLE = _crc_table()


def crc16(data: bytes, crc: int = 0) -> int:
    """CRC-16, polynomial 0x8005, most significant bit first, carried on from `crc`."""
    for byte in data:
        crc = ((crc << 8) & 0xFFFF) ^ _TABLE[(crc >> 8) ^ byte]
    return crc


def packet(servo_id: int, body: bytes) -> bytes:
    """A packet round `body`: instruction and parameters, not yet stuffed."""
    stuffed = body.replace(PATTERN, STUFFED)
    data = HEADER + bytes((servo_id,)) + (len(stuffed) + 2).to_bytes(2, "little") + stuffed
    return data + crc16(data).to_bytes(2, "little")


def status(servo_id: int, error: int, parameters: bytes = b"") -> bytes:
    """A status packet."""
    return packet(servo_id, bytes((STATUS, error)) + parameters)


@dataclass(frozen=True, slots=True)
class Instruction:
    """An instruction packet, unstuffed.

    Attributes
    ----------
    target
        Id, or `BROADCAST`.
    code, parameters
        What is to be done.
    good
        Whether its CRC is right; a servo that it is meant for complains otherwise.
    size
        Bytes on the wire.
    """

    target: int
    code: int
    parameters: bytes
    good: bool
    size: int


class Listener:
    """Finds instruction packets in a stream of bytes, whatever else is in it."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[Instruction]:
        """Packets that are complete with these bytes."""
        self._buffer += data
        while (found := self._next()) is not None:
            yield found

    def clear(self) -> None:
        """Forget what has begun."""
        self._buffer.clear()

    def _next(self) -> Instruction | None:
        buffer = self._buffer
        while True:
            at = buffer.find(HEADER)
            if at < 0:
                del buffer[: max(0, len(buffer) - len(HEADER) + 1)]
                return None
            del buffer[:at]
            if len(buffer) < 8:
                return None
            total = 7 + buffer[5] + 256 * buffer[6]
            if not 10 <= total <= LONGEST:
                del buffer[:1]
                continue
            if len(buffer) < total:
                return None
            raw = bytes(buffer[:total])
            good = crc16(raw[:-2]) == raw[-2] | raw[-1] << 8
            if good or raw[7] == STATUS:
                del buffer[:total]
            else:
                del buffer[:1]  # a spoilt length must not swallow what follows
            if raw[7] == STATUS:
                continue
            body = raw[7:-2].replace(STUFFED, PATTERN)
            return Instruction(raw[4], body[0], body[1:], good, total)
