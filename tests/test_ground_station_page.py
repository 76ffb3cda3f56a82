"""docs/ground-station.md says what the component and the ground's side do."""

from __future__ import annotations

import dataclasses
import json
import re
import shlex
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

import click
import pytest

from ori_deploy.cli.commands import main as program
from ori_deploy.cli.gcs import DEFAULT_LINK, gcs
from ori_deploy.deploy.states import State
from ori_deploy.mav import commands, component, neighbours, speaker, telemetry, texts
from ori_deploy.mav.bridge import STALE_ASK_S, STATES
from ori_deploy.mav.link_spec import FORMS
from ori_deploy.mav.parameters import parameters_of
from ori_deploy.mav.settings import DEPLOY_RULES, MOST_LINKS, Settings, load_settings
from ori_deploy.wire.vehicle import dialect
from tests.cli.serving import quick_plan, serving
from tests.mav.stations import MavProxy

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "ground-station.md").read_text()
XML = ElementTree.parse(ROOT / "ori_deploy" / "wire" / "ori_vehicle.xml")
ACTIONS = ROOT / "docs" / "ground-station" / "ori-deploy-actions.json"


def section(title: str) -> str:
    found = re.search(rf"^(#+) {re.escape(title)}\n(.*?)(?=^#|\Z)", PAGE, re.DOTALL | re.MULTILINE)
    assert found is not None, title
    return found.group(2)


def tables(text: str) -> list[list[list[str]]]:
    """Rows of cells, without the head."""
    found: list[list[list[str]]] = []
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        rows = [[cell.strip().strip("`") for cell in line.strip("|").split("|")] for line in block.splitlines()]
        found.append(rows[2:])
    return found


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


def enum(name: str) -> Mapping[str, int]:
    entries = XML.findall(f".//enum[@name='{name}']/entry")
    return {entry.attrib["name"].removeprefix(f"{name}_"): int(entry.attrib["value"]) for entry in entries}


# -- answers -------------------------------------------------------------------------------------------


def test_every_reason_is_in_the_table_with_its_number_and_result() -> None:
    rows = tables(section("Answers"))[0]
    assert {row[0]: int(row[1]) for row in rows} == enum("ORI_REASON")
    stated = {int(row[1]): row[2] for row in rows}
    results = {value: name.name.removeprefix("MAV_RESULT_") for value, name in dialect.enums["MAV_RESULT"].items()}
    refused = set(enum("ORI_REASON").values()) - {
        dialect.ORI_REASON_NONE,
        dialect.ORI_REASON_STOPPED,
        dialect.ORI_REASON_NOTHING_TO_DO,
    }
    for reason in refused:
        assert stated[reason] == results[commands.refusal(reason).result], reason


def test_the_interlocks_reasons_are_answered_as_in_its_table() -> None:
    rows = tables(section("Interlock"))[0]
    stated = {row[4]: row[5] for row in tables(section("Interlock"))[0]}
    answers = {row[0]: row[2] for row in tables(section("Answers"))[0]}
    assert list(stated) == ["LANDED_UNKNOWN", "AIRBORNE", "ARMING_UNKNOWN", "ARMED", "NONE"]
    assert all(answers[reason] == result for reason, result in stated.items() if reason != "NONE")
    assert [row[1] for row in rows] == ["refused"] * 4 + ["begun"]
    assert int(commands.FORCE) == 21196
    assert "Force is 21196" in PAGE
    assert all(f'"{rule}"' in section("Interlock") for rule in DEPLOY_RULES)


def test_commands_and_their_aliases() -> None:
    rows = tables(section("Commands"))[0]
    numbers = {row[0]: int(row[1]) for row in rows}
    alias = {work: int(number) for number, work in commands.ALIASED.items()}
    for number, work in commands.COMMANDS.items():
        name = dialect.enums["MAV_CMD"][number].name
        assert numbers[name] == number
        assert next(row[2] for row in rows if row[0] == name) == str(alias[work])
    assert numbers["MAV_CMD_REQUEST_MESSAGE"] == dialect.MAV_CMD_REQUEST_MESSAGE
    assert numbers["MAV_CMD_ARM_AUTHORIZATION_REQUEST"] == dialect.MAV_CMD_ARM_AUTHORIZATION_REQUEST
    assert len(rows) == len(commands.COMMANDS) + 2
    assert f"({commands.ALIAS})" in PAGE


def test_times_are_those_of_the_sources() -> None:
    for words, seconds in (
        ("within {:g} s, it gets the answer", commands.REMEMBERED_S),
        ("within {:g} s of its first sending", commands.SENT_AGAIN_S),
        ("A refusal holds for {:g} s", commands.SAME_ANSWER_S),
        ("waited longer than {:g} s for the loop", STALE_ASK_S),
        ("gets ACCEPTED for {:g} s", component.ARMING_VALID_S),
        ("is asked to every {:g} s", neighbours.ASK_AGAIN_S),
        ("started again after {:g} s", speaker.RESTART_S),
    ):
        assert words.format(seconds) in " ".join(PAGE.split())
    assert commands.PROGRESS_S == 0.5
    assert (texts.BURST, texts.PER_S, texts.WAITING, texts.CHUNK) == (5, 1.0, 8, 50)
    assert neighbours.LANDED_EVERY_US == 500_000


# -- settings and parameters ---------------------------------------------------------------------------


def test_every_setting_is_there_with_its_default() -> None:
    rows = {row[0]: row[1] for row in tables(section("Settings"))[0]}
    fields = {one.name: one.default for one in dataclasses.fields(Settings)}
    assert list(rows) == list(fields)
    for name, default in fields.items():
        if default is None or default == ():
            assert rows[name] == "none"
        elif isinstance(default, tuple):
            assert rows[name] == ", ".join(map(str, default))
        elif isinstance(default, float):
            assert float(rows[name]) == default
        else:
            assert json.loads(rows[name]) == default


def test_the_example_is_where_the_commands_of_the_page_look() -> None:
    (link,) = load_settings(ROOT / "examples" / "mavlink.toml").links
    assert str(link).replace("udpin", "udpout") == DEFAULT_LINK
    assert DEFAULT_LINK in section("`ori-deploy gcs`")


def test_every_parameter_is_there_with_its_bounds() -> None:
    rows = {row[0]: row[1:] for row in tables(section("Parameters"))[0]}
    known = parameters_of(Settings())
    assert list(rows) == [one.name for one in known]
    for one in known:
        assert [float(cell) for cell in rows[one.name][:3]] == [one.default, one.lowest, one.highest]
        assert rows[one.name][3] == one.meaning


def test_links_are_those_that_are_understood() -> None:
    text = section("Links")
    assert all(f"`{form}`" in text for form in re.split(r", | or ", FORMS))
    assert f"Up to {MOST_LINKS}." in text


# -- telemetry -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["ORI_STRUCTURE", "ORI_CREASES", "ORI_LATCHES"])
def test_messages_have_the_fields_of_the_dialect(name: str) -> None:
    message = XML.find(f".//message[@name='{name}']")
    assert message is not None
    found = re.search(rf"^{name} \((\d+)\)[^\n]*:\n\n((?:\|.*\n)+)", PAGE, re.MULTILINE)
    assert found is not None
    assert found.group(1) == message.attrib["id"]
    stated = [(row[0], row[1], row[2]) for row in tables(found.group(2))[0]]
    fields = [(f.attrib["name"], f.attrib["type"], f.attrib.get("units", "")) for f in message.findall("field")]
    assert stated == fields


def test_no_message_of_the_dialect_is_left_out() -> None:
    for message in XML.findall(".//message"):
        assert message.attrib["name"] in PAGE
    for name, value in enum("ORI_STRUCTURE_FLAGS").items():
        assert f"{name.removeprefix('ORI_STRUCTURE_')} {value}" in PAGE
    assert f"ORI_CREASES (54151), {telemetry.CREASES_PER_MESSAGE} in a message" in PAGE
    assert f"ORI_LATCHES (54152), {telemetry.LATCHES_PER_MESSAGE} in a message" in PAGE


def test_the_heartbeat_says_every_state() -> None:
    rows = tables(section("Heartbeat"))[0]
    assert [(row[1], int(row[0])) for row in rows] == sorted(
        ((str(state), number) for state, number in STATES.items()), key=lambda pair: pair[1]
    )
    assert {str(state) for state in State} == {row[1] for row in rows}
    status = {value: entry.name.removeprefix("MAV_STATE_") for value, entry in dialect.enums["MAV_STATE"].items()}
    severity = {
        value: entry.name.removeprefix("MAV_SEVERITY_").lower()
        for value, entry in dialect.enums["MAV_SEVERITY"].items()
    }
    for number, _, stated, said in rows:
        assert stated == status[telemetry.SYSTEM_STATUS[int(number)]]
        if int(number) in texts._SAID:
            how, words = texts._SAID[int(number)]
            assert said == f"{severity[how]}: {words}"
        else:
            assert said in ("", "critical: the fault, in words")


# -- QGroundControl ------------------------------------------------------------------------------------


def test_the_actions_are_what_qgroundcontrol_reads_and_the_component_takes() -> None:
    document = json.loads(ACTIONS.read_text())
    assert (document["version"], document["fileType"]) == (1, "MavlinkActions")
    known = {"label", "description", "mavCmd", "compId", *(f"param{k}" for k in range(1, 8))}
    for action in document["actions"]:
        assert {"label", "description", "mavCmd"} <= set(action) <= known
        assert (action["mavCmd"], action["compId"]) == (commands.ALIAS, Settings.component_id)
    assert [float(action["param1"]) for action in document["actions"]] == list(commands.ALIASED)
    assert "](ground-station/ori-deploy-actions.json)" in PAGE


# -- commands ------------------------------------------------------------------------------------------


def command_lines() -> Iterator[str]:
    for block in blocks("sh"):
        yield from (re.split(r"  +#| &$", line)[0].strip() for line in block.splitlines())
    yield from re.findall(r"`(ori-deploy gcs [^`]+)`", PAGE)


LINES = sorted(set(command_lines()))
_FILES = ("rig.toml", "wing.design.json", "wing.plan.json", "mavlink.key")


@pytest.mark.parametrize("line", LINES)
def test_a_command_is_one(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    for name in _FILES:
        (tmp_path / name).touch()
    words = shlex.split(line)
    match words:
        case ["ori-deploy", *rest]:
            parse(program, rest)
        case ["python" | "cp", source, *_]:
            assert (tmp_path / source).exists()
        case _:
            assert words[0] in ("mkdir", "mavproxy.py") or line.startswith("(umask 077; "), line


def parse(command: click.Command, words: list[str]) -> None:
    """As the program would, without doing it."""
    if isinstance(command, click.Group):
        _, found, rest = command.resolve_command(click.Context(command), words)
        assert found is not None
        parse(found, rest)
    else:
        command.make_context(command.name, list(words))


def test_every_command_of_the_ground_is_in_the_table() -> None:
    rows = tables(section("`ori-deploy gcs`"))[0]
    assert [row[0].removeprefix("ori-deploy gcs ") for row in rows] == list(
        sorted(gcs.commands, key=[row[0].split()[-1] for row in rows].index)
    )


class Signer(MavProxy):
    """MAVProxy that is told the passphrase of the page first: without it nobody answers."""

    def started(self) -> None:
        (words,) = re.findall(r"`(signing key [^`]+)`", PAGE)
        self.send(words)
        super().started()


@pytest.mark.slow
@pytest.mark.usefixtures("runtime_folder")
@pytest.mark.parametrize("station", [MavProxy, Signer])
def test_mavproxy_does_what_the_page_has_it_do(station: type[MavProxy], tmp_path: Path) -> None:
    (phrase,) = re.findall(r'echo "(passphrase:[^"]+)"', PAGE)
    (tmp_path / "mavlink.key").touch(mode=0o600)
    (tmp_path / "mavlink.key").write_text(phrase)
    signed = {"key_file": "mavlink.key"} if station is Signer else {}
    (snippet,) = re.findall(r"^```\n(alias add.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    *aliases, deploy, show, change = snippet.splitlines()
    with serving(quick_plan(tmp_path), tmp_path, deploy_when="always", **signed) as served, station(served.port) as s:
        assert s.parameters() == 6
        for line in aliases:
            s.send(line)
        s.send(deploy)
        assert s.acknowledged() == "IN_PROGRESS"
        while (told := s.acknowledged(within=60.0)) == "IN_PROGRESS":
            pass
        assert told == "ACCEPTED"
        s.send("wing-fold")
        assert s.acknowledged() == "TEMPORARILY_REJECTED"
        s.send("wing-stop")
        assert s.acknowledged() == "ACCEPTED"
        s.send("wing-clear")
        assert s.acknowledged() == "ACCEPTED"
        s.send(show)
        s.wait_for("^ORI_SPEED +1")
        s.send(change)
        deadline = time.monotonic() + 20.0
        while s.parameter("ORI_SPEED") != 0.5:
            assert time.monotonic() < deadline


def test_examples_are_named_and_short() -> None:
    scripts = sorted((ROOT / "examples" / "ground_station").glob("*.py"))
    assert len(scripts) == 4
    for script in scripts:
        assert f"examples/ground_station/{script.name}" in PAGE
        assert len(script.read_text().splitlines()) < 40
