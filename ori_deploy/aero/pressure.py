"""Pressure round a section in flight, as a load on the skin along the outline's parameter.

From NeuralFoil's speeds at the edge of the boundary layer: C_p = 1 - (u_e / V)². Inside, the wing has the pressure of
the air far away, as one that is vented where C_p is 0 has. The section stands for all of the span: it has the lift
coefficient that the wing has on average.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ori_deploy.aero.aircraft import GRAVITY_M_S2, Aircraft
from ori_deploy.aero.section import EdgeSpeed, Section, SectionPolar
from ori_deploy.loads import Air, Loads
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Points, Reals

_BETWEEN = 4
"""Points of the table for every one of NeuralFoil's: pressure is curved where speed is straight."""


@dataclass(frozen=True)
class SectionPressure:
    """Pressure coefficients along a profile.

    Attributes
    ----------
    alpha_rad, lift
        Angle of attack, and C_l as NeuralFoil gives it.
    s
        (n,) parameters of the profile, increasing.
    cp
        (n,) pressure coefficients there.
    """

    profile: Profile
    alpha_rad: float
    lift: float
    s: Reals
    cp: Reals

    @property
    def integrated_lift(self) -> float:
        """C_l that the pressures add up to: what stands for the section has to carry the weight, too."""
        z, cp = self._fine()
        force = 1j * (0.5 * (cp[1:] + cp[:-1]) * np.diff(z)).sum()
        return float((np.conj(1j * np.exp(1j * self.alpha_rad)) * force).real) / self.profile_chord

    @property
    def profile_chord(self) -> float:
        """Metres."""
        return float(getattr(self.profile, "chord_m", self.profile.size))

    def _fine(self) -> tuple[Points, Reals]:
        s = np.linspace(0.0, self.profile.period, 4001)
        return self.profile.point(s), np.interp(s, self.s, self.cp, period=self.profile.period)

    def pressure_at(self, dynamic_pressure_pa: float) -> tuple[tuple[float, float], ...]:
        """(parameter, pascal) pairs, outside less inside: what `air.pressure_at` of a loads file takes."""
        return tuple(
            (round(float(s), 9), round(float(dynamic_pressure_pa * c), 4))
            for s, c in zip(self.s, self.cp, strict=True)
        )


def section_pressure(
    section: Section, polar: SectionPolar, profile: Profile, lift: float, n_crit: float
) -> SectionPressure:
    """Pressures at a lift coefficient.

    Parameters
    ----------
    section, polar
        The section that flies, and its polar.
    profile
        The one that the loads are for: its parameter is used, and its chord.

    Raises
    ------
    InputError
        The section does not have so much lift; the profile is no airfoil.
    """
    alpha = polar.alpha_rad(lift)
    edge = section.edge_speed(alpha, polar.reynolds, n_crit)
    at = np.array(
        [profile.at_chord(float(x), "upper" if up else "lower") for x, up in zip(edge.x, edge.upper, strict=True)]
    )
    s, cp = _coefficients(edge, at, profile)
    found = float(section.forces(alpha, polar.reynolds, n_crit).lift[0])
    return SectionPressure(profile, alpha, found, s, cp)


def _coefficients(edge: EdgeSpeed, at: Reals, profile: Profile) -> tuple[Reals, Reals]:
    """Parameters and C_p: speeds straight between stations, so that they pass 0 where the flow divides."""
    order = np.argsort(at)
    at, speed = at[order], edge.speed[order]
    inside = [np.linspace(a, b, _BETWEEN, endpoint=False) for a, b in pairwise(at)]
    # From the last stations to the trailing edge the pressure stays as it is: the wake begins.
    s = np.concatenate([[0.0], *inside, [at[-1], profile.period * (1.0 - 1e-9)]])
    return s, 1.0 - np.interp(s, at, speed) ** 2


def density_of(mass_kg: float, material_area_m2: float, span_m: float) -> float:
    """Density of panels that together weigh this, kg/m³."""
    return mass_kg / (material_area_m2 * span_m)


def flight_loads(
    craft: Aircraft, pressure: SectionPressure, factor: float, density_kg_m3: float | None, clamp: str | None
) -> Loads:
    """What a deployed wing bears in flight, at `factor` times its weight: pressure and inertia, in the chord's axes.

    In a gust the wing is thrown upwards with the whole aircraft, so that its own mass weighs `factor` times as much.
    """
    g = GRAVITY_M_S2 * factor
    alpha = pressure.alpha_rad
    base = Loads() if density_kg_m3 is None else Loads(density_kg_m3=density_kg_m3)
    return Loads(
        density_kg_m3=base.density_kg_m3,
        gravity_m_s2=(float(g * np.sin(alpha)), float(-g * np.cos(alpha)), 0.0),
        air=Air(pressure_at=pressure.pressure_at(craft.dynamic_pressure_pa), density_kg_m3=craft.air.density_kg_m3),
        clamp=clamp,
    )
