"""What every link is to those who use it."""

from __future__ import annotations

import socket
from collections.abc import Iterable, Iterator
from typing import Protocol

from ori_deploy.mav.link_spec import LinkSpec

Key = tuple[object, ...]
"""Where bytes come from and go to, in one link: a socket's address, or nothing more to be said."""

ONLY: Key = ()
"""The key of a link's only peer."""

Address = tuple[socket.AddressFamily, tuple[str, int] | tuple[str, int, int, int]]

READ_BYTES = 4096
"""Read at most at once, so that a flood on one link leaves the others their turn."""

FIRST_RETRY_S, LAST_RETRY_S = 0.5, 8.0


class Gone(Exception):
    """A peer takes nothing more; whoever knows it forgets it."""


class Transport(Protocol):
    """One link."""

    def waits(self) -> Iterable[tuple[int, int]]:
        """File descriptors to poll, and for which events."""

    def read(self, fd: int, events: int) -> Iterator[tuple[Key, bytes]]:
        """What came on a descriptor with these events; empty bytes where a peer is gone."""

    def write(self, key: Key, frame: bytes) -> bool:
        """Send, or False when there is no room now. Raises `Gone`."""

    def targets(self) -> Iterable[Key]:
        """Peers to which everything goes, heard or not."""

    def tick(self, now: float) -> float:
        """Open again what was lost, when it is time; returns when to be called next."""

    def drop(self, key: Key) -> None:
        """Be done with a peer."""

    def close(self) -> None:
        """Be done."""

    def name(self, key: Key) -> str:
        """Of a peer, for people."""

    def bound(self) -> LinkSpec:
        """The link with the port it really has."""


class Retry:
    """When to try again: soon, then less and less often."""

    def __init__(self) -> None:
        self.due = -1.0
        self._wait_s = FIRST_RETRY_S

    def failed(self, now: float) -> None:
        self.due = now + self._wait_s
        self._wait_s = min(2.0 * self._wait_s, LAST_RETRY_S)

    def worked(self) -> None:
        self._wait_s = FIRST_RETRY_S


def text_of_address(address: Key) -> str:
    """Host and port."""
    host, port = address[0], address[1]
    return f"[{host}]:{port}" if ":" in str(host) else f"{host}:{port}"
