"""What the search tests share."""

from __future__ import annotations

import numpy as np

from ori_deploy.design import Embedding
from ori_deploy.layout import Layout, make_layout, ring
from ori_deploy.profiles import Naca4, Profile, Superellipse

ELLIPSE = Superellipse(1.0, 0.6)
CIRCLE = Superellipse(1.0, 1.0)
WING = Naca4("2412", 1.0)


def ring_layout(n: int) -> Layout:
    """Cells round one inner vertex, slit at the first opening vertex."""
    vertices, cells = ring(n)
    return make_layout(vertices, cells, [("P", "O1")])


def index(layout: Layout, name: str) -> int:
    """A vertex's number."""
    return next(i for i, v in enumerate(layout.vertices) if v.id == name)


def at(place: Embedding, name: str) -> complex:
    """Where a vertex is."""
    return complex(place.z[index(place.layout, name)])


def mirrored_ring(place: Embedding) -> Embedding:
    """A ring on a profile that is its own mirror image about the x axis, s -> -s, seen in that mirror."""
    n = place.layout.n_cells
    image = ["P", *(f"O{(1 - i) % n + 1}" for i in range(n)), *(f"C{-i % n + 1}" for i in range(n))]
    of = [index(place.layout, name) for name in image]
    order = [v.id for v in place.layout.vertices]
    names = ["P", *(f"O{i + 1}" for i in range(n)), *(f"C{i + 1}" for i in range(n))]
    assert order == names
    return Embedding(place.profile, place.layout, -place.s[of] % place.profile.period, np.conj(place.z[of]))


def scaled(profile: Profile, factor: float) -> Profile:
    """The same shape, larger."""
    if isinstance(profile, Superellipse):
        return Superellipse(profile.a_m * factor, profile.b_m * factor, profile.exponent)
    assert isinstance(profile, Naca4)
    return Naca4(profile.code, profile.chord_m * factor)
