"""The serial port under the SDK: what its `PortHandler` does, done without its faults.

The SDK asks a port for so many bytes and is handed those of one status packet, never those of two: the port
finds packets in the stream, so that a spoilt length or a lost byte costs one packet and not the rest.
Deadlines are monotonic, waiting sleeps in the kernel, and a port that is gone is a `BusClosed`.
"""

from __future__ import annotations

import os
import select
import struct
import termios
import time
from collections.abc import Iterable
from fcntl import ioctl

import serial

from ori_deploy.actuators.bus import BusClosed
from ori_deploy.actuators.claim import DeviceClaim, why_closed

HEADER = b"\xff\xff\xfd\x00"
STATUS = 0x55
SHORTEST_FRAME = 11
"""Bytes of a status packet without parameters."""

FRAME_OVERHEAD = 7
"""Bytes of a packet that its length field does not count."""

BITS_PER_BYTE = 10

OPEN_SLACK_S = 0.005
"""Time that host, driver and adapter may take over the wire's own, unless the caller knows better."""

WRITE_PATIENCE_S = 1.0

PATIENCE_S = 0.06
"""How long a reply that did not come in time is waited for before something else is asked."""


_TCGETS2 = 0x802C542A
_TERMIOS2_BYTES, _OUTPUT_SPEED_AT = 44, 40
"""Linux's `struct termios2`, which alone has the rate in numbers."""


class BlockingPort:
    """A serial port with the methods that `Protocol2PacketHandler` calls.

    Names in mixed case are the SDK's. Bytes come out of `readPort` one status packet at a time; the caller
    says with `accept` or `reject` what became of it.

    Parameters
    ----------
    path
        Device, such as "/dev/ttyUSB0".
    baud
        Bits per second.
    slack_s
        Time that a reply may take beyond what the wire needs.

    Attributes
    ----------
    is_using
        The SDK's own lock; cleared before every transaction, since an exception leaves it set.
    longest_frame
        Bytes beyond which a packet is not believed to be one.
    expected
        Bytes that the replies have together, stuffing left out.
    heard
        Bytes received since the last packet was sent.
    """

    def __init__(self, path: str, baud: int, slack_s: float = OPEN_SLACK_S) -> None:
        self.path = path
        self.slack_s = slack_s
        self.is_using = False
        self.longest_frame = 1024
        self.expected = 0
        self.heard = 0
        self._baud = baud
        self._claim = DeviceClaim(path)
        self._serial: serial.Serial | None = None
        self._fd = -1
        self._poll = select.poll()
        self._buffer = bytearray()
        self._start = 0  # of the packet that is being handed out
        self._given = 0  # bytes of it that are out
        self._frame = b""
        self._deadline = 0.0
        self._late = False
        self._owed = False

    def open(self) -> None:
        """Open the device for this process alone.

        Raises
        ------
        BusClosed
            It is not there, not a serial port, not permitted, or in use.
        """
        self._claim.take()
        try:
            self._serial = serial.Serial(self.path, self._baud, timeout=0, exclusive=True)
        except serial.SerialException as wrong:
            self._claim.release()
            raise BusClosed(f"{self.path} cannot be opened: {why_closed(wrong, self.path, 'adapter')}") from wrong
        except (ValueError, OSError, termios.error) as wrong:
            self._claim.release()
            raise BusClosed(
                f"{self.path} cannot be opened at {self._baud} baud: {wrong}; remedy: check the port and the rate"
            ) from wrong
        self._fd = self._serial.fileno()
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)
        self._late = self._owed = False
        self._forget()

    def close(self) -> None:
        """Close it. Safe to call twice, and when the device is gone."""
        if self._serial is not None:
            self._serial.close()
            self._serial = None
            self._fd = -1
        self._claim.release()

    @property
    def is_open(self) -> bool:
        """Whether it was opened and not closed since; a device may be gone all the same."""
        return self._serial is not None

    def check(self) -> None:
        """Raise `BusClosed` when the device is gone, without sending anything."""
        if self._serial is None:
            raise BusClosed(f"{self.path} is not open")
        probe = select.poll()
        probe.register(self._fd, 0)
        if any(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL) for _, event in probe.poll(0)):
            self._lost("hung up")

    def begin(self, longest_frame: int, expected: int, patience_s: float = PATIENCE_S) -> None:
        """Get ready for the next transaction.

        A reply that is still owed would be taken for the next one's: it is waited for, and thrown away.

        Parameters
        ----------
        longest_frame, expected
            As the attributes.
        patience_s
            How long to wait for what is owed; shorter where the next reply cannot be mistaken for it.
        """
        deadline = time.monotonic() + patience_s
        while self._late and (self._owed or self.heard < self.expected) and self._receive(deadline):
            pass
        self._late = self._owed = False
        self.is_using = False
        self.longest_frame, self.expected = longest_frame, expected

    def owe(self) -> None:
        """What came was not what was asked for: that may still come, however many bytes there were."""
        self._late = self._owed = True

    # -- what the SDK calls --------------------------------------------------------------------------

    def getBaudRate(self) -> int:
        """Bits per second."""
        return self._baud

    def setBaudRate(self, baud: int) -> bool:
        """Change the rate of an open port."""
        self._baud = baud
        if self._serial is not None:
            try:
                self._serial.baudrate = baud
            except (ValueError, OSError, termios.error) as wrong:
                raise BusClosed(f"{self.path} cannot be set to {baud} baud: {wrong}") from wrong
        return True

    def made_baud(self) -> int | None:
        """The rate that the driver says it makes: some make another without a word. None where it does not tell."""
        try:
            raw = ioctl(self._fd, _TCGETS2, bytes(_TERMIOS2_BYTES))
        except OSError:
            return None  # not Linux, or no terminal
        speed: int = struct.unpack_from("I", raw, _OUTPUT_SPEED_AT)[0]
        return speed

    def clearPort(self) -> None:
        """Forget what was received."""
        if self._fd >= 0:
            self._take_waiting()
        self._forget()

    def writePort(self, packet: Iterable[int]) -> int:
        """Send all of a packet, and return its length."""
        data = bytes(packet)
        sent = 0
        self._late = self.expected > 0  # until all replies are in, whatever interrupts us
        deadline = time.monotonic() + WRITE_PATIENCE_S
        while sent < len(data):
            try:
                sent += os.write(self._fd, data[sent:])
            except BlockingIOError:
                self._wait_to_write(deadline)
            except OSError as wrong:
                self._lost(str(wrong), wrong)
        return sent

    def setPacketTimeout(self, packet_length: int) -> None:
        """Give a reply of so many bytes its time on the wire, and the slack."""
        self._deadline = time.monotonic() + packet_length * BITS_PER_BYTE / self._baud + self.slack_s

    def give(self, duration_s: float) -> None:
        """Give the reply until `duration_s` from now, and the slack."""
        self._deadline = time.monotonic() + duration_s + self.slack_s

    def isPacketTimeout(self) -> bool:
        """True: `readPort` itself waits until the deadline, so that what it did not bring is lost."""
        return True

    def readPort(self, length: int) -> bytes:
        """Up to `length` bytes of the current packet, once all of it is there; nothing after the deadline."""
        if not self._frame and not self.next_frame():
            return b""
        part = self._frame[self._given : self._given + length]
        self._given += len(part)
        return part

    # -- packets in the stream -----------------------------------------------------------------------

    def next_frame(self) -> bytes:
        """Wait for the next status packet and return it as received; empty when there is none.

        There is none when the deadline passes, or when all the bytes that can come are there.
        """
        expired = False
        while True:
            found, missing = self._find_frame(expired)
            if found:
                self._frame, self._given = found, 0
                return found
            complete = self.heard >= self.expected and missing == 0
            if complete or expired:
                self._late = not complete
                return b""
            expired = not self._receive(self._deadline, missing)

    def wait_for_all(self) -> bytes:
        """Wait for the bytes that are expected, and return what is there; less when the deadline passes."""
        while self.heard < self.expected and self._receive(self._deadline):
            pass
        self._late = self.heard < self.expected
        return bytes(self._buffer)

    def goes_on(self, duration_s: float) -> bool:
        """Whether another status packet follows that nobody asked for; if none does, none is waited for later."""
        self.expected = self.heard + 1
        self.give(duration_s)
        found = bool(self.next_frame())
        if not found:
            self.expected, self._late = self.heard, False
        return found

    def accept(self) -> None:
        """The packet was good: go on behind it."""
        self._start += len(self._frame)
        self._frame, self._given = b"", 0
        self._late = self.heard < self.expected

    def reject(self) -> None:
        """The packet was none: look for another from its second byte on."""
        self._start += 1
        self._frame, self._given = b"", 0

    def _find_frame(self, expired: bool) -> tuple[bytes, int]:
        """The next packet that is all there, or how many bytes one that has begun still lacks."""
        while True:
            at = self._buffer.find(HEADER, self._start)
            if at < 0:  # the tail may be the beginning of a header
                self._start = max(self._start, len(self._buffer) - len(HEADER) + 1)
                return b"", 0
            self._start = at
            available = len(self._buffer) - at
            total = SHORTEST_FRAME
            if available > FRAME_OVERHEAD:
                total = FRAME_OVERHEAD + self._buffer[at + 5] + 256 * self._buffer[at + 6]
                if not SHORTEST_FRAME <= total <= self.longest_frame or self._buffer[at + 7] != STATUS:
                    self._start += 1
                    continue
            if available >= total:
                return bytes(self._buffer[at : at + total]), 0
            if not expired:
                return b"", total - available
            self._start += 1

    def _receive(self, deadline: float, needed: int = 1) -> bool:
        """Wait for bytes until the deadline; False when none came."""
        if needed > 1:  # sleep through what the rest needs on the wire, so that one wake-up takes it all
            wire_s = needed * BITS_PER_BYTE / self._baud
            time.sleep(max(0.0, min(wire_s, deadline - time.monotonic())))
        while True:
            left = deadline - time.monotonic()
            if left <= 0.0:
                return self._take_waiting()
            # Rounded up: a poll that ends early would be asked again at once, and again.
            if self._poll.poll(int(1e3 * left) + 1) and self._take_waiting():
                return True

    def _take_waiting(self) -> bool:
        """Read what has arrived, without waiting."""
        try:
            data = os.read(self._fd, 4096)
        except BlockingIOError:
            return False
        except OSError as wrong:
            self._lost(str(wrong), wrong)
        if not data:
            self.check()
            return False
        self._buffer += data
        self.heard += len(data)
        return True

    def _wait_to_write(self, deadline: float) -> None:
        ready = select.poll()
        ready.register(self._fd, select.POLLOUT)
        if time.monotonic() > deadline or not ready.poll(int(1e3 * WRITE_PATIENCE_S)):
            self._lost(f"takes no bytes for {WRITE_PATIENCE_S:g} s")

    def _forget(self) -> None:
        self._buffer.clear()
        self._start = self._given = self.heard = 0
        self._frame = b""

    def _lost(self, why: str, cause: OSError | None = None) -> None:
        raise BusClosed(f"{self.path} is gone ({why}); remedy: plug it in, then connect") from cause
