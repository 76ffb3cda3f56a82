"""Files of cones: what goes in comes out, and what is wrong is refused by name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ori_deploy.design import ConeStructure
from ori_deploy.errors import FileError, InputError
from ori_deploy.files import Design, build_from_file, design_data, load_design, pose_data, save_design
from ori_deploy.motion.slits import deploys_free
from tests.cones import CONES, cone
from tests.shapes import structure

EXAMPLES = Path(__file__).parents[2] / "examples"
ROUND = (EXAMPLES / "cone_circular_6.toml").read_text()
WING = (EXAMPLES / "wing_tapered.toml").read_text()


def build_text(tmp_path: Path, text: str) -> tuple[Any, ConeStructure]:
    path = tmp_path / "spec.toml"
    path.write_text(text)
    spec, built = build_from_file(path)
    assert isinstance(built, ConeStructure)
    return spec, built


@pytest.mark.parametrize(
    ("name", "eta"), [("cone_circular_6", 4.2891), ("cone_elliptic_6", 2.9788), ("wing_tapered", 2.1317)]
)
def test_shipped_cones_have_the_figures_of_their_kind(name: str, eta: float) -> None:
    spec, built = build_from_file(EXAMPLES / f"{name}.toml")
    assert isinstance(built, ConeStructure)
    assert round(built.eta, 4) == eta
    assert spec.structure.span_m == pytest.approx(spec.structure.r_max_m - spec.structure.r_min_m)  # type: ignore[union-attr]


@pytest.mark.parametrize("name", CONES)
def test_design_survives_its_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / "x.design.json"
    save_design(Design(name, 0.7, cone(name), r_min_m=0.2), path)
    again = load_design(path)
    assert (again.name, again.span_m, again.r_min_m, again.r_max_m) == (name, 0.7, 0.2, pytest.approx(0.9))
    assert isinstance(again.structure, ConeStructure)
    assert np.allclose(again.structure.cells.crease, cone(name).cells.crease, atol=1e-12)
    assert again.structure.layout.slits == cone(name).layout.slits


@pytest.mark.parametrize("name", ["circular 6", "wing, apex above", "wing, apex below", "oblique 6"])
def test_design_file_keeps_its_contract(name: str, tmp_path: Path) -> None:
    s = cone(name)
    data = save_design(Design(name, 0.9, s, r_min_m=0.1), tmp_path / "d.json")
    assert json.loads((tmp_path / "d.json").read_text()) == data
    assert data["kind"] == "cone"
    assert (data["r_min_m"], data["r_max_m"], data["span_m"]) == (0.1, 1.0, pytest.approx(0.9))
    assert data["wall_rad"] == s.wall_rad
    apex, plane = np.array(data["apex"]), s.profile.plane_z_m
    assert apex.shape == (3,)
    base = s.profile.base
    for v in data["layout"]["vertices"]:
        assert "xy" not in v
        assert np.linalg.norm(v["xyz"]) == pytest.approx(1.0, abs=1e-14)
        # The ray from the apex meets the base's plane where the vertex was put.
        meets = apex + np.array(v["xyz"]) * (plane - apex[2]) / v["xyz"][2]
        assert meets[2] == pytest.approx(plane)
        if not v["inner"]:
            assert abs(complex(meets[0], meets[1]) - complex(base.point(v["s"]))) < 1e-12 * base.size
    axis = s.profile.to_user(s.profile.axis)
    for p in data["panels"]:
        outline = np.array(p["outline"])
        ahead = np.roll(outline, -1, axis=0)
        assert outline.shape[1] == 3
        # Counter-clockwise seen from outside, that is, from beyond the base.
        assert (np.cross(outline, ahead) @ axis).sum() > 0.0
    for c in data["cells"]:
        assert all(np.linalg.norm(v) == pytest.approx(1.0) for v in c["creases"].values())
        assert sum(c["deployed_angles_rad"].values()) > 2.0 * np.pi
    packaging = data["packaging"]
    assert sum(c["area"] for c in data["cells"]) == pytest.approx(packaging["area"], rel=1e-9)
    assert sum(p["area"] for p in data["panels"]) == pytest.approx(packaging["material_area"], rel=1e-9)
    assert packaging["eta"] == pytest.approx(packaging["area"] / packaging["material_area"], rel=1e-12)
    assert len(packaging["stack_box_m"]) == 3
    volume = packaging["area"] * (1.0**3 - 0.1**3) / 3.0
    assert packaging["box_ratio"] == pytest.approx(volume / np.prod(packaging["stack_box_m"]), rel=1e-12)
    assert packaging["material_area"] * (1.0 - 0.1**3) / 3.0 < np.prod(packaging["stack_box_m"])


@pytest.mark.parametrize("name", ["circular 6", "wing, apex above"])
def test_poses_are_rigid_motions_about_the_apex_in_the_users_coordinates(name: str) -> None:
    s = cone(name)
    n = s.layout.n_cells
    deployed = design_data(Design(name, 1.0, s))["panels"]
    for fold in (0.0, 0.4, 1.0):
        for panel, own in zip(pose_data(s, np.full(n, fold)), deployed, strict=True):
            m = np.array(panel["transform"])
            assert m.shape == (4, 4)
            assert np.allclose(m[:3, :3] @ m[:3, :3].T, np.eye(3), atol=1e-12)
            assert np.linalg.det(m[:3, :3]) == pytest.approx(1.0)
            assert np.allclose(m[:3, :3] @ s.profile.apex + m[:3, 3], s.profile.apex, atol=1e-12)
            assert np.allclose(np.array(own["outline"]) @ m[:3, :3].T, panel["outline"], atol=1e-12)
            if fold == 1.0:
                assert np.allclose(m, np.eye(4), atol=1e-9)


def test_an_edited_design_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "d.json"
    original = save_design(Design("cone", 0.9, cone("two cells"), r_min_m=0.1), path)
    for key, value in (
        ("r_max_m", 2.0),
        ("span_m", -1.0),
        ("r_min_m", 0.5),
        ("apex", [0.0, 0.0, 0.1]),
        ("apex", "here"),
        ("wall_m", 0.2),
        ("packaging", {**original["packaging"], "box_ratio": 9.9}),
        ("packaging", {**original["packaging"], "stack_box_m": [1.0]}),
        ("kind", "ball"),
    ):
        path.write_text(json.dumps({**original, key: value}))
        with pytest.raises(FileError, match=f"{key}|span_m|r_max_m"):
            load_design(path)
    for damaged in (
        {**original, "kind": "cylinder"},
        {**original, "profile": {"kind": "cone"}},
        {k: v for k, v in original.items() if k != "wall_rad"},
    ):
        path.write_text(json.dumps(damaged))
        with pytest.raises(InputError):
            load_design(path)
    data = json.loads(json.dumps(original))
    data["cells"][1]["creases"]["open_c"][0] += 1e-6
    path.write_text(json.dumps(data))
    with pytest.raises(FileError, match="recorded creases differ"):
        load_design(path)
    data = json.loads(json.dumps(original))
    data["layout"]["vertices"][0]["xyz"] = [0.0, 1.0]
    path.write_text(json.dumps(data))
    with pytest.raises(FileError, match="not a whole design"):
        load_design(path)


def test_a_cylinders_design_has_no_apex() -> None:
    data = design_data(Design("wing", 1.0, structure("wing")))
    assert data["kind"] == "cylinder"
    assert not {"apex", "r_min_m", "r_max_m", "wall_rad"} & set(data)


@pytest.mark.parametrize(
    ("keys", "radii", "wall"),
    [
        ("wall_rad = 0.01", (0.0, 1.0), 0.01),
        ("wall_m = 0.01", (0.0, 1.0), 0.01),
        ("wall_m = 0.01\nr_max_m = 0.5", (0.0, 0.5), 0.02),
        ("wall_rad = 0.01\nr_min_m = 0.2", (0.2, 1.0), 0.01),
        ("wall_m = 0.01\nspan_m = 0.4", (0.6, 1.0), 0.01),
        ("wall_m = 0.02\nspan_m = 2.0", (0.0, 2.0), 0.01),
        ("wall_rad = 0.01\nspan_m = 0.4\nr_min_m = 0.1", (0.1, 0.5), 0.01),
        ("wall_rad = 0.01\nspan_m = 0.4\nr_max_m = 3", (2.6, 3.0), 0.01),
        ("wall_rad = 0.01\nspan_m = 0.4\nr_min_m = 0.1\nr_max_m = 0.5", (0.1, 0.5), 0.01),
    ],
)
def test_radii_and_wall_may_be_told_in_several_ways(
    tmp_path: Path, keys: str, radii: tuple[float, float], wall: float
) -> None:
    head, rest = ROUND.split("[structure]")[0], ROUND.split("[layout]")[1]
    spec, built = build_text(tmp_path, f'{head}[structure]\n{keys}\n[layout]\n{rest}slits = [["P", "O1"]]\n')
    assert (spec.structure.r_min_m, spec.structure.r_max_m) == pytest.approx(radii)
    assert spec.structure.span_m == pytest.approx(radii[1] - radii[0])
    assert built.wall_rad == pytest.approx(wall)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("half_angle_rad = 0.5", "half_angle_rad = 1.6", r"too wide.*1\.6 rad.*at most 1\.5 rad.*smaller"),
        ("half_angle_rad = 0.5", "half_angle_rad = 28.6", "too wide"),
        ("half_angle_rad = 0.5", "half_angle_rad = -0.5", r"key profile\.half_angle_rad"),
        (
            "half_angle_rad = 0.5",
            "half_angle_rad = 1.4\naspect = 5.0",
            "make half_angle_rad smaller or aspect smaller",
        ),
        ("half_angle_rad = 0.5", "", "either half_angle_rad"),
        ("half_angle_rad = 0.5", "apex_m = [0.0, 0.0, 1.0]", "apex_m and base go together"),
        ("half_angle_rad = 0.5", "half_angle_rad = 0.5\nspan_m = 1.0", r"key profile\.span_m"),
        ("r_max_m = 1.0", "r_max_m = 0.05", r"0 <= r_min_m < r_max_m.*r_max_m = 0\.05"),
        ("r_max_m = 1.0", "r_max_m = 1.0\nspan_m = 0.5", "give two"),
        ("r_max_m = 1.0", 'r_max_m = "1 m"', r"key structure\.r_max_m"),
        ("r_max_m = 1.0", "r_max_m = 1.0\nspan_segments = 3", r"key structure\.span_segments"),
        ("wall_rad = 0.01", "wall_rad = 0.01\nwall_m = 0.01", "exactly one of wall_rad and wall_m"),
        ("wall_rad = 0.01", "", "exactly one of wall_rad and wall_m"),
        ("wall_rad = 0.01", "wall_rad = 0.2", r"cell c\d: .*wall"),
        ("cells = 6", "cells = 6, center_m = [0.6, 0.0]", r"vertex P: outside the profile; found \(0\.6, 0\) m"),
        ('kind = "cone"\nhalf_angle_rad = 0.5', 'kind = "ellipse"\na_m = 1.0\nb_m = 1.0', r"key structure\.r_min_m"),
    ],
)
def test_bad_cones_are_refused_by_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in ROUND
    with pytest.raises(InputError, match=message) as refused:
        build_text(tmp_path, ROUND.replace(old, new))
    assert "spec.toml" in str(refused.value)
    assert "nan" not in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[0.0625, 0.0, 3.0]", "[0.0625, 0.0, 0.0]", r"apex lies inside the profile.*z = 0 m.*move apex_m"),
        ("[0.0625, 0.0, 3.0]", "[1.0, 0.0, 0.0]", "apex lies in the plane of the profile"),
        ("[0.0625, 0.0, 3.0]", "[0.0625, 0.0]", r"key profile\.apex_m"),
        ("[0.0625, 0.0, 3.0]", "[0.0625, 0.0, 3.0]\naspect = 0.5", "aspect goes with half_angle_rad"),
        ('code = "2412"', 'code = "24"', "NACA"),
        ('kind = "naca", code = "2412"', 'kind = "cone", code = "2412"', r"profile\.base.*kind"),
        ('code = "2412", chord_m = 0.25', 'code = "2412"', r"key profile\.base\.chord_m"),
        ("xy_m = [0.11, 0.01]", "xy_m = [0.11, 0.05]", r"vertex P: outside the profile; found \(0\.11, 0\.05\) m"),
        ("x_chord = 0.68", "x_chord = 1.68", "vertex T1: x_chord: no places"),
        ("wall_m = 0.00125", "wall_m = 0.004", r"cell c\d.*rad"),
    ],
)
def test_bad_tapered_wings_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in WING
    with pytest.raises(InputError, match=message):
        build_text(tmp_path, WING.replace(old, new))


def test_ring_without_slits_gets_one_that_deploys_free(tmp_path: Path) -> None:
    _, built = build_text(tmp_path, ROUND)
    assert deploys_free(built)
