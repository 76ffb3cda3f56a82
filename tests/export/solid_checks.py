"""What every part has to be, and designs to try it on."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ori_deploy.design import ConeStructure, build
from ori_deploy.export.parts import Part, Parts, build_parts
from ori_deploy.export.parts_spec import PartsSpec
from ori_deploy.files import Design
from ori_deploy.profiles import Superellipse
from tests import shapes
from tests.export.designs import design as shared


def some_slow(fast: list[str], slow: list[str]) -> list[Any]:
    """Names to try, some of them only with the slow tests."""
    return [*fast, *(pytest.param(name, marks=pytest.mark.slow) for name in slow)]


WITHOUT_CLEARANCE = PartsSpec.model_validate(
    {"clearance": dict.fromkeys(("joint_mm", "slit_mm", "inner_mm", "bond_mm", "segment_mm"), 0.0)}
)


@cache
def design(name: str) -> Design:
    """A design of `designs`, or "24 cells"."""
    if name == "24 cells":
        return Design(name, 0.2, build(shapes.ring_on(Superellipse(0.2, 0.15), 24), 0.001))
    return shared(name)


def material_m3(d: Design) -> float:
    """The design's volume of material: areas by quadrature, times span; solid angles between two radii."""
    area = float(d.structure.panel_areas.sum())
    if isinstance(d.structure, ConeStructure):
        return area * (d.r_max_m**3 - d.r_min_m**3) / 3.0
    return area * d.span_m


def driven_everywhere(d: Design, crease: str = "close_a") -> dict[str, str]:
    return dict.fromkeys(d.structure.layout.cell_ids, crease)


@cache
def parts(name: str, *, plain: bool = False) -> Parts:
    """With the default spec, a servo in every cell."""
    d = design(name)
    return build_parts(d, plain=plain, driven={} if plain else driven_everywhere(d))


def assert_one_body(part: Part) -> None:
    """Closed, oriented outwards, connected: every directed edge once, and once the other way."""
    a = part.triangles
    edges = np.concatenate([a[:, [0, 1]], a[:, [1, 2]], a[:, [2, 0]]])
    n = len(part.points)
    forth, back = edges[:, 0] * n + edges[:, 1], edges[:, 1] * n + edges[:, 0]
    assert len(np.unique(forth)) == len(forth), f"{part.id}: an edge twice in one direction"
    assert np.array_equal(np.sort(forth), np.sort(back)), f"{part.id}: open"
    assert part.volume_m3 > 0.0, f"{part.id}: inside out"
    joined = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    bodies, _ = connected_components(joined, directed=False)
    assert bodies == 1, f"{part.id}: {bodies} bodies"


def assert_sound(made: Parts) -> None:
    """Every part is one body; what is missing of it is what its pockets say."""
    for part in made.parts:
        assert_one_body(part)
        taken = sum(pocket.volume_m3 for pocket in part.pockets)
        assert abs(part.plain_m3 - taken - part.volume_m3) <= 1e-9 * part.plain_m3, part.id
        assert all(pocket.volume_m3 > 0.0 for pocket in part.pockets)
