"""What is wired to which pin: the entries of a rig fitted to its actuators and latches, and checked.

Everything that can be known without a device is refused here, before anything is opened.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

from ori_deploy.actuators.mcu.settings import FRAME_S, HingeEntry, HingeServo, LatchDrive, LatchEntry, McuSettings
from ori_deploy.errors import RigError

OUTPUTS, INPUTS = 12, 12
MAGNETS, SENSORS = 8, 8
MAX_HINGES, MAX_LATCHES = 12, 8

MAX_RATE_HZ = 50.0
"""Servos get a pulse every 20 ms; goals that come faster would never be seen."""

QUEUE = 20
"""Knots that the device can queue."""

SILENT_CYCLES = 2.0
"""Cycles without a message that the device has to bear: what was sent in one is lost, and the next one is late."""

MAX_VELOCITY_RAD_S = 30.0
MAX_ACCELERATION_RAD_S2 = 1e6
MAX_POSITION_RAD = 100.0
"""Beyond these a number does not fit its field, or the device's fixed point."""


class _Actuator(Protocol):
    @property
    def id(self) -> str: ...
    @property
    def max_velocity_rad_s(self) -> float: ...
    @property
    def max_acceleration_rad_s2(self) -> float: ...
    @property
    def min_position_rad(self) -> float: ...
    @property
    def max_position_rad(self) -> float: ...


class _Latch(Protocol):
    @property
    def id(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def max_on_s(self) -> float | None: ...
    @property
    def duty_cycle(self) -> float | None: ...
    @property
    def travel_s(self) -> float | None: ...


_L = TypeVar("_L", bound=_Latch)


@dataclass(frozen=True, slots=True)
class Hinge:
    """One hinge: its servo, where it is wired to, and what its actuator may do.

    Attributes
    ----------
    name
        Actuator.
    output, feedback
        Servo output, and analogue input; None for one that is driven blind.
    servo
        Its pulses and its feedback.
    min_rad, max_rad, max_velocity_rad_s, max_acceleration_rad_s2
        Of the actuator.
    """

    name: str
    output: int
    feedback: int | None
    servo: HingeServo
    min_rad: float
    max_rad: float
    max_velocity_rad_s: float
    max_acceleration_rad_s2: float


@dataclass(frozen=True, slots=True)
class Latch:
    """One latch: where its sensor and its drive are wired to.

    Attributes
    ----------
    name, kind
        Of the rig.
    output
        Magnet output of an electromagnet, servo output of a lock pin, else None.
    sensor
        Input, or None.
    drive
        How it is sensed and driven.
    max_on_s, duty_cycle, travel_s
        As in the rig, 0 or 1 where they do not belong to the kind.
    """

    name: str
    kind: str
    output: int | None
    sensor: int | None
    drive: LatchDrive
    max_on_s: float
    duty_cycle: float
    travel_s: float


@dataclass(frozen=True)
class McuWiring:
    """Everything on one microcontroller.

    Attributes
    ----------
    settings
        As in the rig file.
    hinges, latches
        In the order of the rig's.
    """

    settings: McuSettings
    hinges: tuple[Hinge, ...]
    latches: tuple[Latch, ...]


@dataclass
class _Pins:
    """Pins of one sort, given out once each."""

    what: str
    count: int
    remedy: str
    source: str | None
    taken: dict[int, str] = field(default_factory=dict)

    def take(self, pin: int, owner: str) -> int:
        if pin >= self.count or pin in self.taken:
            raise RigError(
                f"{owner}: {self.what} {pin} cannot be used",
                value=f"it belongs to {self.taken[pin]}" if pin in self.taken else f"{pin}",
                limit=f"{self.what}s 0 to {self.count - 1}, each for one purpose",
                remedy=f"use another {self.what}",
                source=self.source,
            )
        self.taken[pin] = owner
        return pin

    def take_next(self, owner: str) -> int:
        for pin in range(self.count):
            if pin not in self.taken:
                return self.take(pin, owner)
        raise RigError(
            f"{owner}: no {self.what} is left",
            value=", ".join(f"{pin}: {name}" for pin, name in sorted(self.taken.items())),
            limit=f"{self.count} {self.what}s",
            remedy=self.remedy,
            source=self.source,
        )


def resolve_wiring(
    settings: McuSettings,
    actuators: Sequence[_Actuator],
    latches: Sequence[_Latch],
    rate_hz: float,
    source: str | None,
) -> McuWiring:
    """Fit the microcontroller to a rig.

    Parameters
    ----------
    settings
        Of the rig.
    actuators, latches
        Those of the rig that are wired to it, in order; no actuators where it works latches alone.
    rate_hz
        Of the control loop.
    source
        The rig file, for messages.

    Raises
    ------
    RigError
        An entry for what the rig does not have; something without an entry or a template; a pin used twice;
        more than the device has pins for; a range that pulses or feedback do not cover; a number that does
        not fit; a loop that is too fast, or too slow for `silence_s`.
    """
    _check_names(settings, actuators, latches, source)
    if actuators:
        _check_loop(settings, rate_hz, source)
    for what, found, most in (("hinges", len(actuators), MAX_HINGES), ("latches", len(latches), MAX_LATCHES)):
        if found > most:
            raise RigError(
                f"too many {what} for one microcontroller",
                value=found,
                limit=f"{most}",
                remedy=f"use fewer, or a design with fewer; a bus of Dynamixel servos has room for more {what}"
                if what == "hinges"
                else "use fewer, or put some of them elsewhere",
                source=source,
            )
    outputs = _Pins("servo output", OUTPUTS, "use fewer hinges and lock pins", source)
    pins = {latch.id for latch in latches if latch.kind == "lock_pin"}
    hinges = _hinges(settings, actuators, pins, outputs, source)
    return McuWiring(settings, hinges, _latches(settings, latches, outputs, source))


# -- checks ------------------------------------------------------------------------------------------


def _check_names(
    settings: McuSettings, actuators: Sequence[_Actuator], latches: Sequence[_Latch], source: str | None
) -> None:
    for table, key, named, known in (
        ("hinge", "actuator", [e.actuator for e in settings.hinge], [a.id for a in actuators]),
        ("latch", "latch", [e.latch for e in settings.latch], [a.id for a in latches]),
    ):
        for i, name in enumerate(named):
            if name not in known:
                raise RigError(
                    f"mcu.{table}[{i}].{key}: the rig has no such {key} here",
                    value=name,
                    limit=f"one of {', '.join(known) or '(none)'}",
                    remedy="correct the name, or remove the entry",
                    source=source,
                )
            if name in named[:i]:
                raise RigError(
                    f"mcu.{table}[{i}].{key}: {name} is given twice",
                    limit=f"one entry for one {key}",
                    remedy="remove one of them",
                    source=source,
                )


def _check_loop(settings: McuSettings, rate_hz: float, source: str | None) -> None:
    if rate_hz > MAX_RATE_HZ:
        raise RigError(
            "rate_hz: too fast for hinges on a microcontroller",
            value=f"{rate_hz:g}",
            limit=f"{MAX_RATE_HZ:g}: servos get a pulse every 20 ms, a faster loop has nothing to command",
            remedy=f"rate_hz = {MAX_RATE_HZ:g} or less",
            source=source,
        )
    borne_s = settings.silence_s - settings.brake_s - FRAME_S  # then braking has to begin
    if borne_s < SILENT_CYCLES / rate_hz - 1e-9:
        raise RigError(
            "mcu.silence_s: shorter than a lost cycle and the way to rest",
            value=f"{settings.silence_s:g} s at {rate_hz:g} Hz",
            limit=f"at least {SILENT_CYCLES / rate_hz + settings.brake_s + FRAME_S:.3g} s: "
            f"{SILENT_CYCLES:g} cycles, a frame, and brake_s",
            remedy="raise silence_s, min_lead_s and lead_s, or raise rate_hz",
            source=source,
        )
    if settings.lead_s < settings.min_lead_s + 1.0 / rate_hz - 1e-9:
        raise RigError(
            "mcu.lead_s: less than a cycle more than min_lead_s",
            value=f"{settings.lead_s:g} s at {rate_hz:g} Hz",
            limit=f"at least {settings.min_lead_s + 1.0 / rate_hz:.3g} s",
            remedy="raise lead_s, or raise rate_hz",
            source=source,
        )
    knots = settings.lead_s * rate_hz + 3.0  # what is under way, what is due, and one that came early
    if knots > QUEUE:
        raise RigError(
            "mcu.lead_s: the device cannot queue so much",
            value=f"{settings.lead_s:g} s at {rate_hz:g} Hz, {knots:.0f} goals",
            limit=f"{QUEUE} goals",
            remedy="lower lead_s, or lower rate_hz",
            source=source,
        )


# -- hinges ------------------------------------------------------------------------------------------


def _hinges(
    settings: McuSettings, actuators: Sequence[_Actuator], lock_pins: set[str], outputs: _Pins, source: str | None
) -> tuple[Hinge, ...]:
    inputs = _Pins("feedback input", INPUTS, "use fewer hinges", source)
    entries = {entry.actuator: entry for entry in settings.hinge}
    for entry in settings.hinge:
        outputs.take(entry.output, f"actuator {entry.actuator}")
        if entry.feedback is not None:
            inputs.take(entry.feedback, f"actuator {entry.actuator}")
    for latch in settings.latch:  # before numbers are given out: a pin's output was chosen by hand
        if latch.latch in lock_pins and latch.output is not None:
            outputs.take(latch.output, f"latch {latch.latch}")
    return tuple(_hinge(settings, actuator, entries, outputs, inputs, source) for actuator in actuators)


def _hinge(
    settings: McuSettings,
    actuator: _Actuator,
    entries: dict[str, HingeEntry],
    outputs: _Pins,
    inputs: _Pins,
    source: str | None,
) -> Hinge:
    owner = f"actuator {actuator.id}"
    entry = entries.get(actuator.id)
    servo = entry or settings.each_hinge
    if servo is None:
        raise RigError(
            f"{owner}: nothing says which servo it is",
            limit="one entry for every actuator",
            remedy=f'add a [[mcu.hinge]] with actuator = "{actuator.id}", or an [mcu.each_hinge] template',
            source=source,
        )
    _check_range(actuator, servo, source)
    if entry is not None:
        output, feedback = entry.output, entry.feedback
    else:
        output = outputs.take_next(owner)
        feedback = None if servo.open_loop else inputs.take_next(owner)
    return Hinge(
        actuator.id,
        output,
        feedback,
        servo,
        actuator.min_position_rad,
        actuator.max_position_rad,
        actuator.max_velocity_rad_s,
        actuator.max_acceleration_rad_s2,
    )


def _check_range(actuator: _Actuator, servo: HingeServo, source: str | None) -> None:
    ends = (actuator.min_position_rad, actuator.max_position_rad)
    pulses = sorted(servo.pulse_zero_us + servo.pulse_us_per_rad * end for end in ends)
    if pulses[0] < servo.pulse_min_us or pulses[1] > servo.pulse_max_us:
        raise RigError(
            f"actuator {actuator.id}: its servo's pulses do not cover its range",
            value=f"{ends[0]:.4g} to {ends[1]:.4g} rad, which is {pulses[0]:.0f} to {pulses[1]:.0f} us",
            limit=f"pulse_min_us to pulse_max_us, {servo.pulse_min_us:g} to {servo.pulse_max_us:g} us",
            remedy="narrow the actuator's range, or correct pulse_zero_us and pulse_us_per_rad",
            source=source,
        )
    if servo.feedback_rad_per_count is not None:
        counts = sorted((end - (servo.feedback_zero_rad or 0.0)) / servo.feedback_rad_per_count for end in ends)
        low, high = servo.feedback_low or 0, servo.feedback_high or 0
        if counts[0] < low or counts[1] > high:
            raise RigError(
                f"actuator {actuator.id}: its feedback does not cover its range",
                value=f"{ends[0]:.4g} to {ends[1]:.4g} rad, which is {counts[0]:.0f} to {counts[1]:.0f} counts",
                limit=f"feedback_low to feedback_high, {low} to {high} counts",
                remedy="narrow the actuator's range, or calibrate the feedback again",
                source=source,
            )
    for what, value, limit in (
        ("max_velocity_rad_s", actuator.max_velocity_rad_s, MAX_VELOCITY_RAD_S),
        ("max_acceleration_rad_s2", actuator.max_acceleration_rad_s2, MAX_ACCELERATION_RAD_S2),
        ("position range", max(abs(end) for end in ends), MAX_POSITION_RAD),
        ("pulse_us_per_rad", abs(servo.pulse_us_per_rad), 2e6),
        ("feedback_zero_rad", abs(servo.feedback_zero_rad or 0.0), MAX_POSITION_RAD),
        ("feedback_rad_per_count", abs(servo.feedback_rad_per_count or 0.0), 2.0),
    ):
        if value > limit:
            raise RigError(
                f"actuator {actuator.id}: {what} is more than the microcontroller can be told",
                value=f"{value:g}",
                limit=f"{limit:g}",
                remedy="state less; no hobby servo has more",
                source=source,
            )


# -- latches -----------------------------------------------------------------------------------------


def _latches(
    settings: McuSettings, latches: Sequence[_Latch], outputs: _Pins, source: str | None
) -> tuple[Latch, ...]:
    magnets = _Pins("magnet output", MAGNETS, "use fewer electromagnets", source)
    sensors = _Pins("sensor input", SENSORS, "use fewer latches", source)
    entries = {entry.latch: entry for entry in settings.latch}
    kinds = {latch.id: latch.kind for latch in latches}
    for entry in settings.latch:
        if entry.sensor is not None:
            sensors.take(entry.sensor, f"latch {entry.latch}")
        if entry.output is not None and kinds[entry.latch] == "electromagnet":
            magnets.take(entry.output, f"latch {entry.latch}")
    return tuple(
        _latch(settings, latch, entries.get(latch.id), outputs, magnets, sensors, source) for latch in latches
    )


def _latch(
    settings: McuSettings,
    latch: _Latch,
    entry: LatchEntry | None,
    outputs: _Pins,
    magnets: _Pins,
    sensors: _Pins,
    source: str | None,
) -> Latch:
    owner = f"latch {latch.id}"
    drive = entry or settings.each_latch
    if drive is None:
        raise RigError(
            f"{owner}: nothing says how it is wired",
            limit="one entry for every latch",
            remedy=f'add a [[mcu.latch]] with latch = "{latch.id}", or an [mcu.each_latch] template',
            source=source,
        )
    _check_kind(latch, entry, drive, settings.each_latch, source)
    output = sensor = None
    if entry is not None:
        output, sensor = entry.output, entry.sensor
    else:
        sensor = sensors.take_next(owner)
        if latch.kind != "magnet":
            output = (magnets if latch.kind == "electromagnet" else outputs).take_next(owner)
    return Latch(
        latch.id,
        latch.kind,
        output,
        sensor,
        drive,
        latch.max_on_s or 0.0,
        1.0 if latch.duty_cycle is None else latch.duty_cycle,
        latch.travel_s or 0.0,
    )


def _check_kind(
    latch: _Latch, entry: LatchEntry | None, drive: LatchDrive, template: LatchDrive | None, source: str | None
) -> None:
    """What a latch of its kind needs, and what does not belong to it; a template may be for several kinds."""
    pin, magnet = latch.kind == "lock_pin", latch.kind == "magnet"
    inherited = template is not None and drive.engaged_us == template.engaged_us
    needs: list[tuple[bool, str, str]] = [
        (pin and drive.engaged_us is None, "a lock pin has no pulses", "give engaged_us and released_us"),
        (
            entry is not None and not pin and drive.engaged_us is not None and not inherited,
            "engaged_us belongs to a lock pin",
            "remove engaged_us and released_us",
        ),
        (
            entry is not None and entry.output is None and not magnet,
            "no output drives it",
            "give the output that it is wired to",
        ),
        (entry is not None and entry.output is not None and magnet, "a magnet has no output", "remove output"),
        (
            entry is not None and entry.sensor is None and magnet,
            "a passive magnet without a sensor cannot be told closed",
            "give the sensor that sees it",
        ),
        (
            entry is not None and (entry.output or 0) >= MAGNETS and latch.kind == "electromagnet",
            f"magnet outputs are 0 to {MAGNETS - 1}",
            "use one of them",
        ),
    ]
    for wrong, what, remedy in needs:
        if wrong:
            raise RigError(f"latch {latch.id}: {what}", value=f"kind {latch.kind}", remedy=remedy, source=source)
    for what, value, limit in (
        ("max_on_s", latch.max_on_s or 0.0, 3600.0),
        ("travel_s", latch.travel_s or 0.0, 65.0),
    ):
        if value > limit:
            raise RigError(
                f"latch {latch.id}: {what} is more than the microcontroller can be told",
                value=f"{value:g} s",
                limit=f"{limit:g} s",
                remedy="state less",
                source=source,
            )
