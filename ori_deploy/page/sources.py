"""What to show: a design, a plan with its design, or a flight log with its design, found out from a file."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ori_deploy.errors import FileError, InputError
from ori_deploy.files import Design, digest, load_design, load_plan
from ori_deploy.files.design_file import DESIGN_SCHEMA
from ori_deploy.files.plan_file import PLAN_SCHEMA
from ori_deploy.motion import Plan
from ori_deploy.telemetry.read import Run, read_run

_MCAP = b"\x89MCAP"
_FOLDERS_UP = 1
"""A log often lies in a folder beside the design's."""


@dataclass(frozen=True)
class Source:
    """What a page is made from.

    Attributes
    ----------
    design
        The structure.
    plan, run
        Its times, or those of a flight; None where there are none.
    """

    design: Design
    plan: Plan | None = None
    run: Run | None = None


def source_of(path: Path, design: Path | None = None) -> Source:
    """What a file is.

    Parameters
    ----------
    design
        Design file; looked for beside a plan or a log without it.

    Raises
    ------
    FileError
        None of the three, or its design is not found.
    InputError
        It is a design itself, and another one is given.
    """
    try:
        with path.open("rb") as file:
            head = file.read(len(_MCAP))
    except OSError as wrong:
        raise FileError(f"{path}: cannot be read", value=wrong.strerror, remedy="check the path") from wrong
    if head == _MCAP:
        run = read_run(path)
        return Source(design_with(str(run.info["design_sha256"]), path, design), run=run)
    schema = _schema(path)
    if schema == DESIGN_SCHEMA and design is not None:
        raise InputError(
            f"--design: {path} is a design itself",
            value=str(design),
            limit="names the design of a plan or of a flight log",
            remedy="leave --design out, or give the plan or the log",
        )
    if schema == DESIGN_SCHEMA:
        return Source(load_design(path))
    if schema == PLAN_SCHEMA:
        plan = load_plan(path)
        return Source(design_with(plan.design_sha256, path, design), plan=plan)
    raise FileError(
        f"{path}: nothing to show",
        value=schema or "a file of another kind",
        limit=f"{DESIGN_SCHEMA}, {PLAN_SCHEMA}, or a flight log",
        remedy="give what ori-deploy design, plan, or deploy --log has written",
    )


def design_with(sha256: str, beside: Path, given: Path | None) -> Design:
    """The design with a digest: the one that is given, or one that lies beside a file.

    Raises
    ------
    FileError
        There is none, or the one that is given is another.
    """
    if given is not None:
        design = load_design(given)
        if sha256 and design.sha256 != sha256:
            raise FileError(
                f"{given}: not the design of {beside.name}",
                value=design.sha256[:12],
                limit=sha256[:12],
                remedy="give the design file it was made from",
            )
        return design
    folder = beside.absolute().parent
    for place in (folder, *folder.parents[:_FOLDERS_UP]):
        for path in sorted(place.glob("*.json")):
            if _is(path, sha256):
                return load_design(path)
    raise FileError(
        f"{beside}: its design is not beside it",
        limit=f"a design file with digest {sha256[:12]}…",
        remedy="name it with --design",
    )


def _is(path: Path, sha256: str) -> bool:
    with suppress(OSError):
        return path.is_file() and digest(path) == sha256
    return False


def _schema(path: Path) -> str:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return ""
    return str(data.get("schema", "")) if isinstance(data, dict) else ""
