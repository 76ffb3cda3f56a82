"""The journal: what was about to be done, on the disk before it is done, so that a restart can tell where it was.

One entry, replaced whole: written to a name beside it, synced, renamed, the folder synced. That takes a disk
anything from a millisecond to a second, so a thread does it, and the loop waits at rest, stepping on, until it is
done.
"""

from __future__ import annotations

import json
import math
import os
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

from ori_deploy.errors import FileError

SCHEMA = "ori-deploy/journal/1"

CLOSE_S = 5.0
"""How long closing waits for the disk."""

_TEXT = ("command", "stage", "state", "design_sha256", "rig_sha256", "written")


@dataclass(frozen=True, slots=True)
class Entry:
    """Where the structure was, and what was about to be done.

    Attributes
    ----------
    command, stage
        "deploy" and "open", say; empty when nothing was being carried out.
    state
        Of the controller.
    from_fold, to_fold
        Folds between which the cells are while this entry stands.
    design_sha256, rig_sha256
        What was moved, and on what; only the first is compared.
    written
        Date and time, for people: the computer's clock may be wrong.
    """

    command: str
    stage: str
    state: str
    from_fold: float
    to_fold: float
    design_sha256: str = ""
    rig_sha256: str = ""
    written: str = ""

    @property
    def folds(self) -> tuple[float, float]:
        """Lowest and highest fold that agree with it."""
        return min(self.from_fold, self.to_fold), max(self.from_fold, self.to_fold)

    def __str__(self) -> str:
        low, high = self.folds
        where = f"at fold {low:.3f}" if low == high else f"between fold {low:.3f} and {high:.3f}"
        doing = f"{self.command}, stage {self.stage}" if self.stage else self.state
        return f"{doing}, {where}, written {self.written}"


class Journal(Protocol):
    """Where the controller leaves word."""

    @property
    def last(self) -> Entry | None:
        """What was there at the start; None when there was nothing."""

    def post(self, entry: Entry) -> None:
        """Replace the entry; returns at once."""

    def settled(self) -> bool:
        """Whether the last entry is on the disk, or cannot be brought there."""

    @property
    def failure(self) -> str | None:
        """Why the last entry is not on the disk."""


def read_journal(path: Path) -> Entry | None:
    """The entry of a journal; None where there is none.

    Raises
    ------
    FileError
        It cannot be read, or holds something else.
    """
    remedy = "see where the structure stands, then remove the file"
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError) as wrong:
        raise FileError(f"{path}: the journal cannot be read", value=str(wrong), remedy=remedy) from wrong
    try:
        if data.pop("schema") != SCHEMA:
            raise ValueError("another schema")
        entry = Entry(**data)
        texts = all(isinstance(getattr(entry, name), str) for name in _TEXT)
        if not texts or not all(math.isfinite(fold) for fold in entry.folds):
            raise ValueError("a value of the wrong kind")
    except (AttributeError, KeyError, TypeError, ValueError) as wrong:
        raise FileError(f"{path}: not a journal", value=str(wrong), limit=SCHEMA, remedy=remedy) from wrong
    return entry


class JournalFile:
    """A journal on the disk.

    Parameters
    ----------
    path
        Of the file; its folder has to be there.
    wait
        Whether `post` itself waits for the disk: where time is virtual nobody is kept waiting by it.

    Raises
    ------
    FileError
        What is there cannot be read, or nothing can be written there.
    """

    def __init__(self, path: Path, *, wait: bool = False) -> None:
        self.path = path
        self.last = read_journal(path)
        _check_folder(path)
        self._wait = wait
        self._news = threading.Condition()
        self._next: Entry | None = None
        self._busy = False
        self._closed = False
        self._failure: str | None = None
        self._thread = threading.Thread(target=self._write_on, name="journal", daemon=True)
        self._thread.start()

    @property
    def failure(self) -> str | None:
        """Why the last entry is not on the disk."""
        return self._failure

    def post(self, entry: Entry) -> None:
        """Replace the entry. Of two that come faster than the disk is, the later counts."""
        with self._news:
            self._next = entry
            self._news.notify_all()
            if self._wait:
                self._news.wait_for(lambda: self._next is None and not self._busy)

    def settled(self) -> bool:
        """Whether the last entry is on the disk, or cannot be brought there."""
        with self._news:
            return self._next is None and not self._busy

    def close(self) -> None:
        """Finish what was posted. Safe to call twice."""
        with self._news:
            self._closed = True
            self._news.notify_all()
        self._thread.join(CLOSE_S)  # a disk that never answers is left alone; the thread ends with the program

    def __enter__(self) -> JournalFile:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def _write_on(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._next is not None or self._closed)
                entry, self._next = self._next, None
                if entry is None:
                    return
                self._busy = True
            try:
                write_entry(self.path, entry)
                failure = None
            except Exception as wrong:  # noqa: BLE001  whoever waits for this thread has to be answered
                failure = f"{self.path}: {getattr(wrong, 'strerror', None) or wrong}"
            with self._news:
                self._failure, self._busy = failure, False
                self._news.notify_all()


def _check_folder(path: Path) -> None:
    """Whether an entry can be written, before anything depends on it."""
    try:
        attempt = path.with_name(f".{path.name}.{os.getpid()}.partial")
        attempt.touch()
        attempt.unlink()
    except OSError as wrong:
        raise FileError(
            f"{path}: the journal cannot be written",
            value=wrong.strerror,
            remedy="check the folder",
        ) from wrong


def write_entry(path: Path, entry: Entry) -> None:
    """Replace the file, whole or not at all, and on the disk when this returns. Raises OSError."""
    stamp = entry.written or time.strftime("%Y-%m-%d %H:%M:%S")
    data = {"schema": SCHEMA, **asdict(entry), "written": stamp}
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with partial.open("w", encoding="utf-8") as file:
            json.dump(data, file, indent=1, allow_nan=False)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
