"""Which layouts there are: against the table, a second enumerator, and closed forms."""

from __future__ import annotations

import tracemalloc
from collections import Counter
from fractions import Fraction
from itertools import islice
from math import comb

import pytest

from ori_deploy.errors import LayoutError
from ori_deploy.layout import (
    Layout,
    PlaneTree,
    Vertex,
    count_by_inner,
    folds_flat_with_some_slits,
    layout_of,
    layouts,
    most_inner,
)
from tests.layout import gluing

TABLE = {1: {0: 1}, 2: {0: 1}, 3: {0: 3, 1: 1}, 4: {0: 7, 1: 2}, 5: {0: 28, 1: 9, 2: 1}, 6: {0: 108, 1: 42, 2: 4}}
MIRROR_APART = {1: 1, 2: 1, 3: 5, 4: 14, 5: 64, 6: 289}
A005036 = [1, 1, 2, 5, 16, 60, 261, 1243]


@pytest.mark.parametrize("k", TABLE)
def test_counts_are_those_of_the_table(k: int) -> None:
    assert count_by_inner(k) == TABLE[k]
    assert sum(count_by_inner(k, mirror_apart=True).values()) == MIRROR_APART[k]


def compare_with_gluing(k: int, *, mirror_apart: bool) -> None:
    trees = list(layouts(k, mirror_apart=mirror_apart))
    found = [min(gluing.codes(tree.cells, mirror_apart=mirror_apart)) for tree in trees]
    assert len(set(found)) == len(found)
    expected = gluing.classes(k, mirror_apart=mirror_apart)
    assert set(found) == set(expected)
    for tree, code in zip(trees, found, strict=True):
        assert tree.n_inner == gluing.n_inner(expected[code])


@pytest.mark.parametrize("mirror_apart", [False, True])
@pytest.mark.parametrize("k", range(1, 7))
def test_layouts_are_those_that_gluing_finds(k: int, mirror_apart: bool) -> None:
    compare_with_gluing(k, mirror_apart=mirror_apart)


@pytest.mark.slow  # the first size at which three inner vertices fit
@pytest.mark.parametrize("mirror_apart", [False, True])
def test_layouts_of_seven_cells_are_those_that_gluing_finds(mirror_apart: bool) -> None:
    compare_with_gluing(7, mirror_apart=mirror_apart)


@pytest.mark.parametrize("k", range(1, 9))
def test_rotations_weigh_to_the_number_of_noncrossing_trees(k: int) -> None:
    # Without inner vertices a plane tree with marks is a tree drawn on k + 1 points of a circle: A001764.
    points = k + 1
    drawn = sum(
        Fraction(points, len(t.symmetries(mirror_apart=True))) for t in layouts(k, inner=0, mirror_apart=True)
    )
    assert drawn == comb(3 * k, k) // (2 * k + 1)


@pytest.mark.parametrize("k", range(1, 8))
def test_both_ways_to_count_mirror_images_weigh_the_same(k: int) -> None:
    once, apart = Counter[int](), Counter[int]()
    for tree in layouts(k):
        once[tree.n_inner] += Fraction(2, len(tree.symmetries()))  # type: ignore[assignment]
    for tree in layouts(k, mirror_apart=True):
        apart[tree.n_inner] += Fraction(1, len(tree.symmetries(mirror_apart=True)))  # type: ignore[assignment]
    assert once == apart


@pytest.mark.parametrize("k", range(1, 9))
def test_colour_blind_count_is_that_of_dissections(k: int) -> None:
    """Dissections of a polygon into k quadrilaterals up to rotation and reflection: OEIS A005036."""
    classes = set()
    for tree in layouts(k, inner=0):
        swapped = tuple(Vertex(v.id, "opening" if v.role == "closing" else "closing", False) for v in tree.vertices)
        other, _ = PlaneTree.of(Layout(swapped, tuple((c, b, d, a) for a, c, b, d in tree.cells), ()))
        classes.add(frozenset((tree.word, other.canonical().word)))
    assert len(classes) == A005036[k - 1]


@pytest.mark.parametrize("mirror_apart", [False, True])
@pytest.mark.parametrize("k", range(1, 9))
def test_asking_for_inner_vertices_gives_just_those(k: int, mirror_apart: bool) -> None:
    everything = list(layouts(k, mirror_apart=mirror_apart))
    for inner in range(most_inner(k) + 2):
        asked = list(layouts(k, inner=inner, mirror_apart=mirror_apart))
        assert asked == [t for t in everything if t.n_inner == inner]
    assert max(t.n_inner for t in everything) == most_inner(k)


@pytest.mark.parametrize("mirror_apart", [False, True])
def test_all_are_canonical_and_differ(mirror_apart: bool) -> None:
    trees = list(layouts(8, mirror_apart=mirror_apart))
    assert len(set(trees)) == len(trees)
    assert all(t == t.canonical(mirror_apart=mirror_apart) for t in trees)


def test_sizes_beyond_counting_start_at_once() -> None:
    for k in (40, 126):
        first = list(islice(layouts(k), 50))
        assert len(set(first)) == 50
        assert all(t.n_cells == k and t == t.canonical() for t in first)
    few = list(islice(layouts(20, inner=9), 20))
    assert [t.n_inner for t in few] == [9] * len(few)
    assert few


def test_nothing_is_remembered_of_layouts_gone_by() -> None:
    found = layouts(14)
    held = []
    tracemalloc.start()
    try:
        for n in (1000, 9000):
            for _ in islice(found, n):
                pass
            held.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert held[1] < held[0] + 10_000  # a list of what came in between would hold thirty times that


def test_no_layout_is_an_answer() -> None:
    assert list(layouts(4, inner=2)) == []
    assert count_by_inner(4, inner=7) == {7: 0}


def test_allowable_rule_is_the_callers() -> None:
    def no_ring(vertices: tuple[Vertex, ...], _: object) -> str | None:
        return "an inner vertex" if any(v.inner for v in vertices) else None

    assert count_by_inner(6, allowable=no_ring) == {0: 108}


@pytest.mark.parametrize("mirror_apart", [False, True])
@pytest.mark.parametrize("k", range(1, 8))
def test_the_stricter_rule_gives_those_that_fold_flat(k: int, mirror_apart: bool) -> None:
    # The default slits fold flat where any do: tested with the slit choices, against all combinations.
    everything = layouts(k, mirror_apart=mirror_apart)
    foldable = [t for t in everything if not layout_of(t).overfull_vertices]
    assert list(layouts(k, mirror_apart=mirror_apart, allowable=folds_flat_with_some_slits)) == foldable
    assert foldable


@pytest.mark.parametrize(("k", "inner"), [(0, None), (-3, None), (127, None), (10**9, 1), (4, -1)])
def test_what_cannot_be_asked_is_refused_when_asked(k: int, inner: int | None) -> None:
    with pytest.raises(LayoutError) as refused:
        layouts(k, inner=inner)
    assert refused.value.limit
    assert refused.value.remedy
