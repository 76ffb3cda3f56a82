"""MuJoCo reads the model, and puts every panel where we have it; loops hold while motors pull."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh

from ori_deploy.export.bodies import LEAST_KG, LEAST_KG_M2, Bodies, Drive, plain_meshes
from ori_deploy.export.mjcf import mjcf_text, write_mjcf
from ori_deploy.export.tree import tree_of
from ori_deploy.files import Design
from ori_deploy.motion import CREASES
from tests.cones import cone as shared_cone
from tests.export.designs import design
from tests.export.models import FOLDS, NAMES, Posed, bodies, own_poses, written
from tests.shapes import wing


def loaded(made: Bodies) -> Posed:
    return Posed(made, mujoco.MjModel.from_xml_string(mjcf_text(made)))


@pytest.mark.parametrize("name", NAMES)
def test_panels_are_where_our_own_poses_have_them(name: str) -> None:
    posed = loaded(bodies(name))
    rng = np.random.default_rng(5)
    for fold in (*FOLDS, rng.uniform(0.3, 1.0, posed.bodies.skeleton.layout.n_cells)):
        posed.put(fold)
        np.testing.assert_allclose(posed.frames(), own_poses(posed.bodies, fold), atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_loops_close_at_every_fold(name: str) -> None:
    posed = loaded(bodies(name))
    n = posed.bodies.skeleton.layout.n_cells
    assert posed.model.neq == 2 * n
    assert posed.model.njnt == 3 * n
    for fold in FOLDS:
        posed.put(fold)
        mujoco.mj_forward(posed.model, posed.data)
        assert np.abs(posed.data.efc_pos[: posed.data.ne]).max() < 1e-9


@pytest.mark.parametrize("crease", range(4))
def test_no_driven_crease_is_cut(crease: int) -> None:
    layout = design("two inner vertices").structure.layout
    tree = tree_of(layout, [crease] * layout.n_cells)
    assert all(loop.crease != crease for loop in tree.loops)
    assert sorted(hang.panel for hang in tree.hangs) == list(range(1, layout.n_panels))
    joints = {(hang.cell, hang.crease) for hang in tree.joints} | {(loop.cell, loop.crease) for loop in tree.loops}
    assert len(joints) == 4 * layout.n_cells


def test_masses_are_those_of_the_panels_and_meshes_lie_on_them() -> None:
    for name in ("wing", "cone elliptic"):
        made = bodies(name)
        model = loaded(made).model
        structure = made.design.structure
        cubed = made.design.span_m
        if name.startswith("cone"):
            cubed = (made.design.r_max_m**3 - made.design.r_min_m**3) / 3.0
        for panel, area in zip(structure.layout.panel_ids, structure.panel_areas, strict=True):
            assert model.body(panel).mass[0] == pytest.approx(300.0 * area * cubed, rel=1e-12)
        for panel, mesh in enumerate(made.meshes):
            assert mesh is not None
            corners = mesh.vertices[mesh.faces]
            six = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum()
            assert six / 6.0 == pytest.approx(made.volume_m3[panel], rel=1e-9)


@pytest.mark.parametrize("name", ["wing", "cone elliptic"])
def test_inertias_are_those_of_the_meshes(name: str) -> None:
    """Against trimesh, from the triangles that the model shows."""
    made = bodies(name)
    model = loaded(made).model
    for panel, link in enumerate(made.skeleton.layout.panel_ids):
        shown = made.meshes[panel]
        assert shown is not None
        mesh = trimesh.Trimesh(shown.vertices, shown.faces)
        mesh.density = made.density_kg_m3
        body = model.body(link)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        tensor = turn.reshape(3, 3) @ np.diag(body.inertia) @ turn.reshape(3, 3).T
        assert body.mass[0] == pytest.approx(mesh.mass, rel=1e-3)
        assert np.linalg.norm(body.ipos - mesh.center_mass) < 1e-3 * mesh.scale, link
        assert np.abs(tensor - mesh.moment_inertia).max() < 3e-3 * body.inertia.max(), link


SIZES = (0.003, 0.05, 1.0, 30.0)


@pytest.mark.parametrize("kg_m3", [0.0, 300.0])
@pytest.mark.parametrize("kind", ["cylinder", "cone"])
def test_models_of_every_size_and_density_are_read(kind: str, kg_m3: float, tmp_path: Path) -> None:
    """Sections and spans of millimetres and of tens of metres; nothing weighs less than MuJoCo takes."""
    cone = shared_cone("elliptic 6")
    for k, (size, span) in enumerate(product(SIZES, SIZES)):
        if kind == "cylinder":
            d = Design("sized", span, wing(0.005, chord=size))
        else:
            d = Design("sized", span, cone, r_min_m=size)
        drives = tuple(Drive(f"servo_{c + 1}", 0, 5.0, 2.0) for c in range(d.structure.layout.n_cells))
        made = Bodies(d, plain_meshes(d), kg_m3, drives)
        (tmp_path / f"{k}").mkdir()
        path, _ = written(made, tmp_path / f"{k}")
        for model in (loaded(made).model, mujoco.MjModel.from_xml_path(str(path))):
            assert (model.body_mass[-d.structure.layout.n_panels :] >= LEAST_KG * (1.0 - 1e-12)).all()
            assert (model.body_inertia[-d.structure.layout.n_panels :] >= LEAST_KG_M2 * (1.0 - 1e-3)).all()


def test_only_light_bodies_get_more_inertia_than_they_have() -> None:
    made = bodies("wing")
    for panel in range(made.skeleton.layout.n_panels):
        own = made.density_kg_m3 * made.skeleton.solids.inertia(panel)
        assert np.abs(made.inertia(panel) - own).max() < 1e-3 * own.max(), "but for how it is drawn"
        light = replace(made, density_kg_m3=0.0).inertia(panel)
        np.testing.assert_array_equal(light, light[0, 0] * np.eye(3))
        assert 0.0 < light[0, 0] < 1e-4 * own.max()


@pytest.mark.parametrize("name", ["flat-sided cylinder", "flat-sided cone"])
def test_panels_without_area_are_bodies_between_their_creases(name: str, tmp_path: Path) -> None:
    made = bodies(name)
    flat = np.flatnonzero(made.volume_m3 == 0.0)
    assert len(flat) == 8
    path, model = written(made, tmp_path)
    for text in (mjcf_text(made), model.xml):
        assert not re.search(r"\b(nan|inf)\b", text, re.IGNORECASE)
    posed = loaded(made)
    mujoco.MjModel.from_xml_path(str(path))
    ends = made.skeleton.crease_ends.reshape(-1, 3)
    for panel in range(made.skeleton.layout.n_panels):
        middle = made.centroid(panel)
        assert np.isfinite(middle).all()
        if panel in flat:
            assert made.meshes[panel] is None
            assert made.mass_kg(panel) == LEAST_KG
            cell = made.skeleton.crease_ends[panel // 4].mean(axis=1)
            near = np.sort(np.linalg.norm(cell - middle, axis=1))
            assert near[0] == pytest.approx(near[1], rel=1e-9), "as far from one crease as from the other"
        assert (middle >= ends.min(axis=0) - 0.2).all()
        assert (middle <= ends.max(axis=0) + 0.2).all()
    posed.put(0.5)
    np.testing.assert_allclose(posed.frames(), own_poses(made, 0.5), atol=1e-9)


def folds_of(posed: Posed) -> Any:
    """(n_cells,) folds that the driven joints say."""
    made = posed.bodies
    bars: Any = made.skeleton.linkage.four_bars
    table = np.linspace(0.0, 1.0, 2001)
    angles = bars.angles(table)
    folds = []
    for cell, drive in enumerate(made.drives):
        joint = posed.data.joint(made.joint(cell, drive.crease))
        folds.append(
            np.interp(joint.qpos[0] + bars.deployed[cell, drive.crease], angles[:, cell, drive.crease], table)
        )
    return np.array(folds)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wing", "cone elliptic"])
def test_motors_fold_it_and_loops_hold(name: str) -> None:
    posed = loaded(bodies(name, CREASES.index("close_a")))
    model, data = posed.model, posed.data
    model.opt.gravity[:] = 0.0
    mujoco.mj_resetDataKeyframe(model, data, model.key("deployed").id)
    for step in range(4000):
        fold = 1.0 - 0.6 * min(1.0, step / 3000)
        _command(posed, fold)
        mujoco.mj_step(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-4 * posed.bodies.design.span_m
    folds = folds_of(posed)
    assert folds.max() < 0.6
    np.testing.assert_allclose(posed.frames(), own_poses(posed.bodies, folds), atol=2e-3)


def _command(posed: Posed, fold: float) -> None:
    made = posed.bodies
    bars: Any = made.skeleton.linkage.four_bars
    opened = bars.angles(np.array([fold]))[0] - bars.deployed
    for cell, drive in enumerate(made.drives):
        posed.data.actuator(drive.name).ctrl[0] = opened[cell, drive.crease]


def test_keyframes_are_both_ends_of_the_motion(tmp_path: Path) -> None:
    made = bodies("wing", CREASES.index("open_d"))
    write_mjcf(made, tmp_path / "wing.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "wing.xml"))
    posed = Posed(made, model)
    for name, fold in (("deployed", 1.0), ("flat", 0.0)):
        mujoco.mj_resetDataKeyframe(model, posed.data, model.key(name).id)
        mujoco.mj_kinematics(model, posed.data)
        np.testing.assert_allclose(posed.frames(), own_poses(made, fold), atol=1e-9)
        for k in range(model.nu):
            joint = model.actuator_trnid[k, 0]
            assert posed.data.ctrl[k] == posed.data.qpos[model.jnt_qposadr[joint]]
    low, high = model.jnt_range.T
    assert (low <= posed.data.qpos).all()
    assert (posed.data.qpos <= high).all()
