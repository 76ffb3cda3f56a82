"""The structure as a linkage in space: crease lines, where panels are, and how far creases are folded.

A cylinder's section lies in the plane of x and y and its span runs from z = 0 upwards; a cone's creases run along its
rays, between two radii from the apex, in the user's coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.design import Structure
from ori_deploy.files import Design
from ori_deploy.layout import Layout
from ori_deploy.loads import Solids, in_space
from ori_deploy.motion import BEFORE_CREASE, CREASES, NEXT_CREASE, Linkage, mechanism_of
from ori_deploy.profiles.profile import Reals


@dataclass(frozen=True)
class Skeleton:
    """A design as links between crease lines. Metres and radians; the first panel stays where it is when deployed.

    Attributes
    ----------
    design
        What it is made from.
    """

    design: Design

    @property
    def layout(self) -> Layout:
        return self.design.structure.layout

    @cached_property
    def linkage(self) -> Linkage[Any]:
        """The design as it moves."""
        return mechanism_of(self.design.structure, self.design.unit_m)

    @cached_property
    def solids(self) -> Solids:
        """Its panels' volumes, centroids and inertias, and its creases' directions."""
        return Solids.of(self.design.structure, self.design.span_m, self.design.r_min_m)

    @cached_property
    def crease_names(self) -> tuple[tuple[str, ...], ...]:
        """("c1.open_c", …) per cell."""
        return tuple(tuple(f"{cell}.{crease}" for crease in CREASES) for cell in self.layout.cell_ids)

    @cached_property
    def crease_ends(self) -> Reals:
        """(n_cells, 4, 2, 3) ends of every crease, deployed: at z = 0 and the span, or at r_min and r_max."""
        design, structure = self.design, self.design.structure
        if isinstance(structure, Structure):
            z = structure.cells.crease
            ends = np.zeros((*z.shape, 2, 3))
            ends[..., 0], ends[..., 1] = z.real[..., None], z.imag[..., None]
            ends[..., 1, 2] = design.span_m
            return ends
        rays = structure.profile.to_user(structure.cells.crease)
        radii = np.array([design.r_min_m, design.r_max_m])
        return np.asarray(structure.profile.apex + radii[:, None] * rays[:, :, None, :])

    @property
    def right_handed(self) -> bool:
        """Whether cells run counter-clockwise seen against the creases' direction, as in the plane."""
        structure = self.design.structure
        return isinstance(structure, Structure) or structure.profile.is_right_handed

    @cached_property
    def deployed_fold_rad(self) -> Reals:
        """(n_cells, 4) by how much the two links of every crease are folded when deployed: pi less their angle."""
        ends = self.crease_ends
        across = ends[:, :, 1] - ends[:, :, 0]
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        fold = np.empty(ends.shape[:2])
        for k in range(4):
            before, here, after = BEFORE_CREASE[k], NEXT_CREASE[k], NEXT_CREASE[(k + 1) % 4]
            # Both links as they leave the crease, in the plane across it; ends at the outer side: a cone's
            # inner ones may all be its apex.
            axis = across[:, here]
            first, second = (_across(ends[:, c, 1] - ends[:, here, 1], axis) for c in (before, after))
            sine = np.linalg.norm(np.cross(first, second), axis=-1)
            fold[:, here] = np.pi - np.arctan2(sine, np.einsum("ci,ci->c", first, second))
        return fold

    def fold_rad(self, fold: ArrayLike) -> Reals:
        """(n_poses, n_cells, 4) by how much the links are folded at every crease: 0 flat, up to pi face to face.

        A link leans against its panel's inner face by a constant angle, so this is the crease's inner angle with
        another sign and zero.
        """
        return self.deployed_fold_rad - (self.inner_rad(fold) - self.linkage.four_bars.deployed)

    def inner_rad(self, fold: ArrayLike) -> Reals:
        """(n_poses, n_cells, 4) inner angles of all creases, for folds as in `poses`."""
        return self.linkage.four_bars.angles(np.atleast_1d(np.asarray(fold, dtype=float)))

    def poses(self, fold: ArrayLike) -> Reals:
        """(n_poses, n_panels, 4, 4) rigid motions of the deployed panels.

        Parameters
        ----------
        fold
            (n_poses,) or a number, all cells in step; or (n_poses, n_cells).
        """
        return in_space(self.linkage.poses(fold).matrices())


def body_numbers(layout: Layout) -> NDArray[np.intp]:
    """(n_panels,) the rigid body of every panel, counted from 0: bonded panels are one."""
    return np.unique(layout.bodies, return_inverse=True)[1]


def _across(vectors: Reals, axis: Reals) -> Reals:
    """The part of vectors (n, 3) that is at right angles to unit axes (n, 3)."""
    return np.asarray(vectors - np.einsum("ci,ci->c", vectors, axis)[:, None] * axis)
