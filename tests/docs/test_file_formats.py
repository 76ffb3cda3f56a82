"""`ori-deploy schema` and the readers agree: on the shipped files, on written ones, and on what neither takes."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from click.testing import CliRunner
from jsonschema import Draft202012Validator

from ori_deploy.actuators.rig import load_rig
from ori_deploy.cli.commands import main as program
from ori_deploy.cli.schema import DIALECT, KINDS, model_of, schema_of
from ori_deploy.cli.steps import make_design
from ori_deploy.errors import InputError
from ori_deploy.export.parts_spec import load_parts_spec
from ori_deploy.files import (
    design_data,
    load_aircraft,
    load_design,
    load_graph,
    load_loads,
    load_plan,
    load_spec,
    load_sweep,
    save_plan,
)
from ori_deploy.files.plan_file import plan_data
from ori_deploy.mav.settings import load_settings
from ori_deploy.motion import MotionCheck, Plan, StepTolerance
from ori_deploy.motion.plan import SpanStage

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
PAGE = (ROOT / "docs" / "file-formats.md").read_text()
READERS: dict[str, Callable[[Path], object]] = {
    "aircraft": load_aircraft,
    "design": load_design,
    "graph": load_graph,
    "loads": load_loads,
    "mavlink": load_settings,
    "parts": load_parts_spec,
    "plan": load_plan,
    "rig": load_rig,
    "spec": load_spec,
    "sweep": load_sweep,
}


def faults(kind: str, data: object) -> list[str]:
    """What the schema has against a file."""
    return [f"{e.json_path}: {e.message}" for e in Draft202012Validator(schema_of(kind)).iter_errors(data)]


def small_plan() -> Plan:
    """Two poses of two cells, and a span in two."""
    table = np.array([[[3.0, 3.0, 0.0, 0.0]] * 2, [[1.0, 1.0, 2.0, 2.0]] * 2])
    check = MotionCheck(2, 0.0, 1e-5, 1e-4, (0.05, 0.95), ("c1.ac", "c2.da"), 0.95)
    span = SpanStage(
        2, ("h1",), np.array([0.0, 1.0]), np.array([[np.pi], [0.0]]), ("in_step",), 0.0, 1e-5, (1.0, 1.0, 1.0)
    )
    steps = StepTolerance(np.array([0.0, 1.0]), np.array([1.0, 0.02]), 0.98, 1e-4)
    return Plan(
        "0" * 64, "two", ("c1", "c2"), 1.0, np.array([0.0, 1.0]), np.array([0.0, 1.0]), table, 0.0 * table, table,
        steps, ("cell:c1", "cell:c2"), check, span,
    )  # fmt: skip


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_kind_prints_a_schema_that_is_one(kind: str) -> None:
    printed = CliRunner().invoke(program, ["schema", kind])
    told = json.loads(printed.output)
    Draft202012Validator.check_schema(told)
    assert told["$schema"] == DIALECT == Draft202012Validator.META_SCHEMA["$id"]
    assert told["properties"]["schema"]["const"] == f"ori-deploy/{kind}/1" == told["title"]
    assert "schema" in told["required"]


def test_every_shipped_file_fits_the_schema_of_its_kind() -> None:
    seen = set()
    for path in sorted(EXAMPLES.glob("*.toml")):
        data = tomllib.loads(path.read_text())
        kind = data["schema"].split("/")[1]
        seen.add(kind)
        assert not faults(kind, data), path
    assert seen >= {"spec", "rig", "loads", "mavlink", "aircraft"}


def test_the_blocks_of_the_specification_page_fit() -> None:
    page = (ROOT / "docs" / "specification.md").read_text()
    blocks = [tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", page, re.DOTALL)]
    found = {data["schema"].split("/")[1]: data for data in blocks if "schema" in data}
    assert found.keys() >= {"spec", "graph"}
    assert not [fault for kind, data in found.items() for fault in faults(kind, data)]


@pytest.mark.parametrize("name", ["wing_span_3", "antenna_helix", "antenna_conical_spiral"])
def test_what_is_written_of_a_design_is_what_its_schema_says(name: str, tmp_path: Path) -> None:
    design, data, _ = make_design(EXAMPLES / f"{name}.toml", tmp_path / "d.json")
    assert not faults("design", data)
    assert told_again("design", data) == data
    assert design_data(design) == data


def test_what_is_written_of_a_plan_is_what_its_schema_says(tmp_path: Path) -> None:
    plan = small_plan()
    save_plan(plan, tmp_path / "p.json")
    assert load_plan(tmp_path / "p.json").duration_s == 1.0
    data = json.loads((tmp_path / "p.json").read_text())
    assert not faults("plan", data)
    assert told_again("plan", data) == data


def told_again(kind: str, data: dict[str, Any]) -> Any:
    """A file through the class that reads it, and back: it loses every key that the class does not know."""
    read = model_of(kind).model_validate(data)
    return json.loads(read.model_dump_json(by_alias=True, exclude_unset=True))


BREAKS: dict[str, Callable[[dict[str, Any]], object]] = {
    "aircraft": lambda d: d["cruise"].update(speed_m_s=-1.0),
    "design": lambda d: d["packaging"].pop("eta"),
    "graph": lambda d: d["vertex"][0].update(role="hinge"),
    "loads": lambda d: d["film"].update(thickness_um="thick"),
    "mavlink": lambda d: d.update(system_id=0),
    "parts": lambda d: d.setdefault("print", {}).update(wall_mm=-1.0),
    "plan": lambda d: d["crease_angles_rad"][0][0].pop(),
    "rig": lambda d: d["controller"].update(path_tolerance_rad=3.0),
    "spec": lambda d: d["structure"].update(wall_mm=1.0),
    "sweep": lambda d: d.update(seed=-1),
}


def whole(kind: str, folder: Path) -> Any:
    """A file of each kind that is as it should be."""
    if kind == "design":
        return make_design(EXAMPLES / "ellipse_6.toml", folder / "d.json")[1]
    if kind == "plan":
        return json.loads(json.dumps(plan_data(small_plan())))
    shipped: dict[str, str] = {
        "aircraft": "uav_table1",
        "loads": "loads_wing",
        "mavlink": "mavlink",
        "rig": "rig_wing_explicit",
        "spec": "wing_naca2412",
    }
    if kind in shipped:
        data = tomllib.loads((EXAMPLES / f"{shipped[kind]}.toml").read_text())
        if kind == "aircraft":
            del data["wing"]["design"]  # a file beside it
        return data
    if kind == "graph":
        ids = ("A", "B", "C", "D")
        places = ((0, 0), (1, 0), (1, 1), (0, 1))
        corners = [{"id": name, "xy": list(place)} for name, place in zip(ids, places, strict=True)]
        edges = [list(pair) for pair in zip(ids, "BCDA", strict=True)]
        return {"schema": "ori-deploy/graph/1", "edges": edges, "vertex": corners}
    return {"schema": f"ori-deploy/{kind}/1", **({"grid": {}} if kind == "sweep" else {})}


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_what_the_schema_refuses_the_reader_refuses_by_the_key(kind: str, tmp_path: Path) -> None:
    data = whole(kind, tmp_path)
    assert not faults(kind, data)
    READERS[kind](written(data, kind, tmp_path / "whole"))
    broken = copy.deepcopy(data)
    BREAKS[kind](broken)
    assert faults(kind, broken)
    with pytest.raises(InputError) as refused:
        READERS[kind](written(broken, kind, tmp_path / "broken"))
    changed = {"design": "eta", "plan": "crease_angles_rad", "spec": "wall_mm", "graph": "role"}
    assert changed.get(kind, "") in str(refused.value)


def written(data: dict[str, Any], kind: str, stem: Path) -> Path:
    path = stem.with_suffix(".json" if kind in ("design", "plan", "graph") else ".toml")
    path.write_text(json.dumps(data) if path.suffix == ".json" else tomli_w.dumps(data))
    return path


def test_a_rig_may_not_say_where_it_came_from() -> None:
    data = whole("rig", ROOT)
    assert faults("rig", {**data, "source": "elsewhere"})
    assert faults("rig", {**data, "sha256": ""})


def test_the_page_has_every_kind_and_its_reader() -> None:
    rows = dict(re.findall(r"^\| `([a-z]+)` \| `ori-deploy/\1/1` \| [^|]* \| `(\w+)` \|", PAGE, re.MULTILINE))
    assert rows == {kind: reader.__name__ for kind, reader in READERS.items()}
    assert rows.keys() == KINDS.keys()
