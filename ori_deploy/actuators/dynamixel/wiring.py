"""Which servo is which: the entries of a rig fitted to its actuators and latches, and checked.

Everything that can be known without a bus is refused here, before anything is opened.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Protocol

from ori_deploy.actuators.dynamixel.settings import DynamixelSettings, ServoEntry
from ori_deploy.errors import RigError
from ori_deploy.wire.dynamixel import OperatingMode, ServoModel, model_named
from ori_deploy.wire.dynamixel.registers import CENTRE_COUNT, COUNTS_PER_TURN

RAD_PER_COUNT = 2.0 * pi / COUNTS_PER_TURN
MAX_TURNS = 255
"""Turns either way that extended position counts (e-manual: 256, of which the homing offset may take one)."""


class _Actuator(Protocol):
    @property
    def id(self) -> str: ...
    @property
    def max_velocity_rad_s(self) -> float: ...
    @property
    def max_torque_nm(self) -> float: ...
    @property
    def min_position_rad(self) -> float: ...
    @property
    def max_position_rad(self) -> float: ...


class _Latch(Protocol):
    @property
    def id(self) -> str: ...
    @property
    def kind(self) -> str: ...


@dataclass(frozen=True, slots=True)
class HingeServo:
    """The servo of one hinge.

    Attributes
    ----------
    name, id, model
        Actuator, id on the bus, model.
    mode
        Operating mode.
    min_count, max_count
        Range of its goals.
    """

    name: str
    id: int
    model: ServoModel
    mode: OperatingMode
    min_count: int
    max_count: int

    @property
    def one_turn(self) -> bool:
        """Whether its range lies in the first turn, so that a restart does not lose its place."""
        return self.min_count >= 0 and self.max_count < COUNTS_PER_TURN


@dataclass(frozen=True, slots=True)
class PinServo:
    """The servo that drives a lock pin."""

    latch: str
    id: int
    model: ServoModel
    engaged_count: int
    released_count: int

    @property
    def angles_rad(self) -> tuple[float, float]:
        """Shaft positions, engaged and released."""
        engaged, released = (
            (count - CENTRE_COUNT) * RAD_PER_COUNT for count in (self.engaged_count, self.released_count)
        )
        return engaged, released

    @property
    def mode(self) -> OperatingMode:
        """Gives way when the pin does not find its hole, where the model can measure current."""
        limp = OperatingMode.CURRENT_BASED_POSITION
        return limp if limp in self.model.modes else OperatingMode.POSITION


@dataclass(frozen=True)
class Wiring:
    """Every servo of a rig.

    Attributes
    ----------
    settings
        As in the rig file.
    hinges
        In the order of the rig's hinges.
    pins
        Lock pins, in the order of the rig's latches.
    """

    settings: DynamixelSettings
    hinges: tuple[HingeServo, ...]
    pins: tuple[PinServo, ...]

    @property
    def servos(self) -> tuple[HingeServo | PinServo, ...]:
        """All of them."""
        return self.hinges + self.pins

    def as_found(self, firmware: Mapping[int, int]) -> Wiring:
        """The same servos with the registers of the firmware that they were found to have, by id."""
        return replace(
            self,
            hinges=tuple(replace(one, model=one.model.at_firmware(firmware[one.id])) for one in self.hinges),
            pins=tuple(replace(one, model=one.model.at_firmware(firmware[one.id])) for one in self.pins),
        )


def resolve_wiring(
    settings: DynamixelSettings, actuators: Sequence[_Actuator], latches: Sequence[_Latch], source: str | None
) -> Wiring:
    """Fit the servos to a rig.

    Parameters
    ----------
    settings
        Of the rig.
    actuators, latches
        Of the rig, in order.
    source
        The rig file, for messages.

    Raises
    ------
    RigError
        An id that two servos share; a servo for what the rig does not have; a latch that nothing on this bus
        can work or sense; a range, speed or torque that the model does not have.
    """
    entries = _entries(settings, actuators, latches, source)
    taken = {entry.id for entry in settings.servo}
    free = (servo_id for servo_id in range(settings.first_id, 253) if servo_id not in taken)
    hinges = []
    for actuator in actuators:
        entry = entries.get(("actuator", actuator.id))
        servo_id = entry.id if entry else next(free, None)
        if servo_id is None:
            raise RigError(
                f"no id is left for actuator {actuator.id}",
                value=f"first_id = {settings.first_id}",
                limit="ids 0 to 252",
                remedy="lower first_id",
                source=source,
            )
        model = model_named((entry.model if entry else None) or settings.model)
        hinges.append(_hinge(settings, actuator, servo_id, model, source))
    pins = [_pin(settings, latch, entries.get(("latch", latch.id)), source) for latch in latches]
    return Wiring(settings, tuple(hinges), tuple(pin for pin in pins if pin is not None))


def _entries(
    settings: DynamixelSettings, actuators: Sequence[_Actuator], latches: Sequence[_Latch], source: str | None
) -> dict[tuple[str, str], ServoEntry]:
    """Entries by what they are."""
    known = {("actuator", actuator.id) for actuator in actuators} | {("latch", latch.id) for latch in latches}
    entries: dict[tuple[str, str], ServoEntry] = {}
    ids: dict[int, tuple[str, str]] = {}
    for i, entry in enumerate(settings.servo):
        key = ("actuator", entry.actuator) if entry.actuator is not None else ("latch", entry.latch or "")
        where = f"dynamixel.servo[{i}]"
        if key not in known:
            names = sorted(name for kind, name in known if kind == key[0])
            raise RigError(
                f"{where}.{key[0]}: the rig has no such {key[0]}",
                value=key[1],
                limit=f"one of {', '.join(names) or '(none)'}",
                remedy="correct the name, or remove the servo",
                source=source,
            )
        for other, what in ((ids.get(entry.id), f"id {entry.id}"), (key if key in entries else None, key[1])):
            if other is not None:
                raise RigError(
                    f"{where}: {what} is given twice",
                    value=f"for {other[0]} {other[1]} and {key[0]} {key[1]}",
                    limit="one servo, one id, one purpose",
                    remedy="change one of them; ori-deploy bus set-id changes a servo's",
                    source=source,
                )
        entries[key] = entry
        ids[entry.id] = key
    return entries


def _hinge(
    settings: DynamixelSettings, actuator: _Actuator, servo_id: int, model: ServoModel, source: str | None
) -> HingeServo:
    low = CENTRE_COUNT + round(actuator.min_position_rad / RAD_PER_COUNT)
    high = CENTRE_COUNT + round(actuator.max_position_rad / RAD_PER_COUNT)
    one_turn = low >= 0 and high < COUNTS_PER_TURN
    mode = {
        "auto": OperatingMode.POSITION if one_turn else OperatingMode.EXTENDED_POSITION,
        "position": OperatingMode.POSITION,
        "extended_position": OperatingMode.EXTENDED_POSITION,
        "current_based_position": OperatingMode.CURRENT_BASED_POSITION,
    }[settings.operating_mode]
    _require_model(mode in model.modes, actuator.id, model, f"operating mode {mode.name}", "use another mode", source)
    turns = max(abs(low - CENTRE_COUNT), abs(high - CENTRE_COUNT)) / COUNTS_PER_TURN
    if (mode is OperatingMode.POSITION and not one_turn) or turns > MAX_TURNS:
        raise RigError(
            f"actuator {actuator.id}: its range does not fit operating mode {mode.name}",
            value=f"{actuator.min_position_rad:.4g} to {actuator.max_position_rad:.4g} rad",
            limit=f"-{pi:.5g} to {(COUNTS_PER_TURN - 1 - CENTRE_COUNT) * RAD_PER_COUNT:.5g} rad"
            if mode is OperatingMode.POSITION
            else f"{MAX_TURNS} turns either way",
            remedy='narrow it, or use operating_mode = "extended_position"',
            source=source,
        )
    for what, wanted, has, unit in (
        ("max_velocity_rad_s", actuator.max_velocity_rad_s, model.no_load_rad_s, "rad/s without load"),
        ("max_torque_nm", actuator.max_torque_nm, model.stall_torque_nm, "N m at stall"),
    ):
        if wanted > has:
            raise RigError(
                f"actuator {actuator.id}: {what} is more than an {model.name} has",
                value=f"{wanted:g}",
                limit=f"{has:.3g} {unit} at {model.nominal_v:g} V",
                remedy="state less, or use a stronger model",
                source=source,
            )
    return HingeServo(actuator.id, servo_id, model, mode, low, high)


def _pin(settings: DynamixelSettings, latch: _Latch, entry: ServoEntry | None, source: str | None) -> PinServo | None:
    if latch.kind == "electromagnet":
        raise RigError(
            f"latch {latch.id}: nothing on a Dynamixel bus can switch an electromagnet",
            remedy="use a lock_pin with a servo of its own, or a magnet",
            source=source,
        )
    if latch.kind == "magnet":
        if settings.magnets is None:
            raise RigError(
                f"latch {latch.id}: a passive magnet has no sensor on a Dynamixel bus",
                limit="every latch is sensed, or nothing can be called deployed",
                remedy='magnets = "by_hinges" in [dynamixel] accepts the measured hinges as its sensor',
                source=source,
            )
        return None
    if entry is None or entry.engaged_rad is None or entry.released_rad is None:
        raise RigError(
            f"latch {latch.id}: no servo drives this lock pin",
            remedy=f'add a [[dynamixel.servo]] with latch = "{latch.id}", id, engaged_rad and released_rad',
            source=source,
        )
    model = model_named(entry.model or settings.model)
    ends = [CENTRE_COUNT + round(angle / RAD_PER_COUNT) for angle in (entry.engaged_rad, entry.released_rad)]
    if not all(0 <= end < COUNTS_PER_TURN for end in ends):
        raise RigError(
            f"latch {latch.id}: engaged_rad and released_rad lie outside the servo's first turn",
            value=f"{entry.engaged_rad:g}, {entry.released_rad:g}",
            limit="-3.1416 to 3.14 rad",
            remedy="mount the pin so that both lie inside",
            source=source,
        )
    return PinServo(latch.id, entry.id, model, ends[0], ends[1])


def _require_model(ok: bool, actuator: str, model: ServoModel, what: str, remedy: str, source: str | None) -> None:
    if not ok:
        raise RigError(
            f"actuator {actuator}: an {model.name} does not have {what}",
            limit=", ".join(sorted(mode.name for mode in model.modes)),
            remedy=remedy,
            source=source,
        )
