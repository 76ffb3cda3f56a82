"""The key of MAVLink's signatures from its file, and the timestamps over restarts."""

from __future__ import annotations

import hashlib
import json
import logging
import math
import os
import stat
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from ori_deploy.errors import FileError
from ori_deploy.files.text import write_atomically
from ori_deploy.wire.signing import KEY_BYTES, LATEST, TICKS_PER_S, Signing

SCHEMA = "ori-deploy/mavlink-timestamps/1"
PASSPHRASE = b"passphrase:"
FORMS = "32 raw bytes, 64 hexadecimal digits, or passphrase: and one line of text"
MOST_BYTES = 4096
SAVE_S = 10.0
"""How often timestamps are written at most."""

AHEAD_TICKS = int(2 * SAVE_S * TICKS_PER_S)
"""So much higher than used is the timestamp that is kept: what is used until the next save stays below it."""

log = logging.getLogger(__name__)


def load_key(path: Path) -> bytes:
    """The 32 bytes of the key in a file: raw, as 64 hexadecimal digits, or hashed from a passphrase as stations do.

    Raises
    ------
    FileError
        It cannot be read, others may read it, or it holds no key. What it holds is never shown.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        try:
            _check(path, os.fstat(handle).st_mode)
            content = os.read(handle, MOST_BYTES + 1)
        finally:
            os.close(handle)
    except OSError as wrong:
        raise FileError(
            f"{path}: the signing key cannot be read",
            value=wrong.strerror,
            remedy="check the name and the permissions",
        ) from wrong
    except ValueError as wrong:
        raise FileError(f"{str(path)!r}: not a file name", remedy="mend the name") from wrong
    key = _key(content)
    if key is None:
        raise FileError(
            f"{path}: holds no signing key", value=f"{len(content)} bytes", limit=FORMS, remedy="make the key again"
        )
    return key


def _check(path: Path, mode: int) -> None:
    if not stat.S_ISREG(mode):
        raise FileError(f"{path}: the signing key is not a file", limit="a regular file", remedy="check the name")
    if mode & 0o077:
        raise FileError(
            f"{path}: others may read the signing key",
            value=f"mode {stat.S_IMODE(mode):o}",
            limit="mode 600 or 400",
            remedy=f"chmod 600 {path}, and a new key if others are on this machine",
        )


def _key(content: bytes) -> bytes | None:
    line = content.rstrip(b"\r\n")
    if line.startswith(PASSPHRASE):
        phrase = line.removeprefix(PASSPHRASE)
        usable = phrase and b"\n" not in phrase and len(content) <= MOST_BYTES
        return hashlib.sha256(phrase).digest() if usable else None
    if len(content) == KEY_BYTES:
        return content
    try:
        key = bytes.fromhex(line.decode("ascii"))
    except ValueError:
        return None
    return key if len(key) == KEY_BYTES and len(line) == 2 * KEY_BYTES else None


class KeptTimestamps:
    """Keeps the timestamps of a `Signing` in a file, so that after a restart recordings are refused still.

    Best effort: a file that cannot be read or written is logged, once, and stops nobody.

    Parameters
    ----------
    path
        The file; `timestamps_beside` names one.
    signing
        What was kept is put into it.
    now
        Monotonic seconds.
    """

    def __init__(self, path: Path, signing: Signing, now: Callable[[], float] = time.monotonic) -> None:
        self._path, self._signing, self._now = path, signing, now
        self._saved_s = -math.inf
        self._complained = False
        self._restore()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._save(0)  # nothing is signed after that

    def tick(self) -> None:
        """Save when it is time; to be called as often as convenient."""
        if self._now() - self._saved_s >= SAVE_S:
            self._save(AHEAD_TICKS)

    def _save(self, ahead: int) -> None:
        signing, self._saved_s = self._signing, self._now()
        document = {
            "schema": SCHEMA,
            "timestamp": min(max(signing.timestamp, signing.clock()) + ahead, LATEST),
            "streams": [[*stream, last] for stream, last in signing.streams.items()],
        }
        try:
            write_atomically(self._path, json.dumps(document))
        except FileError as wrong:
            self._complain(wrong)

    def _restore(self) -> None:
        try:
            document = json.loads(self._path.read_text(encoding="utf-8"))
            if document["schema"] != SCHEMA:
                raise ValueError("another schema")
            timestamp = _whole(document["timestamp"], LATEST)
            streams = {
                (_whole(system, 255), _whole(component, 255), _whole(link, 255)): _whole(last, LATEST)
                for system, component, link, last in document["streams"]
            }
        except FileNotFoundError:
            return
        except (OSError, ValueError, TypeError, KeyError, RecursionError) as wrong:
            self._complain(wrong)
            return
        self._signing.timestamp = max(self._signing.timestamp, timestamp)
        self._signing.streams.update(streams)

    def _complain(self, wrong: Exception) -> None:
        if not self._complained:
            log.warning("timestamps of signatures are not kept over restarts: %s: %s", self._path, wrong)
        self._complained = True


def timestamps_beside(key_file: Path) -> Path:
    """Where the timestamps of a key are kept: one program's, as two would undo each other's."""
    return key_file.with_name(f"{key_file.name}.timestamps")


def _whole(value: object, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise ValueError(f"{value!r} is not from 0 to {most}")
    return value
