"""A serial device, such as a telemetry radio."""

from __future__ import annotations

import logging
import os
import select
from collections.abc import Iterable, Iterator
from contextlib import suppress

import serial

from ori_deploy.mav.link_spec import LinkSpec
from ori_deploy.mav.transport.base import LAST_RETRY_S, ONLY, READ_BYTES, Gone, Key, Retry

log = logging.getLogger(__name__)


class SerialTransport:
    """A serial device, opened again when it was unplugged."""

    def __init__(self, spec: LinkSpec) -> None:
        self._spec = spec
        self._port: serial.Serial | None = None
        self._rest = b""  # of a frame that found room in part
        self._retry = Retry()
        self._complained = False
        self._now = 0.0

    def tick(self, now: float) -> float:
        self._now = now
        if self._port is None and now >= self._retry.due:
            self._open()
        if self._port is None:
            return self._retry.due
        with suppress(OSError):  # reading finds out
            self._flush(self._port.fileno())
        return now + LAST_RETRY_S

    def _open(self) -> None:
        try:
            self._port = serial.Serial(self._spec.place, self._spec.number, timeout=0, exclusive=True)
            self._retry.worked()
            self._complained = False
        except (OSError, ValueError) as wrong:
            if not self._complained:
                log.warning("link %s: cannot be opened, tried again and again: %s", self._spec, wrong)
            self._complained = True
            self._retry.failed(self._now)

    def waits(self) -> Iterable[tuple[int, int]]:
        if self._port is None:
            return ()
        return ((self._port.fileno(), select.POLLIN | (select.POLLOUT if self._rest else 0)),)

    def read(self, fd: int, events: int) -> Iterator[tuple[Key, bytes]]:
        try:
            self._flush(fd)
            if not events & ~select.POLLOUT:
                return  # a device without data reads as one that is at its end
            data = os.read(fd, READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        yield ONLY, data

    def write(self, key: Key, frame: bytes) -> bool:
        """The rest of a frame that found room in part goes first, so that frames stay whole."""
        del key
        if self._port is None:
            return False
        # Not through pyserial, which turns round and round while a device has no room.
        try:
            self._flush(self._port.fileno())
            if self._rest:
                return False
            self._rest = frame
            self._flush(self._port.fileno())
        except OSError as wrong:
            raise Gone(wrong.strerror) from wrong
        if self._rest == frame:
            self._rest = b""
            return False
        return True

    def _flush(self, fd: int) -> None:
        with suppress(BlockingIOError, InterruptedError):
            while self._rest:
                self._rest = self._rest[os.write(fd, self._rest) :]

    def targets(self) -> Iterable[Key]:
        return (ONLY,) if self._port is not None else ()

    def drop(self, key: Key) -> None:
        del key
        if self._port is not None:
            self.close()
            self._retry.failed(self._now)

    def close(self) -> None:
        if self._port is not None:
            with suppress(OSError):
                self._port.close()
        self._port, self._rest = None, b""

    def name(self, key: Key) -> str:
        del key
        return f"serial {self._spec.place}"

    def bound(self) -> LinkSpec:
        return self._spec
