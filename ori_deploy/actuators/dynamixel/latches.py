"""Latches on a Dynamixel bus: lock pins with a servo of their own, and magnets that the hinges vouch for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import CommandRefused, HingeReadings, LatchReading
from ori_deploy.actuators.dynamixel.line import Replies, Reply, ServoLine
from ori_deploy.actuators.dynamixel.readings import PIN, hardware_error
from ori_deploy.actuators.dynamixel.startup import KEPT_RETURN_LEVEL, by_block_address, clear_trip, read, write
from ori_deploy.actuators.dynamixel.throughput import PIN_BYTES, PIN_SIZES
from ori_deploy.actuators.dynamixel.wiring import PinServo
from ori_deploy.actuators.rig import Latch
from ori_deploy.clock import Clock
from ori_deploy.wire.dynamixel.registers import WATCHDOG_UNIT_S

FloatArray = NDArray[np.float64]

HOME = 0.05
"""Part of its travel within which a pin counts as home."""


class Latches:
    """All latches of a rig.

    Parameters
    ----------
    latches
        Of the rig: those of the deployed state, then the stow locks.
    pins
        Servos of the lock pins among them.
    closed_rad, reach_rad
        (n_latches, n_hinges) shaft positions at which what a latch secures is closed, and how far from there
        it takes hold; inf where a hinge does not matter.
    watchdog_s
        Given to the pins' servos with their first command.
    """

    def __init__(
        self,
        latches: Sequence[Latch],
        pins: Sequence[PinServo],
        closed_rad: FloatArray,
        reach_rad: FloatArray,
        watchdog_s: float,
    ) -> None:
        self._latches = tuple(latches)
        self._pins = {pin.latch: pin for pin in pins}
        self._closed, self._reach = closed_rad, reach_rad
        self._watchdog_units = round(watchdog_s / WATCHDOG_UNIT_S)
        self._reads = 0
        self._engaged = {latch.id: False for latch in latches}

    @property
    def has_magnets(self) -> bool:
        """Whether any of them is sensed by the hinges."""
        return any(latch.id not in self._pins for latch in self._latches)

    def find(self, line: ServoLine, pins: Sequence[PinServo]) -> None:
        """Take over from whoever worked the pins before: one that holds near its hole counts as engaged.

        Parameters
        ----------
        pins
            The same servos, with the registers of the firmware that they were found to have.
        """
        self._pins = {pin.latch: pin for pin in pins}
        for name, pin in self._pins.items():
            goal = read(line, pin.id, pin.model.table.goal_position)
            holds = bool(read(line, pin.id, pin.model.table.torque_enable))
            self._engaged[name] = holds and _near(pin, goal, pin.engaged_count)

    def command(self, line: ServoLine, index: int, engaged: bool) -> None:
        """Close or open one. A magnet takes note; a pin's servo is told where to go.

        Raises
        ------
        CommandRefused
            The servo holds no torque.
        BusError
            It does not answer.
        """
        name = self._latches[index].id
        pin = self._pins.get(name)
        if pin is not None:
            self._hold(line, pin)
            write(line, pin.id, pin.model.table.goal_position, pin.engaged_count if engaged else pin.released_count)
        self._engaged[name] = engaged

    def disarm(self, line: ServoLine) -> None:
        """Let pins stay as they are when the bus is let go of."""
        for pin in self._pins.values():
            if read(line, pin.id, pin.model.table.bus_watchdog) > 0:  # a tripped one stands, and stays so
                write(line, pin.id, pin.model.table.bus_watchdog, 0)

    def read(self, line: ServoLine, hinges: HingeReadings | None, clock: Clock) -> tuple[LatchReading, ...]:
        """All of them, in order.

        Parameters
        ----------
        hinges
            Readings of now; needed where there are magnets.

        Raises
        ------
        BusTimeout, CorruptReply
            There are pins, and none of them answered.
        """
        by_id: dict[int, Reply] = {}
        garbage = False
        self._reads += 1
        for address, ids in by_block_address(tuple(self._pins.values())).items():
            replies = line.sync_read(address, PIN_BYTES + self._reads % PIN_SIZES, ids)
            by_id |= dict(replies.by_id)
            garbage |= replies.garbage
        if self._pins:
            Replies(by_id, garbage).require_any("lock pins")
        now = clock.now()
        return tuple(self._reading(latch.id, by_id, hinges, k, now) for k, latch in enumerate(self._latches))

    def _reading(
        self, name: str, by_id: dict[int, Reply], hinges: HingeReadings | None, k: int, now: float
    ) -> LatchReading:
        pin = self._pins.get(name)
        if pin is None:
            return self._magnet(k, hinges)
        reply = by_id.get(pin.id)
        if reply is None:
            return LatchReading(name, self._engaged[name], None, valid=False, time_s=np.nan)
        shown = np.frombuffer(reply.data[: PIN.itemsize], dtype=PIN)[0]
        fault = self._fault(pin, shown)
        # Where the settings are gone, so is what the block shows; a pin that nobody holds is not known to stay.
        confirmed = None if fault is not None else _near(pin, int(shown["position"]), pin.engaged_count)
        return LatchReading(name, self._engaged[name], confirmed, valid=True, time_s=now, fault=fault)

    def _fault(self, pin: PinServo, shown: np.void) -> str | None:
        """What is wrong with a pin's servo, or None."""
        servo = f"its servo (id {pin.id})"
        if shown["level"] != KEPT_RETURN_LEVEL:
            return f"{servo} restarted and lost its settings"
        if shown["error"]:
            return f"{servo} reports {hardware_error(int(shown['error'])).name}"
        if shown["watchdog"] < 0:
            return f"{servo} heard nothing for too long and stopped where it was"
        if self._engaged[pin.latch] and not shown["torque"]:
            return f"{servo} has no torque, though it was told to hold the pin"
        return None

    def _magnet(self, k: int, hinges: HingeReadings | None) -> LatchReading:
        """Closed when every hinge it depends on is measured within its capture range."""
        name = self._latches[k].id
        matters = np.isfinite(self._reach[k])
        if hinges is None or not hinges.valid[matters].all():
            return LatchReading(name, self._engaged[name], None, valid=False, time_s=np.nan)
        away = np.abs(hinges.position_rad - self._closed[k])
        closed = bool((away <= self._reach[k])[matters].all())
        oldest = float(hinges.time_s[matters].min())
        return LatchReading(name, self._engaged[name], closed, valid=True, time_s=oldest)

    def _hold(self, line: ServoLine, pin: PinServo) -> None:
        """Torque on where the pin stands, if it is not on; then its watchdog."""
        table = pin.model.table
        clear_trip(line, pin)
        if not read(line, pin.id, table.torque_enable):
            errors = read(line, pin.id, table.hardware_error_status)
            if errors:
                raise CommandRefused(
                    f"{pin.latch}: its servo (id {pin.id}) reports {hardware_error(errors).name}, takes no torque; "
                    "remedy: free the pin, then ori-deploy bus reset-error"
                )
            write(line, pin.id, table.goal_position, read(line, pin.id, table.present_position))
            write(line, pin.id, table.torque_enable, 1)
        write(line, pin.id, table.bus_watchdog, self._watchdog_units)


def _near(pin: PinServo, count: int, end: int) -> bool:
    return abs(count - end) <= HOME * abs(pin.engaged_count - pin.released_count)
