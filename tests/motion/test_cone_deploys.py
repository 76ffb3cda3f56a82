"""A cone from its specification to a stowed structure, on the command line, with the rig that fits any design."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.test_commands import EXAMPLES, run

SPEC = """schema = "ori-deploy/spec/1"
[profile]
kind = "cone"
half_angle_rad = 0.5
aspect = 0.7
[structure]
r_min_m = 0.1
r_max_m = 0.4
wall_m = 0.004
[layout]
ring = { cells = 3, center_m = [0.0, 0.0] }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a cone's design and plan."""
    made = tmp_path_factory.mktemp("cone")
    (made / "cone.toml").write_text(SPEC)
    for words in (
        ("design", "cone.toml", "-o", "cone.design.json"),
        ("plan", "cone.design.json", "--rig", EXAMPLES / "rig_mock.toml", "-o", "cone.plan.json"),
    ):
        done = run(*words, cwd=made)
        assert done.returncode == 0, done.stderr
    return made


@pytest.mark.slow
@pytest.mark.parametrize(("command", "state"), [("deploy", "deployed"), ("stow", "stowed")])
def test_a_cone_deploys_and_stows(folder: Path, command: str, state: str) -> None:
    done = run(command, "cone.plan.json", "--rig", EXAMPLES / "rig_mock.toml", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert f"{command}: succeeded" in done.stdout
    assert f"state {state}" in done.stdout


@pytest.mark.slow
def test_its_plan_tells_metres_at_the_outer_radius(folder: Path) -> None:
    design, plan = (json.loads((folder / f"cone.{kind}.json").read_text()) for kind in ("design", "plan"))
    assert design["r_max_m"] == 0.4
    assert plan["check"]["allowed_penetration_m"] == pytest.approx(0.4 * 1.0 * 1e-4, rel=1e-9)


@pytest.mark.slow
def test_its_poses_are_motions_of_space_about_the_apex(folder: Path) -> None:
    told = json.loads(run("poses", "cone.design.json", "--fold", "0.4", "--json", cwd=folder).stdout)
    design = json.loads((folder / "cone.design.json").read_text())
    apex = np.append(design["apex"], 1.0)
    for panel, deployed in zip(told, design["panels"], strict=True):
        matrix = np.array(panel["transform"])
        assert matrix.shape == (4, 4)
        assert np.allclose(matrix @ apex, apex)
        assert np.allclose(np.linalg.norm(panel["outline"], axis=1), 1.0)
        assert np.allclose(np.array(deployed["outline"]) @ matrix[:3, :3].T, panel["outline"])
