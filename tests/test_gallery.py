"""Every example that is shipped: designed, written, read again, and planned free of interference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ori_deploy.cli.steps import make_design, make_plan
from ori_deploy.files import design_data, load_plan, load_spec

EXAMPLES = Path(__file__).parents[1] / "examples"
RIG = EXAMPLES / "rig_mock.toml"
GALLERY = sorted(
    p for p in EXAMPLES.glob("*.toml") if not p.name.startswith(("mavlink", "rig_", "loads_", "parts_", "uav_"))
)
LEAST_MARGIN_DEG = 1.0
WITHOUT_WALL = {"circle_6"}
"""Shapes that show a closed form: everything else has a wall that can be built."""
QUICK = {"ellipse_4", "wing_naca2412"}
"""Planned with every test run: the others' plans take seconds each."""


def test_the_gallery_holds_what_is_promised() -> None:
    promised = {"clover_6", "heart_6", "cone_circular_6", "cone_elliptic_6", "wing_tapered"}
    assert promised | {"antenna_helix", "antenna_conical_spiral", "wing_naca2412"} <= {p.stem for p in GALLERY}
    assert {p.stem for p in GALLERY} >= QUICK


@pytest.mark.parametrize("spec", GALLERY, ids=lambda p: p.stem)
def test_an_example_is_built_written_and_read_again(spec: Path, tmp_path: Path) -> None:
    parsed = load_spec(spec)
    built, data, _ = make_design(spec, tmp_path / "shape.design.json")
    structure = built.structure
    assert np.degrees(structure.cells.dead_centre_margin.min()) >= LEAST_MARGIN_DEG
    assert structure.layout.overfull_vertices == ()
    assert (structure.cells.offset.min() > 0.0) == (spec.stem not in WITHOUT_WALL)
    assert structure.cell_areas.sum() == pytest.approx(structure.profile.area, rel=1e-9)
    assert data["packaging"]["eta"] > 1.0
    assert (parsed.strip is not None) == ("strip" in data) == spec.stem.startswith("antenna")
    assert design_data(built) == data


@pytest.mark.parametrize(
    "spec",
    [pytest.param(p, id=p.stem, marks=() if p.stem in QUICK else pytest.mark.slow) for p in GALLERY],
)
def test_an_example_is_planned_and_checked(spec: Path, tmp_path: Path) -> None:
    _, _, design_file = make_design(spec, tmp_path / "shape.design.json")
    make_plan(design_file, RIG, tmp_path / "shape.plan.json")
    plan = load_plan(tmp_path / "shape.plan.json")
    assert plan.fold[[0, -1]] == pytest.approx([0.0, 1.0])
    assert plan.check.deepest_penetration_m <= plan.check.allowed_penetration_m
    assert plan.check.smallest_clearance_m > 0.0
