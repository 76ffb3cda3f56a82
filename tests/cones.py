"""Structures on cones that tests share: every kind of cell, corner, base and apex."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from ori_deploy.design import ConeEmbedding, ConeStructure, build_cone, embed_cone
from ori_deploy.layout import make_layout, ring
from ori_deploy.profiles import Clover, Cone, Naca4, Superellipse
from tests.shapes import peanut, polygon, structure


def cone_ring(
    cone: Cone,
    n: int,
    *,
    phase: float = 0.5,
    centre: tuple[float, float] = (0.0, 0.0),
    slit: str = "O1",
) -> ConeEmbedding:
    """A ring of n cells, evenly spaced in the base's natural parameter; `centre` in the base's plane."""
    vertices, cells = ring(n)
    layout = make_layout(vertices, cells, [("P", slit)])
    step = 2.0 * np.pi / n
    places = {f"O{i + 1}": cone.at_natural(phase + i * step) for i in range(n)}
    places |= {f"C{i + 1}": cone.at_natural(phase + (i + 0.5) * step) for i in range(n)}
    return embed_cone(cone, layout, places, {"P": centre})


def coned(name: str, apex: tuple[float, float, float], wall_rad: float) -> ConeStructure:
    """A plane structure of `tests.shapes` as the base of a cone: the same vertices."""
    e = structure(name).embedding
    ids = [v.id for v in e.layout.vertices]
    outline = {ids[i]: float(s) for i, s in enumerate(e.s) if np.isfinite(s)}
    inner = {ids[i]: (float(e.z[i].real), float(e.z[i].imag)) for i in np.flatnonzero(np.isnan(e.s))}
    return build_cone(embed_cone(Cone(e.profile, apex), e.layout, outline, inner), wall_rad)


def half(angle: float, aspect: float = 1.0) -> Cone:
    return Cone.of_half_angle(angle, aspect)


CONES: dict[str, Callable[[], ConeStructure]] = {
    "circular 6": lambda: build_cone(cone_ring(half(0.5), 6), 0.01),
    "circular 6 without wall": lambda: build_cone(cone_ring(half(0.5), 6), 0.0),
    "elliptic 6": lambda: build_cone(cone_ring(half(0.5, 0.6), 6, phase=np.pi / 6.0), 0.01),
    "elliptic 6 turned": lambda: build_cone(cone_ring(half(0.5, 0.6), 6, phase=0.3), 0.004),
    "elliptic 7 off axis": lambda: build_cone(cone_ring(half(0.4, 0.7), 7, phase=1.1, centre=(0.04, -0.02)), 0.004),
    "wide 5": lambda: build_cone(cone_ring(half(1.1), 5), 0.02),
    "narrow 8": lambda: build_cone(cone_ring(half(0.01), 8), 1e-4),
    "wing, apex above": lambda: coned("wing thin", (0.1, 0.05, 4.0), 0.0006),
    "wing, apex below": lambda: coned("wing thin", (0.6, 0.0, -4.0), 0.0006),
    "one cell": lambda: coned("one cell", (0.1, 0.0, -2.0), 0.01),
    "two cells": lambda: coned("two cells", (0.0, 0.2, 2.5), 0.005),
    "two inner vertices": lambda: coned("two inner vertices", (0.0, 0.0, -2.0), 0.004),
    "superellipse 4": lambda: coned("superellipse 4, m = 3.5", (0.3, 0.1, -3.0), 0.005),
    "hollow 8": lambda: build_cone(cone_ring(Cone(peanut(), (0.0, 0.0, -3.0)), 8, phase=0.0), 0.003),
    "clover 6": lambda: build_cone(cone_ring(Cone(Clover(0.1, 0.25), (0.0, 0.0, -0.4)), 6, phase=0.0), 0.002),
    "pyramid 5": lambda: build_cone(cone_ring(Cone(polygon(), (0.0, 0.0, -0.6)), 5, phase=0.25, slit="O2"), 0.003),
    "oblique 6": lambda: build_cone(cone_ring(Cone(Superellipse(0.3, 0.3), (1.0, 0.2, -1.0)), 6), 0.002),
    "tapered wing": lambda: coned("wing", (0.25, 0.0, 6.0), 0.0008),
}


@cache
def cone(name: str) -> ConeStructure:
    """A structure of the catalogue, built once."""
    return CONES[name]()


def naca_cone(code: str = "2412", apex: tuple[float, float, float] = (0.05, 0.0, 2.0)) -> Cone:
    return Cone(Naca4(code, 0.25), apex)
