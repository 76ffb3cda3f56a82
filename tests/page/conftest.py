"""Files of the example wing, made once, with a log of its deployment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from sim_backends.dynamixel.from_rig import spec_for_files
from sim_backends.dynamixel.launcher import VirtualBus
from tests.cli.inside import run
from tests.cli.virtual import patient_wing

EXAMPLES = Path(__file__).parents[2] / "examples"
RIG = EXAMPLES / "rig_mock.toml"


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with designs of a wing, a cone and a wing in segments, plans, and a log of the wing."""
    folder = tmp_path_factory.mktemp("page")
    for name, example in (("wing", "wing_naca2412"), ("span", "wing_span_3"), ("cone", "cone_circular_6")):
        spec, design = EXAMPLES / f"{example}.toml", f"{name}.design.json"
        assert run("design", spec, "-o", design, cwd=folder).returncode == 0
        if name != "cone":
            assert run("plan", design, "--rig", RIG, "-o", f"{name}.plan.json", cwd=folder).returncode == 0
    done = run("deploy", "wing.plan.json", "--rig", RIG, "--log", "run.mcap", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


@dataclass
class ServoWing:
    """The example wing, stowed, on virtual servos."""

    plan: Path
    bus: VirtualBus

    @property
    def serving(self) -> tuple[object, ...]:
        """The words that serve it, with a page."""
        rig = self.plan.with_name("rig.toml")
        return ("serve", self.plan, "--rig", rig, "--port", self.bus.link, "--view", "--view-port", 0)

    def shafts(self) -> tuple[float, ...]:
        """Where the servos truly stand."""
        return tuple(servo.output_rad for servo in self.bus.truth().values())


@pytest.fixture(scope="session")
def servo_plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan of the example wing, and its rig beside it; a browser that draws without a graphics card needs time."""
    return patient_wing(tmp_path_factory.mktemp("page_servos"), slack_s=0.05, watchdog_s=0.8, lost=10)


@pytest.fixture
def servo_wing(servo_plan: Path, tmp_path: Path) -> Iterator[ServoWing]:
    """Servos of their own for one test."""
    spec = spec_for_files(servo_plan.with_name("rig.toml"), servo_plan, "stowed")
    with VirtualBus(spec, link=tmp_path / "ttyDXL") as bus:
        yield ServoWing(servo_plan, bus)
