"""Writing a specification: a structure that was found, as a file that a person can read and change."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import tomli_w

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.files.spec import SPEC_SCHEMA
from ori_deploy.files.text import read_toml, write_atomically


def spec_data(structure: Structure | ConeStructure, given: dict[str, Any]) -> dict[str, Any]:
    """A specification of a structure, as plain data.

    Parameters
    ----------
    structure
        Its vertices are written out: outline ones as `arc`, inner ones as `xy_m`.
    given
        The specification it was searched for: profile, span and whatever else it says are kept; its wish is
        not, it has been fulfilled.
    """
    layout = structure.layout
    if isinstance(structure, ConeStructure):
        plane, z = structure.profile.base, structure.profile.onto_base(structure.embedding.u)
        wall = {"wall_rad": structure.wall_rad}
    else:
        plane, z = structure.profile, structure.embedding.z
        wall = {"wall_m": structure.wall_m}
    kept_of_structure = {k: v for k, v in given["structure"].items() if not k.startswith("wall_")}
    ids = [v.id for v in layout.vertices]
    vertices = []
    for i, v in enumerate(layout.vertices):
        entry: dict[str, Any] = {"id": v.id, "role": v.role}
        if v.inner:
            vertices.append({**entry, "inner": True, "xy_m": [float(z[i].real), float(z[i].imag)]})
        else:
            arc = float(plane.arc_length(structure.embedding.s[i])) / plane.perimeter
            vertices.append({**entry, "arc": arc % 1.0})
    kept = {k: v for k, v in given.items() if k not in ("vertex", "layout", "optimize", "sweep")}
    return {
        **kept,
        "schema": SPEC_SCHEMA,
        "structure": {**kept_of_structure, **wall},
        "vertex": vertices,
        "layout": {
            "cells": [[ids[i] for i in cell] for cell in layout.cells],
            "slits": [[ids[a], ids[b]] for a, b in layout.slits],
        },
    }


def save_spec(path: Path, structure: Structure | ConeStructure, given: Path, comment: str = "") -> None:
    """Write a structure that was found for the specification `given`, whole or not at all."""
    data = spec_data(structure, read_toml(given, SPEC_SCHEMA))
    data["profile"] = _looked_up_from(path.resolve().parent, given.resolve().parent, data["profile"])
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    write_atomically(path, head + tomli_w.dumps(data))


def _looked_up_from(folder: Path, given: Path, profile: dict[str, Any]) -> dict[str, Any]:
    """A profile's table with its file's name, beside the given specification, as seen from another folder."""
    seen = dict(profile)
    if "base" in seen:
        seen["base"] = _looked_up_from(folder, given, seen["base"])
    if "file" in seen and not Path(seen["file"]).is_absolute():
        seen["file"] = Path(os.path.relpath(given / seen["file"], folder)).as_posix()
    return seen
