"""The prototypes of the paper's Fig. 3: shapes of the gallery, built."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ori_deploy.design import Structure
from ori_deploy.figures.table import Table
from ori_deploy.files import Design, build_from_file
from ori_deploy.files.shipped import shipped

PROTOTYPES: tuple[tuple[str, str], ...] = (
    ("three-leaf clover", "clover_6.toml"),
    ("heart", "heart_6.toml"),
    ("circular cone", "cone_circular_6.toml"),
    ("elliptic cone", "cone_elliptic_6.toml"),
)
"""What Fig. 3 shows, a to d, and the examples that stand for it."""


@dataclass(frozen=True)
class Prototype:
    """A built structure and its figures.

    Attributes
    ----------
    name
        For people.
    design
        What was built.
    wall_m
        Least wall offset, metres; of a cone at its outer radius.
    eta, box_ratio
        Packaging ratios: against the material, and against the smallest box round the folded stack.
    margin_rad
        Smallest dead-centre margin.
    """

    name: str
    design: Design
    wall_m: float
    eta: float
    box_ratio: float
    margin_rad: float


def prototype(name: str, spec: Path) -> Prototype:
    """Build what a specification says.

    Raises
    ------
    InputError
        What is wrong with the specification.
    """
    parsed, structure = build_from_file(spec)
    cut = parsed.structure
    design = Design(
        spec.stem, cut.span_m, structure, span_segments=cut.span_segments, r_min_m=cut.r_min_m, strip=parsed.strip
    )
    return Prototype(
        name=name,
        design=design,
        wall_m=structure.wall_m if isinstance(structure, Structure) else structure.wall_rad * design.unit_m,
        eta=float(structure.eta),
        box_ratio=float(design.entries.packaging()["box_ratio"]),
        margin_rad=float(np.min(structure.cells.dead_centre_margin)),
    )


def shipped_prototype(name: str) -> Prototype:
    """One of `PROTOTYPES`, by its name for people."""
    return prototype(name, shipped(dict(PROTOTYPES)[name]))


def prototype_table(prototypes: Sequence[Prototype]) -> Table:
    """One row per prototype."""
    columns = ("name", "specification", "kind", "cells", "wall_m", "eta", "box_ratio", "smallest_margin_rad")
    return Table(
        columns,
        [
            (
                p.name,
                f"{p.design.name}.toml",
                p.design.entries.kind,
                p.design.structure.layout.n_cells,
                p.wall_m,
                p.eta,
                p.box_ratio,
                p.margin_rad,
            )
            for p in prototypes
        ],
    )
