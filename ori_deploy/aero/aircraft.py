"""What an aircraft is, as far as its aerodynamics go: plain numbers in SI, and what was published about it.

x points aft, y to the right, z up; the origin is the root's quarter-chord point.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ori_deploy.aero.polar import Polar

GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True)
class Air:
    """What it flies in.

    Attributes
    ----------
    density_kg_m3, viscosity_pa_s
        Density and dynamic viscosity.
    n_crit
        Amplification at which the boundary layer turns turbulent: 9 is an average wind tunnel.
    """

    density_kg_m3: float = 1.225
    viscosity_pa_s: float = 1.789e-5
    n_crit: float = 9.0

    def reynolds(self, speed_m_s: float, length_m: float) -> float:
        """Reynolds number."""
        return self.density_kg_m3 * speed_m_s * length_m / self.viscosity_pa_s


@dataclass(frozen=True)
class Wing:
    """A trapezoidal wing of two halves with dihedral, and a flat piece between them.

    Attributes
    ----------
    span_m, area_m2, taper
        Projected span, planform area, tip chord over root chord.
    mount_m
        Span of the flat piece in the middle; 0 for none.
    dihedral_rad, sweep_rad, incidence_rad
        Of each half beyond the flat piece; of the quarter-chord line; of the chord to the fuselage.
    mass_kg
        None where it is not known.
    """

    span_m: float
    area_m2: float
    taper: float = 1.0
    mount_m: float = 0.0
    dihedral_rad: float = 0.0
    sweep_rad: float = 0.0
    incidence_rad: float = 0.0
    mass_kg: float | None = None

    @property
    def aspect_ratio(self) -> float:
        return self.span_m**2 / self.area_m2

    @property
    def mean_chord_m(self) -> float:
        """Area over span."""
        return self.area_m2 / self.span_m

    @property
    def root_chord_m(self) -> float:
        return 2.0 * self.mean_chord_m / (1.0 + self.taper)

    @property
    def mac_m(self) -> float:
        """Mean aerodynamic chord of the trapezoid."""
        t = self.taper
        return 2.0 / 3.0 * self.root_chord_m * (1.0 + t + t * t) / (1.0 + t)

    @property
    def mac_nose_m(self) -> float:
        """x of the mean aerodynamic chord's leading edge."""
        y = self.span_m / 6.0 * (1.0 + 2.0 * self.taper) / (1.0 + self.taper)
        return float(y * np.tan(self.sweep_rad)) - 0.25 * self.mac_m


@dataclass(frozen=True)
class Tail:
    """A rectangular horizontal tail, all-moving; its incidence is what trims.

    Attributes
    ----------
    span_m, chord_m
        Of the plate.
    arm_m
        From the wing's quarter chord at the root to the tail's.
    height_m
        Above the wing's root.
    """

    span_m: float
    chord_m: float
    arm_m: float
    height_m: float = 0.0

    @property
    def area_m2(self) -> float:
        return self.span_m * self.chord_m

    def volume(self, wing: Wing) -> float:
        """Tail volume coefficient: area times arm over the wing's area times its mean aerodynamic chord."""
        return self.area_m2 * self.arm_m / (wing.area_m2 * wing.mac_m)


@dataclass(frozen=True)
class Fin:
    """A rectangular vertical tail; thickness is that over its chord."""

    height_m: float
    chord_m: float
    thickness: float = 0.05


@dataclass(frozen=True)
class Fuselage:
    """A body of revolution; `nose_m` is how far its nose is ahead of the origin."""

    length_m: float
    diameter_m: float
    nose_m: float


@dataclass(frozen=True)
class Power:
    """What drives it.

    Attributes
    ----------
    efficiency
        From the battery to thrust times speed.
    battery_wh, usable
        Energy of the battery, and the share of it that is flown with.
    avionics_w
        Drawn besides.
    motor, propeller_m
        For the record, and the propeller's diameter; empty and None where not known.
    """

    efficiency: float
    battery_wh: float
    usable: float = 0.8
    avionics_w: float = 0.0
    motor: str = ""
    propeller_m: float | None = None


@dataclass(frozen=True)
class Published:
    """What somebody else found; None where they do not say. Times in seconds.

    Attributes
    ----------
    source
        Where it is published.
    cruise_cl, static_margin, endurance_s
        Lift coefficient at cruise; lowest and highest static margin, in mean aerodynamic chords; time of flight.
    polar
        The drag polar.
    """

    source: str = ""
    cruise_cl: float | None = None
    static_margin: tuple[float, float] | None = None
    endurance_s: float | None = None
    polar: Polar | None = None


@dataclass(frozen=True)
class Aircraft:
    """The whole of it.

    Attributes
    ----------
    mass_kg, cg_chord
        At take-off; centre of gravity behind the mean aerodynamic chord's leading edge, in chords.
    cruise_m_s
        Speed at cruise.
    gust_m_s
        Speed of the upward gust that the wing has to bear.
    wing, tail, fin, fuselage
        Its parts; the last three None where there are none.
    assumed
        Keys of the file, such as `tail` or `mass.cg_chord`, that are somebody's guess and not published.
    """

    name: str
    mass_kg: float
    cg_chord: float
    cruise_m_s: float
    gust_m_s: float
    wing: Wing
    power: Power
    tail: Tail | None = None
    fin: Fin | None = None
    fuselage: Fuselage | None = None
    air: Air = Air()
    published: Published = Published()
    assumed: tuple[str, ...] = field(default_factory=tuple)

    @property
    def weight_n(self) -> float:
        return self.mass_kg * GRAVITY_M_S2

    @property
    def dynamic_pressure_pa(self) -> float:
        """At cruise."""
        return 0.5 * self.air.density_kg_m3 * self.cruise_m_s**2

    @property
    def cg_m(self) -> float:
        """x of the centre of gravity."""
        return self.wing.mac_nose_m + self.cg_chord * self.wing.mac_m

    @property
    def reynolds(self) -> float:
        """At cruise, with the wing's mean chord."""
        return self.air.reynolds(self.cruise_m_s, self.wing.mean_chord_m)
