"""What interference asks of the surface that panels move on: the plane, or the sphere.

Everything is seen from one panel of a pair: its shapes live in its own chart of the surface, and the
other panel is moved into that chart.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic

import numpy as np
import shapely
from numpy.typing import NDArray

from ori_deploy.motion.poses import PosesT
from ori_deploy.profiles.profile import Points, Reals

Indices = NDArray[np.intp]
Shapes = NDArray[np.object_]


class Contact(ABC, Generic[PosesT]):
    """Panels as shapes, and how near two of them are. All lengths in metres; on a cone at the outer radius.

    Pairs are given as (n,) panels `i` and `j`, each with a pose: the same index on every argument.
    """

    @property
    @abstractmethod
    def shapes(self) -> Shapes:
        """(n_panels,) each panel's polygon in its own chart, deployed; empty where it has no material."""

    @property
    @abstractmethod
    def widest_m(self) -> Reals:
        """(n_panels,) a depth that no point inside the panel exceeds."""

    @abstractmethod
    def shrunk(self, depth_m: Reals, panels: Indices) -> Shapes:
        """Panels, in their own charts, without what is nearer to their boundary than (n,) `depth_m`."""

    @abstractmethod
    def moved(self, poses: PosesT, pose: Indices, moving: Indices, fixed: Indices) -> Shapes:
        """Shapes of panels `moving` in the charts of panels `fixed`, as far as those charts reach."""

    @abstractmethod
    def gaps(self, poses: PosesT, pose: Indices, i: Indices, j: Indices) -> Reals:
        """Lower bound of the distance of two panels, from boxes round them; negative: they overlap by no more."""

    @abstractmethod
    def distances(self, poses: PosesT, pose: Indices, i: Indices, j: Indices) -> Reals:
        """Distance of two panels, 0 where they meet."""

    @abstractmethod
    def travel(self, a: PosesT, b: PosesT, pose: Indices, i: Indices, j: Indices) -> Reals:
        """Bound of how far a point of panel `i` moves, seen from `j`, from poses `a` to `b`."""


def polygons(rings: tuple[Points, ...]) -> Shapes:
    """Panels as valid shapes, from their corners in a chart.

    An outline touches itself where a hollow is as deep as the wall; such a shape falls into parts.
    """
    shapes = np.array(
        [shapely.Polygon(np.stack([z.real, z.imag], axis=1)) if len(z) > 2 else shapely.Polygon() for z in rings]
    )
    bad = ~shapely.is_valid(shapes)
    shapes[bad] = shapely.make_valid(shapes[bad])
    return shapes
