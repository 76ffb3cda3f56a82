"""The serial port: bytes out at once, bytes in until a deadline, and a port that is gone is a `BusClosed`."""

from __future__ import annotations

import os
import select
import termios
import time

import serial

from ori_deploy.actuators.bus import BusClosed
from ori_deploy.actuators.claim import DeviceClaim, why_closed

WRITE_PATIENCE_S = 0.2
"""How long the driver may refuse bytes; a queue that long would be of no use any more."""

CFLAG = 2


class SerialPort:
    """A serial port of this process alone.

    Parameters
    ----------
    path
        Device, such as "/dev/ttyACM0".
    baud
        Bits per second.
    """

    def __init__(self, path: str, baud: int) -> None:
        self.path = path
        self._baud = baud
        self._claim = DeviceClaim(path)
        self._serial: serial.Serial | None = None
        self._fd = -1

    @property
    def is_open(self) -> bool:
        """Whether it was opened and not closed since; a device may be gone all the same."""
        return self._serial is not None

    def open(self) -> None:
        """Open the device.

        Raises
        ------
        BusClosed
            It is not there, not a serial port, not permitted, or in use.
        """
        self._claim.take()
        try:
            self._serial = serial.Serial(self.path, self._baud, timeout=0, exclusive=True)
            self._fd = self._serial.fileno()
            _keep_dtr(self._fd)
        except serial.SerialException as wrong:
            self._claim.release()
            why = why_closed(wrong, self.path, "microcontroller")
            raise BusClosed(f"{self.path} cannot be opened: {why}") from wrong
        except (ValueError, OSError, termios.error) as wrong:
            self.close()
            raise BusClosed(
                f"{self.path} cannot be opened at {self._baud} baud: {wrong}; remedy: check the port and the rate"
            ) from wrong

    def close(self) -> None:
        """Close it. Safe to call twice, and when the device is gone."""
        if self._serial is not None:
            self._serial.close()
            self._serial = None
            self._fd = -1
        self._claim.release()

    def check(self) -> None:
        """Raise `BusClosed` when the device is gone, without sending anything."""
        self._require_open()
        probe = select.poll()
        probe.register(self._fd, 0)
        if any(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL) for _, event in probe.poll(0)):
            self._lost("hung up")

    def write(self, data: bytes) -> None:
        """Send all of it."""
        self._require_open()
        sent = 0
        deadline = time.monotonic() + WRITE_PATIENCE_S
        while sent < len(data):
            try:
                sent += os.write(self._fd, data[sent:])
            except BlockingIOError:
                self._wait(select.POLLOUT, deadline)
                if time.monotonic() >= deadline:
                    self._lost(f"takes no bytes for {WRITE_PATIENCE_S:g} s")
            except OSError as wrong:
                self._lost(str(wrong), wrong)

    def read(self, wait_s: float = 0.0) -> bytes:
        """What has arrived; waits up to `wait_s` for the first byte. Empty when nothing came."""
        self._require_open()
        if wait_s > 0.0:
            self._wait(select.POLLIN, time.monotonic() + wait_s)
        try:
            data = os.read(self._fd, 4096)
        except BlockingIOError:
            return b""
        except OSError as wrong:
            self._lost(str(wrong), wrong)
            raise
        if not data:
            self.check()
        return data

    def _wait(self, event: int, deadline: float) -> None:
        """Sleep until the port is ready, or the deadline has passed."""
        ready = select.poll()
        ready.register(self._fd, event)
        while (left := deadline - time.monotonic()) > 0.0:
            # Rounded up: a poll that ends early would be asked again at once, and again.
            if ready.poll(int(1e3 * left) + 1):
                return

    def _require_open(self) -> None:
        if self._serial is None:
            raise BusClosed(f"{self.path} is not open")

    def _lost(self, why: str, cause: OSError | None = None) -> None:
        raise BusClosed(f"{self.path} is gone ({why}); remedy: plug it in, then connect") from cause


def _keep_dtr(fd: int) -> None:
    """Leave the DTR line as it is at close: on most boards its next edge restarts the microcontroller."""
    settings = termios.tcgetattr(fd)
    settings[CFLAG] &= ~termios.HUPCL
    termios.tcsetattr(fd, termios.TCSANOW, settings)
