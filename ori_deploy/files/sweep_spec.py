"""What to sweep over: the `[sweep]` table of a specification, or a file of its own (schema ori-deploy/sweep/1)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from ori_deploy.files.profile_spec import Strict
from ori_deploy.files.text import read_toml, validated

SWEEP_SCHEMA = "ori-deploy/sweep/1"


class SweepSpec(Strict):
    """`[sweep]`: `grid` from keys of the specification to the values to try, and the seed of the starts."""

    grid: dict[str, Any]
    seed: Annotated[int, Field(strict=True, ge=0)] = 0


class SweepFile(SweepSpec):
    """The file."""

    schema_: Annotated[Literal["ori-deploy/sweep/1"], Field(alias="schema")]


def load_sweep(path: Path) -> SweepSpec:
    """Read a grid file.

    Raises
    ------
    FileError
        Unreadable, not TOML, unknown or missing keys; names file and key.
    """
    data = read_toml(path, SWEEP_SCHEMA)
    return validated(SweepFile, data, str(path))
