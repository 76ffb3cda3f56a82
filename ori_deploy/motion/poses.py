"""Where every panel is at a given fold: rigid motions of the deployed cross-section, plane or sphere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self, TypeVar

import numpy as np

from ori_deploy.profiles.profile import Points, Reals


class Placement(Protocol):
    """Rigid motions of all panels at several folds."""

    @property
    def n_poses(self) -> int:
        """How many folds."""

    def part(self, some: slice) -> Self:
        """Some of the folds."""

    def matrices(self) -> Reals:
        """(n_poses, n_panels, k, k) homogeneous transforms: k = 3 in the plane, 4 in space."""


PosesT = TypeVar("PosesT", bound=Placement)
"""Each surface has its own kind of poses."""


@dataclass(frozen=True)
class Poses:
    """Rigid motions `z -> turn * z + shift` of all panels of a cylinder's cross-section.

    Attributes
    ----------
    turn, shift
        (n_panels, n_poses) unit complex numbers and metres. The first panel of cell c1 stays where it
        is in the deployed cross-section.
    """

    turn: Points
    shift: Points

    @property
    def n_poses(self) -> int:
        return int(self.turn.shape[1])

    def part(self, some: slice) -> Poses:
        return Poses(self.turn[:, some], self.shift[:, some])

    def matrices(self) -> Reals:
        """(n_poses, n_panels, 3, 3) homogeneous transforms."""
        turn, shift = self.turn.T, self.shift.T
        out = np.zeros((*turn.shape, 3, 3))
        out[..., 0, 0] = out[..., 1, 1] = turn.real
        out[..., 1, 0], out[..., 0, 1] = turn.imag, -turn.imag
        out[..., 0, 2], out[..., 1, 2] = shift.real, shift.imag
        out[..., 2, 2] = 1.0
        return out


@dataclass(frozen=True)
class ConePoses:
    """Rotations about a cone's apex.

    Attributes
    ----------
    rotation
        (n_panels, n_poses, 3, 3) in the cone's frame. The first panel of cell c1 stays where it is in
        the deployed cone.
    frame
        (3, 3) the cone's axes as columns in the user's coordinates; orthogonal, a mirror image perhaps.
    apex
        (3,) in the user's coordinates, metres.
    """

    rotation: Reals
    frame: Reals
    apex: Reals

    @property
    def n_poses(self) -> int:
        return int(self.rotation.shape[1])

    def part(self, some: slice) -> ConePoses:
        return ConePoses(self.rotation[:, some], self.frame, self.apex)

    def matrices(self) -> Reals:
        """(n_poses, n_panels, 4, 4) homogeneous transforms of the user's coordinates, metres: about `apex`."""
        out = np.zeros((self.n_poses, len(self.rotation), 4, 4))
        turned = self.frame @ self.rotation.transpose(1, 0, 2, 3) @ self.frame.T
        out[..., :3, :3] = turned
        out[..., :3, 3] = self.apex - turned @ self.apex
        out[..., 3, 3] = 1.0
        return out
