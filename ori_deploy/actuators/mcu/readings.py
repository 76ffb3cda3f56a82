"""From what the device reports to readings in SI units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import (
    BusTimeout,
    CommandRefused,
    CorruptReply,
    HardwareError,
    HealthReadings,
    HingeReadings,
)
from ori_deploy.actuators.mcu.records import ADC_COUNTS
from ori_deploy.actuators.mcu.settings import Thermistor
from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.wire.mcu import State, dialect

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

ZERO_CELSIUS_K = 273.15
NTC_K = 25.0 + ZERO_CELSIUS_K

THERMISTOR_LOW, THERMISTOR_HIGH = 20, 1003
"""Counts beyond these are a short circuit, or an open wire."""

SMOOTHING = 0.5
"""Share of the newest difference in a velocity."""

FORGET_S = 0.5
"""Positions farther apart in time tell nothing of the velocity now."""


def bits(mask: int, n: int) -> BoolArray:
    """(n,) bits of a mask, the lowest first."""
    return np.array([bool(mask >> k & 1) for k in range(n)], dtype=np.bool_)


def temperature_c(count: int, thermistor: Thermistor) -> float:
    """Temperature that a count of the thermistor's input stands for; NaN where it cannot be."""
    if not THERMISTOR_LOW <= count <= THERMISTOR_HIGH:
        return float("nan")
    ohm = thermistor.series_ohm * count / (ADC_COUNTS - count)
    kelvin = 1.0 / (1.0 / NTC_K + np.log(ohm / thermistor.r25_ohm) / thermistor.beta_k)
    return float(kelvin) - ZERO_CELSIUS_K


def stalls_only(state: State) -> bool:
    """Whether the latched fault is told by the hinges that stalled, and needs no other telling."""
    return bool(state.fault == dialect.ORI_FAULT_STALL and state.stalled)


class Decoder:
    """Readings of the hinges of one device; remembers where they were last.

    Parameters
    ----------
    wiring
        Which hinge is which.
    """

    def __init__(self, wiring: McuWiring) -> None:
        self._n = len(wiring.hinges)
        self._thermistor = wiring.settings.thermistor
        self._blind = np.array([hinge.feedback is None for hinge in wiring.hinges], dtype=np.bool_)
        self.vouched_rad = np.full(self._n, np.nan)
        self.forget()

    @property
    def blind(self) -> BoolArray:
        """(n_hinges,) which have no feedback."""
        return self._blind

    def forget(self) -> None:
        """Positions may have changed in ways that are no motion."""
        self._last_rad = np.full(self._n, np.nan)
        self._last_s = np.nan
        self._velocity = np.zeros(self._n)

    def hinges(self, state: State, time_s: float, *, alarm: bool) -> HingeReadings:
        """Readings of the hinges.

        Parameters
        ----------
        time_s
            When the device took them, by the host's clock.
        alarm
            Something is wrong with the whole device.

        Raises
        ------
        BusTimeout
            Every feedback wire is open.
        CorruptReply
            No feedback can be believed.
        """
        position = self._positions(state)
        valid = np.isfinite(position)
        self._require_any(valid, state)
        self._follow(position, 1e-6 * state.time_us)
        wrong = np.ones(self._n, dtype=np.bool_) if alarm else bits(state.stalled, self._n)
        return HingeReadings(
            position_rad=position,
            velocity_rad_s=np.where(valid, self._velocity, np.nan),
            current_a=np.full(self._n, np.nan),
            alert=valid & wrong,
            valid=valid,
            time_s=np.where(valid, time_s, np.nan),
        )

    def health(self, state: State, time_s: float) -> HealthReadings:
        """Temperature and voltage are those of all servos together. Raises as `hinges` does."""
        valid = np.isfinite(self._positions(state)) | self._blind
        self._require_any(valid, state)
        wrong = self.thermistor_error(state)
        if wrong is not None:
            raise wrong
        celsius = temperature_c(state.temperature_count, self._thermistor)
        stalled = bits(state.stalled, self._n)
        return HealthReadings(
            temperature_c=np.where(valid, celsius, np.nan),
            voltage_v=np.where(valid, 1e-3 * state.supply_mv, np.nan),
            hardware_error=np.where(valid & stalled, int(HardwareError.OVERLOAD), 0).astype(np.uint8),
            torque_on=valid & bits(state.outputs_on, self._n),
            valid=valid,
            time_s=np.where(valid, time_s, np.nan),
        )

    def thermistor_error(self, state: State) -> CorruptReply | None:
        """What is wrong with the thermistor, where there are hinges that it is wanted for."""
        count = state.temperature_count
        if not self._n or THERMISTOR_LOW <= count <= THERMISTOR_HIGH:
            return None
        found = "short circuit" if count < THERMISTOR_LOW else "no thermistor, or an open wire"
        return CorruptReply(
            f"{found} at A13: it reads {count} counts; limit: {THERMISTOR_LOW} to {THERMISTOR_HIGH}; "
            "remedy: check the thermistor and its resistor, or put 10 kohm in its place"
        )

    def require_borne_out(
        self, readings: HingeReadings, names: Sequence[str], shaft_rad: FloatArray, tolerance_rad: FloatArray
    ) -> None:
        """Check somebody's word for where the shafts stand against those that are measured.

        Raises
        ------
        CommandRefused
            A shaft is measured elsewhere, or does not say where it is.
        """
        known = readings.valid | self._blind
        if not known.all():
            lost = ", ".join(name for name, is_known in zip(names, known, strict=True) if not is_known)
            raise CommandRefused(f"no valid position from {lost}; remedy: check its feedback wire")
        off = np.where(readings.valid, np.abs(readings.position_rad - shaft_rad), 0.0)
        off = np.where(self._blind & np.isfinite(self.vouched_rad), 0.0, off)  # a new word for an old
        if (off > tolerance_rad).any():
            k = int(np.argmax(off - tolerance_rad))
            raise CommandRefused(
                f"{names[k]} is not where the structure is said to stand: measured {off[k]:.3f} rad from there; "
                f"limit: {tolerance_rad[k]:.3f} rad; remedy: bring it there, or say where it does stand"
            )

    def _positions(self, state: State) -> FloatArray:
        """(n_hinges,) measured; where there is no feedback the output, or what was vouched for; NaN if not known."""
        n = self._n
        measured = np.where(bits(state.sensed, n), 1e-6 * np.array(state.position_urad[:n], dtype=np.float64), np.nan)
        output = 1e-6 * np.array(state.output_urad[:n], dtype=np.float64)
        believed = np.where(bits(state.outputs_on, n), output, self.vouched_rad)
        position: FloatArray = np.where(self._blind, believed, measured)
        return position

    def _require_any(self, valid: BoolArray, state: State) -> None:
        measured = ~self._blind
        if valid.any() or not measured.any():
            return
        if bits(state.silent, self._n)[measured].all():
            raise BusTimeout("hinges: every feedback wire is open; remedy: check the servos' supply and wires")
        raise CorruptReply(
            "hinges: no feedback can be believed; remedy: check the feedback wires and the calibration"
        )

    def _follow(self, position: FloatArray, device_s: float) -> None:
        """Velocities from differences, smoothed a little."""
        step = device_s - self._last_s
        if step < 1e-3:  # the same report again
            return
        rate = (position - self._last_rad) / step
        known = np.isfinite(rate) & (step <= FORGET_S)
        smooth = SMOOTHING * np.where(known, rate, 0.0) + (1.0 - SMOOTHING) * self._velocity
        self._velocity = np.where(known, smooth, 0.0)
        self._last_rad, self._last_s = position, device_s
