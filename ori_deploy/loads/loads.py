"""What a structure weighs, what resists its creases, what blows at it and what holds its slits: plain numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ori_deploy.profiles.profile import Reals


@dataclass(frozen=True)
class Film:
    """The film that hinges every crease: an elastic strip that wants to lie flat.

    Attributes
    ----------
    thickness_m, gap_m, modulus_pa
        Its thickness, its free length between the two panels, its Young's modulus. A film that has creased is softer.
    width_m
        Along the crease; None for the whole span.
    rest_open_rad, rest_close_rad
        Inner angles at which it lies flat, at opening and at closing creases.
    """

    thickness_m: float = 50e-6
    gap_m: float = 1e-3
    modulus_pa: float = 4e9
    width_m: float | None = None
    rest_open_rad: float = np.pi
    rest_close_rad: float = np.pi

    def stiffness_nm(self, span_m: float) -> float:
        """N m per radian of one crease: E w t³ / (12 L)."""
        width = span_m if self.width_m is None else self.width_m
        return self.modulus_pa * width * self.thickness_m**3 / (12.0 * self.gap_m)

    @property
    def rest_rad(self) -> Reals:
        """(4,) rest angles in the order of `CREASES`."""
        return np.array([self.rest_open_rad, self.rest_open_rad, self.rest_close_rad, self.rest_close_rad])


@dataclass(frozen=True)
class Air:
    """What the air does to the outer skin. Neither shadows panels nor changes with the shape they are in.

    Attributes
    ----------
    pressure_pa
        Outside less inside, all over the skin: pushes inwards where positive, and turns with the panels.
    pressure_at
        (parameter of the outline, pascal) more of it, linear in between: a section's distribution. Empty for none.
    wind_m_s
        Velocity of the air, in the design's coordinates; pushes at what faces it with ½ ρ c (v·n)².
    density_kg_m3, coefficient
        ρ and c of the wind.
    """

    pressure_pa: float = 0.0
    pressure_at: tuple[tuple[float, float], ...] = ()
    wind_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    density_kg_m3: float = 1.2
    coefficient: float = 1.2

    @property
    def still(self) -> bool:
        """Whether there is none."""
        return self.pressure_pa == 0.0 and not self.pressure_at and not any(self.wind_m_s)


@dataclass(frozen=True)
class Magnets:
    """The magnets along one slit, taken together, at its opening vertex.

    Attributes
    ----------
    force_n
        What it takes to pull the slit open there.
    reach_m
        Gap at which the force has fallen to a quarter.
    capture_m
        Gap beyond which they do not pull.
    seat_m
        Gap over which the force builds up: how far the closed slit gives.
    """

    force_n: float = 0.0
    reach_m: float = 2e-3
    capture_m: float = 8e-3
    seat_m: float = 2.5e-4

    def pull_n(self, gap_m: Reals) -> Reals:
        """Force that closes a gap, newton; elementwise."""
        gap = np.asarray(gap_m)
        far = self.force_n / (1.0 + np.maximum(gap - self.seat_m, 0.0) / self.reach_m) ** 2
        near = self.force_n * gap / self.seat_m
        return np.where(gap < self.seat_m, near, np.where(gap <= self.capture_m, far, 0.0))


@dataclass(frozen=True)
class Loads:
    """Everything that the servos have to overcome.

    Attributes
    ----------
    density_kg_m3
        Of the panels, infill counted: 300 is printed with 20 % infill.
    extra_kg
        More mass, at the middle of a panel: servos, magnets. By panel id.
    gravity_m_s2
        In the design's coordinates: a cylinder's section is the plane of x and y, its span is along z.
    film, air, magnets
        Hinges, wind and pressure, slits.
    friction_nm, damping_nm_s
        Of every crease: dry and viscous.
    clamp
        The panel by which the structure is held; None for the first.
    efficiency
        Of the gears between shaft and crease.
    """

    density_kg_m3: float = 300.0
    extra_kg: Mapping[str, float] = field(default_factory=dict)
    gravity_m_s2: tuple[float, float, float] = (0.0, -9.81, 0.0)
    film: Film = Film()
    air: Air = Air()
    magnets: Magnets = Magnets()
    friction_nm: float = 0.0
    damping_nm_s: float = 0.0
    clamp: str | None = None
    efficiency: float = 0.9
