"""Closed forms of flight: what they have to be, whatever the aircraft."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.aero import Fuselage, Tail, Wing
from ori_deploy.aero.flight import (
    endurance_s,
    gust_alleviation,
    gust_factor,
    ideal_efficiency,
    lift_needed,
    mass_ratio,
    power_w,
)
from ori_deploy.aero.friction import fuselage_drag, laminar, tail_drag, turbulent, wetted_area_m2
from tests.aero.crafts import UAV


def test_lift_coefficient_of_table_1_is_not_what_its_other_figures_give() -> None:
    by_hand = 0.85 * 9.80665 / (0.5 * 1.225 * 8.5**2 * 0.315)
    assert lift_needed(UAV) == pytest.approx(by_hand, rel=1e-12)
    assert lift_needed(UAV) == pytest.approx(0.598, abs=5e-4)
    assert lift_needed(UAV) < 0.65


def test_drag_of_equation_9_and_endurance_by_hand() -> None:
    polar = UAV.published.polar
    assert polar is not None
    assert float(polar.drag(0.65)) == pytest.approx(0.029 + 0.072 * 0.616**2, rel=1e-12)
    drag = float(polar.drag(0.65)) * UAV.dynamic_pressure_pa * 0.315
    watts = drag * 8.5 / 0.45 + 1.0
    assert endurance_s(drag, 8.5, UAV.power) == pytest.approx(3.33 * 0.8 * 3600.0 / watts, rel=1e-12)


@given(st.floats(0.01, 100.0), st.floats(1.001, 10.0))
def test_more_drag_flies_shorter_and_takes_more_power(drag: float, more: float) -> None:
    assert endurance_s(more * drag, 8.5, UAV.power) < endurance_s(drag, 8.5, UAV.power)
    assert power_w(more * drag, 8.5, UAV.power) > power_w(drag, 8.5, UAV.power)


@given(st.floats(1e-3, 1e3), st.floats(1.01, 10.0))
def test_a_propellers_bound_is_below_one_and_falls_with_thrust(thrust: float, more: float) -> None:
    one, other = (ideal_efficiency(t, 44.0, 0.2) for t in (thrust, more * thrust))
    assert 0.0 < other < one < 1.0


def test_pratts_factor_is_that_of_the_rules() -> None:
    """CS-23.341: K_g = 0.88 μ / (5.3 + μ), μ = 2 (W/S) / (ρ c a g), n = 1 + K_g ρ U V a / (2 W/S)."""
    slope = 4.3
    loading = UAV.weight_n / 0.315
    mu = 2.0 * loading / (1.225 * 0.25 * slope * 9.80665)
    assert mass_ratio(UAV, slope) == pytest.approx(mu, rel=1e-12)
    assert gust_alleviation(mu) == pytest.approx(0.88 * mu / (5.3 + mu), rel=1e-12)
    n = 1.0 + 0.88 * mu / (5.3 + mu) * 1.225 * 3.0 * 8.5 * slope / (2.0 * loading)
    assert gust_factor(UAV, slope) == pytest.approx(n, rel=1e-12)
    assert gust_factor(replace(UAV, gust_m_s=0.0), slope) == 1.0
    heavy = replace(UAV, mass_kg=1e6)
    assert gust_alleviation(mass_ratio(heavy, slope)) == pytest.approx(0.88, rel=1e-4)


def test_trapezoid_is_that_of_the_integrals() -> None:
    wing = Wing(2.0, 0.6, taper=0.4, sweep_rad=0.2)
    y = np.linspace(0.0, 1.0, 200_001)
    chord = wing.root_chord_m * (1.0 - 0.6 * y)
    assert 2.0 * np.trapezoid(chord, y) == pytest.approx(0.6, rel=1e-9)
    assert wing.mac_m == pytest.approx(np.trapezoid(chord**2, y) / np.trapezoid(chord, y), rel=1e-9)
    quarter = np.trapezoid(chord * y * np.tan(0.2), y) / np.trapezoid(chord, y)
    assert wing.mac_nose_m + 0.25 * wing.mac_m == pytest.approx(quarter, rel=1e-9)
    assert Tail(0.4, 0.1, 0.5).volume(Wing(1.0, 0.2)) == pytest.approx(0.04 * 0.5 / (0.2 * 0.2), rel=1e-12)


def test_friction_is_that_of_the_textbook() -> None:
    assert laminar(1e5) == pytest.approx(0.0042, abs=5e-5)
    assert turbulent(1e7) == pytest.approx(0.00300, abs=5e-5)
    # A Sears-Haack body of slenderness 10 has a surface of 0.866 π d L or so.
    assert wetted_area_m2(Fuselage(1.0, 0.1, 0.2)) == pytest.approx(0.866 * np.pi * 0.1, rel=0.01)
    assert tail_drag(replace(UAV, tail=None)) == 0.0
    assert fuselage_drag(replace(UAV, fuselage=None)) == 0.0
    assert 0.0 < tail_drag(UAV) < fuselage_drag(UAV) < 0.005
