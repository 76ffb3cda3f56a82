"""NACA 5-digit sections against the published ordinates and thin-airfoil theory."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ori_deploy.errors import ProfileError
from ori_deploy.profiles import Naca4, Naca5, from_description
from ori_deploy.profiles.naca import naca_section

STATIONS = [1.25, 2.5, 5, 7.5, 10, 15, 20, 25, 30, 40, 50, 60, 70, 80, 90, 95]
UPPER_23012 = [2.67, 3.61, 4.91, 5.80, 6.43, 7.19, 7.50, 7.60, 7.55, 7.14, 6.41, 5.47, 4.36, 3.08, 1.68, 0.92]
LOWER_23012 = [1.23, 1.71, 2.26, 2.61, 2.92, 3.50, 3.97, 4.28, 4.46, 4.48, 4.17, 3.67, 3.00, 2.16, 1.23, 0.70]
"""Abbott & von Doenhoff, Theory of Wing Sections, appendix III; per cent of the chord."""

STANDARD = ["210", "220", "230", "240", "250"]
REFLEX = ["221", "231", "241", "251"]


@pytest.mark.parametrize(("side", "sign", "table"), [("upper", 1, UPPER_23012), ("lower", -1, LOWER_23012)])
def test_23012_has_its_published_ordinates(side: str, sign: int, table: list[float]) -> None:
    p = Naca5("23012", 1.0)
    found = [100 * sign * p.point(p.at_chord(x / 100, side)).imag for x in STATIONS]  # type: ignore[arg-type]
    # The published trailing edge is 0.126 % thick on either side, this one closed.
    open_edge = 5 * 12 * (0.1036 - 0.1015) * (np.array(STATIONS) / 100) ** 4
    assert np.allclose(found + open_edge, table, atol=0.035)  # computed by hand in their day


def slope(p: Naca5, angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slope of the camber line where x = (1 - cos(angle)) / 2, by differences of its height."""
    x, h = 0.5 * (1.0 - np.cos(angle)), 1e-6
    return np.asarray((p._camber_line(x + h)[0] - p._camber_line(x - h)[0]) / (2 * h))


def fourier(p: Naca5, n: int) -> float:
    """Coefficient A_n of thin-airfoil theory."""
    angle = (np.arange(20_000) + 0.5) * np.pi / 20_000
    return float(2.0 * (slope(p, angle) * np.cos(n * angle)).mean())


@pytest.mark.parametrize("digits", STANDARD + REFLEX)
def test_ideal_lift_is_the_designs(digits: str) -> None:
    assert np.pi * fourier(Naca5(digits + "12", 1.0), 1) == pytest.approx(0.3, abs=0.02)
    first, sixth = (fourier(Naca5(f"{n}{digits[1:]}12", 1.0), 1) for n in (1, 6))
    assert sixth == pytest.approx(6 * first, rel=1e-9)


@pytest.mark.parametrize("digits", REFLEX)
def test_reflex_camber_has_no_moment_about_the_quarter_chord(digits: str) -> None:
    p, plain = Naca5(digits + "12", 1.0), Naca5(digits[:2] + "012", 1.0)
    moment, without = (0.25 * np.pi * (fourier(q, 2) - fourier(q, 1)) for q in (p, plain))
    assert without < -0.008
    assert abs(moment) < 0.17 * abs(without)


@pytest.mark.parametrize("digits", STANDARD + REFLEX)
def test_camber_is_largest_where_the_code_says_and_ends_on_the_chord(digits: str) -> None:
    p = Naca5(digits + "12", 1.0)
    x = np.linspace(0.0, 1.0, 20_001)
    height, along = p._camber_line(x)
    assert x[height.argmax()] == pytest.approx(int(digits[1]) / 20, abs=0.004)
    assert height[[0, -1]] == pytest.approx(0.0, abs=1e-15)
    assert np.allclose(np.gradient(height, x)[1:-1], along[1:-1], atol=2e-3)


def test_the_number_of_digits_chooses_the_family_also_from_a_description() -> None:
    assert isinstance(naca_section("2412", 1.0), Naca4)
    assert isinstance(naca_section("23012", 1.0), Naca5)
    p = Naca5("23112", 0.3)
    again = from_description(p.describe())
    assert isinstance(again, Naca5)
    s = np.linspace(0.0, 2.0, 33)
    assert (again.point(s) == p.point(s)).all()


@pytest.mark.parametrize(
    "code", ["26012", "20012", "21112", "23212", "23000", "03012", "230", "230123", "2301x", "24 12", "", "²3012"]
)
def test_codes_that_are_none_are_refused(code: str) -> None:
    with pytest.raises(ProfileError, match="code"):
        naca_section(code, 1.0)


@pytest.mark.parametrize("chord", [0.0, -1.0, float("nan")])
def test_a_chord_must_be_a_length(chord: float) -> None:
    with pytest.raises(ProfileError, match="chord_m"):
        Naca5("23012", chord)
