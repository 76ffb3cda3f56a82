"""The configuration of a microcontroller: its records, and the hash by which both sides know that they agree.

Seconds, radians and volts become the whole numbers of the wire here, and nowhere else.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from math import ceil, floor

from ori_deploy.actuators.mcu.wiring import Hinge, Latch, McuWiring
from ori_deploy.wire.mcu import ConfigDevice, ConfigHinge, ConfigLatch, dialect, full_payload

Record = ConfigDevice | ConfigHinge | ConfigLatch

SCHEMA = 1
ADC_COUNTS = 1024
NONE = 255
"""A latch without a sensor."""

POSITION_SLACK_RAD = 1e-3
VELOCITY_SLACK_RAD_S = 5e-3
ACCELERATION_SLACK_RAD_S2 = 0.5
"""What rounding to the wire's units may add: a knot's velocity is a multiple of 1 mrad/s, and half of that at
both ends of 20 ms is 0.15 rad/s^2."""

CLOCK_SLACK = 0.01
"""The device measures by its own seconds, which may be 0.5 % longer, and the host may shorten the spacing of
knots by a quarter percent."""

STOP_SHARE = 2.0
"""A stop along the path may take as much acceleration again as the plan (`ori_deploy.deploy.motion.rate_slew`)."""

_KINDS = {"magnet": dialect.ORI_MAGNET, "electromagnet": dialect.ORI_ELECTROMAGNET, "lock_pin": dialect.ORI_LOCK_PIN}


def device_velocity(max_velocity_rad_s: float) -> float:
    """Fastest that the device lets a hinge go whose actuator may go so fast."""
    return max_velocity_rad_s * (1.0 + CLOCK_SLACK) + VELOCITY_SLACK_RAD_S


def device_acceleration(max_acceleration_rad_s2: float) -> float:
    """Steepest that the device lets a hinge go whose actuator has this acceleration limit."""
    return STOP_SHARE * max_acceleration_rad_s2 * (1.0 + 2.0 * CLOCK_SLACK) + ACCELERATION_SLACK_RAD_S2


def records(wiring: McuWiring) -> tuple[Record, ...]:
    """All records of a configuration, tokens 0: the device's, those of its hinges, those of its latches."""
    return (
        _device(wiring),
        *(_hinge(k, hinge) for k, hinge in enumerate(wiring.hinges)),
        *(_latch(k, latch) for k, latch in enumerate(wiring.latches)),
    )


def device_record(config: Sequence[Record]) -> ConfigDevice | None:
    """The device's own record, or None without a configuration."""
    return config[0] if config and isinstance(config[0], ConfigDevice) else None


def config_hash(config: Sequence[Record]) -> int:
    """CRC-32 of the payloads of all records; they have token 0."""
    crc = 0
    for record in config:
        crc = zlib.crc32(full_payload(record), crc)
    return crc


def _device(wiring: McuWiring) -> ConfigDevice:
    settings = wiring.settings
    per_count_v = settings.supply_divider * settings.adc_reference_v / ADC_COUNTS
    return ConfigDevice(
        supply_uv_per_count=round(1e6 * per_count_v),
        stall_urad=round(1e6 * settings.stall_rad),
        seat_urad=round(1e6 * settings.seat_rad),
        stall_ms=round(1e3 * settings.stall_s),
        silence_ms=round(1e3 * settings.silence_s),
        brake_ms=round(1e3 * settings.brake_s),
        supply_min_mv=round(1e3 * settings.min_supply_v),
        token=0,
        schema=SCHEMA,
        hinges=len(wiring.hinges),
        latches=len(wiring.latches),
    )


def _hinge(index: int, hinge: Hinge) -> ConfigHinge:
    servo = hinge.servo
    return ConfigHinge(
        min_urad=floor(1e6 * (hinge.min_rad - POSITION_SLACK_RAD)),
        max_urad=ceil(1e6 * (hinge.max_rad + POSITION_SLACK_RAD)),
        pulse_zero_ns=round(1e3 * servo.pulse_zero_us),
        pulse_slope_ns=round(1e3 * servo.pulse_us_per_rad),
        feedback_zero_urad=round(1e6 * (servo.feedback_zero_rad or 0.0)),
        feedback_slope_nrad=round(1e9 * (servo.feedback_rad_per_count or 0.0)),
        max_acceleration_mrad_s2=ceil(1e3 * device_acceleration(hinge.max_acceleration_rad_s2)),
        max_velocity_mrad_s=ceil(1e3 * device_velocity(hinge.max_velocity_rad_s)),
        pulse_min_us=round(servo.pulse_min_us),
        pulse_max_us=round(servo.pulse_max_us),
        feedback_low=servo.feedback_low or 0,
        feedback_high=servo.feedback_high or 0,
        token=0,
        index=index,
        channel=hinge.output,
        adc=hinge.feedback or 0,
        flags=0 if hinge.feedback is None else dialect.ORI_HINGE_HAS_FEEDBACK,
    )


def _latch(index: int, latch: Latch) -> ConfigLatch:
    pin = latch.kind == "lock_pin"
    return ConfigLatch(
        max_on_ms=round(1e3 * latch.max_on_s),
        duty_permille=max(1, round(1e3 * latch.duty_cycle)),
        travel_ms=round(1e3 * latch.travel_s),
        engaged_us=round(latch.drive.engaged_us or 0.0) if pin else 0,
        released_us=round(latch.drive.released_us or 0.0) if pin else 0,
        debounce_ms=max(1, round(1e3 * latch.drive.debounce_s)),
        token=0,
        index=index,
        kind=_KINDS[latch.kind],
        output=latch.output or 0,
        sensor=NONE if latch.sensor is None else latch.sensor,
        flags=dialect.ORI_LATCH_SENSOR_HIGH if latch.drive.sensor_high else 0,
    )
