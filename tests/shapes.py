"""Structures the geometry tests share: every kind of cell, corner, outline and layout."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from ori_deploy.design import Embedding, Structure, build, embed
from ori_deploy.layout import Vertex, make_layout, ring
from ori_deploy.profiles import Naca4, PointOutline, Profile, Superellipse

Cell = tuple[str, str, str, str]


def ring_on(
    profile: Profile,
    n: int,
    *,
    phase: float = 0.5,
    centre: tuple[float, float] = (0.0, 0.0),
    slit: str = "O1",
) -> Embedding:
    """A ring of n cells, evenly spaced in the natural parameter."""
    vertices, cells = ring(n)
    layout = make_layout(vertices, cells, [("P", slit)])
    step = 2.0 * np.pi / n
    places = {f"O{i + 1}": profile.at_natural(phase + i * step) for i in range(n)}
    places |= {f"C{i + 1}": profile.at_natural(phase + (i + 0.5) * step) for i in range(n)}
    return embed(profile, layout, places, {"P": centre})


def laid_out(
    profile: Profile,
    cells: list[Cell],
    outline: dict[str, float],
    inner: dict[str, tuple[float, float]],
    slits: list[tuple[str, str]],
) -> Embedding:
    """Any layout: ids of closing vertices start with C, P or Q, opening ones with O."""
    names = dict.fromkeys(v for cell in cells for v in cell)
    vertices = [Vertex(v, "opening" if v[0] == "O" else "closing", v in inner) for v in names]
    return embed(profile, make_layout(vertices, cells, slits), outline, inner)


def wing(wall: float = 0.005, slit: str = "O2", chord: float = 1.0) -> Structure:
    """The example wing."""
    p = Naca4("2412", chord)
    cells: list[Cell] = [
        ("P", "O1", "C1", "O2"),
        ("P", "O2", "CN", "O3"),
        ("P", "O3", "C2", "O4"),
        ("P", "O4", "CE", "O1"),
    ]
    places = {
        "O1": p.at_chord(0.68, "upper"),
        "C1": p.at_chord(0.39, "upper"),
        "O2": p.at_chord(0.16, "upper"),
        "CN": p.at_chord(0.0, "upper"),
        "O3": p.at_chord(0.055, "lower"),
        "C2": p.at_chord(0.40, "lower"),
        "O4": p.at_chord(0.80, "lower"),
        "CE": p.at_chord(1.0, "lower"),
    }
    return build(laid_out(p, cells, places, {"P": (0.44 * chord, 0.04 * chord)}, [("P", slit)]), wall * chord)


def one_cell() -> Structure:
    """A single cell: four curved panels, every corner between two arcs."""
    p = Superellipse(1.0, 0.6)
    places = {"C1": np.pi, "O1": 1.45 * np.pi, "C2": 0.0, "O2": 0.55 * np.pi}
    return build(laid_out(p, [("C1", "O1", "C2", "O2")], places, {}, []), 0.03)


def two_cells() -> Structure:
    """Two cells that share one edge; no inner vertex, so no slit."""
    p = Superellipse(1.0, 0.6)
    cells: list[Cell] = [("CM", "O1", "CA", "O2"), ("CM", "O2", "CB", "O3")]
    places = {
        "CM": 1.5 * np.pi,
        "O1": 1.85 * np.pi,
        "CA": 0.1,
        "O2": 0.5 * np.pi,
        "CB": np.pi - 0.1,
        "O3": 1.15 * np.pi,
    }
    return build(laid_out(p, cells, places, {}, []), 0.02)


def two_inner_vertices() -> Structure:
    """Five cells round two inner vertices; the middle cell has four straight panels."""
    p = Superellipse(1.0, 0.8)
    cells: list[Cell] = [
        ("P", "Otop", "C1", "Oleft"),
        ("P", "Oleft", "C2", "Obot"),
        ("Q", "Obot", "C3", "Oright"),
        ("Q", "Oright", "C4", "Otop"),
        ("P", "Obot", "Q", "Otop"),
    ]
    places = {
        "Otop": 0.5 * np.pi, "C1": 0.76 * np.pi, "Oleft": np.pi, "C2": 1.24 * np.pi, "Obot": 1.5 * np.pi,
        "C3": 1.76 * np.pi, "Oright": 0.0, "C4": 0.24 * np.pi,
    }  # fmt: skip
    inner = {"P": (-0.36, 0.02), "Q": (0.36, -0.02)}
    return build(laid_out(p, cells, places, inner, [("P", "Otop"), ("Q", "Obot")]), 0.01)


def peanut(resolution: int = 512) -> PointOutline:
    """A smooth outline with two hollows."""
    t = np.linspace(0.0, 2.0 * np.pi, 160, endpoint=False)
    r = 1.0 + 0.30 * np.cos(2.0 * t)
    return PointOutline(np.stack([r * np.cos(t), r * np.sin(t)], axis=1), 1.0, smooth=True, resolution=resolution)


def polygon() -> PointOutline:
    """A convex polygon with straight sides and corners everywhere."""
    t = np.linspace(0.0, 2.0 * np.pi, 9, endpoint=False)
    return PointOutline(np.stack([np.cos(t), 0.7 * np.sin(t)], axis=1), 0.2, smooth=False)


def overfull() -> Structure:
    """The five cells of `two_inner_vertices`, slits chosen so that three bonded cells open at one vertex."""
    e = two_inner_vertices().embedding
    layout = make_layout(
        e.layout.vertices,
        [tuple(e.layout.vertices[v].id for v in cell) for cell in e.layout.cells],  # type: ignore[misc]
        [("P", "Oleft"), ("Q", "Oright")],
    )
    return build(Embedding(e.profile, layout, e.s, e.z), 0.01)


CATALOGUE: dict[str, Callable[[], Structure]] = {
    "wing": wing,
    "wing thin": lambda: wing(0.003),
    "circle 3": lambda: build(ring_on(Superellipse(1.0, 1.0), 3), 0.02),
    "circle 6 without wall": lambda: build(ring_on(Superellipse(1.0, 1.0), 6), 0.0),
    "ellipse 4": lambda: build(ring_on(Superellipse(0.1, 0.06), 4), 0.001),
    "ellipse 6 without wall": lambda: build(ring_on(Superellipse(1.0, 0.6), 6), 0.0),
    "ellipse 7 off centre": lambda: build(ring_on(Superellipse(1.0, 0.6), 7, phase=1.1, centre=(0.1, -0.05)), 0.01),
    "ellipse 12": lambda: build(ring_on(Superellipse(1.0, 0.8), 12, phase=0.2), 0.004),
    "superellipse 4, m = 3.5": lambda: build(ring_on(Superellipse(1.0, 0.7, 3.5), 4, phase=0.6), 0.02),
    "superellipse 6, m = 1.5": lambda: build(ring_on(Superellipse(1.0, 0.8, 1.5), 6, phase=0.3), 0.01),
    "one cell": one_cell,
    "two cells": two_cells,
    "two inner vertices": two_inner_vertices,
    "peanut 8": lambda: build(ring_on(peanut(), 8, phase=0.0), 0.01),
    "polygon 5": lambda: build(ring_on(polygon(), 5, phase=0.25, slit="O2"), 0.002),
}


@cache
def structure(name: str) -> Structure:
    """A structure of the catalogue, built once."""
    return CATALOGUE[name]()
