"""Whole aircraft by the lattice and by AeroBuildup, against what has to be so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ori_deploy.aero import Tail, Wing
from ori_deploy.aero.assessment import assessed
from ori_deploy.aero.flight import lift_needed
from ori_deploy.aero.methods import BuildUp, VortexLattice
from ori_deploy.aero.trim import stability, trimmed
from ori_deploy.errors import InputError
from tests.aero.crafts import UAV, section

PLAIN = replace(UAV, wing=Wing(1.26, 0.315), tail=None, fin=None, fuselage=None)
STEP = np.radians(2.0)


def slope(lattice: VortexLattice) -> float:
    return (lattice.at(STEP, 0.0).lift - lattice.at(-STEP, 0.0).lift) / (2.0 * STEP)


def test_a_symmetric_wing_has_its_sections_drag_and_nothing_else_at_no_angle() -> None:
    found = VortexLattice(PLAIN, section("0012")).at(0.0, 0.0)
    assert found.lift == pytest.approx(0.0, abs=1e-3)
    assert found.induced == pytest.approx(0.0, abs=1e-5)
    assert found.drag == pytest.approx(found.profile + found.induced, rel=1e-12)
    own = float(section("0012").forces(0.0, PLAIN.reynolds).drag[0])
    assert found.profile == pytest.approx(own, rel=0.02)


def test_a_wing_that_cannot_carry_its_weight_is_refused_at_once() -> None:
    with pytest.raises(InputError, match=r"stalls.*fly faster"):
        assessed(replace(UAV, mass_kg=3.0), section())


@pytest.mark.slow
@pytest.mark.parametrize("aspect", [4.0, 5.04, 10.0])
def test_the_lattices_slope_is_near_helmbolds(aspect: float) -> None:
    """a = 2 π A / (2 + sqrt(A² + 4)): lifting-surface theory is some per cent below it for rectangles."""
    wing = Wing(0.25 * aspect, 0.0625 * aspect)
    found = slope(VortexLattice(replace(PLAIN, wing=wing), section("0012")))
    helmbold = 2.0 * np.pi * aspect / (2.0 + np.sqrt(aspect**2 + 4.0))
    assert 0.93 * helmbold < found < 1.01 * helmbold


@pytest.mark.slow
def test_induced_drag_is_near_that_of_an_elliptic_wing_and_goes_with_lift_squared() -> None:
    lattice = VortexLattice(PLAIN, section("0012"))
    one, two = lattice.at(STEP, 0.0), lattice.at(2.0 * STEP, 0.0)
    assert two.induced / one.induced == pytest.approx((two.lift / one.lift) ** 2, rel=0.02)
    elliptic = two.lift**2 / (np.pi * PLAIN.wing.aspect_ratio)
    assert two.induced == pytest.approx(elliptic, rel=0.08)


@pytest.mark.slow
def test_a_wing_alone_has_its_neutral_point_at_a_quarter_and_flies_untrimmed() -> None:
    lattice = VortexLattice(PLAIN, section())
    trim = trimmed(PLAIN, lattice, 0.5)
    assert trim.found.lift == pytest.approx(0.5, abs=1e-4)
    assert trim.tail_rad == 0.0
    assert stability(PLAIN, lattice, trim).neutral_chord == pytest.approx(0.25, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("way", [VortexLattice, BuildUp])
def test_the_neutral_point_goes_aft_with_tail_volume(way: type[VortexLattice] | type[BuildUp]) -> None:
    seen = []
    for arm in (0.4, 0.7):
        craft = replace(UAV, tail=Tail(0.36, 0.13, arm))
        method = way(craft, section())
        trim = trimmed(craft, method, lift_needed(craft))
        assert trim.found.lift == pytest.approx(lift_needed(craft), abs=1e-4)
        assert trim.found.moment == pytest.approx(0.0, abs=1e-4)
        stable = stability(craft, method, trim)
        assert stable.margin == pytest.approx(stable.neutral_chord - craft.cg_chord, abs=1e-12)
        assert craft.tail is not None
        seen.append((craft.tail.volume(craft.wing), stable.neutral_chord))
    volume, neutral = np.array(seen).T
    gain = np.diff(neutral) / np.diff(volume)
    # The tail's slope is below the wing's, and downwash takes about half of it.
    assert ((gain > 0.2) & (gain < 1.1)).all()


@pytest.mark.slow
def test_where_the_centre_of_gravity_is_moves_the_margin_and_not_the_neutral_point() -> None:
    found = []
    for cg in (0.25, 0.35):
        craft = replace(UAV, cg_chord=cg)
        method = VortexLattice(craft, section())
        found.append(stability(craft, method, trimmed(craft, method, 0.6)))
    assert found[0].neutral_chord == pytest.approx(found[1].neutral_chord, abs=0.01)
    assert found[0].margin - found[1].margin == pytest.approx(0.1, abs=0.01)


@pytest.mark.slow
def test_a_tapered_swept_wing_is_no_other_kind_of_wing() -> None:
    """Unloaded tips, smaller Reynolds numbers there: some per cent, no more."""
    other = replace(PLAIN, wing=Wing(1.26, 0.315, taper=0.5, sweep_rad=np.radians(10.0)))
    plain, tapered = (VortexLattice(craft, section()).at(np.radians(6.0), 0.0) for craft in (PLAIN, other))
    assert tapered.lift == pytest.approx(plain.lift, rel=0.06)
    assert tapered.profile == pytest.approx(plain.profile, rel=0.1)
    assert tapered.induced / tapered.lift**2 == pytest.approx(plain.induced / plain.lift**2, rel=0.08)


@pytest.mark.slow
def test_a_gust_that_stalls_loads_no_more_than_the_section_bears() -> None:
    found = assessed(replace(UAV, tail=None, fin=None, gust_m_s=15.24), section())
    assert found.gust.stalls
    assert found.gust.lift == found.section_polar.largest_lift
    assert found.gust.carried < found.gust.factor
