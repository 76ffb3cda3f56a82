"""How often a bus can be gone round: what the wire, the servos and the adapter take, before anything is wired.

Bytes are those of Protocol 2.0 without stuffing, ten bits each. A servo thinks for `turnaround_s` and waits
for its return delay before it answers; the adapter hands a reply on once its latency timer has run out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ori_deploy.actuators.dynamixel.port import BITS_PER_BYTE, FRAME_OVERHEAD, SHORTEST_FRAME
from ori_deploy.actuators.dynamixel.settings import DynamixelSettings
from ori_deploy.actuators.dynamixel.wiring import Wiring
from ori_deploy.errors import RigError
from ori_deploy.wire.dynamixel.registers import WATCHDOG_UNIT_S

GROUP_PACKET = 14
"""Bytes of a sync read or write without what it says of each servo."""

BLOCK_OVERHEAD = 4
GOAL_BYTES = 4
STATE_BYTES = 10
"""Present current or load, velocity and position: 126 to 135."""

HEALTH_BYTES = 7
PIN_BYTES = 8
"""The indirect blocks of hinges and of lock pins; see `startup`."""

SILENT_CYCLES = 2.0
"""Cycles without an instruction that a servo's watchdog has to bear: one is lost, or late."""

STATE_SIZES, HEALTH_SIZES, PIN_SIZES = 5, 3, 3
"""Sizes that repeated reads go through, each a byte longer: a late reply to one of the last has another size."""


@dataclass(frozen=True, slots=True)
class WireTimes:
    """What takes how long on one bus.

    Attributes
    ----------
    baud
        Bits per second.
    turnaround_s, return_delay_s
        Before a servo answers.
    usb_latency_s
        Before the host sees an answer.
    """

    baud: int
    turnaround_s: float
    return_delay_s: float
    usb_latency_s: float

    def bytes_s(self, count: int) -> float:
        """Time of bytes on the wire."""
        return count * BITS_PER_BYTE / self.baud

    def sync_write_s(self, n_servos: int, size: int) -> float:
        """Time of a sync write of `size` bytes to each servo."""
        return self.bytes_s(GROUP_PACKET + n_servos * (1 + size))

    def sync_read_s(self, n_servos: int, size: int, *, fast: bool) -> float:
        """Time of a sync read of `size` bytes from each servo, until the host has them all."""
        if n_servos == 0:
            return 0.0
        pause = self.turnaround_s + self.return_delay_s
        ask = self.bytes_s(GROUP_PACKET + n_servos)
        if fast:
            answer = self.bytes_s(FRAME_OVERHEAD + 1 + n_servos * (size + BLOCK_OVERHEAD)) + pause
        else:
            answer = n_servos * (self.bytes_s(SHORTEST_FRAME + size) + pause)
        return ask + answer + self.usb_latency_s


@dataclass(frozen=True, slots=True)
class CycleTime:
    """Parts of the longest cycle of a control loop, in seconds.

    Attributes
    ----------
    goals, state
        In every cycle.
    health, pins
        In some: temperatures and the like, and servos that drive lock pins.
    """

    goals: float
    state: float
    health: float
    pins: float

    @property
    def usual_s(self) -> float:
        """Goals out, state in."""
        return self.goals + self.state

    @property
    def longest_s(self) -> float:
        """A cycle in which everything is asked for."""
        return self.goals + self.state + self.health + self.pins

    @property
    def rate_hz(self) -> float:
        """Rate at which even the longest cycle fits."""
        return 1.0 / self.longest_s


def cycle_time(wiring: Wiring, times: WireTimes, *, fast: bool) -> CycleTime:
    """The longest cycle of a rig's control loop."""
    n, n_pins = len(wiring.hinges), len(wiring.pins)
    return CycleTime(
        goals=times.sync_write_s(n, GOAL_BYTES),
        state=times.sync_read_s(n, STATE_BYTES + STATE_SIZES - 1, fast=fast),
        health=times.sync_read_s(n, HEALTH_BYTES + HEALTH_SIZES - 1, fast=fast),
        pins=times.sync_read_s(n_pins, PIN_BYTES + PIN_SIZES - 1, fast=False),
    )


def planned_times(wiring: Wiring, *, return_delay_s: float = 0.0, usb_latency_s: float | None = None) -> WireTimes:
    """Times as the rig states them; what was measured on the bus takes precedence."""
    settings = wiring.settings
    latency = settings.usb_latency_s if usb_latency_s is None else usb_latency_s
    return WireTimes(settings.baud, settings.turnaround_s, return_delay_s, latency)


def check_rate(wiring: Wiring, times: WireTimes, rate_hz: float, *, fast: bool, source: str | None) -> CycleTime:
    """Refuse a rate at which the longest cycle does not fit.

    Raises
    ------
    RigError
        With the rate that can be reached, and what takes the time.
    """
    cycle = cycle_time(wiring, times, fast=fast)
    if rate_hz <= cycle.rate_hz:
        return cycle
    parts = ", ".join(
        f"{name} {1e3 * part:.2f}"
        for name, part in (
            ("goals", cycle.goals), ("state", cycle.state), ("health", cycle.health), ("lock pins", cycle.pins),
        )
        if part
    )  # fmt: skip
    kind = "fast sync read" if fast else "sync read"
    raise RigError(
        f"rate_hz: more than {len(wiring.servos)} servos can follow at {times.baud} baud",
        value=f"{rate_hz:g} Hz",
        limit=f"{cycle.rate_hz:.1f} Hz with {kind}: the longest cycle takes {1e3 * cycle.longest_s:.2f} ms "
        f"({parts} ms; each answer waits {1e3 * times.usb_latency_s:g} ms in the adapter)",
        remedy=_remedy(wiring, times, rate_hz, fast=fast),
        source=source,
    )


def check_watchdog(settings: DynamixelSettings, rate_hz: float, source: str | None) -> None:
    """Refuse a watchdog that trips between two cycles of the loop.

    Raises
    ------
    RigError
        With the shortest that would do.
    """
    least_s = SILENT_CYCLES / rate_hz
    if 0.0 < settings.watchdog_s < least_s - 1e-9:
        raise RigError(
            "dynamixel.watchdog_s: servos would stop between two cycles of the loop",
            value=f"{settings.watchdog_s:g} s at {rate_hz:g} Hz",
            limit=f"at least {SILENT_CYCLES:g} cycles, {least_s:.3g} s; or 0 for none",
            remedy=f"watchdog_s = {math.ceil(least_s / WATCHDOG_UNIT_S - 1e-9) * WATCHDOG_UNIT_S:.2f} or more, "
            "or raise rate_hz",
            source=source,
        )


def _remedy(wiring: Wiring, times: WireTimes, rate_hz: float, *, fast: bool) -> str:
    """What would help, tried in the order of least work."""
    best_latency = WireTimes(times.baud, times.turnaround_s, times.return_delay_s, min(times.usb_latency_s, 0.001))
    best_baud = WireTimes(4_000_000, times.turnaround_s, 0.0, best_latency.usb_latency_s)
    for text, other, with_fast in (
        ("set the adapter's latency timer to 1 ms (ori-deploy doctor says how)", best_latency, fast),
        ("use fast_sync_read, with firmware that knows it", times, True),
        ("raise the baud rate to 4000000 (ori-deploy bus set-baud)", best_baud, fast),
        ("raise the baud rate to 4000000 and use fast_sync_read", best_baud, True),
    ):
        if rate_hz <= cycle_time(wiring, other, fast=with_fast).rate_hz and (other, with_fast) != (times, fast):
            return text
    return "lower rate_hz, or drive fewer servos"
