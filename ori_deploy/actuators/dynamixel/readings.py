"""From the bytes that servos answer to readings in SI units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import ActuatorRestarted, HardwareError, HealthReadings, HingeReadings, WatchdogTripped
from ori_deploy.actuators.dynamixel.line import Replies
from ori_deploy.actuators.dynamixel.startup import KEPT_RETURN_LEVEL
from ori_deploy.actuators.dynamixel.wiring import RAD_PER_COUNT, HingeServo
from ori_deploy.wire.dynamixel.models import RPM
from ori_deploy.wire.dynamixel.registers import CENTRE_COUNT, LOAD_UNIT, VELOCITY_UNIT_RPM, VOLTAGE_UNIT_V

FloatArray = NDArray[np.float64]

STATE = np.dtype([("effort", "<i2"), ("velocity", "<i4"), ("position", "<i4")])
"""Addresses 126 to 135 of every model."""

HEALTH = np.dtype(
    [
        ("level", "u1"),
        ("torque", "u1"),
        ("error", "u1"),
        ("watchdog", "i1"),
        ("voltage", "<u2"),
        ("temperature", "u1"),
    ]
)
"""The registers of `startup.health_registers`, seen through indirect addresses."""

PIN = np.dtype([("level", "u1"), ("torque", "u1"), ("error", "u1"), ("watchdog", "i1"), ("position", "<i4")])
"""The registers of `startup.pin_registers`."""

JUMP_TURNS = 0.5
SPEED_SLACK = 1.5
"""A position farther than that from the last one, at 1.5 times the no-load speed, has not been turned to."""

_ERROR_BITS = (
    (0x01, HardwareError.INPUT_VOLTAGE),
    (0x04, HardwareError.OVERHEATING),
    (0x08, HardwareError.ENCODER),
    (0x10, HardwareError.ELECTRICAL_SHOCK),
    (0x20, HardwareError.OVERLOAD),
)
"""Bits of Hardware Error Status (70) in the e-manual."""


def hardware_error(bits: int) -> HardwareError:
    """What the register's bits mean."""
    error = HardwareError.NONE
    for bit, meaning in _ERROR_BITS:
        if bits & bit:
            error |= meaning
    return error


_ERRORS = np.array([int(hardware_error(bits)) for bits in range(256)], dtype=np.uint8)


class Decoder:
    """Readings of some servos, in their order; remembers where each was last.

    Parameters
    ----------
    servos
        Of the hinges.
    """

    def __init__(self, servos: Sequence[HingeServo]) -> None:
        self._names = [servo.name for servo in servos]
        self._ids = [servo.id for servo in servos]
        self._amps = np.array([_amps_per_unit(servo) for servo in servos])
        self._fastest = SPEED_SLACK * np.array([servo.model.no_load_rad_s for servo in servos])
        self._last_rad = np.full(len(servos), np.nan)
        self._last_s = np.full(len(servos), np.nan)

    def forget(self) -> None:
        """Positions may have changed in ways that are no motion."""
        self._last_rad[:] = np.nan

    def state(self, replies: Replies, now: float) -> HingeReadings:
        """Readings of the hinges.

        Raises
        ------
        ActuatorRestarted
            A position is not where its shaft can have turned to.
        """
        valid, data = self._rows(replies, STATE)
        nan = np.nan
        position = np.where(valid, (data["position"] - float(CENTRE_COUNT)) * RAD_PER_COUNT, nan)
        self._refuse_jumps(position, now)
        by_id = replies.by_id
        return HingeReadings(
            position_rad=position,
            velocity_rad_s=np.where(valid, data["velocity"] * (VELOCITY_UNIT_RPM * RPM), nan),
            current_a=np.where(valid, np.abs(data["effort"].astype(np.float64)) * self._amps, nan),
            alert=np.array([i in by_id and by_id[i].alert for i in self._ids]),
            valid=valid,
            time_s=np.where(valid, now, nan),
        )

    def health(self, replies: Replies, now: float, watchdog_s: float) -> HealthReadings:
        """Temperatures, voltages, errors, torque.

        Raises
        ------
        ActuatorRestarted
            A servo's health block is not set up any more.
        WatchdogTripped
            A servo has stopped because it heard nothing for `watchdog_s`.
        """
        valid, data = self._rows(replies, HEALTH)
        lost = valid & (data["level"] != KEPT_RETURN_LEVEL)
        if lost.any():
            raise ActuatorRestarted(
                self._names[int(np.argmax(lost))],
                "its settings are those of a restart, its torque is off; remedy: check its supply",
            )
        tripped = valid & (data["watchdog"] < 0)
        if tripped.any():
            raise WatchdogTripped(
                self._names[int(np.argmax(tripped))],
                f"heard nothing for {watchdog_s:g} s and stopped where it was; remedy: check the cable and what else "
                "loads the computer",
            )
        return HealthReadings(
            temperature_c=np.where(valid, data["temperature"].astype(np.float64), np.nan),
            voltage_v=np.where(valid, data["voltage"] * VOLTAGE_UNIT_V, np.nan),
            hardware_error=np.where(valid, _ERRORS[data["error"]], 0).astype(np.uint8),
            torque_on=valid & (data["torque"] == 1),
            valid=valid,
            time_s=np.where(valid, now, np.nan),
        )

    def _refuse_jumps(self, position: FloatArray, now: float) -> None:
        """A shaft that is where it cannot have turned to belongs to a servo that restarted."""
        reach = JUMP_TURNS * 2.0 * np.pi + self._fastest * (now - self._last_s)
        way = position - self._last_rad
        jumped = np.abs(way) > reach  # False for NaN
        known = np.isfinite(position)
        self._last_rad = np.where(known, position, self._last_rad)
        self._last_s = np.where(known, now, self._last_s)
        if jumped.any():
            k = int(np.argmax(jumped))
            raise ActuatorRestarted(
                self._names[k],
                f"its position jumped by {way[k] / (2.0 * np.pi):.2f} turns: it restarted and forgot its turns; "
                "remedy: check its supply, then say where the structure stands",
            )

    def _rows(self, replies: Replies, layout: np.dtype[np.void]) -> tuple[NDArray[np.bool_], NDArray[np.void]]:
        """Replies as an array in the order of the servos, and which of its rows are there."""
        size = layout.itemsize
        empty = bytes(size)
        by_id = replies.by_id
        raw = b"".join(by_id[i].data[:size] if i in by_id else empty for i in self._ids)
        return np.array([i in by_id for i in self._ids]), np.frombuffer(raw, dtype=layout)


def _amps_per_unit(servo: HingeServo) -> float:
    """Of the effort register; a load is turned into the current it stands for, which is an estimate."""
    if servo.model.current_unit_a is not None:
        return servo.model.current_unit_a
    return LOAD_UNIT * servo.model.stall_current_a
