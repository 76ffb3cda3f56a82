"""The abstract actuator bus: hinges, latches and their sensors, whatever carries the bytes.

A backend implements the small methods whose names begin with an underscore. What must hold for every
backend is written once, here: nothing goes out before `connect`, no goal goes out that is not a finite
number inside its range, and torque never goes on before the goal is the measured position.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from ori_deploy.errors import OriDeployError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class BusError(OriDeployError):
    """Base of everything a bus call can raise."""


class BusTimeout(BusError):
    """No actuator answered in time; the link itself may be fine."""


class CorruptReply(BusError):
    """Something answered, and none of it could be believed."""


class BusClosed(BusError):
    """Not connected, or unplugged while connected. `connect` must succeed before anything else can."""


class CommandRefused(BusError):
    """The command was not sent, or was refused by the device; nothing has moved because of it."""

    refused = True


class ActuatorFault(BusError):
    """An actuator reports a fault of its own.

    Attributes
    ----------
    actuator_id
        The hinge actuator or latch that reports it.
    """

    def __init__(self, actuator_id: str, message: str) -> None:
        super().__init__(f"{actuator_id}: {message}")
        self.actuator_id = actuator_id


class ActuatorRestarted(ActuatorFault):
    """An actuator restarted: its torque is off, and it may have forgotten how many turns it had made."""


class WatchdogTripped(ActuatorFault):
    """An actuator heard nothing for too long and stopped where it was; it takes no goals until that is cleared."""


class LatchTripped(ActuatorFault):
    """A latch shut itself off to protect itself, and refuses to work until it has recovered."""


class HardwareError(IntFlag):
    """What an actuator can find wrong with itself."""

    NONE = 0
    INPUT_VOLTAGE = 1
    OVERHEATING = 2
    ENCODER = 4
    ELECTRICAL_SHOCK = 8
    OVERLOAD = 16


@dataclass(frozen=True, slots=True, eq=False)
class HingeReadings:
    """One reading of every hinge; arrays have shape (n_hinges,).

    Attributes
    ----------
    position_rad, velocity_rad_s
        Of the actuator's shaft; NaN where not valid.
    current_a
        Magnitude of the motor current; NaN where not valid.
    alert
        The actuator says that `read_health` has a hardware error to tell; False where not valid.
    valid
        Whether this hinge answered, and correctly.
    time_s
        When the reading was taken, on the bus's clock; NaN where not valid.
    """

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    current_a: FloatArray
    alert: BoolArray
    valid: BoolArray
    time_s: FloatArray

    @classmethod
    def none(cls, n_hinges: int) -> HingeReadings:
        """Readings in which no hinge answered."""
        nan = np.full(n_hinges, np.nan)
        false = np.zeros(n_hinges, dtype=np.bool_)
        return cls(nan, nan, nan, false, false, nan)


CLOCK_SLACK_S = 1e-3
"""How far in the future a reading's time may lie; beyond it the clocks do not agree."""


def believable(readings: HingeReadings, now: float, max_age_s: float) -> BoolArray:
    """Which hinges' positions may be acted on: (n_hinges,) valid, a number, and of now.

    Written so that whatever is not a number is not believed.
    """
    age = now - readings.time_s
    fresh: BoolArray = (age >= -CLOCK_SLACK_S) & (age <= max_age_s)
    return readings.valid & np.isfinite(readings.position_rad) & fresh


@dataclass(frozen=True, slots=True, eq=False)
class HealthReadings:
    """What changes slowly, read less often; arrays have shape (n_hinges,).

    Attributes
    ----------
    temperature_c, voltage_v
        NaN where not valid.
    hardware_error
        `HardwareError` bits; 0 where not valid.
    torque_on
        Whether the actuator holds its goal; False where not valid. An actuator that restarted has it off.
    valid, time_s
        As in `HingeReadings`.
    """

    temperature_c: FloatArray
    voltage_v: FloatArray
    hardware_error: NDArray[np.uint8]
    torque_on: BoolArray
    valid: BoolArray
    time_s: FloatArray

    @classmethod
    def none(cls, n_hinges: int) -> HealthReadings:
        """Readings in which no hinge answered."""
        nan = np.full(n_hinges, np.nan)
        false = np.zeros(n_hinges, dtype=np.bool_)
        return cls(nan, nan, np.zeros(n_hinges, dtype=np.uint8), false, false, nan)

    @property
    def sound(self) -> BoolArray:
        """(n_hinges,) which answered with numbers."""
        return self.valid & np.isfinite(self.temperature_c) & np.isfinite(self.voltage_v)


@dataclass(frozen=True, slots=True)
class LatchReading:
    """What one latch and its sensor say.

    Attributes
    ----------
    id
        The latch.
    engaged
        The last command it accepted.
    confirmed
        Whether the sensor sees the latch closed; None when the sensor cannot tell.
    valid
        Whether the reading arrived; `confirmed` is None when it did not.
    time_s
        When it was taken; NaN when not valid.
    fault
        Why the latch shut itself off, or None.
    """

    id: str
    engaged: bool
    confirmed: bool | None
    valid: bool
    time_s: float
    fault: str | None = None


class ActuatorBus(ABC):
    """Hinge actuators and latches behind one connection.

    Parameters
    ----------
    hinge_ids, latch_ids
        Names, in the order of every array and tuple of readings.
    position_limits_rad
        (n_hinges, 2) smallest and largest goal of every shaft; finite.

    Attributes
    ----------
    advice
        What `connect` found that works and could work better, or that has to be dealt with before a motion.
    """

    advice: tuple[str, ...] = ()

    def __init__(self, hinge_ids: Sequence[str], latch_ids: Sequence[str], position_limits_rad: FloatArray) -> None:
        limits = np.array(position_limits_rad, dtype=np.float64)
        if limits.shape != (len(hinge_ids), 2) or not np.isfinite(limits).all():
            raise ValueError(f"position limits must be finite, shape ({len(hinge_ids)}, 2)")
        self.hinge_ids = tuple(hinge_ids)
        self.latch_ids = tuple(latch_ids)
        self._lower, self._upper = limits.T.copy()
        self._connected = False

    @property
    def connected(self) -> bool:
        """Whether `connect` succeeded and neither `close` nor an unplugging followed."""
        return self._connected

    def connect(self) -> None:
        """Open the link and check that every actuator is there. Nothing moves, torque stays as it is.

        Raises
        ------
        BusClosed
            There is nothing to connect to.
        BusTimeout
            An actuator is missing; the message names it.
        """
        if not self._connected:
            self._open()
            self._connected = True

    def close(self) -> None:
        """Close the link. Actuators keep their goal and torque. Safe to call twice."""
        if self._connected:
            self._connected = False
            self._close()

    def enable_torque(self, readings: HingeReadings | None = None) -> FloatArray:
        """Turn torque on where every hinge stands: the goal is the measured position, the effort not limited.

        Parameters
        ----------
        readings
            Where they stand, for callers that have a clock and judged the readings' age by it; without
            them the hinges are read here.

        Returns
        -------
        (n_hinges,) the goals that were set.

        Raises
        ------
        CommandRefused
            A hinge does not say where it is, or stands outside its range; no torque went on.
        """
        self._require_connection()
        readings = self.read_hinges() if readings is None else readings
        known = readings.valid & np.isfinite(readings.position_rad)
        if not known.all():
            raise CommandRefused(
                f"torque stays off: no valid position from {self._names(~known)}; remedy: check its power and wiring"
            )
        self._check_goals(readings.position_rad)
        self._write_goals(readings.position_rad, None)
        if self.limits_effort:
            self._limit_effort(1.0)
        self._set_torque(True)
        return readings.position_rad

    def disable_torque(self) -> None:
        """Let every hinge go limp. Latches stay as they are."""
        self._require_connection()
        self._set_torque(False)

    @property
    def limits_effort(self) -> bool:
        """Whether `limit_effort` limits anything; hobby servos push with all they have, whatever they are told."""
        return False

    def limit_effort(self, part: float) -> None:
        """Let hinges push with at most this part of what they otherwise may, until `enable_torque` or the next call.

        A bus that cannot, see `limits_effort`, does nothing.

        Parameters
        ----------
        part
            Above 0, up to 1, which is no limit. Servos whose voltage is limited turn slower in proportion, too.

        Raises
        ------
        CommandRefused
            It is no such part; the limit stays as it was.
        """
        self._require_connection()
        if not 0.0 < part <= 1.0:  # true for NaN as well
            raise CommandRefused(
                f"effort is {part:g} of what hinges may; limit: above 0, up to 1; remedy: 0.5 is half as strong"
            )
        if self.limits_effort:
            self._limit_effort(part)

    def unvouched(self) -> tuple[str, ...]:
        """Hinges of which nobody knows where they stand before `vouch`; none where all sensors know."""
        self._require_connection()
        return ()

    def vouch(self, shaft_rad: FloatArray, tolerance_rad: FloatArray) -> None:
        """Take somebody's word for where the structure stands, where sensors alone cannot tell.

        Parameters
        ----------
        shaft_rad, tolerance_rad
            (n_hinges,) where the shafts are said to stand, and how far off they may be measured.

        Raises
        ------
        CommandRefused
            It is measured elsewhere.
        """
        del shaft_rad, tolerance_rad
        self._require_connection()

    @property
    def delay_s(self) -> float:
        """About how long after `command_hinges` a goal is due: 0 unless the bus queues goals ahead."""
        return 0.0

    def due_s(self, now: float) -> float:
        """When the goal that was commanded last is due, on the bus's clock; `now` is when it was commanded."""
        return now + self.delay_s

    @property
    def brake_s(self) -> float:
        """How long `brake` takes from full speed to rest; 0 for a bus that queues nothing."""
        return 0.0

    def command_hinges(self, position_rad: FloatArray, velocity_rad_s: FloatArray | None = None) -> None:
        """Send a goal to every hinge.

        Parameters
        ----------
        position_rad
            (n_hinges,) shaft positions.
        velocity_rad_s
            (n_hinges,) how fast the shafts move there, for buses that interpolate; None to come to rest.

        Raises
        ------
        CommandRefused
            A goal is not finite or outside its range. None of the goals was sent.
        BusClosed
            The link is gone.
        """
        self._require_connection()
        self._check_goals(position_rad)
        if velocity_rad_s is not None and not (
            np.shape(velocity_rad_s) == self._lower.shape and np.isfinite(velocity_rad_s).all()
        ):
            raise CommandRefused(f"velocities must be finite, shape {self._lower.shape}; nothing was sent")
        self._write_goals(position_rad, velocity_rad_s)

    def brake(self) -> float:
        """Come to rest at once along the goals that are queued, and take no more before `enable_torque`.

        Returns
        -------
        Seconds until everything rests. A bus that queues nothing has nothing to do: its hinges hold the last goal.
        """
        self._require_connection()
        return self._brake()

    def read_hinges(self) -> HingeReadings:
        """Read every hinge. A hinge that fails alone comes back invalid.

        Raises
        ------
        BusTimeout, CorruptReply
            No hinge gave a valid answer.
        BusClosed
            The link is gone.
        """
        self._require_connection()
        return self._read_hinges()

    def read_health(self) -> HealthReadings:
        """Read temperatures, voltages, hardware errors and torque. Raises as `read_hinges` does."""
        self._require_connection()
        return self._read_health()

    def reset_errors(self) -> None:
        """Acknowledge hardware errors whose cause has passed. Torque of those hinges stays off.

        Raises
        ------
        CommandRefused
            A cause persists; the message names the actuator and the cause.
        """
        self._require_connection()
        self._reset_errors()

    def engage(self, latch_id: str) -> None:
        """Command a latch to close. Closing is confirmed by its sensor, never by this call.

        Raises
        ------
        CommandRefused
            There is no such latch.
        LatchTripped
            The latch is protecting itself and stays off.
        """
        self._require_connection()
        self._set_latch(self._latch_index(latch_id), True)

    def release(self, latch_id: str) -> None:
        """Command a latch to open. A passive magnet accepts it and opens when it is pulled apart."""
        self._require_connection()
        self._set_latch(self._latch_index(latch_id), False)

    def read_latches(self) -> tuple[LatchReading, ...]:
        """Read every latch, in the order of `latch_ids`. Raises as `read_hinges` does."""
        self._require_connection()
        return self._read_latches()

    def _check_goals(self, goals: FloatArray) -> None:
        if np.shape(goals) != self._lower.shape:
            raise CommandRefused(f"goals have shape {np.shape(goals)}; expected {self._lower.shape}")
        inside = (goals >= self._lower) & (goals <= self._upper)  # False for NaN as well
        if not inside.all():
            i = int(np.flatnonzero(~inside)[0])
            raise CommandRefused(
                f"goal of {self.hinge_ids[i]} is {goals[i]:.6g} rad; "
                f"limit: {self._lower[i]:.6g} to {self._upper[i]:.6g} rad; nothing was sent"
            )

    def _latch_index(self, latch_id: str) -> int:
        if latch_id not in self.latch_ids:
            raise CommandRefused(f"there is no latch {latch_id!r}; latches: {', '.join(self.latch_ids)}")
        return self.latch_ids.index(latch_id)

    def _require_connection(self) -> None:
        if not self._connected:
            raise BusClosed("the bus is not connected")

    def _names(self, mask: BoolArray) -> str:
        return ", ".join(self.hinge_ids[i] for i in np.flatnonzero(mask))

    def _brake(self) -> float:
        return 0.0

    def _limit_effort(self, part: float) -> None:
        raise NotImplementedError(f"{type(self).__name__} says that it limits effort, and does not")

    @abstractmethod
    def _open(self) -> None: ...

    @abstractmethod
    def _close(self) -> None: ...

    @abstractmethod
    def _write_goals(self, position_rad: FloatArray, velocity_rad_s: FloatArray | None) -> None: ...

    @abstractmethod
    def _set_torque(self, on: bool) -> None: ...

    @abstractmethod
    def _read_hinges(self) -> HingeReadings: ...

    @abstractmethod
    def _read_health(self) -> HealthReadings: ...

    @abstractmethod
    def _reset_errors(self) -> None: ...

    @abstractmethod
    def _set_latch(self, index: int, engaged: bool) -> None: ...

    @abstractmethod
    def _read_latches(self) -> tuple[LatchReading, ...]: ...
