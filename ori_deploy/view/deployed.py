"""The deployed cross-section as lines and places on paper: a cylinder's in mm, a cone's in degrees of arc."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.layout import Layout
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.view.globe import Globe, strokes

_MM = 1e3


@dataclass(frozen=True)
class Deployed:
    """What a drawing of the deployed cross-section shows; points are complex numbers on paper.

    Attributes
    ----------
    layout
        Names, bonds and slits.
    unit
        Of the points: mm or deg.
    panels
        Panel polygons.
    target
        The profile's polygon.
    vertices
        (n_vertices,) places of the layout's vertices.
    edge
        The line from one vertex to another, by their indices.
    crease
        (n_cells, 4) places of the creases.
    void
        (n_cells, 4) corners of the voids.
    outwards
        (n_vertices,) unit normals of the outline at its vertices; 0 at inner ones.
    """

    layout: Layout
    unit: str
    panels: tuple[Points, ...]
    target: Points
    vertices: Points
    edge: Callable[[int, int], Points]
    crease: Points
    void: Points
    outwards: Points

    @property
    def extent(self) -> tuple[Reals, Reals]:
        """(2,) lower left and upper right corner of the outline's box."""
        x, y = self.target.real, self.target.imag
        return np.array([x.min(), y.min()]), np.array([x.max(), y.max()])


def deployed(structure: Structure | ConeStructure) -> Deployed:
    """The deployed cross-section of any structure."""
    return _on_sphere(structure) if isinstance(structure, ConeStructure) else _in_plane(structure)


def _in_plane(structure: Structure) -> Deployed:
    profile, e = structure.profile, structure.embedding
    vertices = _MM * e.z
    return Deployed(
        layout=structure.layout,
        unit="mm",
        panels=tuple(_MM * outline for outline in structure.panel_outlines()),
        target=_MM * profile.sample(0.0, profile.period, 1e-5 * profile.size),
        vertices=vertices,
        edge=lambda a, b: vertices[[a, b]],
        crease=_MM * structure.cells.crease,
        void=_MM * structure.cells.void,
        outwards=_normals(e.s, profile.tangents),
    )


def _on_sphere(structure: ConeStructure) -> Deployed:
    cone, e = structure.profile, structure.embedding
    globe = Globe.looking_along(cone.axis, np.array([1.0, 0.0, 0.0]))
    # So near that the curve is straight on either side; a corner stays one.
    step = 1e-7 * cone.period

    def tangents(s: Reals) -> tuple[Points, Points]:
        behind, here, ahead = (globe.flat(cone.point(s + k * step)) for k in (-1.0, 0.0, 1.0))
        before, after = here - behind, ahead - here
        return before / np.abs(before), after / np.abs(after)

    return Deployed(
        layout=structure.layout,
        unit="deg",
        panels=tuple(globe.flat(strokes(outline, closed=True)) for outline in structure.panel_outlines()),
        target=globe.flat(cone.sample(0.0, cone.period, 1e-5 * cone.size)),
        vertices=globe.flat(e.u),
        edge=lambda a, b: globe.flat(strokes(e.u[[a, b]], closed=False)),
        crease=globe.flat(structure.cells.crease),
        void=globe.flat(structure.cells.void),
        outwards=_normals(e.s, tangents),
    )


def _normals(s: Reals, tangents: Callable[[Reals], tuple[Points, Points]]) -> Points:
    """Outward normals at outline parameters, 0 at inner vertices; straight ahead at a cusp: a trailing edge."""
    outer = np.flatnonzero(np.isfinite(s))
    before, after = tangents(s[outer])
    mean = before + after
    cusp = np.abs(mean) <= 1e-9
    normals = np.zeros(len(s), dtype=np.complex128)
    normals[outer] = np.where(cusp, before, -1j * mean / np.where(cusp, 1.0, np.abs(mean)))
    return normals
