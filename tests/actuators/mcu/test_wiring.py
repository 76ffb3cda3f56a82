"""What a rig may say of a microcontroller, and what becomes of it on the wire."""

from __future__ import annotations

import zlib
from typing import Any

import pytest
from pydantic import ValidationError

from ori_deploy.actuators.mcu.readings import temperature_c
from ori_deploy.actuators.mcu.records import config_hash, device_acceleration, device_velocity, records
from ori_deploy.actuators.mcu.settings import Thermistor
from ori_deploy.actuators.mcu.wiring import resolve_wiring
from ori_deploy.actuators.rig import Latch
from ori_deploy.errors import RigError
from ori_deploy.wire.generated import ori_deploy as d
from tests.actuators.mcu.scripted import ScriptedDevice
from tests.actuators.mcu.setups import FEEDBACK, SERVO, actuator, electromagnet, lock_pin, magnet, settings, wiring


def test_templates_are_numbered_in_order_around_those_named() -> None:
    named = {"actuator": "b", "output": 0, "feedback": 1, **SERVO, **FEEDBACK}
    pin = {"latch": "pin", "output": 2, "sensor": 0, "engaged_us": 900.0, "released_us": 1800.0}
    made = wiring(4, (magnet("m"), electromagnet("e"), lock_pin("pin"), magnet("n")), hinge=[named], latch=[pin])
    assert [(h.output, h.feedback) for h in made.hinges] == [(1, 0), (0, 1), (3, 2), (4, 3)]
    assert [(latch.output, latch.sensor) for latch in made.latches] == [(None, 1), (0, 2), (2, 0), (None, 3)]


def test_pins_from_the_template_get_servo_outputs_behind_the_hinges() -> None:
    made = wiring(2, (lock_pin("p"), lock_pin("q")), each_latch={"engaged_us": 1000.0, "released_us": 2000.0})
    assert [latch.output for latch in made.latches] == [2, 3]


def test_entries_inherit_what_they_do_not_say() -> None:
    made = wiring(
        2,
        (electromagnet("e"), lock_pin("p")),
        hinge=[{"actuator": "a", "output": 4, "feedback": 6, "pulse_zero_us": 1480.0}],
        each_latch={"engaged_us": 1000.0, "released_us": 2000.0, "sensor_high": True},
        latch=[{"latch": "e", "output": 4, "sensor": 5}, {"latch": "p", "output": 7, "debounce_s": 0.1}],
    )
    servo = made.hinges[0].servo
    assert (made.hinges[0].output, made.hinges[0].feedback, servo.pulse_zero_us) == (4, 6, 1480.0)
    assert (servo.pulse_us_per_rad, servo.feedback_zero_rad) == (SERVO["pulse_us_per_rad"], -3.0)
    assert made.hinges[1].servo.pulse_zero_us == 1500.0
    assert made.latches[0].drive.sensor_high  # on magnet output 4, though a servo output 4 is taken
    assert (made.latches[1].drive.engaged_us, made.latches[1].drive.debounce_s) == (1000.0, 0.1)


def test_a_blind_entry_inherits_nothing_that_measures() -> None:
    made = wiring(1, hinge=[{"actuator": "a", "output": 0, "open_loop": True}])
    assert made.hinges[0].feedback is None
    assert made.hinges[0].servo.feedback_zero_rad is None


def test_records_in_the_units_of_the_wire() -> None:
    pin = {"latch": "pin", "output": 7, "engaged_us": 1000.0, "released_us": 2000.0, "sensor_high": True}
    made = wiring(1, (electromagnet("e"), lock_pin("pin")), latch=[pin])
    device, hinge, magnetic, driven = records(made)
    assert device.supply_uv_per_count == round(3.0 * 5.0 / 1024 * 1e6)
    assert (device.silence_ms, device.brake_ms, device.stall_ms, device.supply_min_mv) == (150, 50, 500, 4500)
    assert (device.schema, device.hinges, device.latches) == (1, 1, 2)
    assert (hinge.min_urad, hinge.max_urad) == (-2_001_000, 2_001_000)
    assert (hinge.pulse_zero_ns, hinge.pulse_slope_ns) == (1_500_000, 400_000)
    assert (hinge.feedback_zero_urad, hinge.feedback_slope_nrad) == (-3_000_000, 6_000_000)
    assert hinge.max_velocity_mrad_s == 3035
    assert hinge.max_acceleration_mrad_s2 == 41_300
    assert hinge.flags == d.ORI_HINGE_HAS_FEEDBACK
    assert (magnetic.kind, magnetic.max_on_ms, magnetic.duty_permille) == (d.ORI_ELECTROMAGNET, 2000, 250)
    assert (driven.kind, driven.output, driven.sensor, driven.flags) == (d.ORI_LOCK_PIN, 7, 255, 1)
    assert (driven.engaged_us, driven.released_us, driven.travel_ms) == (1000, 2000, 300)
    assert device_velocity(3.0) == pytest.approx(3.035)
    assert device_acceleration(20.0) == pytest.approx(41.3)


def test_the_hash_is_that_of_the_padded_payloads() -> None:
    made = records(wiring(2, (magnet("m"),)))
    assert config_hash(made) == ScriptedDevice.hash(list(made))
    assert config_hash(made) != config_hash(records(wiring(2, (magnet("m"),), stall_rad=0.31)))
    assert config_hash(()) == zlib.crc32(b"")


def test_every_record_fits_its_fields_at_the_ends_of_what_is_allowed() -> None:
    wide = {**SERVO, "pulse_min_us": 400.0, "pulse_max_us": 2700.0, "pulse_us_per_rad": -1e-3, "open_loop": True}
    slow = {"silence_s": 3.0, "brake_s": 0.5, "lead_s": 0.9, "min_lead_s": 0.9}
    with pytest.raises(ValidationError, match="min_lead_s"):
        settings(**slow)
    made = resolve_wiring(
        settings(each_hinge=wide, stall_rad=3.0, seat_rad=0.5, stall_s=10.0, supply_divider=100.0, min_supply_v=60.0),
        [actuator("a", max_velocity_rad_s=30.0, max_acceleration_rad_s2=1e6, max_position_rad=100.0)],
        [Latch(id="e", secures="stow", kind="electromagnet", max_on_s=3600.0, duty_cycle=1e-6)],
        50.0,
        None,
    )
    config_hash(records(made))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"silence_s": 0.05}, "0.1 to 3"),
        ({"brake_s": 0.12}, "brake_s"),
        ({"min_lead_s": 0.2}, "min_lead_s"),
        ({"lead_s": 0.24}, "lead_s"),
        ({"baud": 9600}, "500000: the firmware knows no other rate"),
        ({"hinge": [{"actuator": "a", "output": 0, "feedback": 0}], "each_hinge": None}, "pulse_zero_us"),
        ({"each_hinge": SERVO}, "open_loop"),
        ({"each_hinge": {**SERVO, **FEEDBACK, "open_loop": True}}, "open_loop"),
        ({"each_hinge": {**SERVO, **FEEDBACK, "feedback_low": 1001}}, "feedback_low"),
        ({"each_hinge": {**SERVO, **FEEDBACK, "pulse_us_per_rad": 0.0}}, "not 0"),
        ({"each_hinge": {**SERVO, **FEEDBACK, "pulse_max_us": 450.0}}, "pulse_min_us"),
        ({"hinge": [{"actuator": "a", "output": 0, **SERVO, **FEEDBACK}]}, "feedback is missing"),
        ({"hinge": [{"actuator": "a", "output": 12, "feedback": 0, **SERVO, **FEEDBACK}]}, "11"),
        ({"each_latch": {"engaged_us": 1000.0}}, "go together"),
        ({"each_latch": {"engaged_us": 1000.0, "released_us": 1000.0}}, "differ"),
        ({"nonsense": 1}, "nonsense"),
        ({"supply_divider": None}, "supply_divider"),
    ],
)
def test_settings_that_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        settings(**changes)


A = {"actuator": "a", "output": 3, "feedback": 3, **SERVO, **FEEDBACK}
B = {"actuator": "b", "output": 4, "feedback": 4, **SERVO, **FEEDBACK}
PIN = {"latch": "pin", "output": 5, "sensor": 0, "engaged_us": 1000.0, "released_us": 2000.0}


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: wiring(rate_hz=51.0), "51.*50.*remedy"),
        (lambda: wiring(rate_hz=20.0), "silence_s.*0.17"),
        (lambda: wiring(rate_hz=25.0, lead_s=0.28), "lead_s.*0.29"),
        (lambda: wiring(lead_s=0.36), "queue"),
        (lambda: wiring(13), "too many hinges.*13.*12"),
        (lambda: wiring(1, tuple(magnet(f"m{k}") for k in range(9))), "too many latches"),
        (lambda: wiring(hinge=[{**A, "actuator": "z"}]), r"hinge\[0\].*z"),
        (lambda: wiring(hinge=[A, {**A, "output": 5}]), "a is given twice"),
        (lambda: wiring(hinge=[A, {**B, "output": 3}]), "servo output 3.*actuator a"),
        (lambda: wiring(hinge=[A, {**B, "feedback": 3}]), "feedback input 3.*actuator a"),
        (lambda: wiring(each_hinge=None, hinge=[A]), r"actuator b.*\[\[mcu.hinge\]\]"),
        (lambda: wiring(each_hinge={**SERVO, **FEEDBACK, "pulse_us_per_rad": 510.0}), "480 to 2520 us"),
        (lambda: wiring(each_hinge={**SERVO, **FEEDBACK, "feedback_low": 300}), "167 to 833 counts"),
        (lambda: wiring(1, (magnet("m"),), each_latch=None), r"latch m.*\[\[mcu.latch\]\]"),
        (lambda: wiring(1, (lock_pin("pin"),)), "pin: a lock pin has no pulses"),
        (lambda: wiring(1, (magnet("m"),), latch=[{"latch": "m"}]), "without a sensor"),
        (lambda: wiring(1, (magnet("m"),), latch=[{"latch": "m", "sensor": 0, "output": 1}]), "no output"),
        (lambda: wiring(1, (electromagnet("e"),), latch=[{"latch": "e"}]), "no output drives it"),
        (lambda: wiring(1, (electromagnet("e"),), latch=[{"latch": "e", "output": 8}]), "magnet output 8"),
        (
            lambda: wiring(2, (lock_pin("pin"),), hinge=[{**A, "output": 5}], latch=[PIN]),
            "servo output 5.*actuator a",
        ),
        (
            lambda: wiring(
                1, (magnet("m"), magnet("n")), latch=[{"latch": "m", "sensor": 1}, {"latch": "n", "sensor": 1}]
            ),
            "sensor input 1.*latch m",
        ),
        (
            lambda: wiring(12, (lock_pin("p"),), each_latch={"engaged_us": 1000.0, "released_us": 2000.0}),
            "no servo output is left",
        ),
    ],
)
def test_wirings_that_are_refused(make: Any, words: str) -> None:
    with pytest.raises(RigError, match=words) as refused:
        make()
    assert "rig.toml" in str(refused.value)
    assert "remedy" in str(refused.value)


def test_a_number_beyond_its_field_is_refused() -> None:
    for change in ({"max_velocity_rad_s": 31.0}, {"max_acceleration_rad_s2": 2e6}):
        with pytest.raises(RigError, match="can be told"):
            resolve_wiring(settings(), [actuator("a", **change)], (), 50.0, None)


def test_thermistor() -> None:
    ntc = Thermistor()
    assert temperature_c(512, ntc) == pytest.approx(25.0)
    # 10 kohm, B 3950: 3.588 kohm at 50 degrees, 27.2 kohm at 5
    assert temperature_c(round(1024 * 3.588 / 13.588), ntc) == pytest.approx(50.0, abs=0.3)
    assert temperature_c(round(1024 * 25.91 / 35.91), ntc) == pytest.approx(5.0, abs=0.3)
    for count in (0, 5, 1020, 1023):
        assert temperature_c(count, ntc) != temperature_c(count, ntc)
