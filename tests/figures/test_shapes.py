"""The data of Figs. 3 and 5, and tables."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.design import build
from ori_deploy.errors import MotionError
from ori_deploy.figures import PROTOTYPES, prototype_table, shipped_prototype, wing, wing_of, wing_vertex_table
from ori_deploy.figures.prototypes import prototype
from ori_deploy.figures.table import Table
from ori_deploy.figures.wing import PLAIN, SPARRED, vertical_spars, wing_summary_table
from ori_deploy.files.shipped import shipped
from ori_deploy.profiles import Superellipse
from tests.shapes import ring_on, structure

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_prototypes_are_those_of_the_paper() -> None:
    built = [shipped_prototype(name) for name, _ in PROTOTYPES]
    assert [p.design.entries.kind for p in built] == ["cylinder", "cylinder", "cone", "cone"]
    table = prototype_table(built)
    for row, p in zip(table.rows, built, strict=True):
        told = dict(zip(table.columns, row, strict=True))
        assert told["eta"] == pytest.approx(p.design.structure.profile.area / p.design.structure.panel_areas.sum())
        assert told["wall_m"] > 0.0  # type: ignore[operator]
        assert told["smallest_margin_rad"] > np.radians(1.0)  # type: ignore[operator]
        assert (EXAMPLES / str(told["specification"])).exists()


def test_the_wing_has_two_spars_from_skin_to_skin() -> None:
    found = wing(SPARRED)
    assert len(found.spars) == 2
    z, s = found.structure.embedding.z, found.structure.embedding.s
    for spar in found.spars:
        assert np.ptp(z[list(spar)].real) <= 1e-9 * found.structure.profile.size
        assert np.isfinite(s[[spar[0], spar[-1]]]).all()
    rows = wing_vertex_table(found).rows
    assert sorted(row[-1] for row in rows if row[-1]) == sorted(
        k for k, spar in enumerate(found.spars, 1) for _ in spar
    )


def test_the_plain_wing_folds_to_a_third_of_its_span() -> None:
    found = wing(PLAIN)
    assert found.spars == ()
    assert found.refused == ""
    assert found.folding is not None
    told = dict(wing_summary_table(found, found).rows)  # type: ignore[arg-type]
    assert told["segment_length_m"] == pytest.approx(found.built.design.span_m / 3.0)
    assert told["stowed_length_m"] == pytest.approx(told["segment_length_m"])


def test_a_wing_without_room_for_hinges_says_so() -> None:
    found = wing(SPARRED)
    assert (found.folding is None) == bool(found.refused)
    told = dict(wing_summary_table(found, found).rows)  # type: ignore[arg-type]
    assert ("stowed_length_m" in told) == (found.folding is not None)


def test_a_cone_is_no_wing() -> None:
    with pytest.raises(MotionError, match="cone"):
        wing_of(prototype("cone", shipped("cone_circular_6.toml")))


def test_spars_are_found_where_inner_edges_stand_upright() -> None:
    # Opening vertices O1 .. O4 at 0, 90, 180, 270 degrees: O2-P-O4 stands upright, O1-P-O3 lies.
    upright = build(ring_on(Superellipse(1.0, 0.6), 4, phase=0.0), 0.0)
    ids = [v.id for v in upright.layout.vertices]
    assert [{ids[v] for v in spar} for spar in vertical_spars(upright)] == [{"O2", "P", "O4"}]
    assert vertical_spars(structure("ellipse 4")) == ()


VALUES = st.one_of(
    st.floats(allow_nan=False), st.integers(), st.text(st.characters(codec="ascii", exclude_characters="\r\0"))
)


@given(st.lists(st.tuples(VALUES, VALUES), max_size=8))
def test_numbers_in_a_table_read_back_as_what_they_are(rows: list[tuple[float | int | str, ...]]) -> None:
    read = list(csv.reader(io.StringIO(Table(("a", "b"), rows).csv())))
    assert read[0] == ["a", "b"]
    for got, given_row in zip(read[1:], rows, strict=True):
        for text, value in zip(got, given_row, strict=True):
            assert (float(text) if isinstance(value, float) else text) == (
                value if isinstance(value, float) else str(value)
            )


def test_a_table_leaves_nan_empty_and_refuses_ragged_rows() -> None:
    assert Table(("a", "b"), [(float("nan"), True), (1.5, False)]).csv() == "a,b\n,yes\n1.5,no\n"
    with pytest.raises(ValueError, match="2 values under 1"):
        Table(("a",), [(1, 2)]).csv()
