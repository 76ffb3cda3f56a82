"""The folder for sockets and locks of running programs: this user's alone, and gone with the session.

`$XDG_RUNTIME_DIR/ori-deploy`, or `/tmp/ori-deploy-UID` without it. In /tmp anybody may make a folder of that
name first, so that nothing is trusted that is not a folder of this user's own which nobody else can enter.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from pathlib import Path

from ori_deploy.errors import FileError

NAME = "ori-deploy"
FALLBACK = Path("/tmp")
RUN_USER = Path("/run/user")


def runtime_dir() -> Path:
    """The folder of this user, made if need be.

    Raises
    ------
    FileError
        It cannot be made, or is not this user's alone.
    """
    folder = _own()
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
    except FileExistsError:
        pass  # something else of that name: found out below
    except OSError as wrong:
        raise FileError(
            f"{folder}: the folder for sockets and locks cannot be made",
            value=wrong.strerror,
            remedy="set XDG_RUNTIME_DIR to a folder of your own",
        ) from wrong
    problem = _problem(folder, os.geteuid())
    if problem is not None:
        raise FileError(
            f"{folder}: not a safe place for sockets and locks",
            value=problem,
            limit="a folder of your own that nobody else can enter",
            remedy=f"remove it, or chmod 700 {folder}, or set XDG_RUNTIME_DIR to a folder of your own",
        )
    return folder


def runtime_dirs(uid: int) -> tuple[Path, ...]:
    """Where a program of that user may have put its sockets and locks: those folders that are there and safe.

    More than one, since a service has no XDG_RUNTIME_DIR where a terminal has it.
    """
    candidates = [RUN_USER / str(uid) / NAME, FALLBACK / f"{NAME}-{uid}"]
    if uid == os.geteuid():
        candidates.insert(0, _own())
    return tuple(folder for folder in _once(candidates) if _problem(folder, uid) is None)


def _own() -> Path:
    uid = os.geteuid()
    given = os.environ.get("XDG_RUNTIME_DIR", "")
    # After `su` or `sudo -E` it may still be another user's.
    if Path(given).is_absolute() and _is_folder_of(Path(given), uid):
        return Path(given) / NAME
    return FALLBACK / f"{NAME}-{uid}"


def _is_folder_of(folder: Path, uid: int) -> bool:
    try:
        found = folder.stat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == uid


def _problem(folder: Path, uid: int) -> str | None:
    """Why a folder cannot be trusted, or None."""
    try:
        found = folder.lstat()
    except OSError as wrong:
        return str(wrong.strerror)
    if not stat.S_ISDIR(found.st_mode):
        return "a symbolic link" if stat.S_ISLNK(found.st_mode) else "not a folder"
    if found.st_uid != uid:
        return f"owned by user {found.st_uid}"
    mode = stat.S_IMODE(found.st_mode)
    return f"mode {mode:o}" if mode & 0o077 else None


def _once(folders: Iterable[Path]) -> Iterable[Path]:
    return dict.fromkeys(folders)
