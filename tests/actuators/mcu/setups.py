"""Small rigs on a microcontroller."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from ori_deploy.actuators.mcu.records import records
from ori_deploy.actuators.mcu.settings import McuSettings
from ori_deploy.actuators.mcu.wiring import McuWiring, resolve_wiring
from ori_deploy.actuators.rig import Actuator, Latch

SERVO: dict[str, Any] = {
    "pulse_zero_us": 1500.0,
    "pulse_us_per_rad": 400.0,
    "pulse_min_us": 500.0,
    "pulse_max_us": 2500.0,
}
FEEDBACK: dict[str, Any] = {
    "feedback_zero_rad": -3.0,
    "feedback_rad_per_count": 0.006,
    "feedback_low": 30,
    "feedback_high": 1000,
}
_SETTINGS = TypeAdapter(McuSettings)


def settings(**changes: Any) -> McuSettings:
    """Settings of a rig with templates for everything."""
    table: dict[str, Any] = {
        "port": "/dev/ttyNONE",
        "supply_divider": 3.0,
        "min_supply_v": 4.5,
        "boot_wait_s": 0.3,
        "each_hinge": {**SERVO, **FEEDBACK},
        "each_latch": {},
    }
    table.update(changes)
    return _SETTINGS.validate_python({key: value for key, value in table.items() if value is not None})


def actuator(name: str, **changes: Any) -> Actuator:
    """An actuator that goes from -2 to 2 rad."""
    limits: dict[str, Any] = {
        "max_velocity_rad_s": 3.0,
        "max_acceleration_rad_s2": 20.0,
        "max_torque_nm": 1.0,
        "min_position_rad": -2.0,
        "max_position_rad": 2.0,
    }
    return Actuator(id=name, **{**limits, **changes})


def magnet(name: str) -> Latch:
    """A passive one."""
    return Latch(id=name, secures="stow", kind="magnet")


def electromagnet(name: str) -> Latch:
    """One that must not stay on."""
    return Latch(id=name, secures="stow", kind="electromagnet", max_on_s=2.0, duty_cycle=0.25)


def lock_pin(name: str) -> Latch:
    """One that is driven."""
    return Latch(id=name, secures="stow", kind="lock_pin", travel_s=0.3)


def wiring(n_hinges: int = 3, latches: tuple[Latch, ...] = (), rate_hz: float = 50.0, **changes: Any) -> McuWiring:
    """Some hinges a, b, c ... and latches."""
    names = "abcdefghijklmnop"[:n_hinges]
    return resolve_wiring(settings(**changes), [actuator(name) for name in names], latches, rate_hz, "rig.toml")


def config(made: McuWiring) -> list[Any]:
    """Records for a scripted device."""
    return list(records(made))
