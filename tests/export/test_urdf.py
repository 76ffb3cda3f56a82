"""The URDF model loads in MuJoCo, and its links are where our own poses have the panels."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh

from ori_deploy.export.urdf import BASE
from ori_deploy.motion import CREASES
from tests.export.models import FOLDS, NAMES, Posed, bodies, own_poses, written


def numbers(given: str) -> Any:
    return np.array([float(v) for v in given.split()])


def origins_of(root: ET.Element) -> dict[str, Any]:
    """Where every link's frame stands when deployed, from the file alone."""
    origins = {BASE: np.zeros(3)}
    for joint in root.iter("joint"):
        parent, child, origin = joint.find("parent"), joint.find("child"), joint.find("origin")
        if parent is not None and child is not None and origin is not None:
            origins[child.attrib["link"]] = origins[parent.attrib["link"]] + numbers(origin.attrib["xyz"])
    return origins


@pytest.mark.parametrize("name", NAMES)
def test_links_are_where_our_own_poses_have_them(name: str, tmp_path: Path) -> None:
    made = bodies(name)
    path, model = written(made, tmp_path)
    posed = Posed(made, mujoco.MjModel.from_xml_path(str(path)))
    root = ET.fromstring(model.xml)
    origins = origins_of(root)
    names = made.skeleton.layout.panel_ids
    assert posed.model.njnt == len(made.tree.joints) == 3 * made.skeleton.layout.n_cells
    for fold in FOLDS:
        posed.put(fold)
        frames = posed.frames()
        for panel, link in enumerate(names):
            frames[panel, :3, 3] -= frames[panel, :3, :3] @ origins[link]
        np.testing.assert_allclose(frames, own_poses(made, fold), atol=1e-9)


@pytest.mark.parametrize("name", ["wing", "cone tip", "tapered"])
def test_cut_creases_meet_at_every_fold(name: str, tmp_path: Path) -> None:
    made = bodies(name)
    path, model = written(made, tmp_path)
    posed = Posed(made, mujoco.MjModel.from_xml_path(str(path)))
    loops = list(ET.fromstring(model.xml).iter("loop"))
    assert len(loops) == made.skeleton.layout.n_cells
    for fold in FOLDS:
        posed.put(fold)
        for loop in loops:
            ends = []
            for end in loop.iter("end"):
                body = posed.data.body(end.attrib["link"])
                places = [numbers(end.attrib[side]) for side in ("near", "far")]
                ends.append([body.xpos + body.xmat.reshape(3, 3) @ place for place in places])
            np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


@pytest.mark.parametrize("name", ["wing", "tapered"])
def test_meshes_are_the_panels_and_masses_theirs(name: str, tmp_path: Path) -> None:
    made = bodies(name)
    path, model = written(made, tmp_path)
    posed = Posed(made, mujoco.MjModel.from_xml_path(str(path)))
    posed.put(1.0)
    names = made.skeleton.layout.panel_ids
    assert len(model.meshes) == len(names)
    for panel, link in enumerate(names):
        assert posed.model.body(link).mass[0] == pytest.approx(made.mass_kg(panel), rel=1e-12)
        data = np.frombuffer(
            model.meshes[f"wing_meshes/{link}.stl"][84:], dtype="<f4, (3,3)<f4, <u2".replace("<f4, ", "(3,)<f4, ", 1)
        )
        corners = data["f1"].astype(float)
        volume = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
        assert volume == pytest.approx(made.volume_m3[panel], rel=1e-3)
    mujoco.mj_forward(posed.model, posed.data)
    for panel, link in enumerate(names):
        np.testing.assert_allclose(posed.data.body(link).xipos, made.centroid(panel), atol=1e-9)


@pytest.mark.parametrize("name", ["wing", "tapered", "cone elliptic"])
def test_masses_and_inertias_are_those_of_the_meshes_written(name: str, tmp_path: Path) -> None:
    """Against trimesh, from the files' triangles: singles, and the skin within the meshes' chord."""
    made = bodies(name)
    path, model = written(made, tmp_path)
    loaded = mujoco.MjModel.from_xml_path(str(path))
    for link in made.skeleton.layout.panel_ids:
        mesh = trimesh.load(tmp_path / "wing_meshes" / f"{link}.stl")
        assert mesh.is_watertight
        mesh.density = made.density_kg_m3
        body = loaded.body(link)
        assert body.mass[0] == pytest.approx(mesh.mass, rel=1e-3)
        off = np.linalg.norm(body.ipos - mesh.center_mass)
        assert off < 1e-3 * mesh.scale, link
        # About the mesh's own centroid and axes; the largest moment is the scale of what may be off.
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        tensor = turn.reshape(3, 3) @ np.diag(body.inertia) @ turn.reshape(3, 3).T
        assert np.abs(tensor - mesh.moment_inertia).max() < 3e-3 * body.inertia.max(), link
    assert model.meshes


def test_driven_creases_have_their_limits_and_gears(tmp_path: Path) -> None:
    made = bodies("wing", CREASES.index("open_c"))
    _, model = written(made, tmp_path)
    root = ET.fromstring(model.xml)
    limits = {j.attrib["name"]: j.find("limit") for j in root.findall("joint") if j.attrib["type"] == "revolute"}
    for name, limit in limits.items():
        assert limit is not None
        driven = name.endswith("open_c")
        assert (float(limit.attrib["effort"]), float(limit.attrib["velocity"])) == (
            (5.0, 2.0) if driven else (0.0, 0.0)
        )
    transmissions = list(root.iter("transmission"))
    assert len(transmissions) == 4
    assert [float(r.text or "") for r in root.iter("mechanicalReduction")] == [2.0] * 4
    assert not any(loop.attrib["crease"].endswith("open_c") for loop in root.iter("loop"))
