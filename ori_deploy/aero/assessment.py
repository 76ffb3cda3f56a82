"""Everything that is computed about an aircraft, once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ori_deploy.aero.aircraft import Aircraft
from ori_deploy.aero.fidelity import Deviation, deviation, fold_with_gap, outline_at
from ori_deploy.aero.flight import gust_factor, lift_needed
from ori_deploy.aero.methods import BuildUp, Method, VortexLattice
from ori_deploy.aero.section import Forces, Section, SectionPolar, chord_m
from ori_deploy.aero.trim import Stability, Sweep, Trim, stability, sweep, trimmed
from ori_deploy.design import Structure
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Points

POLAR_RANGE = (0.3, 1.4)
"""Of C_L at cruise: between these a polar is fitted."""
_NEAR_STALL = 0.9
"""Of the section's largest lift, beyond which no polar is a parabola."""


@dataclass(frozen=True)
class ByMethod:
    """What one method finds."""

    name: str
    trim: Trim
    stability: Stability
    sweep: Sweep


@dataclass(frozen=True)
class Gust:
    """The wing in the gust.

    Attributes
    ----------
    factor
        Load factor by the formula.
    lift
        The wing's C_L at it, as the pressures are taken for: no more than its section's largest.
    carried
        The load factor at that C_L.
    stalls
        Whether the section has not so much lift as the formula asks for.
    """

    factor: float
    lift: float
    carried: float
    stalls: bool


@dataclass(frozen=True)
class Assessment:
    """All of it but the section's fidelity.

    Attributes
    ----------
    lift_needed
        C_L of level flight at cruise.
    lattice, build_up
        By the two methods.
    section, section_polar
        The section that is wanted, and its polar at the wing's mean chord.
    wing_lift
        The wing's own C_L at cruise, by the lattice: what its section is looked at with.
    """

    craft: Aircraft
    lift_needed: float
    lattice: ByMethod
    build_up: ByMethod
    section: Section
    section_polar: SectionPolar
    wing_lift: float
    gust: Gust


@dataclass(frozen=True)
class Standing:
    """The built section in one state.

    Attributes
    ----------
    state
        For people.
    fold, gap_m
        Of all cells, and by how much the skin is open.
    deviation
        From the section that is wanted.
    forces
        At the angle of attack at which that one has the wing's lift at cruise.
    unseen
        What of its outline NeuralFoil does not see, in chords.
    """

    state: str
    fold: float
    gap_m: float
    deviation: Deviation
    forces: Forces
    unseen: float


@dataclass(frozen=True)
class Fidelity:
    """The built section beside the one that is wanted, at one angle of attack."""

    chord_m: float
    alpha_rad: float
    reynolds: float
    wanted: Forces
    standings: tuple[Standing, ...]


def assessed(craft: Aircraft, section: Section) -> Assessment:
    """Trim, stability and polar by both methods, and the gust.

    Raises
    ------
    InputError
        It cannot be trimmed, or the section stalls at cruise; a package is missing.
    """
    needed = lift_needed(craft)
    lattice = VortexLattice(craft, section)
    polar = SectionPolar.of(section, craft.reynolds, craft.air.n_crit)
    polar.alpha_rad(needed)  # refuses a wing that cannot carry its weight, before anything takes time
    found = [_by(craft, method, needed, polar.largest_lift) for method in (lattice, BuildUp(craft, section))]
    wing_lift = found[0].trim.found.lift - found[0].trim.found.tail_lift
    factor = gust_factor(craft, found[0].stability.slope)
    asked = wing_lift + (factor - 1.0) * needed
    reached = min(asked, polar.largest_lift)
    carried = 1.0 + (reached - wing_lift) / needed
    return Assessment(
        craft, needed, found[0], found[1], section, polar, wing_lift,
        Gust(factor, reached, carried, asked > polar.largest_lift),
    )  # fmt: skip


def _by(craft: Aircraft, method: Method, needed: float, largest: float) -> ByMethod:
    trim = trimmed(craft, method, needed)
    stable = stability(craft, method, trim)
    low, high = (share * needed for share in POLAR_RANGE)
    return ByMethod(
        method.name, trim, stable, sweep(method, trim, stable.slope, (low, min(high, _NEAR_STALL * largest)))
    )


def fidelity(found: Assessment, wanted: Profile, structure: Structure, slit_gap_m: float) -> Fidelity:
    """The built section as designed, and as it stands while its slits do not quite close.

    Parameters
    ----------
    wanted
        The profile of `found.section`.
    slit_gap_m
        How far the skin is open then.
    """
    air, reynolds = found.craft.air, found.craft.reynolds
    alpha = found.section_polar.alpha_rad(found.wing_lift)
    chord = chord_m(structure.profile)
    folds = {"as designed": 1.0}
    if slit_gap_m > 0.0:
        folds[f"open {1e3 * slit_gap_m:.3g} mm"] = fold_with_gap(structure, slit_gap_m)
    standings = []
    for state, fold in folds.items():
        outline = outline_at(structure, fold)
        off = deviation(outline, wanted, chord / chord_m(wanted))
        built = Section(state, _closed(off.aligned) / chord)
        forces = built.forces(alpha, reynolds, air.n_crit)
        standings.append(Standing(state, fold, outline.gap_m, off, forces, built.unseen))
    return Fidelity(chord, alpha, reynolds, found.section.forces(alpha, reynolds, air.n_crit), tuple(standings))


def _closed(z: Points) -> Points:
    """Without repeated points, and ending where it began."""
    ring = np.append(z, z[0])
    return np.asarray(ring[np.append(True, np.abs(np.diff(ring)) > 0.0)])
