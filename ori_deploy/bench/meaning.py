"""What the number in a register means: SI units, and words where it is no quantity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ori_deploy.actuators.bus import HardwareError
from ori_deploy.actuators.dynamixel.readings import hardware_error
from ori_deploy.actuators.dynamixel.wiring import RAD_PER_COUNT
from ori_deploy.wire.dynamixel import BAUD_CODES, OperatingMode, Register, ServoModel
from ori_deploy.wire.dynamixel.models import RPM
from ori_deploy.wire.dynamixel.registers import (
    ACCELERATION_UNIT_RPM2,
    CENTRE_COUNT,
    LOAD_UNIT,
    RETURN_DELAY_UNIT_S,
    VELOCITY_UNIT_RPM,
    VOLTAGE_UNIT_V,
    WATCHDOG_TRIPPED,
    WATCHDOG_UNIT_S,
)

Unit = Literal["rad", "rad_s", "rad_s2", "a", "v", "c", "s", "fraction"]

PWM_FULL = 885
"""Value of the PWM registers that stands for all of the supply."""

TIME_BASED = 0x04
"""Bit of the drive mode: profile registers hold milliseconds, not speeds."""

_ABSOLUTE = ("max_position_limit", "min_position_limit", "goal_position", "present_position", "position_trajectory")
_RELATIVE = ("homing_offset",)
_SPEEDS = (
    "velocity_limit", "goal_velocity", "present_velocity", "velocity_trajectory", "profile_velocity",
    "moving_threshold",
)  # fmt: skip
_CURRENTS = ("current_limit", "goal_current", "present_current")
_VOLTAGES = ("max_voltage_limit", "min_voltage_limit", "present_input_voltage")
_TEMPERATURES = ("temperature_limit", "present_temperature")
_PWMS = ("pwm_limit", "goal_pwm", "present_pwm")


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a register says.

    Attributes
    ----------
    register, value
        As it is in the servo.
    si, unit
        The quantity, where it is one.
    words
        What it stands for, where it is none; "" where the number says it all.
    """

    register: Register
    value: int
    si: float | None = None
    unit: Unit | None = None
    words: str = ""


def meaning(model: ServoModel, register: Register, value: int, *, time_based: bool = False) -> Meaning:
    """What a value means in a register of a model.

    Parameters
    ----------
    time_based
        Whether the servo's drive mode has the time-based profile, which changes what the profile registers hold.
    """
    name = register.name
    if name == "bus_watchdog" and value == WATCHDOG_TRIPPED:
        return Meaning(register, value, words="tripped: it stopped where it was, and takes no goals")
    if name.startswith("profile_") and time_based:
        return Meaning(register, value, 1e-3 * value, "s")
    if name in _ABSOLUTE:
        return Meaning(register, value, (value - CENTRE_COUNT) * RAD_PER_COUNT, "rad")
    scale = _scale(model, name)
    if scale is not None:
        return Meaning(register, value, value * scale[0], scale[1])
    return Meaning(register, value, words=_words(name, value))


def _scale(model: ServoModel, name: str) -> tuple[float, Unit] | None:
    """Size and unit of one count of a register that holds a quantity."""
    scales: tuple[tuple[tuple[str, ...], float, Unit], ...] = (
        (_RELATIVE, RAD_PER_COUNT, "rad"),
        (_SPEEDS, VELOCITY_UNIT_RPM * RPM, "rad_s"),
        (("profile_acceleration",), ACCELERATION_UNIT_RPM2 * RPM / 60.0, "rad_s2"),
        (_CURRENTS, model.current_unit_a or 0.0, "a"),
        (_VOLTAGES, VOLTAGE_UNIT_V, "v"),
        (_TEMPERATURES, 1.0, "c"),
        (_PWMS, 1.0 / PWM_FULL, "fraction"),
        (("present_load",), LOAD_UNIT, "fraction"),
        (("return_delay_time",), RETURN_DELAY_UNIT_S, "s"),
        (("bus_watchdog",), WATCHDOG_UNIT_S, "s"),
        (("realtime_tick",), 1e-3, "s"),
    )
    return next(((size, unit) for names, size, unit in scales if name in names), None)


def _words(name: str, value: int) -> str:
    if name == "baud_rate":
        return next((f"{baud} baud" for baud, code in BAUD_CODES.items() if code == value), "unknown rate")
    if name == "operating_mode":
        known = value in tuple(OperatingMode)
        return OperatingMode(value).name.lower() if known else "unknown mode"
    if name == "hardware_error_status":
        return error_words(value)
    if name == "torque_enable":
        return "on" if value else "off"
    if name == "drive_mode":
        bits = (
            (0x01, "reversed"), (0x02, "follows another servo"), (TIME_BASED, "time-based profile"),
            (0x08, "a goal turns torque on"),
        )  # fmt: skip
        return ", ".join(text for bit, text in bits if value & bit) or "normal, velocity-based profile"
    if name == "status_return_level":
        return {0: "answers pings only", 1: "answers pings and reads", 2: "answers everything"}.get(value, "unknown")
    return ""


_ERROR_WORDS = {
    HardwareError.INPUT_VOLTAGE: "input voltage",
    HardwareError.OVERHEATING: "overheating",
    HardwareError.ENCODER: "encoder",
    HardwareError.ELECTRICAL_SHOCK: "electrical shock",
    HardwareError.OVERLOAD: "overload",
}


def error_words(bits: int) -> str:
    """Hardware errors by name, from the bits of the register."""
    error = hardware_error(bits)
    names = [text for flag, text in _ERROR_WORDS.items() if error & flag]
    if not names:
        return "none" if bits == 0 else f"unknown ({bits:#04x})"
    return ", ".join(names)
