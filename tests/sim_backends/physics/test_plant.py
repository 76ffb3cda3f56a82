"""The plant behind simulated servos: torques as sized, energy accounted for, gears, latches, obstacles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ori_deploy.errors import InputError
from ori_deploy.loads import Air, Film, Loads, Magnets
from ori_deploy.motion import CREASES
from sim_backends.load import BACKDRIVE, shaft_rates
from sim_backends.physics.model import WIND_UP_RAD, Obstacle
from sim_backends.physics.plant import Plant, plant_of
from sim_backends.physics.trial import deploy_slowly
from tests.sim_backends.physics.structures import CALM, design, plant, poses_of, rig_for

CLOSE_A = CREASES.index("close_a")
BUSY = Loads(
    friction_nm=0.002, damping_nm_s=5e-4, air=Air(pressure_pa=5.0, wind_m_s=(2.0, 4.0, 0.0)), clamp="c1.cb"
)  # fmt: skip


def at_fold(p: Plant, fold: float) -> np.ndarray:
    """Shaft positions at a fold."""
    model = p.world.model
    angles = model.linkage.four_bars.angles(fold)
    return np.array([d.zero_rad + d.shaft_per_crease * angles[d.cell, d.crease] for d in model.drives])


@pytest.mark.parametrize(
    ("name", "density", "seconds"),
    [
        ("wing", 300.0, 10.0),
        pytest.param("tapered", 300.0, 10.0, marks=pytest.mark.slow),
        pytest.param("one cell", 5.0, 10.0, marks=pytest.mark.slow),
        pytest.param("two inner vertices", 5.0, 20.0, marks=pytest.mark.slow),
        pytest.param("cone elliptic 6", 30.0, 20.0, marks=pytest.mark.slow),
    ],
)
def test_slow_hinge_torques_are_those_that_size_says(name: str, density: float, seconds: float) -> None:
    p = plant(name, Loads(density_kg_m3=density), torque_nm=10.0, contact=False)
    seen = deploy_slowly(p, seconds)
    # The gears of a stowed plant are wound up first; at the very end transmissions are steep.
    calm = (seen.fold.min(axis=1) > 0.1) & (seen.fold.max(axis=1) < 0.99)
    assert calm.sum() > 30
    assert np.abs(seen.torque_nm - seen.sized_nm)[calm].max() < 0.03 * np.abs(seen.sized_nm[calm]).max()
    assert seen.loop_gap_m < 2e-5 * max(1.0, p.world.model.linkage.size_m)


def test_hinge_torques_with_air_and_friction_are_those_that_size_says() -> None:
    seen = deploy_slowly(plant("wing", BUSY, contact=False), 5.0)
    late = (seen.fold.min(axis=1) > 0.1) & (seen.fold.max(axis=1) < 0.99)
    assert np.abs(seen.torque_nm - seen.sized_nm)[late].max() < 0.04 * np.abs(seen.sized_nm).max()


@pytest.mark.parametrize("loads", [Loads(), replace(BUSY, magnets=Magnets(force_n=15.0))])
def test_work_of_the_servos_is_energy_gained_and_lost(loads: Loads) -> None:
    seen = deploy_slowly(plant("wing", loads, contact=False), 2.5)
    assert abs(seen.unexplained_j) < 0.02 * seen.turnover_j
    assert seen.turnover_j > 0.3


@pytest.mark.parametrize("name", ["wing", "ellipse 4", "tapered"])
def test_panels_under_load_stay_on_the_mechanism(name: str) -> None:
    p = plant(name, Loads(damping_nm_s=1e-3), contact=False)
    for k in range(600):
        p.step(at_fold(p, 0.5 * min(1.0, (k + 1) / 400)), 0.002)
    world = p.world
    fold = world.angles[:, CLOSE_A] / world.model.linkage.four_bars.deployed[:, CLOSE_A]
    np.testing.assert_allclose(world.matrices, poses_of(world.model, fold), atol=2e-4)
    assert world.loop_gap_m < 2e-6


def test_every_hinge_is_where_its_shaft_is_but_for_wind_up() -> None:
    p = plant("wing", Loads())
    goal = at_fold(p, 0.3)
    for k in range(600):
        p.step(at_fold(p, 0.3 * min(1.0, (k + 1) / 500)), 0.002)
    torque = p.torque_nm
    np.testing.assert_allclose(goal - p.output_rad, torque * WIND_UP_RAD / 2.0, atol=2e-4)


def test_gears_with_play_let_a_crease_hang() -> None:
    play = 0.02
    tight, loose = plant("wing", Loads(damping_nm_s=1e-3)), plant("wing", Loads(damping_nm_s=1e-3), play_rad=play)
    for p in (tight, loose):
        for k in range(700):
            p.step(at_fold(p, 0.3 * min(1.0, (k + 1) / 500)), 0.002)
    apart = loose.output_rad - tight.output_rad
    np.testing.assert_allclose(np.abs(apart), 0.5 * play, atol=2e-3)


def test_a_closed_latch_holds_what_shafts_would_pull_apart() -> None:
    p = plant("wing", CALM, crease_rad=design("wing").structure.cells.angle)
    p.secure(["slit:P-O2"])
    shaft = p.output_rad
    for k in range(250):
        p.step(shaft - np.array([0.0, 0.0, 0.08, 0.0]) * min(1.0, k / 200), 0.002)
    assert p.world.slit_gaps_m[0].max() < 2e-4
    held = abs(p.torque_nm[2])
    p.secure([])
    for _ in range(250):
        p.step(shaft - np.array([0.0, 0.0, 0.08, 0.0]), 0.002)
    assert p.world.slit_gaps_m[0].max() > 5e-4
    assert abs(p.torque_nm[2]) < 0.2 * held


def test_a_stow_latch_holds_the_stack() -> None:
    p = plant("wing", CALM)
    p.secure(["stow"])
    for k in range(200):
        p.step(at_fold(p, 0.02 * min(1.0, k / 100)), 0.002)
    held = p.world.angles[:, CLOSE_A]
    p.secure([])
    for _ in range(200):
        p.step(at_fold(p, 0.02), 0.002)
    free = p.world.angles[:, CLOSE_A]
    assert (np.abs(held) < 0.3 * free).all()


@pytest.mark.parametrize("what", ["locked crease", "obstacle"])
def test_what_is_in_the_way_winds_the_gears_up(what: str) -> None:
    obstacles: tuple[Obstacle, ...] = ()
    if what == "obstacle":
        p = plant("wing", CALM, contact=False)
        p.world.put(0.6)
        panel = 9
        middle = (p.world.matrices[panel] @ [*p.world.model.solids.centroid[panel], 1.0])[:3]
        obstacles = (Obstacle((float(middle[0]), float(middle[1]), 0.63), (0.003, 0.003, 0.7)),)
    p = plant("wing", CALM, contact=False, obstacles=obstacles)
    worst, frames = 0.0, 500
    for k in range(frames):
        if what == "locked crease" and k == 150:
            p.world.lock(2, CLOSE_A)
        p.step(at_fold(p, 0.7 * (k + 1) / frames), 0.002)
        worst = max(worst, float(np.abs(p.torque_nm).max()))
    assert worst > 3.0


def test_a_shaft_alone_is_as_fast_as_asked_and_slower_under_load() -> None:
    one = np.ones(1)
    fast, stall = 4.0 * one, 2.0 * one

    def rate(wish: float, load: float, limit: float = 2.0) -> float:
        return float(shaft_rates(wish * one, load * one, fast, stall, limit * one)[0])

    assert rate(1.0, 0.0) == pytest.approx(1.0)
    assert rate(1.0, 0.5) == pytest.approx(1.0)  # the controller makes up for it
    assert rate(4.0, 1.0) == pytest.approx(2.0)  # half the stall torque leaves half the speed
    assert rate(4.0, -1.0) == pytest.approx(4.0)  # what pulls along is braked
    assert rate(1.0, 2.0) == pytest.approx(0.0)  # stalled
    assert rate(0.0, 1.5) == pytest.approx(0.0)  # held
    assert rate(1.0, 2.0 * (1.0 + 0.9 * BACKDRIVE)) == 0.0  # gears hold a little more than the motor
    assert rate(1.0, 3.0) == pytest.approx(-4.0 * (0.5 - BACKDRIVE))  # turned back
    assert rate(0.0, 0.1, limit=0.0) == 0.0  # torque off: friction holds
    assert rate(0.0, 1.0, limit=0.0) == pytest.approx(-4.0 * (0.5 - BACKDRIVE))
    assert float(shaft_rates(one, 0.0 * one, 0.0 * one, stall, stall)[0]) == 0.0  # no voltage


def test_a_rig_for_another_design_is_refused() -> None:
    with pytest.raises(InputError, match="the rig's cells are not the design's"):
        plant_of(design("one cell"), rig_for(design("wing")))


def test_stronger_film_needs_more_torque() -> None:
    thin, thick = (
        plant("one cell", replace(CALM, density_kg_m3=1.0, film=Film(thickness_m=t), damping_nm_s=1e-3))
        for t in (1e-4, 2e-4)
    )
    for p in (thin, thick):
        for k in range(1500):
            p.step(at_fold(p, 0.5 * min(1.0, (k + 1) / 1000)), 0.002)
    np.testing.assert_allclose(thick.torque_nm, 8.0 * thin.torque_nm, rtol=0.02)
