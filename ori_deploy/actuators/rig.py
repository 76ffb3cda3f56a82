"""The rig file: what is wired to what, how far and how fast it may go, and when to stop.

Angles of a crease are the design's; positions of a shaft are the actuator's:
`shaft = zero + direction * gear_ratio * crease`. Times are seconds, the rest is SI.
"""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, TypeAdapter, ValidationError, model_validator
from pydantic.dataclasses import dataclass
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import ErrorDetails

from ori_deploy.actuators.dynamixel.settings import DynamixelSettings
from ori_deploy.actuators.mcu.settings import McuSettings
from ori_deploy.actuators.numbers import (
    STRICT,
    Count,
    Finite,
    Fraction,
    Name,
    NonNegative,
    Positive,
    at_most,
    between,
)
from ori_deploy.errors import RigError
from ori_deploy.spelling import keys_beside, meant

SCHEMA = "ori-deploy/rig/1"

STOW_POINT = "stow"
"""What a latch secures when it keeps the folded stack together."""

Crease = Literal["open_c", "open_d", "close_a", "close_b"]
CREASE_ORDER: tuple[Crease, ...] = ("open_c", "open_d", "close_a", "close_b")
"""The design's order of creases, on every array axis of length 4."""

Backend = Literal["mock", "dynamixel", "mcu"]
LatchKind = Literal["magnet", "electromagnet", "lock_pin"]

MAX_PATH_TOLERANCE_RAD = 1.0
MAX_HEALTH_PERIOD_S = 10.0


def _plain_integer(value: object) -> object:
    if type(value) is not int:  # true and 1.0 are equal to 1, and are slips
        raise ValueError("the integer 1 or -1")
    return value


_Rate = Annotated[
    Positive,
    between(10.0, 2000.0, "slower cannot stop cells in time, faster no bus can follow"),
]
_Direction = Annotated[Literal[1, -1], BeforeValidator(_plain_integer)]
_GearRatio = Annotated[Positive, between(1e-3, 1e4, "no gear between shaft and crease is beyond that")]
_Zero = Annotated[Finite, between(-1e4, 1e4, "farther out, shaft positions lose their resolution")]
_Patience = Annotated[Positive, at_most(600.0, "whoever waits longer never learns of a failure")]
_PathTolerance = Annotated[Positive, at_most(MAX_PATH_TOLERANCE_RAD, "a stalled crease would go unnoticed")]
_StartTolerance = Annotated[Positive, at_most(0.5, "farther off, cells are not on the path")]
_ReadingAge = Annotated[Positive, at_most(1.0, "older readings say nothing of where cells are")]
_LostReplies = Annotated[Count, at_most(20, "a silent hinge would be driven blind for too long")]
_Overruns = Annotated[Count, at_most(1000, "a loop that is always late sees every fault late")]
_HoldRamp = Annotated[Positive, at_most(2.0, "after a fault the structure has to come to rest soon")]
_AlignVelocity = Annotated[Positive, at_most(1.0, "cells are brought into step slowly, they may touch")]
_Temperature = Annotated[Finite, at_most(120.0, "no servo survives more")]
_PausePatience = Annotated[NonNegative, at_most(120.0, "a servo that holds while it is hot gets hotter")]
_Effort = Annotated[Fraction, between(0.05, 1.0, "weaker turns no hinge, and 1 is no limit")]
_SeatingTolerance = Annotated[Positive, between(0.001, 0.1, "less no sensor tells apart, more is not seating yet")]
_HealthPeriod = Annotated[Positive, at_most(MAX_HEALTH_PERIOD_S, "a hot or sagging servo has to be seen in time")]


@dataclass(frozen=True, config=STRICT, kw_only=True)
class ActuatorLimits:
    """What an actuator can do, at its shaft."""

    max_velocity_rad_s: Positive
    max_acceleration_rad_s2: Positive
    max_torque_nm: Positive
    min_position_rad: Finite
    max_position_rad: Finite

    @model_validator(mode="after")
    def _range_is_not_empty(self) -> ActuatorLimits:
        if self.min_position_rad >= self.max_position_rad:
            raise ValueError("min_position_rad must be smaller than max_position_rad")
        return self


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Actuator(ActuatorLimits):
    """A named actuator."""

    id: Name


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Drive:
    """How an actuator turns a crease, and how fast the crease may turn.

    Attributes
    ----------
    crease
        Which of the cell's creases is driven. At a closing crease of a cell whose walls have no thickness
        a motor has no leverage in the flat state.
    direction
        Sense of the shaft when the crease's inner angle grows.
    gear_ratio
        Shaft turns per turn of the crease.
    zero_rad
        Shaft position at which the crease's inner angle is 0.
    max_crease_velocity_rad_s, max_crease_acceleration_rad_s2
        Limits of the crease itself; without them the actuator's own count.
    """

    crease: Crease
    direction: _Direction = 1
    gear_ratio: _GearRatio = 1.0
    zero_rad: _Zero = 0.0
    max_crease_velocity_rad_s: Positive | None = None
    max_crease_acceleration_rad_s2: Positive | None = None


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Hinge(Drive):
    """One driven crease of one cell, by name."""

    actuator: Name
    cell: Name


@dataclass(frozen=True, config=STRICT, kw_only=True)
class CellTemplate(Drive):
    """What every cell gets that has no hinge of its own in the file."""

    actuator: ActuatorLimits


@dataclass(frozen=True, config=STRICT, kw_only=True)
class LatchModel:
    """A kind of latch, its limits and its patience.

    Attributes
    ----------
    kind
        magnet: passive, closes and opens by being brought together and pulled apart. electromagnet:
        holds while energised. lock_pin: driven in and out.
    timeout_s
        How long closing or opening may take before it counts as failed.
    capture_range_rad
        How far a crease may be from closed for the latch to take hold.
    max_on_s, duty_cycle
        electromagnet only: longest time energised from cold, and the fraction of time it can be on for
        ever; with `duty_cycle = 1` it never trips.
    travel_s
        lock_pin only: time to drive home.
    """

    kind: LatchKind
    timeout_s: _Patience = 3.0
    capture_range_rad: Positive = 0.03
    max_on_s: Positive | None = None
    duty_cycle: Fraction | None = None
    travel_s: Positive | None = None

    @model_validator(mode="after")
    def _keys_belong_to_the_kind(self) -> LatchModel:
        wanted = {"magnet": set(), "electromagnet": {"max_on_s", "duty_cycle"}, "lock_pin": {"travel_s"}}
        for key in ("max_on_s", "duty_cycle", "travel_s"):
            needed = key in wanted[self.kind]
            if needed and getattr(self, key) is None:
                raise ValueError(f"a latch of kind {self.kind} needs {key}")
            if not needed and getattr(self, key) is not None:
                raise ValueError(f"{key} does not belong to a latch of kind {self.kind}")
        return self

    @model_validator(mode="after")
    def _a_pin_gets_home_in_time(self) -> LatchModel:
        if self.travel_s is not None and self.timeout_s <= self.travel_s:
            raise ValueError(
                f"timeout_s = {self.timeout_s:g} must be longer than travel_s = {self.travel_s:g}: "
                "the pin would always be given up on its way"
            )
        return self


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Latch(LatchModel):
    """One latch.

    Attributes
    ----------
    secures
        A slit ("slit:P-T2"), a cell that touches no inner vertex ("cell:c3"), or "stow".
    """

    id: Name
    secures: Name


@dataclass(frozen=True, config=STRICT, kw_only=True)
class PassiveCreases:
    """Limits of the creases that no actuator drives; without them they have none."""

    max_velocity_rad_s: Positive | None = None
    max_acceleration_rad_s2: Positive | None = None


@dataclass(frozen=True, config=STRICT, kw_only=True)
class ControllerSettings:
    """When the controller refuses, slows, stops or gives up. Angles are those of the driven creases.

    Attributes
    ----------
    path_tolerance_rad
        Measured against commanded while under way; has to cover the servo's lag at full speed.
    start_tolerance_rad
        Measured against the path before a motion starts.
    goal_tolerance_rad
        Measured against the end of the path before latches engage and before "stowed".
    settle_timeout_s
        How long reaching `goal_tolerance_rad` may take.
    max_reading_age_s
        An older reading counts as lost.
    lost_replies_allowed
        Replies in a row that a hinge or latch may lose without effect.
    overruns_allowed
        Cycles in a row that may be late by a whole one while anything moves; one more is a fault.
    hold_ramp_s
        Time from full rate to rest along the path; longer where an actuator's acceleration demands it.
    align_velocity_rad_s
        Speed at which cells are brought into step before a motion.
    max_temperature_c, min_voltage_v
        Beyond these the structure is held.
    pause_patience_s
        And for so long; then it is a fault.
    health_period_s
        How often temperatures, voltages, errors and resting latches are read.
    seating_effort
        Part of their strength with which hinges close the slits, from the plan's seating fold until the latches
        confirm; 1 is no limit. Has to lift what the structure weighs there.
    holding_effort
        Part that they hold with once it is deployed and latched.
    seating_tolerance
        Fold by which a cell may touch before the end of the path, and cells one before the other.
    at_close
        Whether hinges keep holding or go limp when the controller lets go of the bus.
    """

    path_tolerance_rad: _PathTolerance = 0.10
    start_tolerance_rad: _StartTolerance = 0.05
    goal_tolerance_rad: Positive = 0.02
    settle_timeout_s: _Patience = 2.0
    max_reading_age_s: _ReadingAge = 0.05
    lost_replies_allowed: _LostReplies = 2
    overruns_allowed: _Overruns = 25
    hold_ramp_s: _HoldRamp = 0.25
    align_velocity_rad_s: _AlignVelocity = 0.1
    max_temperature_c: _Temperature = 70.0
    min_voltage_v: NonNegative = 10.0
    pause_patience_s: _PausePatience = 5.0
    health_period_s: _HealthPeriod = 0.05
    seating_effort: _Effort = 0.6
    holding_effort: _Effort = 0.5
    seating_tolerance: _SeatingTolerance = 0.01
    at_close: Literal["hold", "relax"] = "hold"

    @model_validator(mode="after")
    def _goal_is_within_the_path(self) -> ControllerSettings:
        if self.goal_tolerance_rad > self.path_tolerance_rad:
            raise ValueError(
                f"goal_tolerance_rad = {self.goal_tolerance_rad:g} must not exceed "
                f"path_tolerance_rad = {self.path_tolerance_rad:g}: latches would close on cells off the path"
            )
        return self


@dataclass(frozen=True, config=STRICT, kw_only=True)
class MockSettings:
    """The simulated servos, all alike. Angles and torques are those of the shaft.

    Attributes
    ----------
    seed
        Of the measurement noise.
    time_constant_s
        Of the first-order position response.
    noise_rad, encoder_step_rad
        Standard deviation and resolution of measured positions.
    backlash_rad
        Free play between shaft and crease.
    load_nm
        Steady torque that the structure asks of every servo.
    supply_v, supply_ohm, ambient_c
        Supply without load, its inner resistance, and the surroundings.
    plant, loads
        Design file that the servos drive as rigid panels in MuJoCo, instead of `load_nm` each, and loads
        file with its weights; paths from the rig file. What latches hold is then held there, too.
    """

    seed: Count = 1
    time_constant_s: Positive = 0.03
    noise_rad: NonNegative = 0.001
    encoder_step_rad: Positive = 0.001534
    backlash_rad: NonNegative = 0.005
    load_nm: NonNegative = 0.3
    supply_v: Positive = 12.0
    supply_ohm: NonNegative = 0.05
    ambient_c: Finite = 23.0
    plant: Name | None = None
    loads: Name | None = None

    @model_validator(mode="after")
    def _loads_belong_to_a_plant(self) -> MockSettings:
        if self.loads is not None and self.plant is None:
            raise ValueError("loads goes with plant: name the design file that is loaded so")
        return self


@dataclass(frozen=True, config=STRICT, kw_only=True)
class Rig:
    """A rig file as it stands; `ori_deploy.actuators.resolve.resolve_rig` fits it to a design.

    `source` and `sha256` say which file it came from; they are not keys of the file.
    """

    schema: Literal["ori-deploy/rig/1"]
    backend: Backend
    rate_hz: _Rate
    actuator: tuple[Actuator, ...] = ()
    hinge: tuple[Hinge, ...] = ()
    latch: tuple[Latch, ...] = ()
    each_cell: CellTemplate | None = None
    each_latch_point: LatchModel | None = None
    passive_creases: PassiveCreases = PassiveCreases()
    controller: ControllerSettings = ControllerSettings()
    mock: MockSettings = MockSettings()
    dynamixel: DynamixelSettings | None = None
    mcu: McuSettings | None = None
    source: SkipJsonSchema[str | None] = None
    sha256: SkipJsonSchema[str] = ""

    @model_validator(mode="after")
    def _a_backend_has_its_table(self) -> Rig:
        if self.backend == "dynamixel" and self.dynamixel is None:
            raise ValueError('backend = "dynamixel" needs a table [dynamixel] with port and baud')
        if self.backend == "mcu" and self.mcu is None:
            raise ValueError('backend = "mcu" needs a table [mcu] with port, supply_divider and min_supply_v')
        return self

    @model_validator(mode="after")
    def _hinges_are_on_one_bus(self) -> Rig:
        if self.backend == "mcu" and self.dynamixel is not None:
            raise ValueError(
                'backend = "mcu" does not go with a table [dynamixel]: hinges are on one bus; for latches on the '
                'microcontroller and hinges on servos write backend = "dynamixel"'
            )
        return self


_RIG = TypeAdapter(Rig)


def load_rig(path: str | Path) -> Rig:
    """Read and validate a rig file.

    Raises
    ------
    RigError
        Naming the file, the key, the value, the rule and the remedy.
    """
    source = str(path)
    try:
        # Not made anew: it may be a file that was read before, and is no more to be read from where it was.
        data = (path if isinstance(path, Path) else Path(path)).read_bytes()
    except OSError as error:
        raise RigError(
            "the rig file cannot be read", value=error.strerror, remedy="check the path", source=source
        ) from error
    try:
        document = tomllib.loads(data.decode("utf-8"))
    except ValueError as error:  # not UTF-8, not TOML, or an integer of thousands of digits
        raise RigError(
            "the rig file is not TOML", value=error, remedy="correct the line named", source=source
        ) from error
    except RecursionError as error:
        raise RigError(
            "the rig file is nested too deeply",
            value=error,
            limit="tables in tables as in the examples",
            remedy="remove brackets",
            source=source,
        ) from error
    return replace(parse_rig(document, source), sha256=hashlib.sha256(data).hexdigest())


def parse_rig(document: dict[str, Any], source: str | None = None) -> Rig:
    """Validate a rig given as the tables of its file.

    Raises
    ------
    RigError
        As `load_rig`.
    """
    for key in ("source", "sha256"):  # attributes of Rig that a file may not set
        if key in document:
            raise RigError(f"unknown key {key}", remedy="remove it", source=source)
    if document.get("schema", SCHEMA) != SCHEMA:  # of another kind, of which every other key is wrong as well
        raise RigError(
            "key schema",
            value=repr(document["schema"]),
            limit=repr(SCHEMA),
            remedy="check that this is a rig file",
            source=source,
        )
    try:
        rig: Rig = _RIG.validate_python(document)
    except ValidationError as error:
        raise _rig_error(error.errors(include_url=False), source) from error
    return replace(rig, source=source)


def _rig_error(errors: list[ErrorDetails], source: str | None) -> RigError:
    """The first thing that pydantic found, in this package's words."""
    first = errors[0]
    key = ""
    for part in first["loc"]:
        key += f"[{part}]" if isinstance(part, int) else f".{part}" if key else str(part)
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    kind = first["type"]
    if kind in ("unexpected_keyword_argument", "extra_forbidden"):
        return RigError(
            f"unknown key {key}{more}",
            value=first["input"],
            limit="only keys of the rig schema",
            remedy=meant(str(first["loc"][-1]), keys_beside(_RIG.json_schema(), first["loc"])),
            source=source,
        )
    if kind in ("missing", "missing_argument"):
        return RigError(f"missing key {key}{more}", remedy="add it", source=source)
    is_table = isinstance(first["input"], dict)
    return RigError(
        f"{key or 'rig'}{more}",
        value=None if is_table else repr(first["input"]),
        limit=first["msg"].removeprefix("Value error, "),
        remedy="give a value inside the limit",
        source=source,
    )
