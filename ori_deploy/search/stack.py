"""The folded stack of a structure on a cylinder: a chain of cells, each two slabs face to face.

Flat, every inner face lies along one direction, that of the stack. At an opening vertex at most two
bonded cells fold flat, so a cell has at most one bond on each of its two slabs: bonded cells form a
chain, and their slabs lie one on the other. The stack is as high as all slabs together. Along it, two
bonded cells share the end of their bond; where everything else ends follows cell by cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from ori_deploy.design import Cells
from ori_deploy.design.jet import Jet, stacked
from ori_deploy.errors import LayoutError
from ori_deploy.layout import Layout
from ori_deploy.profiles.profile import Reals
from ori_deploy.search.measures import Measures

_TOWARDS_B = (1.0, -1.0, -1.0, 1.0)
"""Whether a panel, seen from its closing vertex, runs from a towards b along its folded cell, or back."""

ENDS = 5
"""Lengths along a folded cell from its closing crease a: to closing crease b, and to each panel's closing vertex."""


@dataclass(frozen=True)
class Stack:
    """The chain of a layout's cells.

    Attributes
    ----------
    layout
        With slits that fold flat.
    """

    layout: Layout

    def __post_init__(self) -> None:
        if self.layout.overfull_vertices:
            vertex, cells = self.layout.overfull_vertices[0]
            raise LayoutError(
                'objective = "box_ratio": this structure does not fold flat',
                value=f"cells {', '.join(cells)} are bonded in a row at {vertex}",
                limit="at most two cells bonded in a row at an opening vertex",
                remedy='choose slits that part them, or objective = "eta"',
            )

    @cached_property
    def places(self) -> Reals:
        """(6 n_cells, 5 n_cells) where every end is along the stack: sums of lengths that `ends` gives.

        Six ends per cell: its closing crease a, then those of `ends`.
        """
        n = self.layout.n_cells
        origin, sense = np.zeros((n, ENDS * n)), np.ones(n)
        for cell, entry, bonded in self.layout.folding_order:
            if bonded >= 0:
                before, there, here = bonded // 4, bonded % 4, entry % 4
                sense[cell] = sense[before] * _TOWARDS_B[there] * _TOWARDS_B[here]
                origin[cell] = origin[before]
                origin[cell, ENDS * before + 1 + there] += sense[before]
                origin[cell, ENDS * cell + 1 + here] -= sense[cell]
        place = np.repeat(origin[:, None], ENDS + 1, axis=1)
        for k in range(ENDS):
            place[np.arange(n), k + 1, ENDS * np.arange(n) + k] += sense
        return place.reshape((ENDS + 1) * n, ENDS * n)


def ends(measures: Measures, vertices: Jet) -> Jet:
    """(n, 5) lengths along each folded cell from closing crease a: to b, and to the panels' closing vertices.

    Parameters
    ----------
    measures
        Of the cells.
    vertices
        (n, 4) places of their corners a, c, b, d.
    """
    cells = cast(Cells, measures.cells)
    direction, crease, run = (cast(Jet, x) for x in (cells.direction, cells.crease, cells.run))
    from_a, from_b = vertices[:, 0] - crease[:, 2], vertices[:, 2] - crease[:, 3]
    long = run[:, 0] + run[:, 1]

    def along(k: int, z: Jet) -> Jet:
        return cast(Jet, cast(Any, np.conj(cast(Any, direction[:, k])) * z).real)

    return stacked(
        [long, along(0, from_a), long + along(1, from_b), long - along(2, from_b), -along(3, from_a)], axis=1
    )
