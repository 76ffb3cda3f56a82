"""The world around a simulated microcontroller: servos, feedback, latches, supply."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from ori_deploy.errors import InputError
from sim_backends.plant_spec import PlantSpec

OUTPUTS, MAGNETS, SENSORS, ADC_INPUTS = 12, 8, 8, 16
NOBODY = 255
"""Index of an output, a sensor or an input that is not there."""

LatchKind = Literal["magnet", "electromagnet", "lock_pin"]
KINDS: tuple[LatchKind, ...] = ("magnet", "electromagnet", "lock_pin")


@dataclass(frozen=True)
class HingeSpec:
    """A servo that drives a hinge, with its feedback pot.

    Attributes
    ----------
    output, adc
        Where servo and pot are wired; 255 for no pot, and for a hinge that something else turns.
    start_rad
        Where it stands.
    pulse_zero_ns, pulse_slope_ns
        Pulse at 0 rad, and how it changes per radian, with sign.
    feedback_zero_urad, feedback_slope_nrad
        Position at count 0, and per count, with sign.
    noise_counts
        Standard deviation of the pot's reading.
    time_constant_s, max_velocity_rad_s
        Of its response.
    lower_rad, upper_rad
        Ends of its travel.
    """

    output: int
    adc: int = NOBODY
    start_rad: float = 0.0
    pulse_zero_ns: int = 1_500_000
    pulse_slope_ns: int = 636_620
    feedback_zero_urad: int = -1_800_000
    feedback_slope_nrad: int = 3_519_062
    noise_counts: float = 0.0
    time_constant_s: float = 0.03
    max_velocity_rad_s: float = 6.0
    lower_rad: float = -1e3
    upper_rad: float = 1e3

    def __post_init__(self) -> None:
        if not (0 <= self.output < OUTPUTS or self.output == NOBODY):
            raise InputError("output of a hinge", value=self.output, limit="0 to 11, or 255", remedy="choose another")
        if not (0 <= self.adc < ADC_INPUTS or self.adc == NOBODY):
            raise InputError("input of a hinge", value=self.adc, limit="0 to 15, or 255", remedy="choose another")
        if self.pulse_slope_ns == 0 or self.feedback_slope_nrad == 0:
            raise InputError("slopes of a hinge", value=0, limit="anything else", remedy="give them")
        if not (self.time_constant_s > 0.0 and self.max_velocity_rad_s > 0.0 and self.lower_rad < self.upper_rad):
            raise InputError(
                "response and travel of a hinge",
                value=f"{self.time_constant_s} s, {self.max_velocity_rad_s} rad/s, "
                f"{self.lower_rad} to {self.upper_rad} rad",
                limit="more than 0, and a range",
                remedy="change them",
            )


@dataclass(frozen=True)
class LatchSpec:
    """A latch, with its Hall sensor.

    Attributes
    ----------
    kind
        Passive magnet, electromagnet, or pin driven by a servo.
    output
        Magnet output, or servo output of the pin; 255 for a passive magnet.
    sensor, sensor_high
        Where its sensor is wired, 255 for none; whether it is high when the latch is closed.
    hinges, closed_rad, range_rad
        What it secures, where these have to stand, and how far off they may be when it takes hold.
    engaged_us, released_us, travel_s
        Of a lock pin: its two pulses, and the time between them.
    start_closed
        Whether a lock pin starts at home.
    secures
        What it holds, as the rig names it.
    """

    kind: LatchKind
    output: int = NOBODY
    sensor: int = NOBODY
    sensor_high: bool = False
    hinges: tuple[int, ...] = ()
    closed_rad: tuple[float, ...] = ()
    range_rad: tuple[float, ...] = ()
    engaged_us: int = 2000
    released_us: int = 1000
    travel_s: float = 0.4
    start_closed: bool = False
    secures: str = ""

    def __post_init__(self) -> None:
        outputs = {"magnet": 0, "electromagnet": MAGNETS, "lock_pin": OUTPUTS}[self.kind]
        if self.kind != "magnet" and not 0 <= self.output < outputs:
            raise InputError(
                f"output of a latch, {self.kind}", value=self.output, limit=f"0 to {outputs - 1}", remedy="change it"
            )
        if not (0 <= self.sensor < SENSORS or self.sensor == NOBODY):
            raise InputError("sensor of a latch", value=self.sensor, limit="0 to 7, or 255", remedy="change it")
        if not len(self.hinges) == len(self.closed_rad) == len(self.range_rad):
            raise InputError("hinges, closed_rad, range_rad of a latch", remedy="give one of each for every hinge")
        if self.engaged_us == self.released_us or not self.travel_s > 0.0:
            raise InputError("travel of a lock pin", value="none", remedy="let its pulses differ, and take its time")


@dataclass(frozen=True)
class WorldSpec:
    """Everything at the microcontroller's pins.

    Attributes
    ----------
    hinges, latches
        In the order in which truth lists them.
    supply_v, supply_uv_per_count
        The servos' supply, and how its divider makes counts of it.
    thermistor_count
        What the thermistor reads.
    seed
        Of noise in readings, of bouncing sensors, and of faults of the cable.
    plant
        What the hinges drive; None for servos that know nothing of each other.
    """

    hinges: tuple[HingeSpec, ...] = field(default=())
    latches: tuple[LatchSpec, ...] = field(default=())
    supply_v: float = 6.0
    supply_uv_per_count: float = 10_000.0
    thermistor_count: int = 512
    seed: int = 0
    plant: PlantSpec | None = None

    def __post_init__(self) -> None:
        if self.plant is not None and len(self.plant.names) != len(self.hinges):
            raise InputError(
                "plant: hinges in the world", value=len(self.hinges), limit=f"{len(self.plant.names)}, one per cell",
                remedy="let the microcontroller drive all hinges of the structure",
            )  # fmt: skip
        if len(self.hinges) > OUTPUTS or len(self.latches) > MAGNETS:
            raise InputError(
                "a world", value=f"{len(self.hinges)} hinges, {len(self.latches)} latches", limit="12 and 8",
                remedy="take fewer",
            )  # fmt: skip
        missing = {k for latch in self.latches for k in latch.hinges} - set(range(len(self.hinges)))
        if missing:
            raise InputError("latches name hinges", value=sorted(missing), remedy="let these exist")

    def to_text(self) -> str:
        """As the emulation reads it."""
        lines = [
            f"seed {self.seed}",
            f"supply_uv {1e6 * self.supply_v:.0f}",
            f"supply_uv_per_count {self.supply_uv_per_count!r}",
            f"thermistor_count {self.thermistor_count}",
        ]
        for k, hinge in enumerate(self.hinges):
            lines += [f"hinge {k} {name} {value!r}" for name, value in vars(hinge).items()]
        for k, latch in enumerate(self.latches):
            lines += [f"latch {k} {name} {value}" for name, value in _fields(latch).items()]
            lines += [
                f"latch {k} secures {hinge} {closed!r} {reach!r}"
                for hinge, closed, reach in zip(latch.hinges, latch.closed_rad, latch.range_rad, strict=True)
            ]
        return "\n".join(lines) + "\n"


def _fields(latch: LatchSpec) -> dict[str, int | float]:
    return {
        "kind": KINDS.index(latch.kind),
        "output": latch.output,
        "sensor": latch.sensor,
        "sensor_high": int(latch.sensor_high),
        "engaged_us": latch.engaged_us,
        "released_us": latch.released_us,
        "travel_s": latch.travel_s,
        "start_travel": float(latch.start_closed),
    }
