"""Cones on the command line: every step from specification to report."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.test_commands import EXAMPLES, run

RIG = EXAMPLES / "rig_mock.toml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A design, a plan and a log of the circular cone."""
    where = tmp_path_factory.mktemp("cone")
    for words in (
        ("design", EXAMPLES / "cone_circular_6.toml", "-o", "c.design.json"),
        ("plan", "c.design.json", "--rig", RIG, "-o", "c.plan.json"),
        ("deploy", "c.plan.json", "--rig", RIG, "--log", "run.mcap"),
        ("report", "run.mcap", "--design", "c.design.json", "--plan", "c.plan.json", "-o", "c.html"),
    ):
        done = run(*words, cwd=where)
        assert done.returncode == 0, done.stderr
    return where


@pytest.mark.slow  # a cone's interference, and a report of it
def test_every_step_leaves_its_file(folder: Path) -> None:
    design = json.loads((folder / "c.design.json").read_text())
    assert design["kind"] == "cone"
    assert design["packaging"]["eta"] == pytest.approx(4.2891, abs=5e-5)
    plan = json.loads((folder / "c.plan.json").read_text())
    assert plan["check"]["deepest_penetration_m"] <= plan["check"]["allowed_penetration_m"]
    # Flat: closing creases at 0, opening ones at 180 degrees.
    start = np.array(plan["crease_angles_rad"][0])
    assert np.degrees(np.abs(start[:, 2:])).max() < 1e-6
    assert np.degrees(np.abs(np.pi - start[:, :2])).max() < 1e-6
    assert "m from the apex" in (folder / "c.html").read_text()


@pytest.mark.slow  # with the design of the test before
def test_poses_tell_rotations_about_the_apex(folder: Path) -> None:
    told = run("poses", "c.design.json", "--fold", "0.3", cwd=folder)
    assert told.returncode == 0, told.stderr
    assert len(told.stdout.splitlines()) == 24
    assert "through the apex" in told.stdout
    panels = json.loads(run("poses", "c.design.json", "--fold", "0.3", "--json", cwd=folder).stdout)
    assert np.array(panels[5]["transform"]).shape == (4, 4)
    assert np.allclose(np.linalg.norm(panels[5]["outline"], axis=1), 1.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("half_angle_rad = 0.5", "half_angle_rad = 1.6", "too wide"),
        (
            "half_angle_rad = 0.5",
            'apex_m = [0, 0, 0]\nbase = { kind = "ellipse", a_m = 1.0, b_m = 1.0 }',
            "inside the",
        ),
        ("wall_rad = 0.01", "wall_rad = 0.3", "cell c"),
    ],
)
def test_bad_cones_end_with_one_line_and_status_2(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = (EXAMPLES / "cone_circular_6.toml").read_text()
    assert old in text
    (tmp_path / "bad.toml").write_text(text.replace(old, new))
    done = run("design", "bad.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert message in done.stderr
    assert "bad.toml" in done.stderr
    assert not list(tmp_path.glob("*.json"))
