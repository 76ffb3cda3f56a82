"""The page on the microcontroller says what the software and the firmware do."""

from __future__ import annotations

import dataclasses
import math
import re
import shlex
import tomllib
import typing
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import click
import pytest

from ori_deploy.actuators.mcu.faults import fault_name
from ori_deploy.actuators.mcu.settings import HingeEntry, LatchEntry, McuSettings, Thermistor
from ori_deploy.actuators.rig import ControllerSettings, Latch, Rig, load_rig, parse_rig
from ori_deploy.actuators.rig import Hinge as RigHinge
from ori_deploy.cli.commands import main as program
from ori_deploy.cli.mcu_monitor import _HINGES, _LATCHES
from sim_backends.dynamixel_bus import main as virtual_bus
from sim_backends.mcu import main as emulated_board

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "hardware-mcu.md").read_text()
FIRMWARE = ROOT / "firmware"
PORT = FIRMWARE / "port_atmega2560"

ARDUINO_MEGA = {
    **{f"A{bit}": f"D{22 + bit}" for bit in range(8)},
    **{f"C{bit}": f"D{37 - bit}" for bit in range(8)},
    **{"B5": "D11", "B6": "D12", "B7": "D13", "D7": "D38", "E3": "D5", "E4": "D2", "E5": "D3"},
    **{"H3": "D6", "H4": "D7", "H5": "D8", "L3": "D46", "L4": "D45", "L5": "D44"},
}
"""Of the chip's port and bit, the number that is printed on the board."""


def section(title: str) -> str:
    found = re.search(rf"^## \d+\. {re.escape(title)}\n(.*?)(?=^## )", PAGE, re.DOTALL | re.MULTILINE)
    assert found is not None, title
    return found.group(1)


def tables(text: str) -> list[list[list[str]]]:
    """Tables as rows of cells, head first."""
    found: list[list[list[str]]] = []
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()]
        found.append([rows[0], *rows[2:]])
    return found


def blocks(language: str) -> list[str]:
    return re.findall(rf"^ *```{language}\n(.*?)^ *```", PAGE, re.DOTALL | re.MULTILINE)


def names_in(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


# -- pins ----------------------------------------------------------------------------------------------


def sources() -> dict[str, str]:
    return {path.name: path.read_text() for path in PORT.glob("*.c")}


def test_pins_are_those_of_the_port() -> None:
    pins = tables(section("Wiring"))[0]
    servos = [
        ARDUINO_MEGA[port + bit]
        for port, bit in re.findall(r"&PIN([A-L]), _BV\(COM\w+\), _BV\((\d)\)", sources()["servos.c"])
    ]
    board = sources()["pins.c"]
    magnets = re.search(r"PORT(\w) = on \? PORT\1 \| bit", board)
    sensors = re.search(r"return PIN(\w);", board)
    assert magnets is not None
    assert sensors is not None
    assert "bit = (uint8_t)(1U << output)" in board
    assert [row[0] for row in pins[1:]] == [str(k) for k in range(12)]
    assert [row[1] for row in pins[1:]] == servos
    assert [row[2] for row in pins[1:]] == [f"A{k}" for k in range(12)]
    assert [row[3] for row in pins[1:9]] == [ARDUINO_MEGA[f"{magnets.group(1)}{bit}"] for bit in range(8)]
    assert [row[4] for row in pins[1:9]] == [ARDUINO_MEGA[f"{sensors.group(1)}{bit}"] for bit in range(8)]
    assert all(row[3:5] == ["", ""] for row in pins[9:])


def test_the_other_pins_are_those_of_the_port() -> None:
    others = {row[0]: row[1] for row in tables(section("Wiring"))[1][1:]}
    core = (FIRMWARE / "core" / "port.h").read_text()
    for what, name in (("servos' supply", "ORI_ADC_SUPPLY"), ("thermistor", "ORI_ADC_THERMISTOR")):
        assert f"#define {name} {others[what].removeprefix('A')}U" in core
    stop = re.search(r"port_estop\(void\) \{\n\s*return PIN(\w) & _BV\((\d)\);", sources()["pins.c"])
    assert stop is not None
    assert others["emergency stop"] == ARDUINO_MEGA[stop.group(1) + stop.group(2)]


# -- the rig file --------------------------------------------------------------------------------------

TABLES: dict[str, tuple[type, ...]] = {
    "`[mcu]`": (McuSettings,),
    "`[mcu.each_hinge]`, `[[mcu.hinge]]`": (HingeEntry,),
    "`[mcu.each_latch]`, `[[mcu.latch]]`": (LatchEntry,),
    "`[mcu.thermistor]`": (Thermistor,),
}


def keys_of(*tables: type) -> set[str]:
    return {entry.name for table in tables for entry in dataclasses.fields(table)}


def test_the_rig_tables_have_every_key_and_no_other() -> None:
    found = {table[0][0]: table for table in tables(section("The rig file"))}
    assert set(found) == set(TABLES)
    for head, table in found.items():
        assert sorted(name for row in table[1:] for name in names_in(row[0])) == sorted(keys_of(*TABLES[head])), head


def test_defaults_are_those_of_the_settings() -> None:
    defaults = {
        entry.name: entry.default
        for kind in (McuSettings, HingeEntry, LatchEntry, Thermistor)
        for entry in dataclasses.fields(kind)
    }
    for table in tables(section("The rig file")):
        for row in table[1:]:
            keys, stated = names_in(row[0]), row[2]
            if "must be given" in stated and "lock pins" not in stated:
                assert all(defaults[key] in (dataclasses.MISSING, None) for key in keys), keys
            elif stated in ("true", "false"):
                assert [defaults[key] for key in keys] == [stated == "true"]
            elif re.match(r"[\d.]", stated):
                assert [defaults[key] for key in keys] == [float(number) for number in stated.split(", ")], keys


def test_every_key_that_is_named_exists() -> None:
    """Whatever looks like a key of a rig: lower case, with the unit behind an underscore."""
    known = keys_of(McuSettings, HingeEntry, LatchEntry, Thermistor, Rig, ControllerSettings, Latch, RigHinge)
    for hint in typing.get_type_hints(Rig).values():
        for kind in (hint, *typing.get_args(hint)):
            known |= keys_of(kind) if dataclasses.is_dataclass(kind) and isinstance(kind, type) else set()
    named = {name.split(" = ")[0] for name in names_in(re.sub(r"```.*?```", "", PAGE, flags=re.DOTALL))}
    keys = {name for name in named if re.fullmatch(r"[a-z0-9]+(_[a-z0-9]+)*_(s|us|rad|v|hz|ohm|k|count|zero)", name)}
    assert len(keys) > 25
    assert keys <= known, keys - known


def test_rig_entries_on_the_page_are_good(tmp_path: Path) -> None:
    entry, mixed = blocks("toml")
    rig = tomllib.loads((ROOT / "examples" / "rig_wing_mcu.toml").read_text())
    rig["mcu"]["hinge"] = tomllib.loads(entry)["mcu"]["hinge"]
    assert parse_rig(rig).mcu is not None
    text = (ROOT / "examples" / "rig_wing_dynamixel.toml").read_text()
    text, cut = re.subn(r"^magnets = .*\n", "", text, flags=re.MULTILINE)
    text, cut_too = re.subn(r"^\[each_latch_point\]\n(?:\w.*\n)+", mixed, text, flags=re.MULTILINE)
    assert (cut, cut_too) == (1, 1)
    (tmp_path / "mixed.toml").write_text(text)
    assert load_rig(tmp_path / "mixed.toml").mcu is not None


def test_the_table_of_shafts_is_that_of_the_example_rig() -> None:
    rig = load_rig(ROOT / "examples" / "rig_wing_mcu.toml")
    assert rig.mcu is not None
    servo = rig.mcu.each_hinge
    assert servo is not None
    hinges = {hinge.actuator: hinge for hinge in rig.hinge}
    table = next(table for table in tables(section("Calibrating")))
    assert [names_in(row[0])[0] for row in table[1:]] == sorted(hinges)
    for row in table[1:]:
        flat, pulse, count, far, far_pulse, far_count = (float(cell.replace("−", "-")) for cell in row[1:])
        assert flat == hinges[names_in(row[0])[0]].zero_rad
        for position, us, counts in ((flat, pulse, count), (far, far_pulse, far_count)):
            assert us == pytest.approx(servo.pulse_zero_us + servo.pulse_us_per_rad * position, abs=0.8)
            assert servo.feedback_zero_rad is not None
            assert servo.feedback_rad_per_count is not None
            assert counts == pytest.approx(
                (position - servo.feedback_zero_rad) / servo.feedback_rad_per_count, abs=0.7
            )


def test_the_torques_are_those_of_the_example_rig() -> None:
    rig = load_rig(ROOT / "examples" / "rig_wing_mcu.toml")
    stall_nm = 2.0 * rig.actuator[0].max_torque_nm
    text = section("Bill of materials for the example wing")
    assert f"The rig says {stall_nm} N m" in text
    assert f"{stall_nm} N m (35 kg cm) at stall" in text
    gear, efficiency = 1.4, 0.9
    assert all(hinge.gear_ratio == gear for hinge in rig.hinge if hinge.actuator in ("servo_1", "servo_3"))
    for crease_nm, shaft_nm, percent in ((1.13, "0.90", 26), (1.8, "1.43", 41)):
        assert f"{crease_nm / (gear * efficiency):.2f}" == shaft_nm
        assert round(100.0 * float(shaft_nm) / stall_nm) == percent
        assert shaft_nm in text
    assert "26 and 41 %" in text
    assert [round(100.0 * nm / stall_nm) for nm in (0.64, 0.53)] == [18, 15]


# -- samples -------------------------------------------------------------------------------------------


def test_the_monitor_on_the_page_has_the_columns_of_the_program() -> None:
    shown = re.search(r"```\n(idle; 0 queued; .*?)```", PAGE, re.DOTALL)
    assert shown is not None
    lines = shown.group(1).splitlines()
    assert tuple(lines[1].split()) == _HINGES
    assert tuple(lines[6].split()) == tuple(name for name in _LATCHES if name)
    rig = load_rig(ROOT / "examples" / "rig_wing_mcu.toml")
    assert rig.mcu is not None
    servo = rig.mcu.each_hinge
    assert servo is not None
    assert servo.feedback_zero_rad is not None
    assert servo.feedback_rad_per_count is not None
    for line in lines[2:6]:
        _, degrees, _, rad, count, *_ = line.split()
        assert math.radians(float(degrees)) == pytest.approx(float(rad), abs=1e-4)
        counted = (float(rad) - servo.feedback_zero_rad) / servo.feedback_rad_per_count
        assert int(count) == round(counted)


def test_the_worked_example_of_the_calibration_is_right() -> None:
    low, high, slope, zero = 249, 785, 0.00586, -3.030
    assert f"n₁ = {low}, n₂ = {high}: slope {slope}, zero −{-zero:.3f}" in PAGE
    assert 3.142 / (high - low) == pytest.approx(slope, abs=5e-6)
    assert -1.571 - slope * low == pytest.approx(zero, abs=5e-4)
    assert f"feedback_zero_rad = {zero:.3f}" in PAGE


# -- faults --------------------------------------------------------------------------------------------


def test_every_fault_of_the_wire_is_in_the_table() -> None:
    dialect = ElementTree.parse(ROOT / "ori_deploy" / "wire" / "ori_deploy.xml")
    values = [int(entry.attrib["value"]) for entry in dialect.findall(".//enum[@name='ORI_FAULT']/entry")]
    table = tables(section("Faults"))[0]
    assert [names_in(row[0]) for row in table[1:]] == [[fault_name(value)] for value in values if value]


# -- commands ------------------------------------------------------------------------------------------

_FILES = ("rig.toml", "mixed.toml", "wing.design.json", "wing.plan.json", "mixed.plan.json", "run.mcap")


def commands() -> Iterator[str]:
    for block in blocks("sh"):
        yield from (line.split("  #")[0].strip() for line in block.splitlines())
    for name in names_in(re.sub(r"```.*?```", "", PAGE, flags=re.DOTALL)):
        if name.startswith("ori-deploy ") and len(name.split()) > 2 and name != "ori-deploy mcu config":
            yield name


COMMANDS = sorted(set(commands()))


def parse(command: click.Command, words: list[str]) -> None:
    """As the program would, without doing it. Groups here have no options of their own."""
    if isinstance(command, click.Group):
        _, found, rest = command.resolve_command(click.Context(command), words)
        assert found is not None
        parse(found, rest)
    else:
        command.make_context(command.name, list(words))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with every file that commands of the page name."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "firmware" / "build").mkdir(parents=True)
    for name in (*_FILES, "firmware/build/ori_atmega2560.hex"):
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_is_one(line: str, folder: Path) -> None:
    words = shlex.split(line)
    match words:
        case ["ori-deploy", *rest]:
            parse(program, rest)
        case ["python", "-m", "sim_backends.mcu", *rest]:
            parse(emulated_board, rest)
        case ["python", "-m", "sim_backends.dynamixel_bus", *rest]:
            parse(virtual_bus, rest)
        case ["make", "-C", "firmware", target, *_]:
            rules = (PORT / "rules.mk").read_text()
            assert f"\n{target}: " in rules or (target.endswith(".hex") and "\n%.hex: %.elf" in rules)
        case ["cp", source, _]:
            assert (folder / source).exists()
        case _:
            assert words[0] in ("avrdude", "mkdir"), line


def test_the_commands_are_found() -> None:
    assert len(COMMANDS) > 20
    assert {"mcu jog", "mcu torque-off", "doctor"} <= {
        " ".join(line.split()[1 : 2 + (line.split()[1] == "mcu")]) for line in COMMANDS
    }
    assert {line.split()[0] for line in COMMANDS} == {"ori-deploy", "python", "make", "cp", "mkdir", "avrdude"}


# -- the picture ---------------------------------------------------------------------------------------


def test_the_picture_is_there_and_shows_the_pins_of_the_wing() -> None:
    assert "](mcu-wiring.png)" in PAGE
    assert (ROOT / "docs" / "mcu-wiring.png").stat().st_size > 50_000
    pins = tables(section("Wiring"))[0][1:]
    drawn = (ROOT / "tools" / "draw_mcu_wiring.py").read_text()
    for k in range(4):
        assert f'("servo_{k + 1}", "{pins[k][1]}, {pins[k][2]}"' in drawn
    for name in ("D38", "A12", "A13", pins[0][3], pins[0][4]):
        assert f'"{name}"' in drawn
