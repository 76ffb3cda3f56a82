"""The files that a session is given: those it reads, once each, and those it writes, which are no others."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.cli.journal import default_path
from ori_deploy.errors import FileError
from ori_deploy.files.text import HeldFile, read_bytes
from ori_deploy.telemetry.log import kept_as, there


def held(path: Path) -> HeldFile:
    """Read a file, for all who look at it in this session: they see the same, and a log keeps just that.

    Raises
    ------
    FileError
        It cannot be read.
    """
    return HeldFile.of(path, read_bytes(path))


def named(paths: Iterable[Path | None]) -> tuple[Path, ...]:
    """Those that were given."""
    return tuple(path for path in paths if path is not None)


def refuse_shared(
    log: Path | None, journal: Path | None, rig: ResolvedRig, port: str | None, rig_path: Path, *others: Path
) -> None:
    """Refuse a log or a journal that would take the place of the other, or of a file that is read.

    A log displaces what is there under its name, and what displaces a journal leaves nobody who knows how far the
    last motion came; a journal that finds a log tells people to remove it.

    Parameters
    ----------
    log, journal
        As given; None for no log, and for the default journal.
    rig, port
        What the default journal depends on.
    rig_path, others
        Files that the session reads.

    Raises
    ------
    FileError
        Names both; nothing is opened yet.
    """
    where = journal or default_path(rig_path, rig, port)
    if log is not None and not log.name:
        raise FileError(f"--log {log}: has no name", limit="a file", remedy="give the name of a file")
    for option, path in (("--log", log), ("--journal", where)):
        for read in (rig_path, *others):
            if path is not None and _one_file(path, read):
                raise FileError(
                    f"{option} {path}: is a file that is read here",
                    value=str(read),
                    limit="a file of its own",
                    remedy="choose another name",
                )
    if log is None or where is None:
        return
    if _one_file(log, where) or _one_file(kept_as(log), where) or _written_as(log, where) or _written_as(where, log):
        raise FileError(
            f"--log {log}: would take the place of the journal, or the journal its",
            value=f"the journal {where}",
            limit="a file each, and neither a name that the other is written or kept under",
            remedy="choose another name for the log",
        )


def _one_file(a: Path, b: Path) -> bool:
    """Whether two names are one file, or would be if they were there."""
    if os.path.realpath(a) == os.path.realpath(b):  # unlike `resolve`, it has an answer for links in a circle, too
        return True
    return there(a) and there(b) and a.samefile(b)


def _written_as(path: Path, other: Path) -> bool:
    """Whether `other` is a name under which `path` is, until it is whole: by this process or an earlier one."""
    whole, other = Path(os.path.realpath(path)), Path(os.path.realpath(other))
    name = rf"\.?{re.escape(whole.name)}\.\d+\.partial"
    return whole.parent == other.parent and re.fullmatch(name, other.name) is not None
