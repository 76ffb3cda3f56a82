"""MuJoCo reads the model, and puts every panel where we have it; loops hold while motors pull."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh

from ori_deploy.export.bodies import Bodies
from ori_deploy.export.mjcf import mjcf_text, write_mjcf
from ori_deploy.export.tree import tree_of
from ori_deploy.motion import CREASES
from tests.export.designs import design
from tests.export.models import FOLDS, NAMES, Posed, bodies, own_poses


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
