"""Where everything is: rigid motions of bodies and span segments as unit quaternions and places."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from ori_deploy.design import Structure
from ori_deploy.files import Design
from ori_deploy.motion import Linkage, Mechanism, SpanFolding, mechanism_of
from ori_deploy.motion.poses import Placement
from ori_deploy.profiles.profile import Reals


@dataclass(frozen=True)
class Places:
    """Rigid motions.

    Attributes
    ----------
    wxyz
        (n, 4) unit quaternions.
    position
        (n, 3) metres.
    """

    wxyz: Reals
    position: Reals

    @classmethod
    def of(cls, matrices: Reals) -> Places:
        """From (n, 4, 4) homogeneous transforms, or (n, 3, 3) ones of the plane of x and y."""
        if matrices.shape[-1] == 3:
            half = 0.5 * np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])
            nought = np.zeros_like(half)
            wxyz = np.column_stack([np.cos(half), nought, nought, np.sin(half)])
            return cls(wxyz, np.column_stack([matrices[:, :2, 2], nought]))
        xyzw = Rotation.from_matrix(matrices[:, :3, :3]).as_quat()
        return cls(xyzw[:, [3, 0, 1, 2]], matrices[:, :3, 3].copy())

    def matrices(self) -> Reals:
        """(n, 4, 4) homogeneous transforms."""
        out = np.tile(np.eye(4), (len(self.wxyz), 1, 1))
        out[:, :3, :3] = Rotation.from_quat(self.wxyz[:, [1, 2, 3, 0]]).as_matrix()
        out[:, :3, 3] = self.position
        return out


@dataclass(frozen=True)
class Mover:
    """How a design moves.

    Attributes
    ----------
    design
        Which.
    """

    design: Design

    @cached_property
    def mechanism(self) -> Linkage[Placement]:
        """Its cells."""
        return mechanism_of(self.design.structure, self.design.r_max_m)

    @cached_property
    def span(self) -> SpanFolding | None:
        """Its span, where that is cut into segments."""
        structure, n = self.design.structure, self.design.span_segments
        if n == 1 or not isinstance(structure, Structure):
            return None
        return SpanFolding(Mechanism(structure), self.design.span_m, n)

    def panels(self, fold: Reals) -> Places:
        """All panels of one segment, at one fold per cell (n_cells,)."""
        return Places.of(self.mechanism.poses(np.asarray(fold, dtype=float)[None, :]).matrices()[0])

    def segments(self, folded: float) -> Places:
        """All span segments; `folded` from 0, straight, to 1."""
        if self.span is None:
            return Places(np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)))
        angles = np.full((1, self.span.segments - 1), np.pi * folded)
        matrices = self.span.segment_matrices(angles)[0].copy()
        # All segments show the first one's bodies, which each has further along the span.
        along = self.span.length_m * np.arange(self.span.segments)
        matrices[:, :3, 3] += matrices[:, :3, 2] * along[:, None]
        return Places.of(matrices)
