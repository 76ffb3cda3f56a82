"""Measures of cones and their derivatives, against structures that are built and against differences."""

from __future__ import annotations

import numpy as np
import pytest

from ori_deploy.design import ConeStructure, Embedding
from ori_deploy.profiles import Cone
from ori_deploy.profiles.profile import Reals
from ori_deploy.search import Wish, solve
from ori_deploy.search.cone_measures import ConeMeasurer
from ori_deploy.search.measures import Measures, Unknowns
from tests.cones import CONES, cone

STEP = 1e-6


def unknowns_of(built: ConeStructure) -> tuple[Unknowns, Reals]:
    """A structure's own unknowns: vertices in the base's plane, raises and wall over the cone's size."""
    shape = built.profile
    unknowns = Unknowns(shape.base, built.layout)
    x = unknowns.pack(built.embedding.s, shape.onto_base(built.embedding.u), built.wall_rad / shape.size)
    raised = built.cells.offset[:, 0] - built.wall_rad - built.opening.dip.reshape(-1, 2)[:, 0]
    x[unknowns.n_places : unknowns.wall] = raised / shape.size
    return unknowns, x


def measured(built: ConeStructure, unknowns: Unknowns, x: Reals) -> Measures:
    found = ConeMeasurer(unknowns, built.profile)(unknowns.of_cells(x), np.arange(built.layout.n_cells))
    assert found is not None
    return found


@pytest.mark.parametrize("name", CONES)
def test_measures_are_those_of_the_structure(name: str) -> None:
    built = cone(name)
    unknowns, x = unknowns_of(built)
    found = measured(built, unknowns, x)
    size = built.profile.size
    assert np.abs(found.material.value - built.panel_areas).max() <= 1e-12 * built.profile.solid_angle
    assert np.abs(found.cells.dead_centre_margin.value - built.cells.dead_centre_margin).max() <= 1e-11  # type: ignore[union-attr]
    assert np.abs(found.cells.face.value - built.cells.face).max() <= 1e-11 * size  # type: ignore[union-attr]
    assert np.abs(found.thickness.value - built.cells.rim - built.cells.offset).max() <= 1e-11 * size


@pytest.mark.parametrize("name", CONES)
def test_derivatives_are_those_of_differences(name: str) -> None:
    built = cone(name)
    unknowns, x = unknowns_of(built)
    direction = np.random.default_rng(1).normal(size=unknowns.count)
    # In a corner of the outline a vertex has a derivative on either side.
    outline = np.flatnonzero(~unknowns.inner)
    for i in outline:
        away = np.abs(built.profile.base.breaks - built.embedding.s[i] % built.profile.period)
        if away.min() < 1e-3 * built.profile.period:
            direction[unknowns.column[i, 0]] = 0.0
    here = measured(built, unknowns, x)
    ahead = measured(built, unknowns, x + STEP * direction)
    behind = measured(built, unknowns, x - STEP * direction)
    along = np.append(direction, 0.0)[unknowns.local]

    def blocks(m: Measures) -> list[object]:
        return [m.material.reshape(-1, 4), m.cells.dead_centre_margin, m.cells.face, m.raised, m.length, m.thickness]

    for now, later, earlier in zip(blocks(here), blocks(ahead), blocks(behind), strict=True):
        difference = (later.value - earlier.value) / (2.0 * STEP)  # type: ignore[attr-defined]
        slope = np.einsum("ikm,im->ik", now.slope, along)  # type: ignore[attr-defined]
        assert np.abs(slope - difference).max() <= 1e-6 * max(1.0, np.abs(difference).max())


def test_an_optimum_is_better_than_its_start_and_keeps_its_bounds() -> None:
    built = cone("elliptic 6")
    shape = built.profile
    start = Embedding(shape.base, built.layout, built.embedding.s, shape.onto_base(built.embedding.u))
    found = solve(shape, built.layout, built.wall_rad, Wish(margin_rad=0.1), start=start)
    assert isinstance(found.structure, ConeStructure)
    assert found.settled
    assert found.eta > 1.1 * built.eta
    assert found.structure.cells.dead_centre_margin.min() >= 0.1
    assert found.structure.cells.offset.min() >= built.wall_rad - 1e-12


def test_equal_cells_of_a_circular_cone_are_an_optimum() -> None:
    built = cone("circular 6")
    shape = built.profile
    start = Embedding(shape.base, built.layout, built.embedding.s, shape.onto_base(built.embedding.u))
    assert solve(shape, built.layout, built.wall_rad, start=start).eta == pytest.approx(built.eta, rel=1e-9)


@pytest.mark.slow
def test_a_narrow_cone_has_the_optimum_of_its_cylinder() -> None:
    built = cone("elliptic 6")
    base = built.profile.base
    flat = solve(base, built.layout, 0.01 * base.size, start=0).eta
    errors = []
    for distance in (10.0, 20.0, 40.0):
        far = Cone(base, (0.0, 0.0, -distance * base.size))
        errors.append(abs(solve(far, built.layout, 0.01 * far.size, start=0).eta - flat))
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]
