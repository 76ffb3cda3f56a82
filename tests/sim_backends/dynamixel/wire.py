"""A host on the wire of a `Bus`, in made-up time, with a codec of its own: slow, and nothing of the simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ori_deploy.wire.dynamixel import ServoModel, model_named
from sim_backends.dynamixel.bus import Answer, Bus
from sim_backends.dynamixel.packets import Listener
from sim_backends.dynamixel.servo import Servo
from sim_backends.dynamixel.spec import BusSpec, ServoSpec

BROADCAST = 0xFE
XM = "XM430-W350"
CLEAR_TURNS = b"\x01\x44\x58\x4c\x22"


def slow_crc(data: bytes) -> int:
    """CRC-16 of Protocol 2.0, bit by bit."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x8005) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


def stuff(body: bytes) -> bytes:
    """Byte by byte, as the protocol's text says: 0xFD after every 0xFF 0xFF 0xFD."""
    out = bytearray()
    for k, byte in enumerate(body):
        out.append(byte)
        if body[max(0, k - 2) : k + 1] == b"\xff\xff\xfd":
            out.append(0xFD)
    return bytes(out)


def frame(target: int, body: bytes) -> bytes:
    """A packet round instruction and parameters."""
    stuffed = stuff(body)
    data = b"\xff\xff\xfd\x00" + bytes((target,)) + (len(stuffed) + 2).to_bytes(2, "little") + stuffed
    return data + slow_crc(data).to_bytes(2, "little")


@dataclass(frozen=True)
class Status:
    """A status packet."""

    id: int
    error: int
    data: bytes


def statuses(data: bytes) -> list[Status]:
    """Status packets, nothing before, between or after them."""
    found = []
    while data:
        assert data[:4] == b"\xff\xff\xfd\x00"
        total = 7 + data[5] + 256 * data[6]
        one, data = data[:total], data[total:]
        assert slow_crc(one[:-2]).to_bytes(2, "little") == one[-2:]
        body = one[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        assert body[0] == 0x55
        found.append(Status(one[4], body[1], body[2:]))
    return found


def word(value: int) -> bytes:
    return value.to_bytes(2, "little")


class Host:
    """Talks to servos, and lets time pass."""

    def __init__(self, *servos: ServoSpec, **spec: Any) -> None:
        self.bus = Bus(BusSpec(servos=servos or (ServoSpec(id=1),), **spec), 0.0)
        self.baud = self.bus.spec.baud
        self.now = 0.0
        self._listener = Listener()

    def wait(self, duration_s: float) -> None:
        self.now += duration_s
        self.bus.advance(self.now)

    def answers(self, raw: bytes) -> list[Answer]:
        """To bytes that come at once, one per instruction in them."""
        self.bus.advance(self.now)
        return [self.bus.handle(one, self.baud, self.now) for one in self._listener.feed(raw)]

    def say(self, raw: bytes) -> bytes:
        """What comes back to bytes."""
        return b"".join(bytes(answer.data) for answer in self.answers(raw))

    def do(self, target: int, code: int, parameters: bytes = b"") -> list[Status]:
        return statuses(self.say(frame(target, bytes((code,)) + parameters)))

    def model(self, servo_id: int) -> ServoModel:
        return model_named(self.servo(servo_id).spec.model)

    def servo(self, servo_id: int) -> Servo:
        """The servo that had this id when it was switched on."""
        return next(servo for servo in self.bus.servos if servo.spec.id == servo_id)

    def read(self, servo_id: int, name: str) -> int:
        register = self.model(servo_id).table.named(name)
        (got,) = self.do(servo_id, 2, word(register.address) + word(register.size))
        assert got.id == servo_id
        assert got.error & 0x7F == 0
        return register.decode(got.data)

    def write(self, servo_id: int, name: str, value: int) -> int:
        """The error that it is answered with."""
        register = self.model(servo_id).table.named(name)
        (got,) = self.do(servo_id, 3, word(register.address) + register.encode(value))
        return got.error

    def write_all(self, servo_id: int, **values: int) -> None:
        for name, value in values.items():
            assert self.write(servo_id, name, value) == 0, name

    def sync_read(self, address: int, size: int, ids: Sequence[int]) -> list[Status]:
        return self.do(BROADCAST, 0x82, word(address) + word(size) + bytes(ids))
