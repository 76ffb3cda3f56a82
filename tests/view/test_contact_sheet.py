"""Contact sheets: drawings without crossings, everything there, nothing left out unsaid."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely

from ori_deploy.layout import layout_of, layouts
from ori_deploy.profiles import xy
from ori_deploy.view import to_png, to_svg
from ori_deploy.view.contact_sheet import MOST_DRAWN, Entry, draw_contact_sheet, on_circle


@pytest.mark.parametrize("k", range(1, 8))
def test_drawings_are_straight_and_cells_tile_the_outline(k: int) -> None:
    for tree in layouts(k):
        layout = layout_of(tree)
        z = on_circle(layout)
        cells = [shapely.Polygon(xy(z[list(cell)])) for cell in layout.cells]
        assert all(cell.is_valid and cell.exterior.is_ccw for cell in cells)
        outline = shapely.Polygon(xy(z[list(layout.outline)]))
        assert sum(cell.area for cell in cells) == pytest.approx(outline.area, rel=1e-12)
        assert min(cell.area for cell in cells) > 1e-3 * outline.area


def test_everything_is_drawn() -> None:
    trees = list(layouts(5))
    entries = [Entry(layout_of(tree), tree.code) for tree in trees]
    figure = draw_contact_sheet(entries, title="38 layouts of 5 cells", total=38)
    (axes,) = figure.axes
    by_gid = {c.get_gid(): c for c in axes.collections}
    assert len(by_gid["cells"].get_paths()) == 5 * 38
    assert len(by_gid["outline"].get_paths()) == 38
    assert len(by_gid["slits"].get_paths()) == sum(tree.n_inner for tree in trees)
    assert len(by_gid["bonds"].get_paths()) == 4 * 38
    marks = {line.get_gid(): len(line.get_xydata()) for line in axes.lines}
    assert marks["closing"] == 6 * 38
    assert marks["opening"] == sum(6 - tree.n_inner for tree in trees)
    assert {t.get_text() for t in axes.texts} >= {tree.code for tree in trees}
    assert [t.get_text() for t in figure.texts] == ["38 layouts of 5 cells"]


def test_drawings_do_not_overlap_and_stay_on_the_sheet() -> None:
    for k in (1, 3, 4, 6):
        entries = [Entry(layout_of(tree), tree.code) for tree in layouts(k)]
        (axes,) = draw_contact_sheet(entries, title="", total=len(entries)).axes
        outlines = [
            shapely.Polygon(p.vertices) for c in axes.collections if c.get_gid() == "outline" for p in c.get_paths()
        ]
        assert shapely.unary_union(outlines).area == pytest.approx(sum(o.area for o in outlines))
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        assert shapely.box(left, bottom, right, top).contains(shapely.unary_union(outlines))
        size = axes.figure.get_size_inches() * np.array([axes.get_position().width, axes.get_position().height])
        assert size[0] / (right - left) == pytest.approx(size[1] / (top - bottom))


def test_long_captions_stay_in_their_column() -> None:
    layout = layout_of(next(layouts(4)))
    for n in (1, 6, 40, 100):
        figure = draw_contact_sheet([Entry(layout, "8" * 60 + "\nshort")] * n, title="", total=n)
        to_png(figure, dpi=40.0)
        boxes = [text.get_window_extent() for text in figure.axes[0].texts if "8" in text.get_text()]
        rows = {round(box.y1) for box in boxes}
        assert len(boxes) == n
        for row in rows:
            along = sorted((b.x0, b.x1) for b in boxes if round(b.y1) == row)
            assert all(end < start for (_, end), (start, _) in pairwise(along))
            assert along[0][0] > 0.0


def test_what_is_left_out_is_said() -> None:
    one = Entry(layout_of(next(layouts(4))), "x")
    figure = draw_contact_sheet([one] * (MOST_DRAWN + 5), title="9999 layouts", total=9999)
    assert [t.get_text() for t in figure.texts] == [f"9999 layouts: the first {MOST_DRAWN} are drawn"]
    assert len(figure.axes[0].texts) == MOST_DRAWN


def test_an_empty_sheet_is_a_sheet() -> None:
    assert "<svg" in to_svg(draw_contact_sheet([], title="0 layouts", total=0))


def test_roles_and_folding_differ_without_colour() -> None:
    entries = [Entry(layout_of(tree), tree.code) for tree in layouts(3)]
    (axes,) = draw_contact_sheet(entries, title="", total=4).axes
    marker = {line.get_gid(): line.get_marker() for line in axes.lines}
    assert marker["closing"] != marker["opening"]
    cells = next(c for c in axes.collections if c.get_gid() == "cells")
    lightness = cells.get_facecolor()[:, :3].mean(axis=1).reshape(-1, 3).mean(axis=1)
    cannot = np.array([bool(e.layout.overfull_vertices) for e in entries])
    assert cannot.any()
    assert lightness[cannot].min() > lightness[~cannot].max() + 0.05


def test_given_places_are_kept_in_shape() -> None:
    layout = layout_of(next(layouts(4, inner=1)))
    places = on_circle(layout) * (3.0 + 4.0j) + 100.0
    (axes,) = draw_contact_sheet([Entry(layout, "own", places)], title="own", total=1).axes
    drawn = next(c for c in axes.collections if c.get_gid() == "outline").get_paths()[0].vertices
    given = places[[*layout.outline, layout.outline[0]]]
    ratio = np.abs(np.diff(drawn[:, 0] + 1j * drawn[:, 1])) / np.abs(np.diff(given))
    assert np.ptp(ratio) < 1e-9
    assert to_png(axes.figure)[:4] == b"\x89PNG"  # type: ignore[arg-type]
