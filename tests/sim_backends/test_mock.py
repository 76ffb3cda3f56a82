"""The mock's physics: what it says is what a servo of that size would do, however often one looks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ori_deploy.actuators.bus import CommandRefused, HardwareError, LatchTripped
from ori_deploy.clock import VirtualClock
from sim_backends.mock import MockBus
from sim_backends.mock_servos import STEP_S
from tests.deploy.synthetic import synthetic_plan, synthetic_rig

PLAN = synthetic_plan(4)
STOWED, DEPLOYED = PLAN.crease_angles_rad[0], PLAN.crease_angles_rad[-1]
IDEAL = {"noise_rad": 0.0, "encoder_step_rad": 1e-9, "backlash_rad": 0.0, "load_nm": 0.0}


def make(start: str = "stowed", mock: dict[str, Any] | None = None, **tables: Any) -> tuple[MockBus, VirtualClock]:
    """A connected mock with torque on."""
    rig = synthetic_rig(PLAN, mock={**IDEAL, **(mock or {})}, **tables)
    clock = VirtualClock()
    bus = MockBus.from_rig(rig, clock, STOWED, DEPLOYED, start="deployed" if start == "deployed" else "stowed")
    bus.connect()
    bus.enable_torque()
    return bus, clock


def wait(clock: VirtualClock, duration_s: float) -> None:
    clock.sleep_until(clock.now() + duration_s)


def confirmed(bus: MockBus, latch_id: str) -> bool | None:
    return next(reading.confirmed for reading in bus.read_latches() if reading.id == latch_id)


def run_with_polls(polls: list[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same commands at the same times, read at other times as well."""
    bus, clock = make(mock={"noise_rad": 0.002, "backlash_rad": 0.01, "load_nm": 0.4})
    goal = bus.true_shaft_rad
    for k in range(5):
        for poll in sorted(0.1 * k + p for p in polls):
            clock.sleep_until(poll)
            bus.read_hinges()
        clock.sleep_until(0.1 * (k + 1))
        bus.command_hinges(goal - 0.1 * (k + 1))
    return bus.true_shaft_rad, bus.true_output_rad, bus.read_health().temperature_c


@settings(max_examples=25)
@given(st.lists(st.floats(0.0, 0.0999), max_size=20))
def test_what_happens_does_not_depend_on_how_often_one_looks(polls: list[float]) -> None:
    for watched, alone in zip(run_with_polls(polls), run_with_polls([]), strict=True):
        np.testing.assert_array_equal(watched, alone)


def test_same_seed_same_readings_other_seed_others() -> None:
    readings = []
    for seed in (5, 5, 6):
        bus, _ = make(mock={"noise_rad": 0.01, "seed": seed})
        readings.append(bus.read_hinges().position_rad)
    np.testing.assert_array_equal(readings[0], readings[1])
    assert (readings[0] != readings[2]).any()


def test_a_small_step_is_answered_exponentially() -> None:
    bus, clock = make()
    start = bus.true_shaft_rad
    bus.command_hinges(start - 0.1)
    for t in (0.01, 0.03, 0.06, 0.15):
        clock.sleep_until(t)
        np.testing.assert_allclose(bus.true_shaft_rad, start - 0.1 * (1.0 - np.exp(-t / 0.03)), rtol=0, atol=1e-9)


def test_speed_is_limited_and_falls_with_load_and_voltage() -> None:
    speeds = []
    for mock, sag in (({}, 0.0), ({"load_nm": 1.0}, 0.0), ({}, 6.0)):
        bus, clock = make(mock={**mock, "supply_ohm": 0.0})
        bus.sag(sag)
        start = bus.true_shaft_rad
        bus.command_hinges(start - 3.0)
        wait(clock, 0.2)
        speeds.append(float((start - bus.true_shaft_rad)[0] / 0.2))
    np.testing.assert_allclose(speeds, [8.0, 4.0, 4.0], rtol=1e-6)


def test_encoder_sees_the_shaft_and_not_the_crease_behind_the_play() -> None:
    bus, clock = make(mock={"backlash_rad": 0.02})
    start = bus.true_output_rad
    bus.command_hinges(bus.true_shaft_rad - 0.1)
    wait(clock, 1.0)
    np.testing.assert_allclose(bus.true_output_rad - bus.true_shaft_rad, 0.01, atol=1e-9)
    bus.command_hinges(bus.true_shaft_rad + 0.015)  # turning back inside the play moves no crease
    wait(clock, 1.0)
    np.testing.assert_allclose(bus.true_output_rad, start - 0.1 + 0.01, atol=1e-9)


def test_positions_are_quantised() -> None:
    bus, clock = make(mock={"encoder_step_rad": 0.01})
    wait(clock, 0.1)
    steps = bus.read_hinges().position_rad / 0.01
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)


def test_a_jammed_servo_strains_and_shuts_itself_off() -> None:
    bus, clock = make()
    bus.jam("servo_c2")
    start = bus.true_shaft_rad
    bus.command_hinges(start - 0.5)
    wait(clock, 0.5)
    readings = bus.read_hinges()
    assert readings.current_a[1] > 3.0 * readings.current_a[0]
    assert bus.true_shaft_rad[1] == start[1]
    wait(clock, 1.0)
    assert bus.read_health().hardware_error.tolist() == [0, HardwareError.OVERLOAD, 0, 0]
    assert bus.true_torque_on.tolist() == [True, False, True, True]


def test_torque_does_not_go_on_outside_the_range() -> None:
    bus, _ = make()
    bus.disable_torque()
    bus.push("servo_c3", 25.0)
    with pytest.raises(CommandRefused, match=r"servo_c3.*limit: -20 to 20 rad"):
        bus.enable_torque()
    assert not bus.true_torque_on.any()


def test_reboot_takes_torque_off_and_leaves_the_shaft() -> None:
    bus, clock = make()
    start = bus.true_shaft_rad
    bus.reboot("servo_c3")
    bus.command_hinges(start - 0.2)
    wait(clock, 1.0)
    assert bus.true_torque_on.tolist() == [True, True, False, True]
    np.testing.assert_allclose(bus.true_shaft_rad - start, [-0.2, -0.2, 0.0, -0.2], atol=1e-6)


@pytest.mark.slow
def test_heat_is_measured_trips_cools_and_cannot_be_cleared_while_hot() -> None:
    bus, clock = make()
    bus.overheat("servo_c1", 90.0)
    wait(clock, 0.1)
    assert bus.read_health().temperature_c[0] > 80.0
    assert bus.read_health().hardware_error[0] == HardwareError.OVERHEATING
    with pytest.raises(CommandRefused, match=r"servo_c1.*too hot"):
        bus.reset_errors()
    wait(clock, 120.0)
    bus.reset_errors()
    assert not bus.read_health().hardware_error.any()


def test_work_heats_by_current_squared() -> None:
    rises = []
    for load in (0.5, 1.0):
        bus, clock = make(mock={"load_nm": load, "supply_ohm": 0.0})
        wait(clock, 10.0)
        rises.append(float(bus.read_health().temperature_c[0]) - 23.0)
    assert 3.0 < rises[1] / rises[0] < 4.0  # 4, but for the idle current


def test_sag_is_measured() -> None:
    bus, clock = make(mock={"supply_ohm": 0.0})
    bus.sag(3.0)
    wait(clock, 0.1)
    np.testing.assert_allclose(bus.read_health().voltage_v, 9.0)


def latch(kind: str, **keys: Any) -> dict[str, Any]:
    return {"id": "it", "secures": "slit:P-T2", "kind": kind, "capture_range_rad": 0.02, **keys}


KINDS = [
    latch("magnet"),
    latch("electromagnet", max_on_s=60.0, duty_cycle=0.5),
    latch("lock_pin", travel_s=0.2),
]


def drive(bus: MockBus, clock: VirtualClock, fold: float) -> None:
    angles = STOWED + fold * (DEPLOYED - STOWED)
    shaft = 0.5 - 4.0 * angles[:, 2]
    for _ in range(200):
        bus.command_hinges(shaft)
        wait(clock, 0.01)


@pytest.mark.parametrize("table", KINDS, ids=lambda table: str(table["kind"]))
def test_a_latch_closes_only_inside_its_capture_range(table: dict[str, Any]) -> None:
    bus, clock = make(latch=[table])
    bus.engage("it")
    drive(bus, clock, 0.97)  # 0.027 to 0.039 rad from closed
    assert confirmed(bus, "it") is False
    drive(bus, clock, 0.99)
    assert confirmed(bus, "it") is True
    assert bus.truly_closed("it")


@pytest.mark.parametrize("table", KINDS, ids=lambda table: str(table["kind"]))
def test_a_latch_judges_by_true_and_not_by_measured_positions(table: dict[str, Any]) -> None:
    bus, clock = make(latch=[table], mock={"backlash_rad": 0.4})  # 0.05 rad to either side at the crease
    drive(bus, clock, 1.0)
    bus.engage("it")
    wait(clock, 0.5)
    np.testing.assert_allclose(bus.read_hinges().position_rad, bus.true_shaft_rad, atol=1e-6)
    assert confirmed(bus, "it") is False


@pytest.mark.parametrize("table", KINDS, ids=lambda table: str(table["kind"]))
def test_a_released_latch_lets_the_structure_fold(table: dict[str, Any]) -> None:
    bus, clock = make("deployed", latch=[table])
    assert confirmed(bus, "it") is True
    bus.release("it")
    wait(clock, 0.5)
    assert confirmed(bus, "it") is (table["kind"] == "magnet")  # a magnet opens when it is pulled apart
    drive(bus, clock, 0.5)
    assert confirmed(bus, "it") is False


@pytest.mark.parametrize("table", KINDS[1:], ids=lambda table: str(table["kind"]))
def test_a_closed_powered_latch_holds_against_the_servos(table: dict[str, Any]) -> None:
    bus, clock = make("deployed", latch=[table])
    before = bus.true_output_rad
    bus.command_hinges(bus.true_shaft_rad + 1.0)
    wait(clock, 0.5)
    np.testing.assert_allclose(bus.true_output_rad, before, atol=0.02)
    assert confirmed(bus, "it") is True


def test_a_latch_on_a_cell_depends_on_that_cell_only() -> None:
    bus, clock = make(latch=[{"id": "it", "secures": "cell:c1", "kind": "magnet"}])
    goal = bus.true_shaft_rad
    goal[0] = 0.5 - 4.0 * DEPLOYED[0, 2]
    bus.command_hinges(goal)
    wait(clock, 3.0)
    assert confirmed(bus, "it") is True
    assert confirmed(bus, "latch_slit:P-T2") is False


def test_a_lock_pin_takes_its_travel_time() -> None:
    bus, clock = make("deployed", latch=[latch("lock_pin", travel_s=0.4)])
    bus.release("it")
    wait(clock, 1.0)
    bus.engage("it")
    wait(clock, 0.38)
    assert confirmed(bus, "it") is False
    wait(clock, 0.04)
    assert confirmed(bus, "it") is True


def test_a_lock_pin_that_meets_no_hole_waits_before_it() -> None:
    bus, clock = make(latch=[latch("lock_pin", travel_s=0.4)])
    bus.engage("it")
    wait(clock, 5.0)
    drive(bus, clock, 1.0)  # it did not block the way, and went home on arrival
    assert confirmed(bus, "it") is True


def test_an_electromagnet_trips_after_its_time_and_recovers() -> None:
    bus, clock = make("deployed", latch=[latch("electromagnet", max_on_s=2.0, duty_cycle=0.5)])
    bus.release("it")
    wait(clock, 10.0)
    bus.engage("it")
    wait(clock, 1.95)
    assert confirmed(bus, "it") is True
    wait(clock, 0.1)
    assert confirmed(bus, "it") is False
    assert bus.read_latches()[0].fault is not None
    with pytest.raises(LatchTripped, match="it"):
        bus.engage("it")
    wait(clock, 5.0)
    bus.engage("it")
    wait(clock, 0.1)
    assert confirmed(bus, "it") is True


def test_an_electromagnet_rated_for_ever_never_trips() -> None:
    bus, clock = make("deployed", latch=[latch("electromagnet", max_on_s=1.0, duty_cycle=1.0)])
    wait(clock, 60.0)
    assert confirmed(bus, "it") is True


@pytest.mark.parametrize("table", KINDS, ids=lambda table: str(table["kind"]))
def test_a_stuck_latch_stays_as_it_is(table: dict[str, Any]) -> None:
    closed, clock = make("deployed", latch=[table])
    closed.latch_stuck("it")
    closed.release("it")
    wait(clock, 1.0)
    assert confirmed(closed, "it") is True
    drive(closed, clock, 0.9)
    assert closed.truly_closed("it")
    opened, clock = make(latch=[table])
    opened.latch_stuck("it")
    drive(opened, clock, 1.0)
    opened.engage("it")
    wait(clock, 1.0)
    assert confirmed(opened, "it") is False


def test_a_blind_latch_says_that_it_does_not_know() -> None:
    bus, _ = make("deployed", latch=[latch("magnet")])
    bus.latch_blind("it")
    assert confirmed(bus, "it") is None
    assert bus.truly_closed("it")


def test_lost_latch_replies_are_not_valid_and_not_confirmed() -> None:
    bus, _ = make("deployed")
    bus.drop_latch_replies(1)
    assert all(not reading.valid and reading.confirmed is None for reading in bus.read_latches())
    assert all(reading.valid for reading in bus.read_latches())


def test_delayed_reads_take_time() -> None:
    bus, clock = make()
    bus.delay_reads(1, 0.05)
    before = clock.now()
    bus.read_hinges()
    assert clock.now() == pytest.approx(before + 0.05)
    bus.read_hinges()
    assert clock.now() == pytest.approx(before + 0.05)


def test_the_grid_is_finer_than_the_servo() -> None:
    assert synthetic_rig(PLAN).mock.time_constant_s / STEP_S >= 10.0
