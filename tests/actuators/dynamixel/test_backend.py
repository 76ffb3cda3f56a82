"""What the Dynamixel backend promises beyond the contract, on virtual servos."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ori_deploy.actuators.bus import (
    ActuatorFault,
    ActuatorRestarted,
    BusTimeout,
    CommandRefused,
    WatchdogTripped,
)
from ori_deploy.actuators.dynamixel.adapter import latency_advice, latency_timer_s
from ori_deploy.actuators.dynamixel.bus import REARM_EVERY
from ori_deploy.actuators.dynamixel.line import ServoLine
from ori_deploy.errors import RigError
from ori_deploy.wire.dynamixel import Register
from sim_backends.dynamixel.launcher import VirtualBus
from tests.actuators.dynamixel.virtual import N, Setup, servos

STEP = np.array([0.3, -0.3, 0.2])


def hold(setup: Setup) -> np.ndarray:
    setup.bus.connect()
    return setup.bus.enable_torque()


def stream(setup: Setup, goal: np.ndarray, seconds: float) -> None:
    """Command a goal at 100 Hz, as a control loop does."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        setup.bus.command_hinges(goal)
        time.sleep(0.01)


# -- start-up ------------------------------------------------------------------------------------------


def test_connect_brings_factory_servos_to_the_rig_s_settings(tmp_path: Path) -> None:
    with servos(tmp_path, profile_velocity_rad_s=2.0, profile_acceleration_rad_s2=9.0) as setup:
        assert setup.virtual.register(1, "return_delay_time") == 250
        setup.virtual.set_register(2, "drive_mode", 9)
        setup.virtual.set_register(2, "secondary_id", 1)
        setup.bus.connect()
        for i in range(1, N + 1):
            found = {name: setup.virtual.register(i, name) for name in ("return_delay_time", "drive_mode")}
            assert found == {"return_delay_time": 0, "drive_mode": 0}
            assert setup.virtual.register(i, "secondary_id") == 255
            assert setup.virtual.register(i, "operating_mode") == 3
            assert setup.virtual.register(i, "max_position_limit") == 2048 + round(3.1 * 4096 / (2 * np.pi))
            assert setup.virtual.register(i, "profile_velocity") * 0.229 * 2 * np.pi / 60 == pytest.approx(
                2, rel=0.02
            )
            acceleration = setup.virtual.register(i, "profile_acceleration") * 214.577 * 2 * np.pi / 3600
            assert acceleration == pytest.approx(9, rel=0.05)
            assert not setup.virtual.register(i, "torque_enable")


def test_nothing_in_the_eeprom_is_written_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written: set[tuple[int, str, int]] = set()
    write = ServoLine.write

    def noting(line: ServoLine, servo_id: int, register: Register, value: int) -> None:
        if register.eeprom:
            written.add((servo_id, register.name, value))
        write(line, servo_id, register, value)

    monkeypatch.setattr(ServoLine, "write", noting)
    with servos(tmp_path) as setup:
        setup.bus.connect()
        setup.bus.close()
        assert len(written) >= N
        written.clear()
        setup.bus.connect()
        assert not written
        setup.virtual.set_register(1, "return_delay_time", 7)
        setup.bus.close()
        setup.bus.connect()
        assert written == {(1, "return_delay_time", 0)}


def test_wrong_model_old_firmware_and_missing_servos_are_named(tmp_path: Path) -> None:
    with servos(tmp_path, servo={"firmware": 36}) as setup:
        with pytest.raises(CommandRefused, match=r"servo_c1 \(id 1\) has firmware 36"):
            setup.bus.connect()
        setup.again(watchdog_s=0.0).connect()
    with servos(tmp_path, servo={"model": "XM430-W210"}) as setup, pytest.raises(CommandRefused, match="XM430-W210"):
        setup.bus.connect()
    with servos(tmp_path) as setup:
        setup.virtual.mute(2)
        setup.virtual.mute(20)
        with pytest.raises(BusTimeout, match=r"servo_c2 \(id 2\), pin \(id 20\)"):
            setup.bus.connect()
        assert not setup.bus.connected


def test_settings_that_torque_locks_are_not_forced(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        goal = hold(setup)
        setup.virtual.set_register(1, "return_delay_time", 100)
        second = setup.again()
        setup.bus.close()
        with pytest.raises(CommandRefused, match=r"servo_c1.*torque is on and return_delay_time is 100"):
            second.connect()
        np.testing.assert_allclose([setup.virtual.truth()[i].shaft_rad for i in (1, 2, 3)], goal, atol=0.01)


def test_a_servo_that_takes_torque_by_itself_is_not_driven(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        setup.virtual.set_register(2, "startup_configuration", 1)
        with pytest.raises(CommandRefused, match=r"servo_c2 .*startup_configuration is 1"):
            setup.bus.connect()


def test_a_lost_and_a_spoilt_answer_do_not_end_the_start(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        for i in (1, 2, 3):
            setup.virtual.drop(i, 1)
        setup.virtual.corrupt(20, 1)
        setup.bus.connect()
        assert setup.bus.read_hinges().valid.all()


def test_a_rate_that_the_bus_as_found_cannot_carry_is_refused(tmp_path: Path) -> None:
    """Old firmware has no fast sync read, which the rig counted on."""
    rate = {"rate_hz": 190.0}
    with servos(tmp_path, baud=1_000_000, rig=rate, servo={"firmware": 48}) as setup:
        setup.bus.connect()
    with (
        servos(tmp_path, baud=1_000_000, rig=rate, servo={"firmware": 41}) as setup,
        pytest.raises(RigError, match="the longest cycle takes"),
    ):
        setup.bus.connect()


def test_latency_timers_are_looked_up_and_long_ones_get_advice(tmp_path: Path) -> None:
    device = tmp_path / "dev" / "ttyUSB7"
    device.parent.mkdir()
    device.touch()
    link = tmp_path / "dev" / "wing"
    link.symlink_to(device)
    timer = tmp_path / "sys" / "ttyUSB7" / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text("16\n")
    assert latency_timer_s(str(link), tmp_path / "sys") == pytest.approx(0.016)
    advice = latency_advice(str(link), tmp_path / "sys")
    assert advice is not None
    for word in ("16 ms", "limit: 1 ms", "remedy", str(timer)):
        assert word in advice
    timer.write_text("1\n")
    assert latency_advice(str(link), tmp_path / "sys") is None
    assert latency_timer_s("/dev/null", tmp_path / "sys") is None


# -- no jump, ever -------------------------------------------------------------------------------------


@pytest.mark.parametrize("stale_rad", [1.5, -1.5])
def test_a_stale_goal_in_the_servo_never_moves_it(tmp_path: Path, stale_rad: float) -> None:
    with servos(tmp_path) as setup:
        setup.bus.connect()
        before = [setup.virtual.truth()[i].shaft_rad for i in (1, 2, 3)]
        for i in (1, 2, 3):
            setup.virtual.set_register(i, "goal_position", 2048 + round(stale_rad * 4096 / (2 * np.pi)))
        setup.bus.enable_torque()
        time.sleep(0.3)
        after = setup.virtual.truth()
        np.testing.assert_allclose([after[i].shaft_rad for i in (1, 2, 3)], before, atol=0.01)
        assert max(abs(after[i].velocity_rad_s) for i in (1, 2, 3)) < 0.1


def test_a_shaft_that_was_turned_since_it_was_read_gets_no_torque(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        setup.bus.connect()
        readings = setup.bus.read_hinges()
        setup.virtual.push(3, 0.2)
        with pytest.raises(CommandRefused, match=r"servo_c3 turned by 0\.\d+ rad while torque went on"):
            setup.bus.enable_torque(readings)
        assert not any(servo.torque_on for servo in setup.virtual.truth().values())


def test_torque_stays_off_everywhere_when_one_servo_refuses_it(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        setup.bus.connect()
        setup.virtual.overload(3)
        with pytest.raises(ActuatorFault, match=r"servo_c3.*OVERLOAD"):
            setup.bus.enable_torque()
        assert not any(servo.torque_on for servo in setup.virtual.truth().values())


@pytest.mark.slow
def test_goals_arrive_in_extended_and_in_current_based_position_mode(tmp_path: Path) -> None:
    for mode, number in (("extended_position", 4), ("current_based_position", 5)):
        more = {"current_limit_a": 1.0} if number == 5 else {}
        with servos(tmp_path, operating_mode=mode, watchdog_s=0.0, **more) as setup:
            setup.bus.connect()
            if setup.bus.unvouched():
                setup.bus.vouch(setup.bus.read_hinges().position_rad, np.full(N, 0.01))
            goal = setup.bus.enable_torque() + STEP
            setup.bus.command_hinges(goal)
            time.sleep(0.5)
            assert setup.virtual.register(1, "operating_mode") == number
            np.testing.assert_allclose(setup.bus.read_hinges().position_rad, goal, atol=0.01)


@pytest.mark.slow
def test_a_current_limit_makes_a_blocked_servo_give_way(tmp_path: Path) -> None:
    currents = {}
    for limit in (None, 0.5):
        mode = {} if limit is None else {"operating_mode": "current_based_position", "current_limit_a": limit}
        with servos(tmp_path, watchdog_s=0.0, **mode) as setup:
            goal = hold(setup) + STEP
            setup.virtual.jam(1)
            setup.bus.command_hinges(goal)
            time.sleep(0.3)
            currents[limit] = setup.bus.read_hinges().current_a[0]
    assert currents[None] > 2.0
    assert currents[0.5] == pytest.approx(0.5, rel=0.2)


# -- watchdog ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_silence_stops_every_servo_and_is_a_typed_fault_that_clearing_ends(tmp_path: Path) -> None:
    slow = {"profile_velocity_rad_s": 0.5}
    with servos(tmp_path, watchdog_s=0.3, **slow) as setup:
        goal = hold(setup) + 2.0 * STEP
        stream(setup, goal, 0.1)
        silent = time.monotonic()
        time.sleep(0.7)
        truth = setup.virtual.truth()
        for i in range(1, N + 1):
            assert truth[i].frozen
            assert truth[i].moved_s < silent + 0.34
            assert truth[i].torque_on
        with pytest.raises(WatchdogTripped, match=r"servo_c1.*0.3 s"):
            setup.bus.read_health()
        stood = setup.bus.read_hinges().position_rad
        assert (np.abs(stood - goal) > 0.05).all()
        setup.bus.reset_errors()
        time.sleep(0.2)
        np.testing.assert_allclose(setup.bus.read_hinges().position_rad, stood, atol=0.005)
        stream(setup, setup.bus.enable_torque() + 0.5 * STEP, 1.0)
        np.testing.assert_allclose(setup.bus.read_hinges().position_rad, stood + 0.5 * STEP, atol=0.02)


def test_closing_leaves_servos_holding_without_a_watchdog(tmp_path: Path) -> None:
    with servos(tmp_path, watchdog_s=0.08) as setup:
        goal = hold(setup)
        stream(setup, goal, 0.1)
        assert setup.virtual.register(1, "bus_watchdog") == 4
        setup.bus.close()
        time.sleep(0.3)
        for i in (1, 2, 3, 20):
            assert setup.virtual.register(i, "bus_watchdog") == 0
        assert all(setup.virtual.truth()[i].torque_on for i in (1, 2, 3))


@pytest.mark.slow
def test_a_host_that_comes_back_does_not_let_stopped_servos_go_on(tmp_path: Path) -> None:
    """Their goal is still where the dead host wanted them; clearing the watchdog must not send them there."""
    with servos(tmp_path, watchdog_s=0.08, profile_velocity_rad_s=0.5) as setup:
        goal = hold(setup) + 2.0 * STEP
        stream(setup, goal, 0.1)
        time.sleep(0.4)
        truth = setup.virtual.truth()
        assert all(truth[i].frozen for i in (1, 2, 3))
        stood = [truth[i].shaft_rad for i in (1, 2, 3)]
        setup.bus.close()  # as it is when the host gives up
        time.sleep(0.2)
        assert all(setup.virtual.truth()[i].frozen for i in (1, 2, 3))
        second = setup.again()
        second.connect()
        time.sleep(0.3)
        truth = setup.virtual.truth()
        np.testing.assert_allclose([truth[i].shaft_rad for i in (1, 2, 3)], stood, atol=0.01)
        np.testing.assert_allclose([truth[i].goal_rad for i in (1, 2, 3)], stood, atol=0.01)
        second.close()


def test_one_silent_servo_does_not_keep_the_others_from_going_limp(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        hold(setup)
        setup.virtual.mute(1)
        with pytest.raises(BusTimeout, match="servo_c1 did not say that torque is off"):
            setup.bus.disable_torque()
        assert not any(setup.virtual.truth()[i].torque_on for i in (1, 2, 3))


# -- turns ---------------------------------------------------------------------------------------------


def test_servos_of_several_turns_get_no_torque_before_somebody_vouches_for_them(tmp_path: Path) -> None:
    with servos(tmp_path, turns=True, start_fold=0.8) as setup:
        setup.bus.connect()
        true = np.array([setup.virtual.truth()[i].shaft_rad for i in (1, 2, 3)])
        assert (np.abs(true) > np.pi).any()
        assert setup.bus.unvouched() == ("servo_c1", "servo_c2", "servo_c3")
        with pytest.raises(CommandRefused, match=r"restarted.*--stands"):
            setup.bus.enable_torque()
        with pytest.raises(CommandRefused, match="is not where the structure is said to stand"):
            setup.bus.vouch(true + 1.0, np.full(N, 0.1))
        assert setup.bus.unvouched()
        setup.bus.vouch(true + 0.05, np.full(N, 0.1))
        np.testing.assert_allclose(setup.bus.read_hinges().position_rad, true, atol=0.002)
        np.testing.assert_allclose(setup.bus.enable_torque(), true, atol=0.002)
        time.sleep(0.2)
        np.testing.assert_allclose([setup.virtual.truth()[i].shaft_rad for i in (1, 2, 3)], true, atol=0.01)


def test_the_word_outlives_the_host_and_not_a_restart(tmp_path: Path) -> None:
    with servos(tmp_path, turns=True, start_fold=0.8) as setup:
        setup.bus.connect()
        true = np.array([setup.virtual.truth()[i].shaft_rad for i in (1, 2, 3)])
        setup.bus.vouch(true, np.full(N, 0.1))
        setup.bus.close()
        second = setup.again()
        second.connect()
        assert not second.unvouched()
        np.testing.assert_allclose(second.read_hinges().position_rad, true, atol=0.002)
        setup.virtual.reboot(2)
        time.sleep(0.4)
        assert second.unvouched() == ("servo_c2",)
        second.close()


def test_a_restart_on_the_way_is_a_typed_fault_that_names_the_servo(tmp_path: Path) -> None:
    with servos(tmp_path, turns=True, start_fold=0.8) as setup:
        setup.bus.connect()
        setup.bus.vouch(np.array([setup.virtual.truth()[i].shaft_rad for i in (1, 2, 3)]), np.full(N, 0.1))
        setup.bus.enable_torque()
        setup.bus.read_hinges()
        offset = setup.virtual.register(3, "homing_offset")
        assert offset % 4096 == 0
        # What it forgot are the turns since it was switched on; here as if it had made two.
        setup.virtual.set_register(3, "homing_offset", offset + 2 * 4096)
        with pytest.raises(ActuatorRestarted, match=r"servo_c3.*2.00 turns"):
            setup.bus.read_hinges()


def test_within_one_turn_a_restart_loses_torque_and_nothing_else(tmp_path: Path) -> None:
    with servos(tmp_path, watchdog_s=0.0) as setup:
        goal = hold(setup)
        setup.virtual.reboot(2)
        time.sleep(0.4)
        np.testing.assert_allclose(setup.bus.read_hinges().position_rad, goal, atol=0.02)
        assert setup.virtual.register(2, "torque_enable") == 0
        with pytest.raises(ActuatorRestarted, match="servo_c2"):
            setup.bus.read_health()
        with pytest.raises(CommandRefused, match=r"servo_c2 restarted.*connect again"):
            setup.bus.enable_torque()
        setup.bus.reset_errors()
        assert setup.bus.read_health().torque_on.tolist() == [True, False, True]
        setup.bus.enable_torque()
        assert setup.bus.read_health().torque_on.all()


# -- health, errors, latches ---------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("model", ["XL330-M288", "XL430-W250", "XC430-W150", "XM430-W350", "XH540-W150"])
def test_every_model_is_read_in_the_same_units(tmp_path: Path, model: str) -> None:
    rig = {"controller": {"min_voltage_v": 3.0}}
    with servos(tmp_path, model=model, rig=rig, watchdog_s=0.0) as setup:
        goal = hold(setup) + STEP
        setup.bus.command_hinges(goal)
        time.sleep(0.05)
        moving = setup.bus.read_hinges()
        truth = setup.virtual.truth()
        assert np.sign(moving.velocity_rad_s).tolist() == np.sign(STEP).tolist()
        time.sleep(0.5)
        still = setup.bus.read_hinges()
        np.testing.assert_allclose(still.position_rad, goal, atol=0.01)
        np.testing.assert_allclose(still.velocity_rad_s, 0.0, atol=0.05)
        truth = setup.virtual.truth()
        np.testing.assert_allclose(still.current_a, [truth[i].current_a for i in (1, 2, 3)], atol=0.08)
        health = setup.bus.read_health()
        assert health.sound.all()
        np.testing.assert_allclose(health.temperature_c, [truth[i].temperature_c for i in (1, 2, 3)], atol=1.0)
        assert (np.abs(health.voltage_v / {"XL330-M288": 5.0, "XL430-W250": 11.1}.get(model, 12.0) - 1) < 0.05).all()


@pytest.mark.parametrize("firmware", [46, 52, 53])
def test_registers_that_a_later_firmware_moved_are_found(tmp_path: Path, firmware: int) -> None:
    """XL330: indirect data begin at 208, from firmware 53 on at 224."""
    rig = {"controller": {"min_voltage_v": 3.0}}
    with servos(tmp_path, model="XL330-M288", rig=rig, servo={"firmware": firmware}) as setup:
        setup.bus.connect()
        health = setup.bus.read_health()
        assert health.sound.all()
        np.testing.assert_allclose(health.voltage_v, 5.0, atol=0.2)
        setup.bus.enable_torque()
        assert setup.bus.read_health().torque_on.all()


def test_health_registers_spread_over_the_table_come_in_one_read(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        setup.bus.connect()
        before = setup.virtual.account().reads
        setup.bus.read_health()
        assert setup.virtual.account().reads == before + 1


@pytest.mark.slow
def test_an_overheated_servo_is_not_reset_before_it_has_cooled(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        setup.bus.connect()
        setup.virtual.heat(1, 95.0)
        time.sleep(0.1)
        assert setup.bus.read_hinges().alert[0]
        with pytest.raises(CommandRefused, match="servo_c1 is still too hot: 95 °C; limit: 80 °C"):
            setup.bus.reset_errors()
        setup.virtual.heat(1, 40.0)
        setup.bus.reset_errors()
        assert not setup.bus.read_health().hardware_error.any()


@pytest.mark.slow
def test_a_pin_goes_home_only_when_its_hinges_are_there(tmp_path: Path) -> None:
    for fold, closed in ((0.5, False), (1.0, True)):
        with servos(tmp_path, start_fold=fold, watchdog_s=0.0) as setup:
            setup.bus.connect()
            assert not setup.bus.read_latches()[0].engaged
            setup.bus.engage("pin")
            time.sleep(0.6)
            reading = setup.bus.read_latches()[0]
            assert (reading.id, reading.engaged, reading.confirmed, reading.valid) == ("pin", True, closed, True)
            setup.bus.release("pin")
            time.sleep(0.6)
            reading = setup.bus.read_latches()[0]
            assert (reading.engaged, reading.confirmed) == (False, False)


def test_a_pin_that_holds_is_known_to_the_next_host(tmp_path: Path) -> None:
    with servos(tmp_path, start_fold=1.0, watchdog_s=0.0) as setup:
        setup.bus.connect()
        setup.bus.engage("pin")
        time.sleep(0.5)
        setup.bus.close()
        second = setup.again()
        second.connect()
        assert second.read_latches()[0].engaged
        assert second.read_latches()[0].confirmed
        second.close()


@pytest.mark.slow
def test_a_magnet_is_what_its_hinges_measure(tmp_path: Path) -> None:
    """The magnet is on cell c1 alone: the others do not matter to it."""
    with servos(tmp_path, start_fold=1.0, watchdog_s=0.0) as setup:
        goal = hold(setup)
        magnet = setup.bus.latch_ids.index("latch_cell:c1")
        assert setup.bus.read_latches()[magnet].confirmed
        setup.bus.command_hinges(goal + np.array([0.0, 0.3, 0.3]))
        time.sleep(0.3)
        assert setup.bus.read_latches()[magnet].confirmed
        setup.bus.command_hinges(goal + np.array([0.3, 0.0, 0.0]))
        time.sleep(0.3)
        assert setup.bus.read_latches()[magnet].confirmed is False
        setup.virtual.mute(1)
        time.sleep(0.02)  # what was read in this cycle is still good
        reading = setup.bus.read_latches()[magnet]
        assert (reading.valid, reading.confirmed) == (False, None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (lambda bus: bus.set_register(20, "torque_enable", 0), "no torque"),
        (lambda bus: bus.reboot(20), "restarted"),
        (lambda bus: bus.overload(20), "OVERLOAD"),
    ],
    ids=["limp", "restarted", "overload"],
)
def test_a_pin_that_nobody_holds_is_not_confirmed_and_clearing_mends_it(
    tmp_path: Path, harm: Callable[[VirtualBus], None], words: str
) -> None:
    """It still stands in its hole; that it stays there nobody can say."""
    with servos(tmp_path, start_fold=1.0, watchdog_s=0.0) as setup:
        setup.bus.connect()
        speed = setup.virtual.register(20, "profile_velocity")
        assert speed > 0
        setup.bus.engage("pin")
        time.sleep(0.5)
        assert setup.bus.read_latches()[0].confirmed
        harm(setup.virtual)
        time.sleep(0.5)
        reading = setup.bus.read_latches()[0]
        assert (reading.valid, reading.confirmed) == (True, None)
        assert reading.fault is not None
        assert words in reading.fault
        setup.bus.reset_errors()
        assert setup.virtual.register(20, "profile_velocity") == speed
        setup.bus.engage("pin")
        time.sleep(0.5)
        reading = setup.bus.read_latches()[0]
        assert (reading.confirmed, reading.fault) == (True, None)


def test_a_pin_that_was_stopped_stays_so_when_the_bus_is_let_go_of(tmp_path: Path) -> None:
    with servos(tmp_path, start_fold=1.0, watchdog_s=0.08) as setup:
        setup.bus.connect()
        setup.bus.engage("pin")
        time.sleep(0.4)
        stopped = setup.virtual.truth()[20]
        assert stopped.frozen
        assert "heard nothing" in str(setup.bus.read_latches()[0].fault)
        setup.bus.close()
        time.sleep(0.3)
        assert setup.virtual.truth()[20].shaft_rad == pytest.approx(stopped.shaft_rad, abs=0.01)


def test_a_watchdog_that_was_missed_is_set_again_on_the_way(tmp_path: Path) -> None:
    with servos(tmp_path) as setup:
        goal = hold(setup)
        setup.bus.command_hinges(goal)
        setup.bus.read_hinges()  # answered, so what was written before has arrived
        setup.virtual.set_register(2, "bus_watchdog", 0)
        for _ in range(REARM_EVERY):
            setup.bus.command_hinges(goal)
        setup.bus.read_hinges()
        assert setup.virtual.register(2, "bus_watchdog") == 25


def test_a_change_of_mode_takes_the_word_back(tmp_path: Path) -> None:
    with servos(tmp_path, turns=True, start_fold=0.8) as setup:
        setup.bus.connect()
        setup.bus.vouch(np.array([setup.virtual.truth()[i].shaft_rad for i in (1, 2, 3)]), np.full(N, 0.1))
        setup.bus.close()
        setup.virtual.set_register(2, "operating_mode", 3)
        second = setup.again()
        second.connect()
        assert second.unvouched() == ("servo_c2",)
        second.close()


def test_no_tolerance_is_so_wide_that_any_place_within_a_turn_will_do(tmp_path: Path) -> None:
    """With a gear of 100, 0.05 rad of crease is almost a turn of the shaft."""
    with servos(tmp_path, turns=True, start_fold=0.8) as setup:
        setup.bus.connect()
        true = np.array([setup.virtual.truth()[i].shaft_rad for i in (1, 2, 3)])
        with pytest.raises(CommandRefused, match=r"limit: 1\.571 rad"):
            setup.bus.vouch(true + 2.5, np.full(N, 5.0))
