"""The operator's socket: looked at once per cycle, never waited for.

What a client can do to the control loop is bounded. Per cycle a few connections are taken, each is read once
and has one request answered. A client that sends too long a line or does not read its answers is dropped, and
with too many connections those go that were heard of least lately, so that the next operator always gets through.
What may lead to a motion is not done when it has waited long, or nobody is there any more to hear what became of it.
"""

from __future__ import annotations

import logging
import os
import select
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Self

from ori_deploy.errors import FileError
from ori_deploy.operate.desk import Desk
from ori_deploy.operate.messages import (
    LONGEST_WAIT_S,
    MAX_REQUEST_BYTES,
    MAY_MOVE,
    Answer,
    BadRequest,
    Request,
    answer_line,
    parse_request,
    too_late,
)
from ori_deploy.operate.places import remove_stale, socket_path
from ori_deploy.runtime_dir import runtime_dir

MAX_CLIENTS = 16
ACCEPTS_PER_CYCLE = 8
"""Fewer than clients: who comes is read once before others that come can take the place."""
BACKLOG = 16
READ_BYTES = 4096
LONGEST_PATH = 107
"""Bytes that the kernel allows the name of a socket."""

_UCRED = struct.Struct("3i")

log = logging.getLogger(__name__)


@dataclass(eq=False, slots=True)
class _Client:
    """A connection.

    `who` names its process, `waiting` is set while it wants to hear of rest, `kept` once it is wanted for a stop.
    `cycle` is that in which it came or was heard last; `spoke` is set once it has said a whole line.
    """

    link: socket.socket
    who: str
    heard: bytearray = field(default_factory=bytearray)
    waiting: bool = False
    kept: bool = False
    spoke: bool = False
    cycle: int = 0

    @property
    def missed(self) -> tuple[bool, bool, bool, int]:
        """By how much it would be missed."""
        return self.kept, self.waiting, self.spoke, self.cycle

    @property
    def gone(self) -> bool:
        """Whether nobody is at the other end, or nobody who says any more."""
        poll = select.poll()
        poll.register(self.link, select.POLLRDHUP)
        return bool(poll.poll(0))


class OperatorSocket:
    """The socket of one running controller; for `with`.

    Parameters
    ----------
    desk
        Answers what is asked.
    now
        CLOCK_MONOTONIC, by which clients tell when they asked.

    Raises
    ------
    FileError
        There is no safe folder for it, or its name is too long.
    OSError
        It cannot be made there.
    """

    def __init__(self, desk: Desk, now: Callable[[], float] = time.monotonic) -> None:
        self._desk, self._now = desk, now
        self._cycle = 0
        folder = runtime_dir()
        remove_stale(folder)
        self.path: Path = socket_path(folder, os.getpid())
        if len(os.fsencode(self.path)) > LONGEST_PATH:
            raise FileError(
                f"{self.path}: too long a name for a socket",
                value=f"{len(os.fsencode(self.path))} bytes",
                limit=f"{LONGEST_PATH}",
                remedy="set XDG_RUNTIME_DIR to a folder with a shorter name",
            )
        self.path.unlink(missing_ok=True)  # of a program that had our number before
        self._clients: dict[int, _Client] = {}
        self._poll = select.poll()
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        try:
            self._listener.bind(str(self.path))
            self.path.chmod(0o600)  # the folder kept others out until now
            self._listener.listen(BACKLOG)
        except OSError:
            self._listener.close()
            self.path.unlink(missing_ok=True)
            raise
        self._poll.register(self._listener, select.POLLIN)

    @property
    def listening(self) -> bool:
        """Whether operators can still get through."""
        return self._listener.fileno() >= 0

    def poll(self) -> None:
        """Serve what has come since the last cycle. Waits for nothing and raises nothing."""
        if not self.listening:
            return
        try:
            self._serve()
        except Exception:  # a motion does not end because somebody asked about it
            log.exception("the operator's socket failed and is closed")
            self._shut()

    def close(self) -> None:
        """Tell those who wait how things are now, if at rest, and those who stay how the session ended; then
        remove the socket. Safe to call twice."""
        if not self.listening:
            return
        try:
            self._tell_waiting()
            self._tell_last()
        finally:
            self._shut()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # -- one cycle -----------------------------------------------------------------------------------

    def _serve(self) -> None:
        self._cycle += 1
        self._tell_waiting()
        ready = {fd for fd, _ in self._poll.poll(0)}
        if self._listener.fileno() in ready:
            ready |= self._accept()
        for fd, client in list(self._clients.items()):
            if not self._serve_one(client, fd in ready):
                self._drop(client)

    def _serve_one(self, client: _Client, ready: bool) -> bool:
        """Read at most once and answer at most one request; False when the client is to be dropped."""
        # Nothing more is read while a request lies here: who sends faster than it is served has to wait.
        if b"\n" not in client.heard and ready and not self._hear(client):
            return False
        return not client.heard or self._attend(client)

    def _accept(self) -> set[int]:
        """Take new connections; returns their descriptors."""
        new: set[int] = set()
        for _ in range(ACCEPTS_PER_CYCLE):
            try:
                link, _ = self._listener.accept()
            except OSError:  # none left, or no descriptors: the next cycle asks again
                break
            client = _admitted(link)
            if client is None:
                link.close()
                continue
            if len(self._clients) >= MAX_CLIENTS:
                gone = self._least_missed()
                new.discard(gone.link.fileno())
                self._drop(gone)
            link.setblocking(False)
            client.cycle = self._cycle
            self._clients[link.fileno()] = client
            self._poll.register(link, select.POLLIN)
            new.add(link.fileno())
        return new

    def _least_missed(self) -> _Client:
        """Who can go: not those of this cycle, who have not been heard yet, while there are others."""
        clients = self._clients.values()
        others = [one for one in clients if one.cycle < self._cycle]
        return min(others or clients, key=lambda one: one.missed)

    def _hear(self, client: _Client) -> bool:
        """Read what there is; False when the client is gone."""
        try:
            data = client.link.recv(READ_BYTES)
        except BlockingIOError:
            return True
        except OSError:
            return False
        client.heard += data
        client.cycle = self._cycle
        return bool(data)

    def _attend(self, client: _Client) -> bool:
        """Answer the first whole line; False when the client is to be dropped."""
        end = client.heard.find(b"\n", 0, MAX_REQUEST_BYTES)
        if end < 0:
            if len(client.heard) < MAX_REQUEST_BYTES:
                return True
            self._send(client, Answer(False, why=f"a line of more than {MAX_REQUEST_BYTES} bytes is no request"))
            return False
        line = bytes(client.heard[:end])
        del client.heard[: end + 1]
        try:
            request = parse_request(line)
        except BadRequest as wrong:
            return self._send(client, Answer(False, why=f"not a request: {wrong}"))
        client.spoke, client.kept = True, client.kept or request.keep
        answer = self._desk.answer(request, client.who, self._late(request, client))
        client.waiting = request.wait and answer.took
        return self._send(client, answer)

    def _late(self, request: Request, client: _Client) -> str | None:
        """Why nobody counts on it any more that something is done; None where somebody may."""
        if request.do not in MAY_MOVE:
            return None
        if too_late(request, self._now()):
            return f"it was asked for more than {LONGEST_WAIT_S:g} s ago; see how things are, and ask again"
        return "who asked for it has hung up" if client.gone else None

    def _tell_waiting(self) -> None:
        """The second answer, to those who wanted to hear of rest."""
        if not any(client.waiting for client in self._clients.values()) or not self._desk.at_rest:
            return
        for client in [one for one in self._clients.values() if one.waiting]:
            client.waiting = False
            if not self._send(client, self._desk.told()):
                self._drop(client)

    def _tell_last(self) -> None:
        """To connections that are kept: how things are at the end."""
        kept = [one for one in self._clients.values() if one.kept]
        if kept:
            answer = replace(self._desk.told(self._desk.status()), last=True)
            for client in kept:
                self._send(client, answer)

    def _send(self, client: _Client, answer: Answer) -> bool:
        """Send all of an answer at once; False when there is no room for it, or nobody there."""
        data = answer_line(answer)
        try:
            return client.link.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL) == len(data)
        except OSError:
            return False

    def _drop(self, client: _Client) -> None:
        self._poll.unregister(client.link)
        del self._clients[client.link.fileno()]
        client.link.close()

    def _shut(self) -> None:
        for client in self._clients.values():
            client.link.close()
        self._clients.clear()
        self._listener.close()
        self.path.unlink(missing_ok=True)


def _admitted(link: socket.socket) -> _Client | None:
    """The client behind a connection, if the kernel says that it is this user's, or root's."""
    try:
        pid, uid, _ = _UCRED.unpack(link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size))
    except OSError:
        return None
    if uid not in (os.geteuid(), 0):
        log.warning("user %d, process %d, may not command this controller", uid, pid)
        return None
    return _Client(link, f"an operator at another terminal (pid {pid})")
