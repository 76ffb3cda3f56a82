"""Hinges on one bus, latches on that one or on another: servos that tell much, and magnets that need a switch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import ActuatorBus, BusClosed, HealthReadings, HingeReadings, LatchReading

FloatArray = NDArray[np.float64]

_P = ParamSpec("_P")
_R = TypeVar("_R")


def _noticing_loss(method: Callable[Concatenate[MixedBus, _P], _R]) -> Callable[Concatenate[MixedBus, _P], _R]:
    """When one of the buses is gone, both are let go of: half a structure is not to be driven."""

    @wraps(method)
    def noticing(self: MixedBus, /, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        try:
            return method(self, *args, **kwargs)
        except BusClosed:
            self._connected = False
            self._close()
            raise

    return noticing


class MixedBus(ActuatorBus):
    """Two buses as one.

    Parameters
    ----------
    hinges
        Has all the hinges, and maybe some latches.
    others
        Has the rest of the latches, and no hinges.
    latch_ids
        All latches, in the order of the readings.
    position_limits_rad
        (n_hinges, 2) as in `ActuatorBus`.
    """

    def __init__(
        self, hinges: ActuatorBus, others: ActuatorBus, latch_ids: Sequence[str], position_limits_rad: FloatArray
    ) -> None:
        super().__init__(hinges.hinge_ids, latch_ids, position_limits_rad)
        if others.hinge_ids or sorted(latch_ids) != sorted(hinges.latch_ids + others.latch_ids):
            raise ValueError(
                f"latches {', '.join(latch_ids)} on buses with {', '.join(hinges.latch_ids) or 'none'} "
                f"and {', '.join(others.latch_ids) or 'none'}"
            )
        self._hinges, self._others = hinges, others

    @property
    def delay_s(self) -> float:
        """That of the hinges."""
        return self._hinges.delay_s

    @property
    def brake_s(self) -> float:
        """That of the hinges."""
        return self._hinges.brake_s

    @property
    def limits_effort(self) -> bool:
        """Whether the hinges' bus does."""
        return self._hinges.limits_effort

    @_noticing_loss
    def unvouched(self) -> tuple[str, ...]:
        """Hinges of which nobody knows where they stand."""
        self._require_connection()
        return self._hinges.unvouched()

    @_noticing_loss
    def vouch(self, shaft_rad: FloatArray, tolerance_rad: FloatArray) -> None:
        """Pass somebody's word on to the hinges' bus."""
        self._require_connection()
        self._hinges.vouch(shaft_rad, tolerance_rad)

    def _open(self) -> None:
        self._others.connect()
        try:
            self._hinges.connect()
        except BaseException:
            self._others.close()
            raise
        self.advice = self._hinges.advice + self._others.advice

    def _close(self) -> None:
        try:
            self._hinges.close()
        finally:
            self._others.close()

    @_noticing_loss
    def _write_goals(self, position_rad: FloatArray, velocity_rad_s: FloatArray | None = None) -> None:
        self._hinges.command_hinges(position_rad, velocity_rad_s)

    @_noticing_loss
    def _brake(self) -> float:
        return self._hinges.brake()

    @_noticing_loss
    def _limit_effort(self, part: float) -> None:
        self._hinges.limit_effort(part)

    @_noticing_loss
    def _set_torque(self, on: bool) -> None:
        self._hinges._require_connection()
        self._hinges._set_torque(on)  # at the goals that were just written

    @_noticing_loss
    def _read_hinges(self) -> HingeReadings:
        return self._hinges.read_hinges()

    @_noticing_loss
    def _read_health(self) -> HealthReadings:
        self._others.read_health()  # raises what is latched there, such as its emergency stop
        return self._hinges.read_health()

    @_noticing_loss
    def _reset_errors(self) -> None:
        self._others.reset_errors()
        self._hinges.reset_errors()

    @_noticing_loss
    def _set_latch(self, index: int, engaged: bool) -> None:
        name = self.latch_ids[index]
        bus = self._others if name in self._others.latch_ids else self._hinges
        if engaged:
            bus.engage(name)
        else:
            bus.release(name)

    @_noticing_loss
    def _read_latches(self) -> tuple[LatchReading, ...]:
        buses = [bus for bus in (self._hinges, self._others) if bus.latch_ids]
        by_id = {reading.id: reading for bus in buses for reading in bus.read_latches()}
        return tuple(by_id[name] for name in self.latch_ids)
