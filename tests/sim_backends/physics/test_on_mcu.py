"""Hobby servos of the simulated board drive the wing in MuJoCo: step by step, and by the firmware over the pty."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.errors import InputError
from ori_deploy.files import load_plan, save_design
from ori_deploy.motion import CREASES, Plan
from sim_backends.mcu import main
from sim_backends.microcontroller.build import Port
from sim_backends.microcontroller.from_rig import world_for_files, world_from_rig
from sim_backends.microcontroller.launcher import Microcontroller
from sim_backends.microcontroller.plant_link import STEP_S, PlantLink
from sim_backends.microcontroller.spec import HingeSpec, WorldSpec
from tests.cli.test_mcu import configure, made, motion
from tests.deploy.test_on_plant import wing_plan
from tests.sim_backends.microcontroller.bench import need
from tests.sim_backends.physics.structures import EXAMPLES, design

__all__ = ["made"]
RIG = EXAMPLES / "rig_wing_mcu.toml"
CLOSE_A = CREASES.index("close_a")


@pytest.fixture(scope="module")
def wing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("wing") / "wing.design.json"
    save_design(design("wing"), path)
    return path


def fitted() -> tuple[ResolvedRig, Plan]:
    layout = design("wing").structure.layout
    return resolve_rig(load_rig(RIG), layout.cell_ids, ("slit:P-O2",)), wing_plan()


def loads_file(folder: Path, film_um: float) -> Path:
    path = folder / "loads.toml"
    film = f"[film]\nthickness_um = {film_um}\n[hinge]\ndamping_nm_s = 0.001\n"
    path.write_text(f'schema = "ori-deploy/loads/1"\nclamp = "c1.cb"\n{film}')
    return path


def link(wing: Path, loads: Path | None = None) -> tuple[PlantLink, WorldSpec]:
    rig, plan = fitted()
    world = world_from_rig(rig, plan.crease_angles_rad[0], plan.crease_angles_rad[-1], plant=wing, loads=loads)
    assert world.plant is not None
    return PlantLink(world, world.plant), world


def follow(one: PlantLink, world: WorldSpec, jammed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Goals along the plan, a pulse every 20 ms; shafts and creases at the end."""
    rig, plan = fitted()
    shaft = np.array([hinge.start_rad for hinge in world.hinges])
    crease = shaft
    goals = rig.to_actuator(plan.crease_angles_rad)
    for k in range(round((plan.duration_s + 0.5) / STEP_S)):
        row = min(int(0.02 * (k // 5) * plan.rate_hz), len(goals) - 1)
        shaft, crease = one.step(goals[row], shaft, 0b1111, jammed, 0)
    return shaft, crease


def test_hobby_servos_deploy_the_wing(wing: Path) -> None:
    one, world = link(wing)
    rig, plan = fitted()
    shaft, crease = follow(one, world)
    gear = np.abs(rig.shaft_per_crease)
    goal = rig.to_actuator(plan.crease_angles_rad[-1])
    assert (np.abs(crease - goal) < 0.03 * gear).all()
    # Gears give: the pot sees the shaft, the structure is a little behind.
    assert 1e-4 < np.abs(shaft - crease).max() < 0.05


def test_a_jammed_shaft_leaves_its_cell_behind(wing: Path) -> None:
    one, world = link(wing)
    shaft, crease = follow(one, world, jammed=0b0100)
    start = world.hinges[2].start_rad
    assert shaft[2] == start
    assert abs(crease[2] - start) < 0.06


@pytest.mark.parametrize(("film_um", "holds"), [(25.0, True), (100.0, False)])
def test_servos_without_pulses_are_held_by_their_gears_only(
    wing: Path, tmp_path: Path, film_um: float, holds: bool
) -> None:
    """A stack wants open: the film of its closing creases is bent by half a turn."""
    one, world = link(wing, loads_file(tmp_path, film_um))
    shaft = start = np.array([hinge.start_rad for hinge in world.hinges])
    for _ in range(100):
        shaft, _ = one.step(shaft + 1.0, shaft, 0, 0, 0)
    assert (np.abs(shaft - start).max() < 0.02) == holds


def test_a_plant_wants_all_its_hinges(wing: Path) -> None:
    _, world = link(wing)
    with pytest.raises(InputError, match="hinges in the world"):
        WorldSpec(hinges=(HingeSpec(0),), plant=world.plant)


@pytest.mark.parametrize(
    "words", [["--plant", "w.json"], ["--rig", "r.toml", "--plan", "p.json", "--loads", "l.toml"]]
)
def test_options_that_say_too_little_are_refused(words: list[str]) -> None:
    result = CliRunner().invoke(main, [*words, "--link", "/nonexistent/tty"])
    assert result.exit_code == 2
    assert "--plant with --rig and --plan" in result.output


def test_creases_are_told_to_the_board(wing: Path, tmp_path: Path) -> None:
    """The process starts with a plant, and its world's time goes on with it."""
    need("host")
    _, world = link(wing)
    with Microcontroller(world, tmp_path / "ttyMCU", port="host") as board:
        board.wait_ready()
        first = board.truth()
        np.testing.assert_allclose(first.shaft_rad, [hinge.start_rad for hinge in world.hinges], atol=0.1)
        assert board.truth().time_us > first.time_us


@pytest.mark.slow
@pytest.mark.parametrize("port", ["host", "atmega2560"])
def test_the_firmware_deploys_and_stows_the_wing(made: Path, tmp_path: Path, port: Port) -> None:
    need(port)
    loads = loads_file(tmp_path, 25.0)  # half as thick: an unpowered board has to hold the stack
    world = world_for_files(made / "rig.toml", made / "wing.plan.json", "stowed", made / "w.design.json", loads)
    plan = load_plan(made / "wing.plan.json")
    with Microcontroller(world, tmp_path / "ttyMCU", port=port) as board:
        board.wait_ready()
        configure(made, tmp_path)
        for command, end in (("deploy", -1), ("stow", 0)):
            done = motion(command, made, tmp_path)
            assert done.returncode == 0, done.stdout + done.stderr
            plant = board._plant
            assert plant is not None
            angles = plant.load.world.angles[:, CLOSE_A]  # type: ignore[attr-defined]
            np.testing.assert_allclose(angles, plan.crease_angles_rad[end, :, CLOSE_A], atol=0.06)
