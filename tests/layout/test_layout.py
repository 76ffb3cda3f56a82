"""Layouts: what they promise, and every way in which one can be wrong."""

from __future__ import annotations

import numpy as np
import pytest

from ori_deploy.errors import LayoutError
from ori_deploy.layout import Layout, Vertex, make_layout, opening_vertices_on_outline, ring
from tests.shapes import CATALOGUE, overfull, structure

Cell = tuple[str, str, str, str]
everything = pytest.mark.parametrize("name", CATALOGUE)


def layout_of(cells: list[Cell], slits: list[tuple[str, str]], inner: str = "P") -> Layout:
    names = dict.fromkeys(v for cell in cells for v in cell)
    return make_layout([Vertex(v, "opening" if v[0] == "O" else "closing", v in inner) for v in names], cells, slits)


@everything
def test_bonds_make_one_tree_and_slits_match_inner_vertices(name: str) -> None:
    layout = structure(name).layout
    bonds = int((layout.bonded_to >= 0).sum()) // 2
    inner = sum(v.inner for v in layout.vertices)
    assert bonds == layout.n_cells - 1
    assert len(layout.slits) == inner
    assert sorted(c for c, _, _ in layout.folding_order) == list(range(layout.n_cells))


@everything
def test_neighbours_are_mutual_and_share_an_edge(name: str) -> None:
    layout = structure(name).layout
    for panel, other in enumerate(layout.neighbour):
        if other < 0:
            continue
        assert layout.neighbour[other] == panel
        ends = [
            {int(layout.corners[p // 4, p % 4]), int(layout.corners[p // 4, (p + 1) % 4])} for p in (panel, other)
        ]
        assert ends[0] == ends[1]


@everything
def test_outline_visits_every_outline_vertex_once_closing_and_opening_in_turn(name: str) -> None:
    layout = structure(name).layout
    assert sorted(layout.outline) == [i for i, v in enumerate(layout.vertices) if not v.inner]
    roles = [layout.vertices[i].role for i in layout.outline]
    assert all(one != two for one, two in zip(roles, roles[1:] + roles[:1], strict=True))


@everything
def test_locking_every_latch_point_leaves_no_cell_free(name: str) -> None:
    layout = structure(name).layout
    at_slits = {v for slit in layout.slits for v in slit}
    held = {c for c, corners in zip(layout.cell_ids, layout.cells, strict=True) if at_slits & set(corners)}
    # A cell is held by a slit at one of its inner vertices, or by a latch of its own.
    inner = {i for i, v in enumerate(layout.vertices) if v.inner}
    for name_, corners in zip(layout.cell_ids, layout.cells, strict=True):
        assert (f"cell:{name_}" in layout.latch_points) == (not inner & set(corners))
        assert name_ in held or f"cell:{name_}" in layout.latch_points or inner & set(corners)


def test_bodies_join_bonded_panels_only() -> None:
    layout = structure("wing").layout
    assert len(set(layout.bodies.tolist())) == layout.n_panels - (layout.n_cells - 1)
    bonded = int(np.flatnonzero(layout.bonded_to >= 0)[0])
    assert layout.bodies[bonded] == layout.bodies[layout.bonded_to[bonded]]
    slit = np.flatnonzero(layout.is_slit)
    assert layout.bodies[slit[0]] != layout.bodies[slit[1]]


def test_rows_of_three_bonded_cells_at_an_opening_vertex_are_named() -> None:
    rows = dict(overfull().layout.overfull_vertices)
    assert set(rows) == {"Otop", "Obot"}
    assert all(len(row) == 3 and row[1] == "c5" for row in rows.values())


def test_a_single_cell_and_two_cells_are_layouts() -> None:
    one = layout_of([("C1", "O1", "C2", "O2")], [])
    assert one.latch_points == ("cell:c1",)
    two = layout_of([("CM", "O1", "CA", "O2"), ("CM", "O2", "CB", "O3")], [])
    assert two.latch_points == ("cell:c1", "cell:c2")
    assert (two.bonded_to >= 0).sum() == 2


SQUARE: list[Cell] = [("P", "O1", "C1", "O2"), ("P", "O2", "C2", "O3"), ("P", "O3", "C3", "O1")]


@pytest.mark.parametrize(
    ("cells", "slits", "message"),
    [
        (SQUARE, [], "vertex P: 0 slits"),
        (SQUARE, [("P", "O1"), ("P", "O2")], "vertex P: 2 slits"),
        (SQUARE, [("P", "C1")], "slit P-C1: not an edge"),
        (SQUARE, [("P", "O9")], "slit P-O9: not two known vertices"),
        (SQUARE, [("C1", "O1")], "touches no inner vertex"),
        (SQUARE[:2], [("P", "O2")], "vertex P: the cells round it do not fit"),
        ([("P", "O1", "C1", "O2"), ("O2", "P", "O3", "C2"), SQUARE[2]], [("P", "O1")], "cell c2: wrong colouring"),
        ([("P", "O1", "C1", "O1"), *SQUARE[1:]], [("P", "O1")], "cell c1: a vertex twice"),
        ([("P", "O2", "C1", "O1"), *SQUARE[1:]], [("P", "O1")], "both lie on the left|do not fit"),
        ([*SQUARE, ("C4", "O4", "C5", "O5")], [("P", "O1")], "not one disk"),
        ([("P", "O1", "C1", "O2"), ("P", "O2", "C2", "O1")], [("P", "O1")], "too few cells round an inner vertex"),
    ],
)
def test_what_is_not_a_layout_is_refused(cells: list[Cell], slits: list[tuple[str, str]], message: str) -> None:
    with pytest.raises(LayoutError, match=message) as refused:
        layout_of(cells, slits)
    assert refused.value.limit
    assert refused.value.remedy


def test_cells_that_are_not_quadrilaterals_are_refused() -> None:
    with pytest.raises(LayoutError, match="cell c1: not a quadrilateral; found 3 vertices"):
        layout_of([("C1", "O1", "C2")], [])  # type: ignore[list-item]


def test_unknown_unused_and_repeated_vertices_are_refused() -> None:
    vertices, cells = ring(4)
    with pytest.raises(LayoutError, match="cell c1: unknown vertex; found O1"):
        make_layout([v for v in vertices if v.id != "O1"], cells, [("P", "O1")])
    with pytest.raises(LayoutError, match="vertex X: in no cell"):
        make_layout([*vertices, Vertex("X", "opening", False)], cells, [("P", "O1")])
    with pytest.raises(LayoutError, match="vertex O1: id given twice"):
        make_layout([*vertices, Vertex("O1", "opening", False)], cells, [("P", "O1")])


def test_allowable_rule_is_the_callers() -> None:
    inside_out = [Vertex("O", "opening", True), *(Vertex(f"C{i}", "closing", False) for i in range(3))]
    inside_out += [Vertex(f"W{i}", "opening", False) for i in range(3)]
    cells: list[Cell] = [(f"C{i}", f"W{i}", f"C{(i + 1) % 3}", "O") for i in range(3)]
    assert opening_vertices_on_outline(tuple(inside_out), ()) == "opening vertex O is inside"
    with pytest.raises(LayoutError, match="opening vertex O is inside"):
        make_layout(inside_out, cells, [])
    with pytest.raises(LayoutError, match="no wings on Sundays"):
        make_layout(inside_out, cells, [("O", "C0")], allowable=lambda _v, _c: "no wings on Sundays")


@pytest.mark.parametrize("n", [-1, 0, 2])
def test_ring_needs_three_cells(n: int) -> None:
    with pytest.raises(LayoutError, match="too few cells"):
        ring(n)
