"""The doctor finds what is wrong, says what to do, and leaves everything as it is."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

import ori_deploy.cli.doctor as doctor_module
from ori_deploy.cli import bus_common
from ori_deploy.wire.dynamixel import model_named
from sim_backends.dynamixel_bus import ServoSpec, VirtualBus
from tests.cli.virtual import Running, command, is_one_line, virtual_bus

pytestmark = pytest.mark.slow  # servos and their answers take real time

RIG = Path(__file__).parents[2] / "examples" / "rig_wing_dynamixel.toml"
FOUR = tuple(ServoSpec(id=i) for i in (1, 2, 3, 4))


@pytest.fixture(autouse=True)
def fewer_rates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each rate takes a second of silence; where it matters, servos are at one of these."""
    for module in (doctor_module, bus_common):
        monkeypatch.setattr(module, "USUAL_BAUDS", (57_600, 1_000_000))


def doctor(bus: VirtualBus, *words: object) -> Result:
    return command("doctor", "--port", bus.link, *words, "--json")


def findings(result: Result, status: str | None = None) -> list[dict[str, str]]:
    told = json.loads(result.stdout)
    kinds = {"ok": "ok", "warnings": "warning", "problems": "problem"}
    for key, kind in kinds.items():
        assert told[key] == sum(finding["status"] == kind for finding in told["findings"])
    assert result.exit_code == (1 if told["problems"] else 0), result.output
    for finding in told["findings"]:
        assert set(finding) == {"check", "about", "status", "value", "limit", "remedy"}
        assert finding["status"] == "ok" or (finding["remedy"] and finding["value"])
    return [finding for finding in told["findings"] if status in (None, finding["status"])]


def the(found: list[dict[str, str]], check: str) -> dict[str, str]:
    (one,) = [finding for finding in found if finding["check"] == check]
    return one


def rig_file(folder: Path, *changes: tuple[str, str]) -> Path:
    path = folder / "rig.toml"
    text = RIG.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return path


def set_up(bus: VirtualBus) -> None:
    """As a controller leaves servos."""
    for servo_id in bus.truth():
        bus.set_register(servo_id, "return_delay_time", 0)


def test_a_good_bus_has_no_problem_and_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus_common, "BENCH_SLACK_S", 0.5)  # an answer that a busy machine holds back is not lost
    monkeypatch.setattr("ori_deploy.bench.diagnosis.ASKS", 2)  # each waits that long for a second answer
    names = [register.name for register in model_named("xm430").table if register.writable]
    with virtual_bus(tmp_path, *FOUR) as bus:
        set_up(bus)
        before = {i: [bus.register(i, name) for name in names] for i in bus.truth()}
        found = findings(doctor(bus, "--rig", rig_file(tmp_path)))
        after = {i: [bus.register(i, name) for name in names] for i in bus.truth()}
        assert all(servo.moved_s < 0.0 for servo in bus.truth().values())
    assert after == before
    assert [finding for finding in found if finding["status"] != "ok"] == []
    assert {finding["check"] for finding in found} >= {
        "port", "permission", "free", "latency timer", "servos answer", "one baud rate", "one servo per id",
        "servos are the rig's", "status return level", "firmware", "return delay", "hardware error", "supply",
        "temperature", "loop rate", "turns",
    }  # fmt: skip


def test_warnings_alone_end_with_status_0_and_are_shown_once(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, *FOUR) as bus:
        shown = command("doctor", "--port", bus.link)
    assert shown.exit_code == 0
    assert len(re.findall("WARNING  return delay", shown.stdout)) == 1
    assert "servo 1, 2, 3, 4" in shown.stdout
    assert "500 us; limit: 0 us; remedy: " in shown.stdout
    assert "problems: 0, warnings: 4" in shown.stdout


def test_two_servos_of_one_id_are_told_from_a_bad_cable(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, *FOUR, ServoSpec(id=3, start_rad=1.0)) as bus:
        found = findings(doctor(bus), "problem")
    assert the(found, "one servo per id")["about"] == "servo 3"
    assert "set-id 3" in the(found, "one servo per id")["remedy"]


def test_a_lost_or_damaged_answer_is_no_missing_servo(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, *FOUR) as bus:
        set_up(bus)
        rig = rig_file(tmp_path)
        for spoil, count in ((bus.drop, 2), (bus.corrupt, 5)):
            spoil(2, count)
            assert not findings(doctor(bus, "--rig", rig), "problem")


def test_servos_at_another_rate_are_found(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, *FOUR[:3], replace(FOUR[3], baud=57_600)) as bus:
        found = findings(doctor(bus, "--rig", rig_file(tmp_path)), "problem")
    rate = the(found, "one baud rate")
    assert (rate["about"], rate["value"]) == ("servo 4", "57600 baud")
    assert rate["remedy"] == "ori-deploy bus set-baud 4 1000000 --baud 57600"
    assert the(found, "servos are the rig's")["about"] == "servo_4 (id 4)"


def test_servos_that_are_not_the_rigs_are_named(tmp_path: Path) -> None:
    servos = (FOUR[0], ServoSpec(id=2, model="XL430-W250"), FOUR[2], ServoSpec(id=9))
    with virtual_bus(tmp_path, *servos) as bus:
        found = findings(doctor(bus, "--rig", rig_file(tmp_path)))
    ours = {finding["about"]: finding for finding in found if finding["check"] == "servos are the rig's"}
    assert ours["servo_1 (id 1)"]["status"] == "ok"
    assert (ours["servo_2 (id 2)"]["value"], ours["servo_2 (id 2)"]["limit"]) == ("XL430-W250", "XM430-W350")
    assert ours["servo_4 (id 4)"]["value"] == "does not answer"
    assert ours["servo 9"]["status"] == "warning"


def test_old_firmware_counts_for_what_the_rig_wants_of_it(tmp_path: Path) -> None:
    servos = (replace(FOUR[0], firmware=37), replace(FOUR[1], firmware=44), *FOUR[2:])
    with virtual_bus(tmp_path, *servos) as bus:
        alone = [f for f in findings(doctor(bus)) if f["check"] == "firmware"]
        rigged = [f for f in findings(doctor(bus, "--rig", rig_file(tmp_path))) if f["check"] == "firmware"]
    assert [finding["status"] for finding in alone] == ["warning", "warning", "ok", "ok"]
    assert [finding["status"] for finding in rigged] == ["problem", "warning", "ok", "ok"]
    assert "watchdog_s = 0" in rigged[0]["remedy"]


def test_registers_errors_supply_and_heat_are_judged(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, *FOUR) as bus:
        set_up(bus)
        bus.set_register(1, "status_return_level", 1)
        bus.set_register(2, "status_return_level", 0)
        bus.fail(3, 0x20)
        bus.heat(4, 66.0)
        bus.sag(1.7)
        found = findings(doctor(bus, "--rig", rig_file(tmp_path)))
    levels = {f["about"]: f["status"] for f in found if f["check"] == "status return level"}
    assert levels == {"servo 1": "warning", "servo 2": "problem", "servo 3": "ok", "servo 4": "ok"}
    error = the([f for f in found if f["status"] == "problem"], "hardware error")
    assert (error["about"], error["value"]) == ("servo 3", "overload")
    assert "reset-error 3" in error["remedy"]
    supply = [f for f in found if f["check"] == "supply"]
    assert {f["status"] for f in supply} == {"problem"}
    assert "10.3 V" in supply[0]["value"]
    assert "10.5" in supply[0]["limit"]
    heat = {f["about"]: f["status"] for f in found if f["check"] == "temperature"}
    assert heat["servo 4"] == "warning"
    assert heat["servo 1"] == "ok"


def test_a_rate_that_the_bus_cannot_follow_is_a_problem(tmp_path: Path) -> None:
    """With firmware that knows no fast read the loop takes longer than the rig reckons with."""
    with virtual_bus(tmp_path, *(replace(servo, firmware=44) for servo in FOUR)) as bus:
        rig = rig_file(tmp_path, ("rate_hz = 100.0", "rate_hz = 150.0"))
        found = findings(doctor(bus, "--rig", rig))
    rate = the(found, "loop rate")
    assert "with sync read" in rate["value"]
    assert rate["limit"] == "rate_hz = 150"


def test_servos_of_many_turns_that_restarted_are_a_warning(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, *FOUR) as bus:
        set_up(bus)
        rig = rig_file(tmp_path, ("max_position_rad = 3.13", "max_position_rad = 6.0"))
        found = [f for f in findings(doctor(bus, "--rig", rig)) if f["check"] == "turns"]
    assert [finding["status"] for finding in found] == 4 * ["warning"]
    assert "--stands" in found[0]["remedy"]


def test_a_silent_bus_is_a_problem(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        bus.mute(1)
        found = findings(doctor(bus), "problem")
    assert the(found, "servos answer")["value"].startswith("nobody")


def test_a_port_in_use_is_told_and_left_alone(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, *FOUR) as bus:
        words = ("bus", "monitor", 1, "--port", bus.link, "--baud", 1_000_000, "--json")
        with Running(*words, cwd=tmp_path) as other:
            assert other.line()
            busy = findings(doctor(bus), "problem")
    assert the(busy, "free")["remedy"]


def test_a_port_that_is_not_there_or_no_port_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for name, says in (("none", "no such device"), ("file", "not a device")):
        told = command("doctor", "--port", tmp_path / name, "--json")
        assert the(findings(told), "port")["value"] == says


def test_a_board_is_looked_for_where_it_was_said_to_be_or_not_at_all(tmp_path: Path) -> None:
    board = RIG.with_name("rig_wing_mcu.toml")
    here, there = tmp_path / "here", tmp_path / "there"
    for words in (("--mcu-port", here), ("--port", here), ("--port", here, "--mcu-port", here)):
        (found,) = findings(command("doctor", "--rig", board, *words, "--json"))
        assert (found["about"], found["value"]) == (str(here), "no such device")
    for words in (("--rig", board, "--port", there), ("--port", there), ("--rig", RIG)):
        refused = command("doctor", *words, "--mcu-port", here)
        assert refused.exit_code == 2
        is_one_line(refused, "--mcu-port: ", str(here), "limit: ", "remedy: ")


def test_a_port_that_may_not_be_used_names_the_group(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)
    found = doctor_module.port_findings("/dev/null")[-1]
    assert (found.check, found.verdict) == ("permission", "problem")
    assert found.limit.startswith("group ")
    assert "usermod" in found.remedy


def test_what_a_process_has_open_is_seen(tmp_path: Path) -> None:
    (tmp_path / "device").write_text("")
    code = f"import sys; f = open({str(tmp_path / 'device')!r}); print(1, flush=True); sys.stdin.read()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline()
        holders = doctor_module._holders((tmp_path / "device").resolve())
        other.communicate()
    assert any(f"(process {other.pid})" in holder for holder in holders)


@pytest.mark.parametrize(("latency_s", "status"), [(0.016, "warning"), (0.001, "ok"), (None, "ok")])
def test_the_latency_timer_is_judged(monkeypatch: pytest.MonkeyPatch, latency_s: float | None, status: str) -> None:
    def timer(*_: Any) -> float | None:
        return latency_s

    monkeypatch.setattr(doctor_module, "latency_timer_s", timer)
    monkeypatch.setattr("ori_deploy.actuators.dynamixel.adapter.latency_timer_s", timer)
    found = doctor_module._latency("/dev/ttyUSB0")
    assert found.verdict == status
    if status == "warning":
        assert (found.value, found.limit) == ("16 ms", "1 ms")
        assert "latency_timer" in found.remedy


def test_help_has_an_example() -> None:
    assert "ori-deploy doctor --rig" in command("doctor", "--help").stdout.split("Example:")[1]
