"""The pty that a host opens in place of an adapter, and the link by which it finds it."""

from __future__ import annotations

import errno
import os
import select
import socket
import struct
import tty
from fcntl import ioctl
from hashlib import sha256
from pathlib import Path

from ori_deploy.errors import InputError

_TCGETS2 = 0x802C542A
_TERMIOS2_BYTES, _OUTPUT_SPEED_AT = 44, 40


class Plug:
    """A pty with a link to it.

    Parameters
    ----------
    link
        Where the link goes.

    Attributes
    ----------
    device
        The pty's own name while it is plugged in.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self.device = ""
        self._master = self._slave = -1

    def put_in(self) -> None:
        """Open a new pty, and let the link point at it."""
        self._master, self._slave = os.openpty()  # held open: a pty without a slave reports a hang-up
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)
        fresh = self.link.with_name(f".{self.link.name}.{os.getpid()}")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(self.device)
        fresh.replace(self.link)

    def pull_out(self) -> None:
        """Close the pty: whoever has it open is hung up on. The link goes, too."""
        if self._master < 0:
            return
        if self.link.is_symlink() and str(self.link.readlink()) == self.device:
            self.link.unlink()
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = -1

    def fileno(self) -> int:
        """To wait on; -1 while pulled out."""
        return self._master

    def baud(self) -> int:
        """Rate that the host has set."""
        raw = ioctl(self._slave, _TCGETS2, bytes(_TERMIOS2_BYTES))
        speed: int = struct.unpack_from("I", raw, _OUTPUT_SPEED_AT)[0]
        return speed

    def receive(self) -> bytes:
        """What the host has sent."""
        try:
            return os.read(self._master, 65536)
        except BlockingIOError:
            return b""

    def send(self, data: bytes) -> None:
        """Hand bytes to the host. What it does not take in time is lost, as on a real line."""
        while data:
            try:
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                waiting = select.poll()
                waiting.register(self._master, select.POLLOUT)
                if not waiting.poll(100):
                    return


def claim(link: Path, control: Path) -> socket.socket:
    """Make sure that no other bus has the link, and clear away what a dead one left.

    Returns
    -------
    socket
        The claim, until it is closed or the process ends: a name that Linux gives to one alone.

    Raises
    ------
    InputError
        The link is somebody else's, or cannot be put there.
    """
    if link.exists() and not link.is_symlink():
        raise InputError(f"{link}: there is a file of this name", remedy="choose another --link")
    if not link.parent.is_dir():
        raise InputError(f"{link}: its folder does not exist", value=link.parent, remedy="make it, or choose another")
    if len(str(control).encode()) > 100:
        raise InputError(
            f"{control}: too long for a socket's name", value=f"{len(str(control))} characters", limit="100",
            remedy="choose a shorter --control",
        )  # fmt: skip
    if not control.parent.is_dir():
        raise InputError(
            f"{control}: its folder does not exist", value=control.parent, remedy="make it, or choose another"
        )
    held = socket.socket(socket.AF_UNIX)
    try:
        where = str(link.parent.resolve() / link.name)
        held.bind(b"\0virtual-dynamixel-bus-" + sha256(where.encode()).hexdigest().encode())
    except OSError:
        held.close()
        raise _taken(link) from None
    try:
        _clear(link, control)
    except InputError:
        held.close()
        raise
    return held


def _taken(link: Path) -> InputError:
    return InputError(f"{link}: another virtual bus has it", remedy="end that one, or choose another --link")


def _clear(link: Path, control: Path) -> None:
    if control.exists():
        if not control.is_socket():
            raise InputError(f"{control}: there is a file of this name", remedy="choose another --control")
        with socket.socket(socket.AF_UNIX) as probe:
            wrong = probe.connect_ex(str(control))
        if wrong == 0:
            raise _taken(link)
        if wrong in (errno.ECONNREFUSED, errno.ENOENT):
            control.unlink(missing_ok=True)
        else:
            raise InputError(
                f"{control}: cannot be used", value=os.strerror(wrong), remedy="choose another --control"
            )
