"""What a rig file says of a Dynamixel bus: tables `[dynamixel]` and `[[dynamixel.servo]]`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator
from pydantic.dataclasses import dataclass

from ori_deploy.actuators.numbers import STRICT, Finite, Name, NonNegative, Positive, at_most, between
from ori_deploy.wire.dynamixel import BAUD_CODES, MODELS, model_named
from ori_deploy.wire.dynamixel.registers import WATCHDOG_UNIT_S

Mode = Literal["auto", "position", "extended_position", "current_based_position"]

LONGEST_WATCHDOG_S = 127 * WATCHDOG_UNIT_S


def _known_baud(value: int) -> int:
    if value not in BAUD_CODES:
        raise ValueError(f"one of {', '.join(str(baud) for baud in BAUD_CODES)}")
    return value


def _known_model(value: str) -> str:
    try:
        return model_named(value).name
    except KeyError:
        raise ValueError(f"one of {', '.join(model.name for model in MODELS)}") from None


def _whole_watchdog(value: float) -> float:
    units = value / WATCHDOG_UNIT_S
    if value and abs(units - round(units)) > 1e-6:
        raise ValueError(f"a multiple of {WATCHDOG_UNIT_S:g} s, which is what a servo counts in")
    return value


ServoId = Annotated[int, Field(ge=0, le=252, strict=True)]
ModelName = Annotated[Name, AfterValidator(_known_model)]
_Baud = Annotated[int, Field(strict=True), AfterValidator(_known_baud)]
_Watchdog = Annotated[
    NonNegative,
    AfterValidator(_whole_watchdog),
    at_most(LONGEST_WATCHDOG_S, "a servo cannot count farther"),
]
_Latency = Annotated[NonNegative, at_most(0.02, "no adapter waits longer; see ori-deploy doctor")]
_Slack = Annotated[Positive, between(0.0005, 0.2, "shorter loses good replies, longer stalls the loop")]


@dataclass(frozen=True, config=STRICT, kw_only=True)
class ServoEntry:
    """Who one servo is, where the template does not fit.

    Attributes
    ----------
    actuator, latch
        The actuator that it is, or the lock pin that it drives; one of the two.
    id, model
        On the bus; without a model that of `[dynamixel]`.
    engaged_rad, released_rad
        A lock pin's two shaft positions.
    """

    id: ServoId
    actuator: Name | None = None
    latch: Name | None = None
    model: ModelName | None = None
    engaged_rad: Finite | None = None
    released_rad: Finite | None = None

    @model_validator(mode="after")
    def _is_one_thing(self) -> ServoEntry:
        if (self.actuator is None) == (self.latch is None):
            raise ValueError("a servo is an actuator or drives a latch: give one of the two")
        given = [name for name in ("engaged_rad", "released_rad") if getattr(self, name) is not None]
        if self.actuator is not None and given:
            raise ValueError(f"{given[0]} belongs to a servo that drives a latch")
        if self.latch is not None and (len(given) < 2 or self.engaged_rad == self.released_rad):
            raise ValueError("a servo that drives a latch needs engaged_rad and released_rad, and they differ")
        return self


@dataclass(frozen=True, config=STRICT, kw_only=True)
class DynamixelSettings:
    """The bus, and what all its servos have in common.

    Shaft positions are 0 in the middle of a servo's first turn (count 2048) and grow counter-clockwise.

    Attributes
    ----------
    port, baud
        Device and rate.
    first_id, model
        Actuators without an entry of their own get ids from `first_id` on, in the order of the cells.
    operating_mode
        "auto": position mode where the actuator's range lies within one turn, else extended position.
    current_limit_a
        With "current_based_position": the current beyond which a servo gives way.
    profile_velocity_rad_s, profile_acceleration_rad_s2
        Limits that the servo itself keeps; without them it follows at once.
    watchdog_s
        A servo that hears nothing for so long stops where it is. 0 turns that off.
    fast_sync_read
        All answers in one packet, where every servo's firmware knows it.
    usb_latency_s, turnaround_s
        Of the adapter and of a servo, for what can be reached; the adapter's is also looked up.
    reply_slack_s
        How much later than computed a reply may come.
    magnets
        "by_hinges": a passive magnet counts as closed when the hinges that it depends on are measured within
        its `capture_range_rad`; there is no other sensor on this bus.
    servo
        Servos by name.
    """

    port: Name
    baud: _Baud
    first_id: ServoId = 1
    model: ModelName = "XM430-W350"
    operating_mode: Mode = "auto"
    current_limit_a: Positive | None = None
    profile_velocity_rad_s: Positive | None = None
    profile_acceleration_rad_s2: Positive | None = None
    watchdog_s: _Watchdog = 0.08
    fast_sync_read: bool = True
    usb_latency_s: _Latency = 0.001
    turnaround_s: _Latency = 50e-6
    reply_slack_s: _Slack = 0.004
    magnets: Literal["by_hinges"] | None = None
    servo: tuple[ServoEntry, ...] = ()

    @model_validator(mode="after")
    def _current_belongs_to_the_mode(self) -> DynamixelSettings:
        wanted = self.operating_mode == "current_based_position"
        if wanted and self.current_limit_a is None:
            raise ValueError('operating_mode = "current_based_position" needs current_limit_a')
        if not wanted and self.current_limit_a is not None:
            raise ValueError('current_limit_a goes with operating_mode = "current_based_position"')
        return self
