"""`ori-deploy serve`: a controller that stays, in a process of its own, commanded over loopback."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from ori_deploy.actuators.bus import BusClosed
from ori_deploy.deploy.controller import Controller
from ori_deploy.mav.commands import SENT_AGAIN_S
from ori_deploy.mav.ground import GroundStation, NoAnswer, Result, State, Structure, Verdict
from ori_deploy.operate.client import ask, find
from ori_deploy.operate.messages import Do, Request
from ori_deploy.telemetry.read import read_run
from tests.cli.serving import Autopilot, Served, quick_plan, serving
from tests.cli.test_operate import answer, asked, session
from tests.cli.virtual import command, is_one_line

pytestmark = pytest.mark.usefixtures("runtime_folder")

SLOWLY = 0.1
"""Of the plan's speed: a motion of a second lasts long enough for whatever shall happen in the middle of it."""


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return quick_plan(tmp_path_factory.mktemp("serve"))


def slow_down(served: Served) -> None:
    with served.station() as station:
        assert station.set_parameter("ORI_SPEED", SLOWLY) == pytest.approx(SLOWLY)


def moving(told: Structure) -> bool:
    """Well under way, and far from the end."""
    return told.state is State.MOVING and 0.05 < told.fold < 0.95


def meanwhile(do: Callable[[GroundStation], Verdict], served: Served, system: int = 255) -> Future[Verdict]:
    """A command of a station that waits for its end, in a thread."""

    def commanded() -> Verdict:
        with served.station(system) as station:
            return do(station)

    with_it = ThreadPoolExecutor(1)
    future = with_it.submit(commanded)
    with_it.shutdown(wait=False)
    return future


# -- what cannot be served -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("--link", "udpin:0.0.0.0:14560"), ("listens where other machines reach it", "--beyond-loopback")),
        (("--link", "smoke:signals"), ("not a link", "udpin:HOST:PORT")),
        (("--mavlink", "wrong.toml"), ("wrong.toml", "deploy_when")),
    ],
)
def test_settings_that_cannot_be_used_are_told_before_anything_is_opened(
    plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], parts: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("wrong.toml").write_text('schema = "ori-deploy/mavlink/1"\ndeploy_when = "whenever"\n')
    done = command("serve", plan, "--rig", plan.with_name("rig.toml"), *words)
    assert done.exit_code == 2
    is_one_line(done, *parts)


def test_a_link_that_cannot_be_opened_is_told(plan: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        link = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        done = command("serve", plan, "--rig", plan.with_name("rig.toml"), "--link", link)
    assert done.exit_code == 1
    is_one_line(done, link, "in use")


def test_a_bus_that_does_not_open_is_refused_and_nothing_moved(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def connect(_: Controller) -> None:
        raise BusClosed("/dev/ttyUSB0: cannot be opened; remedy: plug it in")

    monkeypatch.setattr(Controller, "connect", connect)
    done = command("serve", plan, "--rig", plan.with_name("rig.toml"))
    assert done.exit_code == 3
    is_one_line(done, "/dev/ttyUSB0")


# -- a signal ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_signal_brings_what_moves_to_rest_along_its_path_and_ends(plan: Path, tmp_path: Path) -> None:
    with serving(plan, tmp_path, "--log", "run.mcap", deploy_when="always") as served:
        slow_down(served)
        verdict = meanwhile(lambda station: station.deploy(), served)
        served.until(moving)
        served.process.process.send_signal(signal.SIGINT)
        status, out, err = served.process.end()
        assert verdict.result(60.0) == Verdict(Result.CANCELLED, "stopped")
    assert (status, err) == (0, "")
    assert out.splitlines()[-1].startswith("deploy: stopped in ")
    log = read_run(tmp_path / "run.mcap")
    assert np.nanmax(np.abs(np.diff(log.commanded_fold))) < 0.01  # never a jump
    assert log.rate[-1] == 0.0
    orders = [(one["command"], one["arguments"]) for one in log.commands if one["command"].startswith("order ")]
    assert orders == [("order deploy", "system 255 component 190")]


@pytest.mark.slow
def test_an_emergency_stop_is_heard_while_a_signal_brings_it_to_rest(plan: Path, tmp_path: Path) -> None:
    """Reproduced: nobody was listened to after the signal, and it went on for all of its ramp."""
    (tmp_path / plan.name).write_bytes(plan.read_bytes())
    rig = tomllib.loads(plan.with_name("rig.toml").read_text())
    rig["controller"]["hold_ramp_s"] = 2.0  # the longest there is
    (tmp_path / "rig.toml").write_text(tomli_w.dumps(rig))
    with serving(tmp_path / plan.name, tmp_path, deploy_when="always") as served:
        slow_down(served)
        verdict = meanwhile(lambda station: station.deploy(), served)
        served.until(moving)
        serves = find(served.process.pid)
        served.process.process.send_signal(signal.SIGINT)
        served.process.until("moving -> stopping")
        (refused,) = ask(serves, Request(Do.STOW))
        (stopped,) = ask(serves, Request(Do.ESTOP))
        _, out, _ = served.process.end()
        assert not verdict.result(60.0).accepted
    assert (refused.took, stopped.took) == (False, True)
    assert "told to end" in str(refused.why)
    assert "stopping -> fault" in out


@pytest.mark.slow
def test_a_signal_while_nothing_moves_just_ends(plan: Path, tmp_path: Path) -> None:
    with serving(plan, tmp_path) as served:
        served.process.process.send_signal(signal.SIGTERM)
        status, out, err = served.process.end()
    assert (status, err) == (0, "")
    assert "armed" not in out  # nothing was ever powered


# -- the vehicle ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_fold_is_held_when_the_vehicle_arms_and_goes_on_only_when_told(plan: Path, tmp_path: Path) -> None:
    with serving(plan, tmp_path, "--start", "deployed") as served, Autopilot(served.port) as autopilot:
        served.until(lambda told: told.may_fold)
        with served.station() as station:
            assert station.deploy().accepted  # powered where it stands
        slow_down(served)
        verdict = meanwhile(lambda station: station.fold(), served)
        served.until(moving)
        autopilot.armed = True
        assert verdict.result(60.0) == Verdict(Result.FAILED, "vehicle changed")
        held = served.until(lambda told: told.state is State.HOLD and told.at_rest)
        autopilot.armed = False
        assert served.until(lambda told: told.may_fold).fold == held.fold
        time.sleep(SENT_AGAIN_S)  # sooner it might be the first one, sent again
        with served.station() as station:
            assert station.set_parameter("ORI_SPEED", 1.0) == 1.0
            assert station.fold().accepted


# -- stations ------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["hold", "finish"])
def test_a_station_that_dies_in_the_middle(plan: Path, tmp_path: Path, policy: str) -> None:
    with serving(plan, tmp_path, deploy_when="always", link_loss=policy, link_timeout_s=2.5) as served:
        slow_down(served)
        line = [sys.executable, "-m", "ori_deploy.cli", "gcs", "deploy", "--link", served.link]
        with subprocess.Popen(line, stdout=subprocess.DEVNULL) as station:
            served.until(moving)
            station.kill()
        if policy == "finish":
            served.until(lambda told: told.locked)
            return
        served.until(lambda told: told.state is State.HOLD and told.at_rest)
        with served.station() as again:
            assert again.set_parameter("ORI_SPEED", 1.0) == 1.0
            assert again.deploy().accepted


@pytest.mark.slow
def test_two_stations_want_the_same_and_a_third_stops_it(plan: Path, tmp_path: Path) -> None:
    with serving(plan, tmp_path, deploy_when="always", commanders=[255, 254, 253]) as served:
        slow_down(served)
        verdicts = [meanwhile(lambda station: station.deploy(), served, system) for system in (255, 254)]
        served.until(moving)
        with served.station(253) as station:
            assert station.stop() == Verdict(Result.ACCEPTED, "none")
        assert [one.result(60.0) for one in verdicts] == [Verdict(Result.CANCELLED, "stopped")] * 2
        assert served.status().state is State.ARMED


@pytest.mark.slow
def test_what_a_station_has_set_lasts_over_a_restart(plan: Path, tmp_path: Path) -> None:
    with serving(plan, tmp_path, parameters_file="set.json") as served:
        slow_down(served)
    with serving(plan, tmp_path, parameters_file="set.json") as served, served.station() as station:
        assert station.parameters()["ORI_SPEED"] == pytest.approx(SLOWLY)


# -- another terminal ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_another_terminal_sees_it_pauses_it_and_is_interlocked_too(plan: Path, tmp_path: Path) -> None:
    with serving(plan, tmp_path, deploy_when="always") as served:
        slow_down(served)
        verdict = meanwhile(lambda station: station.deploy(), served)
        served.until(moving)
        pid = served.process.pid
        assert answer("pause", "--wait", "--pid", pid, cwd=tmp_path)["state"] == "hold"
        assert served.status().state is State.HOLD
        assert verdict.result(60.0) == Verdict(Result.FAILED, "held")
        assert asked("stop", "--pid", pid, cwd=tmp_path).returncode == 0
        served.until(lambda told: told.state is State.ARMED)


@pytest.mark.slow
def test_without_a_network_it_serves_other_terminals(plan: Path, tmp_path: Path) -> None:
    with session(tmp_path, "serve", plan, "--rig", plan.with_name("rig.toml")) as running:
        running.until("orders from other terminals")
        assert answer("status", "--pid", running.pid, cwd=tmp_path)["state"] == "ready"


# -- processes that die --------------------------------------------------------------------------------


def child_of(served: Served, module: str) -> int:
    """A process of it, by what it runs."""
    tasks = Path(f"/proc/{served.process.pid}/task")
    children = [int(pid) for task in tasks.iterdir() for pid in (task / "children").read_text().split()]
    (found,) = [pid for pid in children if module.encode() in Path(f"/proc/{pid}/cmdline").read_bytes()]
    return found


@pytest.mark.slow
def test_the_death_of_the_recorder_is_told_with_the_next_motion(plan: Path, tmp_path: Path) -> None:
    """Reproduced: `succeeded`, and not a word before the session ended."""
    with serving(plan, tmp_path, "--log", "run.mcap", deploy_when="always") as served:
        os.kill(child_of(served, "ori_deploy.telemetry"), signal.SIGKILL)
        with served.station() as station:
            assert station.deploy().accepted
        served.process.until("warning: the motion went on without an observer")
        served.process.process.send_signal(signal.SIGINT)
        served.process.end()


@pytest.mark.slow
def test_the_process_that_speaks_dies_in_the_middle(plan: Path, tmp_path: Path) -> None:
    with serving(plan, tmp_path, deploy_when="always", parameters_file="set.json") as served:
        slow_down(served)
        before = child_of(served, "ori_deploy.mav.process")
        meanwhile(lambda station: station.deploy(timeout_s=5.0), served)
        served.until(moving)
        os.kill(before, signal.SIGKILL)
        served.process.until("error: the process that speaks MAVLink is gone")
        served.process.until("-> hold")
        held = served.until(lambda told: told.state is State.HOLD and told.at_rest)  # another speaks by then
        assert child_of(served, "ori_deploy.mav.process") != before
        assert 0.0 < held.fold < 1.0
        with served.station() as station:
            assert station.set_parameter("ORI_SPEED", 1.0) == 1.0
            assert station.deploy().accepted


@pytest.mark.slow
def test_the_loop_dies_and_nobody_speaks_for_it(plan: Path, tmp_path: Path) -> None:
    with serving(plan, tmp_path, deploy_when="always") as served:
        speaker = Path(f"/proc/{child_of(served, 'ori_deploy.mav.process')}")
        slow_down(served)
        verdict = meanwhile(lambda station: station.deploy(), served)
        served.until(moving)
        served.process.process.kill()
        with pytest.raises(NoAnswer, match="fell silent"):
            verdict.result(60.0)
        assert not speaker.exists()


@pytest.mark.slow
def test_a_fault_says_what_leads_on_and_what_is_held_is_given_up_at_the_end(plan: Path, tmp_path: Path) -> None:
    with serving(plan, tmp_path, deploy_when="always") as served:
        slow_down(served)
        verdict = meanwhile(lambda station: station.deploy(), served)
        served.until(moving)
        pid = served.process.pid
        assert asked("estop", "--pid", pid, "--wait", cwd=tmp_path).returncode == 0
        assert verdict.result(60.0).result is Result.FAILED
        served.process.until("`ori-deploy clear-fault` or `ori-deploy gcs clear-fault`")
        cleared = answer("clear-fault", "--pid", pid, cwd=tmp_path)
        assert (cleared["took"], cleared["fault"], cleared["state"]) == (True, None, "armed")
        meanwhile(lambda station: station.deploy(), served)
        served.until(moving)
        assert asked("pause", "--pid", pid, "--wait", cwd=tmp_path).returncode == 0
        os.kill(pid, signal.SIGINT)
        status, out, _ = served.process.end()
        assert (status, "deploy: stopped" in out) == (0, True), out


# -- a terminal that is gone ---------------------------------------------------------------------------


@pytest.mark.slow
def test_an_output_that_takes_nothing_ends_no_session(plan: Path, tmp_path: Path) -> None:
    """Reproduced: on a full disk, or after a logout, the first pause ended the loop that holds the structure."""
    line = [sys.executable, "-m", "ori_deploy.cli", "serve", str(plan), "--rig", str(plan.with_name("rig.toml"))]
    with Path("/dev/full").open("w") as full:
        process = subprocess.Popen(line, cwd=tmp_path, stdout=full, stderr=subprocess.DEVNULL)
    try:
        there = ("--pid", process.pid)
        deadline = time.monotonic() + 30.0
        while asked("status", *there, cwd=tmp_path).returncode != 0:
            assert process.poll() is None
            assert time.monotonic() < deadline
        (begun,) = ask(find(process.pid), Request(Do.DEPLOY))
        assert begun.took
        assert asked("estop", *there, cwd=tmp_path).returncode == 0
        time.sleep(0.5)
        assert answer("status", *there, cwd=tmp_path)["state"] == "fault"
        assert asked("clear-fault", *there, cwd=tmp_path).returncode == 0
        assert process.poll() is None
        process.send_signal(signal.SIGTERM)
        assert process.wait(30.0) == 0
    finally:
        process.kill()
        process.wait()
