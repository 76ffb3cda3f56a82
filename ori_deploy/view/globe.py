"""The unit sphere round a cone's apex on paper: distances and directions from the middle are true (azimuthal)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ori_deploy.profiles.profile import Points
from ori_deploy.profiles.sphere import Vectors, arc, cross, dot, unit

_STEP_RAD = 0.03
"""Longest arc drawn as one straight stroke."""


@dataclass(frozen=True)
class Globe:
    """Azimuthal equidistant projection, in degrees of arc.

    Attributes
    ----------
    centre
        (3,) direction that lies in the paper's origin.
    east
        (3,) direction, at right angles to it, that points right.
    """

    centre: Vectors
    east: Vectors

    @classmethod
    def looking_along(cls, centre: Vectors, east: Vectors) -> Globe:
        """The globe with a direction `east`, about, to the right."""
        centre = unit(centre)
        return cls(centre, unit(east - dot(east, centre)[..., None] * centre))

    def flat(self, directions: Vectors) -> Points:
        """(...,) places on paper of unit vectors (..., 3); x right, y up, degrees."""
        north = cross(self.centre, self.east)
        out = np.asarray(directions @ self.east + 1j * (directions @ north), dtype=np.complex128)
        sine = np.abs(out)
        angle = np.arctan2(sine, directions @ self.centre)
        return np.asarray(np.degrees(np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0)) * out)


def strokes(corners: Vectors, *, closed: bool) -> Vectors:
    """Points along the great-circle arcs from corner to corner, close enough to be joined by straight strokes."""
    ends = np.roll(corners, -1, axis=0) if closed else corners[1:]
    pieces = []
    for a, b in zip(corners, ends, strict=False):
        count = max(1, int(np.ceil(float(arc(a, b)) / _STEP_RAD)))
        share = np.arange(count)[:, None] / count
        pieces.append(unit((1.0 - share) * a + share * b))
    return np.concatenate(pieces if closed else [*pieces, corners[-1:]])
