"""What is on a virtual bus: servos, lock pins, supply, wire."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Self

from ori_deploy.errors import InputError
from ori_deploy.wire.dynamixel import BAUD_CODES, MODELS, model_named
from sim_backends.plant_spec import PlantSpec

NEWEST_FIRMWARE = 48


@dataclass(frozen=True)
class ServoSpec:
    """One servo as it is switched on.

    Attributes
    ----------
    id, model, firmware
        What it answers to a ping.
    baud
        Its own rate; None for that of the bus.
    start_rad
        Where its shaft stands, 0 at count 2048; more than a turn away it will say so only up to whole turns.
    load_nm
        Steady torque that it has to overcome.
    time_constant_s
        Of its position response.
    backlash_rad
        Free play between shaft and crease.
    lower_stop_rad, upper_stop_rad
        Ends of its crease's travel, as shaft positions; None for none.
    noise_counts
        Standard deviation of its position readings.
    goal_follows_on_torque
        Whether its goal becomes its position when torque goes on. A servo that keeps an old goal is the worse case.
    trip_clears_profile
        Whether a watchdog that trips also writes 0 to the profile registers. The e-manual can be read either way.
    """

    id: int
    model: str = "XM430-W350"
    firmware: int = NEWEST_FIRMWARE
    baud: int | None = None
    start_rad: float = 0.0
    load_nm: float = 0.1
    time_constant_s: float = 0.02
    backlash_rad: float = 0.0
    lower_stop_rad: float | None = None
    upper_stop_rad: float | None = None
    noise_counts: float = 0.0
    goal_follows_on_torque: bool = False
    trip_clears_profile: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.id <= 252:
            raise InputError(f"servo id {self.id}", limit="0 to 252", remedy="choose another")
        if not 0 <= self.firmware <= 255:
            raise InputError(
                f"servo {self.id}: firmware", value=self.firmware, limit="0 to 255", remedy="choose another"
            )
        if not (self.time_constant_s > 0.0 and self.backlash_rad >= 0.0):
            raise InputError(
                f"servo {self.id}: time constant and backlash",
                value=f"{self.time_constant_s} s, {self.backlash_rad} rad",
                limit="more than 0, and 0 or more",
                remedy="change them",
            )
        try:
            model_named(self.model)
        except KeyError:
            raise InputError(
                "unknown servo model",
                value=self.model,
                limit=", ".join(model.name for model in MODELS),
                remedy="choose one of these, or a family such as xm430",
            ) from None


@dataclass(frozen=True)
class PinSpec:
    """A servo that drives a lock pin through its hole: only there can it pass the middle of its travel.

    Attributes
    ----------
    servo_id, engaged_rad, released_rad
        The servo and its two ends.
    hinge_ids, closed_rad, range_rad
        Servos whose creases the pin locks, where these have to stand, and how far off they may be.
    secures
        What it holds, as the rig names it.
    """

    servo_id: int
    engaged_rad: float
    released_rad: float
    hinge_ids: tuple[int, ...]
    closed_rad: tuple[float, ...]
    range_rad: tuple[float, ...]
    secures: str = ""

    def __post_init__(self) -> None:
        if self.engaged_rad == self.released_rad:
            raise InputError(
                f"lock pin {self.servo_id}: its two ends",
                value=f"both {self.engaged_rad} rad",
                remedy="let them differ",
            )
        if not len(self.hinge_ids) == len(self.closed_rad) == len(self.range_rad):
            raise InputError(
                f"lock pin {self.servo_id}: hinge_ids, closed_rad, range_rad",
                value=f"{len(self.hinge_ids)}, {len(self.closed_rad)} and {len(self.range_rad)} of them",
                remedy="give one of each for every hinge",
            )


@dataclass(frozen=True)
class BusSpec:
    """A bus.

    Attributes
    ----------
    servos
        Two may have one id: their answers then collide, as they would.
    baud
        Rate to which servos without one of their own are set.
    wire_timing
        Whether answers take the time that bytes, pauses and the adapter take.
    turnaround_s, usb_latency_s
        Of a servo before it answers, and of the adapter.
    followers_answer
        Whether a servo answers a sync read though the one before it stayed silent.
    pins
        Lock pins.
    supply_v
        Without load, for all; None for as many supplies as there are nominal voltages.
    supply_ohm, ambient_c
        Inner resistance of the supply, and the surroundings.
    seed
        Of the noise in readings.
    plant
        What the first servos drive, instead of their `load_nm`; None for servos that know nothing of each other.
    """

    servos: tuple[ServoSpec, ...]
    baud: int = 1_000_000
    wire_timing: bool = True
    turnaround_s: float = 50e-6
    usb_latency_s: float = 1e-3
    followers_answer: bool = True
    pins: tuple[PinSpec, ...] = field(default=())
    supply_v: float | None = None
    supply_ohm: float = 0.02
    ambient_c: float = 23.0
    seed: int = 0
    plant: PlantSpec | None = None

    def __post_init__(self) -> None:
        if not self.servos:
            raise InputError("a bus without servos", limit="at least one", remedy="name some: --servos 1-4:xm430")
        for baud in {self.baud, *(servo.baud for servo in self.servos if servo.baud is not None)}:
            if baud not in BAUD_CODES:
                raise InputError(
                    "unknown baud rate", value=baud, limit=", ".join(str(b) for b in BAUD_CODES), remedy="choose one"
                )

        missing = {i for pin in self.pins for i in (pin.servo_id, *pin.hinge_ids)} - {s.id for s in self.servos}
        if missing:
            raise InputError("lock pins name servos", value=sorted(missing), remedy="put these on the bus")

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """From what `to_json` made, once it has been through JSON."""
        tuples = ("hinge_ids", "closed_rad", "range_rad")
        entries: list[dict[str, Any]] = data["pins"]
        pins = tuple(PinSpec(**{**pin, **{key: tuple(pin[key]) for key in tuples}}) for pin in entries)
        servos = tuple(ServoSpec(**servo) for servo in data["servos"])
        plant = None if data.get("plant") is None else PlantSpec.from_json(data["plant"])
        return cls(**{**data, "servos": servos, "pins": pins, "plant": plant})
