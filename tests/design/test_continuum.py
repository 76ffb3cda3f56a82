"""Equations (7) and (8): against arithmetic with 25 digits, closed forms, and structures really built."""

from __future__ import annotations

from itertools import pairwise

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.design import build, embed
from ori_deploy.design.continuum import centroid, continuum_limit, superellipse_table
from ori_deploy.errors import ProfileError
from ori_deploy.layout import make_layout, ring
from ori_deploy.profiles import Clover, Heart, Naca4, Naca5, PointOutline, Profile, Superellipse
from tests.shapes import peanut, polygon


def by_the_letter(gamma: float, m: float, center: complex = 0j) -> float:
    """(8) as printed, in the polar angle, in arithmetic with 25 digits; derivatives from the implicit equation."""
    with mpmath.workdps(25):
        g, m_, c = mpmath.mpf(gamma), mpmath.mpf(m), mpmath.mpc(center)

        def outside(r: mpmath.mpf, e: mpmath.mpc) -> mpmath.mpf:
            z = c + r * e
            return abs(z.real) ** m_ + abs(z.imag / g) ** m_ - 1

        def radius(e: mpmath.mpc) -> mpmath.mpf:
            """Distance from the center to the outline in direction `e`."""
            if c == 0:
                return (abs(e.real) ** m_ + abs(e.imag / g) ** m_) ** (-1 / m_)
            return mpmath.findroot(lambda r: outside(r, e), (mpmath.mpf("1e-9"), 3), solver="anderson", tol=1e-40)

        def root(angle: mpmath.mpf) -> mpmath.mpf:
            e = mpmath.expj(angle)
            r = radius(e)
            z = c + r * e
            x, y = abs(z.real), abs(z.imag)
            # Implicit F = x^m + (y/g)^m: gradient and Hessian give r' and the curvature.
            fx, fy = m_ * x ** (m_ - 1), m_ * y ** (m_ - 1) / g**m_
            fxx, fyy = m_ * (m_ - 1) * x ** (m_ - 2), m_ * (m_ - 1) * y ** (m_ - 2) / g**m_
            curvature = (fxx * fy**2 + fyy * fx**2) / mpmath.hypot(fx, fy) ** 3
            gx, gy = fx * mpmath.sign(z.real), fy * mpmath.sign(z.imag)
            slope = -r * (-gx * e.imag + gy * e.real) / (gx * e.real + gy * e.imag)
            return mpmath.sqrt(r * curvature * (r**2 + 2 * slope**2) / 16)

        axes = sorted(float(mpmath.arg(z - c)) % (2 * np.pi) for z in (1, 1j * g, -1, -1j * g))
        ends = [*axes, axes[0] + 2 * np.pi]
        # In four from axis to axis: quadrature clusters at the ends, and corners are narrow.
        total = sum(mpmath.quad(root, mpmath.linspace(a, b, 5)) for a, b in pairwise(ends))
        area = 4 * g * mpmath.gamma(1 + 1 / m_) ** 2 / mpmath.gamma(1 + 2 / m_)
        return float(area / total**2)


def elliptic(gamma: float) -> float:
    """(8) of an ellipse from its own parameter: what is left is one smooth periodic integral."""
    t = (np.arange(4096) + 0.5) * 2 * np.pi / 4096
    r, speed = np.hypot(np.cos(t), gamma * np.sin(t)), np.hypot(np.sin(t), gamma * np.cos(t))
    along = (gamma**2 - 1) * np.sin(t) * np.cos(t)
    root = 0.25 * np.sqrt(gamma * ((r * speed) ** 2 + along**2) / (r * speed**3))
    return float(np.pi * gamma / (2 * np.pi * root.mean()) ** 2)


def test_a_circle_gains_four_over_pi_with_every_cell_whatever_its_size() -> None:
    for radius in (1e-3, 1.0, 1e3):
        found = continuum_limit(Superellipse(radius, radius))
        assert found.eta_per_cell == pytest.approx(4 / np.pi, rel=1e-13)
        assert found.integral == pytest.approx(0.5 * np.pi * radius, rel=1e-13)


@pytest.mark.parametrize(("gamma", "printed"), [(1.0, 1.27324), (0.6, 1.10652), (0.4, 0.89595), (0.2, 0.64700)])
def test_ellipses_of_fig_4c(gamma: float, printed: float) -> None:
    found = continuum_limit(Superellipse(1.0, gamma)).eta_per_cell
    assert found == pytest.approx(elliptic(gamma), rel=1e-12)
    assert found == pytest.approx(printed, abs=1e-5)


@pytest.mark.parametrize(
    ("gamma", "m", "center"),
    [
        (0.6, 2.0, 0.3 - 0.1j),
        (0.5, 3.0, 0j),
        (1.0, 8.0, 0j),
        (0.3, 8.0, 0j),
        (0.1, 5.0, 0j),
        (0.8, 2.5, 0.2 + 0.3j),
        (0.7, 1.5, 0j),
    ],
)
def test_agrees_with_the_equation_by_the_letter(gamma: float, m: float, center: complex) -> None:
    found = continuum_limit(Superellipse(1.0, gamma, m), center).eta_per_cell
    assert found == pytest.approx(by_the_letter(gamma, m, center), rel=1e-8)


@settings(max_examples=40)
@given(gamma=st.floats(0.05, 1.0), m=st.floats(1.2, 12.0))
def test_the_table_and_the_outline_agree(gamma: float, m: float) -> None:
    """Two routes: cancelled by hand in the paper's parameter, and curvature of the outline."""
    assert superellipse_table(gamma, m)[0, 0] == pytest.approx(
        continuum_limit(Superellipse(1.0, gamma, m, resolution=64)).eta_per_cell, rel=1e-8
    )


def test_the_table_is_ordered_and_shows_what_the_paper_says() -> None:
    aspects, exponents = np.linspace(0.1, 1.0, 7), np.linspace(2.5, 8.0, 9)
    table = superellipse_table(aspects, exponents)
    assert table.shape == (7, 9)
    assert (np.diff(table, axis=0) > 0.0).all()  # less anisotropic: more
    assert (np.diff(table[3:], axis=1) > 0.0).all()  # more polygonal: more
    assert np.allclose(
        superellipse_table([2.0, 5.0], exponents), superellipse_table([0.5, 0.2], exponents), rtol=1e-12
    )


@settings(max_examples=20)
@given(size=st.floats(1e-3, 1e3), x=st.floats(-0.5, 0.5), y=st.floats(-0.5, 0.5), m=st.floats(1.5, 6.0))
def test_depends_on_shape_and_relative_place_only(size: float, x: float, y: float, m: float) -> None:
    place = complex(x, 0.6 * y)
    here = continuum_limit(Superellipse(1.0, 0.6, m), place)
    there = continuum_limit(Superellipse(size, 0.6 * size, m), size * place)
    mirrored = continuum_limit(Superellipse(1.0, 0.6, m), -place.conjugate())
    assert there.eta_per_cell == pytest.approx(here.eta_per_cell, rel=1e-9)
    assert mirrored.eta_per_cell == pytest.approx(here.eta_per_cell, rel=1e-9)


def egg() -> PointOutline:
    """Smooth and convex, with a centroid that has to be found."""
    t = np.linspace(0.0, 2 * np.pi, 240, endpoint=False)
    return PointOutline(np.stack([np.cos(t) + 0.1 * np.cos(2 * t), 0.8 * np.sin(t)], axis=1) + 0.3)


def test_the_inner_vertex_is_the_centroid_when_left_out() -> None:
    p = egg()
    z = p.point(np.linspace(0.0, p.period, 400_001))
    cross = (np.conj(z[:-1]) * z[1:]).imag
    assert centroid(p) == pytest.approx(((z[:-1] + z[1:]) * cross).sum() / (3 * cross.sum()), rel=1e-8)
    assert continuum_limit(p).center == centroid(p)
    assert continuum_limit(p).eta_per_cell == continuum_limit(p, centroid(p)).eta_per_cell


def test_a_spline_through_an_ellipse_has_the_ellipses_limit() -> None:
    t = np.linspace(0.0, 2 * np.pi, 300, endpoint=False)
    p = PointOutline(np.stack([np.cos(t), 0.6 * np.sin(t)], axis=1))
    assert continuum_limit(p).eta_per_cell == pytest.approx(elliptic(0.6), rel=1e-6)


def test_equation_7_of_a_circle_is_closed() -> None:
    limit = continuum_limit(Superellipse(2.0, 2.0))
    width = np.array([0.5, 0.8, 1.1, 0.4, 2.0, 2 * np.pi - 4.8])
    edges = np.cumsum(width) - 0.7
    assert limit.finite_eta(edges) == pytest.approx(16 * np.pi / (np.roll(width, -1) ** 2).sum(), rel=1e-12)


@pytest.mark.parametrize(
    "profile", [Superellipse(1.0, 0.4), Superellipse(1.0, 0.7, 3.0), egg()], ids=["ellipse", "superellipse", "egg"]
)
def test_equation_7_comes_up_to_8_with_the_best_division_and_not_with_an_even_one(profile: Profile) -> None:
    limit = continuum_limit(profile)
    short = []
    for n in (100, 200, 400):
        z = profile.point(limit.best_openings(n, 0.3)) - limit.center
        short.append(1.0 - limit.finite_eta(np.unwrap(np.angle(z))) / (n * limit.eta_per_cell))
    assert abs(short[2]) < 0.7 * abs(short[1]) < 0.7**2 * abs(short[0])
    assert abs(short[2]) < 5e-3
    even = np.arange(400) * 2 * np.pi / 400
    assert limit.finite_eta(even) < 400 * limit.eta_per_cell * (1 - 1e-2)


@settings(max_examples=40)
@given(angle=st.floats(-20.0, 20.0))
def test_places_are_seen_under_their_polar_angle(angle: float) -> None:
    limit = continuum_limit(Superellipse(1.0, 0.5, 3.0), 0.4 + 0.2j)
    z = complex(limit.profile.point(limit.at_polar_angle(angle))) - limit.center
    assert np.exp(1j * angle) * abs(z) == pytest.approx(z, abs=1e-12)


def built_eta(profile: Profile, n: int) -> float:
    """eta of n cells without wall that are divided as (8) has it."""
    limit = continuum_limit(profile)
    opening = limit.best_openings(n, 0.4)
    closing = limit.best_closings(opening)
    vertices, cells = ring(n)
    places = {f"O{i + 1}": opening[i] for i in range(n)} | {f"C{i + 1}": closing[i] for i in range(n)}
    layout = make_layout(vertices, cells, [("P", "O1")])
    return build(embed(profile, layout, places, {"P": (limit.center.real, limit.center.imag)}), 0.0).eta


@pytest.mark.parametrize(
    "profile", [Superellipse(1.0, 1.0), Superellipse(1.0, 0.6), egg()], ids=["circle", "ellipse", "egg"]
)
def test_structures_that_are_built_come_up_to_the_limit(profile: Profile) -> None:
    slope = (built_eta(profile, 160) - built_eta(profile, 120)) / 40
    assert slope == pytest.approx(continuum_limit(profile).eta_per_cell, rel=0.01)


@pytest.mark.parametrize(
    ("profile", "why"),
    [
        (Naca4("2412", 1.0), r"corner of \d+ deg at \(1, 0\)"),
        (Naca5("23012", 1.0), "corner"),
        (Naca4("6409", 1.0), "corner .* and a hollow"),
        (Clover(1.0, 0.4), "found a hollow"),
        (Heart(1.0), r"found a hollow at \((-?0.0\d*|0),"),
        (peanut(), "hollow"),
        (polygon(), "no bound"),
        (Superellipse(1.0, 1.0, 1.0), "no bound"),
        (Superellipse(1.0, 1.0, 0.7), "hollow"),
        (PointOutline([[0, 0], [1, 0], [1, 1], [0, 1]], smooth=False), r"corner of 90 deg"),
    ],
    ids=lambda v: getattr(v, "kind", ""),
)
def test_outlines_for_which_it_does_not_hold_are_refused_with_the_reason(profile: Profile, why: str) -> None:
    with pytest.raises(ProfileError, match=why):
        continuum_limit(profile)


@pytest.mark.parametrize("center", [1.0, 2.0 + 1j, complex("nan"), -1.0 + 1e-12j])
def test_an_inner_vertex_outside_is_refused(center: complex) -> None:
    with pytest.raises(ProfileError, match="center"):
        continuum_limit(Superellipse(1.0, 1.0), center)


@pytest.mark.parametrize("angles", [[0.0, 1.0, 0.5], [0.0, 7.0], [0.0, 0.0, 1.0], [float("nan"), 1.0], [[0.0, 1.0]]])
def test_angles_out_of_order_are_refused(angles: list[float]) -> None:
    with pytest.raises(ProfileError, match="angles"):
        continuum_limit(Superellipse(1.0, 1.0)).finite_eta(angles)


@pytest.mark.parametrize(("aspects", "exponents"), [([0.0], [2.0]), ([0.5], [1.0]), ([0.5, np.nan], [2.0])])
def test_a_table_of_no_superellipses_is_refused(aspects: list[float], exponents: list[float]) -> None:
    with pytest.raises(ProfileError):
        superellipse_table(aspects, exponents)
