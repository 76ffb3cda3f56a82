"""Profiles answer exactly: closed forms where there are any, dense brute force where there are none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe, gamma

from ori_deploy.errors import ProfileError
from ori_deploy.profiles import (
    Clover,
    Heart,
    Naca4,
    Naca5,
    PointOutline,
    Profile,
    Superellipse,
    from_description,
    parse_dat,
    xy,
)
from tests.shapes import peanut, polygon

FAMILIES: dict[str, Profile] = {
    "circle": Superellipse(1.0, 1.0),
    "ellipse": Superellipse(0.3, 0.1),
    "superellipse m=4": Superellipse(1.0, 0.6, 4.0),
    "superellipse m=8": Superellipse(1.0, 0.6, 8.0),
    "superellipse m=1.3": Superellipse(1.0, 0.6, 1.3),
    "astroid m=0.7": Superellipse(1.0, 0.8, 0.7),
    "naca 2412": Naca4("2412", 0.25),
    "naca 0012": Naca4("0012", 1.0),
    "naca 6409": Naca4("6409", 2.0),
    "naca 23012": Naca5("23012", 0.5),
    "naca 24115": Naca5("24115", 1.0),
    "clover": Clover(0.1, 0.4),
    "clover of seven": Clover(2.0, 0.15, 7),
    "heart": Heart(0.2),
    "peanut": peanut(),
    "polygon": polygon(),
}
families = pytest.mark.parametrize("profile", FAMILIES.values(), ids=FAMILIES.keys())


def away_from_breaks(profile: Profile, n: int = 400) -> np.ndarray:
    s = np.linspace(0.0, profile.period, n, endpoint=False) + 0.37 * profile.period / n
    gap = np.abs(s[:, None] - np.append(profile.breaks, profile.period)[None]).min(axis=1)
    return s[gap > 0.1 * profile.period / n]


@families
def test_derivatives_are_those_of_the_curve(profile: Profile) -> None:
    s, h = away_from_breaks(profile), 1e-6 * profile.period
    f, df, ddf = profile.evaluate(s, 2)
    low, high = profile.evaluate(s - h, 1), profile.evaluate(s + h, 1)
    speed = profile.size / profile.period
    assert np.allclose((high[0] - low[0]) / (2 * h), df, atol=1e-6 * speed, rtol=1e-6)
    assert np.allclose((high[1] - low[1]) / (2 * h), ddf, atol=1e-4 * speed / profile.period, rtol=2e-3)
    assert np.allclose(f, profile.point(s), atol=1e-15 * profile.size, rtol=0.0)


@families
def test_period_closes_and_wraps(profile: Profile) -> None:
    s = np.linspace(0.0, profile.period, 50)
    assert np.allclose(profile.point(s + profile.period), profile.point(s), atol=1e-12 * profile.size)
    assert abs(profile.point(0.0) - profile.point(profile.period * (1 - 1e-15))) < 1e-7 * profile.size


@families
def test_area_and_length_agree_with_a_dense_polygon(profile: Profile) -> None:
    z = profile.point(np.linspace(0.0, profile.period, 400_001))
    shoelace = 0.5 * (np.conj(z[:-1]) * z[1:]).imag.sum()
    assert profile.area == pytest.approx(shoelace, rel=1e-8)
    assert profile.perimeter == pytest.approx(np.abs(np.diff(z)).sum(), rel=1e-6)


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (1.0, 0.6), (0.2, 0.9)])
def test_ellipse_has_its_textbook_area_and_perimeter(a: float, b: float) -> None:
    p = Superellipse(a, b)
    assert p.area == pytest.approx(np.pi * a * b, rel=1e-13)
    major, minor = max(a, b), min(a, b)
    assert p.perimeter == pytest.approx(4 * major * ellipe(1 - (minor / major) ** 2), rel=1e-13)


@pytest.mark.parametrize("m", [0.7, 1.0, 1.5, 2.5, 4.0, 8.0])
def test_superellipse_has_its_textbook_area(m: float) -> None:
    assert Superellipse(1.0, 0.6, m).area == pytest.approx(
        4 * 0.6 * gamma(1 + 1 / m) ** 2 / gamma(1 + 2 / m), rel=1e-8
    )


@given(m=st.floats(0.6, 8.0), angle=st.floats(0.0, 6.28))
def test_natural_angle_is_the_papers(m: float, angle: float) -> None:
    p = Superellipse(1.0, 0.6, m)
    c, s = np.cos(angle), np.sin(angle)
    wanted = np.sign(c) * abs(c) ** (2 / m) + 0.6j * np.sign(s) * abs(s) ** (2 / m)
    assert abs(p.point(p.at_natural(angle)) - wanted) < 1e-12


@families
@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.37, 0.5, 0.93])
def test_arc_fraction_is_a_fraction_of_the_length(profile: Profile, fraction: float) -> None:
    s = profile.at_arc(fraction)
    z = profile.point(np.linspace(0.0, s, 200_001))
    assert np.abs(np.diff(z)).sum() == pytest.approx(fraction * profile.perimeter, abs=1e-5 * profile.perimeter)


@families
@settings(max_examples=40)
@given(data=st.data())
def test_extreme_finds_the_highest_point_of_any_arc(profile: Profile, data: st.DataObject) -> None:
    start = data.draw(st.floats(-1.0, 1.0)) * profile.period
    length = data.draw(st.floats(1e-4, 1.0)) * profile.period
    direction = np.exp(1j * data.draw(st.floats(0.0, 6.28)))
    value, where = profile.extreme(
        np.array([start]), np.array([start + length]), np.array([0.1 + 0.2j]), np.array([direction])
    )
    dense = profile.point(np.linspace(start, start + length, 20_001))
    heights = (np.conj(direction) * (dense - (0.1 + 0.2j))).real
    assert value[0] >= heights.max() - 1e-12 * profile.size
    # Nothing higher than the densest look allows: the step times the steepest slope there.
    assert value[0] <= heights.max() + np.abs(np.diff(heights)).max()
    assert (np.conj(direction) * (where[0] - (0.1 + 0.2j))).real == pytest.approx(value[0], abs=1e-15)


@families
@settings(max_examples=15)
@given(data=st.data())
def test_samples_keep_their_sagitta_and_every_corner(profile: Profile, data: st.DataObject) -> None:
    start = data.draw(st.floats(0.0, 1.0)) * profile.period
    stop = start + data.draw(st.floats(1e-3, 1.0)) * profile.period
    sagitta = 10.0 ** data.draw(st.floats(-6.0, -3.0)) * profile.size
    points = profile.sample(start, stop, sagitta)
    assert np.allclose(points[[0, -1]], profile.point([start, stop]), atol=1e-14, rtol=0.0)
    dense = profile.point(np.linspace(start, stop, 2000))
    a, b = points[:-1], points[1:]
    side = b - a
    along = np.clip((np.conj(side) * (dense[:, None] - a)).real / np.maximum(np.abs(side) ** 2, 1e-300), 0.0, 1.0)
    distance = np.abs(dense[:, None] - (a + along * side)).min(axis=1)
    # Where curvature jumps or is unbounded between samples the equal-share rule is approximate.
    assert distance.max() <= 1.6 * sagitta
    corners = [c for c in (*profile.corners, *(profile.corners + profile.period)) if start < c < stop]
    for c in corners:
        assert np.abs(points - profile.point(c)).min() < 1e-12 * profile.size


def test_naca_thickness_and_camber_are_the_textbooks() -> None:
    p = Naca4("0012", 1.0)
    upper, lower = p.point(p.at_chord(0.3, "upper")), p.point(p.at_chord(0.3, "lower"))
    assert upper.imag - lower.imag == pytest.approx(0.12003, abs=2e-5)  # Abbott & von Doenhoff: 12 % at 30 %
    cambered = Naca4("2412", 1.0)
    x = np.linspace(0.1, 0.99, 50)
    top = np.array([cambered.point(cambered.at_chord(float(v), "upper")).imag for v in x])
    bottom = np.array([cambered.point(cambered.at_chord(float(v), "lower")).imag for v in x])
    camber = np.where(x < 0.4, 0.02 / 0.16 * (0.8 * x - x**2), 0.02 / 0.36 * (0.2 + 0.8 * x - x**2))
    # The sides' mean is the camber line but for thickness being set off perpendicular to it.
    assert np.allclose(0.5 * (top + bottom), camber, atol=6e-4)


@pytest.mark.parametrize("x", [0.0, 1e-4, 0.055, 0.4, 0.68, 0.999, 1.0])
@pytest.mark.parametrize("side", ["upper", "lower"])
def test_chord_fraction_is_the_surfaces_x(x: float, side: str) -> None:
    p = Naca4("2412", 0.25)
    z = p.point(p.at_chord(x, side))  # type: ignore[arg-type]
    assert z.real == pytest.approx(0.25 * x, abs=1e-14)
    if 0.0 < x < 1.0:
        assert (z.imag > 0.0) == (side == "upper" or x > 0.999)


def test_chord_fraction_beyond_the_chord_says_what_there_is() -> None:
    with pytest.raises(ProfileError, match=r"no places on the upper side.* <= x_chord <= 1;"):
        Naca4("2412", 1.0).at_chord(1.2, "upper")
    with pytest.raises(ProfileError, match=r"no places on the lower side.*place, 0 <= x_chord <= 1;"):
        Naca4("2412", 0.25).at_chord(1.5, "lower")  # 0, not what rounding left of it
    with pytest.raises(ProfileError, match="no upper and lower side"):
        Superellipse(1.0, 0.5).at_chord(0.2, "upper")


def test_spline_through_airfoil_points_is_the_airfoil() -> None:
    p = Naca4("2412", 1.0)
    s = np.linspace(0.0, 2.0, 160, endpoint=False)
    q = PointOutline(xy(p.point(s)), 1.0, smooth=True)
    assert q.area == pytest.approx(p.area, rel=2e-6)
    for x in (0.1, 0.5, 0.9):
        assert abs(q.point(q.at_chord(x, "upper")) - p.point(p.at_chord(x, "upper"))) < 2e-5
    before, after = q.tangents(0.0)
    assert abs(np.angle(after / before)) > 2.5  # the trailing edge stays a corner


def test_polygon_is_its_sides() -> None:
    square = PointOutline([[0, 0], [2, 0], [2, 1], [0, 1]], 0.5, smooth=False)
    assert square.area == pytest.approx(0.5, rel=1e-14)
    assert square.perimeter == pytest.approx(3.0, rel=1e-14)
    assert square.is_convex
    assert not peanut().is_convex


@families
def test_description_makes_the_same_profile_again(profile: Profile) -> None:
    again = from_description(profile.describe())
    s = np.linspace(0.0, profile.period, 100)
    assert np.array_equal(again.point(s), profile.point(s))


SELIG = "NACA 0003 test\n 1.0 0.0\n 0.5 0.02\n 0.0 0.0\n 0.5 -0.01\n"
LEDNICER = "Test section\n 3. 3.\n\n 0.0 0.0\n 0.5 0.02\n 1.0 0.0\n\n 0.0 0.0\n 0.5 -0.01\n 1.0 0.0\n"


def test_both_dat_layouts_give_the_same_outline() -> None:
    selig = PointOutline(parse_dat(SELIG), smooth=False)
    lednicer = PointOutline(parse_dat(LEDNICER), smooth=False)
    assert selig.area == pytest.approx(lednicer.area, rel=1e-14)
    assert selig.area == pytest.approx(0.015, rel=1e-12)


def test_dat_error_names_the_line() -> None:
    with pytest.raises(ProfileError, match=r"wing\.dat, line 4.*two numbers"):
        parse_dat("name\n1 0\n0.5 0.1\n0.2 zero\n0 0\n", "wing.dat")


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[0, 0], [1, 0], [1, 1], [0, 1]][::-1], "clockwise"),
        ([[0, 0], [1, 1], [1, 0], [0, 1]], "crosses itself"),
        ([[0, 0], [1, 0], [np.nan, 1]], "point 3 is not a finite number"),
        ([[0, 0], [1, 0]], "too few points"),
        ([[0, 0], [1, 0], [1, 0], [0, 0]], "fewer than 3 different points"),
        ([[0, 0], [2, 0], [1, 0], [1, 1]], "crosses itself"),
    ],
)
@pytest.mark.parametrize("smooth", [True, False])
def test_unusable_points_are_refused(points: list[list[float]], message: str, smooth: bool) -> None:
    with pytest.raises(ProfileError, match=message):
        PointOutline(points, smooth=smooth)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Superellipse(0.0, 1.0), "a_m"),
        (lambda: Superellipse(1.0, float("nan")), "b_m"),
        (lambda: Superellipse(1.0, 1.0, -2.0), "exponent"),
        (lambda: Naca4("24125", 1.0), "4-digit"),
        (lambda: Naca4("2400", 1.0), "4-digit"),
        (lambda: Naca4("2412", float("inf")), "chord_m"),
        (lambda: from_description({"kind": "spiral"}), "unknown kind"),
        (lambda: from_description({"kind": "ellipse", "a_m": 1.0}), "do not fit"),
        (lambda: Superellipse(1.0, 1.0).at_arc(1.2), "fraction"),
    ],
)
def test_unusable_parameters_are_refused(make, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ProfileError, match=message):
        make()


@given(angle=st.floats(0.0, 6.28), r=st.floats(0.0, 2.0))
def test_contains_agrees_with_the_ellipse_equation(angle: float, r: float) -> None:
    p = Superellipse(1.0, 0.6)
    z = r * (np.cos(angle) + 0.6j * np.sin(angle))
    if abs(r - 1.0) > 1e-4:
        assert bool(p.contains([z])[0]) == (r < 1.0)


@pytest.mark.parametrize("n", [60, 120, 240])
def test_a_closed_file_starts_where_it_says(n: int) -> None:
    p = Naca4("2412", 1.0)
    open_loop = xy(p.point(np.linspace(0.0, 2.0, n, endpoint=False)))
    closed = np.concatenate([open_loop, open_loop[:1]])
    one, two = PointOutline(open_loop), PointOutline(closed)
    assert abs(two.point(0.0) - 1.0) < 1e-15
    assert np.array_equal(one.table_f, two.table_f)
    for side in ("upper", "lower"):
        assert abs(two.point(two.at_chord(1.0, side)) - 1.0) < 1e-15  # type: ignore[arg-type]
        assert two.point(two.at_chord(0.97, side)).real == pytest.approx(0.97)  # type: ignore[arg-type]


def test_chord_ends_are_where_they_are_or_refused() -> None:
    square = PointOutline([[0, 0], [1, 0], [1, 1], [0, 1]], smooth=False)
    with pytest.raises(ProfileError, match="places on the upper side"):
        square.at_chord(1.0, "upper")


@pytest.mark.parametrize("n", [5, 6, 8, 12, 40])
def test_sparse_points_of_a_smooth_curve_stay_smooth(n: int) -> None:
    t = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    circle = PointOutline(np.stack([np.cos(t), np.sin(t)], axis=1))
    assert circle.area == pytest.approx(np.pi, rel=0.03)
    assert len(circle.corners) == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name\n1.O 0.0\n0.5 0.1\n0 0\n0.5 -0.1\n", r"line 2: not two numbers"),
        ("name\n1.0 0.0 0.0\n0.5 0.1 0.0\n", r"line 2: not two numbers"),
        ("name\n7. 6.\n0 0\n0.5 0.1\n1 0\n", "point counts of its first row do not fit"),
    ],
)
def test_headers_do_not_swallow_points(text: str, message: str) -> None:
    with pytest.raises(ProfileError, match=message):
        parse_dat(text, "x.dat")


def test_a_byte_order_mark_is_no_point() -> None:
    assert len(parse_dat("\ufeff1.0 0.0\n0.5 0.1\n0 0\n")) == 3


def test_camber_without_its_place_is_refused() -> None:
    with pytest.raises(ProfileError, match="no camber without its place"):
        Naca4("2012", 1.0)
