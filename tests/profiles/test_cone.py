"""Cones: what holds for any, closed forms where there are some, refusals."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.errors import ProfileError
from ori_deploy.profiles import Clover, Cone, Naca4, PointOutline, Superellipse, cone_from_description
from ori_deploy.profiles.sphere import arc, cross, dot, excess, polygon_excess, unit
from tests.shapes import peanut

CONES = {
    "circular": Cone.of_half_angle(0.5),
    "elliptic": Cone.of_half_angle(0.7, 0.4),
    "wide": Cone.of_half_angle(1.4),
    "narrow": Cone.of_half_angle(1e-3),
    "wing": Cone(Naca4("2412", 0.25), (0.05, 0.01, 1.5)),
    "oblique": Cone(Superellipse(0.3, 0.2), (1.5, -0.4, -1.0)),
    "superellipse": Cone(Superellipse(0.3, 0.2, 4.0), (0.0, 0.0, -0.4)),
    "hollow": Cone(peanut(), (0.1, 0.0, 2.0)),
    "clover": Cone(Clover(0.2, 0.3), (0.0, 0.0, 0.3), 0.1),
    "pyramid": Cone(PointOutline([[1, 1], [-1, 1], [-1, -1], [1, -1]], smooth=False), (0.0, 0.0, -1.5)),
}
every = pytest.mark.parametrize("cone", CONES.values(), ids=CONES.keys())


def dense(cone: Cone, start: float, stop: float, n: int = 20001) -> np.ndarray:
    return cone.point(np.linspace(start, stop, n))


@every
def test_rays_run_through_the_base(cone: Cone) -> None:
    s = np.linspace(0.0, cone.period, 101)
    f = cone.base.point(s)
    places = np.stack([f.real, f.imag, np.full(len(s), cone.plane_z_m)], axis=1)
    rays = places - cone.apex
    assert np.allclose(cone.to_user(cone.point(s)), rays / np.linalg.norm(rays, axis=1, keepdims=True), atol=1e-14)
    assert np.allclose(cone.from_user(cone.to_user(cone.point(s))), cone.point(s), atol=1e-15)
    assert (cone.point(s)[:, 2] > 0.0).all()
    assert np.abs(cone.onto_base(cone.point(s)) - f).max() < 1e-12 * cone.base.size
    assert cone.is_right_handed == (cone.apex[2] < cone.plane_z_m)
    assert np.allclose(cone.frame @ cone.frame.T, np.eye(3))


@every
def test_derivatives_are_those_of_the_curve(cone: Cone) -> None:
    width = cone.period / 997.0
    s = np.arange(0.3, 997.0, 31.0) * width
    s = s[np.abs(s[:, None] - np.append(cone.breaks, cone.period)).min(axis=1) > 0.3 * width]
    step = 1e-5 * cone.period
    g, dg, ddg = cone.evaluate(s, 2)
    ahead, behind = cone.evaluate(s + step, 1), cone.evaluate(s - step, 1)
    scale = np.abs(ddg).max() + np.abs(dg).max()
    assert np.allclose((ahead[0] - behind[0]) / (2.0 * step), dg, atol=1e-5 * scale)
    assert np.allclose((ahead[1] - behind[1]) / (2.0 * step), ddg, atol=3e-3 * scale)
    assert np.abs(dot(g, dg)).max() < 1e-13 * scale


@every
def test_integrals_add_up(cone: Cone) -> None:
    g = dense(cone, 0.0, cone.period)
    polygon = polygon_excess(g[:-1], np.array([0.0, 0.0, 1.0]))
    assert cone.solid_angle == pytest.approx(float(polygon), rel=2e-6)
    assert cone.perimeter == pytest.approx(float(arc(g[:-1], g[1:]).sum()), rel=1e-6)
    cut = np.array([-0.3, 0.1, 0.77, 1.0, 2.4]) * cone.period
    assert np.allclose(cone.swept(cut + cone.period) - cone.swept(cut), cone.solid_angle, rtol=1e-12)
    assert np.allclose(cone.arc_length(cut + cone.period) - cone.arc_length(cut), cone.perimeter, rtol=1e-12)
    assert (np.diff(cone.arc_length(np.linspace(0.0, cone.period, 50))) > 0.0).all()


@pytest.mark.parametrize("angle", [1e-4, 0.1, 0.5, 1.2, 1.5])
def test_circular_cone_has_its_closed_forms(angle: float) -> None:
    cone = Cone.of_half_angle(angle)
    assert cone.solid_angle == pytest.approx(4.0 * np.pi * np.sin(0.5 * angle) ** 2, rel=1e-12)
    assert cone.perimeter == pytest.approx(2.0 * np.pi * np.sin(angle), rel=1e-12)
    assert cone.size == pytest.approx(2.0 * angle, rel=1e-12)
    assert np.allclose(cone.axis, [0.0, 0.0, 1.0], atol=1e-14)


def test_pyramid_has_its_closed_form() -> None:
    a, b, d = 1.0, 1.0, 1.5
    expected = 4.0 * np.arctan(a * b / (d * np.sqrt(a * a + b * b + d * d)))
    assert CONES["pyramid"].solid_angle == pytest.approx(expected, rel=1e-12)


def test_elliptic_cone_is_the_issues_curve() -> None:
    cone, s = Cone.of_half_angle(0.5, 0.6), np.linspace(0.0, 6.0, 13)
    told = np.stack([np.tan(0.5) * np.cos(s), 0.6 * np.tan(0.5) * np.sin(s), np.ones_like(s)], axis=1)
    assert np.allclose(cone.point(s), told / np.linalg.norm(told, axis=1, keepdims=True), atol=1e-15)


@every
@settings(max_examples=30)
@given(data=st.data())
def test_extremes_are_those_of_dense_samples(cone: Cone, data: st.DataObject) -> None:
    start = data.draw(st.floats(-1.0, 1.0)) * cone.period
    stop = start + data.draw(st.floats(1e-3, 1.0)) * cone.period
    normal = unit(np.array([data.draw(st.floats(-1.0, 1.0)), data.draw(st.floats(-1.0, 1.0)), 0.31]))
    value, where = cone.extreme(np.array([start]), np.array([stop]), normal[None])
    sampled = (dense(cone, start, stop) @ normal).max()
    assert value[0] >= sampled - 1e-14
    assert value[0] <= sampled + cone.perimeter / 10000.0  # at a corner the samples miss by a step
    assert float(where[0] @ normal) == pytest.approx(float(value[0]), abs=1e-15)


@every
@settings(max_examples=20)
@given(first=st.floats(0.0, 1.0), part=st.floats(0.01, 0.35))
def test_steepest_is_the_largest_angle_seen_from_a_crease(cone: Cone, first: float, part: float) -> None:
    start, stop = first * cone.period, (first + part) * cone.period
    c, q = cone.point(np.array([start, stop]))
    out = -unit(cross(c, q))
    angle, where = cone.steepest(np.array([start]), np.array([stop]), c[None], out[None])
    g = dense(cone, start, stop)
    if (g @ c).min() < 1e-6:
        return  # the arc passes 90 degrees from the crease: another test's case
    sampled = np.arctan2(g @ out, g @ c).max()
    assert angle[0] >= sampled - 1e-13
    assert angle[0] <= sampled + cone.perimeter / 1000.0
    assert np.arctan2(where[0] @ out, where[0] @ c) == pytest.approx(angle[0], abs=1e-14)


def test_an_arc_that_reaches_ninety_degrees_away_is_told_as_a_right_angle() -> None:
    cone = Cone.of_half_angle(1.4)
    c = cone.point(np.array([0.0]))
    out = -unit(cross(c, cone.point(np.array([2.5]))))
    assert cone.steepest(np.array([0.0]), np.array([2.5]), c, out)[0] == pytest.approx(0.5 * np.pi)


@every
@pytest.mark.parametrize("sagitta", [1e-3, 2e-5])
def test_samples_keep_the_sagitta(cone: Cone, sagitta: float) -> None:
    limit = sagitta * cone.size
    start, stop = 0.13 * cone.period, 0.81 * cone.period
    points = cone.sample(start, stop, limit)
    assert np.allclose(points[[0, -1]], cone.point([start, stop]), atol=1e-14)
    pole = unit(cross(points[:-1], points[1:]))
    g = dense(cone, start, stop)
    bounds = (points @ g.T).argmax(axis=1)
    assert (np.diff(bounds) > 0).all()
    for k, (a, b) in enumerate(pairwise(bounds)):
        assert np.abs(g[a : b + 1] @ pole[k]).max() <= 1.01 * limit + np.linalg.norm(g[a] - g[a + 1])


@every
def test_contains_agrees_with_the_base(cone: Cone) -> None:
    middle = cone.axis
    assert cone.contains(middle) == cone.base.contains(cone.onto_base(middle))
    assert not cone.contains(-middle)
    edge = cone.point(0.37 * cone.period)
    inwards = cone.towards(complex(cone.base.table_f.mean())) - edge
    assert cone.contains(unit(edge + 0.02 * inwards))
    assert not cone.contains(unit(edge - 0.02 * inwards))


@every
def test_description_makes_the_same_cone(cone: Cone) -> None:
    again = cone_from_description(json.loads(json.dumps(cone.describe())))
    s = np.linspace(0.0, cone.period, 20)
    assert np.array_equal(again.point(s), cone.point(s))
    assert again.solid_angle == cone.solid_angle


def test_places_are_the_bases() -> None:
    cone, base = CONES["wing"], CONES["wing"].base
    assert cone.at_arc(0.3) == base.at_arc(0.3)
    assert cone.at_natural(1.0) == base.at_natural(1.0)
    assert cone.at_chord(0.4, "lower") == base.at_chord(0.4, "lower")


def test_convexity_is_the_bases() -> None:
    assert CONES["oblique"].is_convex
    assert not CONES["hollow"].is_convex


@pytest.mark.parametrize(
    ("apex", "message"),
    [
        ((0.0, 0.0, 0.0), r"apex lies inside the profile.*z = 0 m.*move apex_m"),
        ((5.0, 0.0, 0.0), r"apex lies in the plane of the profile.*z = 0 m"),
        ((0.0, 0.0, 0.005), r"apex lies inside the profile.*rays up to 1\.5"),
        ((0.0, float("nan"), 1.0), "not a point"),
        ((0.0, 0.0), "not a point"),
    ],
)
def test_apex_that_makes_no_cone_is_refused(apex: tuple[float, ...], message: str) -> None:
    with pytest.raises(ProfileError, match=message):
        Cone(Superellipse(0.2, 0.1), apex)


@pytest.mark.parametrize(
    ("angle", "aspect"), [(0.0, 1.0), (-0.1, 1.0), (1.51, 1.0), (1.6, 1.0), (3.5, 1.0), (1.0, 20.0), (0.5, 0.0)]
)
def test_half_angle_out_of_range_is_refused(angle: float, aspect: float) -> None:
    with pytest.raises(ProfileError, match="limit"):
        Cone.of_half_angle(angle, aspect)


def test_another_description_is_refused() -> None:
    with pytest.raises(ProfileError, match="not a cone"):
        cone_from_description({"kind": "ellipse", "a_m": 1.0, "b_m": 1.0})
    with pytest.raises(ProfileError, match=r"apex_m is not a point|do not fit"):
        cone_from_description({**Cone.of_half_angle(0.5).describe(), "apex_m": "here"})


@settings(max_examples=50)
@given(corner=st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9))
def test_excess_is_the_sum_of_the_angles_less_pi(corner: list[float]) -> None:
    a, b, c = unit(np.array(corner).reshape(3, 3) + np.array([0.0, 0.0, 2.5]))
    volume = float(dot(a, cross(b, c)))
    if abs(volume) < 1e-3:
        return
    angles = 0.0
    for p, q, r in ((a, b, c), (b, c, a), (c, a, b)):
        u, v = unit(q - (q @ p) * p), unit(r - (r @ p) * p)
        angles += float(np.arccos(np.clip(u @ v, -1.0, 1.0)))
    assert float(excess(a, b, c)) == pytest.approx(np.sign(volume) * (angles - np.pi), abs=1e-9)
