"""Aircraft that the tests share."""

from __future__ import annotations

from functools import cache

import numpy as np

from ori_deploy.aero import Aircraft, Fin, Fuselage, Polar, Power, Published, Tail, Wing
from ori_deploy.aero.section import Section, SectionPolar
from ori_deploy.profiles import naca_section

CHORD = 0.25
WING = Wing(1.26, 0.315, mount_m=0.06, dihedral_rad=np.radians(10.0), mass_kg=0.5)
UAV = Aircraft(
    "uav", 0.85, 0.30, 8.5, 3.0, WING, Power(0.45, 3.33, 0.8, 1.0, "", 0.2032), Tail(0.36, 0.13, 0.5),
    Fin(0.16, 0.14), Fuselage(0.8, 0.06, 0.15),
    published=Published("a paper", 0.65, (0.08, 0.10), 540.0, Polar(0.029, 0.072, 0.034)),
    assumed=("tail", "mass.cg_chord", "air"),
)  # fmt: skip


@cache
def section(code: str = "2412") -> Section:
    return Section.of_profile(naca_section(code, CHORD), f"NACA {code}")


@cache
def polar(reynolds: float = 1.455e5) -> SectionPolar:
    return SectionPolar.of(section(), reynolds, 9.0)
