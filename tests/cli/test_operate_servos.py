"""A session on virtual servos, commanded from a second terminal, and a second program that wants its port."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from sim_backends.dynamixel.from_rig import spec_for_files
from sim_backends.dynamixel.launcher import VirtualBus
from tests.cli.test_operate import answer, asked, session
from tests.cli.virtual import patient_wing

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("runtime_folder")]


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return patient_wing(tmp_path_factory.mktemp("operated_servos"), slack_s=0.03, watchdog_s=0.5, lost=5)


@pytest.fixture
def bus(plan: Path, tmp_path: Path) -> Iterator[VirtualBus]:
    """The wing's servos, behind a link."""
    with VirtualBus(spec_for_files(plan.with_name("rig.toml"), plan, "stowed"), link=tmp_path / "ttyDXL") as made:
        yield made


def deploying(plan: Path, bus: VirtualBus) -> tuple[object, ...]:
    """The words of a deployment on the bus."""
    return ("deploy", plan, "--rig", plan.with_name("rig.toml"), "--port", bus.link)


def shafts(bus: VirtualBus) -> np.ndarray:
    truth = bus.truth()
    return np.array([truth[i].output_rad for i in sorted(truth)])


def test_paused_servos_are_held_and_fed_and_go_on(plan: Path, bus: VirtualBus, tmp_path: Path) -> None:
    with session(tmp_path, *deploying(plan, bus)) as running:
        running.until("-> moving")
        paused = answer("pause", "--wait", "--port", bus.link, cwd=tmp_path)
        assert (paused["pid"], paused["state"], paused["at_rest"]) == (running.pid, "hold", True)
        before = shafts(bus)
        time.sleep(1.5)  # three times what the servos' watchdogs allow
        truth = bus.truth()
        assert all(servo.torque_on and not servo.frozen for servo in truth.values())
        np.testing.assert_allclose(shafts(bus), before, atol=0.01)
        told = answer("status", "--port", bus.link, cwd=tmp_path)
        assert told["ports"] == [str(bus.link)]
        assert told["fault"] is None
        done = asked("resume", "--wait", "--port", bus.link, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert running.end()[0] == 0


def test_a_second_program_is_told_who_has_the_port_until_kill_9(plan: Path, bus: VirtualBus, tmp_path: Path) -> None:
    words = deploying(plan, bus)
    with session(tmp_path, *words) as running:
        running.until("-> moving")
        answer("pause", "--wait", "--pid", running.pid, cwd=tmp_path)  # it has the port for as long as this takes
        device = os.path.realpath(bus.link)
        for second in (words, ("bus", "ping", 1, "--port", device), ("mcu", "info", "--port", device)):
            done = asked(*second, cwd=tmp_path)
            assert running.process.poll() is None, running.end()
            assert done.returncode == 3, done.stdout
            assert done.stderr.count("\n") == 1
            assert f"another program has it (pid {running.pid}, ori-deploy deploy {plan} --rig " in done.stderr
            assert "; remedy: end that program" in done.stderr
        assert answer("status", "--pid", running.pid, cwd=tmp_path)["fault"] is None  # nobody disturbed it
        os.kill(running.pid, signal.SIGKILL)
        running.process.wait()
        assert asked("bus", "ping", 1, "--port", device, cwd=tmp_path).returncode == 0


def test_an_emergency_stop_leaves_servos_holding(plan: Path, bus: VirtualBus, tmp_path: Path) -> None:
    with session(tmp_path, *deploying(plan, bus)) as running:
        running.until("-> moving")
        assert asked("estop", "--wait", "--port", bus.link, cwd=tmp_path).returncode == 0
        assert running.end()[0] == 1
        assert all(servo.torque_on for servo in bus.truth().values())
