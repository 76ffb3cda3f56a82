"""Outlines of structures against their profiles."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ori_deploy.aero.fidelity import Outline, deviation, fold_with_gap, outline_at
from ori_deploy.design import Structure
from ori_deploy.errors import InputError
from ori_deploy.files import build_from_file
from ori_deploy.profiles import naca_section

EXAMPLES = Path(__file__).parents[2] / "examples"
FOIL = naca_section("2412", 0.25)


@cache
def wing(name: str = "wing_naca2412") -> Structure:
    structure = build_from_file(EXAMPLES / f"{name}.toml")[1]
    assert isinstance(structure, Structure)
    return structure


def moved(turn_rad: float, shift: complex, grown: float = 0.0) -> Outline:
    s = np.linspace(0.0, 2.0, 1501)
    outwards = -1j * FOIL.tangents(s)[1]
    return Outline(s, np.exp(1j * turn_rad) * (FOIL.point(s) + grown * outwards) + shift, 0.0)


@pytest.mark.parametrize("name", ["wing_naca2412", "wing_two_spars"])
def test_a_deployed_design_has_the_outline_it_was_cut_from(name: str) -> None:
    outline = outline_at(wing(name), 1.0)
    assert outline.gap_m < 1e-12
    off = deviation(outline, FOIL)
    assert off.largest < 1e-6 * 0.25 * 3.0
    assert off.rms <= off.largest
    area = 0.5 * (np.conj(outline.z) * np.roll(outline.z, -1)).imag.sum()
    assert area == pytest.approx(FOIL.area, rel=1e-4)


@pytest.mark.parametrize(("turn", "shift"), [(0.0, 0.003 + 0.002j), (0.05, 0.0j), (-0.03, -0.004 + 0.01j)])
def test_where_it_lies_does_not_count(turn: float, shift: complex) -> None:
    assert deviation(moved(turn, shift), FOIL).largest < 2e-6


def test_an_outline_set_off_everywhere_is_off_by_that() -> None:
    off = deviation(moved(0.02, 0.001j, 2e-4), FOIL)
    assert off.rms == pytest.approx(2e-4, rel=0.03)
    assert off.outwards.mean() > 0.0


def test_a_profile_of_another_chord_is_enlarged() -> None:
    outline = outline_at(wing(), 1.0)
    assert deviation(outline, naca_section("2412", 1.0), 0.25).largest < 1e-6
    assert deviation(outline, naca_section("2414", 0.25)).largest > 1e-3


def test_gap_sets_the_fold_and_the_further_open_the_further_off() -> None:
    seen = []
    for gap in (0.0, 1e-4, 5e-4):
        outline = outline_at(wing(), fold_with_gap(wing(), gap))
        assert outline.gap_m == pytest.approx(gap, abs=1e-9)
        seen.append(deviation(outline, FOIL).largest)
    assert seen[0] < seen[1] < seen[2]
    assert fold_with_gap(wing(), 0.0) == 1.0


@pytest.mark.parametrize("gap", [-1e-3, float("nan"), 1.0])
def test_gaps_that_there_are_not_are_refused(gap: float) -> None:
    with pytest.raises(InputError, match="slit_gap_mm"):
        fold_with_gap(wing(), gap)
