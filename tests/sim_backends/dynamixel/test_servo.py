"""One servo's control table: what may be written when, indirect addresses, watchdog, errors, turns."""

from __future__ import annotations

from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.wire.dynamixel import MODELS, Register
from sim_backends.dynamixel.motors import STEP_S
from sim_backends.dynamixel.servo import BOOT_S
from sim_backends.dynamixel.spec import ServoSpec
from tests.sim_backends.dynamixel.test_packets import few, fixed
from tests.sim_backends.dynamixel.wire import BROADCAST, CLEAR_TURNS, XM, Host, word

FAILED, RANGE, LENGTH, LIMIT, ACCESS, ALERT = 1, 4, 5, 6, 7, 0x80
POSITION_MODE, EXTENDED, CURRENT_POSITION = 3, 4, 5
TURN = 2.0 * pi
NAMES = [model.name for model in MODELS]
GOALS = {"goal_pwm": 1, "goal_current": 1, "goal_velocity": 1, "goal_position": 2000}


def one(**spec: object) -> Host:
    return Host(ServoSpec(id=1, **{"load_nm": 0.0, **spec}))  # type: ignore[arg-type]


def holding(**spec: object) -> Host:
    """Torque on, in extended position mode."""
    host = one(**spec)
    host.write_all(1, operating_mode=EXTENDED, torque_enable=1)
    return host


def write_raw(host: Host, address: int, data: bytes) -> int:
    (got,) = host.do(1, 3, word(address) + data)
    return got.error


def read_raw(host: Host, address: int, size: int) -> bytes:
    (got,) = host.do(1, 2, word(address) + word(size))
    assert got.error & 0x7F == 0
    return got.data


# -- what may be written -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_every_register_starts_at_its_default_and_keeps_its_bounds(name: str) -> None:
    host = one(model=name)
    table = host.model(1).table
    measured = {"present", "realtime", "moving", "firmware", "id", "baud", "goal"}
    for register in table:
        if register.name.split("_")[0] not in measured and not register.name.endswith("_trajectory"):
            assert host.read(1, register.name) == register.default, register.name
        if not register.writable:
            assert write_raw(host, register.address, bytes(register.size)) == ACCESS, register.name
        elif register.maximum is not None and register.name != "operating_mode":
            for value in (register.maximum + 1, (register.minimum or 0) - 1):
                if _fits(register, value):
                    assert host.write(1, register.name, value) == RANGE, register.name


def _fits(register: Register, value: int) -> bool:
    bits = 8 * register.size
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if register.signed else (0, (1 << bits) - 1)
    return low <= value <= high


@pytest.mark.parametrize("name", NAMES)
def test_torque_locks_the_eeprom_and_nothing_else(name: str) -> None:
    host = one(model=name)
    host.write(1, "torque_enable", 1)
    for register in host.model(1).table:
        if register.writable and register.name != "torque_enable":
            value = host.read(1, register.name)
            assert host.write(1, register.name, value) == (ACCESS if register.eeprom else 0), register.name
    host.write(1, "torque_enable", 0)
    assert host.write(1, "homing_offset", 5) == 0


def test_only_the_modes_of_a_model_can_be_set() -> None:
    for model in MODELS:
        host = one(model=model.name)
        taken = {mode for mode in range(17) if host.write(1, "operating_mode", mode) == 0}
        assert taken == set(model.modes)


def test_parts_of_registers_are_a_length_error_and_gaps_an_access_error() -> None:
    host = one()
    assert write_raw(host, 116, b"\0\0") == LENGTH
    assert write_raw(host, 118, b"\0\0") == LENGTH
    assert write_raw(host, 14, b"\0") == ACCESS
    assert write_raw(host, 661, b"\0\0") == ACCESS
    assert [one.error for one in host.do(1, 2, word(661) + word(2))] == [ACCESS]
    assert read_raw(host, 14, 6) == bytes(6)


def test_a_write_over_several_registers_is_done_whole_or_not_at_all() -> None:
    host = one()
    acceleration, velocity = 5, 6
    data = acceleration.to_bytes(4, "little") + velocity.to_bytes(4, "little")
    assert write_raw(host, 108, data + (9999).to_bytes(4, "little")) == LIMIT
    assert read_raw(host, 108, 8) == bytes(8)
    assert write_raw(host, 108, data + (2000).to_bytes(4, "little")) == 0
    assert [host.read(1, name) for name in ("profile_acceleration", "profile_velocity", "goal_position")] == [
        5,
        6,
        2000,
    ]
    assert write_raw(host, 108, data[:6]) == LENGTH


@pytest.mark.parametrize(
    ("goal", "limit", "bound"),
    [("goal_pwm", "pwm_limit", 300), ("goal_current", "current_limit", 200), ("goal_velocity", "velocity_limit", 50)],
)
def test_goals_keep_the_limits_that_are_set(goal: str, limit: str, bound: int) -> None:
    host = one()
    host.write(1, limit, bound)
    assert [host.write(1, goal, value) for value in (bound, -bound)] == [0, 0]
    assert [host.write(1, goal, value) for value in (bound + 1, -bound - 1)] == [LIMIT, LIMIT]


def test_position_goals_keep_the_position_limits_in_position_mode_alone() -> None:
    host = one()
    host.write_all(1, min_position_limit=1000, max_position_limit=3000)
    assert [host.write(1, "goal_position", value) for value in (999, 1000, 3000, 3001)] == [LIMIT, 0, 0, LIMIT]
    for mode in (EXTENDED, CURRENT_POSITION):
        host.write(1, "operating_mode", mode)
        far = 1_048_575
        assert [host.write(1, "goal_position", value) for value in (-far, far, far + 1, -far - 1)] == [
            0,
            0,
            RANGE,
            RANGE,
        ]


def test_the_operating_mode_resets_the_goals() -> None:
    host = one(start_rad=0.3)
    host.write_all(1, pwm_limit=500, current_limit=400)
    host.write_all(1, goal_pwm=10, goal_current=20, goal_velocity=30, goal_position=1000)
    host.write(1, "operating_mode", CURRENT_POSITION)
    present = host.read(1, "present_position")
    assert [host.read(1, name) for name in GOALS] == [500, 400, 0, present]


# -- indirect addresses ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_pointers_point_at_their_own_data_until_they_are_set(name: str) -> None:
    host = one(model=name)
    table = host.model(1).table
    for block in filter(None, (table.indirect, table.more_indirect)):
        pointers = read_raw(host, block.first_address, 2 * block.count)
        assert [int.from_bytes(pointers[k : k + 2], "little") for k in range(0, len(pointers), 2)] == list(
            range(block.first_data, block.first_data + block.count)
        )
        fill = bytes(range(1, block.count + 1))
        assert write_raw(host, block.first_data, fill) == 0
        assert read_raw(host, block.first_data, block.count) == fill


SHOWN = (
    "led",
    "profile_velocity",
    "goal_position",
    "present_position",
    "present_temperature",
    "present_input_voltage",
)


@fixed
@given(st.permutations(SHOWN), st.integers(1, 5), st.booleans(), st.sampled_from(("XM430-W350", "XL330-M288")))
def test_indirect_data_shows_what_it_points_at(names: list[str], count: int, more: bool, model: str) -> None:
    host = one(model=model, start_rad=0.7)
    host.write_all(1, led=1, profile_velocity=0x01020304 % 30_000, goal_position=1234)
    table = host.model(1).table
    block = table.more_indirect if more and table.more_indirect else table.indirect
    registers = [table.named(name) for name in names[:count]]
    addresses = [a for register in registers for a in range(register.address, register.end)]
    for k, address in enumerate(addresses):
        assert write_raw(host, block.first_address + 2 * k, word(address)) == 0
    expected = b"".join(read_raw(host, register.address, register.size) for register in registers)
    assert read_raw(host, block.first_data, len(addresses)) == expected


def test_writes_through_indirect_data_follow_the_rules_of_what_they_reach() -> None:
    host = one()
    for k, address in enumerate((65, 116, 117, 118, 119, 122)):
        write_raw(host, 168 + 2 * k, word(address))
    assert write_raw(host, 224, b"\x01" + (1024).to_bytes(4, "little")) == 0
    assert (host.read(1, "led"), host.read(1, "goal_position")) == (1, 1024)
    assert write_raw(host, 224, b"\x02") == RANGE
    assert write_raw(host, 225, b"\0\0") == LENGTH
    assert write_raw(host, 225, (5000).to_bytes(4, "little")) == LIMIT
    assert write_raw(host, 229, b"\x01") == ACCESS
    assert write_raw(host, 224, b"\0" + (5000).to_bytes(4, "little")) == LIMIT
    assert (host.read(1, "led"), host.read(1, "goal_position")) == (1, 1024)
    assert write_raw(host, 168, word(63)) == RANGE  # the EEPROM cannot be pointed at
    assert write_raw(host, 168, word(662)) == RANGE


def test_a_refused_write_leaves_plain_indirect_data_alone_too() -> None:
    host = one()
    write_raw(host, 170, word(122))  # the second byte is read-only
    assert write_raw(host, 224, b"\x01\x01") == ACCESS
    assert read_raw(host, 224, 1) == b"\0"


def test_a_restart_forgets_pointers_and_plain_indirect_data() -> None:
    host = one()
    write_raw(host, 168, word(65))
    write_raw(host, 225, b"\x07")
    host.do(1, 8)
    host.wait(2 * BOOT_S)
    assert read_raw(host, 168, 2) == word(224)
    assert read_raw(host, 225, 1) == b"\0"


# -- watchdog ----------------------------------------------------------------------------------------


@few
@given(st.integers(1, 40), st.floats(0.0, 0.3), st.floats(1e-6, 0.3))
def test_the_watchdog_trips_at_its_time_and_stops_the_shaft_there(
    units: int, before_s: float, after_s: float
) -> None:
    host = holding()
    host.write_all(1, profile_velocity=8, goal_position=1_000_000)
    host.wait(before_s)
    host.write(1, "bus_watchdog", units)
    start, servo = host.now, host.servo(1)
    host.bus.advance(start + 0.02 * units - 1e-6)
    assert servo.named("bus_watchdog") == units
    host.bus.advance(start + 0.02 * units + after_s)
    assert servo.named("bus_watchdog") == -1
    run_rad = 8 * 0.229 * TURN / 60.0 * (start + 0.02 * units)
    stopped = float(host.bus.motors.shaft_rad[0])
    slack = 8 * 0.229 * TURN / 60.0 * (2 * STEP_S + 0.02)  # a grid step at either end, and the time constant
    assert abs(stopped - run_rad) <= slack
    host.bus.advance(start + 0.02 * units + after_s + 0.5)
    assert float(host.bus.motors.shaft_rad[0]) - stopped <= slack


def test_any_instruction_it_hears_feeds_the_watchdog_a_broadcast_too() -> None:
    host = Host(ServoSpec(id=1), ServoSpec(id=2))
    for k in (1, 2):
        host.write_all(k, torque_enable=1, bus_watchdog=5)
    for _ in range(4):
        host.wait(0.09)
        host.do(BROADCAST, 0x83, word(65) + word(1) + b"\x63\x01")
    assert [host.servo(k).named("bus_watchdog") for k in (1, 2)] == [5, 5]
    for _ in range(2):
        host.wait(0.09)
        host.do(1, 1)
    assert [host.servo(k).named("bus_watchdog") for k in (1, 2)] == [5, -1]


def test_a_tripped_watchdog_refuses_goals_until_it_is_set_to_0() -> None:
    host = holding()
    host.write_all(1, goal_position=100_000, bus_watchdog=1)
    host.wait(0.5)
    assert [host.write(1, name, value) for name, value in GOALS.items()] == [RANGE] * 4
    assert host.write(1, "bus_watchdog", 5) == RANGE
    assert host.write(1, "led", 1) == host.write(1, "profile_velocity", 0) == 0
    stood = host.read(1, "present_position")
    assert host.write(1, "bus_watchdog", 0) == 0
    host.wait(0.5)
    assert host.read(1, "present_position") > stood + 100  # the old goal counts again: the worst that can be
    assert host.write(1, "goal_position", stood - 500) == 0
    host.wait(3.0)
    assert host.read(1, "present_position") == pytest.approx(stood - 500, abs=1)


@pytest.mark.parametrize(
    ("firmware", "torque", "units", "trips"),
    [(37, 1, 1, False), (38, 1, 1, True), (48, 0, 1, False), (48, 1, 0, False)],
)
def test_the_watchdog_needs_firmware_torque_and_a_time(firmware: int, torque: int, units: int, trips: bool) -> None:
    host = one(firmware=firmware)
    host.write_all(1, torque_enable=torque, bus_watchdog=units)
    host.wait(3.0)
    assert (host.read(1, "bus_watchdog") == -1) == trips


def test_a_watchdog_set_before_anybody_spoke_harms_nothing() -> None:
    host = one()
    servo = host.servo(1)
    servo.put(servo.table.torque_enable, 1)
    servo.put(servo.table.bus_watchdog, 1)
    host.wait(0.1)
    assert host.read(1, "bus_watchdog") == -1


# -- hardware errors ---------------------------------------------------------------------------------


def stalled(**spec: object) -> Host:
    """Told to go where a stop does not let it."""
    host = holding(**{"upper_stop_rad": 0.5, **spec})
    host.write(1, "goal_position", 4000)
    return host


def test_a_stalled_servo_is_overloaded_after_a_second_and_lets_go() -> None:
    host = stalled()
    host.wait(0.9)
    assert host.read(1, "hardware_error_status") == 0
    host.wait(1.0)
    assert host.read(1, "hardware_error_status") == 0x20
    assert host.read(1, "torque_enable") == 0
    assert not host.bus.motors.torque_on[0]


def test_a_current_limit_keeps_a_stalled_servo_from_overload() -> None:
    host = one(upper_stop_rad=0.5)
    host.write_all(1, operating_mode=CURRENT_POSITION, goal_current=300, torque_enable=1, goal_position=4000)
    host.wait(5.0)
    assert host.read(1, "hardware_error_status") == 0
    assert host.read(1, "torque_enable") == 1
    assert host.read(1, "present_current") == pytest.approx(300, abs=15)


@pytest.mark.parametrize("bits", [0x01, 0x04, 0x20, 0x24])
@pytest.mark.parametrize("mask", [0x00, 0x04, 0x34])
def test_errors_within_the_shutdown_mask_take_the_torque_until_a_reboot(bits: int, mask: int) -> None:
    host = one()
    host.write_all(1, shutdown=mask, torque_enable=1)
    host.servo(1).fail(bits)
    assert host.do(1, 1)[0].error == ALERT
    assert host.read(1, "hardware_error_status") == bits
    off = bool(bits & mask)
    assert host.read(1, "torque_enable") == (not off)
    assert host.write(1, "torque_enable", 0) == ALERT
    assert host.write(1, "torque_enable", 1) == ALERT | (FAILED if off else 0)
    assert bool(host.bus.motors.torque_on[0]) == (not off)
    host.do(1, 8)
    host.wait(2 * BOOT_S)
    assert host.do(1, 1)[0].error == 0
    assert host.write(1, "torque_enable", 1) == 0


def test_torque_that_is_refused_takes_its_whole_write_along() -> None:
    host = one()
    host.servo(1).fail(0x20)
    for k, address in enumerate((65, 64)):
        write_raw(host, 168 + 2 * k, word(address))
    assert write_raw(host, 224, b"\1\1") == ALERT | FAILED
    assert host.read(1, "led") == 0


def test_every_kind_of_answer_carries_the_alert_bit() -> None:
    host = one()
    host.servo(1).fail(0x20)
    assert host.write(1, "led", 1) == ALERT
    assert host.write(1, "led", 2) == ALERT | RANGE
    assert host.do(1, 2, word(64) + word(1))[0].error == ALERT
    assert host.sync_read(64, 1, [1])[0].error == ALERT
    spoilt = host.say(b"\xff\xff\xfd\x00\x01\x03\x00\x01\x00\x00")
    assert spoilt[8] == ALERT | 3


def test_heat_beyond_the_limit_is_an_error_and_shows_in_degrees() -> None:
    host = one()
    host.write(1, "torque_enable", 1)
    limit = host.read(1, "temperature_limit")
    host.bus.motors.temperature_c[0] = limit - 1
    host.wait(0.1)
    assert host.read(1, "present_temperature") == limit - 1
    assert host.read(1, "hardware_error_status") == 0
    host.bus.motors.temperature_c[0] = limit + 2
    host.wait(0.1)
    assert host.read(1, "hardware_error_status") == 0x04
    assert host.read(1, "torque_enable") == 0


@pytest.mark.parametrize(("volts", "error"), [(9.4, 1), (9.6, 0), (15.9, 0), (16.2, 1)])
def test_a_supply_outside_the_limits_is_an_error(volts: float, error: int) -> None:
    host = Host(ServoSpec(id=1, model=XM), supply_v=volts, supply_ohm=0.0)
    host.wait(0.1)
    assert host.read(1, "present_input_voltage") == round(10 * volts)
    assert host.read(1, "hardware_error_status") == error


# -- turns -------------------------------------------------------------------------------------------


def settled(host: Host, wait_s: float = 8.0) -> int:
    host.wait(wait_s)
    return host.read(1, "present_position")


@pytest.mark.parametrize("goal", [-9000, -1, 4096, 20_000])
def test_goals_may_be_turns_away_and_a_reboot_forgets_the_turns(goal: int) -> None:
    host = holding()
    host.write(1, "goal_position", goal)
    assert settled(host) == goal
    host.do(1, 8)
    host.wait(2 * BOOT_S)
    assert host.read(1, "present_position") == goal % 4096
    assert host.read(1, "operating_mode") == EXTENDED
    before = float(host.bus.motors.shaft_rad[0])
    host.write_all(1, torque_enable=1, goal_position=goal % 4096 + 100)
    host.wait(3.0)
    assert float(host.bus.motors.shaft_rad[0]) - before == pytest.approx(100 * TURN / 4096, abs=2e-3)


@fixed
@given(st.floats(-60.0, 60.0), st.integers(-5000, 5000))
def test_after_power_on_the_position_is_within_one_turn_plus_the_offset(start_rad: float, offset: int) -> None:
    host = one(start_rad=start_rad)
    raw = host.read(1, "present_position")
    assert 0 <= raw < 4096
    assert (raw - 2048 - start_rad * 4096 / TURN + 2048) % 4096 == pytest.approx(2048, abs=0.51)
    host.write(1, "homing_offset", offset)
    assert host.read(1, "present_position") == raw + offset
    host.do(1, 8)
    host.wait(2 * BOOT_S)
    assert host.read(1, "present_position") == raw + offset


@few
@given(st.integers(-3000, 3000), st.integers(-6000, 6000))
def test_goals_count_with_the_homing_offset(offset: int, goal: int) -> None:
    host = one()
    host.write_all(1, homing_offset=offset, operating_mode=EXTENDED, torque_enable=1, goal_position=goal)
    host.wait(4.0)
    assert abs(host.read(1, "present_position") - goal) <= 1
    assert float(host.bus.motors.shaft_rad[0]) == pytest.approx((goal - offset - 2048) * TURN / 4096, abs=3e-3)


def test_position_mode_counts_within_one_turn_once_torque_is_on() -> None:
    host = one(start_rad=3.0)
    host.bus.motors.push(0, 3.0)  # past the end of the turn, by hand
    turned = host.read(1, "present_position")
    assert turned > 4096
    host.write(1, "torque_enable", 1)
    assert host.read(1, "present_position") == turned - 4096
    host.write_all(1, torque_enable=0, operating_mode=EXTENDED)
    host.bus.motors.push(0, -TURN)
    assert host.read(1, "present_position") == turned - 2 * 4096
    host.write(1, "operating_mode", POSITION_MODE)
    assert host.read(1, "present_position") == turned - 4096


def test_clear_takes_the_turns_off_and_nothing_moves() -> None:
    host = holding()
    host.write(1, "goal_position", 9000)
    settled(host)
    before = float(host.bus.motors.shaft_rad[0])
    assert host.do(1, 0x10, CLEAR_TURNS)[0].error == 0
    assert host.read(1, "present_position") == 9000 % 4096
    host.wait(1.0)
    assert float(host.bus.motors.shaft_rad[0]) == pytest.approx(before, abs=2e-3)


def test_clear_is_refused_while_the_shaft_turns() -> None:
    host = holding()
    host.write_all(1, profile_velocity=20, goal_position=50_000)
    host.wait(0.5)
    assert host.read(1, "moving") == 1
    assert host.do(1, 0x10, CLEAR_TURNS)[0].error == FAILED
    host.write(1, "torque_enable", 0)
    host.wait(0.1)
    assert host.read(1, "moving") == 0
    assert host.do(1, 0x10, CLEAR_TURNS)[0].error == 0


def test_a_new_watchdog_or_torque_off_and_on_never_jerks() -> None:
    host = holding(start_rad=0.4)
    host.write(1, "goal_position", 2600)
    settled(host, 3.0)
    host.write(1, "torque_enable", 0)
    host.bus.motors.push(0, 0.3)
    host.write(1, "torque_enable", 1)
    at = float(host.bus.motors.shaft_rad[0])
    host.wait(STEP_S)
    assert abs(float(host.bus.motors.shaft_rad[0]) - at) <= 46 * TURN / 60.0 * STEP_S * 1.01


def test_what_it_measures_it_reports_in_its_units() -> None:
    host = holding(load_nm=0.41)
    host.write_all(1, profile_velocity=50, goal_position=40_000)
    host.wait(1.0)
    assert host.read(1, "present_velocity") == pytest.approx(50, abs=1)
    assert host.read(1, "present_current") > 0
    host.write(1, "goal_position", -40_000)
    host.wait(1.0)
    assert host.read(1, "present_velocity") == pytest.approx(-50, abs=1)
    assert host.read(1, "present_current") < 0
    load = Host(ServoSpec(id=1, model="XL430-W250", load_nm=0.14))
    load.write_all(1, operating_mode=EXTENDED, torque_enable=1, profile_velocity=5, goal_position=40_000)
    load.wait(1.0)
    assert load.read(1, "present_load") == pytest.approx(100, abs=10)  # thousandths of its stall torque


def test_a_new_homing_offset_moves_nothing() -> None:
    host = one(start_rad=0.3)
    at = float(host.bus.motors.shaft_rad[0])
    host.write_all(1, homing_offset=700, torque_enable=1)
    assert host.read(1, "goal_position") == host.read(1, "present_position")
    host.wait(1.0)
    assert float(host.bus.motors.shaft_rad[0]) == pytest.approx(at, abs=1e-3)


def test_a_low_goal_pwm_keeps_a_stalled_servo_from_overload() -> None:
    host = stalled()
    host.write(1, "goal_pwm", 300)
    host.wait(3.0)
    assert host.read(1, "hardware_error_status") == 0
    assert float(host.bus.motors.torque_nm[0]) == pytest.approx(4.1 * 300 / 885, rel=0.01)


def test_only_a_stall_without_a_break_is_an_overload() -> None:
    host = stalled()
    for _ in range(3):
        host.wait(0.8)
        host.write(1, "goal_position", 2048)
        host.wait(0.3)
        host.write(1, "goal_position", 4000)
    assert host.read(1, "hardware_error_status") == 0
