"""What the curves of the packaging ratio show."""

from __future__ import annotations

from math import nan

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ori_deploy.design import Structure
from ori_deploy.figures.packaging import PackagingPoint
from ori_deploy.figures.walls import WallPoint
from ori_deploy.view.fold_rows import FoldRow, draw_fold_rows
from ori_deploy.view.packaging_curves import draw_packaging, draw_walls
from ori_deploy.view.sheet import to_png, to_svg
from ori_deploy.view.spars import draw_sparred_section
from tests.shapes import structure

POINTS = [
    PackagingPoint(aspect, n, start, n * aspect - start, 0.1 * start, 1.1 * n * aspect, settled=True, best=start == 0)
    for aspect in (1.0, 0.6)
    for n in (4, 5, 6)
    for start in (0, 1)
] + [PackagingPoint(0.6, 7, 0, nan, nan, 5.0, settled=False, best=False)]

WALLS = [
    *(WallPoint("a", 0.0, n, 1.0 * n, "") for n in (3, 4, 5)),
    WallPoint("a", 0.1, 3, 2.0, ""),
    WallPoint("a", 0.1, 4, 2.5, ""),
    WallPoint("a", 0.1, 5, 2.2, "dead-centre margin"),
    WallPoint("a", 0.1, 6, nan, "wall offset"),
    WallPoint("b", 0.1, 3, nan, "wall offset"),
    WallPoint("b", 0.0, 3, 4.0, ""),
]


def line(figure: Figure, gid: str) -> list[tuple[float, float]]:
    (found,) = figure.findobj(lambda artist: isinstance(artist, Line2D) and artist.get_gid() == gid)
    return [(float(x), float(y)) for x, y in np.asarray(found.get_xydata()).tolist()]  # type: ignore[attr-defined]


def gids(figure: Figure) -> set[str]:
    return {str(artist.get_gid()) for artist in figure.findobj(Line2D) if artist.get_gid()}


def test_markers_and_lines_of_fig_4c_are_the_points() -> None:
    figure = draw_packaging(POINTS)
    for aspect in (1.0, 0.6):
        own = [p for p in POINTS if p.aspect == aspect and np.isfinite(p.eta)]
        for kind, best in (("best", True), ("others", False)):
            some = [p for p in own if p.best is best]
            assert line(figure, f"eta-{aspect:g}-{kind}") == [(p.n_cells, p.eta) for p in some]
            assert line(figure, f"variation-{aspect:g}-{kind}") == [(p.n_cells, p.variation) for p in some]
        assert line(figure, f"limit-{aspect:g}") == sorted({(p.n_cells, p.limit) for p in own})
    assert to_svg(figure) == to_svg(draw_packaging(POINTS))


def test_equally_good_maxima_are_drawn_once() -> None:
    twice = [PackagingPoint(1.0, 4, k, 4.0, 0.0, 5.0, settled=True, best=True) for k in (0, 1)]
    assert line(draw_packaging(twice), "eta-1-best") == [(4.0, 4.0)]


def test_rows_of_walls_are_drawn_with_their_maximum_and_their_end() -> None:
    figure = draw_walls(WALLS)
    assert line(figure, "wall-a-0") == [(3, 3), (4, 4), (5, 5)]
    assert line(figure, "wall-a-0.1") == [(3, 2), (4, 2.5), (5, 2.2)]
    assert line(figure, "best-a-0.1") == [(4, 2.5)]
    assert line(figure, "end-a-0.1") == [(5, 2.2)]
    assert not {"best-a-0", "end-a-0", "end-b-0", "wall-b-0.1"} & gids(figure)
    told = [text.get_text() for axes in figure.axes for text in axes.get_legend().get_texts()]  # type: ignore[union-attr]
    assert told == [
        "wall 0: no maximum up to n = 5",
        "wall 0.1: η 2.50 at n = 4, ends at 5: dead-centre margin",
        "wall 0: no maximum up to n = 3",
    ]
    assert to_png(figure).startswith(b"\x89PNG")


def test_nothing_to_draw_is_refused() -> None:
    with pytest.raises(ValueError, match="points"):
        draw_packaging(POINTS[-1:])
    with pytest.raises(ValueError, match="points"):
        draw_walls([WALLS[-2]])
    with pytest.raises(ValueError, match="rows"):
        draw_fold_rows([], (0.0, 1.0))


def test_a_sheet_of_folds_has_every_panel_of_every_frame() -> None:
    shapes = [structure("wing"), structure("two inner vertices")]
    figure = draw_fold_rows([FoldRow("one", "a", shapes[0]), FoldRow("two", "b", shapes[1])], (0.0, 0.5, 1.0))
    found = {str(patch.get_gid()) for patch in figure.axes[0].patches}
    assert found == {
        f"row{j}-frame{k}-panel-{panel}"
        for j, shape in enumerate(shapes)
        for k in range(3)
        for panel in shape.layout.panel_ids
    }
    for patch in figure.axes[0].patches:
        x, y = patch.get_path().vertices.T  # type: ignore[attr-defined, union-attr]
        assert x.min() >= 0.0
        assert x.max() <= figure.get_figwidth()
        assert y.min() >= 0.0
        assert y.max() <= figure.get_figheight()


def area(figure: Figure, row: int, frame: int) -> float:
    total = 0.0
    for patch in figure.axes[0].patches:
        if str(patch.get_gid()).startswith(f"row{row}-frame{frame}-"):
            x, y = np.asarray(patch.get_path().vertices).T
            total += 0.5 * abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()))
    return total


def test_rows_at_one_scale_can_be_compared_and_frames_of_a_row_always() -> None:
    shapes = [structure("circle 3"), structure("circle 6 without wall")]
    rows = [FoldRow("", "", shape) for shape in shapes]
    one = draw_fold_rows(rows, (0.0, 1.0), one_scale=True)
    wanted = shapes[0].panel_areas.sum() / shapes[1].panel_areas.sum()
    assert area(one, 0, 0) / area(one, 1, 0) == pytest.approx(wanted, rel=1e-3)
    for row in (0, 1):
        assert area(one, row, 0) == pytest.approx(area(one, row, 1), rel=1e-9)


def names_on(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.axes[0].texts]


def test_spars_are_drawn_where_they_stand_and_no_name_lies_on_another() -> None:
    shape: Structure = structure("two inner vertices")
    ids = [v.id for v in shape.layout.vertices]
    spar = tuple(ids.index(v) for v in ("Otop", "P", "Obot"))
    figure = draw_sparred_section(shape, [spar])
    z = 1e3 * shape.embedding.z[list(spar)]
    assert line(figure, "spar-1") == [(w.real, w.imag) for w in z.tolist()]
    assert "spar 1" in names_on(figure)
    renderer = FigureCanvasAgg(figure).get_renderer()
    boxes = [text.get_window_extent(renderer) for text in figure.axes[0].texts if text.get_text()[0] in "sOCPQ"]
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
