"""Two ways to the forces on a whole aircraft, alike to ask: a vortex lattice with drag added, and AeroBuildup."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from ori_deploy.aero.aircraft import Aircraft, Fuselage, Tail, Wing
from ori_deploy.aero.friction import fin_drag, fuselage_drag, tail_drag
from ori_deploy.aero.need import aerosandbox
from ori_deploy.aero.section import Section, SectionPolar
from ori_deploy.profiles.profile import Reals

STRIPS, MOUNT_STRIPS, TAIL_STRIPS, CHORDWISE = 12, 1, 6, 8
"""Of the lattice: equal strips on half a wing beyond its flat piece, on half of that, on half a tail; panels along
the chord. Strips that grow narrow towards a kink, as AeroSandbox spaces them by itself, ruin the solution there."""
_SEA_LEVEL_M2_S = 1.4607e-5
"""Kinematic viscosity of AeroSandbox's default atmosphere: speeds are scaled so that Reynolds numbers are right."""
_BODY_STATIONS = 21


@dataclass(frozen=True)
class Coefficients:
    """Of the whole aircraft, on the wing's area; the moment about the centre of gravity, on the mean chord, nose up.

    Attributes
    ----------
    tail_lift
        The part of `lift` that the horizontal tail has.
    induced, profile
        Parts of `drag`: of the trailing vortices, and of the wing's boundary layer.
    """

    lift: float
    drag: float
    moment: float
    tail_lift: float
    induced: float
    profile: float


class Method(Protocol):
    """A way to the coefficients."""

    @property
    def name(self) -> str:
        """For people."""

    def at(self, alpha_rad: float, tail_rad: float) -> Coefficients:
        """Coefficients at an angle of attack and an incidence of the tail (nose up positive)."""


def airplane(craft: Aircraft, section: Section, tail_rad: float, *, lattice: bool) -> Any:
    """The aircraft as AeroSandbox has it: cut into strips for a lattice, or else with fin and fuselage."""
    asb = aerosandbox()
    wings = [_wing(craft.wing, section, *((MOUNT_STRIPS, STRIPS) if lattice else (1, 1)))]
    bodies = []
    if craft.tail is not None:
        wings.append(_tail(craft.tail, tail_rad, TAIL_STRIPS if lattice else 1))
        if not lattice and craft.fin is not None:
            wings.append(_fin(craft))
    if not lattice and craft.fuselage is not None:
        bodies.append(_body(craft.fuselage))
    return asb.Airplane(
        name=craft.name,
        xyz_ref=[craft.cg_m, 0.0, 0.0],
        wings=wings,
        fuselages=bodies,
        s_ref=craft.wing.area_m2,
        c_ref=craft.wing.mac_m,
        b_ref=craft.wing.span_m,
    )


def _wing(wing: Wing, section: Section, mount_strips: int, strips: int) -> Any:
    asb = aerosandbox()
    half, flat = 0.5 * wing.span_m, 0.5 * wing.mount_m
    middle = np.linspace(0.0, flat, mount_strips if flat > 0.0 else 0, endpoint=False)
    stations = []
    for y in (*middle, *np.linspace(flat, half, strips + 1)):
        chord = wing.root_chord_m * (1.0 + (wing.taper - 1.0) * y / half)
        nose = y * np.tan(wing.sweep_rad) - 0.25 * chord
        height = max(y - flat, 0.0) * np.tan(wing.dihedral_rad)
        stations.append(
            asb.WingXSec(
                xyz_le=[nose, y, height],
                chord=chord,
                twist=np.degrees(wing.incidence_rad),
                airfoil=section.airfoil,
            )
        )
    return asb.Wing(name="wing", symmetric=True, xsecs=stations)


def _plate() -> Any:
    return aerosandbox().Airfoil("naca0006")


def _tail(tail: Tail, incidence_rad: float, strips: int) -> Any:
    asb = aerosandbox()
    nose = tail.arm_m - 0.25 * tail.chord_m
    return asb.Wing(
        name="tail",
        symmetric=True,
        xsecs=[
            asb.WingXSec(
                xyz_le=[nose, y, tail.height_m], chord=tail.chord_m, twist=np.degrees(incidence_rad), airfoil=_plate()
            )
            for y in np.linspace(0.0, 0.5 * tail.span_m, strips + 1)
        ],
    )


def _fin(craft: Aircraft) -> Any:
    assert craft.fin is not None
    assert craft.tail is not None
    asb = aerosandbox()
    fin, tail = craft.fin, craft.tail
    nose = tail.arm_m - 0.25 * fin.chord_m
    return asb.Wing(
        name="fin",
        symmetric=False,
        xsecs=[
            asb.WingXSec(xyz_le=[nose, 0.0, tail.height_m + z], chord=fin.chord_m, airfoil=_plate())
            for z in (0.0, fin.height_m)
        ],
    )


def _body(body: Fuselage) -> Any:
    """A body of Sears-Haack's shape: pointed at both ends."""
    asb = aerosandbox()
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, _BODY_STATIONS))
    radius = 0.5 * body.diameter_m * (4.0 * share * (1.0 - share)) ** 0.75
    return asb.Fuselage(
        name="fuselage",
        xsecs=[
            asb.FuselageXSec(xyz_c=[-body.nose_m + s * body.length_m, 0.0, 0.0], radius=r)
            for s, r in zip(share, radius, strict=True)
        ],
    )


def _flow(craft: Aircraft, alpha_rad: float) -> Any:
    asb = aerosandbox()
    scaled = craft.cruise_m_s * _SEA_LEVEL_M2_S * craft.air.density_kg_m3 / craft.air.viscosity_pa_s
    return asb.OperatingPoint(velocity=scaled, alpha=np.degrees(alpha_rad))


@dataclass(frozen=True)
class VortexLattice:
    """Lift, moment and induced drag by AeroSandbox's vortex lattice; the wing's profile drag strip by strip from its
    section's polar at the strip's lift; tail surfaces and fuselage by skin friction.

    The lattice is that of wing and tail, without thickness, fuselage or propeller, its wake straight aft.
    """

    craft: Aircraft
    section: Section

    @property
    def name(self) -> str:
        return "VLM + NeuralFoil"

    @cached_property
    def polars(self) -> dict[float, SectionPolar]:
        """The section's polar by chord: filled as strips ask for it."""
        return {}

    def at(self, alpha_rad: float, tail_rad: float) -> Coefficients:
        asb, craft = aerosandbox(), self.craft
        plane = airplane(craft, self.section, tail_rad, lattice=True)
        flow = _flow(craft, alpha_rad)
        lattice = asb.VortexLatticeMethod(plane, flow, spanwise_resolution=1, chordwise_resolution=CHORDWISE)
        found = lattice.run()
        force = np.asarray(lattice.forces_geometry).reshape(-1, CHORDWISE, 3).sum(axis=1)
        area = np.asarray(lattice.areas).reshape(-1, CHORDWISE).sum(axis=1)
        wing = len(area) if craft.tail is None else len(area) - 2 * TAIL_STRIPS
        up = np.array([-np.sin(alpha_rad), 0.0, np.cos(alpha_rad)])
        pressure = float(flow.dynamic_pressure())
        profile = self._profile_drag(force[:wing], area[:wing], lattice, up, pressure)
        rest = tail_drag(craft) + fin_drag(craft) + fuselage_drag(craft)
        induced = float(found["CD"])
        tail_lift = float((force[wing:] @ up).sum()) / (pressure * craft.wing.area_m2)
        return Coefficients(
            float(found["CL"]), induced + profile + rest, float(found["Cm"]), tail_lift, induced, profile
        )

    def _profile_drag(self, force: Reals, area: Reals, lattice: Any, up: Reals, pressure: float) -> float:
        """C_D of the wing's boundary layer, from (n, 3) forces and (n,) areas of its strips."""
        lift = force @ up
        # With dihedral a strip's lift leans sideways.
        local = np.copysign(np.hypot(lift, force[:, 1]), lift) / (pressure * area)
        first = np.arange(0, len(area) * CHORDWISE, CHORDWISE)
        nose = 0.5 * (lattice.front_left_vertices[first] + lattice.front_right_vertices[first])
        end = 0.5 * (lattice.back_left_vertices + lattice.back_right_vertices)[first + CHORDWISE - 1]
        chord = np.round(np.linalg.norm(end - nose, axis=1), 3)
        drag = np.empty_like(area)
        for c in np.unique(chord):
            drag[chord == c] = self.polar_at(float(c)).drag(local[chord == c])
        return float((drag * area).sum() / self.craft.wing.area_m2)

    def polar_at(self, chord_m: float) -> SectionPolar:
        """The section's polar at a chord, at cruise."""
        if chord_m not in self.polars:
            air = self.craft.air
            reynolds = air.reynolds(self.craft.cruise_m_s, chord_m)
            self.polars[chord_m] = SectionPolar.of(self.section, reynolds, air.n_crit)
        return self.polars[chord_m]


@dataclass(frozen=True)
class BuildUp:
    """AeroSandbox's AeroBuildup: parts added up, each by NeuralFoil and corrections for its aspect ratio.

    Every part by itself: the tail feels nothing of the downwash of the wing. Fin and fuselage are in it.
    """

    craft: Aircraft
    section: Section

    @property
    def name(self) -> str:
        return "AeroBuildup"

    def at(self, alpha_rad: float, tail_rad: float) -> Coefficients:
        asb, craft = aerosandbox(), self.craft
        plane = airplane(craft, self.section, tail_rad, lattice=False)
        flow = _flow(craft, alpha_rad)
        found = asb.AeroBuildup(plane, flow, model_size="large", include_wave_drag=False).run()
        scale = float(flow.dynamic_pressure()) * craft.wing.area_m2

        def number(value: Any) -> float:
            return float(np.ravel(value)[0])

        parts = found["wing_aero_components"]
        tail = 0.0 if craft.tail is None else number(parts[1].L) / scale
        return Coefficients(
            number(found["CL"]),
            number(found["CD"]),
            number(found["Cm"]),
            tail,
            number(found["D_induced"]) / scale,
            number(parts[0].D) / scale,
        )
