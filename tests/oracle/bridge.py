"""The same structure for the oracle: only vertex places, the curve and the wall are handed over."""

from __future__ import annotations

import numpy as np

from ori_deploy.design import Structure as Built
from ori_deploy.profiles import xy

from .cell import CellSpec, Vertex, build
from .curves import Array, Outline
from .structure import Side, Structure


def outline_of(built: Built) -> Outline:
    """The profile as an oracle's outline, parameter scaled to one turn."""
    profile = built.profile

    def point(s: Array) -> Array:
        return xy(profile.point(np.asarray(s) * profile.period))

    return Outline("retold", point)


def retold(built: Built) -> tuple[Structure, list[str]]:
    """Construct the same embedding with the oracle; returns it and the names of its slits."""
    e, layout = built.embedding, built.layout
    outline = outline_of(built)
    vertices = [
        Vertex(v.id, (float(e.z[i].real), float(e.z[i].imag)), None if v.inner else float(e.s[i] / e.profile.period))
        for i, v in enumerate(layout.vertices)
    ]
    cells = []
    for corners in layout.cells:
        a, c, b, d = (vertices[i] for i in corners)
        number = len(cells)
        arcs = tuple(bool(layout.neighbour[4 * number + k] < 0) for k in range(4))
        cells.append(build(outline, CellSpec((a, c, b, d), arcs), built.wall_m))  # type: ignore[arg-type]
    joints: dict[str, tuple[Side, Side]] = {}
    slits = []
    for panel, other in enumerate(layout.neighbour):
        if panel < other:
            name = f"{layout.panel_ids[panel]}/{layout.panel_ids[other]}"
            joints[name] = (divmod(panel, 4), divmod(int(other), 4))
            if layout.is_slit[panel]:
                slits.append(name)
    return Structure(outline, cells, joints), slits
