"""Sections by NeuralFoil, against thin-airfoil theory and a panel method that shares nothing with it."""

from __future__ import annotations

import numpy as np
import pytest

from ori_deploy.aero.pressure import SectionPressure, density_of, flight_loads, section_pressure
from ori_deploy.aero.section import Section, chord_m
from ori_deploy.errors import InputError
from ori_deploy.profiles import PointOutline, Superellipse, naca_section, xy
from tests.aero import panels
from tests.aero.crafts import CHORD, UAV, polar, section

FOIL = naca_section("2412", CHORD)


def pressure(lift: float) -> SectionPressure:
    return section_pressure(section(), polar(), FOIL, lift, 9.0)


def test_a_symmetric_section_has_no_lift_at_no_angle_and_is_odd() -> None:
    forces = section("0012").forces(np.radians([-4.0, 0.0, 4.0]), 2e5)
    assert forces.lift[1] == pytest.approx(0.0, abs=2e-3)
    assert forces.lift[0] == pytest.approx(-forces.lift[2], abs=2e-3)
    assert forces.drag[0] == pytest.approx(forces.drag[2], rel=0.01)


def test_zero_lift_angle_is_near_that_of_thin_airfoils() -> None:
    """NACA 24xx: -2.08 degrees; slope 2 π, less what the boundary layer takes."""
    forces = section().forces(np.radians([-2.08, 2.0, 6.0]), 3e6)
    assert forces.lift[0] == pytest.approx(0.0, abs=0.03)
    assert (forces.lift[2] - forces.lift[1]) / np.radians(4.0) == pytest.approx(2.0 * np.pi, rel=0.06)


def test_how_an_outline_is_sampled_does_not_matter_much() -> None:
    coarse = Section("coarse", FOIL.point(np.linspace(0.0, 2.0, 161)) / CHORD)
    at = np.radians([0.0, 3.0, 6.0])
    np.testing.assert_allclose(coarse.forces(at, 1.5e5).lift, section().forces(at, 1.5e5).lift, atol=0.01)
    assert section().unseen < 3e-4


def test_a_polar_ends_where_lift_stops_rising_and_refuses_more() -> None:
    table = polar().forces
    assert (np.diff(table.lift) > 0.0).all()
    assert 1.1 < polar().largest_lift < 1.5
    assert float(polar().drag(0.6)) == pytest.approx(0.0125, abs=0.001)
    assert float(section().forces(polar().alpha_rad(0.6), 1.455e5).lift[0]) == pytest.approx(0.6, abs=0.005)
    with pytest.raises(InputError, match="stalls"):
        polar().alpha_rad(2.0)


@pytest.mark.parametrize(("lift", "off"), [(0.2, 0.02), (0.6, 0.02), (0.9, 0.03), (1.15, 0.04)])
def test_pressures_add_up_to_the_lift(lift: float, off: float) -> None:
    found = pressure(lift)
    assert found.lift == pytest.approx(lift, abs=0.005)
    assert found.integrated_lift == pytest.approx(found.lift, rel=off)


def test_the_flow_divides_once_near_the_nose() -> None:
    found = pressure(0.6)
    assert found.cp.max() == pytest.approx(1.0, abs=0.05)
    assert 1.0 < found.s[found.cp.argmax()] < 1.15  # just below the nose
    assert (np.diff(found.s) > 0.0).all()


@pytest.mark.parametrize("lift", [0.3, 0.6, 0.9])
def test_pressures_are_those_of_a_panel_method_at_the_same_lift(lift: float) -> None:
    sigma = np.linspace(1.0, -1.0, 161)
    z = FOIL.point(1.0 + sigma) / CHORD
    z[-1] = z[0]
    low, high = (panels.solved(z, a)[2] for a in (0.0, 0.1))
    middle, cp, same = panels.solved(z, 0.1 * (lift - low) / (high - low))
    assert same == pytest.approx(lift, abs=0.01)
    found = pressure(lift)
    s = 1.0 + 0.5 * (sigma[1:] + sigma[:-1])
    ours = np.interp(s, found.s, found.cp)
    away = np.abs(ours - cp)[(middle.real > 0.03) & (middle.real < 0.95)]
    assert np.sqrt((away**2).mean()) < 0.06
    assert away.max() < 0.25


def test_the_panel_method_is_that_of_the_textbook() -> None:
    """Thickness raises the slope of thin airfoils by 0.77 t/c (Abbott & von Doenhoff)."""
    z = naca_section("0012", 1.0).point(np.linspace(2.0, 0.0, 161))
    z[-1] = z[0]
    assert panels.solved(z, 0.0)[2] == pytest.approx(0.0, abs=1e-6)
    assert panels.solved(z, 0.1)[2] / np.sin(0.1) == pytest.approx(2.0 * np.pi * (1.0 + 0.77 * 0.12), rel=0.01)


def test_loads_in_flight_carry_what_the_lift_says() -> None:
    found = pressure(0.6)
    loads = flight_loads(UAV, found, 2.0, density_of(0.5, 0.0024, 1.26), "c1.cb")
    assert np.linalg.norm(loads.gravity_m_s2) == pytest.approx(2.0 * 9.80665)
    assert loads.gravity_m_s2[0] == pytest.approx(2.0 * 9.80665 * np.sin(found.alpha_rad))
    assert loads.density_kg_m3 * 0.0024 * 1.26 == pytest.approx(0.5)
    s, pa = np.array(loads.air.pressure_at).T
    fine = np.linspace(0.0, 2.0, 8001)
    z = FOIL.point(fine)
    p = np.interp(0.5 * (fine[1:] + fine[:-1]), s, pa, period=2.0)
    force = 1j * (p * np.diff(z)).sum()
    lift = (np.conj(1j * np.exp(1j * found.alpha_rad)) * force).real
    assert lift / (UAV.dynamic_pressure_pa * CHORD) == pytest.approx(0.6, rel=0.02)


def test_points_of_a_file_give_the_same_pressures() -> None:
    traced = PointOutline(xy(FOIL.point(np.linspace(0.0, 2.0, 121)[:-1]) / CHORD), CHORD)
    other = section_pressure(section(), polar(), traced, 0.6, 9.0)
    assert other.integrated_lift == pytest.approx(pressure(0.6).integrated_lift, abs=0.005)


def test_what_has_no_chord_is_no_airfoil() -> None:
    with pytest.raises(InputError, match="no airfoil"):
        chord_m(Superellipse(0.1, 0.05))
