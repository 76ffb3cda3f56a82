"""UDP: one socket, and a peer for every address that was heard."""

from __future__ import annotations

import select
import socket
from collections.abc import Iterable, Iterator

from ori_deploy.mav.link_spec import LinkSpec
from ori_deploy.mav.transport.base import LAST_RETRY_S, ONLY, READ_BYTES, Address, Key, text_of_address

DATAGRAMS = 16
"""Read at most at once."""


class _Udp:
    """One UDP socket."""

    def __init__(self, spec: LinkSpec, address: Address) -> None:
        self._spec = spec
        self._socket = socket.socket(address[0], socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            self._begin(address)
        except BaseException:
            self._socket.close()
            raise

    def _begin(self, address: Address) -> None:
        raise NotImplementedError

    def waits(self) -> Iterable[tuple[int, int]]:
        return ((self._socket.fileno(), select.POLLIN),)

    def read(self, fd: int, events: int) -> Iterator[tuple[Key, bytes]]:
        del fd, events
        for _ in range(DATAGRAMS):
            try:
                data, address = self._socket.recvfrom(READ_BYTES)
            except OSError:
                return
            key = self._key(address)
            if data and key is not None:
                yield key, data

    def _key(self, address: Key) -> Key | None:
        """Of an address; None for one that is not to be heard."""
        return address

    def write(self, key: Key, frame: bytes) -> bool:
        try:
            self._socket.sendto(frame, key)
        except OSError:
            return False  # no room, or no way there now: there may be one again
        return True

    def tick(self, now: float) -> float:
        return now + LAST_RETRY_S

    def drop(self, key: Key) -> None:
        del key

    def close(self) -> None:
        self._socket.close()

    def bound(self) -> LinkSpec:
        return self._spec


class UdpServer(_Udp):
    """Listens, and answers whoever was heard."""

    def _begin(self, address: Address) -> None:
        self._socket.bind(address[1])

    def targets(self) -> Iterable[Key]:
        return ()

    def name(self, key: Key) -> str:
        return f"udp {text_of_address(key)}"

    def bound(self) -> LinkSpec:
        return LinkSpec(self._spec.kind, self._spec.place, self._socket.getsockname()[1])


class UdpClient(_Udp):
    """Sends to one address, and hears that one only."""

    def _begin(self, address: Address) -> None:
        # Not connected to it: where there is no network yet, that would fail once and for all.
        self._target = address[1]

    def _key(self, address: Key) -> Key | None:
        return ONLY if address[:2] == self._target[:2] else None

    def write(self, key: Key, frame: bytes) -> bool:
        del key
        return super().write(self._target, frame)

    def targets(self) -> Iterable[Key]:
        return (ONLY,)

    def name(self, key: Key) -> str:
        del key
        return f"udp {text_of_address((self._spec.place, self._spec.number))}"
