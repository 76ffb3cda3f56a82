"""Drag of what does not lift: skin friction with form factors, as drag coefficients on the wing's area.

Plates: Blasius, laminar, for the small tail surfaces. Body: the Prandtl-Schlichting line, turbulent from its nose on,
behind the propeller; form factor by Raymer (Aircraft Design, sec. 12.5), wetted area by Torenbeek (Synthesis of
Subsonic Airplane Design, app. B). Thickness of plates: Hoerner (Fluid-Dynamic Drag, ch. 6).
"""

from __future__ import annotations

import numpy as np

from ori_deploy.aero.aircraft import Aircraft, Fuselage


def laminar(reynolds: float) -> float:
    """Friction coefficient of one side of a plate: 1.328 / sqrt(Re)."""
    return float(1.328 / np.sqrt(reynolds))


def turbulent(reynolds: float) -> float:
    """Friction coefficient of one side of a plate: 0.455 / (log10 Re)^2.58."""
    return float(0.455 / np.log10(reynolds) ** 2.58)


def wetted_area_m2(body: Fuselage) -> float:
    """Surface of a streamlined body of revolution, for slenderness above 4.5 or so."""
    slender = body.length_m / body.diameter_m
    return float(
        np.pi * body.diameter_m * body.length_m * (1.0 - 2.0 / slender) ** (2.0 / 3.0) * (1.0 + 1.0 / slender**2)
    )


def tail_drag(craft: Aircraft) -> float:
    """Of the horizontal tail as a flat plate without lift."""
    if craft.tail is None:
        return 0.0
    friction = laminar(craft.air.reynolds(craft.cruise_m_s, craft.tail.chord_m))
    return 2.0 * friction * craft.tail.area_m2 / craft.wing.area_m2


def fin_drag(craft: Aircraft) -> float:
    """Of the vertical tail."""
    fin = craft.fin
    if fin is None:
        return 0.0
    form = 1.0 + 2.0 * fin.thickness + 60.0 * fin.thickness**4
    friction = laminar(craft.air.reynolds(craft.cruise_m_s, fin.chord_m))
    return 2.0 * friction * form * fin.height_m * fin.chord_m / craft.wing.area_m2


def fuselage_drag(craft: Aircraft) -> float:
    """Of the fuselage."""
    body = craft.fuselage
    if body is None:
        return 0.0
    slender = body.length_m / body.diameter_m
    form = 1.0 + 60.0 / slender**3 + slender / 400.0
    friction = turbulent(craft.air.reynolds(craft.cruise_m_s, body.length_m))
    return friction * form * wetted_area_m2(body) / craft.wing.area_m2
