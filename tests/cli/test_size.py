"""`ori-deploy size` tells what every hinge needs, and fails where an actuator has less."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from ori_deploy.cli import main
from ori_deploy.files import build_from_file, save_design
from ori_deploy.files.design_file import Design

EXAMPLES = Path(__file__).parents[2] / "examples"
RIG = str(EXAMPLES / "rig_wing_dynamixel.toml")


@pytest.fixture(scope="module")
def wing(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("size") / "wing.design.json"
    spec, structure = build_from_file(EXAMPLES / "wing_naca2412.toml")
    save_design(Design("wing", spec.structure.span_m, structure), path)
    return str(path)


def run(*words: str, status: int = 0) -> str:
    result = CliRunner().invoke(main, ["size", *words])
    assert result.exit_code == status, result.output
    return result.output


def test_sizes_the_example_wing_as_the_hardware_page_does(wing: str) -> None:
    rows = json.loads(run(wing, "--rig", RIG, "--clamp", "c1.cb", "--wind", "0", "-5", "0", "--json"))
    first = rows[0]
    assert (first["hinge"], first["cell"], first["driven"], first["fold"]) == ("servo_1", "c1", "close_a", 1.0)
    assert first["crease"] == pytest.approx(1.13, abs=0.01)
    assert first["shaft"] == pytest.approx(first["crease"] / (2.0 * 0.9))
    assert first["share"] == pytest.approx(first["shaft"] / 2.0)
    assert first["margin"] == pytest.approx(1.0 / first["share"])


def test_every_row_names_hinge_and_crease(wing: str) -> None:
    lines = run(wing, "--rig", RIG).splitlines()
    for k in range(1, 5):
        assert any(f"servo_{k}" in line and f"c{k} close" in line for line in lines)


def test_an_actuator_that_is_too_weak_fails_the_command(wing: str, tmp_path: Path) -> None:
    loads = tmp_path / "loads.toml"
    loads.write_text('schema = "ori-deploy/loads/1"\nclamp = "c3.bd"\n[film]\nthickness_um = 150.0\n')
    told = run(wing, "--rig", RIG, "--loads", str(loads), status=1)
    assert "servo_3 needs" in told
    assert "has 2" in told


def test_a_loads_file_is_refused_by_key(wing: str, tmp_path: Path) -> None:
    loads = tmp_path / "loads.toml"
    loads.write_text('schema = "ori-deploy/loads/1"\n[film]\nthickness_mm = 0.1\n')
    told = run(wing, "--rig", RIG, "--loads", str(loads), status=2)
    assert "key film.thickness_mm" in told
    assert "found 'c7'" in run(wing, "--rig", RIG, "--clamp", "c7", status=2)
    assert "--film-um" in run(wing, "--rig", RIG, "--film-um", "-1", status=2)


def test_cones_are_sized_too(tmp_path: Path) -> None:
    path = tmp_path / "cone.design.json"
    spec, structure = build_from_file(EXAMPLES / "wing_tapered.toml")
    save_design(Design("cone", spec.structure.span_m, structure, r_min_m=spec.structure.r_min_m), path)
    rows = json.loads(run(str(path), "--rig", str(EXAMPLES / "rig_mock.toml"), "--json"))
    assert [row["cell"] for row in rows] == ["c1", "c2", "c3", "c4"]
    assert all(row["crease"] > 0.0 for row in rows)


def test_the_deployed_pose_alone_can_be_looked_at(wing: str, tmp_path: Path) -> None:
    whole = json.loads(run(wing, "--rig", RIG, "--json"))
    deployed = json.loads(run(wing, "--rig", RIG, "--deployed", "--json"))
    assert {row["fold"] for row in deployed} == {1.0}
    assert all(a["crease"] <= b["crease"] + 1e-12 for a, b in zip(deployed, whole, strict=True))
    told = run(wing, "--rig", RIG, "--deployed", "--plan", str(tmp_path / "none.json"), status=2)
    assert "--deployed or --plan" in told
