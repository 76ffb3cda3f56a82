"""Layouts with spars: every chain that can stand upright, and how many cells it takes."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from ori_deploy.errors import LayoutError
from ori_deploy.layout import Layout, layout_of, layouts
from ori_deploy.search.spars import chains_of, refuse_too_few_cells, spar_start, sparred_layouts
from ori_deploy.search.wish import Wish
from tests.search.cases import WING


def chains_by_trial(layout: Layout) -> set[frozenset[int]]:
    """Every set of two or three vertices, judged by what a straight chain is; slow, and looks at cells only."""
    cells = [list(cell) for cell in layout.cells]
    inner = [v.inner for v in layout.vertices]

    def sharing(i: int, j: int) -> int:
        return sum(1 for cell in cells if i in cell and j in cell and (cell.index(i) - cell.index(j)) % 2 == 1)

    found: set[frozenset[int]] = set()
    for i, j in combinations(range(len(inner)), 2):
        if sharing(i, j) == 2 and not inner[i] and not inner[j]:
            found.add(frozenset((i, j)))
    for p in range(len(inner)):
        if not inner[p]:
            continue
        ends = [i for i in range(len(inner)) if i != p and sharing(i, p) == 2]
        for i, j in combinations(ends, 2):
            # No cell has the whole straight line on one of its corners: two cells or more on each side.
            if not any({i, p, j} <= set(cell) for cell in cells):
                found.add(frozenset((i, p, j)))
    return found


@pytest.mark.parametrize("k", [2, 3, 4, 5, 6])
def test_chains_are_those_of_a_slow_search(k: int) -> None:
    for tree in layouts(k):
        layout = layout_of(tree)
        chains = chains_of(layout)
        assert len({frozenset(c) for c in chains}) == len(chains)
        assert {frozenset(c) for c in chains} == chains_by_trial(layout)


@pytest.mark.parametrize("n_spars", [1, 2])
def test_too_few_cells_names_the_number_that_is_enough(n_spars: int) -> None:
    enough = next(k for k in range(1, 10) if next(sparred_layouts(k, n_spars), None) is not None)
    assert enough > 3
    for k in range(2, enough):
        told = refuse_too_few_cells(k, n_spars)
        assert isinstance(told, LayoutError)
        assert told.remedy == f"--cells {enough}"
        assert f"at least {enough} cells" in str(told)


def test_spars_stand_one_behind_the_other_and_upright_at_the_start() -> None:
    seen = 0
    for wanted in sparred_layouts(6, 2, locked=False):
        for start in (0, 3):
            place = spar_start(WING, wanted, start, 5)
            xs = [place.z[list(chain)].real for chain in wanted.chains]
            for chain, x in zip(wanted.chains, xs, strict=True):
                assert np.ptp(x) < 0.02  # to the step of the outline's table: pins do the rest
                assert place.z[chain[0]].imag > place.z[chain[-1]].imag
            assert xs[0].mean() < xs[1].mean()
            assert abs(place.z[wanted.tail] - WING.point(0.0)) < 1e-12
            loop = list(place.layout.outline)
            ahead = np.diff(place.s[loop], append=place.s[loop[0]]) % WING.period
            assert ahead.sum() == pytest.approx(WING.period)
            Wish(pins=wanted.pins).check(wanted.layout, WING)
        seen += 1
        if seen == 40:
            break
    assert seen > 5
