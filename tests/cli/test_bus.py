"""The bench commands against virtual servos."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from serial.tools import list_ports

from ori_deploy.actuators.dynamixel import line
from ori_deploy.bench.servos import USUAL_BAUDS
from ori_deploy.cli.bus import bus as group
from sim_backends.dynamixel_bus import ServoSpec, VirtualBus
from tests.cli.virtual import Running, bus_command, command, document, is_one_line, virtual_bus

pytestmark = pytest.mark.slow  # servos and their answers take real time

EXAMPLES = Path(__file__).parents[2] / "examples"
XM = "XM430-W350"
XL = "XL430-W250"
OVERLOAD, OVERHEATING = 0x20, 0x04


def hold(bus: VirtualBus, servo_id: int) -> None:
    """Torque on where it stands."""
    assert bus_command("jog", bus, servo_id, "--by", 0, "--hold").exit_code == 0


# -- who is there --------------------------------------------------------------------------------------


def test_scan_tells_ids_models_firmware_alerts_and_every_rate(tmp_path: Path) -> None:
    servos = (ServoSpec(id=1, model=XM), ServoSpec(id=7, model=XL, firmware=40, baud=57_600))
    with virtual_bus(tmp_path, *servos) as bus:
        bus.fail(1, OVERLOAD)
        told = document(command("bus", "scan", "--port", bus.link, "--json"))
        shown = command("bus", "scan", "--port", bus.link, "--baud", 57_600)
    assert told["bauds_tried"] == list(USUAL_BAUDS)
    by_id = {servo["id"]: servo for servo in told["servos"]}
    assert by_id[1] == {
        "id": 1, "baud": 1_000_000, "model": XM, "model_number": 1020, "firmware": 48, "alert": True,
    }  # fmt: skip
    assert (by_id[7]["baud"], by_id[7]["firmware"], by_id[7]["alert"]) == (57_600, 40, False)
    assert told["damaged"] == []
    assert f"7   57600  {XL}" in shown.stdout


def test_scan_says_where_two_servos_share_an_id(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1), ServoSpec(id=4), ServoSpec(id=4, model=XL)) as bus:
        told = document(bus_command("scan", bus, "--json"))
    assert [servo["id"] for servo in told["servos"]] == [1]
    assert told["damaged"] == [{"id": 4, "baud": 1_000_000}]


def test_scan_of_an_empty_line_says_so(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        shown = bus_command("scan", bus, baud=4_000_000)
    assert shown.exit_code == 0
    assert "nobody answers" in shown.stdout
    assert "4000000" in shown.stdout


def test_ping_finds_a_servo_at_whichever_rate_it_has(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=3, baud=3_000_000)) as bus:
        told = document(command("bus", "ping", 3, "--port", bus.link, "--json"))
        missing = command("bus", "ping", 4, "--port", bus.link)
    assert (told["id"], told["baud"], told["model"]) == (3, 3_000_000, XM)
    assert missing.exit_code == 3
    is_one_line(missing, "servo 4 does not answer", "57600", "4000000", "remedy: ")


def test_info_tells_registers_in_si_units_and_words(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1, start_rad=1.0)) as bus:
        few = document(bus_command("info", bus, 1, "--json"))["registers"]
        every = document(bus_command("info", bus, 1, "--all", "--json"))["registers"]
        shown = bus_command("info", bus, 1).stdout
    assert few["present_position"]["value_rad"] == pytest.approx(1.0, abs=2e-3)
    assert few["present_input_voltage"] == {"address": 144, "value": 120, "value_v": 12.0}
    assert few["return_delay_time"]["value_s"] == pytest.approx(500e-6)
    assert few["current_limit"]["value_a"] == pytest.approx(1193 * 2.69e-3)
    assert few["operating_mode"]["meaning"] == "position"
    assert few["hardware_error_status"]["meaning"] == "none"
    assert set(few) < set(every)
    assert every["position_p_gain"]["value"] == 800
    assert "12 V" in shown


def test_a_rig_gives_port_and_rate_and_options_take_precedence(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1, baud=2_000_000)) as bus:
        rig = tmp_path / "rig.toml"
        text = (EXAMPLES / "rig_wing_dynamixel.toml").read_text()
        rig.write_text(text.replace("/dev/ttyUSB0", str(bus.link)).replace("baud = 1000000", "baud = 2000000"))
        assert document(command("bus", "ping", 1, "--rig", rig, "--json"))["baud"] == 2_000_000
        assert command("bus", "ping", 1, "--rig", rig, "--baud", 57_600).exit_code == 3
    assert command("bus", "ping", 1, "--rig", rig, "--port", tmp_path / "none").exit_code == 3
    wrong = command("bus", "ping", 1, "--rig", EXAMPLES / "rig_mock.toml")
    assert wrong.exit_code == 2
    is_one_line(wrong, "rig_mock.toml", "mock", "remedy: ")


def test_without_port_the_only_adapter_is_taken_and_else_the_candidates_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def plugged(*devices: str) -> None:
        ports = [SimpleNamespace(device=device, vid=0x0403) for device in devices]
        monkeypatch.setattr(list_ports, "comports", lambda: [*ports, SimpleNamespace(device="/dev/ttyS0", vid=None)])

    plugged()
    is_one_line(command("bus", "scan"), "no serial adapter", "remedy: ")
    plugged("/dev/ttyUSB1", "/dev/ttyUSB0")
    several = command("bus", "scan")
    assert several.exit_code == 2
    is_one_line(several, "/dev/ttyUSB0, /dev/ttyUSB1", "remedy: give --port")
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        plugged(str(bus.link))
        assert command("bus", "ping", 1, "--baud", 1_000_000).exit_code == 0


def test_one_program_at_a_time_has_the_port(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        words = ("bus", "monitor", 1, "--port", bus.link, "--baud", 1_000_000, "--json")
        with Running(*words, cwd=tmp_path) as other:
            assert json.loads(other.line())["servos"][0]["answered"]
            second = bus_command("ping", bus, 1)
    assert second.exit_code == 3
    is_one_line(second, "another program has it", "remedy: ")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("ping", "300"), "300"),
        (("ping", "1", "--baud", "12345"), "12345"),
        (("torque-off", "some"), "'some'"),
        (("set-baud", "253", "57600"), "'253'"),
        (("jog", "1"), "--by, --to"),
        (("jog", "1", "--by", "1", "--to", "1"), "--by, --to"),
        (("jog", "1", "--by", "nan"), "--by"),
    ],
)
def test_bad_input_is_refused_before_anything_is_opened(words: tuple[str, ...], says: str) -> None:
    refused = command("bus", *words, "--port", "/nowhere")
    assert refused.exit_code == 2
    is_one_line(refused, says)


def test_every_command_has_an_example() -> None:
    listing = command("--help").stdout
    assert "\n  bus " in listing
    assert "\n  doctor " in listing
    assert len(group.commands) == 10
    for name in group.commands:
        page = command("bus", name, "--help").stdout
        assert f"ori-deploy bus {name} " in page.split("Example:")[1]
        assert name in command("bus", "--help").stdout


# -- changes -------------------------------------------------------------------------------------------


def test_set_id_changes_it_and_refuses_what_would_make_two_of_one(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1), ServoSpec(id=2)) as bus:
        taken = bus_command("set-id", bus, 1, 2)
        assert taken.exit_code == 3
        is_one_line(taken, "id 2 is taken", "remedy: ")
        assert document(bus_command("set-id", bus, 1, 9, "--json"))["id"] == 9
        assert set(bus.truth()) == {2, 9}
        same = bus_command("set-id", bus, 2, 2)
        assert same.exit_code == 2
        bus.set_register(2, "torque_enable", 1)
        held = bus_command("set-id", bus, 2, 5)
        assert held.exit_code == 3
        is_one_line(held, "torque is on", "torque-off 2")
        assert set(bus.truth()) == {2, 9}


def test_an_id_is_taken_even_when_its_answers_are_damaged(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1), ServoSpec(id=2)) as bus:
        bus.corrupt(2, 100)
        assert bus_command("set-id", bus, 1, 2).exit_code == 3
        assert set(bus.truth()) == {1, 2}


def test_set_id_that_is_not_confirmed_is_verified_by_asking(tmp_path: Path) -> None:
    """Whether the answer to the change carries the old id or the new, or is lost, the servo has moved."""
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        bus.set_register(1, "status_return_level", 1)  # reads are answered, writes are not
        assert bus_command("set-id", bus, 1, 6).exit_code == 0
        assert set(bus.truth()) == {6}


def test_set_baud_of_all_is_verified_at_the_new_rate(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1), ServoSpec(id=2, model=XL)) as bus:
        done = bus_command("set-baud", bus, "all", 2_000_000, "--json")
        assert [servo["id"] for servo in document(done)["servos"]] == [1, 2]
        assert "baud = 2000000" in done.stderr
        assert [bus.register(i, "baud_rate") for i in (1, 2)] == [4, 4]
        assert bus_command("ping", bus, 2, baud=2_000_000).exit_code == 0


def test_set_baud_refuses_before_any_servo_is_changed(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1), ServoSpec(id=2, model="XL330-M288")) as bus:
        unknown = bus_command("set-baud", bus, "all", 1_234)
        assert unknown.exit_code == 2
        is_one_line(unknown, "1234", "57600")
        too_fast = bus_command("set-baud", bus, "all", 4_500_000)
        assert too_fast.exit_code == 3
        is_one_line(too_fast, "servo 2", "4500000")
        bus.set_register(2, "torque_enable", 1)
        held = bus_command("set-baud", bus, "all", 57_600)
        assert held.exit_code == 3
        is_one_line(held, "servo 2", "torque is on")
        assert [bus.register(i, "baud_rate") for i in (1, 2)] == [3, 3]


def test_reset_error_names_the_error_clears_it_and_warns_of_turns(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1), ServoSpec(id=2)) as bus:
        bus.fail(2, OVERLOAD)
        done = bus_command("reset-error", bus, "all", "--json")
        assert document(done)["servos"] == [{"id": 2, "error_bits": OVERLOAD, "error": "overload"}]
        assert "turns" in done.stderr
        assert bus.register(2, "hardware_error_status") == 0
        nothing = bus_command("reset-error", bus, "all")
        assert "nothing was restarted" in nothing.stdout


def test_an_error_whose_cause_is_still_there_is_not_called_reset(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        bus.heat(1, 95.0)
        bus.fail(1, OVERHEATING)
        again = bus_command("reset-error", bus, 1)
    assert again.exit_code == 1
    is_one_line(again, "servo 1", "overheating", "let it cool")


def test_those_restarted_before_one_that_stays_bad_are_told_all_the_same(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1), ServoSpec(id=2)) as bus:
        bus.fail(1, OVERLOAD)
        bus.heat(2, 95.0)
        bus.fail(2, OVERHEATING)
        done = bus_command("reset-error", bus, "all")
    assert done.exit_code == 1
    assert done.stdout == "servo 1: reported overload; restarted, no error now\n"
    assert "--stands" in done.stderr
    assert "servo 2 reports overheating again" in done.stderr


def test_a_servo_that_holds_is_restarted_only_when_that_is_meant(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        hold(bus, 1)
        asked = bus_command("reset-error", bus, 1, answer="n\n")
        assert asked.exit_code == 3
        assert "goes limp" in asked.stderr
        assert bus.truth()[1].torque_on
        assert bus_command("reset-error", bus, 1, "--yes").exit_code == 0
        assert not bus.truth()[1].torque_on


def test_torque_off_asks_tells_what_follows_and_verifies(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1), ServoSpec(id=2)) as bus:
        for i in (1, 2):
            hold(bus, i)
        for answer in ("n\n", ""):
            refused = bus_command("torque-off", bus, "all", answer=answer)
            assert refused.exit_code == 3
            assert "limp" in refused.stderr
            assert all(servo.torque_on for servo in bus.truth().values())
        assert bus_command("torque-off", bus, 1, answer="y\n").exit_code == 0
        assert [servo.torque_on for servo in bus.truth().values()] == [False, True]
        told = document(bus_command("torque-off", bus, "all", "--yes", "--json"))
        assert told == {"ids": [1, 2], "torque_on": False}
        assert not any(servo.torque_on for servo in bus.truth().values())


def test_torque_off_of_all_is_of_all_rates_and_other_commands_say_which_they_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(line, "PING_SLOT_S", 0.5e-3)
    with virtual_bus(tmp_path, ServoSpec(id=1, baud=57_600), ServoSpec(id=2)) as bus:
        bus_command("jog", bus, 1, "--by", 0, "--hold", baud=57_600)
        hold(bus, 2)
        left_out = command("bus", "reset-error", "all", "--port", bus.link)
        assert left_out.exit_code == 0
        assert "warning: all is all at 57600 baud; servos at 1000000, 2000000" in left_out.stderr
        asked = command("bus", "torque-off", "all", "--port", bus.link, answer="n\n")
        assert asked.exit_code == 3
        assert "Servo 1, 2 goes limp" in asked.stderr
        assert all(servo.torque_on for servo in bus.truth().values())
        told = document(command("bus", "torque-off", "all", "--port", bus.link, "--yes", "--json"))
        assert told == {"ids": [1, 2], "torque_on": False}
        assert not any(servo.torque_on for servo in bus.truth().values())


# -- watching ------------------------------------------------------------------------------------------


def test_monitor_tells_every_servo_in_si_units_and_goes_on_without_one(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1, start_rad=0.5), ServoSpec(id=2, model=XL)) as bus:
        bus.fail(1, OVERLOAD)
        done = bus_command("monitor", bus, "--json", "--count", 2, "--rate", 50)
        assert done.exit_code == 0
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        assert len(lines) == 2
        first, second = lines[-1]["servos"]
        assert first["position_rad"] == pytest.approx(0.5, abs=2e-3)
        assert (first["error"], first["voltage_v"], first["load_fraction"]) == ("overload", 12.0, None)
        assert second["current_a"] is None
        shown = bus_command("monitor", bus, "--count", 1)
        assert "+28.6" in shown.stdout
        assert "+0.499" in shown.stdout or "+0.500" in shown.stdout


def test_the_monitor_says_who_does_not_answer_and_goes_on(tmp_path: Path) -> None:
    with (
        virtual_bus(tmp_path, ServoSpec(id=1), ServoSpec(id=2)) as bus,
        Running("bus", "monitor", "--port", bus.link, "--baud", 1_000_000, "--json", cwd=tmp_path) as running,
    ):
        assert [servo["answered"] for servo in json.loads(running.line())["servos"]] == [True, True]
        bus.mute(2)
        _wait_for(lambda: [servo["answered"] for servo in json.loads(running.line())["servos"]] == [True, False])
        bus.mute(2, on=False)
        _wait_for(lambda: [servo["answered"] for servo in json.loads(running.line())["servos"]] == [True, True])
        assert running.interrupt()[0] == 0


def test_ctrl_c_ends_the_monitor_cleanly(tmp_path: Path) -> None:
    with (
        virtual_bus(tmp_path, ServoSpec(id=1)) as bus,
        Running("bus", "monitor", "--port", bus.link, "--baud", 1_000_000, "--json", cwd=tmp_path) as running,
    ):
        assert running.line()
        status, out, err = running.interrupt()
    assert (status, err) == (0, "")
    assert all(json.loads(line)["servos"] for line in out.splitlines())


# -- jog -----------------------------------------------------------------------------------------------


def test_jog_moves_by_and_to_and_leaves_everything_as_it_was(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1, start_rad=0.3)) as bus:
        bus.set_register(1, "profile_velocity", 17)
        told = document(bus_command("jog", bus, 1, "--by", 20, "--speed", 90, "--json"))
        assert told["arrived"]
        assert not told["torque_on"]
        assert told["position_rad"] - told["start_rad"] == pytest.approx(math.radians(20.0), abs=0.02)
        assert document(bus_command("jog", bus, 1, "--to", -10, "--speed", 90, "--json"))["watchdog"]
        servo = bus.truth()[1]
        assert servo.shaft_rad == pytest.approx(math.radians(-10.0), abs=0.02)
        assert not servo.torque_on
        assert bus.register(1, "profile_velocity") == 17
        assert bus.register(1, "bus_watchdog") == 0


def test_jog_seeds_the_goal_before_torque_goes_on(tmp_path: Path) -> None:
    """A goal left over from yesterday is not where the servo goes."""
    with virtual_bus(tmp_path, ServoSpec(id=1, start_rad=-1.0)) as bus:
        bus.set_register(1, "goal_position", 3_500)
        told = document(bus_command("jog", bus, 1, "--by", 0, "--json"))
        assert told["position_rad"] == pytest.approx(-1.0, abs=5e-3)
        assert bus.truth()[1].moved_s < 0.0


def test_jog_holds_when_told_to_and_where_it_did_before(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        assert document(bus_command("jog", bus, 1, "--by", 5, "--hold", "--json"))["torque_on"]
        assert bus.truth()[1].torque_on
        assert bus_command("jog", bus, 1, "--by", -5).exit_code == 0
        assert bus.truth()[1].torque_on
        assert bus.register(1, "bus_watchdog") == 0


def test_jog_refuses_goals_beyond_the_servos_limits(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        bus.set_register(1, "max_position_limit", 2_500)
        refused = bus_command("jog", bus, 1, "--to", 45)
        assert refused.exit_code == 3
        is_one_line(refused, "45.0 deg", "39.7 deg", "remedy: ")
        bus.set_register(1, "hardware_error_status", OVERLOAD)
        assert "overload" in bus_command("jog", bus, 1, "--by", 1).stderr
        assert bus.truth()[1].moved_s < 0.0


def test_jog_asks_before_a_long_way(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        refused = bus_command("jog", bus, 1, "--by", 100, answer="n\n")
        assert refused.exit_code == 3
        assert "100.0 deg" in refused.stderr
        assert bus.truth()[1].moved_s < 0.0
        assert bus_command("jog", bus, 1, "--by", 100, "--speed", 200, "--yes").exit_code == 0


def test_a_jammed_servo_is_given_up_stopped_and_let_go_of(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        bus.jam(1)
        stuck = bus_command("jog", bus, 1, "--by", 3, "--speed", 60)
        assert stuck.exit_code == 1
        is_one_line(stuck, "servo 1")
        servo = bus.truth()[1]
        assert not servo.torque_on
        assert bus.register(1, "bus_watchdog") == 0


def test_a_jammed_servo_that_held_before_holds_where_it_is(tmp_path: Path) -> None:
    """Freed afterwards, it does not jump to where it was to go."""
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        hold(bus, 1)
        bus.jam(1)
        assert bus_command("jog", bus, 1, "--by", 3, "--speed", 60).exit_code == 1
        assert bus.truth()[1].torque_on
        assert bus.register(1, "goal_position") == bus.register(1, "present_position")


def test_ctrl_c_stops_a_jog_where_it_is(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        words = ("bus", "jog", 1, "--by", 80, "--speed", 8, "--port", bus.link, "--baud", 1_000_000)
        with Running(*words, cwd=tmp_path) as running:
            _wait_for(lambda: bus.truth()[1].shaft_rad > 0.05)
            assert bus.register(1, "bus_watchdog") > 0
            status, _, err = running.interrupt()
        servo = bus.truth()[1]
        assert status == 130
        assert "stopped on its way to 80.00 deg" in err
        assert not servo.torque_on
        assert 0.05 < servo.shaft_rad < math.radians(79.0)
        assert bus.register(1, "bus_watchdog") == 0


def test_a_jog_whose_program_is_killed_is_stopped_by_the_watchdog(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        words = ("bus", "jog", 1, "--by", 80, "--speed", 8, "--port", bus.link, "--baud", 1_000_000)
        with Running(*words, cwd=tmp_path):
            _wait_for(lambda: bus.truth()[1].shaft_rad > 0.05)
        _wait_for(lambda: bus.truth()[1].frozen)
        assert bus.truth()[1].shaft_rad < math.radians(79.0)
        # The next one clears what the watchdog left behind.
        again = bus_command("jog", bus, 1, "--by", -1)
        assert again.exit_code == 0, again.output


def test_a_servo_that_falls_silent_on_its_way_is_told_and_does_not_go_on(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        words = ("bus", "jog", 1, "--by", 80, "--speed", 8, "--port", bus.link, "--baud", 1_000_000)
        with Running(*words, cwd=tmp_path) as running:
            _wait_for(lambda: bus.truth()[1].shaft_rad > 0.05)
            bus.mute(1)
            status, _, err = running.end()
        servo = bus.truth()[1]
        assert status == 1
        assert "servo 1: no answer" in err
        assert "could not be put back" in err
        assert len(err.splitlines()) == 1
        assert servo.frozen or not servo.torque_on


def test_a_port_that_is_pulled_out_on_the_way_is_told_and_the_watchdog_stops_the_servo(tmp_path: Path) -> None:
    with virtual_bus(tmp_path, ServoSpec(id=1)) as bus:
        words = ("bus", "jog", 1, "--by", 80, "--speed", 8, "--port", bus.link, "--baud", 1_000_000)
        with Running(*words, cwd=tmp_path) as running:
            _wait_for(lambda: bus.truth()[1].shaft_rad > 0.05)
            bus.unplug()
            status, _, err = running.end()
        assert status == 1
        assert "is gone" in err
        assert len(err.splitlines()) == 1
        _wait_for(lambda: bus.truth()[1].frozen)


def _wait_for(true: object) -> None:
    deadline = time.monotonic() + 60.0
    assert callable(true)
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.02)
