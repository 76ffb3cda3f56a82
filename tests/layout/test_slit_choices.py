"""Slit choices: against trying every combination of edges."""

from __future__ import annotations

from itertools import product

import pytest

from ori_deploy.errors import LayoutError
from ori_deploy.layout import (
    Layout,
    PlaneTree,
    folds_flat_with_some_slits,
    layout_of,
    layouts,
    make_layout,
    slit_choices,
)
from ori_deploy.layout.slit_choices import Slits
from tests.shapes import CATALOGUE, structure

TREES = [tree for k in range(1, 8) for tree in layouts(k) if tree.n_inner and (k < 7 or tree.n_inner > 1)]


def every_combination(tree: PlaneTree) -> list[Layout]:
    """All ways to leave one edge of each inner vertex out that `make_layout` lets pass."""
    ids = [v.id for v in tree.vertices]
    beside: list[set[str]] = [set() for _ in range(tree.n_inner)]
    for a, c, b, d in tree.cells:
        for v in (a, b):
            if v < tree.n_inner:
                beside[v] |= {ids[c], ids[d]}
    return [
        make_layout(tree.vertices, tree.cell_names, [(ids[i], o) for i, o in enumerate(choice)])
        for choice in product(*(sorted(s) for s in beside))
    ]


@pytest.mark.parametrize("mirror_apart", [False, True])
def test_choices_are_one_of_each_orbit_of_all_combinations(mirror_apart: bool) -> None:
    for tree in TREES:
        every = every_combination(tree)
        group = tree.symmetries(mirror_apart=mirror_apart)
        for foldable in (False, True):
            wanted = {layout.slits for layout in every if not (foldable and layout.overfull_vertices)}
            assert set(slit_choices(tree, foldable=foldable, up_to_symmetry=False)) == wanted
            chosen = list(slit_choices(tree, foldable=foldable, mirror_apart=mirror_apart))
            orbits = [{tuple(sorted((g.images[a], g.images[b]) for a, b in c)) for g in group} for c in chosen]
            assert sum(map(len, orbits)) == len(wanted)
            assert set[Slits]().union(*orbits) == wanted


def test_nothing_inside_leaves_one_empty_choice() -> None:
    for tree in layouts(5, inner=0):
        assert list(slit_choices(tree, foldable=False)) == [()]
        flat = not layout_of(tree).overfull_vertices
        assert list(slit_choices(tree)) == ([()] if flat else [])


@pytest.mark.parametrize("name", [n for n in CATALOGUE if not n.startswith("circle 3")])
def test_structures_fold_flat_with_the_slits_that_are_offered(name: str) -> None:
    layout = structure(name).layout
    choices = list(slit_choices(layout, up_to_symmetry=False))
    assert choices
    for slits in choices:
        ids = [v.id for v in layout.vertices]
        cells = [(ids[a], ids[c], ids[b], ids[d]) for a, c, b, d in layout.cells]
        made = make_layout(layout.vertices, cells, [(ids[a], ids[b]) for a, b in slits])
        assert not made.overfull_vertices
        assert made.slits == slits


def test_default_slits_fold_flat_where_any_do() -> None:
    for tree in (t for k in range(1, 7) for t in layouts(k)):
        layout = layout_of(tree)
        can = any(not other.overfull_vertices for other in every_combination(tree))
        assert bool(layout.overfull_vertices) == (not can)
        broken = folds_flat_with_some_slits(tree.vertices, tree.cells)
        assert (broken is None) == can
        if broken is not None:
            assert layout.overfull_vertices[0][0] in broken


def test_slits_can_be_said() -> None:
    (tree,) = layouts(3, inner=1)
    assert layout_of(tree, [("O2", "P1")]).slits == ((0, 5),)
    with pytest.raises(LayoutError, match="exactly one"):
        layout_of(tree, [])
