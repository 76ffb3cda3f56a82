"""Closed forms of steady flight and of gusts. SI."""

from __future__ import annotations

import numpy as np

from ori_deploy.aero.aircraft import Aircraft, Power


def lift_needed(craft: Aircraft) -> float:
    """C_L of level flight at cruise: weight over dynamic pressure and wing area."""
    return craft.weight_n / (craft.dynamic_pressure_pa * craft.wing.area_m2)


def power_w(drag_n: float, speed_m_s: float, power: Power) -> float:
    """What the battery gives in level flight: thrust times speed over the drive's efficiency, and the avionics."""
    return drag_n * speed_m_s / power.efficiency + power.avionics_w


def endurance_s(drag_n: float, speed_m_s: float, power: Power) -> float:
    """How long the battery lasts in level flight."""
    return 3600.0 * power.battery_wh * power.usable / power_w(drag_n, speed_m_s, power)


def ideal_efficiency(thrust_n: float, dynamic_pressure_pa: float, diameter_m: float) -> float:
    """What a propeller of this size can have at most: Froude's actuator disc, 2 / (1 + sqrt(1 + T / (q A)))."""
    disc = 0.25 * np.pi * diameter_m**2
    return float(2.0 / (1.0 + np.sqrt(1.0 + thrust_n / (dynamic_pressure_pa * disc))))


def mass_ratio(craft: Aircraft, slope: float) -> float:
    """The aircraft's mass over that of the air it moves: 2 m / (ρ S c a); slope a = dC_L/dα per radian."""
    wing = craft.wing
    return 2.0 * craft.mass_kg / (craft.air.density_kg_m3 * wing.area_m2 * wing.mean_chord_m * slope)


def gust_alleviation(mu: float) -> float:
    """Pratt's factor: how much of a sharp-edged gust's load is felt by what rises with it (NACA TR 1206)."""
    return 0.88 * mu / (5.3 + mu)


def gust_factor(craft: Aircraft, slope: float) -> float:
    """Load factor in an upward gust at cruise: n = 1 + K_g ρ U V a S / (2 W), as in CS-23.341.

    Parameters
    ----------
    slope
        dC_L/dα of the aircraft, per radian.
    """
    sharp = 0.5 * craft.air.density_kg_m3 * craft.gust_m_s * craft.cruise_m_s * slope * craft.wing.area_m2
    return 1.0 + gust_alleviation(mass_ratio(craft, slope)) * sharp / craft.weight_n
