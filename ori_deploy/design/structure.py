"""The assembled structure: panels, bonds and packaging."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ori_deploy.design.cells import Cells, build_cells
from ori_deploy.design.creases import Corners, OpeningCreases, corners_of, opening_creases
from ori_deploy.design.embedding import Embedding
from ori_deploy.errors import CellError
from ori_deploy.layout import Layout
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.tolerance import TOLERANCE


def areas_of_panels(c: Points, m: Points, v: Points, q: Points, far: Points, swept: Reals) -> Reals:
    """Areas of panels, even ones counter-clockwise over these corners, odd ones clockwise.

    Parameters
    ----------
    c, m, v, q, far
        (n_panels,) opening crease, elbow, closing crease, closing vertex and far end of the piece of
        outline (the closing vertex again where the panel is curved).
    swept
        (n_panels,) area swept along the outline from `far` to `c`.
    """
    sign = np.where(np.arange(len(q)) % 2 == 0, 1.0, -1.0)
    corners = (c, m, v, q, far)
    straight = sum((np.conj(a) * b).imag for a, b in pairwise(corners))
    return sign * (0.5 * straight + swept)


@dataclass(frozen=True)
class Structure:
    """A flat-foldable thick-origami structure with the profile as its outer surface.

    Make one with `build`. Points are complex numbers in the deployed cross-section, metres.

    Attributes
    ----------
    embedding
        Layout on profile.
    wall_m
        Least wall offset t_min.
    corner, opening, cells
        The construction, see the modules of the same names.
    """

    embedding: Embedding
    wall_m: float
    corner: Corners
    opening: OpeningCreases
    cells: Cells

    @property
    def layout(self) -> Layout:
        return self.embedding.layout

    @property
    def profile(self) -> Profile:
        return self.embedding.profile

    @cached_property
    def outline_pieces(self) -> Reals:
        """(n_panels, 2) start and stop parameter of each panel's piece of outline; equal where it has none."""
        corner, s = self.corner, self.opening.s
        before = np.stack([np.where(corner.curved_before, corner.s_before, np.minimum(corner.s_w, s)), s], axis=1)
        after = np.stack([s, np.where(corner.curved_after, corner.s_after, np.maximum(corner.s_w, s))], axis=1)
        return np.stack([before, after], axis=1).reshape(-1, 2)

    @cached_property
    def _panel_corners(self) -> tuple[Points, Points]:
        """Closing vertex q of each panel, and the corners (m, v) on its inner face; (n_panels,), (n_panels, 2)."""
        q = np.stack([self.corner.q_before, self.corner.q_after], axis=1).ravel()
        v = self.cells.crease[:, [2, 3, 3, 2]].ravel()
        m = self.cells.elbow[:, [0, 0, 1, 1]].ravel()
        return q, np.stack([m, v], axis=1)

    @cached_property
    def panel_areas(self) -> Reals:
        """(n_panels,) exact areas, square metres: straight sides by corners, outline pieces by quadrature.

        0 where there is none but rounding.
        """
        q, inner = self._panel_corners
        m, v = inner.T
        is_before = np.arange(len(q)) % 2 == 0
        # The piece of outline runs between the opening crease and what is called far here.
        piece = np.where(is_before[:, None], self.outline_pieces, self.outline_pieces[:, ::-1])
        far, c = self.profile.point(piece).T
        swept_far, swept_c = self.profile.swept_area(piece).T
        area = areas_of_panels(c, m, v, q, far, swept_c - swept_far)
        # Swept from the origin: what is rounded grows with the distance from there.
        rounding = TOLERANCE.root * self.profile.size * float(np.abs(self.profile.table_f).max())
        return np.where(np.abs(area) <= rounding, 0.0, area)

    @cached_property
    def cell_areas(self) -> Reals:
        """(n_cells,) areas of the cells on the cross-section, square metres; they add up to the profile's."""
        void = self.cells.void
        hollow = 0.5 * (np.conj(void) * np.roll(void, -1, axis=1)).imag.sum(axis=1)
        return np.asarray(hollow + self.material_areas)

    @cached_property
    def material_areas(self) -> Reals:
        """(n_cells,) panel areas per cell, square metres."""
        return np.asarray(self.panel_areas.reshape(-1, 4).sum(axis=1))

    @property
    def eta(self) -> float:
        """Packaging ratio: the cross-section's area over the area of all panels (geometry: section 5)."""
        return float(self.profile.area / self.panel_areas.sum())

    def panel_outline(self, panel: int, sagitta: float) -> Points:
        """A panel's polygon, counter-clockwise, without repeated points.

        Parameters
        ----------
        panel
            Panel number `4 * cell + k`.
        sagitta
            Largest distance of the polygon from the true outline, metres.
        """
        q, inner = self._panel_corners
        start, stop = self.outline_pieces[panel]
        curve = self.profile.sample(start, stop, sagitta) if stop > start else self.profile.point([start])
        end, face = q[panel : panel + 1], inner[panel]
        loop = (end, curve, face) if panel % 2 == 0 else (curve, end, face[::-1])
        polygon = np.concatenate(loop)
        repeated = np.abs(polygon - np.roll(polygon, 1)) <= 1e-12 * self.profile.size
        return np.asarray(polygon[~repeated])

    def panel_outlines(self, sagitta: float | None = None) -> tuple[Points, ...]:
        """All panels' polygons; `sagitta` defaults to `Tolerance.sagitta` times the profile's size."""
        limit = TOLERANCE.sagitta * self.profile.size if sagitta is None else sagitta
        return tuple(self.panel_outline(p, limit) for p in range(self.layout.n_panels))


def build(e: Embedding, wall_m: float) -> Structure:
    """Construct a structure from an embedding (geometry: section 3).

    Parameters
    ----------
    e
        Layout on profile.
    wall_m
        Least wall offset t_min, metres, >= 0.

    Raises
    ------
    CellError
        A cell that cannot be built or cannot reach its flat state; names cell, constraint and number.
    """
    if not (np.isfinite(wall_m) and wall_m >= 0.0):
        raise CellError(
            "wall_m: not a thickness", value=wall_m, limit="wall_m >= 0", remedy="give metres, 0 for none"
        )
    if wall_m >= e.profile.size:
        raise CellError(
            "wall_m: thicker than the whole profile",
            value=f"{wall_m:.6g} m",
            limit=f"{e.profile.size:.6g} m",
            remedy="give metres",
        )
    corner = corners_of(e)
    opening = opening_creases(e, corner)
    cells = build_cells(e, corner, opening, wall_m)
    thickest = float((cells.rim + cells.offset).max())
    if thickest <= TOLERANCE.thickness * e.profile.size:
        raise CellError(
            "structure: no panel has any thickness",
            value=f"{thickest:.3g} m",
            limit=f"more than {TOLERANCE.thickness * e.profile.size:.3g} m somewhere",
            remedy="give wall_m > 0: flat skins between closing vertices need no rim",
        )
    return Structure(e, wall_m, corner, opening, cells)
