"""Write zeros into a rig file: comments and order stay, the old file is kept, nothing is half-written."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields, replace
from itertools import count, zip_longest
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Array

from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import Actuator, Hinge, parse_rig
from ori_deploy.bench.calibration import NotCalibrated
from ori_deploy.errors import FileError, RigError
from ori_deploy.files import digest, write_atomically
from ori_deploy.motion import Plan

DECIMALS = 6
"""Of a zero in the file: a thousandth of what a servo resolves."""


_HEADER = re.compile(r"\s*\[\[?[^\[\]]+\]\]?\s*(#.*)?$")
"""A line that begins a table; one inside a longer value may look so, which costs nothing."""

_TAIL = re.compile(r"(?:^[ \t]*(?:#[^\n]*)?\r?\n)+\Z", re.MULTILINE)


def from_template(text: str, rig: ResolvedRig) -> tuple[str, ...]:
    """Cells whose hinge is made from the template `[each_cell]`, and has no entry of its own."""
    own = {hinge.get("cell") for hinge in tomllib.loads(text).get("hinge", [])}
    return tuple(cell for cell in rig.cell_ids if cell not in own)


def with_zeros(text: str, rig: ResolvedRig, zeros: Mapping[str, float]) -> str:
    """The text of a rig file with new zeros; cells from the template get entries of their own.

    Each table is edited for itself: as one document, entries of different arrays that take turns in the file
    would be sorted apart.

    Parameters
    ----------
    text
        Of the file.
    rig
        What it says, fitted to the plan.
    zeros
        `zero_rad` by cell.
    """
    wanted = {cell: round(zero, DECIMALS) for cell, zero in zeros.items()}
    missing = [cell for cell in from_template(text, rig) if cell in zeros]
    new: dict[str, list[dict[str, Any]]] = {"actuator": [], "hinge": []}
    for hinge, actuator in zip(rig.hinges, rig.actuators, strict=True):
        if hinge.cell in missing:
            new["actuator"].append(_keys(actuator))
            new["hinge"].append(_keys(replace(hinge, zero_rad=wanted[hinge.cell])))
    return "".join([*(_edited(block, wanted, new) for block in _blocks(text)), *_tables(new)])


def _blocks(text: str) -> list[str]:
    """The text cut before every line that begins a table."""
    blocks = [""]
    for line in text.splitlines(keepends=True):
        if _HEADER.match(line):
            blocks.append("")
        blocks[-1] += line
    return blocks


def _edited(block: str, wanted: Mapping[str, float], new: dict[str, list[dict[str, Any]]]) -> str:
    """One table with its zeros; where arrays are written inline, with the entries that are missing, too."""
    body = _TAIL.sub("", block)  # what follows the last key belongs to the next table
    try:
        document = tomlkit.parse(body)
    except TOMLKitError:
        return block  # not a table by itself, so none of ours; that nothing is lost is checked afterwards
    changed = False
    for name in ("actuator", "hinge"):
        entries = document.get(name)
        if not isinstance(entries, (AoT, Array)):
            continue
        for entry in entries if name == "hinge" else ():
            if str(entry.get("cell")) in wanted:
                entry["zero_rad"] = wanted[str(entry["cell"])]
                changed = True
        if isinstance(entries, Array):
            for keys in new[name]:
                inline = tomlkit.inline_table()
                inline.update(keys)
                entries.append(inline)
                changed = True
            new[name] = []
    return tomlkit.dumps(document) + block[len(body) :] if changed else block


def _tables(new: Mapping[str, list[dict[str, Any]]]) -> list[str]:
    """Entries as tables for the end of the file, each actuator before its hinge."""
    tables = [
        (name, keys) for pair in zip_longest(*new.values()) for name, keys in zip(new, pair, strict=True) if keys
    ]
    return [f"\n[[{name}]]\n{tomlkit.dumps(keys)}" for name, keys in tables]


def _keys(entry: Actuator | Hinge) -> dict[str, Any]:
    """What a file would say of it: names first, defaults that are None left out."""
    values = {field.name: getattr(entry, field.name) for field in fields(entry)}
    first = [name for name in ("id", "actuator", "cell", "crease") if name in values]
    order = [*first, *(name for name in values if name not in first)]
    return {name: values[name] for name in order if values[name] is not None}


def check_new(text: str, old: ResolvedRig, plan: Plan, zeros: Mapping[str, float]) -> ResolvedRig:
    """Make sure that the new text is a rig that differs in these zeros only, and can carry the plan out.

    Raises
    ------
    NotCalibrated
        It is not.
    """
    try:
        new = resolve_rig(parse_rig(tomllib.loads(text), old.source), plan.cell_ids, plan.latch_points)
        new.check_range(plan.crease_angles_rad)
    except RigError as wrong:
        raise NotCalibrated(f"the zeros that were found do not fit, and nothing was written: {wrong}") from wrong
    wanted = tuple(
        replace(hinge, zero_rad=round(zeros[hinge.cell], DECIMALS)) if hinge.cell in zeros else hinge
        for hinge in old.hinges
    )
    if (new.hinges, new.actuators, new.wiring) != (wanted, old.actuators, old.wiring):
        raise NotCalibrated(
            f"{old.source}: the zeros cannot be put in without changing something else, and nothing was written; "
            "remedy: give every hinge a [[hinge]] table of its own, then calibrate again"
        )
    return new


def save_rig(path: Path, text: str, sha256: str) -> Path:
    """Write a rig file, and keep the old one beside it.

    Parameters
    ----------
    sha256
        Of the file that the text was made from.

    Returns
    -------
    Where the old one is.

    Raises
    ------
    FileError
        The file changed in the meantime, or cannot be written. Nothing was.
    """
    if digest(path) != sha256:
        raise FileError(
            f"{path}: changed while the hinges were calibrated", limit="the file that was read",
            remedy="calibrate again",
        )  # fmt: skip
    backup = _keep(path)
    try:
        write_atomically(path, text)
    except BaseException:
        backup.unlink()
        raise
    return backup


def _keep(path: Path) -> Path:
    """A copy under a name that nothing has yet."""
    data = path.read_bytes()
    for number in count():
        backup = path.with_name(f"{path.name}.bak" + (f".{number}" if number else ""))
        try:
            out = backup.open("xb")
        except FileExistsError:
            continue
        except OSError as wrong:
            raise _not_kept(backup, wrong) from wrong
        try:
            with out:
                out.write(data)
        except BaseException as wrong:
            backup.unlink(missing_ok=True)  # half a rig is nothing to go back to
            if isinstance(wrong, OSError):
                raise _not_kept(backup, wrong) from wrong
            raise
        return backup
    raise AssertionError("there is always another number")


def _not_kept(backup: Path, wrong: OSError) -> FileError:
    return FileError(f"{backup}: the old rig cannot be kept", value=wrong.strerror, remedy="check the folder")
