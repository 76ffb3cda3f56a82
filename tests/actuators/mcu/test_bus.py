"""The bus against a scripted device: what it sends, what it makes of the answers, and what it does about loss."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ori_deploy.actuators.bus import (
    ActuatorFault,
    ActuatorRestarted,
    BusClosed,
    BusTimeout,
    CommandRefused,
    CorruptReply,
    HardwareError,
    LatchTripped,
    WatchdogTripped,
)
from ori_deploy.actuators.mcu.bus import McuBus
from ori_deploy.actuators.mcu.configure import read_config, write_config
from ori_deploy.actuators.mcu.mixed import MixedBus
from ori_deploy.actuators.mcu.records import config_hash
from ori_deploy.actuators.mcu.startup import FIRMWARE
from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.wire.generated import ori_deploy as d
from tests.actuators.mcu.scripted import ScriptedDevice, SteppedClock, VirtualPort, unharmed
from tests.actuators.mcu.setups import SERVO, config, electromagnet, lock_pin, magnet, wiring

PERIOD_S = 0.02


@dataclass
class Bench:
    """A device in virtual time, and the bus to it."""

    device: ScriptedDevice
    bus: McuBus
    clock: SteppedClock
    port: VirtualPort

    def wait(self, duration_s: float) -> None:
        self.clock.sleep_until(self.clock.now() + duration_s)

    def run(self, cycles: int, path: Callable[[float], tuple[np.ndarray, np.ndarray]] | None = None) -> float:
        """A loop at 50 Hz along a path; with none, only reading. Returns the largest distance of readings from it."""
        bus, start, worst = self.bus, self.clock.now(), 0.0
        for i in range(cycles):
            try:
                position = bus.read_hinges().position_rad
            except (BusTimeout, CorruptReply):
                position = None
            if path is not None:
                bus.command_hinges(*path(i * PERIOD_S))
                if position is not None:
                    due = path(max(0.0, i * PERIOD_S - bus.delay_s))[0]
                    worst = max(worst, float(np.abs(position - due).max()))
            self.clock.sleep_until(start + (i + 1) * PERIOD_S)
        return worst


def bench(
    made: McuWiring | None = None, *, connect: bool = True, clock: SteppedClock | None = None, **script: Any
) -> Bench:
    made = wiring() if made is None else made
    clock = SteppedClock() if clock is None else clock
    device = ScriptedDevice(config(made), clock.now, **script)
    bus = McuBus(made, clock, 50.0, source="rig.toml")
    port = VirtualPort(device, clock)
    bus._port = bus._line.port = port  # type: ignore[assignment]
    if connect:
        bus.connect()
    return Bench(device, bus, clock, port)


def spacing_of(device: ScriptedDevice) -> np.ndarray:
    """Between knots of which the first one moves, in us."""
    moves = np.array([any(knot.velocity) for knot in device.taken])
    return np.diff([knot.time_us for knot in device.taken])[moves[:-1]]


def swing(t: float) -> tuple[np.ndarray, np.ndarray]:
    """From rest to rest in 1 s, 0.5 rad."""
    u = min(t, 1.0)
    way, speed = u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2
    return 0.5 * way * np.array([1.0, -1.0, 0.5]), 0.5 * speed * np.array([1.0, -1.0, 0.5])


def still(t: float) -> tuple[np.ndarray, np.ndarray]:
    """Where it is."""
    del t
    return np.zeros(3), np.zeros(3)


def deaf(message: Any, frame: bytes) -> list[tuple[float, bytes]]:
    del message, frame
    return []


def spoilt(message: Any, frame: bytes) -> list[tuple[float, bytes]]:
    del message
    return [(0.0, frame[:-1] + bytes((frame[-1] ^ 0x40,)))]


# -- connecting --------------------------------------------------------------------------------------


def test_connect_finds_the_device_and_its_clock() -> None:
    b = bench(drift=0.004)
    device, bus = b.device, b.bus
    assert bus.connected
    assert bus.advice == ()
    now = b.clock.now()
    base = bus._line.timebase
    assert abs(base.device_s(now) - 1e-6 * device.now_us()) < base.error_s(now) + 1e-3
    assert not device.outputs_on


def test_connect_waits_for_a_device_that_starts() -> None:
    b = bench(wiring(boot_wait_s=2.0), connect=False, dead=True)
    device, bus = b.device, b.bus
    device._later.append((b.clock.now() + 0.4, lambda: setattr(device, "dead", False)))
    bus.connect()


def test_connect_gives_up_on_silence() -> None:
    b = bench(connect=False, dead=True)
    _, bus = b.device, b.bus
    with pytest.raises(BusTimeout, match=r"0\.3 s"):
        bus.connect()


def test_connect_refuses_another_configuration() -> None:
    b = bench(connect=False)
    device, bus = b.device, b.bus
    device.stored = config(wiring(stall_rad=0.2))
    wanted, found = config_hash(device.config), config_hash(device.stored)
    with pytest.raises(CommandRefused, match=f"{found:08x}.*{wanted:08x}.*ori-deploy mcu config"):
        bus.connect()
    device.stored = []
    with pytest.raises(CommandRefused, match="none"):
        bus.connect()
    assert not bus.connected


@pytest.mark.parametrize(
    ("version", "goes"),
    [(0x01000000, False), (0x01010000, True), (0x01010300, True), (0x01020000, True), (0x02010000, False)],
)
def test_connect_refuses_a_firmware_that_speaks_of_other_things(version: int, goes: bool) -> None:
    b = bench(connect=False)
    b.device.firmware = version
    if goes:
        b.bus.connect()
        return
    with pytest.raises(CommandRefused, match=r"firmware does not go.*ori-deploy mcu flash"):
        b.bus.connect()
    assert not b.bus.connected


def test_the_firmware_here_goes_with_the_host_here() -> None:
    text = (Path(__file__).parents[3] / "firmware" / "core" / "version.h").read_text()
    number = int(re.search(r"UINT32_C\((0x[0-9A-Fa-f]+)\)", text)[1], 16)  # type: ignore[index]
    assert (number >> 24, number >> 16 & 0xFF) == FIRMWARE


def test_connect_names_silent_hinges() -> None:
    b = bench(connect=False, silent=0b010)
    _, bus = b.device, b.bus
    with pytest.raises(BusTimeout, match=r"from b \(open wire at A1\); "):
        bus.connect()


def test_connect_names_a_supply_that_is_off_and_not_every_wire() -> None:
    b = bench(connect=False, silent=0b111, supply_mv=20)
    with pytest.raises(
        BusTimeout, match=r"a, b, c: .* is 0\.02 V; limit: min_supply_v = 4\.5 V; remedy: switch it on"
    ):
        b.bus.connect()


def test_connect_in_spite_of_a_fault() -> None:
    b = bench(fault=d.ORI_FAULT_ESTOP, state=d.ORI_FAULTED)
    _, bus = b.device, b.bus
    assert bus.advice == ()  # told once, when torque is to go on
    assert bus.read_hinges().alert.all()
    with pytest.raises(ActuatorFault, match="emergency stop"):
        bus.read_health()
    with pytest.raises(CommandRefused, match="emergency stop"):
        bus.enable_torque()


def test_unplugging_disconnects() -> None:
    b = bench()
    bus = b.bus
    bus.enable_torque()
    b.port.plugged = False
    with pytest.raises(BusClosed):
        bus.command_hinges(np.zeros(3))
    assert not bus.connected


def test_a_program_that_goes_on_with_the_same_token_is_heard() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    token = device.commands[-1].token
    bus.close()
    bus._line._token = (token - 1) % 65536
    bus.connect()
    bus.disable_torque()
    assert device.outputs_on == 0


# -- readings ----------------------------------------------------------------------------------------


def test_readings() -> None:
    b = bench()
    device, bus = b.device, b.bus
    device.measured[:3] = [100_000, -200_000, 300_000]
    readings = bus.read_hinges()
    np.testing.assert_allclose(readings.position_rad, [0.1, -0.2, 0.3])
    assert readings.valid.all()
    assert np.isfinite(readings.velocity_rad_s).all()
    assert (np.abs(readings.time_s - b.clock.now()) < 0.01).all()
    health = bus.read_health()
    np.testing.assert_allclose(health.temperature_c, 25.0, atol=0.01)
    np.testing.assert_allclose(health.voltage_v, 6.0)
    assert not health.torque_on.any()


def test_readings_have_the_time_at_which_they_were_taken() -> None:
    b = bench(drift=0.004)
    b.wait(1.0)
    b.bus.read_hinges()
    b.device.to_device = lambda message, frame: [(0.008 * (message.get_type() == "ORI_POLL"), frame)]
    sent = b.clock.now()
    assert b.bus.read_hinges().time_s[0] == pytest.approx(sent + 0.009, abs=2e-3)


def test_velocities_are_those_of_the_motion() -> None:
    b = bench()
    b.bus.enable_torque()
    b.run(40, swing)  # 0.5 s along the path, which is half-way
    np.testing.assert_allclose(b.bus.read_hinges().velocity_rad_s, swing(0.5)[1], rtol=0.1)


def test_only_answers_tell_of_the_clock() -> None:
    b = bench()
    before = b.bus._line.timebase.device_s(b.clock.now())
    for ts1 in (1, round(1e9 * b.clock.now()) - 5_000_000):
        b.device.send(d.MAVLink_timesync_message(10**12, ts1))
    b.bus.read_hinges()
    assert b.bus._line.timebase.device_s(b.clock.now()) == pytest.approx(before, abs=0.02)


def test_readings_of_single_hinges_that_fail() -> None:
    b = bench()
    device, bus = b.device, b.bus
    device.silent, device.garbled = 0b001, 0b010
    readings = bus.read_hinges()
    assert readings.valid.tolist() == [False, False, True]
    for array in (readings.position_rad, readings.velocity_rad_s, readings.time_s):
        np.testing.assert_array_equal(np.isnan(array), ~readings.valid)
    assert bus.read_health().valid.tolist() == [False, False, True]
    device.silent, device.garbled = 0b111, 0
    with pytest.raises(BusTimeout, match="open"):
        bus.read_hinges()
    device.silent, device.garbled = 0b011, 0b100
    with pytest.raises(CorruptReply):
        bus.read_hinges()
    device.silent = device.garbled = 0
    device.thermistor = 1020
    with pytest.raises(CorruptReply, match=r"no thermistor.* at A13: it reads 1020 counts"):
        bus.read_health()


@pytest.mark.parametrize(("count", "words"), [(1023, "no thermistor, or an open wire"), (0, "short circuit")])
def test_without_a_thermistor_torque_stays_off_and_it_says_so(count: int, words: str) -> None:
    b = bench(thermistor=count)
    with pytest.raises(CommandRefused, match=f"torque stays off: {words} at A13: it reads {count} counts; limit: 20"):
        b.bus.enable_torque()
    assert b.device.outputs_on == 0


def test_silence_and_noise_are_told_apart() -> None:
    b = bench()
    device, bus = b.device, b.bus
    device.to_host = deaf
    with pytest.raises(BusTimeout):
        bus.read_hinges()
    device.to_host = spoilt
    with pytest.raises(CorruptReply):
        bus.read_hinges()
    device.to_host = unharmed
    assert bus.read_hinges().valid.all()


def test_late_reports_are_not_taken_for_new_ones() -> None:
    b = bench()
    device, bus = b.device, b.bus
    late = [True, True]  # a poll goes out twice before it counts as lost

    def hold_back(message: Any, frame: bytes) -> list[tuple[float, bytes]]:
        if message.get_type() == "ORI_STATE" and late and late.pop():
            return [(0.045, frame)]
        return [(0.0, frame)]

    device.to_host = hold_back
    with pytest.raises(BusTimeout):
        bus.read_hinges()
    device.measured[0] = 500_000
    b.wait(0.03)
    assert bus.read_hinges().position_rad[0] == pytest.approx(0.5)


def test_events_and_texts_are_kept() -> None:
    b = bench()
    device, bus = b.device, b.bus
    device.send(d.MAVLink_ori_event_message(2_000_000, 4, 9, d.ORI_EVENT_FAULT, 10))
    device.send(d.MAVLink_statustext_message(2, b"ori fault 10"))
    bus.read_hinges()
    assert [notice.text for notice in bus.events][-2:] == [
        "event 9 at 2.000 s: fault, index 10, value 4",
        "ori fault 10",
    ]


# -- torque and goals --------------------------------------------------------------------------------


def test_torque_on_and_off() -> None:
    b = bench()
    device, bus = b.device, b.bus
    device.measured[:3] = [100_000, -200_000, 300_000]
    np.testing.assert_allclose(bus.enable_torque(), [0.1, -0.2, 0.3])
    assert device.outputs_on == 0b111
    assert bus.read_health().torque_on.all()
    bus.disable_torque()
    assert device.outputs_on == 0
    bus.command_hinges(np.zeros(3))
    b.wait(0.05)
    assert not device.taken


def test_arming_what_holds_begins_at_its_outputs() -> None:
    """A hinge that hangs below its output is armed where it is measured, and its output does not step there."""
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    device.trip(d.ORI_FAULT_ESTOP)
    device.droop_urad = 20_000
    b.wait(0.02)
    bus.reset_errors()
    np.testing.assert_allclose(bus.enable_torque(), -0.02)
    assert device.asked[:3] == [0, 0, 0]
    b.run(90, lambda time_s: (np.full(3, -0.02 * min(time_s, 1.0)), np.full(3, -0.02 * (time_s < 1.0))))
    assert not device.fault
    assert device.taken[0].position[:3] == [0, 0, 0]
    assert device.asked[:3] == [-20_000] * 3


def test_torque_off_waits_for_rest() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    bus.command_hinges(np.array([0.2, 0.0, -0.2]))
    bus.disable_torque()
    assert device.asked[:3] == [200_000, 0, -200_000]
    assert device.outputs_on == 0
    assert not device.fault


def test_torque_off_brakes_what_moves() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    b.run(25, swing)
    begin = b.clock.now()
    bus.disable_torque()
    assert b.clock.now() - begin < 0.2
    assert device.outputs_on == 0
    assert device.fault == d.ORI_FAULT_HOST_BRAKE


def test_braking_is_no_news_to_who_asked_for_it() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    b.run(25, swing)
    assert bus.brake() == pytest.approx(0.05 + 0.04)
    assert bus.brake_s == 0.05
    assert device.fault == d.ORI_FAULT_HOST_BRAKE
    taken = len(device.taken)
    bus.command_hinges(np.zeros(3))
    assert not bus.read_hinges().alert.any()
    assert bus.read_health().torque_on.all()
    assert len(device.taken) == taken
    bus.close()
    bus.connect()  # it is, to whoever comes next
    with pytest.raises(ActuatorFault, match="told to stop"):
        bus.read_health()
    bus.reset_errors()
    bus.enable_torque()


def test_a_lone_goal_is_reached_within_the_limits() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    bus.command_hinges(np.array([0.5, -0.5, 0.1]))
    b.wait(0.05)
    hold, goal = device.taken
    assert hold.position[:3] == [0, 0, 0]
    assert not any(hold.velocity)
    duration = 1e-6 * (goal.time_us - hold.time_us)
    assert 1.5 * 0.5 / duration <= 3.0
    assert 6.0 * 0.5 / duration**2 <= 20.0
    b.run(45)
    assert device.asked[:3] == [500_000, -500_000, 100_000]
    assert device.state == d.ORI_HOLDING
    assert not device.fault


def test_a_goal_too_far_for_one_step_is_refused() -> None:
    b = bench(wiring(stall_rad=0.3))
    device, bus = b.device, b.bus
    bus.enable_torque()
    bus._grid._velocity[:] = 0.5
    bus._grid._device_velocity[:] = 0.5
    with pytest.raises(CommandRefused, match=r"b is 1\.5 rad"):
        bus.command_hinges(np.array([0.0, 1.5, 0.0]))
    assert not device.taken


def test_a_velocity_beyond_the_limit_is_refused() -> None:
    b = bench()
    _, bus = b.device, b.bus
    bus.enable_torque()
    with pytest.raises(CommandRefused, match="velocity of c is 100"):
        bus.command_hinges(np.zeros(3), np.array([0.0, 0.0, 100.0]))


@pytest.mark.parametrize("drift", [0.0, 0.005, -0.005])
def test_a_motion_is_followed_on_the_grid(drift: float) -> None:
    b = bench(drift=drift)
    device, bus = b.device, b.bus
    bus.enable_torque()
    worst = b.run(75, swing)
    assert not device.fault
    assert worst < 0.03
    spacing = spacing_of(device) / (PERIOD_S * 1e6 * (1.0 + drift))
    assert len(spacing) > 40
    assert ((spacing > 0.99) & (spacing < 1.02)).all()
    np.testing.assert_allclose(device.taken[-1].position[:3], 1e6 * swing(2.0)[0], atol=2)


def test_knots_arrive_once_and_in_order_under_loss() -> None:
    random = np.random.default_rng(3)

    def lossy(message: Any, frame: bytes) -> list[tuple[float, bytes]]:
        del message
        return [] if random.random() < 0.15 else [(0.0, frame)]

    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    device.to_host = device.to_device = lossy
    b.run(80, swing)
    assert not device.fault
    device.to_host = device.to_device = unharmed
    b.run(3)
    assert [knot.number for knot in device.taken] == list(range(len(device.taken)))
    assert len(device.taken) == bus._stream._next  # type: ignore[union-attr]
    np.testing.assert_allclose(device.taken[-1].position[:3], 1e6 * swing(2.0)[0], atol=2)


def test_a_stall_of_the_loop_keeps_the_grid_and_the_lead_comes_back() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    start = np.zeros(3)
    creep = np.full(3, 0.05)
    origin = b.clock.now()
    for i in range(150):
        bus.read_hinges()
        bus.command_hinges(start + creep * min(i, 1) * i * PERIOD_S, creep if i else np.zeros(3))
        if i == 40:
            b.wait(0.05)
            origin += 0.05
        b.wait(max(0.0, origin + (i + 1) * PERIOD_S - b.clock.now()))
    assert not device.fault
    spacing = spacing_of(device)
    assert spacing.max() <= 20_000 * 1.0101
    assert spacing[-60:].mean() > 20_000 * 1.002
    bus.command_hinges(start + creep * 150 * PERIOD_S, np.zeros(3))


def test_holding_keeps_the_stream_alive_and_a_pause_begins_anew() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    b.run(30, still)
    assert device.state == d.ORI_STREAMING
    b.run(25)
    assert device.state == d.ORI_HOLDING
    b.wait(0.3)
    b.run(30, still)
    b.run(20)
    assert device.state == d.ORI_HOLDING
    assert not device.fault


def test_goals_faster_than_the_loop_end_at_the_last_one() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    for goal in np.linspace(0.0, 0.1, 60):
        bus.command_hinges(np.full(3, goal))
    b.run(60)
    assert not device.fault
    assert device.asked[:3] == [100_000] * 3


def test_a_motion_faster_than_the_loop_is_refused() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    queued = 0
    with pytest.raises(CommandRefused, match="one goal in every cycle"):  # noqa: PT012
        for i in range(60):
            bus.command_hinges(*swing(i * PERIOD_S))
            queued += 1
    assert 6 <= queued <= 9
    assert not device.fault


def test_a_loop_that_begins_late_and_catches_up_overfills_the_queue_and_loses_nothing() -> None:
    b = bench()
    b.bus.enable_torque()
    goals = [swing(i * PERIOD_S) for i in range(75)]
    for goal in goals[:6]:
        b.bus.command_hinges(*goal)
    begin = b.clock.now()
    for i, goal in enumerate(goals[6:], 1):
        b.clock.sleep_until(begin + i * PERIOD_S)
        b.bus.read_hinges()
        b.bus.command_hinges(*goal)
    b.run(20)
    assert not b.device.fault
    assert b.device.taken[-1].position[:3] == [500_000, -500_000, 250_000]
    assert [knot.number for knot in b.device.taken] == list(range(len(b.device.taken)))


def test_goals_after_a_long_pause_find_the_clock_again() -> None:
    b = bench(drift=0.005)
    device, bus = b.device, b.bus
    bus.enable_torque()
    base = bus._line.timebase
    base._samples.clear()
    base.add(b.clock.now() - 100.0, b.clock.now() - 99.99, 1e-6 * device.now_us() - 100.4)
    assert not base.good_at(b.clock.now())
    bus.command_hinges(np.full(3, 0.1))
    b.run(40)
    assert device.asked[:3] == [100_000] * 3
    base._samples.clear()
    base.add(b.clock.now() - 100.0, b.clock.now() - 99.99, 1e-6 * device.now_us() - 100.4)
    bus.disable_torque()
    assert not device.outputs_on


def test_a_device_that_takes_no_goals_is_noticed() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    device.stream_open = False
    with pytest.raises(BusTimeout, match="not taken goals"):
        b.run(40, swing)


def test_closing_at_rest_waits_and_leaves_no_fault() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    bus.command_hinges(np.full(3, 0.1))
    bus.close()
    assert device.asked[:3] == [100_000] * 3
    assert device.state == d.ORI_HOLDING
    assert device.outputs_on == 0b111
    bus.connect()  # and whoever comes next goes on from there
    bus.command_hinges(np.full(3, 0.15))
    b.run(40)
    assert device.asked[:3] == [150_000] * 3
    assert not device.fault


def test_closing_sees_to_it_that_the_last_goal_arrives() -> None:
    b = bench()
    b.bus.enable_torque()
    b.device.to_device = deaf
    b.bus.command_hinges(np.full(3, 0.1))
    b.clock.sleep_until(b.clock.now() + 0.002)
    b.device.to_device = unharmed
    b.bus.close()
    assert b.device.asked[:3] == [100_000] * 3
    assert not b.device.fault


# -- faults ------------------------------------------------------------------------------------------


def test_silence_of_the_host_is_a_tripped_watchdog_until_cleared() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    b.run(25, swing)
    b.wait(0.25)
    assert device.fault == d.ORI_FAULT_HOST_SILENT
    readings = bus.read_hinges()
    assert readings.valid.all()
    assert readings.alert.all()
    for _ in range(2):
        with pytest.raises(WatchdogTripped, match="heard nothing"):
            bus.read_health()
    taken = len(device.taken)
    bus.command_hinges(np.zeros(3))
    bus.reset_errors()
    assert bus.read_health().torque_on.all()
    bus.command_hinges(np.zeros(3))
    b.wait(0.05)
    assert len(device.taken) == taken
    bus.enable_torque()
    bus.command_hinges(bus.read_hinges().position_rad)
    b.run(30)
    assert not device.fault


def test_a_stalled_hinge_is_an_overload() -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    device.stall(1)
    assert bus.read_hinges().alert.tolist() == [False, True, False]
    health = bus.read_health()
    assert HardwareError(int(health.hardware_error[1])) == HardwareError.OVERLOAD
    assert health.torque_on.tolist() == [True, False, True]
    bus.reset_errors()
    health = bus.read_health()
    assert not health.hardware_error.any()
    assert health.torque_on.tolist() == [True, False, True]
    bus.enable_torque()
    assert bus.read_health().torque_on.all()


@pytest.mark.parametrize(
    ("fault", "index", "kind", "words"),
    [
        (d.ORI_FAULT_UNDERRUN, 255, WatchdogTripped, "microcontroller: ran out of goals"),
        (d.ORI_FAULT_POSITION_LIMIT, 1, ActuatorFault, "b: .*range"),
        (d.ORI_FAULT_VELOCITY_LIMIT, 2, ActuatorFault, "c: .*too fast"),
        (d.ORI_FAULT_SUPPLY_LOW, 255, ActuatorFault, r"now 6\.00 V; limit: min_supply_v = 4\.5 V; remedy: "),
        (d.ORI_FAULT_HOST_SILENT, 255, WatchdogTripped, r"limit: silence_s = 0\.15 s; remedy: "),
        (d.ORI_FAULT_STALL, 1, ActuatorFault, r"^b: .*limit: stall_rad = 0\.3 rad, stall_s = 0\.5 s; remedy: "),
        (d.ORI_FAULT_ESTOP, 255, ActuatorFault, "release it, then ori-deploy mcu clear-fault --rig rig.toml$"),
        (d.ORI_FAULT_BROWN_OUT, 255, ActuatorRestarted, "sagged"),
        (d.ORI_FAULT_WATCHDOG_RESET, 255, ActuatorRestarted, "hung"),
        (99, 255, ActuatorFault, "fault 99"),
    ],
)
def test_faults_in_words(fault: int, index: int, kind: type[ActuatorFault], words: str) -> None:
    b = bench()
    device, bus = b.device, b.bus
    device.trip(fault, index)
    assert bus.read_hinges().alert.all()
    with pytest.raises(kind, match=words):
        bus.read_health()


@pytest.mark.parametrize(
    ("port", "source", "where"),
    [(None, "r.toml", "--rig r.toml"), ("/dev/x", "r.toml", "--port /dev/x"), (None, None, "--port /dev/ttyNONE")],
)
def test_the_command_that_clears_says_which_board(port: str | None, source: str | None, where: str) -> None:
    made = McuBus(wiring(), SteppedClock(), 50.0, port, source)
    assert made._naming.clear == f"ori-deploy mcu clear-fault {where}"


def test_every_fault_of_the_dialect_has_words() -> None:
    from ori_deploy.actuators.mcu.faults import _FAULTS, Naming

    known = set(d.enums["ORI_FAULT"]) - {d.ORI_FAULT_NONE, d.ORI_FAULT_ENUM_END}
    assert known == set(_FAULTS)
    state = bench().bus._ask_state()
    for words in _FAULTS.values():
        text = words.text(state, Naming())
        assert text.count("remedy: ") == 1
        assert ("ori-deploy mcu clear-fault" in text) == words.cleared


def test_a_fault_whose_cause_persists_stays() -> None:
    b = bench(fault=d.ORI_FAULT_ESTOP, state=d.ORI_FAULTED, cause_persists=True)
    device, bus = b.device, b.bus
    with pytest.raises(CommandRefused, match="estop persists"):
        bus.reset_errors()
    device.cause_persists = False
    bus.reset_errors()
    assert bus.read_health().valid.all()


@pytest.mark.parametrize("fault", [0, d.ORI_FAULT_WATCHDOG_RESET])
def test_a_restart_is_noticed_and_accepted_when_cleared(fault: int) -> None:
    b = bench()
    device, bus = b.device, b.bus
    bus.enable_torque()
    b.run(25, swing)
    device.restart(fault)
    readings = bus.read_hinges()
    assert readings.alert.all()
    assert (np.abs(readings.time_s - b.clock.now()) < 0.01).all()
    with pytest.raises(ActuatorRestarted):
        bus.read_health()
    with pytest.raises(CommandRefused):
        bus.enable_torque()
    bus.reset_errors()
    bus.read_health()
    bus.enable_torque()
    assert device.outputs_on == 0b111


def test_a_lost_answer_does_not_repeat_the_command() -> None:
    b = bench()
    device, bus = b.device, b.bus
    lost = [True, True]
    device.to_host = lambda message, frame: (
        [] if message.get_type() == "ORI_ACK" and lost and lost.pop() else [(0.0, frame)]
    )
    before = len(device.commands)
    bus.enable_torque()
    assert [m.get_type() for m in device.commands[before:]] == ["ORI_ENABLE"]


# -- blind hinges ------------------------------------------------------------------------------------


def test_a_blind_hinge_needs_somebodys_word() -> None:
    blind = {"actuator": "b", "output": 5, "open_loop": True, **SERVO}
    b = bench(wiring(hinge=[blind]))
    device, bus = b.device, b.bus
    assert bus.unvouched() == ("b",)
    assert bus.read_hinges().valid.tolist() == [True, False, True]
    with pytest.raises(CommandRefused, match="from b"):
        bus.enable_torque()
    with pytest.raises(CommandRefused, match="a is not where"):
        bus.vouch(np.array([0.5, 0.7, 0.0]), np.full(3, 0.1))
    bus.vouch(np.array([0.05, 0.7, 0.0]), np.full(3, 0.1))
    assert bus.unvouched() == ()
    np.testing.assert_allclose(bus.enable_torque(), [0.0, 0.7, 0.0])
    assert device.asked[1] == 700_000
    bus.command_hinges(np.array([0.0, 0.8, 0.0]))
    b.run(30)
    assert bus.read_hinges().position_rad[1] == pytest.approx(0.8)
    bus.disable_torque()
    assert bus.unvouched() == ("b",)


# -- latches -----------------------------------------------------------------------------------------


def latch_wiring(n_hinges: int = 3) -> McuWiring:
    pin = {"latch": "pin", "output": 11, "sensor": 3, "engaged_us": 1000.0, "released_us": 2000.0}
    held = {"latch": "em", "output": 0}
    return wiring(n_hinges, (magnet("m"), electromagnet("em"), lock_pin("pin")), latch=[pin, held])


def test_latches() -> None:
    b = bench(latch_wiring())
    device, bus = b.device, b.bus
    device.latches[1].sensed = False
    device.latches[0].closed = True
    bus.engage("em")
    readings = bus.read_latches()
    assert [r.id for r in readings] == ["m", "em", "pin"]
    assert [r.engaged for r in readings] == [False, True, False]
    assert [r.confirmed for r in readings] == [True, None, False]
    assert all(r.valid and abs(r.time_s - b.clock.now()) < 0.01 for r in readings)
    device.latches[1] = type(device.latches[1])(sensed=False, tripped=True, duty_left=250)
    assert "25 %" in (bus.read_latches()[1].fault or "")
    with pytest.raises(LatchTripped, match=r"em: .*25 %"):
        bus.engage("em")
    bus.release("em")
    bus.engage("pin")
    assert device.latches[2].engaged


def test_hinges_on_one_bus_and_latches_on_another() -> None:
    own = wiring(3, (magnet("own"),))
    b = bench(own, connect=False)
    other = bench(latch_wiring(0), connect=False, clock=b.clock)
    device, hinges, switch, others = b.device, b.bus, other.device, other.bus
    order = ["em", "own", "m", "pin"]
    bus = MixedBus(hinges, others, order, np.array([[-2.0, 2.0]] * 3))
    bus.connect()
    assert bus.delay_s == hinges.delay_s
    bus.enable_torque()
    bus.engage("em")
    bus.engage("own")
    assert switch.latches[1].engaged
    assert device.latches[0].engaged
    assert [r.id for r in bus.read_latches()] == order
    assert bus.read_health().torque_on.all()
    switch.trip(d.ORI_FAULT_ESTOP)
    with pytest.raises(ActuatorFault, match="emergency"):
        bus.read_health()
    bus.reset_errors()
    bus.disable_torque()
    other.port.plugged = False
    with pytest.raises(BusClosed):
        bus.read_latches()
    assert not bus.connected
    assert not hinges.connected
    with pytest.raises(BusClosed):
        bus.command_hinges(np.zeros(3))


def test_latches_alone_need_no_stream() -> None:
    b = bench(latch_wiring(0))
    _, bus = b.device, b.bus
    assert bus.delay_s == 0.0
    bus.engage("pin")
    assert bus.read_health().valid.shape == (0,)


# -- configuration -----------------------------------------------------------------------------------


def test_configuration_is_written_and_read_back() -> None:
    made = latch_wiring()
    b = bench(made, connect=False)
    device, bus = b.device, b.bus
    device.stored = []
    bus._port.open()
    bus._line.begin()
    assert read_config(bus._line) == ()
    told = write_config(bus._line, device.config)
    assert told == config_hash(device.config) == device.hash(device.config)
    assert config_hash(read_config(bus._line)) == told
    bus._port.close()
    bus.connect()
