"""Where searches begin: in order round the outline, the corners taken, the same for the same seed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.layout import layout_of, layouts
from ori_deploy.profiles import Profile
from ori_deploy.search.starts import start_embedding, with_inner_vertices
from tests.search.cases import CIRCLE, ELLIPSE, WING, ring_layout
from tests.shapes import peanut

PROFILES = {"ellipse": ELLIPSE, "wing": WING, "peanut": peanut()}
TREES = [tree for k in (3, 4, 5) for tree in layouts(k)]


@settings(max_examples=30)
@given(st.sampled_from(sorted(PROFILES)), st.sampled_from(TREES), st.integers(0, 6), st.integers(0, 99))
def test_outline_vertices_are_in_the_order_the_cells_say(name: str, tree: object, start: int, seed: int) -> None:
    profile, layout = PROFILES[name], layout_of(tree)  # type: ignore[arg-type]
    place = start_embedding(profile, layout, start, seed)
    loop = np.array(layout.outline)
    ahead = np.diff(place.s[loop], append=place.s[loop[0]]) % profile.period
    assert ahead.sum() == pytest.approx(profile.period)
    assert ahead.min() > 1e-4 * profile.period
    assert np.abs(place.z[loop] - profile.point(place.s[loop])).max() < 1e-12 * profile.size
    again = start_embedding(profile, layout, start, seed)
    assert np.array_equal(place.z, again.z)


@pytest.mark.parametrize("start", range(6))
def test_a_closing_vertex_stands_in_the_trailing_edge(start: int) -> None:
    for n in (3, 4, 7):
        place = start_embedding(WING, ring_layout(n), start, 3)
        (there,) = np.flatnonzero(np.abs(place.z - WING.point(0.0)) < 1e-12)
        assert place.layout.vertices[there].role == "closing"


def test_even_starts_on_a_circle_are_equal_angles() -> None:
    for start in (0, 1):
        place = start_embedding(CIRCLE, ring_layout(5), start)
        assert np.abs(place.z[0]) < 1e-12
        turned = np.sort(np.angle(place.z[1:]) % (2.0 * np.pi))
        assert np.diff(turned) == pytest.approx(np.full(9, 2.0 * np.pi / 10.0))
    first, second = (start_embedding(CIRCLE, ring_layout(5), k).s[1] for k in (0, 1))
    assert second - first == pytest.approx(2.0 * np.pi / 20.0)


def test_drawn_starts_differ() -> None:
    places = [start_embedding(ELLIPSE, ring_layout(4), k, seed).z for k in (2, 3, 4) for seed in (0, 1)]
    assert min(np.abs(a - b).max() for i, a in enumerate(places) for b in places[:i]) > 1e-3


@pytest.mark.parametrize("tree", [t for t in TREES if t.n_inner], ids=lambda t: t.code)
def test_inner_vertices_are_the_means_of_their_neighbours(tree: object) -> None:
    layout = layout_of(tree)  # type: ignore[arg-type]
    place = with_inner_vertices(ELLIPSE, layout, start_embedding(ELLIPSE, layout, 2, 1).s)
    for i, v in enumerate(layout.vertices):
        if v.inner:
            neighbours = {cell[(cell.index(i) + step) % 4] for cell in layout.cells if i in cell for step in (1, 3)}
            assert place.z[i] == pytest.approx(complex(np.mean(place.z[sorted(neighbours)])))


def test_profiles_are_what_the_test_thinks() -> None:
    assert all(isinstance(p, Profile) for p in PROFILES.values())
