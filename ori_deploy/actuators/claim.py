"""One program per serial device: a lock that says who holds it.

The lock is a record lock of the kernel's on a file in the user's runtime folder. It ends with the process that
took it, even by kill -9, a child made by fork does not inherit it, and the kernel tells the holder's pid. The
port has a second lock on the device itself, which keeps out other users and other programs that lock devices.
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
import sys
import weakref
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self
from urllib.parse import quote

from ori_deploy.actuators.bus import BusClosed
from ori_deploy.errors import FileError
from ori_deploy.runtime_dir import runtime_dir, runtime_dirs

_FLOCK = "hhqqi"
"""struct flock: type, whence, start, length, pid."""

_PSEUDO_TERMINALS = "/dev/pts/"

_LONGEST_WORDS = 200
"""Of a command line, in an error that is one line itself."""

_held: dict[str, str] = {}
"""Devices that this process holds, by their resolved path: a record lock does not keep a process from itself."""


def held_devices() -> tuple[str, ...]:
    """Devices that this process holds, as they were named when it took them."""
    return tuple(_held.values())


class DeviceClaim:
    """The right to use a serial device, for this process alone.

    Parameters
    ----------
    path
        Device, or a symbolic link to it.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._let_go: weakref.finalize[..., DeviceClaim] | None = None

    def take(self) -> None:
        """Take it, or keep it. What is no device is nobody's: opening it will say so.

        Raises
        ------
        BusClosed
            Another program has it, or there is no safe folder for the lock.
        """
        if self._taken or not Path(self._path).is_char_device():
            return
        device = _identity(self._path)
        if device in _held:
            raise BusClosed(
                f"{self._path} cannot be opened: this program has it already (as {_held[device]}); "
                "remedy: name another device"
            )
        lock, fd = self._open_lock(device)
        try:
            fcntl.lockf(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as wrong:
            os.close(fd)
            raise BusClosed(f"{self._path} cannot be opened: {in_use(self._path)}") from wrong
        try:
            os.ftruncate(fd, 0)
            os.write(fd, f"{os.getpid()} {_own_words()}\n".encode(errors="replace"))  # names may be of any bytes
        except OSError as wrong:
            os.close(fd)
            raise BusClosed(f"{self._path} cannot be locked for this program alone: {wrong}") from wrong
        _held[device] = self._path
        # A port that is dropped without being closed closes its device all the same; the claim goes with it.
        self._let_go = weakref.finalize(self, _let_go, device, lock, fd)
        self._let_go.atexit = False  # the end of the process does it, and that of a forked child must not

    def release(self) -> None:
        """Give it back. Safe to call twice."""
        if self._let_go is not None:
            self._let_go()

    @property
    def _taken(self) -> bool:
        return self._let_go is not None and self._let_go.alive

    def __enter__(self) -> Self:
        self.take()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def _open_lock(self, device: str) -> tuple[Path, int]:
        try:
            path = runtime_dir() / _lock_name(device)
            return path, os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        except (FileError, OSError) as wrong:
            raise BusClosed(f"{self._path} cannot be locked for this program alone: {wrong}") from wrong


def why_closed(wrong: OSError, path: str, thing: str) -> str:
    """Why a port did not open, with a remedy; `thing` is what would be plugged in there."""
    text = str(wrong)
    if wrong.errno == errno.EACCES:
        return "permission denied; remedy: add yourself to the group dialout, then log in again"
    if wrong.errno == errno.ENOENT:
        return f"no such device; remedy: plug the {thing} in, or correct the port"
    if "lock" in text.lower() or wrong.errno in (errno.EAGAIN, errno.EBUSY):
        return in_use(path)
    if not Path(path).is_char_device() or "Inappropriate ioctl" in text or wrong.errno == errno.ENXIO:
        found = "a folder" if Path(path).is_dir() else "a file" if Path(path).is_file() else "another device"
        return f"it is {found}; limit: a serial port, such as /dev/ttyUSB0; remedy: correct the port"
    return f"{text}; remedy: check the port"


def _let_go(device: str, lock: Path, fd: int) -> None:
    if device.startswith(_PSEUDO_TERMINALS):  # nobody will come to this name again
        with suppress(OSError):
            lock.unlink()
    # Any other file stays: who removes a file that another is about to lock lets two in.
    os.close(fd)
    _held.pop(device, None)


def _identity(path: str) -> str:
    """What a device is known by: its resolved path, and when it began where its number is used again.

    A pseudo-terminal's number is given out again while a program may still hold an end of the one before.
    """
    device = os.path.realpath(path)
    if device.startswith(_PSEUDO_TERMINALS):
        try:
            return f"{device}@{Path(device).stat().st_ctime_ns}"
        except OSError:
            return device  # gone meanwhile: opening it will say so
    return device


def in_use(path: str) -> str:
    """That another program has a device, which one, and what helps."""
    pid, words = _holder(path)
    if pid is None:
        return "another program has it; remedy: end that program"
    what = f"{pid}, {words}" if words else str(pid)
    return f"another program has it (pid {what}); remedy: end that program, or wait for its end"


def _holder(path: str) -> tuple[int | None, str]:
    """Pid and command line of the program that has a device, as far as they can be known."""
    name = _lock_name(_identity(path))
    for folder in runtime_dirs(os.geteuid()):
        pid = _lock_holder(folder / name)
        if pid is not None:
            return pid, _noted_words(folder / name, pid)
    pid = _flock_holder(path)  # of another user, or of a program that is not ours
    return pid, "" if pid is None else _words_of(pid)


def _lock_holder(lock: Path) -> int | None:
    """Who has a lock file, asked of the kernel."""
    try:
        fd = os.open(lock, os.O_RDWR | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        asked = struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
        kind, _, _, _, pid = struct.unpack(_FLOCK, fcntl.fcntl(fd, fcntl.F_GETLK, asked))
    except OSError:
        return None
    finally:
        os.close(fd)
    return int(pid) if kind != fcntl.F_UNLCK and pid > 0 else None


def _flock_holder(path: str) -> int | None:
    """Who has locked a device itself, where the kernel lists it."""
    try:
        found = Path(path).stat()
        lines = Path("/proc/locks").read_text().splitlines()
    except OSError:
        return None
    where = f"{os.major(found.st_dev):02x}:{os.minor(found.st_dev):02x}:{found.st_ino}"
    for words in map(str.split, lines):
        if len(words) > 5 and words[1] == "FLOCK" and words[5] == where and words[4].isdigit():
            return int(words[4]) or None
    return None


def _noted_words(lock: Path, pid: int) -> str:
    """The command line that the holder wrote down, unless it has not come to that yet."""
    try:
        number, _, words = lock.read_text(errors="replace").strip().partition(" ")
    except OSError:
        return ""
    return words if number == str(pid) else _words_of(pid)


def _words_of(pid: int) -> str:
    try:
        raw = Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return ""
    return _one_line(raw.replace(b"\0", b" ").decode(errors="replace"))


def _own_words() -> str:
    """How this program was called, in one line."""
    program = Path(sys.argv[0] or "python")
    name = "ori-deploy" if program.parts[-3:] == ("ori_deploy", "cli", "__main__.py") else program.name
    return _one_line(" ".join((name, *sys.argv[1:])))


def _one_line(words: str) -> str:
    return " ".join(words.split())[:_LONGEST_WORDS]


def _lock_name(device: str) -> str:
    return f"{quote(device, safe='')}.lock"
