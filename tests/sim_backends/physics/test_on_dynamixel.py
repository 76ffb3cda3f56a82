"""Virtual Dynamixel servos drive the wing in MuJoCo: motors step by step, and the whole loop over the pty."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.errors import InputError
from ori_deploy.files import save_design
from ori_deploy.motion import CREASES, Plan
from sim_backends.dynamixel.from_rig import spec_for_files, spec_from_rig
from sim_backends.dynamixel.launcher import VirtualBus
from sim_backends.dynamixel.motors import STEP_S, Motors
from sim_backends.dynamixel.spec import BusSpec
from sim_backends.dynamixel_bus import main
from tests.cli.test_dynamixel import EXAMPLES, rig, run
from tests.deploy.test_on_plant import wing_plan
from tests.sim_backends.physics.structures import design

__all__ = ["rig"]
CLOSE_A = CREASES.index("close_a")
PIN_SERVO = (
    'dynamixel.servo]]\nlatch = "pin"\nid = 20\nmodel = "XL330-M288"\nengaged_rad = 1.0\nreleased_rad = -0.5\n'
)
PIN = 'latch]]\nid = "pin"\nsecures = "slit:P-O2"\nkind = "lock_pin"\ntravel_s = 0.2\n'


@pytest.fixture(scope="module")
def wing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wing")
    save_design(design("wing"), folder / "wing.design.json")
    (folder / "loads.toml").write_text('schema = "ori-deploy/loads/1"\nclamp = "c1.cb"\n')
    text = (EXAMPLES / "rig_wing_dynamixel.toml").read_text()
    (folder / "rig.toml").write_text(f"{text}\n[[{PIN_SERVO}\n[[{PIN}")
    return folder


def resolved(folder: Path) -> tuple[ResolvedRig, Plan]:
    layout = design("wing").structure.layout
    return resolve_rig(load_rig(folder / "rig.toml"), layout.cell_ids, layout.latch_points), wing_plan()


def spec(folder: Path, **more: Any) -> BusSpec:
    fitted, motion = resolved(folder)
    ends = motion.crease_angles_rad[[0, -1]]
    return spec_from_rig(fitted, *ends, plant=folder / "wing.design.json", **more)


def folds(motors: Motors) -> np.ndarray:
    world = motors.plant.world  # type: ignore[union-attr]
    return np.asarray(world.angles[:, CLOSE_A] / world.model.linkage.four_bars.deployed[:, CLOSE_A])


def follow(motors: Motors, folder: Path, until_s: float) -> float:
    """Goals along the plan, as a controller gives them; returns the largest distance of a crease from its goal."""
    fitted, motion = resolved(folder)
    worst, now = 0.0, 0.0
    gear = np.abs(fitted.shaft_per_crease)
    while now < until_s:
        row = min(int(now * motion.rate_hz), len(motion.fold) - 1)
        motors.goal_rad[:4] = fitted.to_actuator(motion.crease_angles_rad[row])
        for _ in range(5):
            now += STEP_S
            motors.step(now)
        worst = max(worst, float((np.abs(motors.output_rad[:4] - motors.goal_rad[:4]) / gear).max()))
    return worst


def test_motors_deploy_the_wing_and_feel_it(wing: Path) -> None:
    motors = Motors(spec(wing, loads=wing / "loads.toml"))
    motors.torque_on[:] = True
    seconds = wing_plan().duration_s
    assert follow(motors, wing, seconds + 0.3) < 0.1
    np.testing.assert_allclose(folds(motors), 1.0, atol=0.02)
    # What `size` says of servo_1 about to be latched, but for gears' losses at rest.
    assert motors.torque_nm[0] == pytest.approx((0.665 + 0.373) / 2.0, rel=0.1)


def test_a_seized_crease_stalls_its_motor(wing: Path) -> None:
    motors = Motors(spec(wing))
    motors.torque_on[:] = True
    motors.plant.world.lock(2, CLOSE_A)  # type: ignore[union-attr]
    assert follow(motors, wing, 3.0) > 0.1
    assert motors.torque_nm[2] > 0.9 * motors.stall_nm[2]
    assert motors.strained_s[2] > 0.5


def test_a_pin_in_its_hole_holds_the_slit(wing: Path) -> None:
    gaps = {}
    for pinned in (True, False):
        fitted, motion = resolved(wing)
        ends = motion.crease_angles_rad[[0, -1]]
        rows = {"start": "deployed"} if pinned else {"start_rad": ends[1]}
        motors = Motors(spec_from_rig(fitted, *ends, plant=wing / "wing.design.json", **rows))  # type: ignore[arg-type]
        motors.torque_on[:] = True
        motors.goal_rad[2] -= 0.06
        for k in range(200):
            motors.step((k + 1) * STEP_S)
        gaps[pinned] = float(motors.plant.world.slit_gaps_m.max())  # type: ignore[union-attr]
    assert gaps[True] < 2e-4 < 5e-4 < gaps[False]


def test_a_specification_with_a_plant_goes_through_json(wing: Path) -> None:
    made = spec(wing, loads=wing / "loads.toml")
    assert BusSpec.from_json(json.loads(json.dumps(made.to_json()))) == made


def test_a_plant_of_another_structure_is_refused(wing: Path, tmp_path: Path) -> None:
    save_design(design("one cell"), tmp_path / "one.design.json")
    fitted, motion = resolved(wing)
    made = spec_from_rig(fitted, *motion.crease_angles_rad[[0, -1]], plant=tmp_path / "one.design.json")
    with pytest.raises(InputError, match="another number of cells"):
        Motors(made)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--servos", "1-4:xm430", "--plant", "w.json"], "a rig"),
        (["--servos", "1-4:xm430", "--loads", "l.toml"], "add --plant"),
        (["--rig", str(EXAMPLES / "rig_wing_dynamixel.toml"), "--plant", "w.json"], "add --plan PLAN"),
    ],
)
def test_options_that_say_too_little_are_refused(words: list[str], told: str) -> None:
    result = CliRunner().invoke(main, [*words, "--link", "/nonexistent/tty"])
    assert result.exit_code == 2
    assert told in result.output


@pytest.mark.slow
def test_the_wing_deploys_and_stows_over_the_pty(rig: Path, wing: Path, tmp_path: Path) -> None:
    # A slow loop with much patience: the machine that runs the tests has other things to do as well.
    text = rig.read_text().replace("rate_hz = 100.0", "rate_hz = 25.0").replace("= 5\n", "= 15\n", 1)
    text = text.replace("reply_slack_s = 0.03", "reply_slack_s = 0.06")
    rig.write_text(text.replace("[controller]\n", "[controller]\nmax_reading_age_s = 0.5\nsettle_timeout_s = 10.0\n"))
    plan = tmp_path / "w.plan.json"
    done = run("plan", wing / "wing.design.json", "--rig", rig, "-o", plan, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    made = spec_for_files(rig, plan, "stowed", wing / "wing.design.json", wing / "loads.toml")
    with VirtualBus(made, link=tmp_path / "ttyDXL") as bus:
        for command in ("deploy", "stow"):
            done = run(command, plan, "--rig", rig, "--port", tmp_path / "ttyDXL", cwd=tmp_path)
            assert done.returncode == 0, done.stdout + done.stderr
        held = [truth.current_a for truth in bus.truth().values()]
    assert max(held) > 0.06  # more than idle: the film of the stowed wing
