"""The assembled structure of a cone: panels, bonds and packaging, all as solid angles seen from the apex."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ori_deploy.design.cone.cells import ConeCells, build_cells
from ori_deploy.design.cone.creases import ConeCorners, ConeCreases, corners_of, negligible, opening_creases
from ori_deploy.design.cone.embedding import ConeEmbedding
from ori_deploy.errors import CellError
from ori_deploy.layout import Layout
from ori_deploy.profiles.cone import Cone
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors, excess, polygon_excess
from ori_deploy.tolerance import TOLERANCE

AXIS = np.array([0.0, 0.0, 1.0])
"""Direction from which solid angles are swept: less than a right angle from every ray of a cone."""


def areas_of_panels(c: Vectors, m: Vectors, v: Vectors, q: Vectors, far: Vectors, swept: Reals) -> Reals:
    """Solid angles of panels, even ones counter-clockwise over these corners, odd ones clockwise.

    Parameters
    ----------
    c, m, v, q, far
        (n_panels, 3) opening crease, elbow, closing crease, closing vertex and far end of the piece of
        outline (the closing vertex again where the panel is curved).
    swept
        (n_panels,) solid angle swept from the axis along the outline from `far` to `c`.
    """
    sign = np.where(np.arange(len(q)) % 2 == 0, 1.0, -1.0)
    straight = sum(excess(AXIS, a, b) for a, b in pairwise((c, m, v, q, far)))
    return sign * (straight + swept)


@dataclass(frozen=True)
class ConeStructure:
    """A flat-foldable thick-origami structure with the cone as its outer surface.

    Make one with `build_cone`. Points are unit vectors from the apex, in the cone's frame, deployed.

    Attributes
    ----------
    embedding
        Layout on cone.
    wall_rad
        Least wall offset t_min, radians.
    corner, opening, cells
        The construction, see the modules of the same names.
    """

    embedding: ConeEmbedding
    wall_rad: float
    corner: ConeCorners
    opening: ConeCreases
    cells: ConeCells

    @property
    def layout(self) -> Layout:
        return self.embedding.layout

    @property
    def profile(self) -> Cone:
        return self.embedding.profile

    @cached_property
    def outline_pieces(self) -> Reals:
        """(n_panels, 2) start and stop parameter of each panel's piece of outline; equal where it has none."""
        corner, s = self.corner, self.opening.s
        before = np.stack([np.where(corner.curved_before, corner.s_before, np.minimum(corner.s_w, s)), s], axis=1)
        after = np.stack([s, np.where(corner.curved_after, corner.s_after, np.maximum(corner.s_w, s))], axis=1)
        return np.stack([before, after], axis=1).reshape(-1, 2)

    @cached_property
    def _panel_corners(self) -> tuple[Vectors, Vectors, Vectors]:
        """(n_panels, 3) each: closing vertex q of each panel, and the corners m, v on its inner face."""
        q = np.stack([self.corner.q_before, self.corner.q_after], axis=1).reshape(-1, 3)
        v = self.cells.crease[:, [2, 3, 3, 2]].reshape(-1, 3)
        m = self.cells.elbow[:, [0, 0, 1, 1]].reshape(-1, 3)
        return q, m, v

    @cached_property
    def panel_areas(self) -> Reals:
        """(n_panels,) exact solid angles, steradians: spherical excess, and quadrature along the outline.

        0 where there is none but rounding.
        """
        q, m, v = self._panel_corners
        is_before = np.arange(len(q)) % 2 == 0
        # The piece of outline runs between the opening crease and what is called far here.
        piece = np.where(is_before[:, None], self.outline_pieces, self.outline_pieces[:, ::-1])
        ends, swept = self.profile.point(piece), self.profile.swept(piece)
        area = areas_of_panels(ends[:, 1], m, v, q, ends[:, 0], swept[:, 1] - swept[:, 0])
        # Swept from the axis, by unit vectors: what is rounded does not shrink with the square of the cone's size.
        return np.where(np.abs(area) <= negligible(self.profile), 0.0, area)

    @cached_property
    def cell_areas(self) -> Reals:
        """(n_cells,) solid angles of the cells, steradians; they add up to the cone's."""
        return np.asarray(polygon_excess(self.cells.void, AXIS) + self.material_areas)

    @cached_property
    def material_areas(self) -> Reals:
        """(n_cells,) panel solid angles per cell, steradians."""
        return np.asarray(self.panel_areas.reshape(-1, 4).sum(axis=1))

    @property
    def eta(self) -> float:
        """Packaging ratio: the cone's solid angle over that of all panels (geometry: section 5)."""
        return float(self.profile.solid_angle / self.panel_areas.sum())

    def panel_outline(self, panel: int, sagitta_rad: float) -> Vectors:
        """A panel's corners (k, 3), joined by arcs of great circles, counter-clockwise, without repeated points.

        Parameters
        ----------
        panel
            Panel number `4 * cell + k`.
        sagitta_rad
            Largest arc between this and the true outline.
        """
        q, m, v = (x[panel : panel + 1] for x in self._panel_corners)
        start, stop = self.outline_pieces[panel]
        curve = self.profile.sample(start, stop, sagitta_rad) if stop > start else self.profile.point([start])
        loop = (q, curve, m, v) if panel % 2 == 0 else (curve, q, v, m)
        polygon = np.concatenate(loop)
        apart = np.linalg.norm(polygon - np.roll(polygon, 1, axis=0), axis=1)
        return np.asarray(polygon[apart > 1e-12 * self.profile.size])

    def panel_outlines(self, sagitta_rad: float | None = None) -> tuple[Vectors, ...]:
        """All panels' corners; `sagitta_rad` defaults to `Tolerance.sagitta` times the cone's size."""
        limit = TOLERANCE.sagitta * self.profile.size if sagitta_rad is None else sagitta_rad
        return tuple(self.panel_outline(p, limit) for p in range(self.layout.n_panels))


def build_cone(e: ConeEmbedding, wall_rad: float) -> ConeStructure:
    """Construct a structure from an embedding (geometry: section 4).

    Parameters
    ----------
    e
        Layout on cone.
    wall_rad
        Least wall offset t_min, radians seen from the apex, >= 0.

    Raises
    ------
    CellError
        A cell that cannot be built or cannot reach its flat state; names cell, constraint and number.
    """
    if not (np.isfinite(wall_rad) and wall_rad >= 0.0):
        raise CellError(
            "wall_rad: not a thickness",
            value=wall_rad,
            limit="wall_rad >= 0",
            remedy="give radians seen from the apex, 0 for none",
        )
    if wall_rad >= e.profile.size:
        raise CellError(
            "wall_rad: thicker than the whole profile",
            value=f"{wall_rad:.6g} rad",
            limit=f"{e.profile.size:.6g} rad",
            remedy="give radians seen from the apex",
        )
    corner = corners_of(e)
    opening = opening_creases(e, corner)
    cells = build_cells(e, corner, opening, wall_rad)
    thickest = float((cells.rim + cells.offset).max())
    if thickest <= TOLERANCE.thickness * e.profile.size:
        raise CellError(
            "structure: no panel has any thickness",
            value=f"{thickest:.3g} rad",
            limit=f"more than {TOLERANCE.thickness * e.profile.size:.3g} rad somewhere",
            remedy="give a wall above 0: flat skins between closing vertices need no rim",
        )
    return ConeStructure(e, wall_rad, corner, opening, cells)
