"""Smaller print of the e-manual: fast reads, time slots, changes of mode, what a servo says of its way."""

from __future__ import annotations

import os
import select
import termios
import time
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest

from sim_backends.dynamixel.launcher import VirtualBus
from sim_backends.dynamixel.motors import STEP_S, Motors
from sim_backends.dynamixel.spec import BusSpec, ServoSpec
from tests.sim_backends.dynamixel.wire import BROADCAST, Host, frame, word

PING, READ, WRITE, FACTORY_RESET, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x06, 0x82, 0x83
FAST_SYNC_READ, FAST_BULK_READ = 0x8A, 0x9A
RANGE = 4
POSITION, EXTENDED, CURRENT_BASED, PWM = 3, 4, 5, 16
TURN = 4096
COUNT = 2.0 * pi / TURN


def at_count(count: int) -> float:
    return (count - 2048) * COUNT


def asked(address: int, size: int, *ids: int) -> bytes:
    return word(address) + word(size) + bytes(ids)


def quick(*ids: int, **bus: bool) -> Host:
    """Servos without return delay."""
    host = Host(*(ServoSpec(i) for i in ids), **bus)
    for servo in host.bus.servos:
        servo.put(servo.table.return_delay_time, 0)
    return host


# -- fast reads ------------------------------------------------------------------------------------------


def test_the_published_fast_sync_read() -> None:
    counts = ((3, 166), (7, 2079), (4, 1023))
    host = Host(*(ServoSpec(i, start_rad=at_count(count)) for i, count in counts))
    said = bytes.fromhex("FFFFFD00 FE 0A00 8A 8400 0400 03 07 04 20F2")
    heard = "FFFFFD00 FE 1900 55 00 03 A6000000 8408  00 07 1F080000 16CA  00 04 FF030000 D19E"
    assert host.say(said) == bytes.fromhex(heard)


def test_the_published_fast_bulk_read() -> None:
    """Its instruction is printed with the CRC of the example before it, so only the answer is compared."""
    host = Host(ServoSpec(3, start_rad=at_count(166)), ServoSpec(7), ServoSpec(4), ambient_c=31.0)
    host.bus.motors.torque_nm[1] = 421 / 885 * host.bus.motors.stall_nm[1]
    said = frame(BROADCAST, bytes.fromhex("9A 03 8400 0400 07 7C00 0200 04 9200 0100"))
    heard = "FFFFFD00 FE 1400 55 00 03 A6000000 67A4  00 07 A501 2474  00 04 1F D9C1"
    assert host.say(said) == bytes.fromhex(heard)


@pytest.mark.parametrize(
    ("model", "firmware", "answers"),
    [("XM430-W350", 44, False), ("XM430-W350", 45, True), ("XL330-M288", 45, False), ("XL330-M288", 46, True)],
)
def test_fast_reads_need_their_firmware(model: str, firmware: int, answers: bool) -> None:
    host = Host(ServoSpec(1, model, firmware))
    for code, parameters in ((FAST_SYNC_READ, asked(132, 4, 1)), (FAST_BULK_READ, b"\x01" + asked(132, 4))):
        assert bool(host.say(frame(BROADCAST, bytes((code,)) + parameters))) is answers
    assert len(host.sync_read(132, 4, [1])) == 1


# -- who answers when ------------------------------------------------------------------------------------


def test_whoever_answers_a_broadcast_ping_waits_for_all_who_might_come_before() -> None:
    (few,) = quick(2, 7).answers(frame(BROADCAST, bytes((PING,))))
    (more,) = quick(2, 7, 30).answers(frame(BROADCAST, bytes((PING,))))
    assert few.wire_s == pytest.approx(more.wire_s * 8 / 31)


def test_a_lost_answer_ends_a_chain_whose_followers_listen_for_it() -> None:
    host = quick(1, 2, 3, followers_answer=False)
    host.bus.faults[1].drop = 1
    assert [status.id for status in host.sync_read(132, 4, [1, 2, 3])] == [1]
    assert [status.id for status in host.sync_read(132, 4, [1, 2, 3])] == [1, 2, 3]


def test_a_cycle_of_twelve_servos_takes_what_the_wire_allows() -> None:
    """4 Mbit/s, goals out and 10 bytes back from each: about 400 cycles a second, with fast sync read 574."""
    ids = range(1, 13)
    host = quick(*ids)
    for servo in host.bus.servos:
        servo.put(servo.table.baud_rate, 6)
    host.baud = 4_000_000
    goals = b"".join(bytes((i,)) + (2048).to_bytes(4, "little") for i in ids)
    out = frame(BROADCAST, bytes((SYNC_WRITE,)) + asked(116, 4) + goals)
    rates = []
    for code in (SYNC_READ, FAST_SYNC_READ):
        back = frame(BROADCAST, bytes((code,)) + asked(126, 10, *ids))
        (answer,) = host.answers(back)
        rates.append(1.0 / (10.0 * (len(out) + len(back)) / host.baud + answer.wire_s + host.bus.spec.usb_latency_s))
    assert rates == pytest.approx([400.0, 574.0], rel=0.05)


def test_firmware_before_42_resets_everything_even_on_a_broadcast() -> None:
    host = Host(ServoSpec(5, firmware=41))
    host.do(BROADCAST, FACTORY_RESET, b"\xff")
    assert host.bus.servos[0].id == 1


# -- registers -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("model", "last"), [("XM430-W350", 661), ("XL330-M288", 227)])
def test_pointers_stay_within_the_ram_of_the_model(model: str, last: int) -> None:
    host = Host(ServoSpec(1, model))
    errors = [host.do(1, WRITE, word(168) + word(address))[0].error for address in (63, 64, last, last + 1)]
    assert errors == [RANGE, 0, 0, RANGE]


def test_a_change_of_mode_resets_profile_and_gains() -> None:
    host = Host()
    host.write_all(1, profile_velocity=50, profile_acceleration=5, position_p_gain=1, velocity_i_gain=1)
    host.write_all(1, operating_mode=CURRENT_BASED)
    names = ("profile_velocity", "profile_acceleration", "position_p_gain", "velocity_i_gain")
    assert [host.read(1, name) for name in names] == [0, 0, 800, 1920]


@pytest.mark.parametrize(("mode", "kept"), [(POSITION, False), (EXTENDED, False), (CURRENT_BASED, True)])
def test_turns_when_the_mode_changes(mode: int, kept: bool) -> None:
    host = Host()
    host.write_all(1, operating_mode=PWM)
    host.bus.motors.push(0, TURN * COUNT)
    host.write_all(1, operating_mode=mode)
    assert host.read(1, "present_position") == 2048 + (TURN if kept else 0)
    host.bus.motors.push(0, TURN * COUNT)
    before = host.read(1, "present_position")
    host.write_all(1, operating_mode=mode if mode != POSITION else PWM)
    assert host.read(1, "present_position") == before  # writing the mode that it has is no change


@pytest.mark.parametrize(("follows", "rests_at"), [(False, 3000), (True, 2048)])
def test_torque_goes_for_the_old_goal_unless_told_to_follow(follows: bool, rests_at: int) -> None:
    host = Host(ServoSpec(1, goal_follows_on_torque=follows))
    host.write_all(1, goal_position=3000, torque_enable=1)
    host.wait(2.0)
    assert host.read(1, "present_position") == pytest.approx(rests_at, abs=2)


@pytest.mark.parametrize(("clears", "left"), [(False, [60, 9]), (True, [0, 0])])
def test_the_profile_after_a_trip_as_either_reading_of_the_manual_has_it(clears: bool, left: list[int]) -> None:
    host = Host(ServoSpec(1, trip_clears_profile=clears))
    host.write_all(1, profile_velocity=60, profile_acceleration=9, torque_enable=1, bus_watchdog=5)
    host.wait(1.0)
    assert [host.read(1, name) for name in ("profile_velocity", "profile_acceleration")] == left


def test_moving_status_and_trajectory_tell_what_it_does() -> None:
    host = Host()
    host.write_all(1, profile_velocity=50, profile_acceleration=10, torque_enable=1)
    assert [host.read(1, name) for name in ("moving", "moving_status")] == [0, 0x31]
    host.write_all(1, goal_position=4000)
    host.wait(0.5)
    assert [host.read(1, name) for name in ("moving", "moving_status")] == [1, 0x32]
    assert host.read(1, "velocity_trajectory") == 50
    assert host.read(1, "present_velocity") == pytest.approx(50, abs=1)
    assert 2048 < host.read(1, "present_position") < host.read(1, "position_trajectory") < 4000
    host.wait(5.0)
    assert [host.read(1, name) for name in ("moving", "moving_status")] == [0, 0x31]
    assert host.read(1, "position_trajectory") == 4000
    assert host.read(1, "realtime_tick") == pytest.approx(5500, abs=5)


def test_a_blocked_servo_is_not_following_and_its_output_is_full() -> None:
    host = Host()
    host.write_all(1, torque_enable=1)
    host.bus.motors.jammed[0] = True
    host.write_all(1, goal_position=4000)
    host.wait(0.5)
    assert [host.read(1, name) for name in ("moving_status", "present_pwm")] == [0x08, 885]


def test_noise_is_that_of_its_seed() -> None:
    def readings(seed: int, noise: float) -> list[int]:
        host = Host(ServoSpec(1, noise_counts=noise), seed=seed)
        return [host.read(1, "present_position") for _ in range(50)]

    assert set(readings(0, 0.0)) == {2048}
    assert readings(1, 3.0) == readings(1, 3.0) != readings(2, 3.0)
    assert 1.0 < np.std(readings(1, 3.0)) < 6.0


# -- the process -----------------------------------------------------------------------------------------


def test_a_gap_ends_a_packet_and_the_account_can_begin_anew(tmp_path: Path) -> None:
    with VirtualBus(BusSpec((ServoSpec(1),)), link=tmp_path / "ttyDXL") as bus:
        port = os.open(bus.link, os.O_RDWR | os.O_NOCTTY)
        try:
            settings = termios.tcgetattr(port)
            settings[4] = settings[5] = termios.B1000000
            termios.tcsetattr(port, termios.TCSANOW, settings)
            os.write(port, frame(1, bytes((WRITE,)) + bytes(200))[:20])
            time.sleep(0.2)  # a servo would have given it up after 1.5 ms
            os.write(port, frame(1, bytes((PING,))))
            ready, _, _ = select.select([port], [], [], 5.0)
            assert ready
        finally:
            os.close(port)
        assert bus.account().reads == 0
        assert bus.account().received == 30
        bus.reset_account()
        assert bus.account().received == 0
        truth = bus.truth()[1]
        assert (truth.goal_count, truth.watchdog) == (2048, 0)


# -- profiles --------------------------------------------------------------------------------------------


def test_profiles_never_exceed_their_acceleration_by_anything() -> None:
    """Two hundred of them, with goals that change in mid-flight."""
    n, random = 200, np.random.default_rng(1)
    nimble = ServoSpec(1, load_nm=0.0, time_constant_s=1e-6)  # the shaft is where the trajectory is
    spec = BusSpec(servos=tuple(replace(nimble, id=i) for i in range(n)), supply_ohm=0.0)
    motors = Motors(spec)
    motors.torque_on[:] = True
    top, sharp = random.uniform(0.5, 2.0, n), 10.0 ** random.uniform(0.5, 2.5, n)
    motors.profile_rad_s[:], motors.profile_rad_s2[:] = top, sharp
    places = [motors.shaft_rad.copy()] * 2
    for duration_s in (0.3, 0.4, 10.0):
        motors.goal_rad[:] = random.uniform(-3.0, 3.0, n)
        for _ in range(round(duration_s / STEP_S)):
            motors.step(motors.now + STEP_S)
            places.append(motors.shaft_rad.copy())
    speed = np.diff(np.array(places), axis=0) / STEP_S
    assert (np.abs(speed).max(axis=0) <= top * (1.0 + 1e-6)).all()
    assert (np.abs(np.diff(speed, axis=0)).max(axis=0) <= sharp * STEP_S * (1.0 + 1e-6) + 1e-9).all()
    assert (np.abs(speed).max(axis=0) > 0.9 * np.minimum(top, np.sqrt(0.1 * sharp))).all()  # nor are they shy
    assert motors.shaft_rad == pytest.approx(motors.goal_rad, abs=1e-9)
