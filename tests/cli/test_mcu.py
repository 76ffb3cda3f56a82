"""The wing on the firmware by the command line: the real port, the real wire, the same image as on the board."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from sim_backends.microcontroller.build import Port
from sim_backends.microcontroller.from_rig import Start, world_for_files
from sim_backends.microcontroller.launcher import Microcontroller
from tests.cli.test_dynamixel import EXAMPLES, end, is_decided_the_same_again, run
from tests.cli.virtual import simulator
from tests.sim_backends.microcontroller.bench import need

RIG = EXAMPLES / "rig_wing_mcu.toml"
FRAME_S = 0.02
SILENCE_S = 0.4


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wing's plan, and the shipped rig with a patient board and a slow loop.

    The machine that runs the tests has other things to do as well.
    """
    folder = tmp_path_factory.mktemp("mcu")
    text = RIG.read_text()
    for old, new in (
        ("rate_hz = 50.0 ", "rate_hz = 20.0 "),
        ("silence_s = 0.15 ", f"reply_timeout_s = 0.05\nmin_lead_s = 0.5\nsilence_s = {SILENCE_S} "),
        ("lead_s = 0.3 ", "lead_s = 0.8 "),
        ("path_tolerance_rad = 0.10 ", "path_tolerance_rad = 0.2 "),  # an emulated board's clock may be late
        ("[controller]\n", "[controller]\nlost_replies_allowed = 5\nmax_reading_age_s = 0.2\n"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    (folder / "rig.toml").write_text(text)
    assert run("design", EXAMPLES / "wing_naca2412.toml", "-o", "w.design.json", cwd=folder).returncode == 0
    done = run("plan", "w.design.json", "--rig", "rig.toml", "-o", "wing.plan.json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


@contextmanager
def board(made: Path, folder: Path, *, port: Port = "host", start: Start = "stowed") -> Iterator[Microcontroller]:
    """The wing's board, not configured yet, as ttyMCU in a folder."""
    need(port)
    world = world_for_files(made / "rig.toml", made / "wing.plan.json", start)
    with Microcontroller(world, folder / "ttyMCU", port=port) as one:
        one.wait_ready()
        yield one


def mcu(*words: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    return run("mcu", *words, "--port", cwd / "ttyMCU", cwd=cwd)


def configure(made: Path, folder: Path) -> None:
    done = mcu("config", made / "rig.toml", "--plan", made / "wing.plan.json", cwd=folder)
    assert done.returncode == 0, done.stderr


def motion(command: str, made: Path, folder: Path, *more: str | Path) -> subprocess.CompletedProcess[str]:
    words = (made / "wing.plan.json", "--rig", made / "rig.toml", "--port", folder / "ttyMCU")
    return run(command, *words, *more, cwd=folder)


@pytest.mark.slow
def test_the_wing_deploys_by_the_commands_of_the_example(made: Path, tmp_path: Path) -> None:
    """The commands in the head of the example rig, as they stand there."""
    need("atmega2560")
    text = [line.removeprefix("#   ") for line in RIG.read_text().splitlines() if line.startswith("#   ")]
    (tmp_path / "out").mkdir()
    (tmp_path / "examples").mkdir()
    shutil.copy(made / "rig.toml", tmp_path / "examples" / RIG.name)
    shutil.copy(made / "wing.plan.json", tmp_path)
    with simulator(text[0], tmp_path) as said:
        assert "atmega2560 on out/ttyMCU" in said
        for line in text[1:]:
            done = run(*line.removeprefix("ori-deploy ").split(), cwd=tmp_path)
            assert done.returncode == 0, done.stderr
        assert "state deployed" in done.stdout
        done = run("stow", *text[-1].split()[2:], "--log", "stow.mcap", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "state stowed" in done.stdout
    assert not list((tmp_path / "out").iterdir())
    is_decided_the_same_again(tmp_path / "stow.mcap")


@pytest.mark.slow
def test_a_board_is_asked_configured_watched_and_cleared(made: Path, tmp_path: Path) -> None:
    with board(made, tmp_path) as one:
        told = json.loads(mcu("info", "--json", cwd=tmp_path).stdout)
        assert (told["state"], told["config_hash"], told["config"]) == ("unconfigured", None, [])
        refused = motion("deploy", made, tmp_path)
        assert refused.returncode == 3
        assert "ori-deploy mcu config" in refused.stderr
        words = ("config", made / "rig.toml", "--plan", made / "wing.plan.json")
        assert mcu(*words, "--check", cwd=tmp_path).returncode == 1
        configure(made, tmp_path)
        assert mcu(*words, "--check", cwd=tmp_path).returncode == 0
        assert "nothing was written" in mcu(*words, cwd=tmp_path).stdout
        told = json.loads(mcu("info", "--json", cwd=tmp_path).stdout)
        assert (told["state"], told["hinges"], told["latches"]) == ("idle", 4, 1)
        assert [record["record"] for record in told["config"]] == ["device", *["hinge"] * 4, "latch"]
        one.open_wire(2)
        time.sleep(0.5)
        shown = json.loads(mcu("monitor", "--count", "1", "--json", cwd=tmp_path).stdout)
        assert [hinge["measured_rad"] is None for hinge in shown["hinges"]] == [False, False, True, False]
        assert "open wire" in mcu("monitor", "--count", "1", cwd=tmp_path).stdout
        assert "no fault" in mcu("clear-fault", cwd=tmp_path).stdout
        one.wire(2, "good")
        one.estop()
        time.sleep(0.5)
        refused = mcu("clear-fault", cwd=tmp_path)
        assert refused.returncode == 3
        assert refused.stderr.count("emergency stop") == refused.stderr.count("remedy: ") == 1
        refused = motion("deploy", made, tmp_path)
        assert refused.returncode == 3
        assert refused.stderr.count("\n") == 1  # told once, with the command that clears it
        for word in ("microcontroller: ", "emergency stop", "remedy: ", "ori-deploy mcu clear-fault --port "):
            assert refused.stderr.count(word) == 1, refused.stderr
        one.estop(False)
        time.sleep(0.5)
        assert "cleared: estop" in mcu("clear-fault", cwd=tmp_path).stdout


@pytest.mark.slow
def test_the_monitor_names_what_it_shows_and_one_servo_is_turned(made: Path, tmp_path: Path) -> None:
    rig = ("--rig", made / "rig.toml", "--plan", made / "wing.plan.json")
    jog = ("jog", made / "rig.toml", "--plan", made / "wing.plan.json", "servo_1")
    with board(made, tmp_path) as one:
        assert "supply not configured" in mcu("monitor", "--count", "1", cwd=tmp_path).stdout
        assert "not configured" in mcu("info", cwd=tmp_path).stdout
        assert json.loads(mcu("info", "--json", cwd=tmp_path).stdout)["supply_v"] is None
        assert "configuration is not the rig's" in mcu(*jog, "--by", "0.1", "--yes", cwd=tmp_path).stderr
        configure(made, tmp_path)
        page = mcu("monitor", "--count", "1", *rig, cwd=tmp_path).stdout
        for word in ("servo_4 ", "latch_slit:P-T2 ", "25.0 °C", "e-stop free", "supply 6.0"):
            assert word in page
        shown = json.loads(mcu("monitor", "--count", "1", "--json", *rig, cwd=tmp_path).stdout)
        assert shown["hinges"][0]["count"] == pytest.approx(145, abs=2)  # as in the page's table
        assert shown["hinges"][0]["name"] == "servo_1"
        assert shown["latches"][0]["name"] == "latch_slit:P-T2"
        assert shown["temperature_c"] == pytest.approx(25.0, abs=0.1)
        assert shown["estop"] is False
        before = one.truth().shaft_rad
        done = mcu(*jog, "--by", "0.1", cwd=tmp_path)
        assert done.returncode == 3
        assert "not confirmed" in done.stderr
        done = mcu(*jog, "--by", "0.1", "--yes", "--json", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        told = json.loads(done.stdout)
        assert told["holds"]
        assert told["arrived"]
        np.testing.assert_allclose(np.subtract(one.truth().shaft_rad, before), [0.1, 0.0, 0.0, 0.0], atol=0.02)
        done = mcu("torque-off", *rig, cwd=tmp_path)
        assert done.returncode == 3
        assert "servo_1 holds up falls" in done.stderr
        assert mcu("torque-off", *rig, "--yes", cwd=tmp_path).stdout.startswith("off: servo_1")
        assert "no hinge was on" in mcu("torque-off", *rig, "--yes", cwd=tmp_path).stdout
        one.estop()
        time.sleep(0.5)
        shown = json.loads(mcu("monitor", "--count", "1", "--json", *rig, cwd=tmp_path).stdout)
        assert (shown["estop"], shown["fault"]) == (True, "estop")
        assert "nothing moves" in mcu(*jog, "--by", "0.1", "--yes", cwd=tmp_path).stderr


@pytest.mark.slow
def test_the_doctor_says_what_is_wrong_with_a_board(made: Path, tmp_path: Path) -> None:
    words = ("doctor", "--rig", made / "rig.toml", "--port", tmp_path / "ttyMCU", "--json")
    plan = ("--plan", made / "wing.plan.json")

    def told(*more: str | Path) -> dict[str, dict[str, dict[str, str]]]:
        """By check, and what it is about."""
        answer = json.loads(run(*words, *more, cwd=tmp_path).stdout)
        found: dict[str, dict[str, dict[str, str]]] = {}
        for one in answer["findings"]:
            found.setdefault(one["check"], {})[one["about"]] = one
        return found

    with board(made, tmp_path) as one:
        found = told(*plan)
        assert found["configuration"]["microcontroller"]["remedy"].startswith("ori-deploy mcu config")
        configure(made, tmp_path)
        found = told(*plan)
        link = found.pop("link")["microcontroller"]  # late answers are the machine's, not the board's
        assert "round trip" in link["value"]
        assert {entry["status"] for about in found.values() for entry in about.values()} == {"ok"}
        assert found["configuration"]["microcontroller"]["value"].endswith("the rig's")
        assert set(found["feedback"]) == {"servo_1", "servo_2", "servo_3", "servo_4"}
        assert found["latch sensor"]["latch_slit:P-T2"]["value"] == "open"
        assert "--plan" in told()["configuration"]["microcontroller"]["value"]
        one.open_wire(2)
        one.thermistor(1023)
        one.supply(3.0)
        one.estop()
        time.sleep(0.5)
        found = told(*plan)
        for check, about, value, remedy in (
            ("feedback", "servo_3", "open wire at A2", "check its wire"),
            ("thermistor", "A13", "missing, or an open wire: 1023 counts", "10 kohm"),
            ("supply", "microcontroller", "3.00 V", "switch it on"),
            ("fault", "microcontroller", "estop: emergency stop", "ori-deploy mcu clear-fault"),
        ):
            assert found[check][about]["status"] == "problem"
            assert value in found[check][about]["value"]
            assert remedy in found[check][about]["remedy"]
        assert run(*words, *plan, cwd=tmp_path).returncode == 1


@pytest.mark.slow
def test_the_doctor_says_what_is_at_a_port_that_nobody_told_it_of(made: Path, tmp_path: Path) -> None:
    with board(made, tmp_path) as one:
        words = ("doctor", "--port", tmp_path / "ttyMCU", "--json")
        told = {one["check"]: one for one in json.loads(run(*words, cwd=tmp_path).stdout)["findings"]}
        assert told["device"]["value"].startswith("microcontroller (")
        assert "servos answer" not in told
        configure(made, tmp_path)
        one.estop()
        time.sleep(0.5)
        done = run(*words, cwd=tmp_path)
        assert done.returncode == 1
        fault = next(one for one in json.loads(done.stdout)["findings"] if one["check"] == "fault")
        assert fault["value"].startswith("estop: ")
        assert "ori-deploy mcu clear-fault" in fault["remedy"]


@pytest.mark.slow
def test_servos_without_feedback_are_asked_for_in_the_words_of_the_command(made: Path, tmp_path: Path) -> None:
    text = (made / "rig.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("feedback_")]
    blind = tmp_path / "blind.toml"
    blind.write_text("\n".join(lines).replace("pulse_max_us = 2500.0", "pulse_max_us = 2500.0\nopen_loop = true"))
    with board(made, tmp_path):
        done = mcu("config", blind, "--plan", made / "wing.plan.json", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        words = ("deploy", made / "wing.plan.json", "--rig", blind, "--port", tmp_path / "ttyMCU")
        refused = run(*words, cwd=tmp_path)
        assert refused.returncode == 3
        assert "nobody knows where servo_1, servo_2, servo_3, servo_4 stand" in refused.stderr
        assert refused.stderr.strip().endswith("--stands stowed or --stands deployed")


@pytest.mark.slow
def test_what_cannot_be_is_one_line(made: Path, tmp_path: Path) -> None:
    for words, status, told in (
        (("mcu", "info", "--port", "nowhere"), 3, "nowhere cannot be opened"),
        (("mcu", "info", "--rig", EXAMPLES / "rig_mock.toml"), 2, "a table [mcu]"),
        (
            ("mcu", "info", "--port", "nowhere", "--baud", "115200"),
            2,
            "115200 is no rate of the firmware; limit: 500000",
        ),
        (("mcu", "flash", "--port", "x", "--hex", "no.hex"), 2, "make -C firmware"),
        (("mcu", "config", EXAMPLES / "rig_mock.toml", "--plan", made / "wing.plan.json"), 2, "rate_hz"),
    ):
        done = run(*words, cwd=tmp_path)
        assert done.returncode == status, done.stderr
        assert done.stderr.count("\n") == 1
        assert told in done.stderr


@pytest.mark.slow
def test_the_configuration_outlasts_power_and_another_rig_is_refused(made: Path, tmp_path: Path) -> None:
    with board(made, tmp_path, port="atmega2560") as one:
        configure(made, tmp_path)
        one.power_cycle()
        one.wait_ready()
        told = json.loads(mcu("info", "--json", cwd=tmp_path).stdout)
        assert (told["state"], told["starts"], told["last_start"]) == ("idle", 2, "power")
        other = tmp_path / "other.toml"
        other.write_text((made / "rig.toml").read_text().replace("max_position_rad = 2.3", "max_position_rad = 2.35"))
        done = run(
            "deploy", made / "wing.plan.json", "--rig", other, "--port", tmp_path / "ttyMCU", cwd=tmp_path
        )  # fmt: skip
        assert done.returncode == 3
        assert "configuration is not the rig's" in done.stderr


def begin(made: Path, folder: Path) -> subprocess.Popen[str]:
    """A deployment in the middle of its motion."""
    command = [sys.executable, "-u", "-m", "ori_deploy.cli", "deploy", str(made / "wing.plan.json")]
    command += ["--rig", str(made / "rig.toml"), "--port", str(folder / "ttyMCU"), "--log", "flight.mcap"]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        if "-> moving" in line:
            break
    time.sleep(3.0)
    return process


@pytest.mark.slow
def test_kill_9_ends_in_hold_in_time_and_the_next_session_has_to_clear_it(made: Path, tmp_path: Path) -> None:
    with board(made, tmp_path, port="atmega2560") as one:
        configure(made, tmp_path)
        process = begin(made, tmp_path)
        latches = one.truth().latches
        os.kill(process.pid, signal.SIGKILL)
        killed_s = one.truth().time_us * 1e-6
        process.communicate(timeout=10)
        time.sleep(SILENCE_S + 0.5)
        pulses = one.pulses()
        for output in range(4):
            mine = pulses.of(output)
            changes = mine.time_s[1:][np.diff(mine.width) != 0]
            assert changes[-1] > killed_s - 0.1  # it moved
            assert changes[-1] <= killed_s + SILENCE_S + FRAME_S
            assert mine.time_s[-1] > killed_s + SILENCE_S + 0.2  # and holds
        assert one.truth().latches == latches
        is_decided_the_same_again(tmp_path / "flight.mcap")
        refused = motion("deploy", made, tmp_path)
        assert refused.returncode == 3
        assert "host silent" in refused.stderr or "heard nothing" in refused.stderr
        assert "cleared: host silent" in mcu("clear-fault", cwd=tmp_path).stdout
        done = motion("deploy", made, tmp_path)
        assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_ctrl_c_comes_to_rest_along_the_path_and_leaves_no_fault(made: Path, tmp_path: Path) -> None:
    with board(made, tmp_path) as one:
        configure(made, tmp_path)
        process = begin(made, tmp_path)
        process.send_signal(signal.SIGINT)
        errors = end(process)
        assert process.returncode == 130
        assert "interrupted: brought to rest along its path" in errors
        is_decided_the_same_again(tmp_path / "flight.mcap")
        told = json.loads(mcu("info", "--json", cwd=tmp_path).stdout)
        assert (told["state"], told["fault"]) == ("holding", "none")
        before = one.truth().shaft_rad
        done = motion("deploy", made, tmp_path)
        assert done.returncode == 0, done.stderr
        assert before != one.truth().shaft_rad


def test_an_image_that_is_not_verified_may_have_been_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "avrdude").symlink_to("/bin/false")
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    (tmp_path / "image.hex").write_text(":00000001FF\n")
    ends = os.openpty()
    try:
        done = run("mcu", "flash", "--port", os.ttyname(ends[1]), "--hex", "image.hex", cwd=tmp_path)
    finally:
        for end_of_line in ends:
            os.close(end_of_line)
    assert done.returncode == 1  # 3 would say that nothing was changed
    assert "avrdude ended with status 1" in done.stderr
