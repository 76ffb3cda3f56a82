"""Rigs on a Dynamixel bus: what is refused before anything is opened."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ori_deploy.actuators.dynamixel.wiring import RAD_PER_COUNT, Wiring
from ori_deploy.actuators.resolve import resolve_rig
from ori_deploy.actuators.rig import load_rig, parse_rig
from ori_deploy.errors import RigError
from ori_deploy.wire.dynamixel import OperatingMode

CELLS = ("c1", "c2", "c3")
POINTS = ("slit:P-T1",)
RIG: dict[str, Any] = {
    "schema": "ori-deploy/rig/1",
    "backend": "dynamixel",
    "rate_hz": 100.0,
    "each_cell": {
        "crease": "close_a",
        "gear_ratio": 2.0,
        "actuator": {
            "max_velocity_rad_s": 4.0,
            "max_acceleration_rad_s2": 20.0,
            "max_torque_nm": 2.0,
            "min_position_rad": -3.0,
            "max_position_rad": 3.0,
        },
    },
    "latch": [{"id": "pin", "secures": "stow", "kind": "lock_pin", "travel_s": 0.2}],
    "each_latch_point": {"kind": "magnet"},
    "dynamixel": {
        "port": "/dev/null",
        "baud": 1_000_000,
        "magnets": "by_hinges",
        "servo": [{"latch": "pin", "id": 2, "model": "xl330-m288", "engaged_rad": 1.0, "released_rad": -0.5}],
    },
}
Change = Callable[[dict[str, Any]], object]


def wiring(change: Change = lambda _: None) -> Wiring:
    document = copy.deepcopy(RIG)
    change(document)
    found = resolve_rig(parse_rig(document, "my.toml"), CELLS, POINTS).wiring
    assert found is not None
    return found


def test_template_servos_get_the_ids_that_are_free_in_the_order_of_the_cells() -> None:
    found = wiring()
    assert [(servo.name, servo.id) for servo in found.hinges] == [("servo_c1", 1), ("servo_c2", 3), ("servo_c3", 4)]
    assert [(pin.latch, pin.id, pin.model.name) for pin in found.pins] == [("pin", 2, "XL330-M288")]
    assert {servo.model.name for servo in found.hinges} == {"XM430-W350"}


def test_ranges_within_one_turn_are_position_mode_and_wider_ones_extended() -> None:
    near = wiring().hinges[0]
    assert (near.mode, near.one_turn) == (OperatingMode.POSITION, True)
    assert near.min_count == 2048 - round(3.0 / RAD_PER_COUNT)
    far = wiring(lambda d: d["each_cell"]["actuator"].update(max_position_rad=26.0)).hinges[0]
    assert (far.mode, far.one_turn) == (OperatingMode.EXTENDED_POSITION, False)


def test_a_pin_gives_way_where_its_servo_measures_current() -> None:
    assert wiring().pins[0].mode is OperatingMode.CURRENT_BASED_POSITION
    stiff = wiring(lambda d: d["dynamixel"]["servo"][0].update(model="XL430-W250"))
    assert stiff.pins[0].mode is OperatingMode.POSITION


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.pop("dynamixel"), ["backend", "[dynamixel]"]),
        (lambda d: d["dynamixel"].update(baud=123), ["dynamixel.baud", "123", "57600"]),
        (lambda d: d["dynamixel"].update(model="MG996"), ["dynamixel.model", "MG996", "XM430-W350"]),
        (lambda d: d["dynamixel"].update(colour=1), ["unknown key dynamixel.colour"]),
        (lambda d: d["dynamixel"].update(watchdog_s=0.05), ["watchdog_s", "0.05", "0.02"]),
        (lambda d: d["dynamixel"].update(watchdog_s=3.0), ["watchdog_s", "3.0"]),
        (lambda d: d["dynamixel"].update(current_limit_a=1.0), ["current_limit_a", "current_based_position"]),
        (lambda d: d["dynamixel"].update(operating_mode="current_based_position"), ["current_limit_a"]),
        (
            lambda d: d["dynamixel"].update(
                operating_mode="current_based_position", current_limit_a=1.0, model="XL430-W250"
            ),
            ["servo_c1", "XL430-W250", "CURRENT_BASED_POSITION"],
        ),
        (lambda d: d["dynamixel"].update(first_id=251), ["servo_c3", "first_id = 251", "252"]),
        (lambda d: d["dynamixel"]["servo"][0].update(id=253), ["dynamixel.servo[0].id", "253"]),
        (lambda d: d["dynamixel"]["servo"].append({"actuator": "servo_c1", "id": 2}), ["id 2", "pin", "servo_c1"]),
        (lambda d: d["dynamixel"]["servo"].append({"actuator": "servo_c9", "id": 5}), ["servo_c9", "servo_c1"]),
        (lambda d: d["dynamixel"]["servo"].append({"id": 5}), ["servo[1]", "actuator", "latch"]),
        (
            lambda d: d["dynamixel"]["servo"].extend([{"actuator": "servo_c1", "id": 5}] * 2),
            ["servo_c1", "twice"],
        ),
        (lambda d: d["dynamixel"].update(servo=[]), ["pin", "no servo drives", "[[dynamixel.servo]]"]),
        (lambda d: d["dynamixel"]["servo"][0].pop("engaged_rad"), ["engaged_rad"]),
        (lambda d: d["dynamixel"]["servo"][0].update(engaged_rad=4.0), ["pin", "first turn"]),
        (lambda d: d["dynamixel"].pop("magnets"), ["latch_slit:P-T1", "no sensor", "by_hinges"]),
        (
            lambda d: d["each_latch_point"].update(kind="electromagnet", max_on_s=1.0, duty_cycle=0.5),
            ["latch_slit:P-T1", "electromagnet"],
        ),
        (lambda d: d["each_cell"]["actuator"].update(max_velocity_rad_s=9.0), ["max_velocity_rad_s", "9", "4.82"]),
        (lambda d: d["each_cell"]["actuator"].update(max_torque_nm=9.0), ["max_torque_nm", "9", "4.1"]),
        (
            lambda d: [
                d["dynamixel"].update(operating_mode="position"),
                d["each_cell"]["actuator"].update(max_position_rad=6.0),
            ],
            ["servo_c1", "POSITION", "6 rad", "extended_position"],
        ),
        (lambda d: d.update(rate_hz=1000.0), ["rate_hz", "1000 Hz", "the longest cycle takes", "remedy"]),
        (
            lambda d: d.update(rate_hz=15.0),
            ["watchdog_s", "0.08 s at 15 Hz", "0.133 s", "watchdog_s = 0.14"],
        ),
    ],
)
def test_bad_wiring_is_refused_naming_thing_and_value(change: Change, words: list[str]) -> None:
    with pytest.raises(RigError) as caught:
        wiring(change)
    for word in ["my.toml", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(("rate_hz", "watchdog_s"), [(12.5, 0.16), (25.0, 0.08), (10.0, 0.0), (100.0, 0.02)])
def test_a_watchdog_bears_a_cycle_that_is_lost(rate_hz: float, watchdog_s: float) -> None:
    wiring(lambda d: [d.update(rate_hz=rate_hz), d["dynamixel"].update(watchdog_s=watchdog_s)])
    if watchdog_s > 0.0:
        with pytest.raises(RigError, match="between two cycles"):
            wiring(lambda d: [d.update(rate_hz=0.9 * rate_hz), d["dynamixel"].update(watchdog_s=watchdog_s)])


def test_the_shipped_rig_drives_the_example_wing_within_one_turn() -> None:
    rig = load_rig(Path(__file__).parents[3] / "examples" / "rig_wing_dynamixel.toml")
    resolved = resolve_rig(rig, ("c1", "c2", "c3", "c4"), ("slit:P-T2",))
    assert resolved.wiring is not None
    assert all(servo.one_turn for servo in resolved.wiring.hinges)
