"""A structure on a generalized cone that moves: every panel turns about the apex."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.design.cone import ConeStructure
from ori_deploy.motion.cone_stack import stack_box
from ori_deploy.motion.mechanism import NEXT_CREASE, Linkage
from ori_deploy.motion.poses import ConePoses
from ori_deploy.motion.sphere_contact import SphereContact
from ori_deploy.motion.spherical_fourbar import SphericalFourBars
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors
from ori_deploy.tolerance import Tolerance


def rotations(axis: Vectors, angle: Reals) -> Reals:
    """(..., 3, 3) rotations about unit vectors (..., 3) by angles (...), counter-clockwise seen from their tips."""
    axis, angle = np.asarray(axis), np.asarray(angle)
    x, y, z = np.moveaxis(axis, -1, 0)
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    # 2 sin²(θ/2) for 1 - cos θ: small angles keep all their digits.
    versine = 2.0 * np.sin(0.5 * angle) ** 2
    return np.asarray(np.eye(3) + np.sin(angle)[..., None, None] * skew + versine[..., None, None] * (skew @ skew))


@dataclass(frozen=True)
class ConeMechanism(Linkage[ConePoses]):
    """A structure on a generalized cone that moves.

    Attributes
    ----------
    structure
        What moves.
    r_max_m
        Outer radius: lengths are told in metres there, an arc of 1 rad as `r_max_m`.
    """

    structure: ConeStructure
    r_max_m: float = 1.0

    @property
    def size_m(self) -> float:
        return self.structure.profile.size * self.r_max_m

    @cached_property
    def four_bars(self) -> SphericalFourBars:
        return SphericalFourBars.of(self.structure.cells)

    def poses(self, fold: ArrayLike) -> ConePoses:
        angles = self.four_bars.angles(np.atleast_1d(np.asarray(fold, dtype=float)))
        crease = self.structure.cells.crease
        swing = rotations(crease, -(angles - self.four_bars.deployed))  # (n_poses, n_cells, 4, 3, 3)
        rotation = np.empty((self.layout.n_panels, len(angles), 3, 3))
        rotation[0] = np.eye(3)
        for cell, entry, bonded in self.layout.folding_order:
            if bonded >= 0:
                rotation[entry] = rotation[bonded]
            for step in range(3):
                k = (entry + step) % 4
                here, there = 4 * cell + k, 4 * cell + (k + 1) % 4
                rotation[there] = rotation[here] @ swing[:, cell, NEXT_CREASE[k]]
        profile = self.structure.profile
        return ConePoses(rotation, profile.frame, profile.apex)

    def contact(self, tolerance: Tolerance) -> SphereContact:
        return SphereContact(self.structure, tolerance, self.r_max_m)

    def steps_m(self, poses: ConePoses) -> Reals:
        turned = np.diff(poses.rotation, axis=1)
        moved = np.linalg.norm(turned @ self.structure.profile.axis, axis=-1)
        most = np.linalg.norm(turned, axis=(-2, -1)) / np.sqrt(2.0)
        return np.asarray((moved * self.r_max_m + most * self.size_m).max(axis=0))

    def stack_box_m(self, r_min_m: float, r_max_m: float) -> tuple[float, float, float]:
        """Sides (longest first) of the smallest box round the folded stack between two radii, metres.

        The smallest that is found: see `cone_stack`. The ends of the stack are pieces of spheres.
        """
        flat = self.poses(0.0).rotation[:, 0]
        outlines = [o @ turn.T for o, turn in zip(self.structure.panel_outlines(), flat, strict=True)]
        return stack_box(tuple(outlines), r_min_m, r_max_m)
