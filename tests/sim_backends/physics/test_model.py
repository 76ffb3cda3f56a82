"""The MuJoCo model is the structure: same poses, same masses, loops that close, faces that touch by design only."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ori_deploy.design import build
from ori_deploy.errors import InputError
from ori_deploy.files import Design, build_from_file
from ori_deploy.loads import Loads
from ori_deploy.profiles import Superellipse
from sim_backends.physics import need
from sim_backends.physics.model import Model, mjcf
from sim_backends.physics.pieces import convex_pieces
from sim_backends.physics.world import World
from tests.shapes import ring_on
from tests.sim_backends.physics.structures import CALM, EXAMPLES, design, poses_of

NAMES = [
    "wing", "one cell", "two cells", "two inner vertices", "peanut 8", "circle 6 without wall", "polygon 5",
    "cone elliptic 6", "cone wing, apex below", "cone two inner vertices", "cone circular 6 without wall",
]  # fmt: skip
GALLERY = sorted(
    p
    for p in EXAMPLES.glob("*.toml")
    if not p.name.startswith(("mavlink", "rig_", "loads_", "parts_", "sweep_", "uav_"))
)


@pytest.mark.parametrize("name", NAMES)
def test_panels_are_where_the_mechanism_has_them(name: str) -> None:
    rng = np.random.default_rng(3)
    layout = design(name).structure.layout
    for clamp in (None, layout.panel_ids[-2]):
        world = World(Model(design(name), Loads(clamp=clamp), contact=False))
        for fold in (0.0, 0.31, 1.0, rng.uniform(0.2, 1.0, layout.n_cells)):
            world.put(fold)
            np.testing.assert_allclose(world.matrices, poses_of(world.model, fold), atol=1e-9)
            assert world.loop_gap_m < 1e-9
            angles = world.model.linkage.four_bars.angles(np.broadcast_to(fold, (1, layout.n_cells)))[0]
            np.testing.assert_allclose(world.angles, angles, atol=1e-12)


@settings(max_examples=15)
@given(
    n=st.integers(3, 7),
    aspect=st.floats(0.5, 1.0),
    phase=st.floats(0.0, 1.5),
    wall=st.floats(0.003, 0.02),
    folds=st.lists(st.floats(0.05, 1.0), min_size=7, max_size=7),
    clamp=st.integers(0, 11),
)
def test_any_ring_is_modelled(
    n: int, aspect: float, phase: float, wall: float, folds: list[float], clamp: int
) -> None:
    try:
        made = Design("ring", 0.5, build(ring_on(Superellipse(1.0, aspect), n, phase=phase), wall))
    except InputError:
        assume(False)
    panel = made.structure.layout.panel_ids[clamp % (4 * n)]
    world = World(Model(made, Loads(clamp=panel), contact=False))
    fold = np.array(folds[:n])
    world.put(fold)
    np.testing.assert_allclose(world.matrices, poses_of(world.model, fold), atol=1e-9)
    assert world.loop_gap_m < 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_it_weighs_what_its_panels_weigh(name: str) -> None:
    model = Model(design(name), Loads(extra_kg={"c1.cb": 0.1}), contact=False)
    compiled = mujoco.MjModel.from_xml_string(model.xml())
    layout = design(name).structure.layout
    moving = [p for p in range(layout.n_panels) if model.body(p) != "world"]
    assert compiled.body_mass.sum() == pytest.approx(model.masses[moving].sum())


def test_energy_is_that_of_weight_and_films() -> None:
    loads = Loads(gravity_m_s2=(1.0, -9.0, 0.5), clamp="c2.cb")
    world = World(Model(design("wing"), loads, contact=False))
    model = world.model
    moving = [p for p in range(model.design.structure.layout.n_panels) if model.body(p) != "world"]

    def by_hand(fold: float) -> float:
        poses = poses_of(model, fold)
        place = np.einsum("pij,pj->pi", poses[:, :3, :3], model.solids.centroid) + poses[:, :3, 3]
        bend = model.linkage.four_bars.angles(fold) - loads.film.rest_rad
        weight = model.masses[:, None] * np.array(loads.gravity_m_s2)
        return float(-(place * weight)[moving].sum() + 0.5 * loads.film.stiffness_nm(1.26) * (bend**2).sum())

    for fold in (0.0, 0.4, 1.0):
        world.put(fold)
        assert world.energy_j == pytest.approx(by_hand(fold), abs=1e-9)


@pytest.mark.parametrize(
    "name", ["wing", "peanut 8", "two inner vertices", "cone elliptic 6", "cone wing, apex below"]
)
def test_no_panels_push_each_other_along_the_motion(name: str) -> None:
    world = World(Model(design(name), CALM))
    for fold in np.linspace(0.0, 1.0, 21):
        world.put(fold)
        assert world.n_contacts == 0, fold


def test_cells_out_of_step_push_each_other() -> None:
    world = World(Model(design("wing"), CALM))
    world.put(np.array([1.0, 0.5, 1.0, 1.0]))
    assert world.n_contacts > 0


def test_exported_model_stands_alone_with_both_ends_as_keyframes(tmp_path: Path) -> None:
    path = tmp_path / "wing.xml"
    path.write_text(mjcf(design("wing")))
    compiled = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(compiled)
    model = Model(design("wing"))
    for name, fold in (("deployed", 1.0), ("stowed", 0.0)):
        mujoco.mj_resetDataKeyframe(compiled, data, compiled.key(name).id)
        mujoco.mj_forward(compiled, data)
        poses = poses_of(model, fold)
        for panel in range(16):
            if model.body(panel) != "world":
                np.testing.assert_allclose(data.body(model.body(panel)).xpos, poses[panel, :3, 3], atol=1e-9)


def test_pieces_are_convex_and_cover_the_panel() -> None:
    angle = np.linspace(0.0, np.pi, 60)
    crescent = np.concatenate(
        [
            np.column_stack([np.cos(angle), np.sin(angle)]),
            0.8 * np.column_stack([np.cos(angle[::-1]), np.sin(angle[::-1])]),
        ]
    )
    pieces = convex_pieces(crescent, 1e-3)
    area = 0.0
    for piece in pieces:
        edge = np.roll(piece, -1, axis=0) - piece
        turn = np.cross(np.pad(edge, ((0, 0), (0, 1))), np.pad(np.roll(edge, -1, axis=0), ((0, 0), (0, 1))))[:, 2]
        assert (turn >= -1e-12).all() or (turn <= 1e-12).all()
        after = np.roll(piece, -1, axis=0)
        area += 0.5 * abs((piece[:, 0] * after[:, 1] - after[:, 0] * piece[:, 1]).sum())
    assert area == pytest.approx(0.5 * np.pi * (1.0 - 0.64), rel=0.03)


def test_missing_mujoco_is_one_line_that_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(InputError, match=r"ori-deploy\[physics\]"):
        need.mujoco()


@pytest.mark.slow
@pytest.mark.parametrize("path", GALLERY, ids=lambda path: path.stem)
def test_every_example_is_modelled(path: Path) -> None:
    spec, structure = build_from_file(path)
    made = Design(path.stem, spec.structure.span_m, structure, r_min_m=spec.structure.r_min_m)
    world = World(Model(made, Loads(damping_nm_s=1e-3)))
    for fold in (0.0, 0.2, 0.7, 1.0):
        world.put(fold)
        np.testing.assert_allclose(world.matrices, poses_of(world.model, fold), atol=1e-9)
        assert world.n_contacts == 0
    world.put(0.5)
    for _ in range(20):
        world.step()
    assert np.isfinite(world.angles).all()
    # Let go all at once, without servos: the hardest that loops are pulled at.
    assert world.loop_gap_m < 5e-3 * world.model.linkage.size_m
