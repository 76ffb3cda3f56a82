"""How every panel moves while one cell folds and the others do not: the structure held at one panel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.loads.solids import Solids
from ori_deploy.motion.mechanism import NEXT_CREASE, Linkage
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors


@dataclass(frozen=True)
class Twists:
    """Poses, and their derivatives with respect to every cell's own fold.

    Attributes
    ----------
    matrices
        (n_poses, n_panels, 4, 4) rigid motions from the deployed state; the clamped panel does not move.
    turning, moving
        (n_poses, n_cells, n_panels, 3) angular velocity, radians, and velocity of what is at the origin,
        metres, per unit of one cell's fold.
    rates
        (n_poses, n_cells, 4) rates of the inner angles per unit of their own cell's fold, radians.
    angles
        (n_poses, n_cells, 4) inner angles, radians.
    """

    matrices: Reals
    turning: Vectors
    moving: Vectors
    rates: Reals
    angles: Reals

    @classmethod
    def of(cls, linkage: Linkage[Any], solids: Solids, fold: ArrayLike, clamp: int = 0) -> Twists:
        """All panels' twists.

        Parameters
        ----------
        fold
            (n_poses,) all cells in step, or (n_poses, n_cells).
        clamp
            Number of the panel that is held where it is when deployed.
        """
        at = np.atleast_1d(np.asarray(fold, dtype=float))
        matrices = clamped(in_space(linkage.poses(at).matrices()), clamp)
        rates, angles = linkage.four_bars.transmission(at), linkage.four_bars.angles(at)
        turning, moving = _relative(linkage, solids, matrices, rates)
        return cls(matrices, turning - turning[:, :, [clamp]], moving - moving[:, :, [clamp]], rates, angles)

    def velocities(self, panel: Any, points: Vectors) -> tuple[Vectors, Vectors]:
        """Places and velocities of points that are fixed to panels.

        Parameters
        ----------
        panel
            (n,) their panels.
        points
            (n, 3) where they are when deployed, metres.

        Returns
        -------
        (n_poses, n, 3) places and (n_poses, n_cells, n, 3) velocities per unit of fold, metres.
        """
        motion = self.matrices[:, panel]
        place = np.einsum("tnij,nj->tni", motion[..., :3, :3], points) + motion[..., :3, 3]
        return place, self.moving[:, :, panel] + np.cross(self.turning[:, :, panel], place[:, None])


def in_space(matrices: Reals) -> Reals:
    """(n_poses, n_panels, 4, 4) of poses in the plane (3, 3) or in space already."""
    if matrices.shape[-1] == 4:
        return matrices
    out = np.zeros((*matrices.shape[:2], 4, 4))
    out[..., :2, :2], out[..., :2, 3] = matrices[..., :2, :2], matrices[..., :2, 2]
    out[..., 2, 2] = out[..., 3, 3] = 1.0
    return out


def clamped(matrices: Reals, clamp: int) -> Reals:
    """The same poses seen from one panel."""
    turn, shift = matrices[:, clamp, :3, :3], matrices[:, clamp, :3, 3]
    back = np.zeros((len(matrices), 4, 4))
    back[:, :3, :3] = turn.transpose(0, 2, 1)
    back[:, :3, 3] = -np.einsum("tji,tj->ti", turn, shift)
    back[:, 3, 3] = 1.0
    return back[:, None] @ matrices


def _relative(linkage: Linkage[Any], solids: Solids, matrices: Reals, rates: Reals) -> tuple[Vectors, Vectors]:
    """Twists as seen from the first panel."""
    layout = linkage.layout
    turning = np.zeros((len(matrices), layout.n_cells, layout.n_panels, 3))
    moving = np.zeros_like(turning)
    for cell, entry, bonded in layout.folding_order:
        if bonded >= 0:
            turning[:, :, entry], moving[:, :, entry] = turning[:, :, bonded], moving[:, :, bonded]
        for step in range(3):
            k = (entry + step) % 4
            here, there, crease = 4 * cell + k, 4 * cell + (k + 1) % 4, NEXT_CREASE[k]
            motion = matrices[:, here]
            axis = motion[:, :3, :3] @ solids.crease_axis[cell, crease]
            point = motion[:, :3, :3] @ solids.crease_point[cell, crease] + motion[:, :3, 3]
            turn = -rates[:, cell, crease, None] * axis
            turning[:, :, there], moving[:, :, there] = turning[:, :, here], moving[:, :, here]
            turning[:, cell, there] += turn
            moving[:, cell, there] += np.cross(point, turn)
    return turning, moving
