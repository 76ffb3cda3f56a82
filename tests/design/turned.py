"""Flat-sided structures, turned and moved: what comes out must not depend on where they are."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ori_deploy.design import ConeStructure, Structure, build, build_cone
from ori_deploy.profiles import Cone, PointOutline, xy
from tests.cones import cone_ring
from tests.shapes import ring_on

Kind = Literal["cylinder", "cone"]


def flat_sided(
    kind: Kind, sides: int, turn_rad: float, phase: float, wall: float, away: float = 0.0
) -> Structure | ConeStructure:
    """A ring of as many cells as a regular polygon of radius 1 m has sides; it turns as a whole.

    Parameters
    ----------
    phase
        Where the first opening vertex is, in sides from a corner.
    away
        Distance of a cylinder's middle from the origin, metres; cones stay about their axis.
    """
    middle = (away if kind == "cylinder" else 0.0) * np.exp(1j * (turn_rad + 0.7))
    corner = middle + np.exp(1j * (turn_rad + 2.0 * np.pi * np.arange(sides) / sides))
    outline = PointOutline(xy(corner), smooth=False)
    start = 2.0 * np.pi * phase / sides
    if kind == "cone":
        return build_cone(cone_ring(Cone(outline, (0.0, 0.0, -2.0)), sides, phase=start), wall)
    return build(ring_on(outline, sides, phase=start, centre=(middle.real, middle.imag)), wall)
