"""Settings of the component from a file and from a command line."""

from __future__ import annotations

import dataclasses
import pickle
import re
import tomllib
from pathlib import Path

import pytest

from ori_deploy.errors import FileError, InputError
from ori_deploy.mav.links import LinkSpec
from ori_deploy.mav.settings import DEPLOY_RULES, MAVLINK_SCHEMA, Settings, load_settings, with_links

EXAMPLE = Path(__file__).parents[2] / "examples" / "mavlink.toml"
HERE = LinkSpec("udpin", "127.0.0.1", 14560)


def written(folder: Path, text: str, schema: str = MAVLINK_SCHEMA) -> Path:
    path = folder / "mavlink.toml"
    path.write_text(f'schema = "{schema}"\n{text}\n')
    return path


def test_the_example_says_what_the_defaults_are() -> None:
    assert load_settings(EXAMPLE) == Settings(links=(HERE,))


def test_the_example_has_every_key_with_a_comment() -> None:
    text = EXAMPLE.read_text()
    for field in dataclasses.fields(Settings):
        at = re.search(rf"^(# )?{field.name} = .*", text, re.MULTILINE)
        assert at, field.name
        before = text[: at.start()].rstrip("\n").splitlines()[-1]
        assert "#" in at.group().removeprefix("# ") or before.startswith("#"), field.name


def test_what_is_commented_out_in_the_example_may_be_said() -> None:
    text = re.sub(r"^# (\w+ = )", r"\1", EXAMPLE.read_text(), flags=re.MULTILINE)
    assert set(tomllib.loads(text)) == {"schema", *(field.name for field in dataclasses.fields(Settings))}


def test_every_key_is_taken(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        """
        system_id = 7
        component_id = 141
        autopilot_component = 2
        links = ["udpin:0.0.0.0:14550", "serial:/dev/ttyUSB0:57600"]
        beyond_loopback = true
        commanders = [255, 254]
        deploy_when = "on-ground"
        force_allowed = true
        link_loss = "finish"
        link_timeout_s = 5
        facts_fresh_s = 1.5
        telemetry_hz = 10
        key_file = "keys/mavlink.key"
        accept_unsigned = true
        parameters_file = "/var/lib/parameters.json"
        """,
    )
    assert load_settings(path) == Settings(
        system_id=7,
        component_id=141,
        autopilot_component=2,
        links=(LinkSpec("udpin", "0.0.0.0", 14550), LinkSpec("serial", "/dev/ttyUSB0", 57600)),
        beyond_loopback=True,
        commanders=(255, 254),
        deploy_when="on-ground",
        force_allowed=True,
        link_loss="finish",
        link_timeout_s=5.0,
        facts_fresh_s=1.5,
        telemetry_hz=10.0,
        key_file=tmp_path / "keys/mavlink.key",
        accept_unsigned=True,
        parameters_file=Path("/var/lib/parameters.json"),
    )


def test_nothing_said_is_the_defaults(tmp_path: Path) -> None:
    assert load_settings(written(tmp_path, "")) == Settings()


@pytest.mark.parametrize("rule", DEPLOY_RULES)
def test_every_rule_for_deploying_is_taken(tmp_path: Path, rule: str) -> None:
    assert load_settings(written(tmp_path, f'deploy_when = "{rule}"')).deploy_when == rule


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("system_id = 0", ["key system_id", "found 0", "greater than or equal to 1"]),
        ("system_id = 256", ["key system_id", "less than or equal to 255"]),
        ("component_id = 1.0", ["key component_id", "integer"]),
        ("component_id = true", ["key component_id", "integer"]),
        ("component_id = 1", ["key component_id", "autopilot_component = 1", "remedy"]),
        ("commanders = [255, 0]", ["key commanders[2]", "found 0"]),
        ('commanders = "255"', ["key commanders"]),
        ('deploy_when = "sometimes"', ["key deploy_when", "'sometimes'", "'on-ground-and-disarmed'"]),
        ("force_allowed = 1", ["key force_allowed", "boolean"]),
        ('link_loss = "stop"', ["key link_loss", "'finish' or 'hold'"]),
        ("link_timeout_s = 1.9", ["key link_timeout_s", "greater than or equal to 2"]),
        ("facts_fresh_s = nan", ["key facts_fresh_s"]),
        ("facts_fresh_s = 60", ["key facts_fresh_s", "less than or equal to 10"]),
        ("telemetry_hz = inf", ["key telemetry_hz"]),
        ('links = ["udpin:127.0.0.1"]', ["key links[1]", "udpin:HOST:PORT", "remedy"]),
        (
            'links = ["udpout:10.0.0.1:1", "udpin:0.0.0.0:14550"]',
            ["key links[2]", "found 0.0.0.0", "limit: loopback", "beyond_loopback = true"],
        ),
        ('links = ["udpin:localhost:1", "udpin:127.0.0.1:1"]', ["key links[2]", "twice"]),
        ("links = [1]", ["key links[1]", "string"]),
        (f"links = {['tcp:127.0.0.1:1'] * 9}", ["key links", "at most 8"]),
        ('key_file = ""', ["key key_file"]),
        ("key_file = 5", ["key key_file", "string"]),
        ('parameters_file = "a\\u0000b"', ["key parameters_file"]),
        ("sytem_id = 1", ["key sytem_id", "did you mean system_id?"]),
        ("system_id = ", ["not TOML"]),
    ],
)
def test_what_is_wrong_is_told_with_its_file_and_key(tmp_path: Path, text: str, says: list[str]) -> None:
    path = written(tmp_path, text)
    with pytest.raises(FileError, match=re.escape(str(path))) as refused:
        load_settings(path)
    for part in says:
        assert part in str(refused.value)


def test_another_schema_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="key schema; found 'ori-deploy/rig/1'; limit: 'ori-deploy/mavlink/1'"):
        load_settings(written(tmp_path, "", "ori-deploy/rig/1"))


def test_links_of_a_command_line_stand_in_for_those_of_the_file() -> None:
    settings = Settings(links=(HERE,), commanders=(7,))
    assert with_links(settings, [], False) == settings
    other = with_links(settings, ["udpout:10.0.0.1:14550", "tcp:10.0.0.1:5760"], False)
    assert [str(link) for link in other.links] == ["udpout:10.0.0.1:14550", "tcp:10.0.0.1:5760"]
    assert other.commanders == (7,)
    with pytest.raises(InputError, match="--beyond-loopback"):
        with_links(settings, ["udpin:0.0.0.0:14550"], False)
    beyond = with_links(settings, ["udpin:0.0.0.0:14550"], True)
    assert beyond.beyond_loopback
    assert with_links(beyond, ["tcpin:0.0.0.0:5760"], False).links == (LinkSpec("tcpin", "0.0.0.0", 5760),)


def test_settings_travel_to_another_process() -> None:
    settings = load_settings(EXAMPLE)
    assert pickle.loads(pickle.dumps(settings)) == settings
