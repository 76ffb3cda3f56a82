"""What every backend promises. A new backend joins by adding a factory to `BACKENDS`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from ori_deploy.actuators.bus import (
    ActuatorBus,
    BusClosed,
    BusError,
    BusTimeout,
    CommandRefused,
    CorruptReply,
    HardwareError,
)
from tests.contract.backends import BACKENDS, SLOW, STEP_RAD, N, Subject


@pytest.fixture(params=[pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else []) for name in BACKENDS])
def subject(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Subject]:
    with BACKENDS[request.param](tmp_path) as made:
        yield made


@pytest.fixture
def connected(subject: Subject) -> Subject:
    subject.bus.connect()
    return subject


CALLS: dict[str, Callable[[ActuatorBus], object]] = {
    "enable_torque": lambda bus: bus.enable_torque(),
    "disable_torque": lambda bus: bus.disable_torque(),
    "command_hinges": lambda bus: bus.command_hinges(np.zeros(N)),
    "read_hinges": lambda bus: bus.read_hinges(),
    "read_health": lambda bus: bus.read_health(),
    "reset_errors": lambda bus: bus.reset_errors(),
    "engage": lambda bus: bus.engage(bus.latch_ids[0]),
    "release": lambda bus: bus.release(bus.latch_ids[0]),
    "read_latches": lambda bus: bus.read_latches(),
}


@pytest.mark.parametrize("call", CALLS)
def test_nothing_works_before_connect(subject: Subject, call: str) -> None:
    with pytest.raises(BusClosed):
        CALLS[call](subject.bus)


@pytest.mark.parametrize("call", CALLS)
def test_nothing_works_unplugged_and_replugging_alone_does_not_help(connected: Subject, call: str) -> None:
    connected.unplug()
    with pytest.raises(BusClosed):
        CALLS[call](connected.bus)
    assert not connected.bus.connected
    with pytest.raises(BusClosed):
        connected.bus.connect()
    connected.replug()
    with pytest.raises(BusClosed):
        CALLS[call](connected.bus)
    connected.bus.connect()
    assert connected.bus.read_hinges().valid.all()


def test_close_twice_is_harmless(connected: Subject) -> None:
    connected.bus.close()
    connected.bus.close()
    assert not connected.bus.connected


def test_readings_are_valid_complete_and_of_now(connected: Subject) -> None:
    connected.wait(0.1)
    readings = connected.bus.read_hinges()
    for array in (readings.position_rad, readings.velocity_rad_s):
        assert array.shape == (N,)
        assert np.isfinite(array).all()
    assert readings.current_a.shape == (N,)
    assert (np.isfinite(readings.current_a) == connected.senses_current).all()
    assert readings.valid.all()
    assert not readings.alert.any()
    assert (np.abs(readings.time_s - connected.clock.now()) < 0.05).all()
    health = connected.bus.read_health()
    assert (health.valid & (health.hardware_error == 0)).all()
    assert (health.voltage_v > 5.0).all()
    assert ((health.temperature_c > 0.0) & (health.temperature_c < 60.0)).all()


def test_connecting_moves_nothing_and_leaves_torque_off(connected: Subject) -> None:
    before = connected.positions()
    connected.wait(1.0)
    np.testing.assert_allclose(connected.positions(), before, atol=0.02)
    assert not connected.bus.read_health().torque_on.any()


def test_torque_goes_on_where_the_hinges_stand(connected: Subject) -> None:
    before = connected.positions()
    goal = connected.bus.enable_torque()
    np.testing.assert_allclose(goal, before, atol=0.02)
    connected.wait(1.0)
    np.testing.assert_allclose(connected.positions(), goal, atol=0.02)
    assert connected.bus.read_health().torque_on.all()


def test_torque_on_again_after_a_goal_that_never_took_effect_does_not_jump(connected: Subject) -> None:
    before = connected.positions()
    connected.bus.command_hinges(before + STEP_RAD)
    connected.wait(0.5)
    np.testing.assert_allclose(connected.positions(), before, atol=0.02)
    connected.bus.enable_torque()
    connected.wait(0.5)
    np.testing.assert_allclose(connected.positions(), before, atol=0.02)


def test_goal_is_reached(connected: Subject) -> None:
    goal = connected.bus.enable_torque() + STEP_RAD * np.array([1.0, -1.0, 0.5, 0.0])
    connected.bus.command_hinges(goal)
    connected.wait(1.0)
    np.testing.assert_allclose(connected.positions(), goal, atol=0.02)


def test_goals_are_copied(connected: Subject) -> None:
    goal = connected.bus.enable_torque()
    mine = goal.copy()
    connected.bus.command_hinges(mine)
    mine += STEP_RAD
    connected.wait(0.5)
    np.testing.assert_allclose(connected.positions(), goal, atol=0.02)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e6, -1e6])
def test_bad_goal_is_refused_before_anything_goes_out(connected: Subject, bad: float) -> None:
    goal = connected.bus.enable_torque()
    wrong = goal + STEP_RAD
    wrong[2] = bad
    with pytest.raises(CommandRefused, match=connected.bus.hinge_ids[2]):
        connected.bus.command_hinges(wrong)
    connected.wait(0.5)
    np.testing.assert_allclose(connected.positions(), goal, atol=0.02)


def test_goals_of_the_wrong_number_are_refused(connected: Subject) -> None:
    with pytest.raises(CommandRefused, match="shape"):
        connected.bus.command_hinges(np.zeros(N + 1))


def test_a_silent_hinge_is_not_a_number_and_the_others_are_read(connected: Subject) -> None:
    connected.mute(connected.bus.hinge_ids[1])
    readings = connected.bus.read_hinges()
    np.testing.assert_array_equal(readings.valid, [True, False, True, True])
    for array in (readings.position_rad, readings.velocity_rad_s, readings.time_s):
        np.testing.assert_array_equal(np.isnan(array), ~readings.valid)
    assert np.isnan(readings.current_a[1])
    health = connected.bus.read_health()
    assert not health.valid[1]
    assert np.isnan(health.temperature_c[1])
    assert not health.torque_on[1]


@pytest.mark.parametrize("spoil", ["drop", "corrupt"])
def test_one_spoilt_reply_is_one_invalid_reading(connected: Subject, spoil: str) -> None:
    getattr(connected, spoil)(connected.bus.hinge_ids[0], 1)
    assert not connected.bus.read_hinges().valid[0]
    assert connected.bus.read_hinges().valid.all()


def test_total_silence_and_total_garbage_are_typed_errors(connected: Subject) -> None:
    for hinge in connected.bus.hinge_ids:
        connected.drop(hinge, 1)
    with pytest.raises(BusTimeout):
        connected.bus.read_hinges()
    for hinge in connected.bus.hinge_ids:
        connected.corrupt(hinge, 1)
    with pytest.raises(CorruptReply):
        connected.bus.read_hinges()
    assert connected.bus.read_hinges().valid.all()


def test_torque_stays_off_when_a_hinge_does_not_say_where_it_is(connected: Subject) -> None:
    connected.mute(connected.bus.hinge_ids[3])
    with pytest.raises(CommandRefused, match=connected.bus.hinge_ids[3]):
        connected.bus.enable_torque()
    assert not connected.bus.read_health().torque_on.any()


def test_a_missing_hinge_is_named_at_connect(subject: Subject) -> None:
    subject.mute(subject.bus.hinge_ids[2])
    with pytest.raises(BusTimeout, match=subject.bus.hinge_ids[2]):
        subject.bus.connect()
    assert not subject.bus.connected


def test_hardware_error_shows_takes_torque_off_and_can_be_reset_without_torque(connected: Subject) -> None:
    connected.bus.enable_torque()
    connected.overload(connected.bus.hinge_ids[1])
    assert connected.bus.read_hinges().alert.tolist() == [False, True, False, False]
    health = connected.bus.read_health()
    assert HardwareError(int(health.hardware_error[1])) & HardwareError.OVERLOAD
    assert health.torque_on.tolist() == [True, False, True, True]
    connected.bus.reset_errors()
    health = connected.bus.read_health()
    assert not health.hardware_error.any()
    assert not health.torque_on[1]


def test_disabled_torque_follows_no_goal(connected: Subject) -> None:
    goal = connected.bus.enable_torque()
    connected.bus.disable_torque()
    connected.bus.command_hinges(goal + STEP_RAD)
    connected.wait(0.5)
    np.testing.assert_allclose(connected.positions(), goal, atol=0.02)


def test_effort_is_limited_where_the_bus_says_so_until_torque_goes_on_anew(connected: Subject) -> None:
    bus, effort = connected.bus, connected.effort
    assert bus.limits_effort == (effort is not None), "a bus says whether it can, and no caller has to try"
    goal = bus.enable_torque() + STEP_RAD
    bus.limit_effort(0.4)
    bus.command_hinges(goal)
    connected.wait(1.0)
    np.testing.assert_allclose(connected.positions(), goal, atol=0.02)  # that is strength enough to get there
    if effort is not None:
        np.testing.assert_allclose(effort(), 0.4, atol=2e-3)
    bus.limit_effort(1.0)
    connected.positions()  # behind this answer it has been heard
    if effort is not None:
        np.testing.assert_allclose(effort(), 1.0)
    bus.limit_effort(0.7)
    bus.enable_torque()
    if effort is not None:
        np.testing.assert_allclose(effort(), 1.0)


@pytest.mark.parametrize("part", [0.0, -0.5, 1.01, np.nan, np.inf])
def test_what_is_no_part_of_an_effort_is_refused_by_every_bus(connected: Subject, part: float) -> None:
    connected.bus.enable_torque()
    with pytest.raises(CommandRefused, match="above 0, up to 1"):
        connected.bus.limit_effort(part)
    if connected.effort is not None:
        np.testing.assert_allclose(connected.effort(), 1.0)


def test_effort_needs_a_connection(subject: Subject) -> None:
    with pytest.raises(BusClosed):
        subject.bus.limit_effort(0.5)
    subject.bus.connect()
    subject.unplug()
    if subject.bus.limits_effort:
        with pytest.raises(BusClosed):
            subject.bus.limit_effort(0.5)
        assert not subject.bus.connected


def test_unknown_latch_is_refused(connected: Subject) -> None:
    for command in (connected.bus.engage, connected.bus.release):
        with pytest.raises(CommandRefused, match="nonsense"):
            command("nonsense")


def test_engaging_a_latch_is_not_its_confirmation(connected: Subject) -> None:
    for latch in connected.bus.latch_ids:  # half-way: nothing can close here
        connected.bus.engage(latch)
    connected.wait(1.0)
    readings = connected.bus.read_latches()
    assert [reading.id for reading in readings] == list(connected.bus.latch_ids)
    assert all(reading.engaged and reading.valid for reading in readings)
    assert not any(reading.confirmed for reading in readings)


def test_every_error_is_a_bus_error() -> None:
    for error in (BusTimeout, BusClosed, CorruptReply, CommandRefused):
        assert issubclass(error, BusError)
