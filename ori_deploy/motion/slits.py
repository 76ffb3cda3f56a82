"""Which slits let a structure deploy without touching."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice, product
from typing import Any, TypeVar

import numpy as np

from ori_deploy.errors import LayoutError
from ori_deploy.layout import make_layout
from ori_deploy.motion.interference import Interference
from ori_deploy.motion.mechanism import AnyStructure, Linkage
from ori_deploy.motion.mechanism_of import mechanism_of
from ori_deploy.profiles.profile import Reals
from ori_deploy.tolerance import TOLERANCE, Tolerance

StructureT = TypeVar("StructureT", bound=AnyStructure)

TRIED = 64
"""Choices of slits that are tried before giving up."""


def checked_folds(mechanism: Linkage[Any], tolerance: Tolerance = TOLERANCE) -> Reals:
    """Folds in step, 0 to 1, close enough that no panel moves more than `motion_step` between two of them."""
    coarse = np.linspace(0.0, 1.0, 201)
    poses = mechanism.poses(coarse)
    longest = mechanism.steps_m(poses) / (tolerance.motion_step * mechanism.size_m)
    pieces = [
        np.linspace(a, b, int(np.ceil(n)) if n > 1.0 else 1, endpoint=False)
        for a, b, n in zip(coarse, coarse[1:], longest, strict=False)
    ]
    return np.append(np.concatenate(pieces), 1.0)


def with_slits(structure: StructureT, slits: tuple[tuple[str, str], ...]) -> StructureT:
    """The same cells, bonded but for other slits: (inner vertex, opening vertex) ids, one pair per inner vertex.

    Raises
    ------
    LayoutError
        These slits leave a cell loose, or are none.
    """
    layout = structure.layout
    ids = [v.id for v in layout.vertices]
    cells = [(ids[a], ids[c], ids[b], ids[d]) for a, c, b, d in layout.cells]
    other = make_layout(layout.vertices, cells, slits)
    embedding: Any = replace(structure.embedding, layout=other)
    return replace(structure, embedding=embedding)


def deploys_free(structure: AnyStructure, tolerance: Tolerance = TOLERANCE) -> bool:
    """Whether the structure deploys with all cells in step without touching."""
    mechanism = mechanism_of(structure)
    check = Interference(mechanism, tolerance)
    return (
        not structure.layout.overfull_vertices and check.first_collision(checked_folds(mechanism, tolerance)) is None
    )


def free_slits(
    structure: AnyStructure, tolerance: Tolerance = TOLERANCE, limit: int = TRIED
) -> Iterator[tuple[tuple[str, str], ...]]:
    """Choices of slits with which the same cells deploy in step without touching; at most `limit` are tried.

    Yields
    ------
    (inner vertex, opening vertex) ids, one pair per inner vertex.
    """
    layout = structure.layout
    ids = [v.id for v in layout.vertices]
    choices = [
        sorted({int(cell[k]) for cell in layout.cells if inner in cell for k in (1, 3)}) for inner, _ in layout.slits
    ]
    for chosen in islice(product(*choices), limit):
        slits = tuple((ids[inner], ids[opening]) for (inner, _), opening in zip(layout.slits, chosen, strict=True))
        try:
            other = with_slits(structure, slits)
        except LayoutError:
            continue  # these slits leave a cell loose
        if deploys_free(other, tolerance):
            yield slits


def with_free_slits(structure: StructureT, tolerance: Tolerance = TOLERANCE) -> StructureT:
    """The structure, with other slits where it touches and another choice does not."""
    if deploys_free(structure, tolerance):
        return structure
    slits = next(free_slits(structure, tolerance), None)
    return structure if slits is None else with_slits(structure, slits)
