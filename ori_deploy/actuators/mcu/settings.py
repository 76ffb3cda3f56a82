"""What a rig file says of a microcontroller: table `[mcu]` and its hinges and latches."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Field, model_validator
from pydantic.dataclasses import dataclass

from ori_deploy.actuators.numbers import STRICT, Finite, Name, NonNegative, Positive, at_most, between

KNOWN_BAUD = 500_000
"""The one rate that the firmware knows."""

FRAME_S = 0.02
"""Between two pulses of a servo; what the device does takes effect with the next one, or the one after it."""


def _not_zero(value: float) -> float:
    if value == 0.0:
        raise ValueError("not 0: without a slope nothing can be driven or told")
    return value


def _known_rate(value: int) -> int:
    if value != KNOWN_BAUD:
        raise ValueError(f"{KNOWN_BAUD}: the firmware knows no other rate; leave the key out")
    return value


Baud = Annotated[int, Field(strict=True), AfterValidator(_known_rate)]
ServoOutput = Annotated[int, Field(ge=0, le=11, strict=True)]
FeedbackInput = Annotated[int, Field(ge=0, le=11, strict=True)]
LatchOutput = Annotated[int, Field(ge=0, le=11, strict=True)]
SensorInput = Annotated[int, Field(ge=0, le=7, strict=True)]
PulseUs = Annotated[Positive, between(400.0, 2700.0, "no hobby servo takes other pulses")]
Slope = Annotated[Finite, AfterValidator(_not_zero)]
AdcCount = Annotated[int, Field(ge=0, le=1023, strict=True)]
_Silence = Annotated[Positive, between(0.1, 3.0, "shorter trips on a late cycle, longer drives on alone")]
_Brake = Annotated[Positive, between(0.02, 0.5, "shorter is a jolt, longer needs a longer queue")]
_Lead = Annotated[Positive, between(0.1, 0.9, "shorter leaves no room to stop, longer acts too late")]
_ReplyTimeout = Annotated[Positive, between(0.002, 0.5, "shorter loses good replies, longer stalls the loop")]
_Debounce = Annotated[Positive, between(0.001, 1.0, "shorter than a bounce, or longer than a latch may take")]
_StallTime = Annotated[Positive, between(0.02, 10.0, "shorter trips on lag, longer cooks the servo")]
_Seat = Annotated[Positive, at_most(0.5, "a hinge that is farther off would jump when it goes on")]
_StallAngle = Annotated[Positive, at_most(3.0, "a stalled hinge would go unnoticed")]
_BootWait = Annotated[NonNegative, at_most(20.0, "no microcontroller starts that slowly")]
_Divider = Annotated[Positive, between(1.0, 100.0, "1 without a divider, more with one")]
_Reference = Annotated[Positive, between(1.0, 5.5, "the converter's supply")]


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Thermistor:
    """The servos' thermometer: an NTC to ground, a resistor from it to the converter's supply.

    Attributes
    ----------
    r25_ohm, beta_k
        Of the NTC: resistance at 25 °C, and how steeply it falls.
    series_ohm
        Of the resistor.
    """

    r25_ohm: Positive = 10_000.0
    beta_k: Annotated[Positive, between(1000.0, 10_000.0, "no NTC is made otherwise")] = 3950.0
    series_ohm: Positive = 10_000.0


@dataclass(frozen=True, config=STRICT, kw_only=True)
class HingeServo:
    """A kind of hobby servo: which pulse is which position, and what its feedback wire says.

    Attributes
    ----------
    pulse_zero_us, pulse_us_per_rad
        Pulse at position 0, and its change per radian of the shaft, with sign.
    pulse_min_us, pulse_max_us
        Pulses that the servo never leaves, whatever it is told.
    open_loop
        It has no feedback wire, and is believed to be where it was told to go.
    feedback_zero_rad, feedback_rad_per_count
        Position at count 0 of the converter, and its change per count, with sign.
    feedback_low, feedback_high
        Counts below are an open wire, counts above cannot be.
    """

    pulse_zero_us: PulseUs
    pulse_us_per_rad: Slope
    pulse_min_us: PulseUs
    pulse_max_us: PulseUs
    open_loop: bool = False
    feedback_zero_rad: Finite | None = None
    feedback_rad_per_count: Slope | None = None
    feedback_low: AdcCount | None = None
    feedback_high: AdcCount | None = None

    @model_validator(mode="after")
    def _pulses_are_a_range(self) -> HingeServo:
        if not self.pulse_min_us < self.pulse_max_us:
            raise ValueError("pulse_min_us must be smaller than pulse_max_us")
        return self

    @model_validator(mode="after")
    def _feedback_is_all_or_nothing(self) -> HingeServo:
        keys = ("feedback_zero_rad", "feedback_rad_per_count", "feedback_low", "feedback_high")
        given = [key for key in keys if getattr(self, key) is not None]
        if self.open_loop and given:
            raise ValueError(f"{given[0]} does not go with open_loop = true: nothing is measured")
        missing = [key for key in keys if key not in given]
        if not self.open_loop and missing:
            raise ValueError(f"{missing[0]} is missing: give it, or write open_loop = true to drive the hinge blind")
        if (self.feedback_low or 0) >= (self.feedback_high or 1024):
            raise ValueError("feedback_low must be smaller than feedback_high")
        return self


@dataclass(frozen=True, config=STRICT, kw_only=True)
class HingeEntry(HingeServo):
    """The servo of one actuator.

    Attributes
    ----------
    actuator
        Which.
    output
        Servo output that it is wired to.
    feedback
        Analogue input that its feedback wire goes to; left out with `open_loop = true`.
    """

    actuator: Name
    output: ServoOutput
    feedback: FeedbackInput | None = None

    @model_validator(mode="after")
    def _feedback_or_open_loop(self) -> HingeEntry:
        if self.open_loop and self.feedback is not None:
            raise ValueError("feedback does not go with open_loop = true")
        if not self.open_loop and self.feedback is None:
            raise ValueError("feedback is missing: give its input, or write open_loop = true to drive it blind")
        return self


@dataclass(frozen=True, config=STRICT, kw_only=True)
class LatchDrive:
    """How latches are sensed and driven.

    Attributes
    ----------
    sensor_high
        The sensor is high when the latch is closed; low without it.
    debounce_s
        How long the sensor has to be steady.
    engaged_us, released_us
        A lock pin's two pulses.
    """

    sensor_high: bool = False
    debounce_s: _Debounce = 0.02
    engaged_us: PulseUs | None = None
    released_us: PulseUs | None = None

    @model_validator(mode="after")
    def _a_pin_has_two_ends(self) -> LatchDrive:
        if (self.engaged_us is None) != (self.released_us is None):
            raise ValueError("engaged_us and released_us go together")
        if self.engaged_us is not None and self.engaged_us == self.released_us:
            raise ValueError("engaged_us and released_us must differ")
        return self


@dataclass(frozen=True, config=STRICT, kw_only=True)
class LatchEntry(LatchDrive):
    """One latch.

    Attributes
    ----------
    latch
        Which.
    sensor
        Sensor input; without one nobody can tell whether the latch is closed.
    output
        Electromagnet: magnet output 0 to 7. Lock pin: servo output 0 to 11.
    """

    latch: Name
    sensor: SensorInput | None = None
    output: LatchOutput | None = None


def _filled(template: dict[str, Any], entry: dict[str, Any]) -> dict[str, Any]:
    """An entry with what it does not say itself; one that is driven blind inherits nothing that measures."""
    blind = entry.get("open_loop", False)
    inherited = {key: value for key, value in template.items() if not (blind and key.startswith("feedback_"))}
    return {**inherited, **entry}


@dataclass(frozen=True, config=STRICT, kw_only=True)
class McuSettings:
    """The microcontroller and what is wired to it.

    Attributes
    ----------
    port, baud
        Device and rate.
    silence_s
        Moving hinges are at rest so long after the last message; resting ones go on holding.
    brake_s
        Of that, the time from full rate to rest.
    lead_s
        How long after its command a goal is due: goals are queued in the device.
    min_lead_s
        With less than that in the queue a motion that rests is begun anew.
    reply_timeout_s
        How long an answer may take.
    adc_reference_v
        Supply of the analogue converter.
    supply_divider
        Servo supply, volts per volt at the pin.
    min_supply_v
        Below it the device stops; 0 for never.
    stall_rad, stall_s
        A hinge farther than that from its output, for longer than that, goes off.
    seat_rad
        How far from its measured position a hinge may be turned on.
    thermistor
        Of the servos' thermometer.
    boot_wait_s
        How long a device that does not answer at once is left in peace before it is asked again: opening the
        port restarts most boards, and a bootloader that is talked to stays awake.
    hinge, latch
        By name; what an entry does not say is as in the template.
    each_hinge, each_latch
        Templates, also for those not named. Outputs and inputs that are left are given out in the order of the
        cells.
    """

    port: Name
    baud: Baud = KNOWN_BAUD
    silence_s: _Silence = 0.15
    brake_s: _Brake = 0.05
    lead_s: _Lead = 0.3
    min_lead_s: _Lead = 0.25
    reply_timeout_s: _ReplyTimeout = 0.03
    adc_reference_v: _Reference = 5.0
    supply_divider: _Divider
    min_supply_v: Annotated[NonNegative, at_most(60.0, "no hobby servo lives on more")]
    stall_rad: _StallAngle = 0.3
    stall_s: _StallTime = 0.5
    seat_rad: _Seat = 0.06
    thermistor: Thermistor = Thermistor()
    boot_wait_s: _BootWait = 10.0
    hinge: tuple[HingeEntry, ...] = ()
    each_hinge: HingeServo | None = None
    latch: tuple[LatchEntry, ...] = ()
    each_latch: LatchDrive | None = None

    @model_validator(mode="before")
    @classmethod
    def _entries_inherit(cls, table: Any) -> Any:
        """Fill entries up from their template, before anything is missed in them."""
        if not isinstance(table, dict):
            return table
        filled = dict(table)
        for name in ("hinge", "latch"):
            template, entries = table.get(f"each_{name}"), table.get(name)
            if isinstance(template, dict) and isinstance(entries, list | tuple):
                filled[name] = [_filled(template, entry) if isinstance(entry, dict) else entry for entry in entries]
        return filled

    @model_validator(mode="after")
    def _the_queue_outlasts_silence(self) -> McuSettings:
        if self.silence_s < self.brake_s + 3.0 * FRAME_S - 1e-9:
            raise ValueError(
                f"silence_s = {self.silence_s:g} must be at least brake_s + {3.0 * FRAME_S:g} s: "
                "braking is part of it, and takes effect two frames after silence is noticed"
            )
        needed = self.silence_s + 3.0 * FRAME_S
        if self.min_lead_s < needed - 1e-9:
            raise ValueError(
                f"min_lead_s = {self.min_lead_s:g} must be at least silence_s + {3.0 * FRAME_S:g} s = {needed:g}: "
                "a device that hears nothing brakes along what it has queued"
            )
        if self.lead_s < self.min_lead_s:
            raise ValueError(f"lead_s = {self.lead_s:g} must not be smaller than min_lead_s = {self.min_lead_s:g}")
        return self
