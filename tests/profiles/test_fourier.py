"""Clovers and hearts: their formulas, their shape, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.errors import InputError, ProfileError
from ori_deploy.files import build_from_file, load_spec
from ori_deploy.profiles import Clover, Heart, from_description, xy
from ori_deploy.tolerance import TOLERANCE

clovers = st.builds(Clover, st.floats(1e-3, 1e3), st.floats(0.01, 0.95), st.integers(2, 12), resolution=st.just(96))


@settings(max_examples=40)
@given(p=clovers, angle=st.floats(-7.0, 7.0))
def test_a_clover_has_the_radius_of_its_formula_at_its_natural_angle(p: Clover, angle: float) -> None:
    z = complex(p.point(p.at_natural(angle)))
    assert abs(z) == pytest.approx(p.radius_m * (1 + p.depth * np.cos(p.leaves * angle)), rel=1e-11)
    assert np.exp(1j * angle) * abs(z) == pytest.approx(z, abs=1e-12 * p.size)


@settings(max_examples=40)
@given(p=clovers)
def test_a_clover_has_its_area_and_comes_round_on_itself(p: Clover) -> None:
    assert p.area == pytest.approx(np.pi * p.radius_m**2 * (1 + 0.5 * p.depth**2), rel=1e-9)
    s = np.linspace(0.0, 2 * np.pi, 7)
    turned = p.point(s + 2 * np.pi / p.leaves)
    assert np.allclose(turned, np.exp(2j * np.pi / p.leaves) * p.point(s), atol=1e-12 * p.size)


@settings(max_examples=40)
@given(leaves=st.integers(2, 12), share=st.floats(0.5, 1.5).filter(lambda x: abs(x - 1) > 0.1))
def test_a_clover_is_hollow_beyond_the_depth_its_notes_say(leaves: int, share: float) -> None:
    p = Clover(1.0, share / (leaves**2 + 1), leaves, resolution=384)
    assert p.is_convex == (share < 1.0)


def test_the_heart_follows_its_formula_and_is_as_wide_as_asked() -> None:
    p = Heart(2.0)
    s = np.linspace(0.0, 2 * np.pi, 4001)
    z = p.point(s)
    x = 0.82 * np.sin(s) - 0.18 * np.sin(3 * s)
    y = -0.81 * np.cos(s) - 0.25 * np.cos(2 * s) + 0.09 * np.cos(3 * s) - 0.04 * np.cos(4 * s)
    assert np.allclose(z, x + 1j * y, atol=1e-14)
    assert np.ptp(z.real) == pytest.approx(2.0, abs=1e-12)
    assert np.allclose(p.point(-s), -np.conj(z), atol=1e-14)


def test_the_heart_has_one_notch_at_the_top_one_tip_at_the_bottom_and_no_cusp() -> None:
    p = Heart(0.2)
    s = np.linspace(0.0, 2 * np.pi, 20001)[:-1]
    f, df, ddf = p.evaluate(s, 2)
    assert np.abs(df).min() > 0.02 * p.size
    curvature = (np.conj(df) * ddf).imag / np.abs(df) ** 3
    notch = p.at_natural(np.pi)
    k = int(np.argmin(curvature))
    assert s[k] == pytest.approx(notch, abs=1e-3)
    assert f.imag.argmin() == 0
    level = np.flatnonzero(np.diff(np.sign(df.imag[1:-1])))
    assert len(level) == 3  # two lobes with the notch between them; the tip is where the samples begin


@pytest.mark.parametrize("p", [Clover(0.3, 0.4, 5), Heart(0.2)])
def test_described_and_made_again(p: Clover | Heart) -> None:
    again = from_description(p.describe())
    s = np.linspace(0.0, 6.0, 40)
    assert type(again) is type(p)
    assert (again.point(s) == p.point(s)).all()


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ((0.0, 0.3, 3), "radius_m"),
        ((float("nan"), 0.3, 3), "radius_m"),
        ((1.0, 0.0, 3), "depth"),
        ((1.0, 1.0, 3), "depth"),
        ((1.0, float("nan"), 3), "depth"),
        ((1.0, 0.3, 1), "leaves"),
        ((1.0, 0.3, 25), "leaves"),
        ((1.0, 0.3, 3.0), "leaves"),
        ((1.0, 0.3, True), "leaves"),
    ],
)
def test_a_clover_that_is_none_is_refused(arguments: tuple[float, float, int], what: str) -> None:
    with pytest.raises(ProfileError, match=what):
        Clover(*arguments)


@pytest.mark.parametrize("width", [0.0, -1.0, float("inf"), float("nan")])
def test_a_heart_without_width_is_refused(width: float) -> None:
    with pytest.raises(ProfileError, match="width_m"):
        Heart(width)


_REST = "[structure]\nspan_m = 0.3\nwall_m = 0.001\n[layout]\nring = { cells = 3, phase_rad = 1.047 }\n"


def test_leaves_are_three_when_left_out_and_a_ring_follows_the_angle(tmp_path: Path) -> None:
    file = tmp_path / "clover.toml"
    file.write_text('schema = "ori-deploy/spec/1"\n[profile]\nkind = "clover"\nradius_m = 0.1\ndepth = 0.4\n' + _REST)
    _, structure = build_from_file(file)
    assert structure.profile.describe() == {"kind": "clover", "radius_m": 0.1, "depth": 0.4, "leaves": 3}
    o1 = structure.embedding.z[[v.id for v in structure.layout.vertices].index("O1")]
    assert np.angle(o1) == pytest.approx(1.047)


@pytest.mark.parametrize(
    ("profile", "key"),
    [
        ('kind = "clover"\nradius_m = 0.1\ndepth = 1.2', "depth"),
        ('kind = "clover"\nradius_m = 0.1\ndepth = 0.4\nleaves = 2.5', "leaves"),
        ('kind = "clover"\nradius_m = 0.1', "depth"),
        ('kind = "heart"', "width_m"),
        ('kind = "heart"\nwidth_m = 0.2\nnotch = 1', "notch"),
    ],
)
def test_a_file_that_says_it_wrong_names_the_key(tmp_path: Path, profile: str, key: str) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(f'schema = "ori-deploy/spec/1"\n[profile]\n{profile}\n{_REST}')
    with pytest.raises(InputError, match=f"profile.{key}"):
        load_spec(file)


@pytest.mark.parametrize(("depth", "leaves"), [(0.99, 12), (0.97, 24), (0.999, 24), (0.6, 3)])
def test_samples_keep_their_distance_where_the_outline_doubles_back(depth: float, leaves: int) -> None:
    p = Clover(1.0, depth, leaves)
    sagitta = TOLERANCE.sagitta * p.size
    drawn = shapely.LineString(xy(p.sample(0.0, p.period, sagitta)))
    true = shapely.points(xy(p.point(np.linspace(0.0, p.period, 40_001))))
    assert float(shapely.distance(drawn, true).max()) <= 1.5 * sagitta
