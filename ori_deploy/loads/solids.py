"""Panels as solids in space: mass, skin and creases, alike for cylinders and cones.

Everything is told in the design's coordinates, deployed. A cylinder's cross-section lies in the plane of x and
y, and its span runs from z = 0 upwards; a cone's are the user's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ori_deploy.design import Structure
from ori_deploy.design.cone import ConeStructure
from ori_deploy.motion.mechanism import BEFORE_CREASE, NEXT_CREASE, AnyStructure
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.profiles.sphere import Vectors

FINE = 1e-5
"""Sagitta of the outlines that are integrated over, relative to the profile's size: areas to 1e-4 and better."""

_THIN = 1e-9
"""Volume of a panel, over the largest, below which its centroid and inertia are but rounding."""

SKIN_PIECES = 12
"""Patches of skin along each panel's piece of outline."""


@dataclass(frozen=True)
class Skin:
    """Patches of the outer surface.

    Attributes
    ----------
    panel
        (n,) the panel it is on.
    s
        (n,) parameter of the outline at its middle.
    point
        (n, 3) its middle, metres.
    area
        (n, 3) outward normal times area, square metres.
    """

    panel: NDArray[np.intp]
    s: Reals
    point: Vectors
    area: Vectors


@dataclass(frozen=True)
class Solids:
    """All panels of a structure as solids of density 1.

    Attributes
    ----------
    volume
        (n_panels,) cubic metres.
    centroid
        (n_panels, 3) metres.
    spread
        (n_panels, 3, 3) integral of (x - centroid)(x - centroid)^T over the volume, m^5.
    crease_point, crease_axis
        (n_cells, 4, 3) middle of each crease, and its direction: while the inner angle grows, the panel that
        follows counter-clockwise round the cell turns clockwise about it, seen from the one before.
    skin
        The outer surface.
    span_m
        Length of the creases.
    """

    volume: Reals
    centroid: Vectors
    spread: Reals
    crease_point: Vectors
    crease_axis: Vectors
    skin: Skin
    span_m: float

    @classmethod
    def of(cls, structure: AnyStructure, span_m: float, r_min_m: float = 0.0) -> Solids:
        """The solids of a structure.

        Parameters
        ----------
        span_m
            Length along a cylinder's axis, or along a cone's rays.
        r_min_m
            Radius at which a cone begins.
        """
        # A panel without area has no centroid of its own.
        with np.errstate(divide="ignore", invalid="ignore"):
            if isinstance(structure, ConeStructure):
                made = _cone(structure, r_min_m, r_min_m + span_m)
            else:
                made = _cylinder(structure, span_m)
        return made._without_rounding()

    def _without_rounding(self) -> Solids:
        """Panels so thin that their moments are but rounding as what they are: a line between their two creases."""
        thick = self.volume > _THIN * self.volume.max()
        between = self.crease_point[:, [BEFORE_CREASE, NEXT_CREASE]].mean(axis=1).reshape(-1, 3)
        return replace(
            self,
            volume=np.where(thick, self.volume, 0.0),
            centroid=np.where(thick[:, None], self.centroid, between),
            spread=np.where(thick[:, None, None], self.spread, 0.0),
        )

    def inertia(self, panel: int) -> Reals:
        """(3, 3) inertia of a panel about its centroid at density 1."""
        spread = self.spread[panel]
        return np.asarray(np.trace(spread) * np.eye(3) - spread)


def _cylinder(structure: Structure, span: float) -> Solids:
    moments = [_polygon(outline) for outline in structure.panel_outlines(FINE * structure.profile.size)]
    area = np.array([m[0] for m in moments])
    centroid = np.array([[*m[1], 0.5 * span] for m in moments])
    spread = np.zeros((len(area), 3, 3))
    spread[:, :2, :2] = span * np.array([m[2] for m in moments])
    spread[:, 2, 2] = area * span**3 / 12.0
    place = structure.cells.crease
    point = np.stack([place.real, place.imag, np.full(place.shape, 0.5 * span)], axis=-1)
    axis = np.broadcast_to(np.array([0.0, 0.0, 1.0]), point.shape)
    panel, s, z = _pieces(structure.outline_pieces)
    ends = structure.profile.point(z)
    along = ends[:, 1] - ends[:, 0]
    middle = 0.5 * (ends[:, 0] + ends[:, 1])
    # Counter-clockwise outline: outwards is to the right of it.
    outward = -1j * along * span
    skin = Skin(
        panel,
        s,
        np.stack([middle.real, middle.imag, np.full(len(s), 0.5 * span)], axis=1),
        np.stack([outward.real, outward.imag, np.zeros(len(s))], axis=1),
    )
    return Solids(area * span, centroid, spread, point, axis, skin, span)


def _pieces(pieces: Reals) -> tuple[NDArray[np.intp], Reals, Reals]:
    """Panel, middle parameter and both ends' parameters of all patches along the outline."""
    curved = np.flatnonzero(pieces[:, 1] > pieces[:, 0])
    edges = np.linspace(0.0, 1.0, SKIN_PIECES + 1)
    at = pieces[curved, :1] + np.diff(pieces[curved]) * edges
    ends = np.stack([at[:, :-1], at[:, 1:]], axis=-1).reshape(-1, 2)
    return np.repeat(curved, SKIN_PIECES), ends.mean(axis=1), ends


def _polygon(outline: Points) -> tuple[float, Reals, Reals]:
    """Area, centroid (2,) and second moments about it (2, 2) of a polygon, counter-clockwise."""
    near = outline[0]
    p = np.stack([(outline - near).real, (outline - near).imag], axis=1)
    n = np.roll(p, -1, axis=0)
    twice = p[:, 0] * n[:, 1] - n[:, 0] * p[:, 1]
    area = 0.5 * twice.sum()
    centroid = ((p + n) * twice[:, None]).sum(axis=0) / (6.0 * area)
    # Integral of x x^T over the triangle (0, p, n): twice / 24 (p p^T + n n^T + (p + n)(p + n)^T).
    both = p + n
    outer = sum(np.einsum("k,ki,kj->ij", twice, a, a) for a in (p, n, both)) / 24.0
    return float(area), centroid + np.array([near.real, near.imag]), outer - area * np.outer(centroid, centroid)


_DUFFY = np.polynomial.legendre.leggauss(6)


def _sector(corners: Vectors) -> tuple[float, Reals, Reals]:
    """Solid angle, and the integrals of u (3,) and of u u^T (3, 3) over it, of a spherical polygon."""
    x, w = 0.5 * (_DUFFY[0] + 1.0), 0.5 * _DUFFY[1]
    a, b = np.meshgrid(x, x, indexing="ij")
    weight = (np.outer(w, w) * a).ravel()  # the square folded to a triangle
    share = np.stack([1.0 - a, a * (1.0 - b), a * b], axis=-1).reshape(-1, 3)
    first = corners[0]
    fan = np.stack([np.broadcast_to(first, corners[1:-1].shape), corners[1:-1], corners[2:]], axis=1)
    det = np.linalg.det(fan)  # signed, so that the fan may fold over itself
    flat = np.einsum("qk,tki->tqi", share, fan)
    size = np.linalg.norm(flat, axis=-1)
    u = flat / size[..., None]
    solid = det[:, None] * weight / size**3
    return float(solid.sum()), np.einsum("tq,tqi->i", solid, u), np.einsum("tq,tqi,tqj->ij", solid, u, u)


def _cone(structure: ConeStructure, r_min: float, r_max: float) -> Solids:
    profile = structure.profile
    apex, frame = profile.apex, profile.frame
    handed = np.sign(np.linalg.det(frame))

    def powers(n: int) -> float:
        return (r_max**n - r_min**n) / n

    sectors = [_sector(outline) for outline in structure.panel_outlines(FINE * profile.size)]
    volume = np.array([s[0] for s in sectors]) * powers(3)
    centroid = np.array([s[1] for s in sectors]) * powers(4) / volume[:, None]
    spread = np.array([s[2] for s in sectors]) * powers(5) - np.einsum("p,pi,pj->pij", volume, centroid, centroid)
    crease = profile.to_user(structure.cells.crease)
    panel, s, ends = _pieces(structure.outline_pieces)
    a, b = np.moveaxis(profile.to_user(profile.point(ends)), 1, 0)
    middle = (a + b) / np.linalg.norm(a + b, axis=1)[:, None]
    # At radius r a piece of outline is |a x b| r dr large; three points of Gauss's rule along the ray.
    nodes, weights = np.polynomial.legendre.leggauss(3)
    radius = 0.5 * (r_max + r_min) + 0.5 * (r_max - r_min) * nodes
    lever = 0.5 * (r_max - r_min) * weights * radius
    outward = handed * np.cross(b, a)  # the outline runs counter-clockwise about the frame's z axis
    skin = Skin(
        np.repeat(panel, 3),
        np.repeat(s, 3),
        (apex + middle[:, None] * radius[:, None]).reshape(-1, 3),
        (outward[:, None] * lever[:, None]).reshape(-1, 3),
    )
    place = apex + 0.5 * (r_min + r_max) * crease
    turned = frame @ spread @ frame.T
    return Solids(volume, apex + centroid @ frame.T, turned, place, handed * crease, skin, r_max - r_min)
