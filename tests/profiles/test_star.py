"""From where all of an outline is seen: against drawing every line of sight."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Polygon

from ori_deploy.profiles import Naca4, PointOutline, Profile, Superellipse, xy
from ori_deploy.profiles.star import star_centre
from tests.shapes import peanut


def sees_all(profile: Profile, place: complex) -> bool:
    outline = Polygon(xy(profile.table_f)).buffer(1e-6 * profile.size)
    return all(outline.covers(LineString([(place.real, place.imag), (z.real, z.imag)])) for z in profile.table_f[::4])


@pytest.mark.parametrize(
    "profile", [Superellipse(1.0, 0.3), Superellipse(1e-3, 1e-3, 3.0), Naca4("4415", 2.0), peanut()]
)
def test_what_is_star_shaped(profile: Profile) -> None:
    centre = star_centre(profile)
    assert centre is not None
    assert sees_all(profile, centre)


@settings(max_examples=12)
@given(st.lists(st.floats(0.5, 1.5), min_size=8, max_size=8), st.floats(0.0, 6.0))
def test_drawn_outlines(radius: list[float], turn: float) -> None:
    """Any outline given by a radius over the angle is star-shaped, and what is found sees all of it."""
    t = turn + np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    profile = PointOutline(np.stack([radius * np.cos(t), radius * np.sin(t)], axis=1), 1.0, smooth=False)
    centre = star_centre(profile)
    assert centre is not None
    assert sees_all(profile, centre)


def test_a_crescent_is_not() -> None:
    t = np.linspace(0.0, 1.5 * np.pi, 40)
    outer, inner = np.stack([np.cos(t), np.sin(t)], axis=1), 0.6 * np.stack([np.cos(t), np.sin(t)], axis=1)
    profile = PointOutline(np.concatenate([outer, inner[::-1]]), 1.0, smooth=False)
    assert star_centre(profile) is None
    assert not any(sees_all(profile, z) for z in 0.8 * np.exp(1j * t[1:-1:6]))
