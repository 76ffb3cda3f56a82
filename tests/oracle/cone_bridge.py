"""A cone's structure for the oracle: only the curve, the vertices and the wall are handed over."""

from __future__ import annotations

import numpy as np

from ori_deploy.design import ConeStructure

from .cone import ConeCell, Ray, build
from .curves import Array


def cone_retold(built: ConeStructure, cells: list[int] | None = None) -> list[ConeCell]:
    """Construct some cells (all, unless said which) of the same embedding with the oracle."""
    e, layout = built.embedding, built.layout
    base, apex = e.profile.base, e.profile.apex
    height = abs(e.profile.plane_z_m - apex[2])

    def curve(s: Array) -> Array:
        f = base.point(np.asarray(s) * base.period)
        rays = np.stack([f.real - apex[0], f.imag - apex[1], np.full(np.shape(f), height)], axis=-1)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    rays = [Ray(e.u[i], None if v.inner else float(e.s[i] / base.period)) for i, v in enumerate(layout.vertices)]
    told = []
    for i in range(layout.n_cells) if cells is None else cells:
        a, c, b, d = (rays[v] for v in layout.cells[i])
        arcs = tuple(bool(layout.neighbour[4 * i + k] < 0) for k in range(4))
        told.append(build(curve, (a, c, b, d), arcs, built.wall_rad))  # type: ignore[arg-type]
    return told
