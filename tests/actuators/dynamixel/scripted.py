"""A pty whose far end answers what a test scripts, byte by byte."""

from __future__ import annotations

import os
import threading
import tty
from collections.abc import Callable
from types import TracebackType
from typing import Self

from ori_deploy.actuators.dynamixel.line import ServoLine
from ori_deploy.actuators.dynamixel.port import BlockingPort


def crc16(data: bytes) -> int:
    """CRC-16 with polynomial 0x8005, bit by bit: slow, and not the SDK's table."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x8005) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


def status(servo_id: int, data: bytes = b"", error: int = 0) -> bytes:
    """A status packet, stuffed as the protocol says."""
    body = bytes((0x55, error)) + data
    stuffed = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    length = len(stuffed) + 2
    packet = b"\xff\xff\xfd\x00" + bytes((servo_id, length & 0xFF, length >> 8)) + stuffed
    return packet + crc16(packet).to_bytes(2, "little")


class ScriptedPort:
    """Answers every packet that the host sends with what `answer` makes of it; None closes the line."""

    def __init__(self, answer: Callable[[bytes], bytes | None], slack_s: float = 0.2) -> None:
        self._answer = answer
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.sent: list[bytes] = []
        self.port = BlockingPort(os.ttyname(self._slave), 1_000_000, slack_s)
        self.port.open()
        self.line = ServoLine(self.port)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        waiting = b""
        while True:
            try:
                waiting += os.read(self._master, 4096)
            except OSError:
                return
            while len(waiting) > 7 and len(waiting) >= (total := 7 + waiting[5] + 256 * waiting[6]):
                request, waiting = waiting[:total], waiting[total:]
                self.sent.append(request)
                reply = self._answer(request)
                if reply is None:
                    master, self._master = self._master, -1  # before the host can see that it is gone
                    os.close(self._slave)
                    os.close(master)
                    return
                os.write(self._master, reply)

    def say(self, data: bytes) -> None:
        """Send without being asked."""
        os.write(self._master, data)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.port.close()
        if self._master >= 0:
            os.close(self._slave)
            self._thread.join(5.0)
            os.close(self._master)
        else:
            self._thread.join(5.0)
