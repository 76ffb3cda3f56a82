"""The span in specification, design and plan files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ori_deploy.errors import FileError, InputError
from ori_deploy.files import Design, build_from_file, load_design, load_plan, save_design, save_plan
from ori_deploy.motion import Mechanism, SpanFolding, plan_span
from tests.deploy.synthetic import synthetic_plan
from tests.shapes import structure

EXAMPLE = Path(__file__).parents[2] / "examples" / "wing_span_3.toml"


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("span") / "wing.design.json"
    spec, built = build_from_file(EXAMPLE)
    save_design(Design("wing", spec.structure.span_m, built, span_segments=spec.structure.span_segments), path)
    return path


def test_the_example_is_stowed_in_a_third_of_its_span(designed: Path) -> None:
    data = json.loads(designed.read_text())
    span, box = data["span"], data["packaging"]["stack_box_m"]
    assert span["segments"] == 3
    assert span["segment_length_m"] == pytest.approx(data["span_m"] / 3.0)
    assert sorted(span["stowed_box_m"]) == pytest.approx(sorted([box[0], 3.0 * box[1], 1.26 / 3.0]))
    volume = data["packaging"]["area"] * data["span_m"]
    assert span["stowed_box_ratio"] == pytest.approx(volume / np.prod(span["stowed_box_m"]))
    assert [hinge["panel"] for hinge in span["hinges"]] == ["c1.da", "c2.ac"]
    assert load_design(designed).span_segments == 3


def test_a_span_in_one_piece_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    data = save_design(Design("wing", 1.0, structure("wing")), tmp_path / "a.design.json")
    assert "span" not in data
    assert load_design(tmp_path / "a.design.json").span_segments == 1


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda span: span.update(segments=2), "span.stowed"),
        (lambda span: span.update(segments="3"), "span.segments"),
        (lambda span: span.update(segments=1), "span.segments"),
        (lambda span: span.update(stowed_box_ratio=9.0), "span.stowed_box_ratio"),
        (lambda span: span.pop("stowed_box_m"), "span.stowed_box_m"),
    ],
)
def test_an_edited_span_is_refused(
    designed: Path, tmp_path: Path, edit: Callable[[dict[str, Any]], object], message: str
) -> None:
    data = json.loads(designed.read_text())
    edit(data["span"])
    path = tmp_path / "edited.design.json"
    path.write_text(json.dumps(data))
    with pytest.raises(FileError, match=message):
        load_design(path)


@pytest.mark.parametrize("value", ["0", "-2", "101", "1.5", '"3"'])
def test_a_specification_says_a_whole_number_of_segments(tmp_path: Path, value: str) -> None:
    path = tmp_path / "wing.toml"
    path.write_text(EXAMPLE.read_text().replace("span_segments = 3", f"span_segments = {value}"))
    with pytest.raises(InputError, match="span_segments"):
        build_from_file(path)


@pytest.fixture
def planned(tmp_path: Path) -> Path:
    folding = SpanFolding(Mechanism(structure("wing")), 5.0, 4)
    path = tmp_path / "wing.plan.json"
    save_plan(replace(synthetic_plan(), span=plan_span(folding, 1.0, 1.0, 100.0)), path)
    return path


def test_a_plan_keeps_its_span_stage(planned: Path) -> None:
    again = load_plan(planned).span
    want = plan_span(SpanFolding(Mechanism(structure("wing")), 5.0, 4), 1.0, 1.0, 100.0)
    assert again is not None
    assert want is not None
    assert np.array_equal(again.angles_rad, want.angles_rad)
    assert np.array_equal(again.time_s, want.time_s)
    assert replace(again, angles_rad=want.angles_rad, time_s=want.time_s) == want
    assert json.loads(planned.read_text())["stages"] == {
        "deploy": ["unlock", "span_unfold", "open", "latch"],
        "stow": ["unlatch", "close", "span_fold", "lock"],
    }


@pytest.mark.parametrize(
    "edit",
    [
        lambda plan: plan.pop("span"),  # the cells of a folded span would open
        lambda plan: plan["stages"].update(deploy=["unlock", "open", "latch"]),
        lambda plan: plan.pop("stages"),
        lambda plan: plan["span"].update(segments=3),
        lambda plan: plan["span"].update(hinge_ids=["h1"]),
        lambda plan: plan["span"]["angles_rad"].pop(),
        lambda plan: plan["span"].update(angles_rad=plan["span"]["angles_rad"][::-1]),
        lambda plan: plan["span"].update(time_s=[[t] for t in plan["span"]["time_s"]]),
        lambda plan: plan["span"].update(stowed_box_m=[1.0]),
        lambda plan: plan["span"].pop("free_orders"),
    ],
)
def test_a_damaged_span_stage_is_refused(planned: Path, edit: Callable[[dict[str, Any]], object]) -> None:
    data = json.loads(planned.read_text())
    edit(data)
    planned.write_text(json.dumps(data))
    with pytest.raises(FileError, match=r"span|stages|not a whole plan"):
        load_plan(planned)
