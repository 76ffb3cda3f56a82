"""Several outputs of one command, files and folders: all of them appear when everything is made, or none does."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType

from ori_deploy.cli.steps import refuse_unwritable
from ori_deploy.errors import FileError


class Staging:
    """Where outputs are made, beside the places they go to when the block ends well.

    A folder that is there already is replaced where it holds nothing but what is written anew; other files in it
    are somebody's, and it is refused.
    """

    def __init__(self) -> None:
        self._moves: list[tuple[Path, Path]] = []
        self._made = ExitStack()

    def __enter__(self) -> Staging:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, wrong: BaseException | None, at: TracebackType | None
    ) -> None:
        with self._made:
            if kind is None:
                self._move()

    def file(self, target: Path) -> Path:
        """Where to write what becomes the file `target`."""
        refuse_unwritable(target, *(there for _, there in self._moves if not there.is_dir()))
        refuse_entangled(target, *(there for _, there in self._moves))
        return self._beside(target)

    def folder(self, target: Path) -> Path:
        """An empty folder that becomes `target`."""
        if target.exists() and not target.is_dir():
            raise FileError(f"{target}: not a folder", limit="a folder", remedy="choose another name")
        refuse_entangled(target, *(there for _, there in self._moves))
        refuse_current(target)
        here = self._beside(target)
        here.mkdir()
        return here

    def _beside(self, target: Path) -> Path:
        place = target.resolve()
        try:
            self._make(place.parent)
            temporary = Path(tempfile.mkdtemp(dir=place.parent, prefix=f".{place.name}."))
        except OSError as wrong:
            raise _unwritable(target, wrong) from wrong
        self._made.callback(shutil.rmtree, temporary, ignore_errors=True)
        here = temporary / place.name
        self._moves.append((here, target))
        return here

    def _make(self, folder: Path) -> None:
        """Make a folder and those above it; what nothing was put into is gone at the end."""
        missing = [each for each in (folder, *folder.parents) if not each.exists()]
        for each in reversed(missing):
            each.mkdir(exist_ok=True)
            self._made.callback(_remove_empty, each)

    def _move(self) -> None:
        for here, target in self._moves:
            if here.is_dir():
                _refuse_others(here, target)
        undo: list[Callable[[], object]] = []
        target = Path()
        try:
            for here, target in self._moves:
                _put(here, target, undo)
        except BaseException as wrong:  # Ctrl-C, too
            for back in reversed(undo):
                back()
            if isinstance(wrong, OSError):
                raise _unwritable(target, wrong) from wrong
            raise


def refuse_entangled(*outputs: Path) -> None:
    """Refuse outputs that are one another, or of which one lies in another."""
    for k, path in enumerate(outputs):
        for other in outputs[:k]:
            one, two = path.resolve(), other.resolve()
            if one == two:
                raise FileError(f"{path}: two outputs of one name", remedy="choose another name for one of them")
            inner, outer = (path, other) if one.is_relative_to(two) else (other, path)
            if inner.resolve().is_relative_to(outer.resolve()):
                raise FileError(
                    f"{inner}: lies in another output",
                    value=str(outer),
                    limit="outputs beside each other: a folder is replaced as a whole",
                    remedy="choose another folder for one of them",
                )


def refuse_current(folder: Path) -> None:
    """Refuse to make anew the folder one is in, or one above it."""
    if Path.cwd().is_relative_to(folder.resolve()):
        raise FileError(
            f"{folder}: the current folder cannot be made anew",
            limit="a new folder, or one that holds nothing but what is written",
            remedy="name a folder in it, as in --stl parts",
        )


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):  # something is in it
        folder.rmdir()


def _put(here: Path, target: Path, undo: list[Callable[[], object]]) -> None:
    """Move one output to its place; what was there waits beside it, in what is thrown away at the end."""
    target = target.resolve()
    if target.exists():
        old = here.with_name(f"{here.name}.old")
        target.replace(old)
        undo.append(lambda: old.replace(target))
    here.rename(target)
    undo.append(lambda: target.rename(here))


def _refuse_others(here: Path, target: Path) -> None:
    new = {path.name for path in here.iterdir()}
    others = sorted(path.name for path in target.iterdir() if path.name not in new) if target.exists() else []
    if others:
        raise FileError(
            f"{target}: holds files that are not written anew",
            value=others[0] + (f" and {len(others) - 1} more" if len(others) > 1 else ""),
            limit="a new folder, or one with files of the same names only",
            remedy="choose another folder, or empty this one",
        )


def _unwritable(target: Path, wrong: OSError) -> FileError:
    return FileError(
        f"{target}: cannot be written", value=wrong.strerror, remedy="check the folder and the space left"
    )
