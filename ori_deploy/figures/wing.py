"""The wing of the paper's Fig. 5: two vertical spars, folded flat and then across the span."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ori_deploy.design import Structure
from ori_deploy.errors import MotionError
from ori_deploy.figures.prototypes import Prototype, prototype
from ori_deploy.figures.table import Table, Value
from ori_deploy.files.shipped import shipped
from ori_deploy.motion import Mechanism, SpanFolding
from ori_deploy.search.spars import chains_of

SEGMENTS = 3
"""Pieces of the paper's wing: two spanwise foldings."""
SPARRED = "wing_two_spars.toml"
"""The example with the spars."""
PLAIN = "wing_naca2412.toml"
"""The example without: it stands in for what the one with them cannot show."""

_UPRIGHT = 1e-6
"""Sideways run of a spar, over the profile's size, at which it no longer counts as vertical."""


@dataclass(frozen=True)
class Wing:
    """A wing, its spars and how its span folds.

    Attributes
    ----------
    built
        The structure and its figures.
    structure
        The structure.
    spars
        Vertices of each vertical spar, from skin to skin, front to rear.
    folding
        Its span in segments; None where its folded stack carries no piano hinges.
    refused
        Why not; empty otherwise.
    """

    built: Prototype
    structure: Structure
    spars: tuple[tuple[int, ...], ...]
    folding: SpanFolding | None
    refused: str


def vertical_spars(structure: Structure) -> tuple[tuple[int, ...], ...]:
    """Chains of inner edges, skin to skin, that stand upright: vertices of each, ordered by x."""
    z, size = structure.embedding.z, structure.profile.size
    upright = [chain for chain in chains_of(structure.layout) if np.ptp(z[list(chain)].real) <= _UPRIGHT * size]
    return tuple(sorted((tuple(c) for c in upright), key=lambda chain: float(z[chain[0]].real)))


def wing(name: str = SPARRED, segments: int = SEGMENTS) -> Wing:
    """One of the wings that are shipped.

    Raises
    ------
    InputError
        What is wrong with its specification.
    """
    return wing_of(prototype(name.removesuffix(".toml"), shipped(name)), segments)


def wing_of(built: Prototype, segments: int = SEGMENTS) -> Wing:
    """A built cylinder as a wing with its span in segments.

    Raises
    ------
    MotionError
        A cone: it has no spanwise folding.
    """
    structure = built.design.structure
    if not isinstance(structure, Structure):
        raise MotionError(
            "wing: a cone has no spanwise folding", limit="a cylinder", remedy="give a wing without taper"
        )
    folding = SpanFolding(Mechanism(structure), built.design.span_m, segments)
    refused = _refused(folding)
    return Wing(built, structure, vertical_spars(structure), None if refused else folding, refused)


def _refused(folding: SpanFolding) -> str:
    """Why the folded stack carries no hinges; empty where it does."""
    try:
        placed = len(folding.hinges)
    except MotionError as wrong:
        return str(wrong)
    assert placed == folding.segments - 1
    return ""


def wing_vertex_table(wing: Wing) -> Table:
    """One row per vertex; `spar` counts spars from the front and is 0 off them."""
    layout, z = wing.structure.layout, wing.structure.embedding.z
    spar = {v: k for k, chain in enumerate(wing.spars, 1) for v in chain}
    return Table(
        ("vertex", "role", "inner", "x_m", "y_m", "spar"),
        [
            (v.id, v.role, v.inner, float(z[i].real), float(z[i].imag), spar.get(i, 0))
            for i, v in enumerate(layout.vertices)
        ],
    )


def wing_summary_table(wing: Wing, span: Wing) -> Table:
    """Name and value of what is told about the wing; `span` is the one whose spanwise folding is shown."""
    built, z = wing.built, wing.structure.embedding.z
    rows: list[tuple[Value, ...]] = [
        ("specification", f"{built.design.name}.toml"),
        ("cells", wing.structure.layout.n_cells),
        ("wall_m", built.wall_m),
        ("eta", built.eta),
        ("volume_reduction", 1.0 - 1.0 / built.eta),
        ("box_ratio", built.box_ratio),
        ("smallest_margin_rad", built.margin_rad),
        ("spars", len(wing.spars)),
        *((f"spar_{k}_x_m", float(z[chain[0]].real)) for k, chain in enumerate(wing.spars, 1)),
        ("span_m", built.design.span_m),
        ("spanwise_refused", wing.refused),
    ]
    if span.folding is not None:
        across, thick, along = span.folding.stowed_box_m
        rows += [
            ("spanwise_specification", f"{span.built.design.name}.toml"),
            ("span_segments", span.folding.segments),
            ("segment_length_m", span.folding.length_m),
            ("stowed_width_m", across),
            ("stowed_thickness_m", thick),
            ("stowed_length_m", along),
            ("stowed_box_ratio", span.folding.stowed_box_ratio),
        ]
    return Table(("quantity", "value"), rows)
