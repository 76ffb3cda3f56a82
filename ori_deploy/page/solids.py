"""Panels as triangles: prisms over a cylinder's span, wedges between a cone's radii; the user's axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from ori_deploy.design import ConeStructure
from ori_deploy.motion.mechanism import AnyStructure
from ori_deploy.profiles import xy
from ori_deploy.profiles.profile import Reals

Triangles = NDArray[np.uint32]

SAGITTA = 1e-4
"""How far facets may stand off the true outline, as a part of the profile's size: less than a pixel."""


@dataclass(frozen=True)
class Solid:
    """A closed surface.

    Attributes
    ----------
    vertices
        (n, 3) metres; first the corners at one end of the span, then those at the other.
    faces
        (m, 3) corners of triangles, counter-clockwise seen from outside.
    """

    vertices: Reals
    faces: Triangles

    @property
    def volume_m3(self) -> float:
        """What it encloses."""
        a, b, c = self.vertices[self.faces].transpose(1, 0, 2)
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@dataclass(frozen=True)
class Lift:
    """Takes points of the cross-section into space, to either end of a stretch of the span.

    Attributes
    ----------
    structure
        Whose cross-section.
    low_m, high_m
        Both ends: z on a cylinder, the distance from the apex on a cone.
    """

    structure: AnyStructure
    low_m: float
    high_m: float

    def ends(self, points: NDArray[np.inexact]) -> Reals:
        """(2, n, 3) the points at both ends: (n,) complex ones of a plane section, (n, 3) rays of a cone's."""
        if isinstance(self.structure, ConeStructure):
            cone = self.structure.profile
            rays = cone.to_user(np.asarray(points, dtype=float))
            return np.stack([cone.apex + r * rays for r in (self.low_m, self.high_m)])
        flat = xy(np.atleast_1d(points).astype(np.complex128))
        return np.stack([np.column_stack([flat, np.full(len(flat), z)]) for z in (self.low_m, self.high_m)])

    def solid(self, outline: NDArray[np.inexact]) -> Solid:
        """The body over a panel's outline."""
        low, high = self.ends(outline)
        n = len(low)
        cap = _cap(outline)
        here = np.arange(n, dtype=np.uint32)
        ahead = np.roll(here, -1)
        sides = np.concatenate([np.stack([here, ahead, ahead + n], 1), np.stack([here, ahead + n, here + n], 1)])
        faces = np.concatenate([cap[:, ::-1], cap + n, sides]).astype(np.uint32)
        made = Solid(np.concatenate([low, high]), faces)
        # A cone's frame may be a mirror image, and so may be what is counter-clockwise.
        return made if made.volume_m3 >= 0.0 else Solid(made.vertices, faces[:, ::-1])


def _cap(outline: NDArray[np.inexact]) -> Triangles:
    """(m, 3) triangles that fill an outline, wound as it is."""
    flat = _drawn(outline)
    found = shapely.constrained_delaunay_triangles(shapely.Polygon(flat))
    number = {(float(x), float(y)): i for i, (x, y) in enumerate(flat)}
    rows = [[number[point] for point in piece.exterior.coords[:3]] for piece in found.geoms]
    corners = np.array(rows, dtype=np.uint32).reshape(-1, 3)
    a, b, c = flat[corners].transpose(1, 0, 2)
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    backwards = area * _area(flat) < 0.0
    corners[backwards] = corners[backwards][:, ::-1]
    return corners


def _drawn(outline: NDArray[np.inexact]) -> Reals:
    """(n, 2) an outline on a plane; a cone's seen from its apex."""
    if np.iscomplexobj(outline):
        return np.asarray(xy(outline.astype(np.complex128)))
    middle = outline.sum(axis=0)
    middle /= np.linalg.norm(middle)
    right = np.cross([0.0, 1.0, 0.0] if abs(middle[1]) < 0.9 else [1.0, 0.0, 0.0], middle)
    right /= np.linalg.norm(right)
    flat = outline / (outline @ middle)[:, None]
    return np.column_stack([flat @ right, flat @ np.cross(middle, right)])


def _area(flat: Reals) -> float:
    ahead = np.roll(flat, -1, axis=0)
    return 0.5 * float((flat[:, 0] * ahead[:, 1] - flat[:, 1] * ahead[:, 0]).sum())
