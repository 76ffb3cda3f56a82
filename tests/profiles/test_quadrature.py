"""Integrals along outlines: against closed forms, also where the integrand is singular at a break."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe

from ori_deploy.errors import ProfileError
from ori_deploy.profiles import Heart, Superellipse
from ori_deploy.profiles.quadrature import integrate

SQUIRCLE = Superellipse(1.0, 0.6, 4.0)  # breaks at every quarter


@settings(max_examples=60)
@given(power=st.floats(-0.55, 6.0))
def test_powers_of_the_distance_from_a_break_are_integrated(power: float) -> None:
    quarter = 0.5 * np.pi
    found = integrate(SQUIRCLE, lambda s: (s % quarter) ** power).total
    # Beyond the first break rounding of s leaves no more digits than this of the distance from it.
    goal = max(2e-10, 20.0 * 1e-15 ** (1.0 + min(power, 0.0)))
    assert found == pytest.approx(4 * quarter ** (power + 1) / (power + 1), rel=goal)


@settings(max_examples=30)
@given(width=st.floats(1e-4, 1.0), place=st.floats(0.1, 6.0))
def test_a_narrow_peak_is_found_and_resolved(width: float, place: float) -> None:
    found = integrate(Superellipse(1.0, 1.0), lambda s: width / (width**2 + (s - place) ** 2)).total
    assert found == pytest.approx(np.arctan((2 * np.pi - place) / width) + np.arctan(place / width), rel=1e-9)


def test_length_and_area_of_outlines() -> None:
    ellipse = Superellipse(1.0, 0.3)
    length = integrate(ellipse, lambda s: np.abs(ellipse.evaluate(s, 1)[1])).total
    assert length == pytest.approx(4 * ellipe(1 - 0.09), rel=1e-12)
    heart = Heart(0.2)
    swept = integrate(heart, lambda s: heart.evaluate(s, 1)[1] * np.conj(heart.point(s)) / 2j).total
    assert swept == pytest.approx(heart.area, rel=1e-11)  # real: the outline is closed


@settings(max_examples=30)
@given(share=st.floats(0.0, 1.0))
def test_parameters_undo_the_integral(share: float) -> None:
    integral = integrate(SQUIRCLE, lambda s: 1.0 + np.cos(s) ** 2)
    s = float(integral.parameters(np.array([share * integral.total.real]))[0])
    assert 1.5 * s + 0.25 * np.sin(2 * s) == pytest.approx(share * 3 * np.pi, abs=1e-9)


def test_an_integral_that_has_no_value_is_refused() -> None:
    with pytest.raises(ProfileError, match="does not settle"), np.errstate(divide="ignore"):
        integrate(SQUIRCLE, lambda s: 1.0 / np.abs(s - 1.0) ** 1.5)
