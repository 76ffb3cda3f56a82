"""The jobs of a grid: every combination a specification of its own, judged before the first one runs."""

from __future__ import annotations

import copy
import hashlib
import json
import textwrap
from collections.abc import Iterator
from itertools import chain, islice, product
from pathlib import Path
from typing import Any

import ori_deploy
from ori_deploy.errors import FileError, InputError
from ori_deploy.files import Spec
from ori_deploy.files.text import read_text, validated
from ori_deploy.sweep.grid import GIVEN, OWN, Grid, Job, set_key
from ori_deploy.sweep.optimise import refuse_unsweepable

_TRIED = 500
"""Combinations in which a value is tried before it is called one that none can have, beyond those that differ from
the first in one axis more."""


def files_of(document: dict[str, Any], folder: Path) -> dict[str, str]:
    """Texts of the files that a specification's profile refers to, by the names it gives them."""
    found: dict[str, str] = {}
    queue: list[Any] = [document.get("profile")]
    while queue:
        table = queue.pop()
        if isinstance(table, dict):
            name = table.get("file")
            if isinstance(name, str):
                found[name] = read_text(folder / name)
            queue += table.values()
    return found


def jobs_of(document: dict[str, Any], grid: Grid, folder: Path) -> Iterator[Job]:
    """All jobs of a grid; combinations that come to the same job are made once.

    Parameters
    ----------
    document
        The specification, as its file holds it; its `sweep` table does not count.
    folder
        Where its files are looked up.

    Raises
    ------
    InputError
        When called: a key that the specification cannot have, or a value that no combination can have.
    """
    base = {key: value for key, value in document.items() if key != "sweep"}
    for axis, values in grid.axes:
        for value in values:
            _refuse_value(base, grid, folder, axis, value)
    return _jobs(base, grid, folder)


def _refuse_value(base: dict[str, Any], grid: Grid, folder: Path, axis: str, value: Any) -> None:
    """Refuse a value that is wrong whatever the other axes have, before a thousand jobs fail on it one by one."""
    first: InputError | None = None
    for chosen in _neighbours(grid, axis, value):
        wrong = _wrong(base, chosen, folder)
        if wrong is None:
            return
        first = first or wrong
    if first is not None:
        raise first


def _neighbours(grid: Grid, axis: str, value: Any) -> Iterator[dict[str, Any]]:
    """Combinations with one value given: first those that are near the grid's first one, then others."""
    first = {name: values[0] for name, values in grid.axes} | {axis: value}
    others = [(name, values) for name, values in grid.axes if name != axis]
    one_changed = ({**first, name: other} for name, values in others for other in values[1:])
    several = (
        first | dict(zip((name for name, _ in others), chosen, strict=True))
        for chosen in product(*(values for _, values in others))
    )
    return chain([first], one_changed, islice(several, _TRIED))


def _wrong(base: dict[str, Any], values: dict[str, Any], folder: Path) -> InputError | None:
    """Why a combination is no job at all; whether its design can be built is another matter."""
    try:
        document = _document(base, values)
    except InputError as wrong:
        return wrong
    try:
        spec = validated(Spec, document, "")
    except FileError as wrong:
        return _named(wrong, values)
    try:
        job = _job(base, values, 0, folder)
        if job.optimize:
            refuse_unsweepable(job, spec)
    except InputError as wrong:
        return wrong
    return None


def _named(wrong: InputError, values: dict[str, Any]) -> InputError:
    """An error at a specification's key as one at the grid's, or at the combination that led to it."""
    key = wrong.thing.removeprefix("key ").partition(" ")[0].replace("[", ".").replace("]", "")
    if key in values:
        wrong.thing = f"sweep.grid.{key}: not a value"
        wrong.value = repr(values[key])
    else:
        where = ", ".join(f"{name} = {textwrap.shorten(repr(value), 60)}" for name, value in values.items())
        wrong.thing = f"sweep.grid, with {where}: {wrong.thing}"
    return wrong


def _jobs(base: dict[str, Any], grid: Grid, folder: Path) -> Iterator[Job]:
    seen: set[str] = set()
    for chosen in product(*(values for _, values in grid.axes)):
        job = _job(base, dict(zip(grid.names, chosen, strict=True)), grid.seed, folder)
        if job.digest not in seen:
            seen.add(job.digest)
            yield job


def _document(base: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    document = copy.deepcopy(base)
    for name, value in values.items():
        if name not in OWN:
            set_key(document, name, value)
    return document


def _job(base: dict[str, Any], values: dict[str, Any], seed: int, folder: Path) -> Job:
    document = _document(base, values)
    optimize = bool(values.get("optimize", False))
    what: dict[str, Any] = {
        "document": document,
        "files": files_of(document, folder),
        "layout": values.get("layouts") if optimize else None,
        "start": values.get("start", GIVEN if "layouts" not in values else 0) if optimize else GIVEN,
        "optimize": optimize,
        "seed": seed if optimize else 0,
    }
    written = json.dumps({"version": ori_deploy.__version__, **what}, sort_keys=True)
    return Job(hashlib.sha256(written.encode()).hexdigest(), values, **what)
