"""The grid: which designs a sweep makes, one after another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from typing import Any

from ori_deploy.errors import InputError, LayoutError
from ori_deploy.layout import PlaneTree, folds_flat_with_some_slits, layouts

Start = int | str
"""Number of a start of the optimiser, or "given": the places that the specification gives."""

GIVEN = "given"
MOST_JOBS = 1_000_000

OWN = ("start", "optimize", "layouts")
"""Axes that are no keys of a specification; a layout is named by its code."""


@dataclass(frozen=True)
class Job:
    """One design to be made. Plain data: it travels to other processes and machines.

    Attributes
    ----------
    digest
        Names the job by all that its result depends on, this program's version included.
    values
        What it has of every axis of the grid.
    document
        The specification, as its file would hold it.
    files
        Texts of the files it refers to, by name.
    layout
        Code of the layout to lay on the profile; None for the specification's own.
    start, optimize, seed
        Whether to optimise, and from where.
    """

    digest: str
    values: dict[str, Any]
    document: dict[str, Any]
    files: dict[str, str]
    layout: str | None
    start: Start
    optimize: bool
    seed: int


@dataclass(frozen=True)
class Grid:
    """Axes and what is tried along each; all combinations are made, the last axis turning fastest.

    Attributes
    ----------
    axes
        (name, values) pairs: dotted keys of a specification, and "layouts", "optimize", "start".
    seed
        Of what the optimiser draws.
    """

    axes: tuple[tuple[str, tuple[Any, ...]], ...]
    seed: int = 0

    def __len__(self) -> int:
        return prod(len(values) for _, values in self.axes)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name, _ in self.axes)


def parse_grid(table: dict[str, Any], seed: int = 0) -> Grid:
    """A grid from the `grid` table of a `[sweep]`.

    Parameters
    ----------
    table
        From dotted keys, or tables in tables, to lists of values; a value that is no list is the only one.
        `layouts = { cells = [4, 5], inner = 1 }` stands for all layouts of so many cells.
    seed
        Of what the optimiser draws.

    Raises
    ------
    InputError
        An axis that is empty or no axis, a start without the optimiser, or more combinations than anybody
        can want.
    """
    flat = dict(_flat(table))
    optimize = tuple(flat.get("optimize", (False,)))
    _refuse("optimize", optimize, lambda v: isinstance(v, bool), "true or false")
    _refuse("start", flat.get("start", ()), _is_start, f'whole numbers from 0, or "{GIVEN}"')
    if True not in optimize:
        for name in ("start", "layouts"):
            if name in flat:
                raise InputError(
                    f"sweep.grid.{name}: means nothing without the optimiser",
                    value=str(flat[name][:8]),
                    limit="goes with optimize = true",
                    remedy=f"add optimize = true, or remove {name}",
                )
    for name, values in flat.items():
        if not values:
            raise InputError(
                f"sweep.grid.{name}: no values", limit="one value or more", remedy="list values or remove the key"
            )
    if not flat:
        raise InputError("sweep.grid: empty", limit="one key or more", remedy='for example "structure.wall_m" = [0]')
    order = [name for name in flat if name not in OWN] + [
        name for name in ("layouts", "optimize", "start") if name in flat
    ]
    grid = Grid(tuple((name, tuple(flat[name])) for name in order), seed)
    if len(grid) > MOST_JOBS:
        raise InputError(
            "sweep.grid: too many combinations",
            value=len(grid),
            limit=str(MOST_JOBS),
            remedy="fewer values or several sweeps",
        )
    return grid


def _flat(table: dict[str, Any], before: str = "") -> Iterator[tuple[str, list[Any]]]:
    for key, value in table.items():
        name = f"{before}{key}"
        if name == "layouts":
            yield name, _layout_codes(value)
        elif isinstance(value, dict):
            yield from _flat(value, f"{name}.")
        else:
            yield name, value if isinstance(value, list) else [value]


def _layout_codes(wanted: Any) -> list[str]:
    """Codes of all layouts that fold flat, of the numbers of cells and of inner vertices wanted."""
    if isinstance(wanted, list) and all(isinstance(code, str) for code in wanted):
        for code in wanted:
            _refuse_code(code)
        return wanted
    if not (isinstance(wanted, dict) and set(wanted) <= {"cells", "inner"} and "cells" in wanted):
        raise InputError(
            "sweep.grid.layouts: not a choice of layouts",
            value=repr(wanted)[:80],
            limit="{ cells = [4, 5], inner = 1 }, or a list of layout codes",
            remedy="mend the key",
        )
    cells, inner = (value if isinstance(value, list) else [value] for value in (wanted["cells"], wanted.get("inner")))
    _refuse("layouts.cells", cells, lambda v: type(v) is int and 1 <= v <= 9, "1 to 9 cells")
    _refuse("layouts.inner", inner, lambda v: v is None or (type(v) is int and v >= 0), "0 or more")
    return [
        tree.code
        for count in map(int, cells)
        for inside in inner
        for tree in layouts(count, inner=inside, allowable=folds_flat_with_some_slits)
    ]


def _refuse_code(code: str) -> None:
    """Refuse what is no layout, or none that folds flat."""
    try:
        tree = PlaneTree.from_code(code)
    except LayoutError as wrong:
        wrong.thing = f"sweep.grid.layouts: {wrong.thing}"
        raise
    if folds_flat_with_some_slits(tree.vertices, tree.cells) is not None:
        raise InputError(
            "sweep.grid.layouts: cannot fold flat, whatever its slits",
            value=code,
            limit="layouts that fold flat",
            remedy="copy a code that ori-deploy layouts --foldable prints",
        )


def _is_start(value: Any) -> bool:
    return value == GIVEN or (type(value) is int and value >= 0)


def _refuse(name: str, values: Any, right: Any, limit: str) -> None:
    for value in values:
        if not right(value):
            raise InputError(f"sweep.grid.{name}: not a value", value=repr(value), limit=limit, remedy="mend it")


def set_key(document: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key; an entry of a list is named by its `id`, as in `vertex.T1.x_chord`.

    Raises
    ------
    InputError
        There is no such entry, or something in the way is no table.
    """
    here: Any = document
    *path, last = key.split(".")
    for part in path:
        if isinstance(here, list):
            entries = [entry for entry in here if isinstance(entry, dict) and entry.get("id") == part]
            here = entries[0] if entries else None
        elif isinstance(here, dict):
            here = here.get(part)
        else:
            here = None
    if not isinstance(here, dict):
        raise InputError(
            f"sweep.grid: no such key as {key}",
            limit="keys in tables that the specification has; vertices by id, as vertex.T1.x_chord",
            remedy="mend its name, or add its table",
        )
    here[last] = value
