"""The controller, its mock servos and the wing in MuJoCo: one loop, on a virtual clock."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.clock import VirtualClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import FaultKind, MotionResult
from ori_deploy.deploy.states import State
from ori_deploy.errors import FileError, RigError
from ori_deploy.files import save_design
from ori_deploy.loads import Loads, Magnets
from ori_deploy.motion import CREASES, Plan, plan_motion
from sim_backends.mock import MockBus, Start
from sim_backends.physics.model import Obstacle
from sim_backends.physics.plant import Plant, plant_of
from tests.sim_backends.physics.structures import CALM, RIG, design, rig_for

CLOSE_A = CREASES.index("close_a")
LOADS = Loads(friction_nm=0.002, damping_nm_s=1e-3, magnets=Magnets(force_n=20.0))
PIN = {"id": "pin", "secures": "slit:P-O2", "kind": "lock_pin", "travel_s": 0.3}
LOCK = {"id": "lock", "secures": "stow", "kind": "electromagnet", "max_on_s": 5.0, "duty_cycle": 1.0}


@cache
def wing_plan() -> Plan:
    """As fast as servos behind 4:1 let it."""
    rig = rig_for(design("wing"))
    velocity, acceleration = rig.crease_limits()
    return plan_motion(design("wing").structure, velocity, acceleration, rig.rate_hz, design_name="wing")


class OnPlant:
    """A controller whose bus drives a plant."""

    def __init__(
        self,
        loads: Loads = LOADS,
        start: Start = "stowed",
        obstacles: tuple[Obstacle, ...] = (),
        contact: bool = True,
        **tables: Any,
    ) -> None:
        self.plan = wing_plan()
        self.rig: ResolvedRig = rig_for(design("wing"), **tables)
        ends = self.plan.crease_angles_rad[[0, -1]]
        self.plant: Plant = plant_of(
            design("wing"), self.rig, loads, crease_rad=ends[0 if start == "stowed" else 1], play_rad=0.005,
            contact=contact, obstacles=obstacles,
        )  # fmt: skip
        clock = VirtualClock(1000.0)
        self.bus = MockBus.from_rig(self.rig, clock, ends[0], ends[1], start=start, load=self.plant)
        self.controller = Controller(self.plan, self.rig, self.bus, clock)
        self.controller.connect()
        self.controller.arm()

    def deploy(self) -> MotionResult:
        self.controller.deploy()
        return self.controller.run()

    @property
    def folds(self) -> np.ndarray:
        """(n_cells,) where the cells truly are."""
        world = self.plant.world
        return np.asarray(world.angles[:, CLOSE_A] / world.model.linkage.four_bars.deployed[:, CLOSE_A])


@pytest.mark.slow
def test_the_wing_deploys_against_weight_and_film_and_stows_again() -> None:
    on = OnPlant(latch=[PIN, LOCK])
    result = on.deploy()
    assert result.succeeded, result
    assert result.state is State.DEPLOYED
    np.testing.assert_allclose(on.folds, 1.0, atol=0.02)
    assert on.plant.world.slit_gaps_m.max() < 3e-4
    on.controller.stow()
    result = on.controller.run()
    assert result.succeeded, result
    np.testing.assert_allclose(on.folds, 0.0, atol=0.02)
    assert on.bus.truly_closed("lock")


def test_readings_carry_the_load_of_the_structure() -> None:
    currents = {}
    for name, loads in (("calm", CALM), ("heavy", Loads(gravity_m_s2=(0.0, -9.81, 0.0), density_kg_m3=2000.0))):
        on = OnPlant(loads, contact=False)
        on.controller.deploy()
        for _ in range(150):
            record = on.controller.step()
        currents[name] = float(record.readings.current_a.max())
    assert currents["heavy"] > currents["calm"] + 0.2


@pytest.mark.slow
@pytest.mark.parametrize("cell", [0, 2])
def test_a_crease_that_seizes_stops_the_motion_along_the_path(cell: int) -> None:
    on = OnPlant()
    on.controller.deploy()
    while on.controller.under_way and on.folds.mean() < 0.4:
        on.controller.step()
    on.plant.world.lock(cell, CLOSE_A)
    result = on.controller.run()
    assert result.fault is not None
    assert result.fault.kind in (FaultKind.PATH_TOLERANCE, FaultKind.OUT_OF_STEP), result.fault
    assert result.fault.thing in (f"servo_c{cell + 1}", f"c{cell + 1}")
    assert np.ptp(on.folds) < on.plan.step_tolerance.allowed(float(on.folds.max()))


@pytest.mark.slow
def test_a_box_in_the_way_stops_the_motion() -> None:
    free = OnPlant(CALM, contact=False)
    free.plant.world.put(0.6)
    panel, world = 9, free.plant.world
    x, y, _, _ = world.matrices[panel] @ [*world.model.solids.centroid[panel], 1.0]
    on = OnPlant(CALM, obstacles=(Obstacle((float(x), float(y), 0.63), (0.003, 0.003, 0.7)),), contact=False)
    result = on.deploy()
    assert result.fault is not None
    assert result.fault.kind in (FaultKind.PATH_TOLERANCE, FaultKind.OUT_OF_STEP), result.fault
    assert on.plant.world.n_contacts > 0
    assert on.folds.max() < 0.7


@pytest.mark.slow
def test_a_servo_too_weak_for_the_wing_does_not_deploy_it() -> None:
    each = {**RIG["each_cell"], "actuator": {**RIG["each_cell"]["actuator"], "max_torque_nm": 0.1}}
    result = OnPlant(each_cell=each).deploy()
    assert not result.succeeded
    assert result.fault is not None


@pytest.mark.slow
@pytest.mark.parametrize("latched", [True, False])
def test_a_latched_slit_stays_shut_when_the_servos_let_go(latched: bool) -> None:
    # As heavy as lead: what the servos' own friction does not hold.
    heavy = Loads(density_kg_m3=9000.0, damping_nm_s=5e-3)
    tables = {"latch": [PIN]} if latched else {}
    on = OnPlant(heavy, start="deployed", contact=False, **tables)
    on.controller.step()
    on.bus.disable_torque()
    for k in range(100):
        on.bus._clock.sleep_until(1001.0 + 0.01 * k)
        on.bus.read_hinges()
    gap = float(on.plant.world.slit_gaps_m.max())
    assert (gap < 1e-3) == latched, gap


def test_a_rig_names_its_plant(tmp_path: Path) -> None:
    save_design(design("wing"), tmp_path / "wing.design.json")
    (tmp_path / "loads.toml").write_text('schema = "ori-deploy/loads/1"\n[panels]\ndensity_kg_m3 = 500.0\n')
    text = (Path(__file__).parents[2] / "examples" / "rig_mock.toml").read_text()
    path = tmp_path / "rig.toml"
    path.write_text(text + '\n[mock]\nplant = "wing.design.json"\nloads = "loads.toml"\n')
    layout, ends = design("wing").structure.layout, wing_plan().crease_angles_rad[[0, -1]]
    rig = resolve_rig(load_rig(path), layout.cell_ids, layout.latch_points)
    bus = MockBus.from_rig(rig, VirtualClock(), ends[0], ends[1])
    plant = bus._load
    assert isinstance(plant, Plant)
    assert plant.world.model.loads.density_kg_m3 == 500.0
    np.testing.assert_allclose(bus.true_output_rad, rig.to_actuator(ends[0]), atol=1e-9)
    (tmp_path / "wing.design.json").unlink()
    with pytest.raises(FileError, match=r"wing\.design\.json: cannot be read"):
        MockBus.from_rig(rig, VirtualClock(), ends[0], ends[1])
    path.write_text(text + '\n[mock]\nloads = "loads.toml"\n')
    with pytest.raises(RigError, match="loads goes with plant"):
        load_rig(path)
