"""The operator's socket: looked at once per cycle, never waited for.

What a client can do to the control loop is bounded. Per cycle a few connections are taken, each is read once
and has one request answered. A client that sends too long a line or does not read its answers is dropped, and
with too many connections the oldest go, so that the next operator always gets through.
"""

from __future__ import annotations

import logging
import os
import select
import socket
import struct
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from ori_deploy.errors import FileError
from ori_deploy.operate.desk import Desk
from ori_deploy.operate.messages import MAX_REQUEST_BYTES, Answer, BadRequest, answer_line, parse_request
from ori_deploy.operate.places import remove_stale, socket_path
from ori_deploy.runtime_dir import runtime_dir

MAX_CLIENTS = 8
ACCEPTS_PER_CYCLE = 8
BACKLOG = 16
READ_BYTES = 4096
LONGEST_PATH = 107
"""Bytes that the kernel allows the name of a socket."""

_UCRED = struct.Struct("3i")

log = logging.getLogger(__name__)


@dataclass(eq=False, slots=True)
class _Client:
    """A connection; `who` names its process, `waiting` is set while it wants to hear of rest."""

    link: socket.socket
    who: str
    heard: bytearray = field(default_factory=bytearray)
    waiting: bool = False


class OperatorSocket:
    """The socket of one running controller; for `with`.

    Parameters
    ----------
    desk
        Answers what is asked.

    Raises
    ------
    FileError
        There is no safe folder for it, or its name is too long.
    OSError
        It cannot be made there.
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
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
        """Tell those who wait how things are now, if at rest, and remove the socket. Safe to call twice."""
        if not self.listening:
            return
        try:
            self._tell_waiting()
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
            self._clients[link.fileno()] = client
            self._poll.register(link, select.POLLIN)
            new.add(link.fileno())
        return new

    def _least_missed(self) -> _Client:
        """The oldest of those who do not wait for rest, else the oldest."""
        clients = self._clients.values()
        return next((one for one in clients if not one.waiting), next(iter(clients)))

    def _hear(self, client: _Client) -> bool:
        """Read what there is; False when the client is gone."""
        try:
            data = client.link.recv(READ_BYTES)
        except BlockingIOError:
            return True
        except OSError:
            return False
        client.heard += data
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
        answer = self._desk.answer(request, client.who)
        client.waiting = request.wait and answer.took
        return self._send(client, answer)

    def _tell_waiting(self) -> None:
        """The second answer, to those who wanted to hear of rest."""
        if not any(client.waiting for client in self._clients.values()) or not self._desk.at_rest:
            return
        for client in [one for one in self._clients.values() if one.waiting]:
            client.waiting = False
            if not self._send(client, self._desk.told()):
                self._drop(client)

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
