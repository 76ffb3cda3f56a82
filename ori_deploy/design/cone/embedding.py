"""A layout laid onto a cone: the directions of its vertices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ori_deploy.design.embedding import embed
from ori_deploy.layout import Layout
from ori_deploy.profiles.cone import Cone
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors


@dataclass(frozen=True)
class ConeEmbedding:
    """A layout on a cone. Make one with `embed_cone`, which checks it.

    Attributes
    ----------
    profile, layout
        What is embedded on what.
    s
        (n_vertices,) parameter of each outline vertex; NaN for inner ones.
    u
        (n_vertices, 3) unit vectors from the apex, in the cone's frame.
    """

    profile: Cone
    layout: Layout
    s: Reals
    u: Vectors

    @cached_property
    def curved(self) -> NDArray[np.bool_]:
        """(n_cells, 4) whether the cell's panel lies on the outline."""
        return (self.layout.neighbour < 0).reshape(-1, 4)


def embed_cone(
    cone: Cone, layout: Layout, outline: Mapping[str, float], inner: Mapping[str, tuple[float, float]]
) -> ConeEmbedding:
    """Place a layout's vertices.

    Central projection keeps straight lines straight, so the checks are those of the base's plane.

    Parameters
    ----------
    cone, layout
        Shape and layout.
    outline
        Parameter `s` of every outline vertex, by id.
    inner
        (x, y) in the base's plane, metres, of the ray of every inner vertex, by id.

    Raises
    ------
    LayoutError
        A vertex without a place or outside, outline vertices out of order, inner edges that cross
        the outline or each other.
    """
    plane = embed(cone.base, layout, outline, inner)
    return ConeEmbedding(cone, layout, plane.s, cone.towards(plane.z))
