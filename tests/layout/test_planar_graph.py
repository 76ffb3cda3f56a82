"""Layouts from planar graphs: what is accepted, and the reason for what is not."""

from __future__ import annotations

import cmath
from itertools import combinations

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.errors import LayoutError
from ori_deploy.layout import Layout, PlaneTree, layout_of, layout_of_graph, layouts
from ori_deploy.view.contact_sheet import on_circle

Places = dict[str, complex]
Edges = list[tuple[str, str]]

TREES = [tree for k in range(1, 7) for tree in layouts(k)]
RING = {"A": 2 + 0j, "B": 1 + 2j, "C": -1 + 2j, "D": -2 + 0j, "E": -1 - 2j, "F": 1 - 2j, "M": 0j}
ROUND: Edges = [("A", "B"), ("B", "C"), ("C", "D"), ("D", "E"), ("E", "F"), ("F", "A")]
SPOKES: Edges = [("M", "A"), ("M", "C"), ("M", "E")]


def edges_of(layout: Layout) -> Edges:
    ids = [v.id for v in layout.vertices]
    pairs = {frozenset((cell[k], cell[(k + 1) % 4])) for cell in layout.cells for k in range(4)}
    return [(ids[a], ids[b]) for a, b in map(sorted, pairs)]


@given(st.sampled_from(TREES), st.complex_numbers(min_magnitude=1e-3, max_magnitude=1e3), st.randoms())
def test_every_layout_comes_back_from_its_drawing(tree: PlaneTree, turn: complex, random: object) -> None:
    layout = layout_of(tree)
    places = {v.id: turn * z + 7 - 3j for v, z in zip(layout.vertices, on_circle(layout), strict=True)}
    edges = edges_of(layout)
    random.shuffle(edges)  # type: ignore[attr-defined]
    made = layout_of_graph(places, edges, roles={"C1": "closing"})
    assert made.vertices == layout.vertices
    assert PlaneTree.of(made)[0].canonical(mirror_apart=True) == tree.canonical(mirror_apart=True)
    assert bool(made.overfull_vertices) == bool(layout.overfull_vertices)


def test_a_ring_is_coloured_by_its_inner_vertex() -> None:
    layout = layout_of_graph(RING, ROUND + SPOKES)
    assert [v.id for v in layout.vertices] == list(RING)
    assert [v.id for v in layout.vertices if v.role == "closing"] == ["B", "D", "F", "M"]
    assert [v.id for v in layout.vertices if v.inner] == ["M"]
    assert layout_of_graph(RING, ROUND + SPOKES, slits=[("M", "E")]).slits == ((6, 4),)


def test_with_nothing_inside_the_first_vertex_closes_unless_a_role_says_otherwise() -> None:
    square = {"A": 0j, "B": 1 + 0j, "C": 1 + 1j, "D": 1j}
    edges: Edges = [("A", "B"), ("B", "C"), ("C", "D"), ("D", "A")]
    assert layout_of_graph(square, edges).vertices[0].role == "closing"
    assert layout_of_graph(square, edges, roles={"C": "opening"}).vertices[0].role == "opening"


def test_an_allowable_rule_may_let_the_other_colouring_pass() -> None:
    layout = layout_of_graph(
        RING,
        ROUND + SPOKES,
        roles={"M": "opening"},
        slits=[("M", "A")],
        allowable=lambda _v, _c: None,
    )
    assert [v.id for v in layout.vertices if v.role == "closing"] == ["A", "C", "E"]


NINE = {f"{x}{y}": complex(x, y) for x in range(4) for y in range(3)}
GRID: Edges = [(a, b) for a, b in combinations(NINE, 2) if abs(NINE[a] - NINE[b]) == 1.0]


@pytest.mark.parametrize(
    ("places", "edges", "message"),
    [
        (RING, ROUND + SPOKES + [("B", "E")], "lies on edge B-E|edges"),
        (RING, ROUND + SPOKES + [("B", "D")], "edges M-C and B-D: cross"),
        (RING | {"M": 1.5 + 1j}, ROUND + SPOKES, "vertex M: lies on edge A-B"),
        (RING | {"M": -1 + 2j}, ROUND + SPOKES, "vertices C and M: in the same place; found \\(-1, 2\\)"),
        (RING | {"M": complex("nan")}, ROUND + SPOKES, "vertex M: no place"),
        (RING | {"X": 5 + 5j}, ROUND + SPOKES, "graph: X not joined to A"),
        (RING | {"X": 5 + 5j, "Y": 6 + 5j}, [*ROUND, *SPOKES, ("X", "Y")], "graph: X, Y not joined to A"),
        (RING, ROUND + SPOKES[:2], "face C-D-E-F-A-M: not a quadrilateral; found 6 edges"),
        (RING, [*ROUND, *SPOKES, ("M", "B")], "not a quadrilateral; found 3 edges"),
        (RING | {"X": 5 + 0j}, [*ROUND, *SPOKES, ("A", "X")], "vertex A: the outline passes it 2 times"),
        (RING | {"X": 0.3 + 1j}, [*ROUND, *SPOKES, ("M", "X")], "not a quadrilateral; found 6 edges"),
        (RING, [*ROUND, *SPOKES, ("A", "M")], "edge A-M: given twice"),
        (RING, [*ROUND, *SPOKES, ("A", "A")], "edge A-A: does not join two"),
        (RING, [*ROUND, *SPOKES, ("A", "Q")], "edge A-Q: does not join two known vertices; found Q"),
        (RING, [*ROUND, ("A", "B", "C")], "edge A-B-C: does not join two"),
        (RING, [], "graph: no edges"),
        ({"A": 0j, "B": 1 + 0j}, [("A", "B")], "graph: encloses nothing"),
        (
            {"A": 0j, "B": 3 + 0j, "C": 3 + 3j, "D": 3j, "M": 1 + 1.5j},
            [("A", "B"), ("B", "C"), ("C", "D"), ("D", "A"), ("A", "M"), ("M", "C")],
            "vertex M: too few cells round an inner vertex; found 2",
        ),
        (NINE, GRID, "with 00 closing opening vertex 21 is inside; with 01 closing opening vertex 11 is inside"),
    ],
)
def test_what_is_no_layout_is_refused_with_the_reason(places: Places, edges: Edges, message: str) -> None:
    with pytest.raises(LayoutError, match=message) as refused:
        layout_of_graph(places, edges)
    assert refused.value.limit
    assert refused.value.remedy


def test_roles_that_contradict_are_told() -> None:
    with pytest.raises(LayoutError, match=r"with A closing .* M is inside; with B closing A is opening, not"):
        layout_of_graph(RING, ROUND + SPOKES, roles={"A": "closing"})
    with pytest.raises(LayoutError, match="B is closing, not opening"):
        layout_of_graph(RING, ROUND + SPOKES, roles={"A": "opening", "B": "opening"})


GridPoint = tuple[int, int]


def side(a: GridPoint, b: GridPoint, c: GridPoint) -> int:
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return (area > 0) - (area < 0)


def on(a: GridPoint, b: GridPoint, c: GridPoint) -> bool:
    """Whether c lies on a segment and is none of its ends: whole numbers, so exactly."""
    within = all(min(a[i], b[i]) <= c[i] <= max(a[i], b[i]) for i in (0, 1))
    return side(a, b, c) == 0 and within and c not in (a, b)


def cross(p: GridPoint, q: GridPoint, r: GridPoint, s: GridPoint) -> bool:
    return side(p, q, r) * side(p, q, s) < 0 and side(r, s, p) * side(r, s, q) < 0


@st.composite
def grid_graphs(draw: st.DrawFn) -> tuple[list[GridPoint], list[tuple[int, int]]]:
    points = draw(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=4, max_size=8, unique=True))
    pairs = list(combinations(range(len(points)), 2))
    return points, draw(st.lists(st.sampled_from(pairs), min_size=4, max_size=11, unique=True))


@st.composite
def nearly_grids(draw: st.DrawFn) -> tuple[list[GridPoint], list[tuple[int, int]]]:
    """A piece of a square grid, with some points and edges gone: often a layout, or nearly."""
    wide, high = draw(st.integers(2, 5)), draw(st.integers(2, 3))
    gone = draw(st.sets(st.tuples(st.integers(0, wide - 1), st.integers(0, high - 1)), max_size=2))
    points = [p for x in range(wide) for y in range(high) if (p := (x, y)) not in gone]
    unit = [
        (a, b) for a, b in combinations(range(len(points)), 2) if abs(complex(*points[a]) - complex(*points[b])) == 1
    ]
    cut = draw(st.sets(st.sampled_from(unit), max_size=2)) if unit else set()
    return points, [pair for pair in unit if pair not in cut]


@settings(max_examples=300)
@given(st.one_of(grid_graphs(), nearly_grids()), st.floats(0.0, 6.28))
def test_verdicts_agree_with_exact_crossings_and_with_polygonised_faces(
    graph: tuple[list[GridPoint], list[tuple[int, int]]], turn: float
) -> None:
    points, pairs = graph
    spin = cmath.rect(1.0, turn)
    places = {f"v{i}": spin * complex(*p) for i, p in enumerate(points)}
    edges = [(f"v{a}", f"v{b}") for a, b in pairs]
    ends = [(points[a], points[b]) for a, b in pairs]
    lone = [p for i, p in enumerate(points) if not any(i in pair for pair in pairs)]
    touching = any(on(*e, p) for e in ends for p in points) or any(cross(*e, *f) for e, f in combinations(ends, 2))
    try:
        layout = layout_of_graph(places, edges)
    except LayoutError as refused:
        reason = refused.thing
    else:
        reason = ""
    assert ("cross" in reason or "lies on edge" in reason) == touching
    if touching:
        return
    faces = list(shapely.polygonize([shapely.LineString(e) for e in ends]).geoms)
    outer = shapely.unary_union(faces)
    cells = all(len(f.exterior.coords) == 5 and not f.interiors for f in faces)
    disk = (
        bool(faces)
        and not lone
        and outer.geom_type == "Polygon"
        and all(any(f.boundary.covers(shapely.LineString(e)) for f in faces) for e in ends)
        and len(points) - len(pairs) + len(faces) == 1
    )
    if not (disk and cells):
        assert reason
    if reason:
        assert not (disk and cells) or "inner vertex" in reason or "is inside" in reason
    else:
        assert layout.n_cells == len(faces)
