"""Which journal a session writes: one per rig file, and none for what is not there tomorrow."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import Clock, VirtualClock
from ori_deploy.deploy.journal import JournalFile
from ori_deploy.errors import FileError

_PSEUDO_TERMINALS = "/dev/pts/"


def default_path(rig_path: Path, rig: ResolvedRig, port: str | None) -> Path | None:
    """In `$XDG_STATE_HOME/ori-deploy`, named after the rig file; None for simulated devices.

    Simulated ones stand somewhere else each time they are started, and a journal would only be in the way.

    Raises
    ------
    FileError
        The rig comes from a pipe: it has another name each time, and the journal would never be found again.
    """
    settings = rig.wiring.settings if rig.wiring is not None else rig.mcu.settings if rig.mcu is not None else None
    device = port or (settings.port if settings is not None else "")
    if rig.backend == "mock" or not device or os.path.realpath(device).startswith(_PSEUDO_TERMINALS):
        return None
    if rig_path.exists() and not rig_path.is_file():
        raise FileError(
            f"--rig {rig_path}: no file, so the session has no journal that a later one would find",
            limit="a regular file, or --journal",
            remedy="name a journal with --journal, the same each time",
        )
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    name = hashlib.sha256(os.fsencode(rig_path.resolve())).hexdigest()[:12]
    return state / "ori-deploy" / f"{rig_path.stem}-{name}.journal.json"


@contextmanager
def journal(
    path: Path | None, rig_path: Path, rig: ResolvedRig, port: str | None, clock: Clock
) -> Iterator[JournalFile | None]:
    """The journal of a session: at `path`, or where it is by default; None for none.

    Raises
    ------
    FileError
        It cannot be read or written; nothing has moved yet.
    """
    where = path or default_path(rig_path, rig, port)
    if where is None:
        yield None
        return
    try:
        where.parent.mkdir(parents=True, exist_ok=True)
    except OSError as wrong:
        raise FileError(
            f"{where}: the journal cannot be written", value=wrong.strerror, remedy="give another with --journal"
        ) from wrong
    with JournalFile(where, wait=isinstance(clock, VirtualClock)) as file:
        yield file
