"""TCP: connections that came, and one that is made again and again."""

from __future__ import annotations

import errno
import select
import socket
from collections.abc import Iterable, Iterator

from ori_deploy.mav.link_spec import LinkSpec
from ori_deploy.mav.transport.base import (
    LAST_RETRY_S,
    ONLY,
    READ_BYTES,
    Address,
    Gone,
    Key,
    Retry,
    text_of_address,
)

SEND_BUFFER = 1 << 16
"""Room for what a peer has not taken yet: some ten seconds of telemetry. More is not waited for."""

DEAD_PEER_MS = 10_000
CONNECT_S = 5.0
BACKLOG = 8


def _read_stream(connection: socket.socket) -> bytes | None:
    """What a connection has: nothing (empty) when it is over, None when there is nothing yet."""
    try:
        return connection.recv(READ_BYTES)
    except (BlockingIOError, InterruptedError):
        return None
    except OSError:
        return b""


def _write_stream(connection: socket.socket, frame: bytes) -> bool:
    """Send all of a frame, or find the peer gone: one that does not take what it is sent is not waited for."""
    try:
        sent = connection.send(frame)
    except OSError as wrong:
        raise Gone(wrong.strerror) from wrong
    if sent < len(frame):
        raise Gone("too slow")
    return True


def _ready(connection: socket.socket) -> None:
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, DEAD_PEER_MS)


class TcpServer:
    """Listens for connections."""

    def __init__(self, spec: LinkSpec, address: Address) -> None:
        self._spec = spec
        self._listener = socket.socket(address[0], socket.SOCK_STREAM)
        self._connections: dict[Key, socket.socket] = {}
        try:
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.setblocking(False)
            self._listener.bind(address[1])
            self._listener.listen(BACKLOG)
        except BaseException:
            self._listener.close()
            raise

    def waits(self) -> Iterable[tuple[int, int]]:
        yield self._listener.fileno(), select.POLLIN
        for connection in self._connections.values():
            yield connection.fileno(), select.POLLIN

    def read(self, fd: int, events: int) -> Iterator[tuple[Key, bytes]]:
        del events
        if fd == self._listener.fileno():
            self._accept()
            return
        for key, connection in self._connections.items():
            if connection.fileno() == fd:
                data = _read_stream(connection)
                if data is not None:
                    yield key, data
                return

    def _accept(self) -> None:
        try:
            connection, address = self._listener.accept()
        except OSError:
            return  # gone already, or no descriptors left: who was let in first stays
        try:
            _ready(connection)
        except OSError:
            connection.close()
            return
        self.drop(address)  # who comes again from the same port has given its old connection up
        self._connections[address] = connection

    def write(self, key: Key, frame: bytes) -> bool:
        connection = self._connections.get(key)
        if connection is None:
            raise Gone("no such connection")
        return _write_stream(connection, frame)

    def targets(self) -> Iterable[Key]:
        return tuple(self._connections)

    def tick(self, now: float) -> float:
        return now + LAST_RETRY_S

    def drop(self, key: Key) -> None:
        connection = self._connections.pop(key, None)
        if connection is not None:
            connection.close()

    def close(self) -> None:
        for key in tuple(self._connections):
            self.drop(key)
        self._listener.close()

    def name(self, key: Key) -> str:
        return f"tcp {text_of_address(key)}"

    def bound(self) -> LinkSpec:
        return LinkSpec(self._spec.kind, self._spec.place, self._listener.getsockname()[1])


class TcpClient:
    """Calls, and calls again."""

    def __init__(self, spec: LinkSpec, address: Address) -> None:
        self._spec, self._address = spec, address
        self._socket: socket.socket | None = None
        self._connected = False
        self._retry = Retry()
        self._give_up_s = 0.0
        self._now = 0.0

    def tick(self, now: float) -> float:
        self._now = now
        if self._socket is None and now >= self._retry.due:
            self._call()
        elif self._socket is not None and not self._connected and now >= self._give_up_s:
            self.drop(ONLY)
        if self._socket is None:
            return self._retry.due
        return now + LAST_RETRY_S if self._connected else self._give_up_s

    def _call(self) -> None:
        self._socket = socket.socket(self._address[0], socket.SOCK_STREAM)
        self._give_up_s = self._now + CONNECT_S
        try:
            _ready(self._socket)
            failed = self._socket.connect_ex(self._address[1])
        except OSError as wrong:
            failed = wrong.errno or errno.EIO
        if failed not in (0, errno.EINPROGRESS):
            self.drop(ONLY)

    def waits(self) -> Iterable[tuple[int, int]]:
        if self._socket is None:
            return ()
        return ((self._socket.fileno(), select.POLLIN if self._connected else select.POLLOUT),)

    def read(self, fd: int, events: int) -> Iterator[tuple[Key, bytes]]:
        del fd, events
        if self._socket is None:
            return
        if not self._connected:
            self._answered(self._socket)
            return
        data = _read_stream(self._socket)
        if data is not None:
            yield ONLY, data

    def _answered(self, connection: socket.socket) -> None:
        if connection.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self.drop(ONLY)
        else:
            self._connected = True
            self._retry.worked()

    def write(self, key: Key, frame: bytes) -> bool:
        del key
        return self._socket is not None and self._connected and _write_stream(self._socket, frame)

    def targets(self) -> Iterable[Key]:
        return (ONLY,) if self._connected else ()

    def drop(self, key: Key) -> None:
        del key
        if self._socket is not None:
            self._socket.close()
            self._socket, self._connected = None, False
            self._retry.failed(self._now)

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket, self._connected = None, False

    def name(self, key: Key) -> str:
        del key
        return f"tcp {text_of_address((self._spec.place, self._spec.number))}"

    def bound(self) -> LinkSpec:
        return self._spec
