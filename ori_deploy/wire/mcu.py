"""Messages between host and microcontroller: MAVLink 2 frames made, and found in a stream of bytes.

The generated codec packs and unpacks payloads and counts checksums. Which frames are believed is decided
here: MAVLink 2, unsigned, a message of this dialect no longer than it can be, from the one party that is
expected. Bytes that are nothing of the kind are skipped and counted, and never raise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

from ori_deploy.wire.generated import ori_deploy as dialect
from ori_deploy.wire.generated.ori_deploy import MAVLink_heartbeat_message as Heartbeat
from ori_deploy.wire.generated.ori_deploy import MAVLink_message as Message
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_ack_message as Ack
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_brake_message as Brake
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_config_commit_message as ConfigCommit
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_config_device_message as ConfigDevice
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_config_hinge_message as ConfigHinge
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_config_latch_message as ConfigLatch
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_config_read_message as ConfigRead
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_disable_message as Disable
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_enable_message as Enable
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_event_message as Event
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_fault_clear_message as FaultClear
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_info_message as Info
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_latch_command_message as LatchCommand
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_latch_state_message as LatchState
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_poll_message as Poll
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_setpoints_message as Setpoints
from ori_deploy.wire.generated.ori_deploy import MAVLink_ori_state_message as State
from ori_deploy.wire.generated.ori_deploy import MAVLink_statustext_message as StatusText
from ori_deploy.wire.generated.ori_deploy import MAVLink_timesync_message as Timesync
from ori_deploy.wire.party import Party

__all__ = [
    "DEVICE",
    "HOST",
    "MESSAGES",
    "Ack",
    "Brake",
    "ConfigCommit",
    "ConfigDevice",
    "ConfigHinge",
    "ConfigLatch",
    "ConfigRead",
    "Disable",
    "Enable",
    "Event",
    "FaultClear",
    "FrameReader",
    "FrameWriter",
    "Heartbeat",
    "Info",
    "LatchCommand",
    "LatchState",
    "Message",
    "Party",
    "Poll",
    "Setpoints",
    "State",
    "StatusText",
    "Timesync",
    "dialect",
    "full_payload",
]

# The generated code reads an environment variable that makes it believe frames with wrong checksums.
dialect.MAVLINK_IGNORE_CRC = 0

HINGES = 12
"""Places for hinges in the arrays of a message."""

LATCHES = 8
"""Places for latches."""

MARKER = dialect.PROTOCOL_MARKER_V2
HEADER = dialect.HEADER_LEN_V2
CHECKSUM = 2

MESSAGES: Mapping[int, type[Message]] = MappingProxyType(
    {
        kind.id: kind
        for kind in (
            Heartbeat,
            Timesync,
            StatusText,
            Setpoints,
            Poll,
            State,
            Ack,
            Enable,
            Disable,
            Brake,
            LatchCommand,
            LatchState,
            FaultClear,
            ConfigDevice,
            ConfigHinge,
            ConfigLatch,
            ConfigCommit,
            ConfigRead,
            Info,
            Event,
        )
    }
)
"""The messages that are believed, by their number."""


HOST = Party(255, 190)
DEVICE = Party(1, 1)


class FrameWriter:
    """Makes frames of one sender.

    Parameters
    ----------
    sender
        Whose frames.
    """

    def __init__(self, sender: Party) -> None:
        self._codec = dialect.MAVLink(None, sender.system, sender.component)

    def encode(self, message: Message) -> bytes:
        """The frame of a message, with the next sequence number."""
        frame = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        return frame


class FrameReader:
    """Finds the frames of one sender in a stream of bytes.

    Parameters
    ----------
    sender
        Whose frames are believed.

    Attributes
    ----------
    frames
        How many were good.
    skipped
        Bytes that belonged to no good frame.
    spoilt
        Frames whose header was good and whose checksum was not.
    missing
        Good frames that never came, as their sequence numbers tell.
    """

    def __init__(self, sender: Party) -> None:
        self.frames = self.skipped = self.spoilt = self.missing = 0
        self._sender = bytes((sender.system, sender.component))
        self._codec = dialect.MAVLink(None)
        self._buffer = bytearray()
        self._next: int | None = None

    def feed(self, data: bytes) -> list[Message]:
        """Take bytes in, and return the messages that they complete."""
        self._buffer += data
        return list(self._found())

    def give_up(self) -> list[Message]:
        """The rest of a frame that has begun will not come: return the messages hidden behind its beginning."""
        if len(self._buffer) >= HEADER:
            self.spoilt += 1
            self._skip(1)
        return list(self._found())

    def _found(self) -> Iterator[Message]:
        while self._seek():
            size = HEADER + self._buffer[1] + CHECKSUM
            if len(self._buffer) < size:
                return
            message = self._decode(self._buffer[:size])
            if message is None:
                self.spoilt += 1
                self._skip(1)  # a frame cut short may hide the beginning of the next one
            else:
                del self._buffer[:size]
                yield message

    def _seek(self) -> bool:
        """Skip to the next header that can be believed; False when it is not all there."""
        while True:
            at = self._buffer.find(MARKER)
            self._skip(len(self._buffer) if at < 0 else at)
            if len(self._buffer) < HEADER:
                return False
            if self._believable():
                return True
            self._skip(1)

    def _believable(self) -> bool:
        header = self._buffer[:HEADER]
        kind = MESSAGES.get(int.from_bytes(header[7:10], "little"))
        flags = header[2] | header[3]  # neither signed nor of a kind that was invented later
        return (
            kind is not None and not flags and header[1] <= kind.unpacker.size and bytes(header[5:7]) == self._sender
        )

    def _decode(self, frame: bytearray) -> Message | None:
        """The message, or None when its checksum is wrong."""
        try:
            message = self._codec.decode(frame)
        except dialect.MAVError:
            return None
        number = frame[4]
        if self._next is not None:
            self.missing += (number - self._next) % 256
        self._next = (number + 1) % 256
        self.frames += 1
        return message

    def _skip(self, count: int) -> None:
        self.skipped += count
        del self._buffer[:count]


def full_payload(message: Message) -> bytes:
    """A message's payload with the zeros at its end, which frames leave out."""
    message.pack(dialect.MAVLink(None))
    return bytes(message.get_payload() or b"").ljust(message.unpacker.size, b"\0")
