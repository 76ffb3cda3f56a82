"""All links of a component or a station at once: messages with who sent them, and messages to one peer or to all."""

from __future__ import annotations

import select
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from ori_deploy.mav.link_spec import LinkSpec, parse_link
from ori_deploy.mav.transport import Gone, Key, Transport, open_transport
from ori_deploy.wire.vehicle import Counts, Message, Party, Reader, Signing, Writer

__all__ = ["Heard", "LinkCounts", "LinkSpec", "Links", "Peer", "parse_link"]

MOST_FRAMES = 64
"""Handed over at once: who calls has other things to do, too."""

PEER_FRAMES = 16
"""Of one peer in a turn, so that one that floods leaves the others theirs."""

MOST_BYTES = 1 << 13
"""Looked at in a turn, a datagram more or less: bytes made to look like frames cost some microseconds each."""

MOST_WAITING = 1 << 13
"""Bytes of a peer that wait to be looked at; what comes on top is dropped."""

LATELY_S = 30.0
MOST_PEERS = 16
"""On a link, of those that sent a good frame, and as many of those that did not: strangers push out no station."""


@dataclass(frozen=True, slots=True)
class Peer:
    """Who is at the other end.

    Attributes
    ----------
    link
        Which of the links.
    name
        Its kind and address, as "udp 127.0.0.1:51234".
    """

    link: int
    name: str


@dataclass(frozen=True, slots=True)
class Heard:
    """A message and who sent it."""

    message: Message
    peer: Peer
    system: int
    component: int


@dataclass(frozen=True, slots=True)
class LinkCounts:
    """What went over the links.

    Attributes
    ----------
    read
        What was found in the bytes that came.
    echoes
        Messages that were our own.
    overrun
        Bytes that came faster than they were looked at.
    sent, dropped
        Frames that went, and that did not.
    peers_dropped
        Peers that were gone, too slow, or one too many.
    """

    read: Counts = field(default_factory=Counts)
    echoes: int = 0
    overrun: int = 0
    sent: int = 0
    dropped: int = 0
    peers_dropped: int = 0


class _Known:
    """A peer, and what there is of it."""

    def __init__(self, peer: Peer, transport: Transport, key: Key, reader: Reader, writer: Writer) -> None:
        self.peer, self.transport, self.key = peer, transport, key
        self.reader, self.writer = reader, writer
        self.heard_s: float | None = None
        self.has_more = False  # frames may wait in its reader


class Links:
    """The links of one party; a context manager.

    Parameters
    ----------
    specs
        The links.
    party
        Who sends. Its own messages, echoed, are not handed over.
    signing
        The key, where there is one.
    now
        Monotonic seconds.

    Raises
    ------
    InputError
        One cannot be opened; the others are closed again. What calls, and a device, is opened again and again.
    """

    def __init__(
        self,
        specs: Sequence[LinkSpec],
        party: Party,
        signing: Signing | None = None,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._party, self._signing, self._now = party, signing, now
        self._known: OrderedDict[tuple[int, Key], _Known] = OrderedDict()  # heard least lately first
        self._gone = Counts()
        self._turn = 0
        self._echoes = self._overrun = self._sent = self._dropped = self._peers_dropped = 0
        self._transports: list[Transport] = []
        try:
            for spec in specs:
                self._transports.append(open_transport(spec))
            self._tick()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Be done; may be said twice."""
        for transport in self._transports:
            transport.close()
        self._transports.clear()

    # -- what comes ------------------------------------------------------------------------------------

    def receive(self, timeout_s: float, wake: Sequence[int] = ()) -> list[Heard]:
        """Messages that came, in the order they came from each peer.

        Parameters
        ----------
        timeout_s
            How long to wait for anything to come.
        wake
            File descriptors that end the waiting when they can be read.
        """
        heard: list[Heard] = []
        deadline = self._now() + max(0.0, timeout_s)
        while True:
            due = self._tick()
            self._take_waiting(heard)
            waits = not heard and not any(known.has_more for known in self._known.values())
            until = min(deadline, due) if waits else self._now()
            came = self._read(heard, until, wake)
            if came or not waits or self._now() >= deadline:
                return heard

    def _tick(self) -> float:
        now = self._now()
        return min((transport.tick(now) for transport in self._transports), default=now + LATELY_S)

    def _take_waiting(self, heard: list[Heard]) -> None:
        """Frames that waited for their turn; half of the room is for what comes now."""
        for at, known in tuple(self._known.items()):
            if known.has_more and len(heard) < MOST_FRAMES // 2:
                self._take(at, known, b"", heard)

    def _read(self, heard: list[Heard], until: float, wake: Sequence[int]) -> bool:
        """Poll, and read what there is; whether there was anything."""
        poll = select.poll()
        for fd in wake:
            poll.register(fd, select.POLLIN)
        owners: dict[int, int] = {}
        for link, transport in enumerate(self._transports):
            for fd, events in transport.waits():
                poll.register(fd, events)
                owners[fd] = link
        ready = poll.poll(max(0.0, 1e3 * (until - self._now())))
        self._turn += 1
        ours = [(fd, events) for fd, events in ready if fd in owners]
        # Each link comes first in its turn, so that a flood on one leaves something for the others.
        ours.sort(key=lambda one: (owners[one[0]] - self._turn) % len(self._transports))
        room = MOST_BYTES
        for fd, events in ours:
            if room > 0 and len(heard) < MOST_FRAMES:
                room -= self._read_from(owners[fd], fd, events, room, heard)
        return len(ours) < len(ready) or any(events & ~select.POLLOUT for _, events in ours)

    def _read_from(self, link: int, fd: int, events: int, room: int, heard: list[Heard]) -> int:
        """Read from a descriptor; returns how many bytes."""
        size = 0
        for key, data in self._transports[link].read(fd, events):
            at = (link, key)
            if data:
                size += len(data)
                self._take(at, self._of(at), data, heard)
            else:
                self._drop(at)
            if len(heard) >= MOST_FRAMES or size >= room:
                break
        self._meet(link)
        return size

    def _take(self, at: tuple[int, Key], known: _Known, data: bytes, heard: list[Heard]) -> None:
        """Take bytes of a peer in, and hand its messages over as far as there is room."""
        if len(data) > MOST_WAITING - known.reader.waiting:
            self._overrun += len(data)
            data = b""
        room = min(PEER_FRAMES, MOST_FRAMES - len(heard))
        known.has_more = True
        if room <= 0:
            known.reader.feed(data)
            return
        for message in known.reader.feed(data):
            self._hear(at, known, message, heard)
            room -= 1
            if room <= 0:
                return
        known.has_more = False

    def _hear(self, at: tuple[int, Key], known: _Known, message: Message, heard: list[Heard]) -> None:
        party = Party(message.get_srcSystem(), message.get_srcComponent())
        if party == self._party:
            self._echoes += 1
            return
        is_new, known.heard_s = known.heard_s is None, self._now()
        if at in self._known:
            self._known.move_to_end(at)
            if is_new:
                self._bound_peers(at)
        heard.append(Heard(message, known.peer, party.system, party.component))

    # -- peers -----------------------------------------------------------------------------------------

    def peers(self) -> tuple[Peer, ...]:
        """Those heard lately, and those to which everything goes in any case."""
        return tuple(known.peer for known in self._audience())

    def forget(self, peer: Peer | None = None) -> None:
        """Forget a peer, or all; its connection is ended. It may come again."""
        for at, known in tuple(self._known.items()):
            if peer is None or known.peer == peer:
                self._drop(at, counted=False)

    def bound(self) -> tuple[LinkSpec, ...]:
        """The links with the ports they really have."""
        return tuple(transport.bound() for transport in self._transports)

    @property
    def counts(self) -> LinkCounts:
        """So far."""
        read = sum((known.reader.counts for known in self._known.values()), self._gone)
        return LinkCounts(read, self._echoes, self._overrun, self._sent, self._dropped, self._peers_dropped)

    def _meet(self, link: int) -> None:
        """Know those to which everything goes, heard or not."""
        for key in self._transports[link].targets():
            self._of((link, key))

    def _of(self, at: tuple[int, Key]) -> _Known:
        """What is known of a peer; of a new one, that it is there."""
        known = self._known.get(at)
        if known is None:
            link, key = at
            transport = self._transports[link]
            # Every link signs under its own number: what overtakes on another link is no replay then.
            link_id = None if self._signing is None else (self._signing.link_id + link) % 256
            writer = Writer(self._party, self._signing, link_id)
            peer = Peer(link, transport.name(key))
            known = self._known[at] = _Known(peer, transport, key, Reader(self._signing), writer)
            self._bound_peers(at)
        return known

    def _bound_peers(self, newest: tuple[int, Key]) -> None:
        """Keep a link's peers few."""
        peers = [(at, known.heard_s is None) for at, known in self._known.items() if at[0] == newest[0]]
        for strange in (True, False):
            group = [at for at, is_strange in peers if is_strange is strange]
            if len(group) > MOST_PEERS:
                self._drop(next(at for at in group if at != newest))

    def _drop(self, at: tuple[int, Key], counted: bool = True) -> None:
        known = self._known.pop(at, None)
        if known is not None:
            self._gone += known.reader.counts
            self._peers_dropped += counted
        self._transports[at[0]].drop(at[1])

    # -- what goes -------------------------------------------------------------------------------------

    def send(self, message: Message, peer: Peer | None = None) -> None:
        """Send to a peer, or to everybody; never waits. What cannot be sent is dropped and counted."""
        if peer is None:
            for known in self._audience():
                self._send_to(known, message)
            return
        for known in tuple(self._known.values()):
            if known.peer == peer:
                self._send_to(known, message)
                return
        self._dropped += 1

    def _audience(self) -> list[_Known]:
        for link in range(len(self._transports)):
            self._meet(link)
        since = self._now() - LATELY_S
        return [
            known
            for known in self._known.values()
            if known.key in known.transport.targets() or (known.heard_s is not None and known.heard_s >= since)
        ]

    def _send_to(self, known: _Known, message: Message) -> None:
        try:
            went = known.transport.write(known.key, known.writer.pack(message))
        except Gone:
            went = False
            self._drop((known.peer.link, known.key))
        self._sent += went
        self._dropped += not went
