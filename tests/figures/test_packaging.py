"""The data of Figs. 4a, 4c and 4d."""

from __future__ import annotations

import numpy as np
import pytest

from ori_deploy.design.continuum import continuum_limit
from ori_deploy.figures import efficiency_map, efficiency_table, optimum, optimum_table, packaging_points
from ori_deploy.figures.packaging import (
    ASPECTS,
    COUNTS,
    PackagingPoint,
    Watch,
    balanced_ring,
    packaging_table,
    ring_layout,
)
from ori_deploy.profiles import Superellipse
from ori_deploy.search.many import Result


def interrupting_after(count: int) -> Watch:
    """What a person does who presses Ctrl-C after so many results."""
    seen: list[Result] = []

    def watch(result: Result) -> None:
        seen.append(result)
        if len(seen) >= count:
            raise KeyboardInterrupt

    return watch


@pytest.fixture(scope="module")
def points() -> list[PackagingPoint]:
    found, interrupted = packaging_points((1.0, 0.6), (5, 12), starts=2)
    assert not interrupted
    return found


def test_there_is_one_point_per_search_in_order(points: list[PackagingPoint]) -> None:
    assert [(p.aspect, p.n_cells, p.start) for p in points] == [
        (aspect, n, start) for aspect in (1.0, 0.6) for n in (5, 12) for start in (0, 1)
    ]


def test_many_cells_follow_the_continuum_limit(points: list[PackagingPoint]) -> None:
    for p in points:
        if p.n_cells >= 12:
            assert p.eta == pytest.approx(p.limit, rel=0.15)
        assert p.limit == pytest.approx(p.n_cells * continuum_limit(Superellipse(1.0, p.aspect)).eta_per_cell)


def test_equal_cells_on_a_circle_have_the_closed_forms_eta(points: list[PackagingPoint]) -> None:
    # geometry, section 7: n = 12
    circle = [p for p in points if p.aspect == 1.0 and p.n_cells == 12]
    assert circle[0].eta == pytest.approx(14.11313, rel=1e-4)
    assert all(p.variation < 1e-3 for p in points if p.aspect == 1.0)


def test_cells_become_more_alike_with_their_number(points: list[PackagingPoint]) -> None:
    few, many = (
        [p.variation for p in points if p.aspect == 0.6 and p.n_cells == n and p.best][0]  # noqa: RUF015
        for n in (5, 12)
    )
    assert 0.0 < many < few


def test_the_best_of_each_number_of_cells_is_marked(points: list[PackagingPoint]) -> None:
    for aspect, n in {(p.aspect, p.n_cells) for p in points}:
        own = [p for p in points if (p.aspect, p.n_cells) == (aspect, n)]
        top = max(p.eta for p in own)
        assert any(p.best for p in own)
        for p in own:
            assert p.best == (p.eta >= top * (1.0 - 1e-6))


def test_an_interrupt_keeps_what_is_finished() -> None:
    whole, _ = packaging_points((0.6,), (4, 5), starts=1)
    part, interrupted = packaging_points((0.6,), (4, 5), starts=1, watch=interrupting_after(1))
    assert interrupted
    assert part == whole[:1]


def test_the_tables_hold_every_point(points: list[PackagingPoint]) -> None:
    lines = packaging_table(points).csv().splitlines()
    assert lines[0] == "aspect,cells,start,eta,area_variation,limit_eta,settled,best"
    assert len(lines) == 1 + len(points)
    for line, p in zip(lines[1:], points, strict=True):
        values = line.split(",")
        assert (float(values[0]), int(values[1]), float(values[3])) == (p.aspect, p.n_cells, p.eta)
        assert values[-1] == ("yes" if p.best else "no")


def test_balanced_rings_have_cells_that_fold_nearly_alike() -> None:
    from ori_deploy.design import build

    limit = continuum_limit(Superellipse(1.0, 0.6))
    variation = []
    for n in (8, 16, 32):
        areas = build(balanced_ring(limit, ring_layout(n), 0.3), 0.0).material_areas
        variation.append(areas.std() / areas.mean())
    assert variation[0] > variation[1] > variation[2]


@pytest.mark.parametrize(("cells", "least"), [(4, 4.1997), (6, 6.398)])
def test_optimised_ellipses_reach_the_papers_eta(cells: int, least: float) -> None:
    found = optimum(cells, starts=1)
    assert found.structure.eta >= least
    assert round(found.structure.eta, 1) == found.paper_eta
    table = optimum_table([found])
    assert len(table.rows) == 2 * cells + 1
    for row in table.rows:
        x, y = float(row[-2]), float(row[-1])
        on_outline = np.hypot(x, y / 0.6) == pytest.approx(1.0, abs=1e-9)
        assert on_outline != row[5]


def test_an_interrupted_optimum_is_none() -> None:
    with pytest.raises(KeyboardInterrupt):
        optimum(4, starts=2, watch=interrupting_after(1))


def test_the_map_is_equation_8() -> None:
    found = efficiency_map(3, 4)
    assert found.eta_per_cell.shape == (4, 3)
    assert found.exponent[[0, -1]] == pytest.approx([2.0, 8.0])
    assert found.aspect[[0, -1]] == pytest.approx([0.1, 1.0])
    for j, aspect in enumerate(found.aspect):
        limit = continuum_limit(Superellipse(1.0, float(aspect), float(found.exponent[1])))
        assert found.eta_per_cell[j, 1] == pytest.approx(limit.eta_per_cell, rel=1e-7)
    rows = efficiency_table(found).rows
    assert len(rows) == 12
    assert {(row[0], row[1]): row[2] for row in rows}[8.0, 1.0] == found.eta_per_cell[-1, -1]
    # More polygonal: more; flatter: less.
    assert (np.diff(found.eta_per_cell[-1]) > 0.0).all()
    assert (np.diff(found.eta_per_cell, axis=0) > 0.0).all()


def test_the_whole_figure_is_that_of_the_paper() -> None:
    assert ASPECTS == (1.0, 0.6, 0.4, 0.2)
    assert tuple(range(4, 21)) == COUNTS
