"""A rig file is refused with the key, the value and the remedy, and fitted to a design exactly."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.actuators.resolve import resolve_rig
from ori_deploy.actuators.rig import (
    CREASE_ORDER,
    MAX_HEALTH_PERIOD_S,
    MAX_PATH_TOLERANCE_RAD,
    load_rig,
    parse_rig,
)
from ori_deploy.errors import RigError
from ori_deploy.motion.plan import CREASES

EXAMPLES = Path(__file__).parents[2] / "examples"
CELLS = ("c1", "c2", "c3", "c4")
POINTS = ("slit:P-T2",)
EXPLICIT = tomllib.loads((EXAMPLES / "rig_wing_explicit.toml").read_text())
TEMPLATE = tomllib.loads((EXAMPLES / "rig_mock.toml").read_text())

Change = Callable[[dict[str, Any]], object]


def changed(document: dict[str, Any], change: Change) -> dict[str, Any]:
    copied = copy.deepcopy(document)
    change(copied)
    return copied


def test_crease_order_is_that_of_the_plan() -> None:
    assert CREASE_ORDER == CREASES


@pytest.mark.parametrize("n_cells", [1, 4, 6, 12])
def test_template_rig_fits_any_design(n_cells: int) -> None:
    cells = [f"k{i}" for i in range(n_cells)]
    rig = resolve_rig(load_rig(EXAMPLES / "rig_mock.toml"), cells, ["slit:A-B", "cell:k0"])
    assert [hinge.cell for hinge in rig.hinges] == cells
    assert {hinge.crease for hinge in rig.hinges} == {"close_a"}
    assert {latch.secures for latch in rig.latches} == {"slit:A-B", "cell:k0"}
    assert len(set(rig.hinge_ids)) == n_cells


def test_explicit_rig_fits_the_example_wing() -> None:
    rig = resolve_rig(load_rig(EXAMPLES / "rig_wing_explicit.toml"), CELLS, POINTS)
    assert rig.hinge_ids == ("servo_1", "servo_2", "servo_3", "servo_4")
    assert [latch.id for latch in rig.latches] == ["slit_pin"]
    assert [lock.id for lock in rig.stow_locks] == ["stow_magnet"]
    assert len(rig.sha256) == 64


def test_hinges_follow_the_order_of_the_cells() -> None:
    rig = resolve_rig(parse_rig(EXPLICIT), ("c3", "c1", "c4", "c2"), POINTS)
    assert rig.hinge_ids == ("servo_3", "servo_1", "servo_4", "servo_2")


def test_explicit_entries_override_the_template() -> None:
    document = changed(TEMPLATE, lambda d: d.update(actuator=[EXPLICIT["actuator"][1]]))
    document["hinge"] = [{"actuator": "servo_2", "cell": "c2", "crease": "open_c"}]
    document["latch"] = [{"id": "pin", "secures": POINTS[0], "kind": "lock_pin", "travel_s": 1.0}]
    rig = resolve_rig(parse_rig(document), CELLS, POINTS)
    assert rig.hinge_ids == ("servo_c1", "servo_2", "servo_c3", "servo_c4")
    assert rig.hinges[1].crease == "open_c"
    assert [latch.kind for latch in rig.latches] == ["lock_pin"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(colour="red"), ["unknown key colour", "red", "remedy"]),
        (lambda d: d["hinge"][2].update(gear=3.0), ["unknown key hinge[2].gear", "3.0"]),
        (lambda d: d["hinge"][2].pop("crease"), ["missing key hinge[2].crease"]),
        (lambda d: d["hinge"][2].update(crease="v1"), ["hinge[2].crease", "v1", "open_c"]),
        (lambda d: d["hinge"][0].update(direction=2), ["hinge[0].direction", "2"]),
        (lambda d: d["hinge"][0].update(gear_ratio=float("nan")), ["hinge[0].gear_ratio", "nan", "finite"]),
        (lambda d: d["hinge"][0].update(zero_rad=float("inf")), ["hinge[0].zero_rad", "inf", "finite"]),
        (
            lambda d: d["actuator"][1].update(max_velocity_rad_s=0.0),
            ["actuator[1].max_velocity_rad_s", "0.0"],
        ),
        (lambda d: d["actuator"][1].update(max_torque_nm=-1.0), ["actuator[1].max_torque_nm", "-1.0"]),
        (lambda d: d["actuator"][1].update(min_position_rad=99.0), ["actuator[1]", "min_position_rad"]),
        (lambda d: d["latch"][0].pop("travel_s"), ["latch[0]", "lock_pin", "travel_s"]),
        (lambda d: d["latch"][0].update(max_on_s=1.0), ["latch[0]", "max_on_s", "does not belong"]),
        (lambda d: d["latch"][1].update(duty_cycle=1.5), ["latch[1].duty_cycle", "1.5"]),
        (lambda d: d.update(rate_hz="100"), ["rate_hz", "'100'"]),
        (lambda d: d.update(backend="magic"), ["backend", "magic"]),
        (lambda d: d.update(schema="ori-deploy/rig/9"), ["schema", "ori-deploy/rig/9"]),
        (lambda d: d.update(source="elsewhere"), ["unknown key source"]),
        (
            lambda d: d["controller"].update(lost_replies_allowed=-1),
            ["controller.lost_replies_allowed", "-1"],
        ),
    ],
)
def test_bad_file_is_refused_naming_key_and_value(change: Change, words: list[str]) -> None:
    with pytest.raises(RigError) as caught:
        parse_rig(changed(EXPLICIT, change), "my.toml")
    for word in ["my.toml", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("table", "key", "inside", "outside"),
    [
        ("", "rate_hz", [10.0, 2000.0], [1e-9, 9.99, 2000.1, 1e9]),
        ("controller", "hold_ramp_s", [2.0], [2.01, 1e9]),
        ("controller", "path_tolerance_rad", [MAX_PATH_TOLERANCE_RAD], [1.01 * MAX_PATH_TOLERANCE_RAD]),
        ("controller", "start_tolerance_rad", [0.5], [0.51]),
        ("controller", "max_reading_age_s", [1.0], [1.01]),
        ("controller", "health_period_s", [MAX_HEALTH_PERIOD_S], [1.01 * MAX_HEALTH_PERIOD_S]),
        ("controller", "lost_replies_allowed", [0, 20], [21, 10**9]),
        ("controller", "settle_timeout_s", [600.0], [600.1]),
        ("controller", "max_temperature_c", [120.0], [121.0]),
        ("controller", "align_velocity_rad_s", [1.0], [1.01]),
        ("controller", "seating_effort", [0.05, 1.0], [0.0, 0.049, 1.01]),
        ("controller", "holding_effort", [0.05, 1.0], [0.0, 0.049, 1.01]),
        ("controller", "seating_tolerance", [0.001, 0.1], [0.0, 0.0009, 0.11]),
        ("each_cell", "gear_ratio", [1e-3, 1e4], [9e-4, 1.1e4]),
        ("each_cell", "zero_rad", [-1e4, 1e4], [-10001.0, 10001.0]),
        ("each_cell", "direction", [1, -1], [True, 1.0, 0]),
        ("each_latch_point", "timeout_s", [600.0], [600.1]),
    ],
)
def test_numbers_beyond_sense_are_refused_with_the_reason(
    table: str, key: str, inside: list[float], outside: list[float]
) -> None:
    def with_value(value: float) -> dict[str, Any]:
        document = copy.deepcopy(TEMPLATE)
        (document.setdefault(table, {}) if table else document)[key] = value
        return document

    for value in inside:
        parse_rig(with_value(value))
    for value in outside:
        with pytest.raises(RigError) as caught:
            parse_rig(with_value(value), "my.toml")
        for word in ("my.toml", f"{table}.{key}".removeprefix("."), f"found {value!r}", "limit:", "remedy:"):
            assert word in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda d: d["controller"].update(goal_tolerance_rad=0.2),
            ["controller", "goal_tolerance_rad = 0.2", "path_tolerance_rad = 0.1", "remedy"],
        ),
        (
            lambda d: d["controller"].update(path_tolerance_rad=0.01),
            ["controller", "goal_tolerance_rad = 0.02", "path_tolerance_rad = 0.01", "remedy"],
        ),
        (
            lambda d: d["latch"][0].update(timeout_s=0.4),
            ["latch[0]", "timeout_s = 0.4", "travel_s = 0.4", "remedy"],
        ),
    ],
)
def test_numbers_that_contradict_each_other_are_refused(change: Change, words: list[str]) -> None:
    with pytest.raises(RigError) as caught:
        parse_rig(changed(EXPLICIT, change), "my.toml")
    for word in ["my.toml", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["hinge"][1].update(actuator="servo_9"), ["unknown actuator", "servo_9", "servo_1"]),
        (lambda d: d["hinge"][1].update(cell="c9"), ["unknown cell", "c9", "c1, c2, c3, c4"]),
        (
            lambda d: d["hinge"][1].update(cell="c1"),
            ["two actuators on one crease", "servo_1 and servo_2", "c1/close_a"],
        ),
        (
            lambda d: d["hinge"][1].update(cell="c1", crease="open_d"),
            ["two driven creases in cell c1", "close_a", "open_d"],
        ),
        (
            lambda d: d["hinge"][1].update(actuator="servo_1"),
            ["two creases on one actuator", "c1/close_a", "c2/close_a"],
        ),
        (lambda d: (d["hinge"].pop(), d["actuator"].pop()), ["missing crease", "c4"]),
        (lambda d: d["hinge"].pop(), ["servo_4 drives no crease"]),
        (lambda d: d["latch"].pop(0), ["slit:P-T2 has no latch", "secures"]),
        (lambda d: d["latch"][0].update(secures="slit:X"), ["unknown latch point", "slit:X", "slit:P-T2"]),
        (lambda d: d["latch"][1].update(id="slit_pin"), ["duplicate latch id", "slit_pin"]),
        (lambda d: d["actuator"].append(d["actuator"][0]), ["duplicate actuator id", "servo_1"]),
    ],
)
def test_rig_that_does_not_fit_is_refused(change: Change, words: list[str]) -> None:
    rig = parse_rig(changed(EXPLICIT, change), "my.toml")
    with pytest.raises(RigError) as caught:
        resolve_rig(rig, CELLS, POINTS)
    for word in ["my.toml", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize("content", [b"rate_hz = ", b"\xff\xfe", b"rate_hz = " + b"1" * 5000])
def test_file_that_is_not_toml_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(RigError, match=r"broken\.toml.*not TOML"):
        load_rig(path)


def test_file_that_is_nested_too_deeply_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "deep.toml"
    path.write_bytes(b"a = " + b"[" * 100_000)
    with pytest.raises(RigError, match=r"deep\.toml.*nested too deeply.*remedy"):
        load_rig(path)


def test_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"nowhere\.toml.*cannot be read"):
        load_rig(tmp_path / "nowhere.toml")


@given(
    ratio=st.floats(0.1, 300.0),
    direction=st.sampled_from([1, -1]),
    zero=st.floats(-10.0, 10.0),
    angle=st.floats(-0.5, 7.0),
)
def test_to_crease_inverts_to_actuator(ratio: float, direction: int, zero: float, angle: float) -> None:
    document = changed(TEMPLATE, lambda d: d["each_cell"].update(gear_ratio=ratio, zero_rad=zero))
    document["each_cell"]["direction"] = direction
    rig = resolve_rig(parse_rig(document), CELLS, POINTS)
    angles = np.full((3, 4, 4), np.nan)
    angles[:, :, 2] = angle  # close_a is what the template drives
    shaft = rig.to_actuator(angles)
    assert shaft.shape == (3, 4)
    np.testing.assert_allclose(shaft, zero + direction * ratio * angle, rtol=1e-12)
    np.testing.assert_allclose(rig.to_crease(shaft), angle, rtol=1e-9, atol=1e-9)


def test_crease_limits_take_the_smaller_of_crease_and_actuator() -> None:
    document = changed(EXPLICIT, lambda d: d["hinge"][0].update(gear_ratio=40.0))
    document["hinge"][1].pop("max_crease_velocity_rad_s")
    velocity, acceleration = resolve_rig(parse_rig(document), CELLS, POINTS).crease_limits()
    np.testing.assert_allclose(velocity[:, 2], [0.1, 1.0, 0.6, 0.6])
    np.testing.assert_allclose(acceleration[:, 2], [0.5, 1.2, 1.2, 1.2])
    np.testing.assert_allclose(velocity[:, [0, 1, 3]], 1.5)


def test_creases_without_limits_are_unlimited() -> None:
    rig = resolve_rig(parse_rig(changed(EXPLICIT, lambda d: d.pop("passive_creases"))), CELLS, POINTS)
    velocity, acceleration = rig.crease_limits()
    assert np.isinf(velocity[:, [0, 1, 3]]).all()
    assert np.isinf(acceleration[:, [0, 1, 3]]).all()


def test_motion_beyond_the_position_range_is_refused() -> None:
    rig = resolve_rig(
        parse_rig(changed(TEMPLATE, lambda d: d["each_cell"]["actuator"].update(max_position_rad=4.0))),
        CELLS,
        POINTS,
    )
    angles = np.zeros((2, 4, 4))
    angles[1, 2, 2] = 0.9  # 3.6 rad at the shaft, and the start tolerance 0.2
    rig.check_range(angles)
    angles[1, 2, 2] = 0.96
    with pytest.raises(RigError, match=r"servo_c3.*range too small.*4\.04"):
        rig.check_range(angles)
