"""What moves by itself moves as it does on paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ori_deploy.loads import Film, Loads, Magnets
from sim_backends.physics.model import STEP_S, Model
from sim_backends.physics.world import World
from tests.sim_backends.physics.structures import CALM, design, poses_of

OPEN_C = 0
G = 9.81


def pendulum(loads: Loads) -> tuple[World, float, float]:
    """Panel c1.cb alone on its crease open_c, its cell's loop opened and what hangs on it taken off.

    Returns the world, its inertia about the crease and its mass times the distance of its centre.
    """
    world = World(Model(design("one cell"), loads, contact=False))
    world._d.eq_active[:] = 0  # the loop is open: panels are chains
    names = {"c1.open_c", "c1.close_b", "c1.close_a", "c1.open_d"}
    others = [world._m.joint(name).id for name in names - {"c1.open_c"}]
    world._m.jnt_stiffness[others] = 0.0
    for body in range(2, world._m.nbody):
        if world._m.body(body).name != "c1.cb":
            world._m.body_mass[body] *= 1e-9
            world._m.body_inertia[body] *= 1e-9
    solids = world.model.solids
    mass = float(world.model.masses[1])
    arm = solids.centroid[1] - solids.crease_point[0, OPEN_C]
    about = loads.density_kg_m3 * solids.inertia(1)[2, 2] + mass * float(arm[:2] @ arm[:2])
    return world, about, mass * float(np.hypot(*arm[:2]))


def hanging(loads: Loads) -> Loads:
    """Gravity along the panel's arm when deployed: there it hangs."""
    solids = Model(design("one cell")).solids
    arm = (solids.centroid[1] - solids.crease_point[0, OPEN_C])[:2]
    down = G * arm / np.hypot(*arm)
    return replace(loads, gravity_m_s2=(float(down[0]), float(down[1]), 0.0))


def period_of(world: World, amplitude: float) -> float:
    """Time between two passages of the middle in the same sense."""
    joint = world._m.joint("c1.open_c").qposadr[0]
    world._d.qpos[joint] = -amplitude
    passed: list[float] = []
    before = -amplitude
    for _ in range(20_000):
        world.step()
        now = float(world._d.qpos[joint])
        if before < 0.0 <= now:
            passed.append(world.time_s - STEP_S * now / (now - before))
            if len(passed) == 3:
                return 0.5 * (passed[2] - passed[0])
        before = now
    raise AssertionError("does not swing")


@pytest.mark.parametrize("amplitude", [0.02, 0.4])
def test_a_panel_swings_as_a_compound_pendulum_does(amplitude: float) -> None:
    world, inertia, moment = pendulum(hanging(replace(CALM, density_kg_m3=500.0)))
    by_hand = 2.0 * np.pi * np.sqrt(inertia / (moment * G)) * (1.0 + amplitude**2 / 16.0)
    assert period_of(world, amplitude) == pytest.approx(by_hand, rel=2e-3)


def test_its_film_makes_it_swing_faster() -> None:
    film = Film(thickness_m=3e-4, rest_open_rad=float(design("one cell").structure.cells.angle[0, 0]))
    world, inertia, moment = pendulum(hanging(replace(CALM, film=film)))
    stiffness = film.stiffness_nm(0.3) + moment * G
    assert period_of(world, 0.02) == pytest.approx(2.0 * np.pi * np.sqrt(inertia / stiffness), rel=2e-3)


def test_a_pendulum_keeps_its_energy() -> None:
    world, _, moment = pendulum(hanging(replace(CALM, density_kg_m3=500.0)))
    joint = world._m.joint("c1.open_c").qposadr[0]
    world._d.qpos[joint] = -0.4
    world._mujoco.mj_forward(world._m, world._d)
    swing = moment * G * (1.0 - np.cos(0.4))
    start = world.energy_j
    for _ in range(3000):
        world.step()
    assert abs(world.energy_j - start) < 0.02 * swing


def test_dry_friction_holds_what_it_can() -> None:
    """A cell under a torque below its creases' friction stays; above it moves."""
    film = Film(thickness_m=1e-4)
    rates = np.abs(Model(design("one cell")).linkage.four_bars.transmission(np.array([0.5])))[0, 0]
    linkage = Model(design("one cell")).linkage
    angles = linkage.four_bars.angles(0.5)[0]
    signed = linkage.four_bars.transmission(np.array([0.5]))[0, 0]
    push = abs(film.stiffness_nm(0.3) * float(((angles - np.pi) * signed).sum()))
    for share, moves in ((1.2, False), (0.8, True)):
        friction = share * push / float(rates.sum())
        loads = replace(CALM, density_kg_m3=1.0, film=film, friction_nm=friction, damping_nm_s=1e-4)
        world = World(Model(design("one cell"), loads, contact=False), 0.5)
        before = world.angles
        for _ in range(300):
            world.step()
        assert (np.abs(world.angles - before).max() > 0.02) == moves, share


def pulled(share: float, force_n: float) -> World:
    """A deployed ring whose slit is pulled at with a share of what its magnets hold, for a second."""
    magnets = Magnets(force_n=force_n)
    world = World(Model(design("ellipse 4"), replace(CALM, magnets=magnets, damping_nm_s=1e-3), contact=False), 1.0)
    (slit,) = world.model.slits
    # The way the faces part when all cells fold a little.
    poses = poses_of(world.model, 0.99)
    ends = [poses[p, :3, :3] @ slit.places[0] + poses[p, :3, 3] for p in slit.panels]
    way = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    sites = [world._m.site(f"{slit.point} opening {side}").id for side in "ab"]
    bodies = world._m.site_bodyid[sites]
    for step in range(1500):
        force = share * force_n * min(1.0, step / 500.0) * way
        world.push[:] = 0.0
        for body, site, sign in zip(bodies, sites, (-1.0, 1.0), strict=True):
            arm = world._d.site_xpos[site] - world._d.xipos[body]
            world.push[body, :3] += sign * force
            world.push[body, 3:] += sign * np.cross(arm, force)
        world.step()
    return world


def test_magnets_hold_a_slit_shut_up_to_their_force() -> None:
    held = pulled(0.9, 10.0)
    assert held.slit_gaps_m[0, 0] < held.model.loads.magnets.seat_m
    assert pulled(1.1, 10.0).slit_gaps_m[0, 0] > held.model.loads.magnets.capture_m


@pytest.mark.parametrize(("share", "closes"), [(0.8, True), (1.2, False)])
def test_magnets_pull_a_slit_shut_from_within_their_reach(share: float, closes: bool) -> None:
    magnets = Magnets(force_n=5.0, capture_m=4e-3)
    model = Model(design("ellipse 4"), replace(CALM, magnets=magnets, damping_nm_s=2e-3), contact=False)
    world = World(model)
    folds = np.linspace(0.7, 1.0, 301)
    gaps = []
    for fold in folds:
        world.put(fold)
        gaps.append(world.slit_gaps_m[0, 0])
    start = folds[np.argmin(np.abs(np.array(gaps) - share * magnets.capture_m))]
    world.put(start)
    before = world.slit_gaps_m[0, 0]
    for _ in range(3000):
        world.step()
    assert (world.slit_gaps_m[0, 0] < magnets.seat_m) == closes
    assert closes or world.slit_gaps_m[0, 0] == pytest.approx(before)


def test_a_run_can_be_repeated_exactly() -> None:
    ends = []
    for _ in range(2):
        world = World(Model(design("wing"), Loads(damping_nm_s=1e-3)), 0.6)
        for _ in range(300):
            world.step()
        ends.append(world.angles)
    np.testing.assert_array_equal(ends[0], ends[1])
