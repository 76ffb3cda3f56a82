"""A one-way stream of frames to another process, and a few words back.

The sender never waits, unless it is told to: what a reader that has fallen behind has no room for is dropped
and counted. Both ends are of this program, on this machine: frames are marshalled, and never go into a file.
"""

from __future__ import annotations

import marshal
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

Item = tuple[Any, ...]
Frame = list[Item]

_LENGTH = struct.Struct("<I")
_SOCKET_BYTES = 1 << 20  # asked for; the system may grant less
_READ_BYTES = 1 << 18
ROOM_BYTES = 8 << 20
"""What a sender keeps for a reader that is behind: more than 10 s of 24 hinges at 500 Hz."""
PATIENCE_S = 30.0
"""How long a sender that waits does so for room: the reader is stuck, not slow."""


class Reader:
    """Takes frames out of a stream of bytes."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> Iterator[Frame]:
        """The frames that are complete with these bytes."""
        self._data += data
        at = 0
        while len(self._data) - at >= _LENGTH.size:
            end = at + _LENGTH.size + _LENGTH.unpack_from(self._data, at)[0]
            if len(self._data) < end:
                break
            yield marshal.loads(memoryview(self._data)[at + _LENGTH.size : end])
            at = end
        del self._data[:at]


def packed(frame: Frame) -> bytes:
    """A frame with its length in front."""
    data = marshal.dumps(frame)
    return _LENGTH.pack(len(data)) + data


class Sender:
    """The loop's end.

    Parameters
    ----------
    end
        A connected stream socket.
    waits
        Whether `send` waits for room instead of dropping: where time is virtual nobody is kept waiting.
    room_bytes
        What is kept for a reader that is behind.

    Attributes
    ----------
    dropped
        Frames that did not get through.
    """

    def __init__(self, end: socket.socket, *, waits: bool, room_bytes: int = ROOM_BYTES) -> None:
        self._end = end
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SOCKET_BYTES)
        end.setblocking(False)
        self._waits = waits
        self._room = room_bytes
        self._pending: deque[memoryview] = deque()
        self._pending_bytes = 0
        self._reader = Reader()
        self.dropped = 0
        self._told = 0

    def send(self, frame: Frame, *, urgent: bool = False) -> None:
        """Pass a frame on, now or with a later one. What is urgent, and rare, finds room always.

        Raises
        ------
        OSError
            Nobody reads at the other end, or not for `PATIENCE_S` where it waits.
        """
        if self.dropped > self._told:
            frame = [("dropped", self.dropped), *frame]
        data = packed(frame)
        self.push()
        if not (self._waits or urgent) and self._pending and self._pending_bytes + len(data) > self._room:
            self.dropped += 1
            return
        self._told = self.dropped
        self._pending.append(memoryview(data))
        self._pending_bytes += len(data)
        self.push()
        if self._waits:
            self._drain(time.monotonic() + PATIENCE_S)

    def heard(self) -> Iterator[Frame]:
        """What the other end has said; never waits."""
        while True:
            try:
                data = self._end.recv(_READ_BYTES)
            except (BlockingIOError, ConnectionResetError):
                return
            if not data:
                return
            yield from self._reader.feed(data)

    def finish(self, deadline: float) -> Iterator[Frame]:
        """Pass on what is left, say that nothing more comes, and yield what is said until the other end closes.

        `deadline` is on `time.monotonic`. Raises `TimeoutError` when it passes, OSError when nobody reads.
        """
        self._drain(deadline)
        self._end.shutdown(socket.SHUT_WR)
        while True:
            self._await(self._end, deadline, writing=False)
            data = self._end.recv(_READ_BYTES)
            if not data:
                return
            yield from self._reader.feed(data)

    def fileno(self) -> int:
        """For select: readable when the other end has said something."""
        return self._end.fileno()

    def close(self) -> None:
        """Let go of the socket. Safe to call twice."""
        self._end.close()

    def _drain(self, deadline: float) -> None:
        """Hand everything over, waiting for room."""
        while self._pending:
            self._await(self._end, deadline, writing=True)
            self.push()

    def push(self) -> None:
        """Hand over as much as the socket takes; `send` does so, too."""
        while self._pending:
            try:
                sent = self._end.send(self._pending[0])
            except BlockingIOError:
                return
            self._pending_bytes -= sent
            if sent == len(self._pending[0]):
                self._pending.popleft()
            else:
                self._pending[0] = self._pending[0][sent:]

    @staticmethod
    def _await(end: socket.socket, deadline: float, *, writing: bool) -> None:
        left = max(0.0, deadline - time.monotonic())
        readable, writable, _ = select.select([] if writing else [end], [end] if writing else [], [], left)
        if not (readable or writable):
            raise TimeoutError("it has not finished")


HELD_OFF = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def spawn(
    module: str, words: Sequence[str], *, pass_fds: Sequence[int] = (), stdout: int | None = None
) -> tuple[subprocess.Popen[bytes], socket.socket]:
    """Start `python -m module FD words...` with one end of a socket as file descriptor FD; return the other end.

    It is born deaf to what ends a session: Ctrl-C and the like reach the loop, and end it when the loop has come
    to rest and said all it had to say. It runs until then, or until the loop is gone.
    """
    ours, theirs = socket.socketpair()
    line = [sys.executable, "-m", module, str(theirs.fileno()), *words]
    path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)  # noqa: PTH109  as Python itself means ""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, HELD_OFF)
    try:
        process = subprocess.Popen(
            line,
            pass_fds=(theirs.fileno(), *pass_fds),
            stdin=subprocess.DEVNULL,
            stdout=stdout,
            env=os.environ | {"PYTHONPATH": path, "PYTHONSAFEPATH": "1"},
            start_new_session=True,
        )
    except BaseException:
        ours.close()
        raise
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
    return process, ours


NAP_S = 0.02
"""How long a reader of a loop in real time leaves things be after it has read: a reader that is woken by every
cycle may be given the loop's processor, in the middle of the cycle. A socket holds more than comes in that time."""


def incoming(end: socket.socket, every_s: float, nap_s: float = 0.0) -> Iterator[Frame | None]:
    """Frames as they come, until the other end closes, and None every so often; pauses after every reading."""
    reader = Reader()
    due = time.monotonic() + every_s
    while True:
        if nap_s:
            time.sleep(nap_s)
        left = due - time.monotonic()
        if left <= 0.0:
            due = time.monotonic() + every_s
            yield None
            continue
        if not select.select([end], [], [], left)[0]:
            continue
        try:
            data = end.recv(_READ_BYTES)
        except ConnectionResetError:
            return
        if not data:
            return
        yield from reader.feed(data)
