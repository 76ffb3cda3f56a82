"""Messages of the vehicle's network: MAVLink frames made, and found in a stream of bytes.

The generated codec packs and unpacks payloads and counts checksums. Which frames are believed is decided here:
those of the dialect, from anybody, and signed where there is a key. A frame may be longer than its message is
known to be, since newer dialects extend messages. Bytes that are no frame are skipped and counted, and never
raise.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from ori_deploy.wire.generated import ori_vehicle as dialect
from ori_deploy.wire.generated.ori_vehicle import MAVLink_message as Message
from ori_deploy.wire.party import Party
from ori_deploy.wire.signing import SIGNATURE_BYTES, Signing, Verdict

__all__ = ["Counts", "Message", "Party", "Reader", "Signing", "Writer", "dialect", "text_of"]

# The generated code reads an environment variable that makes it believe frames with wrong checksums.
dialect.MAVLINK_IGNORE_CRC = 0

MARKER_1 = dialect.PROTOCOL_MARKER_V1
MARKERS = re.compile(bytes((ord("["), dialect.PROTOCOL_MARKER_V2, MARKER_1, ord("]"))))
HEADER_1, HEADER_2 = dialect.HEADER_LEN_V1, dialect.HEADER_LEN_V2
CHECKSUM = 2
SIGNED = dialect.MAVLINK_IFLAG_SIGNED

LONGEST = HEADER_2 + 255 + CHECKSUM + SIGNATURE_BYTES
"""Bytes of the longest frame there can be."""


@dataclass(frozen=True, slots=True)
class Counts:
    """What a reader came across.

    Attributes
    ----------
    frames
        Good ones.
    skipped
        Bytes that belonged to no frame.
    bad_checksum
        Frames of known messages whose checksum was wrong.
    unknown
        Frames of messages that this dialect does not have.
    bad_signature, replayed
        Frames whose signature was wrong, or right but used before.
    unsigned
        Frames without the signature that they should have had.
    """

    frames: int = 0
    skipped: int = 0
    bad_checksum: int = 0
    unknown: int = 0
    bad_signature: int = 0
    unsigned: int = 0
    replayed: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(getattr(self, name) + getattr(other, name) for name in self.__slots__))


@dataclass(frozen=True, slots=True)
class _Header:
    """Of a frame: its whole size, and whether its message is known."""

    size: int
    known: bool
    signed: bool
    system: int
    component: int


class Reader:
    """Finds the frames of one peer in its stream of bytes.

    Parameters
    ----------
    signing
        Judges signatures. Without it signatures are not looked at, and MAVLink 1 frames are believed, too.
    """

    def __init__(self, signing: Signing | None = None) -> None:
        self._signing = signing
        self._codec = dialect.MAVLink(None)
        self._buffer = bytearray()
        self._in_step = True  # what was before was a frame: so what follows is likely one
        self._frames = self._skipped = self._bad_checksum = self._unknown = 0
        self._bad_signature = self._unsigned = self._replayed = 0

    @property
    def counts(self) -> Counts:
        """So far."""
        return Counts(
            self._frames, self._skipped, self._bad_checksum, self._unknown,
            self._bad_signature, self._unsigned, self._replayed,
        )  # fmt: skip

    @property
    def waiting(self) -> int:
        """Bytes that were taken in and not yet looked at, or that wait for the rest of their frame."""
        return len(self._buffer)

    def feed(self, data: bytes) -> Iterator[Message]:
        """Take bytes in, and give the messages they complete, each when it is asked for.

        Messages that were not asked for come with the next `feed`.
        """
        self._buffer += data
        return self._found()

    def _found(self) -> Iterator[Message]:
        while (header := self._seek()) is not None:
            if not header.known:
                if len(self._buffer) <= header.size:
                    return
                self._pass_unknown(header.size)
                continue
            if len(self._buffer) < header.size:
                return
            frame = self._buffer[: header.size]
            message = self._decode(frame)
            if message is None:
                self._bad_checksum += 1
                self._skip(1)  # a frame cut short may hide the beginning of the next one
                continue
            del self._buffer[: header.size]
            self._in_step = True
            if self._believed(header, frame):
                self._frames += 1
                message._signed = header.signed and self._signing is not None
                yield message

    def _seek(self) -> _Header | None:
        """Skip to the next header that can be believed; None when it is not all there."""
        while True:
            found = MARKERS.search(self._buffer)
            self._skip(len(self._buffer) if found is None else found.start())
            if len(self._buffer) < (HEADER_1 if self._buffer[:1] == b"\xfe" else HEADER_2):
                return None
            header = self._header()
            if header is not None:
                return header
            self._skip(1)

    def _header(self) -> _Header | None:
        """The header that may begin here, or None."""
        buffer = self._buffer
        length = buffer[1]
        if buffer[0] == MARKER_1:
            kind = dialect.mavlink_map.get(buffer[5])
            if kind is not None and length > kind.unpacker.size:
                return None
            header = _Header(HEADER_1 + length + CHECKSUM, kind is not None, False, buffer[3], buffer[4])
        else:
            flags = buffer[2]
            if flags & ~SIGNED:
                return None  # how long a frame with flags invented later is, nobody here knows
            known = int.from_bytes(buffer[7:10], "little") in dialect.mavlink_map
            signature = SIGNATURE_BYTES if flags else 0
            header = _Header(HEADER_2 + length + CHECKSUM + signature, known, bool(flags), buffer[5], buffer[6])
        # Out of step nearly every marker in noise would do as an unknown message, and swallow what follows.
        return header if header.known or self._in_step else None

    def _pass_unknown(self, size: int) -> None:
        """Pass over a frame of an unknown message: its checksum says nothing, but what follows it does."""
        if MARKERS.match(self._buffer, size):
            self._unknown += 1
            del self._buffer[:size]
        else:
            self._skip(1)

    def _decode(self, frame: bytearray) -> Message | None:
        """The message, or None when its checksum is wrong."""
        try:
            message: Message = self._codec.decode(frame)
        except dialect.MAVError:
            return None
        return message

    def _believed(self, header: _Header, frame: bytearray) -> bool:
        """Whether a whole frame may be heeded; counts why not."""
        if self._signing is None:
            return True
        if not header.signed:
            # MAVLink 1 has no signatures, so that a station which signs never falls back to it.
            believed = self._signing.accept_unsigned and frame[0] != MARKER_1
            self._unsigned += not believed
            return believed
        verdict = self._signing.judge(frame, header.system, header.component)
        self._bad_signature += verdict is Verdict.WRONG
        self._replayed += verdict is Verdict.REPLAYED
        return verdict is Verdict.GOOD

    def _skip(self, count: int) -> None:
        if count:
            self._in_step = False
            self._skipped += count
            del self._buffer[:count]


class Writer:
    """Makes MAVLink 2 frames for one peer, signed where there is a key.

    Parameters
    ----------
    party
        Whose frames.
    signing
        The key, and the timestamps used.
    link_id
        Of the signatures; that of `signing` by default.
    """

    def __init__(self, party: Party, signing: Signing | None = None, link_id: int | None = None) -> None:
        self._codec = dialect.MAVLink(None, party.system, party.component)
        self._signing = signing
        if signing is not None:
            self._codec.signing.secret_key = signing.key
            self._codec.signing.sign_outgoing = True
            self._codec.signing.link_id = signing.link_id if link_id is None else link_id

    def pack(self, message: Message) -> bytes:
        """The frame of a message, with the next sequence number."""
        if self._signing is not None:
            self._codec.signing.timestamp = self._signing.next_timestamp()
        frame: bytes = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        return frame


def text_of(field: str | bytes | bytearray) -> str:
    """The text of a char field up to its first NUL; what is not printable ASCII becomes a question mark."""
    text = field.decode("latin-1") if isinstance(field, bytes | bytearray) else field
    return "".join(c if " " <= c <= "~" else "?" for c in text.split("\0", 1)[0])
