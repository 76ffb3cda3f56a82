"""The data of the figure with real walls."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ori_deploy.design import Structure, build
from ori_deploy.figures.packaging import ring_layout
from ori_deploy.figures.walls import WallPoint, grown, wall_points, wall_rows, wall_table
from ori_deploy.profiles import Naca4, Profile, Superellipse
from ori_deploy.search import Wish, solve
from tests.figures.test_packaging import interrupting_after

SHAPES: dict[str, Callable[[], Profile]] = {
    "ellipse": lambda: Superellipse(1.0, 0.6),
    "wing": lambda: Naca4("2412", 1.0),
}


@pytest.fixture
def ellipse_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ori_deploy.figures.walls.wall_shapes", lambda: {"ellipse": Superellipse(1.0, 0.6)})


@pytest.mark.slow
@pytest.mark.usefixtures("ellipse_only")
def test_a_thick_wall_has_a_maximum_and_the_row_ends_at_the_dead_centre() -> None:
    # Thicker than anyone would: the row is short.
    points, interrupted = wall_points((0.08,), 12, starts=1)
    assert not interrupted
    assert [p.n_cells for p in points] == list(range(3, 3 + len(points)))
    assert np.isnan([p.eta for p in points[-2:]]).all()
    (row,) = wall_rows(points)
    assert row.best is not None
    assert row.best.eta == max(p.eta for p in row.points)
    assert row.points[-1].n_cells < 12
    assert "dead-centre margin" in row.ended_by


@pytest.mark.slow
@pytest.mark.usefixtures("ellipse_only")
def test_a_wall_costs_packaging_and_more_so_with_more_cells() -> None:
    points, _ = wall_points((0.0, 0.01), 5, starts=1)
    bare, thick = ([p.eta for p in points if p.wall == wall] for wall in (0.0, 0.01))
    lost = 1.0 - np.array(thick) / np.array(bare)
    assert (lost > 0.0).all()
    assert (np.diff(lost) > 0.0).all()
    assert all(row.ended_by == "" for row in wall_rows(points))


@pytest.mark.usefixtures("ellipse_only")
def test_an_interrupt_keeps_whole_points() -> None:
    whole, _ = wall_points((0.0,), 4, starts=1)
    part, interrupted = wall_points((0.0,), 4, starts=1, watch=interrupting_after(2))
    assert interrupted
    assert part == whole[:1]


def solved(shape: str, cells: int) -> Structure:
    return solve(SHAPES[shape](), ring_layout(cells), 0.0, Wish(), start=0).structure


@pytest.mark.parametrize("shape", SHAPES)
def test_a_ring_grows_by_one_cell_and_keeps_sharp_corners(shape: str) -> None:
    before = solved(shape, 4)
    for larger in grown(before, 4):
        assert larger.layout.n_cells == 5
        loop = larger.s[list(larger.layout.outline)]
        turned = (loop - loop[0]) % larger.profile.period
        assert (np.diff(turned) > 0.0).all()  # once round, in order
        closing = {v.id: larger.s[i] for i, v in enumerate(larger.layout.vertices) if v.id[0] == "C"}
        away = np.abs(np.array(list(closing.values())))
        if shape == "wing":
            assert min(np.minimum(away, larger.profile.period - away)) < 1e-12  # the trailing edge
        # Every opening vertex is still one, and one is new.
        kept = [
            round(float(before.embedding.s[i]), 9) for i, v in enumerate(before.layout.vertices) if v.id[0] == "O"
        ]
        now = [round(float(larger.s[i]), 9) for i, v in enumerate(larger.layout.vertices) if v.id[0] == "O"]
        assert len(set(now) - set(kept)) == 1
    if shape == "ellipse":
        assert build(grown(before, 1)[0], 0.0).eta > 1.0


def test_rows_and_table_say_the_same() -> None:
    points = [
        WallPoint("a", 0.0, 3, 2.0, ""),
        WallPoint("a", 0.0, 4, 3.0, "dead-centre margin"),
        WallPoint("a", 0.0, 5, 2.5, "dead-centre margin"),
        WallPoint("a", 0.0, 6, float("nan"), "wall offset"),
        WallPoint("a", 0.1, 3, 1.5, ""),
        WallPoint("a", 0.1, 4, float("nan"), "wall offset"),
        WallPoint("b", 0.1, 3, float("nan"), "opening angle"),
        WallPoint("b", 0.2, 3, 1.2, ""),
    ]
    rows = {(row.shape, row.wall): row for row in wall_rows(points)}
    assert rows["a", 0.0].ended_by == "dead-centre margin"
    assert rows["a", 0.1].ended_by == "wall offset"
    assert rows["b", 0.1].ended_by == "opening angle"
    assert rows["b", 0.1].best is None
    assert rows["b", 0.2].ended_by == ""
    lines = wall_table(points).csv().splitlines()
    assert [line for line in lines if line.endswith("yes")] == [
        "a,0.0,4,3.0,dead-centre margin,yes",
        "a,0.1,3,1.5,,yes",
        "b,0.2,3,1.2,,yes",
    ]
    assert "a,0.0,6,,wall offset,no" in lines
