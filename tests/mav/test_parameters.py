"""Parameters: files that are spoilt, and what is meant for other components."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ori_deploy.errors import FileError
from ori_deploy.mav.parameters import SCHEMA, Parameters, parameters_of
from ori_deploy.mav.settings import Settings
from ori_deploy.wire.vehicle import dialect
from tests.mav.world import world

REAL32 = dialect.MAV_PARAM_TYPE_REAL32


@pytest.mark.parametrize(
    "values",
    [
        '{"ORI_SPEED": 1' + "0" * 400 + "}",
        '{"ORI_SPEED": NaN}',
        '{"ORI_SPEED": 1e999}',
        "[" * 100_000,
        '{"X": 1}',
        "",
    ],
)
def test_a_spoilt_file_is_told_with_its_name(tmp_path: Path, values: str) -> None:
    path = tmp_path / "set.json"
    path.write_text(f'{{"schema": "{SCHEMA}", "values": {values}}}')
    with pytest.raises(FileError, match=r"set\.json"):
        Parameters(parameters_of(Settings()), path)


def test_what_cannot_be_kept_holds_until_a_restart(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    w = world(parameters_file=tmp_path / "file" / "set.json")
    w.run(0.1)
    w.hear(dialect.MAVLink_param_set_message(1, 140, b"ORI_SPEED", 0.5, REAL32))
    w.run(0.1)
    assert w.parameters["ORI_SPEED"] == 0.5
    assert any("holds until a restart" in text for text in w.texts())


def test_a_value_is_kept_whole(tmp_path: Path) -> None:
    w = world(parameters_file=tmp_path / "set.json")
    w.hear(dialect.MAVLink_param_set_message(1, 140, b"ORI_SPEED", 0.5, REAL32))
    assert json.loads((tmp_path / "set.json").read_text())["values"]["ORI_SPEED"] == 0.5
    assert [one.name for one in tmp_path.iterdir()] == ["set.json"]


@pytest.mark.parametrize(("component", "errors"), [(140, 3), (0, 0)])
def test_only_who_asks_this_component_is_told_that_it_has_no_such_parameter(component: int, errors: int) -> None:
    """Stations ask all components for what the autopilot has."""
    w = world()
    w.hear(dialect.MAVLink_param_set_message(1, component, b"ARMING_CHECK", 1.0, REAL32))
    w.hear(dialect.MAVLink_param_request_read_message(1, component, b"ARMING_CHECK", -1))
    w.hear(dialect.MAVLink_param_request_read_message(1, component, b"", 500))
    told = w.take(dialect.MAVLink_param_error_message)
    assert [one.error for one in told] == [dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST] * errors


def test_a_fault_is_told_whatever_else_strangers_have_told() -> None:
    w = world()
    w.run(0.1)
    for k in range(400):
        if k == 200:
            w.bench.controller.emergency_stop("a test")
        for name in (b"ORI_SPEED", b"ORI_TLM_HZ"):
            w.hear(dialect.MAVLink_param_set_message(1, 140, name, 0.5, REAL32), (99, 1))
        w.cycle()
    w.run(20.0)
    assert any("pressed by a test" in text for text in w.texts())
