"""What figures and the report show of cones."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ori_deploy.profiles.sphere import arc, cross, unit
from ori_deploy.view import draw_section, draw_strip, render_report, to_svg
from ori_deploy.view.globe import Globe, strokes
from ori_deploy.view.strip import FRAMES, fold_frames
from tests.cones import cone

DRAWN = ["elliptic 6", "wing, apex above", "two inner vertices", "oblique 6"]


def gids(figure: Figure, prefix: str) -> list[str]:
    artists = [a for axes in figure.axes for a in axes.get_children()]
    return [str(a.get_gid()) for a in artists if str(a.get_gid() or "").startswith(prefix)]


def area(z: np.ndarray) -> float:
    return 0.5 * float((np.conj(z) * np.roll(z, -1)).imag.sum())


@settings(max_examples=60)
@given(angles=st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4))
def test_distances_and_directions_from_the_middle_are_true(angles: list[float]) -> None:
    a, b, c, d = angles
    centre = np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])
    globe = Globe.looking_along(centre, np.array([0.3, -0.5, 0.8]))
    assert abs(complex(globe.flat(globe.centre))) < 1e-12
    towards = np.cos(d) * globe.east + np.sin(d) * cross(globe.centre, globe.east)
    away = abs(c)
    z = complex(globe.flat(np.cos(away) * globe.centre + np.sin(away) * towards))
    assert abs(z - np.degrees(away) * np.exp(1j * d)) < 1e-9


def test_strokes_follow_the_great_circle() -> None:
    ends = unit(np.array([[1.0, 0.0, 0.2], [0.0, 1.0, 0.4], [-0.3, 0.1, 1.0]]))
    line = strokes(ends, closed=False)
    assert np.allclose(line[[0, -1]], ends[[0, -1]])
    assert arc(line[:-1], line[1:]).max() < 0.04
    assert arc(line[:-1], line[1:]).sum() == pytest.approx(arc(ends[:-1], ends[1:]).sum(), abs=1e-12)
    assert len(strokes(ends, closed=True)) > len(line)


@pytest.mark.parametrize("name", DRAWN)
def test_section_shows_every_panel_bond_slit_cell_and_vertex(name: str) -> None:
    s = cone(name)
    figure = draw_section(s)
    assert sorted(gids(figure, "panel-")) == sorted(f"panel-{p}" for p in s.layout.panel_ids)
    assert len(gids(figure, "bond-")) == s.layout.n_cells - 1
    assert len(gids(figure, "slit-")) == len(s.layout.slits)
    shown = {t.get_text() for t in figure.axes[0].texts}
    assert set(s.layout.cell_ids) <= shown
    assert "(deg)" in figure.axes[0].get_xlabel()
    drawn = [p.get_xy() @ [1.0, 1j] for p in figure.axes[0].patches if str(p.get_gid()).startswith("panel-")]  # type: ignore[attr-defined]
    solid = s.panel_areas > 1e-9
    # Near the middle the projection keeps areas, to the square of the angle; nothing is turned over.
    shrink = np.array([area(z) for z in drawn])[solid] / np.degrees(np.degrees(s.panel_areas[solid]))
    assert np.abs(shrink - 1.0).max() < 0.5 * s.profile.size**2 + 5e-3
    to_svg(figure)


@pytest.mark.parametrize("name", DRAWN)
def test_frames_lie_apart_with_all_their_panels(name: str) -> None:
    s = cone(name)
    figure = draw_strip(s)
    assert len(gids(figure, "frame")) == len(FRAMES) * (s.layout.n_panels + 2 * len(s.layout.slits))
    boxes = []
    for k in range(len(FRAMES)):
        patches = [p for p in figure.axes[0].patches if str(p.get_gid()).startswith(f"frame{k}-panel-")]
        points = np.concatenate([p.get_xy() for p in patches if isinstance(p, Polygon)])
        boxes.append((*points.min(axis=0), *points.max(axis=0)))
    for a, b in combinations(boxes, 2):
        assert a[2] < b[0] or b[2] < a[0] or a[3] < b[1] or b[3] < a[1]
    bar = next(t.get_text() for t in figure.axes[0].texts if t.get_text().endswith("°") and "\n" not in t.get_text())
    assert float(bar[:-1]) > 0.0


@pytest.mark.parametrize("name", DRAWN)
def test_stack_lies_level_and_the_deployed_frame_stands_as_designed(name: str) -> None:
    s = cone(name)
    flat, *_, deployed = fold_frames(s)
    assert flat.size[0] > flat.size[1]
    globe = Globe.looking_along(
        (s.panel_areas[:, None] * unit(np.array([o.mean(axis=0) for o in s.panel_outlines()]))).sum(axis=0),
        np.array([1.0, 0.0, 0.0]),
    )
    designed = [globe.flat(strokes(o, closed=True)) for o in s.panel_outlines()]
    shift = deployed.outlines[0][0] - designed[0][0]
    for drawn, outline in zip(deployed.outlines, designed, strict=True):
        assert np.abs(drawn - outline - shift).max() < 1e-6
    assert flat.closing_rad == pytest.approx((0.0, 0.0), abs=1e-9)
    assert flat.opening_rad == pytest.approx((np.pi, np.pi), abs=1e-9)


@pytest.mark.parametrize("name", ["elliptic 6", "tapered wing"])
def test_report_tells_a_cones_figures_with_their_units(name: str) -> None:
    s = cone(name)
    page = render_report(name, structure=s, span_m=0.9, r_min_m=0.1)
    for words in ("cone over", " sr", "from 0.1 m to 1 m from the apex", "at the outer radius", "truncated cone"):
        assert words in page
    assert "volume over folded box" in page
    assert "cm²" not in page
    assert "m from the apex</" not in render_report(name, structure=s)  # radii unknown: those of the unit sphere
