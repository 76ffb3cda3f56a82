"""Find `zero_rad`: the shaft position at which a crease's inner angle is 0.

Either somebody holds the structure in a pose whose crease angles are known, or each hinge is walked against
the stop at one end of its motion (see `walk`). What is measured is the shaft; the zero is what is left of it
once gear and crease angle are taken off.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median

from ori_deploy.actuators.bus import BusError
from ori_deploy.actuators.dynamixel.line import Pong, ServoLine
from ori_deploy.actuators.dynamixel.startup import MARK_ADDRESS, mark_of, read
from ori_deploy.actuators.dynamixel.wiring import RAD_PER_COUNT, HingeServo
from ori_deploy.bench.guarded import Guarded, count_of
from ori_deploy.bench.servos import known_model
from ori_deploy.clock import Clock
from ori_deploy.wire.dynamixel import OperatingMode
from ori_deploy.wire.dynamixel.registers import COUNTS_PER_TURN

TURN = 2.0 * math.pi

READINGS = 25
"""Of a shaft that is held by hand; their median counts."""

SCATTER_RAD = 0.012
"""Spread of the readings beyond which a pose was not held still: eight counts."""

LEAD_RAD = 0.2
"""How far ahead of the shaft its goal may be: what it would jump by if the stop gave way."""

STILL_S = 0.4
STILL_RAD = 0.005
PRESSING = 0.7
"""A hinge is at its stop when it has stood still for so long, pressing with most of what it may."""


class NotCalibrated(BusError):
    """No zero was found; the structure stands where it was left, limp, and no file was changed."""


@dataclass(frozen=True, slots=True)
class HingeZero:
    """What has to be known of one hinge to find its zero.

    Attributes
    ----------
    servo
        Which servo it is.
    cell, crease
        What it drives.
    shaft_per_crease
        Signed gear ratio.
    old_zero_rad
        As the rig has it.
    crease_rad, other_rad
        Crease angle at the end of the motion where it is measured, and at the other end.
    """

    servo: HingeServo
    cell: str
    crease: str
    shaft_per_crease: float
    old_zero_rad: float
    crease_rad: float
    other_rad: float

    @property
    def towards(self) -> int:
        """Sense in which the shaft turns towards the end where it is measured."""
        return 1 if self.shaft_per_crease * (self.crease_rad - self.other_rad) > 0.0 else -1

    @property
    def way_rad(self) -> float:
        """What the shaft turns from end to end."""
        return abs(self.shaft_per_crease * (self.crease_rad - self.other_rad))


@dataclass(frozen=True, slots=True)
class Zero:
    """A zero that was found.

    Attributes
    ----------
    hinge
        Of which hinge.
    shaft_rad
        Where its shaft was measured, as the servo will read after it is switched on.
    scatter_rad
        Spread of the readings.
    zero_rad
        What goes into the rig.
    """

    hinge: HingeZero
    shaft_rad: float
    scatter_rad: float
    zero_rad: float

    @property
    def short_rad(self) -> float:
        """How far before the place that the old zero means the shaft was measured; negative for beyond it."""
        return self.hinge.towards * (self.hinge.old_zero_rad - self.zero_rad)


def zero_rad(shaft_rad: float, shaft_per_crease: float, crease_rad: float) -> float:
    """Shaft position at which the crease's inner angle is 0, from one at which it is `crease_rad`."""
    return shaft_rad - shaft_per_crease * crease_rad


def steady(readings_rad: Sequence[float], name: str) -> tuple[float, float]:
    """Median and spread of readings of a shaft that is held still.

    Raises
    ------
    NotCalibrated
        They scatter: it was not.
    """
    spread = max(readings_rad) - min(readings_rad)
    if spread > SCATTER_RAD:
        raise NotCalibrated(
            f"{name} was not held still: readings scatter by {math.degrees(spread):.2f} deg at the shaft; "
            f"limit: {math.degrees(SCATTER_RAD):.2f} deg; remedy: hold the structure in its pose, and try again"
        )
    return median(readings_rad), spread


def as_switched_on(count: int, homing_offset: int) -> int:
    """What position mode reads where a mode of many turns reads `count`: inside the first turn.

    Position mode adds a homing offset only when it is at most a quarter of a turn (e-manual, "Homing Offset").
    """
    added = homing_offset if abs(homing_offset) <= COUNTS_PER_TURN // 4 else 0
    return (count - homing_offset) % COUNTS_PER_TURN + added


def nearest_turn(zero: float, old_zero: float) -> float:
    """The same zero, whole turns away, next to an old one."""
    return zero + TURN * round((old_zero - zero) / TURN)


class StopDetector:
    """Tells from readings of a hinge that is pushed whether it stands against its stop.

    Parameters
    ----------
    effort_limit
        What the motor may take, in the unit of the readings.

    Attributes
    ----------
    least
        Effort from which on it counts as pressing.
    """

    def __init__(self, effort_limit: float) -> None:
        self.least = PRESSING * effort_limit
        self._recent: deque[tuple[float, float, float]] = deque()

    def at_stop(self, time_s: float, position_rad: float, effort: float) -> bool:
        """Take note of a reading. True once it has stood still, pressing, for `STILL_S`."""
        self._recent.append((time_s, position_rad, abs(effort)))
        while len(self._recent) > 1 and time_s - self._recent[1][0] >= STILL_S:
            self._recent.popleft()  # the window is the shortest that is long enough
        if time_s - self._recent[0][0] < STILL_S:
            return False
        positions = [position for _, position, _ in self._recent]
        still = max(positions) - min(positions) <= STILL_RAD
        return still and median(effort for _, _, effort in self._recent) >= self.least

    @property
    def position_rad(self) -> float:
        """Median of the last readings."""
        return median(position for _, position, _ in self._recent)

    @property
    def scatter_rad(self) -> float:
        """Spread of the last readings."""
        positions = [position for _, position, _ in self._recent]
        return max(positions) - min(positions)


def held_zero(
    line: ServoLine, pong: Pong, hinge: HingeZero, clock: Clock, forgets: Callable[[], None] = lambda: None
) -> Zero:
    """The zero of a hinge that is held in a known pose, its servo limp.

    Parameters
    ----------
    forgets
        As of `Guarded`: its sense has to be changed.

    Raises
    ------
    NotCalibrated
        It was not held still, or torque is on.
    BusError
        The servo does not answer.
    """
    name = f"{hinge.servo.name} (id {pong.id})"
    with Guarded(line, pong, clock, forgets=forgets) as servo:
        if servo.read(servo.table.torque_enable):
            raise NotCalibrated(
                f"{name}: torque is on; limit: limp, or it holds what nobody chose; "
                f"remedy: ori-deploy bus torque-off {pong.id}, with the structure held by hand"
            )
        turns_known = knows_turns(servo)
        servo.set(servo.table.drive_mode, 0)  # as the controller will have it: not reversed
        position, spread = steady([servo.look().position_rad for _ in range(READINGS)], name)
        wrap = servo.read(servo.table.operating_mode) != OperatingMode.POSITION
    return zero_at(line, pong, hinge, position, spread, wrap=wrap, turns_known=turns_known)


def knows_turns(servo: Guarded) -> bool:
    """Whether its readings are of turns that somebody has vouched for; to be asked before anything is set."""
    return servo.read(mark_of(servo.model)) == MARK_ADDRESS and servo.read(servo.table.drive_mode) == 0


def zero_at(
    line: ServoLine, pong: Pong, hinge: HingeZero, shaft_rad: float, spread: float, *, wrap: bool, turns_known: bool
) -> Zero:
    """The zero, in the turn that the controller will find the servo in."""
    model = known_model(pong)
    shaft = shaft_rad
    if wrap and hinge.servo.one_turn:
        offset = read(line, pong.id, model.table.homing_offset)
        shaft += (as_switched_on(count_of(shaft_rad), offset) - count_of(shaft_rad)) * RAD_PER_COUNT
    zero = zero_rad(shaft, hinge.shaft_per_crease, hinge.crease_rad)
    if not hinge.servo.one_turn and not turns_known:
        # Its turns are anybody's guess until somebody vouches for them, which is done from the rig's zero.
        nearest = nearest_turn(zero, hinge.old_zero_rad)
        return Zero(hinge, shaft + nearest - zero, spread, nearest)
    return Zero(hinge, shaft, spread, zero)
