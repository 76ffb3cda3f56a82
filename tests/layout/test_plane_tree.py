"""Plane trees: codes, vertices and cells, canonical form, symmetries."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.errors import LayoutError
from ori_deploy.layout import Layout, PlaneTree, Vertex, layout_of, layouts, make_layout, ring
from tests.layout import gluing
from tests.shapes import structure

ALL = [tree for k in range(1, 7) for tree in layouts(k, mirror_apart=True)]
TREES = st.sampled_from(ALL)


def test_every_tree_is_a_layout() -> None:
    for tree in ALL:
        layout = layout_of(tree)  # make_layout checks faces, fans, colouring and bonds
        assert layout.n_cells == tree.n_cells
        assert sum(v.inner for v in layout.vertices) == tree.n_inner
        assert [v.id for v in layout.vertices[: tree.n_inner]] == [f"P{i + 1}" for i in range(tree.n_inner)]
        loop = [layout.vertices[i].id for i in layout.outline]
        start = loop.index("C1")
        n = len(loop) // 2
        assert loop[start:] + loop[:start] == [f"{c}{i + 1}" for i in range(n) for c in "CO"]


@given(tree=TREES, seed=st.integers(0, 2**32))
def test_canonical_form_does_not_depend_on_how_a_layout_is_written(tree: PlaneTree, seed: int) -> None:
    shuffle = random.Random(seed)
    order = list(range(len(tree.vertices)))
    shuffle.shuffle(order)
    mirror = shuffle.random() < 0.5
    cells = [
        [order[v] for v in (cell if not mirror else (cell[0], cell[3], cell[2], cell[1]))] for cell in tree.cells
    ]
    cells = [c if shuffle.random() < 0.5 else [*c[2:], *c[:2]] for c in cells]
    shuffle.shuffle(cells)
    vertices = tuple(tree.vertices[order.index(i)] for i in range(len(order)))
    written = Layout(vertices, tuple((a, c, b, d) for a, c, b, d in cells), ())
    again, place = PlaneTree.of(written)
    assert again.canonical() == tree.canonical()
    assert again.canonical(mirror_apart=True) == (tree.mirrored() if mirror else tree).canonical(mirror_apart=True)
    # The correspondence is an isomorphism: it maps cells to cells, roles to roles.
    mapped = {frozenset(place[v] for v in cell) for cell in again.cells}
    assert mapped == {frozenset(cell) for cell in written.cells}
    assert [(v.role, v.inner) for v in again.vertices] == [
        (written.vertices[i].role, written.vertices[i].inner) for i in place
    ]


@given(TREES)
def test_codes_read_back(tree: PlaneTree) -> None:
    assert PlaneTree.from_code(tree.code) == tree


@given(TREES, st.integers(0, 11))
def test_a_walk_may_start_anywhere(tree: PlaneTree, start: int) -> None:
    i = start % len(tree.word)
    turned = PlaneTree(tree.word[i:] + tree.word[:i])
    assert PlaneTree.from_code(turned.code) == turned
    assert turned.canonical(mirror_apart=True) == tree.canonical(mirror_apart=True)
    assert min(gluing.codes(turned.cells, mirror_apart=True)) == min(gluing.codes(tree.cells, mirror_apart=True))
    assert turned.mirrored().mirrored() == turned
    assert len(layout_of(turned).slits) == tree.n_inner


def test_high_degrees_have_codes() -> None:
    for n in (9, 10, 35, 36, 100):
        vertices, cells = ring(n)
        tree, _ = PlaneTree.of(make_layout(vertices, cells, [("P", "O1")]))
        tree = tree.canonical()
        assert PlaneTree.from_code(tree.code) == tree
        assert len(tree.symmetries()) == 2 * n


@pytest.mark.parametrize("mirror_apart", [False, True])
def test_symmetries_are_all_automorphisms(mirror_apart: bool) -> None:
    for tree in ALL:
        group = tree.symmetries(mirror_apart=mirror_apart)
        flags = gluing.codes(tree.cells, mirror_apart=mirror_apart)
        assert len(group) == flags.count(min(flags))  # a symmetry that keeps a flag keeps everything
        images = [g.images for g in group]
        assert images[0] == tuple(range(len(tree.vertices)))
        assert len(set(images)) == len(images)
        assert {tuple(a[i] for i in b) for a in images for b in images} == set(images)
        corners = {frozenset((cell, (cell[2], cell[3], cell[0], cell[1]))) for cell in tree.cells}
        for g in group:
            assert all(
                tree.vertices[i] == v or tree.vertices[i].role == v.role
                for i, v in zip(g.images, tree.vertices, strict=True)
            )
            for a, c, b, d in tree.cells:
                to = tuple(g.images[v] for v in ((a, d, b, c) if g.mirrored else (a, c, b, d)))
                assert frozenset((to, (to[2], to[3], to[0], to[1]))) in corners


@pytest.mark.parametrize(("name", "code"), [("one cell", "11"), ("two cells", "12*12"), ("wing", "14141414")])
def test_structures_have_the_codes_one_expects(name: str, code: str) -> None:
    tree, _ = PlaneTree.of(structure(name).layout)
    assert tree.canonical().code == code


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("", "0 corners"),
        ("1", "1 corners"),
        ("1*4 14", "not a code; found character 4"),
        ("1014", "not a code"),
        ("(999)1", "not a code"),
        ("(", "not a code"),
        ("12*13", "degree at corner 4 does not fit"),
        ("1111", "degree at corner 3 does not fit"),
        ("1212", "an inner vertex of degree 2, below 3"),
        ("12*12*", "passes a closing vertex of degree 2 2 times"),
        ("1313", "degree at corner|walk does not close"),
        ("22", "does not fit|does not close"),
        ("1" * 400, "too many cells"),
    ],
)
def test_what_is_no_code_is_refused(code: str, message: str) -> None:
    with pytest.raises(LayoutError, match=message) as refused:
        PlaneTree.from_code(code)
    assert refused.value.limit
    assert refused.value.remedy


@given(st.text("123(*)4z", max_size=14))
def test_any_text_is_a_code_or_refused(text: str) -> None:
    try:
        tree = PlaneTree.from_code(text)
    except LayoutError:
        return
    assert layout_of(tree).n_cells == tree.n_cells


def test_a_layout_with_an_opening_vertex_inside_is_no_tree() -> None:
    inside_out = [Vertex("O", "opening", True), *(Vertex(f"C{i}", "closing", False) for i in range(3))]
    inside_out += [Vertex(f"W{i}", "opening", False) for i in range(3)]
    cells = tuple((1 + i, 4 + i, 1 + (i + 1) % 3, 0) for i in range(3))
    with pytest.raises(LayoutError, match="opening vertex O is inside"):
        PlaneTree.of(Layout(tuple(inside_out), cells, ()))


def test_rings_beyond_a_byte_are_refused() -> None:
    vertices, cells = ring(127)
    with pytest.raises(LayoutError, match="too many cells for a plane tree; found 127"):
        PlaneTree.of(make_layout(vertices, cells, [("P", "O1")]))
