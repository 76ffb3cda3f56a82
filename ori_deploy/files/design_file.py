"""Design files (JSON, schema ori-deploy/design/1): a built structure, lengths in metres, angles in radians."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ori_deploy.design import Structure, build, embed
from ori_deploy.errors import FileError, InputError
from ori_deploy.files.text import digest, read_json, write_atomically
from ori_deploy.layout import Vertex, make_layout
from ori_deploy.motion import CREASES, Mechanism
from ori_deploy.profiles import from_description, xy
from ori_deploy.profiles.profile import Points
from ori_deploy.tolerance import TOLERANCE

DESIGN_SCHEMA = "ori-deploy/design/1"


@dataclass(frozen=True)
class Design:
    """A design file in memory.

    Attributes
    ----------
    name
        Taken from the file's name.
    span_m
        Length along the generalized cylinder's axis.
    structure
        The structure.
    sha256
        Digest of the file; empty before it is written.
    """

    name: str
    span_m: float
    structure: Structure
    sha256: str = ""


def _pairs(points: Points) -> list[list[float]]:
    return [[float(z.real), float(z.imag)] for z in np.atleast_1d(points)]


def packaging(structure: Structure) -> dict[str, Any]:
    """Areas in m2, eta, and the folded stack's smallest box in m."""
    box = Mechanism(structure).stack_box_m
    area = structure.profile.area
    return {
        "area": area,
        "material_area": float(structure.panel_areas.sum()),
        "eta": structure.eta,
        "stack_box_m": list(box),
        "box_ratio": area / (box[0] * box[1]),
    }


def design_data(design: Design) -> dict[str, Any]:
    """Everything a design file holds, as plain data."""
    s = design.structure
    layout, cells = s.layout, s.cells
    ids = [v.id for v in layout.vertices]
    panel_ids = layout.panel_ids
    return {
        "schema": DESIGN_SCHEMA,
        "kind": "cylinder",
        "name": design.name,
        "profile": s.profile.describe(),
        "span_m": design.span_m,
        "wall_m": s.wall_m,
        "layout": {
            "vertices": [
                {
                    "id": v.id,
                    "role": v.role,
                    "inner": v.inner,
                    "xy": _pairs(s.embedding.z[i])[0],
                    **({} if v.inner else {"s": float(s.embedding.s[i])}),
                }
                for i, v in enumerate(layout.vertices)
            ],
            "cells": [
                {"id": layout.cell_ids[i], "closing": [ids[a], ids[b]], "opening": [ids[c], ids[d]]}
                for i, (a, c, b, d) in enumerate(layout.cells)
            ],
            "slits": [[ids[a], ids[b]] for a, b in layout.slits],
        },
        "cells": [
            {
                "id": name,
                "creases": dict(zip(CREASES, _pairs(cells.crease[i]), strict=True)),
                "rim_thickness": cells.rim[i].tolist(),
                "inner_offset": cells.offset[i].tolist(),
                "deployed_angles_rad": dict(zip(CREASES, cells.angle[i].tolist(), strict=True)),
                "dead_centre_margin_rad": cells.dead_centre_margin[i].tolist(),
                "area": float(s.cell_areas[i]),
                "material_area": float(s.material_areas[i]),
            }
            for i, name in enumerate(layout.cell_ids)
        ],
        "panels": [
            {
                "id": panel_ids[p],
                "cell": layout.cell_ids[p // 4],
                "outline": _pairs(outline),
                "area": float(s.panel_areas[p]),
                "bonded_to": panel_ids[layout.bonded_to[p]] if layout.bonded_to[p] >= 0 else None,
            }
            for p, outline in enumerate(s.panel_outlines())
        ],
        "packaging": packaging(s),
    }


def save_design(design: Design, path: Path) -> dict[str, Any]:
    """Write a design file (whole or not at all) and return what it holds."""
    data = design_data(design)
    write_atomically(path, json.dumps(data, indent=1, allow_nan=False) + "\n")
    return data


def load_design(path: Path) -> Design:
    """Read a design file: its structure is built again and compared with what the file records.

    Raises
    ------
    FileError
        Unreadable, entries missing, or creases that differ from the construction by more than
        `Tolerance.rebuild`: the file was edited, or made by another version.
    """
    data = read_json(path, DESIGN_SCHEMA)
    try:
        structure = _rebuild(data)
        recorded = np.array([[complex(*cell["creases"][c]) for c in CREASES] for cell in data["cells"]])
        span = float(data["span_m"])
        name = str(data["name"])
    except InputError as wrong:
        wrong.source = wrong.source or str(path)
        raise
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as wrong:
        raise FileError(
            f"{path}: not a whole design",
            value=f"{type(wrong).__name__}: {wrong}",
            remedy="make it again with ori-deploy design",
        ) from wrong
    if data.get("kind") != "cylinder":
        raise FileError(
            f"{path}: kind", value=repr(data.get("kind")), limit="'cylinder'", remedy="make the file again"
        )
    ids = [[cell.get("id") for cell in cells] for cells in (data["layout"]["cells"], data["cells"])]
    panel_ids = [panel.get("id") for panel in data.get("panels", [])]
    if ids != 2 * [list(structure.layout.cell_ids)] or panel_ids != list(structure.layout.panel_ids):
        raise FileError(f"{path}: ids of cells or panels", limit="c1, c2, … in order", remedy="make the file again")
    if not 0.0 < span <= 1e4:
        raise FileError(f"{path}: span_m", value=span, limit="> 0", remedy="make it again with ori-deploy design")
    _compare(path, structure, recorded, data)
    return Design(name, span, structure, digest(path))


def _compare(path: Path, structure: Structure, recorded: Points, data: dict[str, Any]) -> None:
    """Refuse a file whose creases or figures are not those its layout gives."""
    remedy = "don't edit design files: change the specification and design again"
    size = structure.profile.size
    same_shape = recorded.shape == structure.cells.crease.shape
    off = float(np.abs(recorded - structure.cells.crease).max()) if same_shape else np.inf
    if not off <= TOLERANCE.rebuild * size:
        raise FileError(
            f"{path}: recorded creases differ from those its layout gives",
            value=f"{off:.3g} m",
            limit=f"{TOLERANCE.rebuild * size:.3g} m",
            remedy=remedy,
        )
    for key, built in packaging(structure).items():
        if not np.allclose(data["packaging"].get(key, np.nan), built, rtol=1e-6):
            raise FileError(f"{path}: packaging.{key}", value=data["packaging"].get(key), limit=built, remedy=remedy)


def _rebuild(data: dict[str, Any]) -> Structure:
    described = data["layout"]
    vertices = [Vertex(v["id"], v["role"], bool(v["inner"])) for v in described["vertices"]]
    cells = [(c["closing"][0], c["opening"][0], c["closing"][1], c["opening"][1]) for c in described["cells"]]
    layout = make_layout(vertices, cells, [tuple(s) for s in described["slits"]])
    outline = {v["id"]: float(v["s"]) for v in described["vertices"] if not v["inner"]}
    inner = {v["id"]: (float(v["xy"][0]), float(v["xy"][1])) for v in described["vertices"] if v["inner"]}
    return build(embed(from_description(data["profile"]), layout, outline, inner), float(data["wall_m"]))


def pose_data(structure: Structure, fold: np.ndarray[Any, np.dtype[np.float64]]) -> list[dict[str, Any]]:
    """Per panel `{id, transform, outline}` at one fold vector (n_cells,), as plain data."""
    poses = Mechanism(structure).poses(fold[None])
    matrices = poses.matrices()[0]
    return [
        {
            "id": structure.layout.panel_ids[p],
            "transform": matrices[p].tolist(),
            "outline": xy(poses.turn[p, 0] * outline + poses.shift[p, 0]).tolist(),
        }
        for p, outline in enumerate(structure.panel_outlines())
    ]
