"""Design files (JSON, schema ori-deploy/design/1): a built structure, lengths in metres, angles in radians."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from ori_deploy.design import Structure
from ori_deploy.errors import FileError, InputError
from ori_deploy.files.design_schema import DesignFile, first_fault
from ori_deploy.files.shape_entries import (
    AnyStructure,
    ConeEntries,
    CylinderEntries,
    ShapeEntries,
    entries_of,
    rebuilt,
)
from ori_deploy.files.span_entry import read_span, span_data
from ori_deploy.files.strip_entry import HelixSpec, SpiralSpec, read_strip, strip_data
from ori_deploy.files.text import digest, read_json, write_atomically
from ori_deploy.layout import Vertex, make_layout
from ori_deploy.motion import CREASES
from ori_deploy.profiles.profile import Reals
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
        Length along the generalized cylinder's axis; of a cone along its rays.
    structure
        The structure.
    sha256
        Digest of the file; empty before it is written.
    span_segments
        How many segments the span is cut into; 1 for a span in one piece.
    r_min_m
        Radius from the apex at which a cone is cut off inside; 0 for a cylinder.
    strip
        The antenna strip it carries, if any.
    """

    name: str
    span_m: float
    structure: AnyStructure
    sha256: str = ""
    span_segments: int = 1
    r_min_m: float = 0.0
    strip: HelixSpec | SpiralSpec | None = None

    @property
    def r_max_m(self) -> float:
        """Radius from the apex at which a cone is cut off outside."""
        return self.r_min_m + self.span_m

    @property
    def unit_m(self) -> float:
        """Metres that lengths of the structure's own stand for: 1; on a cone, whose lengths are arcs, `r_max_m`."""
        return 1.0 if isinstance(self.structure, Structure) else self.r_max_m

    @property
    def entries(self) -> ShapeEntries:
        """What its file says that depends on the kind of shape."""
        return entries_of(self.structure, self.span_m, self.r_min_m)


def design_data(design: Design) -> dict[str, Any]:
    """Everything a design file holds, as plain data."""
    s, shape = design.structure, design.entries
    layout, cells = s.layout, s.cells
    creases, vertices, outlines = shape.creases().tolist(), shape.vertices(), shape.outlines()
    ids = [v.id for v in layout.vertices]
    panel_ids = layout.panel_ids
    return {
        "schema": DESIGN_SCHEMA,
        "kind": shape.kind,
        "name": design.name,
        "profile": s.profile.describe(),
        **shape.lengths(),
        "layout": {
            "vertices": [
                {
                    "id": v.id,
                    "role": v.role,
                    "inner": v.inner,
                    shape.place: vertices[i],
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
                "creases": dict(zip(CREASES, creases[i], strict=True)),
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
                "outline": outline,
                "area": float(s.panel_areas[p]),
                "bonded_to": panel_ids[layout.bonded_to[p]] if layout.bonded_to[p] >= 0 else None,
            }
            for p, outline in enumerate(outlines)
        ],
        "packaging": shape.packaging(),
        **(span_data(s, design.span_m, design.span_segments) if isinstance(s, Structure) else {}),
        **strip_data(design.strip, s, design.r_min_m, design.r_max_m),
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
    kinds = (CylinderEntries.kind, ConeEntries.kind)
    if data.get("kind") not in kinds:
        raise FileError(
            f"{path}: kind", value=data.get("kind"), limit=" | ".join(kinds), remedy="make the file again"
        )
    try:
        told = DesignFile.model_validate(data)
        structure = _rebuild(data)
        recorded = np.array([[cell["creases"][c] for c in CREASES] for cell in data["cells"]], dtype=float)
        span, r_min = told.span_m, told.r_min_m
        segments = read_span(data, structure, span) if isinstance(structure, Structure) else 1
        strip = read_strip(data, structure, r_min, r_min + span)
    except ValidationError as wrong:
        raise FileError(
            f"{path}: not a whole design",
            value=first_fault(wrong.errors()),
            remedy="make it again with ori-deploy design",
        ) from wrong
    except InputError as wrong:
        wrong.source = wrong.source or str(path)
        raise
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as wrong:
        raise FileError(
            f"{path}: not a whole design",
            value=f"{type(wrong).__name__}: {wrong}",
            remedy="make it again with ori-deploy design",
        ) from wrong
    ids = [[cell.id for cell in cells] for cells in (told.layout.cells, told.cells)]
    panel_ids = [panel.id for panel in told.panels]
    if ids != 2 * [list(structure.layout.cell_ids)] or panel_ids != list(structure.layout.panel_ids):
        raise FileError(f"{path}: ids of cells or panels", limit="c1, c2, … in order", remedy="make the file again")
    design = Design(told.name, span, structure, digest(path), segments, r_min, strip)
    _compare(path, design.entries, structure.profile.size, recorded, data)
    _compare_derived(path, data, design_data(design))
    return design


def _compare_derived(path: Path, data: dict[str, Any], built: dict[str, Any]) -> None:
    """Refuse a file any of whose entries is not what its own layout gives: people build from all of them."""
    where = _difference(data, built, "")
    if where is not None:
        raise FileError(
            f"{path}: {where} is not what the layout gives",
            limit="as ori-deploy design writes it",
            remedy="don't edit design files: change the specification and design again",
        )


def _difference(told: Any, built: Any, where: str) -> str | None:
    """The first entry that differs from the one built, beyond rounding; None where all agree."""
    if isinstance(built, dict):
        if not isinstance(told, dict):
            return where
        inside = ((f"{where}.{key}" if where else key, told.get(key), value) for key, value in built.items())
        return next((found for key, a, b in inside if (found := _difference(a, b, key)) is not None), None)
    if isinstance(built, list):
        if not isinstance(told, list):
            return where
        if len(told) != len(built):
            # Rounding may add a sample to a drawn outline or leave one out.
            drawn = where.endswith((".outline", ".polygon")) and abs(len(told) - len(built)) <= 2
            return None if drawn and _drawn_alike(told, built) else where
        pairs = enumerate(zip(told, built, strict=True))
        return next((found for k, (a, b) in pairs if (found := _difference(a, b, f"{where}[{k}]"))), None)
    if isinstance(built, float) or (isinstance(built, int) and not isinstance(built, bool)):
        return None if _same(told, built) else where
    return None if told == built else where


def _drawn_alike(told: list[Any], built: list[Any]) -> bool:
    """Whether two drawn outlines fill the same box."""
    try:
        a, b = np.array(told, dtype=float), np.array(built, dtype=float)
        extent = float(np.ptp(b, axis=0).max())
        ends = [np.abs(f(a, axis=0) - f(b, axis=0)).max() for f in (np.min, np.max)]
    except (TypeError, ValueError):
        return False
    return bool(max(ends) <= 1e-3 * extent)


def _compare(path: Path, shape: ShapeEntries, size: float, recorded: Reals, data: dict[str, Any]) -> None:
    """Refuse a file whose creases or figures are not those its layout gives."""
    remedy = "don't edit design files: change the specification and design again"
    creases = shape.creases()
    off = float(np.linalg.norm(recorded - creases, axis=-1).max()) if recorded.shape == creases.shape else np.inf
    if not off <= TOLERANCE.rebuild * size:
        raise FileError(
            f"{path}: recorded creases differ from those its layout gives",
            value=f"{off:.3g} {'m' if shape.place == 'xy' else 'rad'}",
            limit=f"{TOLERANCE.rebuild * size:.3g}",
            remedy=remedy,
        )
    told = {key: (data.get(key, np.nan), value) for key, value in shape.lengths().items()}
    told |= {
        f"packaging.{key}": (data["packaging"].get(key, np.nan), value) for key, value in shape.packaging().items()
    }
    for key, (recorded_figure, built) in told.items():
        if not _same(recorded_figure, built):
            raise FileError(f"{path}: {key}", value=recorded_figure, limit=str(built), remedy=remedy)


def _same(recorded: object, built: object) -> bool:
    try:
        figures, wanted = np.asarray(recorded, dtype=float), np.asarray(built, dtype=float)
        # Absolute only against rounding: solid angles and apex coordinates may be tiny, or zero.
        return figures.shape == wanted.shape and bool(np.allclose(figures, wanted, rtol=1e-6, atol=1e-12))
    except (TypeError, ValueError):
        return False  # no number, or of another length


def _rebuild(data: dict[str, Any]) -> AnyStructure:
    described = data["layout"]
    vertices = [Vertex(v["id"], v["role"], bool(v["inner"])) for v in described["vertices"]]
    cells = [(c["closing"][0], c["opening"][0], c["closing"][1], c["opening"][1]) for c in described["cells"]]
    return rebuilt(data, make_layout(vertices, cells, [tuple(s) for s in described["slits"]]))


def pose_data(structure: AnyStructure, fold: Reals) -> list[dict[str, Any]]:
    """Per panel `{id, transform, outline}` at one fold vector (n_cells,), as plain data.

    A cylinder's transforms are 3x3 and its outlines (x, y), metres. A cone's are 4x4, in the user's coordinates, and
    its outlines unit vectors from the apex.
    """
    matrices, outlines = entries_of(structure, 1.0).posed(fold)
    return [
        {"id": name, "transform": matrix.tolist(), "outline": outline}
        for name, matrix, outline in zip(structure.layout.panel_ids, matrices, outlines, strict=True)
    ]
