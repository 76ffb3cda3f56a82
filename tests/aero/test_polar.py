"""Fits of drag polars."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.aero import Polar
from ori_deploy.aero.polar import fitted
from ori_deploy.errors import InputError


@given(st.floats(0.005, 0.1), st.floats(0.02, 0.3), st.floats(-0.3, 0.3))
def test_a_fit_recovers_the_parabola_it_is_given(cd0: float, k: float, cl0: float) -> None:
    lift = np.linspace(-0.2, 1.0, 9)
    found, misfit = fitted(lift, Polar(cd0, k, cl0).drag(lift))
    assert (found.cd0, found.k, found.cl0) == pytest.approx((cd0, k, cl0), abs=1e-9)
    assert misfit < 1e-12


def test_equation_9_has_the_span_efficiency_and_best_glide_of_its_numbers() -> None:
    polar = Polar(0.029, 0.072, 0.034)
    assert polar.oswald(1.26**2 / 0.315) == pytest.approx(1.0 / (np.pi * 5.04 * 0.072), rel=1e-12)
    lift = np.linspace(0.1, 1.5, 100_001)
    assert polar.best_lift == pytest.approx(lift[(lift / polar.drag(lift)).argmax()], abs=1e-4)


@pytest.mark.parametrize(
    ("lift", "drag", "said"),
    [([0.1, 0.2, 0.2], [0.1, 0.2, 0.2], "too few"), ([0.0, 0.5, 1.0], [0.1, 0.2, 0.1], "does not grow")],
)
def test_what_is_no_polar_is_refused(lift: list[float], drag: list[float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        fitted(lift, drag)
