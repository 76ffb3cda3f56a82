"""Transactions with servos on one line: the SDK makes and checks packets, everything else is done here.

Guards against the SDK (release 4.1.0): its lock is cleared before every transaction, since an exception
leaves it set; a reply is believed only when it has exactly the bytes that were asked for (the SDK indexes
into shorter ones and answers 0 for missing data); a header in what is sent is stuffed here, since the SDK
throws away what it stuffs; one servo's silence does not end a sync read; the reply to a fast sync read is
checked block by block.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from dynamixel_sdk import COMM_SUCCESS, Protocol2PacketHandler

from ori_deploy.actuators.bus import BusTimeout, CommandRefused, CorruptReply
from ori_deploy.actuators.dynamixel.fast_reply import BLOCK_OVERHEAD, split_fast_reply
from ori_deploy.actuators.dynamixel.port import (
    BITS_PER_BYTE,
    FRAME_OVERHEAD,
    HEADER,
    PATIENCE_S,
    SHORTEST_FRAME,
    STATUS,
    BlockingPort,
)
from ori_deploy.wire.dynamixel import MODELS_BY_NUMBER, Register, ServoModel

BROADCAST = 0xFE
MAX_ID = 252
ALERT = 0x80
"""Bit of a status packet's error byte: the servo has a hardware error to tell."""

IMPATIENCE_S = 1e-3
"""How long replies that did not come in time are waited for where the next ones cannot be mistaken for them."""

PING_SLOT_S = 3e-3
"""Longest time that one servo takes to answer a broadcast ping, over its bytes (SDK, broadcastPing)."""

_STUFFING = 4  # a stuffed byte needs three others before it: a packet grows by a third at the most
PATTERN, STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"
_PING_DATA = 3
_BODY = 7
_AT_ID, _AT_ERROR, _AT_DATA = 4, 8, 9

_ERRORS = {
    1: "could not carry it out",
    2: "does not know the instruction",
    3: "received it damaged",
    4: "finds the value out of range",
    5: "finds the value too short for the register",
    6: "finds the value beyond a limit that is set",
    7: "does not allow it: the register is read-only, unknown, or locked while torque is on",
}


class ServoRefused(CommandRefused):
    """A servo answered an instruction with an error.

    Attributes
    ----------
    servo_id, code
        Which servo, and the protocol's error number (e-manual, Protocol 2.0, table "Error").
    """

    def __init__(self, servo_id: int, what: str, code: int) -> None:
        super().__init__(f"servo {servo_id}: {what}: it {_ERRORS.get(code, f'answers error {code}')}")
        self.servo_id = servo_id
        self.code = code


@dataclass(frozen=True, slots=True)
class Pong:
    """A servo's answer to a ping."""

    id: int
    model_number: int
    firmware: int
    alert: bool

    @property
    def model(self) -> ServoModel | None:
        """Its model with the registers of its firmware, or None when this package does not drive it."""
        model = MODELS_BY_NUMBER.get(self.model_number)
        return None if model is None else model.at_firmware(self.firmware)


@dataclass(frozen=True, slots=True)
class Reply:
    """What one servo answered to a read.

    Attributes
    ----------
    data
        Exactly the bytes asked for.
    alert
        The servo has a hardware error to tell.
    """

    data: bytes
    alert: bool


@dataclass(frozen=True, slots=True)
class Replies:
    """What came back from a read of several servos.

    Attributes
    ----------
    by_id
        Good replies; servos that are missing answered badly or not at all.
    garbage
        Whether bytes came that were no good reply.
    """

    by_id: Mapping[int, Reply]
    garbage: bool

    def require_any(self, what: str) -> None:
        """Raise when nobody gave a good answer.

        Raises
        ------
        CorruptReply
            Something came, and none of it could be believed.
        BusTimeout
            Nothing came.
        """
        if self.by_id:
            return
        if self.garbage:
            raise CorruptReply(f"{what}: no answer could be believed; remedy: check wiring, ids and baud rate")
        raise BusTimeout(f"{what}: nobody answered; remedy: check power, wiring and baud rate")


class ServoLine:
    """Servos on one half-duplex line.

    Parameters
    ----------
    port
        Open, and used by nobody else.
    """

    def __init__(self, port: BlockingPort) -> None:
        self.port = port
        self._sdk = Protocol2PacketHandler()
        self._asked: frozenset[int] = frozenset()  # who was asked last
        self._frame = 0  # and the size of an answer

    # -- one servo -----------------------------------------------------------------------------------

    def ping(self, servo_id: int) -> Pong:
        """Ask who is there. Raises as `read_block`."""
        reply = self._ask(servo_id, f"ping of servo {servo_id}", _ping_packet(servo_id), _PING_DATA)
        return _pong(servo_id, reply)

    def read(self, servo_id: int, register: Register) -> int:
        """Value of a register. Raises as `read_block`."""
        reply = self.read_block(servo_id, register.address, register.size, register.name)
        return register.decode(reply.data)

    def read_block(self, servo_id: int, address: int, size: int, what: str = "") -> Reply:
        """Read `size` bytes from `address` on.

        Raises
        ------
        BusTimeout, CorruptReply
            No answer, or none that could be believed.
        ServoRefused
            The servo answered with an error.
        BusClosed
            The port is gone.
        """
        what = f"read of {what or f'{size} bytes at {address}'} from servo {servo_id}"
        packet = _packet(servo_id, 0x02, *_words(address, size))
        return self._ask(servo_id, what, packet, size)

    def write(self, servo_id: int, register: Register, value: int) -> None:
        """Write a register and wait for the servo's consent. Raises as `read_block`."""
        data = register.encode(value)
        what = f"write of {register.name} = {value} to servo {servo_id}"
        self._ask(servo_id, what, _packet(servo_id, 0x03, *_words(register.address), *data), 0)

    def reboot(self, servo_id: int) -> None:
        """Restart a servo; it is back after about half a second. Raises as `read_block`."""
        self._ask(servo_id, f"reboot of servo {servo_id}", _packet(servo_id, 0x08), 0)

    # -- several servos ------------------------------------------------------------------------------

    def ping_all(self, ids: Iterable[int] | None = None) -> tuple[Pong, ...]:
        """Ask everybody who is there, in one broadcast, or only some, one by one.

        A servo that does not answer is left out; so is one whose answer is spoilt.
        """
        if ids is not None:
            return tuple(pong for servo_id in ids if (pong := self._try_ping(servo_id)) is not None)
        frame = SHORTEST_FRAME + _PING_DATA
        self._send(_packet(BROADCAST, 0x01), frame, (MAX_ID + 1) * frame)
        per_servo_s = frame * BITS_PER_BYTE / self.port.getBaudRate() + PING_SLOT_S
        self.port.give((MAX_ID + 1) * per_servo_s)
        found: dict[int, Pong] = {}
        while (packet := self._receive()) is not None:
            if len(packet) == frame:
                pong = _pong(packet[_AT_ID], Reply(bytes(packet[_AT_DATA:-2]), bool(packet[_AT_ERROR] & ALERT)))
                found[pong.id] = pong
        return tuple(found[servo_id] for servo_id in sorted(found))

    def sync_write(self, address: int, size: int, data: Mapping[int, bytes]) -> None:
        """Write `size` bytes from `address` on to several servos at once. Nobody answers."""
        parameters = b"".join(bytes((servo_id,)) + values for servo_id, values in data.items())
        if len(parameters) != len(data) * (1 + size):
            raise ValueError(f"sync write of {size} bytes to each servo: found {[len(d) for d in data.values()]}")
        self._send(_packet(BROADCAST, 0x83, *_words(address, size), *parameters), 0, 0)

    def sync_read(self, address: int, size: int, ids: Sequence[int], *, fast: bool = False) -> Replies:
        """Read `size` bytes from `address` on from several servos at once.

        A late reply to an earlier one is not waited for long: whoever reads the same registers over and over
        varies `size`, and replies of another size are not believed.

        Parameters
        ----------
        ids
            In the order in which they are to answer.
        fast
            All answers in one packet (fast sync read): every servo's firmware has to know it. A servo that
            stays silent ends that packet; those behind it are then asked the plain way.

        Raises
        ------
        BusClosed
            The port is gone. Silence and garbage are in the result.
        """
        instruction = 0x8A if fast else 0x82
        packet = _packet(BROADCAST, instruction, *_words(address, size), *ids)
        if fast:
            return self._collect_fast(packet, address, size, ids)
        return self._collect(packet, size, ids)

    def _collect(self, packet: list[int], size: int, ids: Sequence[int]) -> Replies:
        frame = SHORTEST_FRAME + size
        expected = frame * len(ids)
        self._send(packet, frame, expected, ids)
        self.port.give(self._wire_s(len(packet) + expected) + len(ids) * self._pause_s)
        by_id = self._as_expected(self.port.wait_for_all(), frame, ids)
        if by_id is not None:
            return Replies(by_id, garbage=False)
        by_id = {}
        good = 0
        while len(by_id) < len(ids):
            status = self._receive()
            if status is None:
                break
            servo_id = status[_AT_ID]
            refused = status[_AT_ERROR] & ~ALERT
            if servo_id in ids and servo_id not in by_id and len(status) == frame and not refused:
                by_id[servo_id] = Reply(bytes(status[_AT_DATA:-2]), bool(status[_AT_ERROR] & ALERT))
                good += 1
        return Replies(by_id, garbage=self.port.heard > good * frame)

    def _as_expected(self, raw: bytes, size: int, ids: Sequence[int]) -> dict[int, Reply] | None:
        """Replies when all came, in order, good, and without stuffing: the usual case, and the quick one.

        None in every other: then packets are looked for one by one.
        """
        if len(raw) != size * len(ids):
            return None
        by_id: dict[int, Reply] = {}
        length = size - FRAME_OVERHEAD
        for k, servo_id in enumerate(ids):
            packet = raw[k * size : (k + 1) * size]
            told = packet[-2] | packet[-1] << 8
            if (
                packet[:_AT_ERROR] != HEADER + bytes((servo_id, length & 0xFF, length >> 8, STATUS))
                or packet[_AT_ERROR] & ~ALERT
                or STUFFED in packet
                or self._sdk.updateCRC(0, packet, size - 2) != told
            ):
                return None
            by_id[servo_id] = Reply(packet[_AT_DATA:-2], packet[_AT_ERROR] & ALERT != 0)
        return by_id

    def _collect_fast(self, packet: list[int], address: int, size: int, ids: Sequence[int]) -> Replies:
        total = FRAME_OVERHEAD + 1 + (size + BLOCK_OVERHEAD) * len(ids)
        self._send(packet, total, total, ids)
        self.port.give(self._wire_s(len(packet) + total) + self._pause_s)
        raw = self.port.wait_for_all()
        if len(raw) != total:  # something came before it, or it is cut short
            raw = raw[max(raw.find(HEADER), 0) :][:total]
        blocks = split_fast_reply(raw, size, ids, self._sdk.updateCRC)
        by_id = {i: Reply(data, bool(error & ALERT)) for i, (error, data) in blocks.items() if not error & ~ALERT}
        heard = self.port.heard
        garbage = len(by_id) < len(ids) and heard > 0
        n_blocks = max(0, (len(raw) - FRAME_OVERHEAD - 1) // (size + BLOCK_OVERHEAD))
        unheard = ids[n_blocks + 1 :] if heard < total else ()
        if unheard:
            rest = self.sync_read(address, size, unheard)
            by_id |= dict(rest.by_id)
            garbage |= rest.garbage
        return Replies(by_id, garbage)

    # -- packets -------------------------------------------------------------------------------------

    _pause_s = 0.5e-3
    """What a servo may take before it answers: the factory's return delay time."""

    def _wire_s(self, n_bytes: int) -> float:
        return n_bytes * BITS_PER_BYTE / self.port.getBaudRate()

    def _try_ping(self, servo_id: int) -> Pong | None:
        try:
            return self.ping(servo_id)
        except (BusTimeout, CorruptReply):
            return None

    def _ask(self, servo_id: int, what: str, packet: list[int], size: int) -> Reply:
        """One instruction to one servo, and its answer."""
        frame = SHORTEST_FRAME + size
        self._send(packet, frame, frame)
        self.port.give(self._wire_s(len(packet) + frame) + self._pause_s)
        while (status := self._receive()) is not None:
            if status[_AT_ID] != servo_id:
                self.port.expected += len(status)  # a late answer to an earlier question; ours is still to come
                continue
            code = status[_AT_ERROR] & ~ALERT
            if code:
                raise ServoRefused(servo_id, what, code)
            if len(status) == frame:
                return Reply(bytes(status[_AT_DATA:-2]), bool(status[_AT_ERROR] & ALERT))
            self.port.expected += len(status)
        self.port.owe()
        if self.port.heard:
            raise CorruptReply(f"{what}: the answer is damaged; remedy: check wiring, ids and baud rate")
        raise BusTimeout(f"{what}: no answer; remedy: check power, wiring, id and baud rate")

    def _send(self, packet: list[int], frame: int, expected: int, ids: Sequence[int] | None = None) -> None:
        """Send a packet; its replies will have `frame` bytes each, `expected` together, stuffing left out."""
        asked = frozenset((packet[_AT_ID],) if ids is None else ids)
        everybody = frozenset((BROADCAST,))
        overlap = asked & self._asked or everybody in (asked, self._asked)
        alike = frame == self._frame and bool(overlap)
        self._asked, self._frame = asked, frame
        self.port.begin(frame + frame // _STUFFING + 1, expected, PATIENCE_S if alike else IMPATIENCE_S)
        if PATTERN in bytes(packet[_BODY:-2]):
            self._send_stuffed(packet)
        elif self._sdk.txPacket(self.port, packet) != COMM_SUCCESS:
            raise ValueError(f"the SDK does not send a packet of {len(packet)} bytes")

    def _send_stuffed(self, packet: list[int]) -> None:
        """Send a packet with a header in its parameters: the SDK throws away what it stuffs."""
        body = bytes(packet[_BODY:-2]).replace(PATTERN, STUFFED)
        data = HEADER + bytes((packet[_AT_ID],)) + (len(body) + 2).to_bytes(2, "little") + body
        crc: int = self._sdk.updateCRC(0, data, len(data))
        self.port.clearPort()
        self.port.writePort(data + crc.to_bytes(2, "little"))

    def _receive(self) -> list[int] | None:
        """The next good status packet, without stuffing; None when there is no more."""
        while True:
            packet, result = self._sdk.rxPacket(self.port, False)
            if result == COMM_SUCCESS:
                self.port.accept()
                status: list[int] = packet[: FRAME_OVERHEAD + packet[5] + 256 * packet[6]]
                return status
            if not packet:
                return None
            self.port.reject()


def _packet(servo_id: int, instruction: int, *parameters: int) -> list[int]:
    """An instruction packet as the SDK wants it: header and CRC are filled in by it."""
    length = len(parameters) + 3
    return [0, 0, 0, 0, servo_id, length & 0xFF, length >> 8, instruction, *parameters, 0, 0]


def _ping_packet(servo_id: int) -> list[int]:
    return _packet(servo_id, 0x01)


def _words(*values: int) -> tuple[int, ...]:
    return tuple(byte for value in values for byte in value.to_bytes(2, "little"))


def _pong(servo_id: int, reply: Reply) -> Pong:
    return Pong(servo_id, int.from_bytes(reply.data[:2], "little"), reply.data[2], reply.alert)
