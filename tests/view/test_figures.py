"""What figures of structures and plans show."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ori_deploy.design import Structure
from ori_deploy.motion import Plan
from ori_deploy.view import draw_plan, draw_section, draw_strip, to_png, to_svg
from ori_deploy.view.ink import cell_colour, cell_dash
from ori_deploy.view.sheet import to_inline_svg
from ori_deploy.view.strip import FRAMES, fold_frames
from tests.view.conftest import ring_structure

SVG = "{http://www.w3.org/2000/svg}"


def gids(figure: Figure, prefix: str) -> list[str]:
    artists = [a for axes in figure.axes for a in axes.get_children()]
    return [str(a.get_gid()) for a in artists if str(a.get_gid() or "").startswith(prefix)]


def texts(figure: Figure) -> list[str]:
    return [t.get_text() for axes in figure.axes for t in axes.texts]


@pytest.mark.parametrize("n_cells", [3, 6, 12, pytest.param(24, marks=pytest.mark.slow)])
def test_section_shows_every_panel_bond_slit_cell_and_vertex_of_a_ring(n_cells: int) -> None:
    structure = ring_structure(n_cells)
    layout = structure.layout
    figure = draw_section(structure)
    assert sorted(gids(figure, "panel-")) == sorted(f"panel-{p}" for p in layout.panel_ids)
    assert len(gids(figure, "panel-")) == 4 * n_cells
    assert len(gids(figure, "bond-")) == n_cells - 1
    assert gids(figure, "slit-") == ["slit-P-O1"]
    shown = texts(figure)
    assert set(layout.cell_ids) <= set(shown)
    assert {v.id for v in layout.vertices} - set(shown) == {"O1"}
    assert "slit P–O1" in shown


def test_section_of_the_wing_is_true_to_scale_and_covers_the_profile(wing: Structure) -> None:
    figure = draw_section(wing)
    axes = figure.axes[0]
    assert axes.get_aspect() == 1.0
    width, height = figure.get_size_inches() * [axes.get_position().width, axes.get_position().height]
    across, up = np.diff(axes.get_xlim())[0], np.diff(axes.get_ylim())[0]
    assert width / across == pytest.approx(height / up)
    assert axes.get_xlim()[0] < 0.0
    assert axes.get_xlim()[1] > 250.0


@pytest.mark.parametrize("n_cells", [3, 7, 12, pytest.param(24, marks=pytest.mark.slow)])
def test_names_of_outline_vertices_lie_inside_the_figure_and_apart(n_cells: int) -> None:
    structure = ring_structure(n_cells)
    figure = draw_section(structure)
    to_svg(figure)  # settles the layout
    outer = {v.id for v in structure.layout.vertices if not v.inner} | {"slit P–O1"}
    names = [t for t in figure.axes[0].texts if t.get_text() in outer]
    boxes = [t.get_window_extent() for t in names]
    assert len(boxes) == 2 * n_cells
    for box in boxes:
        assert figure.bbox.contains(box.x0, box.y0)
        assert figure.bbox.contains(box.x1, box.y1)
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))


@pytest.mark.parametrize("n_cells", range(3, 25))
def test_neighbours_in_a_ring_differ_in_colour_and_all_cells_in_colour_or_dash(n_cells: int) -> None:
    colours = [cell_colour(i, n_cells) for i in range(n_cells)]
    assert all(a != b for a, b in zip(colours, colours[1:] + colours[:1], strict=True))
    assert len({(cell_colour(i, n_cells), cell_dash(i, n_cells)) for i in range(n_cells)}) == n_cells
    assert all(max(to_rgb(c)) < 0.95 or min(to_rgb(c)) < 0.5 for c in colours)


def polygons(figure: Figure, prefix: str) -> list[Polygon]:
    patches = [p for p in figure.axes[0].patches if str(p.get_gid()).startswith(prefix)]
    return [p for p in patches if isinstance(p, Polygon)]


def frames_on_sheet(figure: Figure) -> list[tuple[float, float, float, float]]:
    """Box of each frame's panels."""
    boxes = []
    for k in range(len(FRAMES)):
        points = np.concatenate([p.get_xy() for p in polygons(figure, f"frame{k}-panel-")])
        boxes.append((*points.min(axis=0), *points.max(axis=0)))
    return boxes


@pytest.mark.parametrize("name", ["wing", "ring 3", "ring 12"])
def test_frames_of_the_strip_lie_apart_inside_the_sheet_with_all_their_panels(name: str, wing: Structure) -> None:
    structure = wing if name == "wing" else ring_structure(int(name.split()[1]))
    figure = draw_strip(structure)
    assert len(gids(figure, "frame")) == len(FRAMES) * (structure.layout.n_panels + 2)  # a slit has two faces
    boxes = frames_on_sheet(figure)
    width, height = figure.get_size_inches()
    for x0, y0, x1, y1 in boxes:
        assert 0.0 < x0 < x1 < width
        assert 0.0 < y0 < y1 < height
    for a, b in combinations(boxes, 2):
        assert a[2] < b[0] or b[2] < a[0] or a[3] < b[1] or b[3] < a[1]
    to_svg(figure)
    captions = [t.get_window_extent() for t in figure.axes[0].texts]
    assert not any(a.overlaps(b) for a, b in combinations(captions, 2))


def test_stack_lies_level_and_the_deployed_frame_stands_as_designed(wing: Structure) -> None:
    flat, *_, deployed = fold_frames(wing)
    edge = flat.outlines[0]
    sides = np.diff(edge, append=edge[0])
    long = sides[np.abs(sides).argmax()]
    assert abs(long.imag) < 1e-3 * abs(long)
    assert flat.size[0] > 5.0 * flat.size[1]
    shift = deployed.outlines[0][0] - 1e3 * wing.panel_outlines()[0][0]
    for drawn, outline in zip(deployed.outlines, wing.panel_outlines(), strict=True):
        np.testing.assert_allclose(drawn, 1e3 * outline + shift, atol=1e-6)


def test_all_frames_have_one_scale_and_panels_keep_their_shape(wing: Structure) -> None:
    figure = draw_strip(wing)
    for panel in ("c1.ac", "c4.da"):
        lengths = []
        for k in range(len(FRAMES)):
            (patch,) = polygons(figure, f"frame{k}-panel-{panel}")
            lengths.append(np.hypot(*np.diff(patch.get_xy(), axis=0).T).sum())
        assert np.ptp(lengths) < 1e-9


def test_plan_shows_four_creases_of_every_cell_twice_and_the_seating(wing_plan: Plan) -> None:
    figure = draw_plan(wing_plan)
    timing, tolerance, *creases = figure.axes
    assert len(creases) == 8
    assert all(len(axes.lines) == 4 for axes in creases)
    assert gids(figure, "seating") == ["seating"]
    (fold,) = [line for line in timing.lines if line.get_gid() == "fold"]
    assert np.asarray(fold.get_xdata())[-1] == pytest.approx(wing_plan.duration_s)
    assert tolerance.get_yscale() == "log"
    (spread,) = [line for line in tolerance.lines if line.get_gid() == "spread"]
    assert np.min(spread.get_ydata()) > 0.0
    angles = np.asarray(creases[2].lines[0].get_ydata())
    assert angles[-1] == pytest.approx(np.degrees(wing_plan.crease_angles_rad[-1, 0, 2]))


def test_plan_without_any_free_step_can_be_drawn_on_a_log_scale(wing_plan: Plan) -> None:
    steps = wing_plan.step_tolerance
    none_free = replace(wing_plan, step_tolerance=replace(steps, spread=np.zeros_like(steps.spread)))
    ET.fromstring(to_svg(draw_plan(none_free)))


def test_svg_is_xml_and_the_same_in_every_run_whatever_the_users_settings(
    wing: Structure, monkeypatch: pytest.MonkeyPatch
) -> None:
    import matplotlib

    first = to_svg(draw_section(wing))
    monkeypatch.setitem(matplotlib.rcParams, "axes.facecolor", "black")
    monkeypatch.setitem(matplotlib.rcParams, "font.size", 30.0)
    assert to_svg(draw_section(wing)) == first
    assert matplotlib.rcParams["font.size"] == 30.0
    root = ET.fromstring(first)
    assert root.tag == f"{SVG}svg"


def test_png_is_the_same_in_every_run(wing: Structure) -> None:
    one, two = (to_png(draw_section(wing), 50) for _ in range(2))
    assert one.startswith(b"\x89PNG")
    assert one == two


def test_ids_of_inline_figures_do_not_meet(wing: Structure) -> None:
    one, two = (ET.fromstring(to_inline_svg(draw_section(wing), p, "x").replace("xlink:", "")) for p in ("a", "b"))
    ids = [{e.get("id") for e in root.iter() if e.get("id")} for root in (one, two)]
    assert ids[0]
    assert not ids[0] & ids[1]
    used = {e.get("href", "#")[1:] for e in one.iter() if e.get("href")}
    assert used <= ids[0]
