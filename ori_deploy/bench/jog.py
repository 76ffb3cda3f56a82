"""Turn one servo a little, slowly, within its limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.dynamixel.line import Pong, ServoLine
from ori_deploy.actuators.dynamixel.startup import read, velocity_units
from ori_deploy.actuators.dynamixel.wiring import MAX_TURNS, RAD_PER_COUNT
from ori_deploy.bench.guarded import Guarded, NotReached, count_of, require_no_error
from ori_deploy.bench.meaning import meaning
from ori_deploy.bench.servos import Snapshot, known_model
from ori_deploy.clock import Clock
from ori_deploy.wire.dynamixel import OperatingMode, ServoModel
from ori_deploy.wire.dynamixel.models import RPM
from ori_deploy.wire.dynamixel.registers import CENTRE_COUNT, COUNTS_PER_TURN, VELOCITY_UNIT_RPM

LONG_WAY_RAD = 0.5 * math.pi
"""A longer move is made only after somebody has said that it is meant."""

NEAR_RAD = 0.035
"""A loaded servo comes to rest that far from its goal, or nearer; of a short move, a part of its way."""

NEAR_WAY = 0.3
ONE_STEP_RAD = 0.003
HALF_A_COUNT = 0.5 * RAD_PER_COUNT
STILL_S = 0.2
"""Shortest rest that is no slow motion: the slowest profile there is turns more than a step in it."""

SLOWEST_RAD_S = VELOCITY_UNIT_RPM * RPM
"""One step of a velocity profile; 0 would mean no limit."""

PATIENCE_S = 3.0
"""What a move may take beyond half as long again as its way at its speed."""

_MODES = (OperatingMode.POSITION, OperatingMode.EXTENDED_POSITION, OperatingMode.CURRENT_BASED_POSITION)


@dataclass(frozen=True, slots=True)
class Move:
    """A move that has been found to be possible.

    Attributes
    ----------
    pong
        The servo.
    start_rad, goal_rad
        Of the shaft.
    speed_rad_s
        Of the servo's own profile.
    """

    pong: Pong
    start_rad: float
    goal_rad: float
    speed_rad_s: float

    @property
    def way_rad(self) -> float:
        """Signed."""
        return self.goal_rad - self.start_rad

    @property
    def near_rad(self) -> float:
        """How far from its goal it counts as arrived."""
        return min(NEAR_RAD, max(2.0 * ONE_STEP_RAD, NEAR_WAY * abs(self.way_rad)))


@dataclass(frozen=True, slots=True)
class Jogged:
    """What became of a move.

    Attributes
    ----------
    move
        As it was meant.
    last
        How the servo was seen last, still under torque.
    arrived
        Or stopped on the way.
    watched
        Whether a watchdog was armed.
    holds
        Whether torque was left on.
    """

    move: Move
    last: Snapshot
    arrived: bool
    watched: bool
    holds: bool


def plan_move(
    line: ServoLine, pong: Pong, speed_rad_s: float, *, by_rad: float | None = None, to_rad: float | None = None
) -> Move:
    """Check a move without moving.

    Parameters
    ----------
    by_rad, to_rad
        From where it stands, or a shaft position; one of the two.

    Raises
    ------
    CommandRefused
        The servo is not in a mode with a position goal, has a hardware error or a drive mode other than 0,
        cannot go so slowly or so fast, or the goal or where it stands is beyond its limits.
    """
    model = known_model(pong)
    table = model.table
    require_no_error(line, pong)
    drive_mode = read(line, pong.id, table.drive_mode)
    if drive_mode:
        words = meaning(model, table.drive_mode, drive_mode).words
        raise CommandRefused(
            f"servo {pong.id}: drive_mode is {drive_mode}: {words}; limit: 0, as deploy sets it, so that sense and "
            "speed are known; remedy: set drive_mode to 0 with DYNAMIXEL Wizard"
        )
    speed = require_speed(line, pong, speed_rad_s)
    low, high = _range(line, pong, model)
    here = read(line, pong.id, table.present_position)
    start = _rad(here)
    goal = start + by_rad if by_rad is not None else to_rad if to_rad is not None else start
    for what, rad in (("stands at", start), ("would go to", goal)):
        if not low - HALF_A_COUNT <= rad <= high + HALF_A_COUNT:
            raise CommandRefused(
                f"servo {pong.id} {what} {_degrees(rad)}; limit: {_degrees(low)} to {_degrees(high)}; "
                "remedy: stay within its limits, or turn it there by hand with torque off"
            )
    return Move(pong, start, goal, speed)


def require_speed(line: ServoLine, pong: Pong, speed_rad_s: float) -> float:
    """The speed that a servo's profile has for one that is wished for: the next of its steps.

    Raises
    ------
    CommandRefused
        It is slower than the first step, or faster than the model or the servo's velocity_limit.
    """
    model = known_model(pong)
    fastest, why = model.no_load_rad_s, f"what an {model.name} does without load"
    allowed = read(line, pong.id, model.table.velocity_limit) * SLOWEST_RAD_S
    if allowed < fastest:
        fastest, why = allowed, "its velocity_limit"
    if not SLOWEST_RAD_S * (1.0 - 1e-9) <= speed_rad_s <= fastest * (1.0 + 1e-9):
        raise CommandRefused(
            f"servo {pong.id}: --speed {math.degrees(speed_rad_s):g} deg/s; "
            f"limit: {math.degrees(SLOWEST_RAD_S):.4g} deg/s, one step of its profile, to "
            f"{math.degrees(fastest):.4g} deg/s, {why}; remedy: choose a speed between them"
        )
    return min(velocity_units(speed_rad_s) * SLOWEST_RAD_S, fastest)


def carry_out(
    line: ServoLine, move: Move, clock: Clock, stop: Callable[[], bool], *, keep_holding: bool = False
) -> Jogged:
    """Make a move; torque and profile are as before at the end.

    Parameters
    ----------
    stop
        Looked at all the time: whether to stop where the servo is.
    keep_holding
        Leave torque on.

    Raises
    ------
    NotReached
        It did not arrive in time; it was stopped where it was.
    BusError
        It reports an error or does not answer any more; the watchdog stops it where it can.
    """
    with Guarded(line, move.pong, clock, keep_holding=keep_holding) as servo:
        servo.set(servo.table.profile_velocity, velocity_units(move.speed_rad_s))
        turned = abs(servo.hold() - count_of(move.start_rad))
        if turned > count_of(NEAR_RAD) - count_of(0.0):
            raise CommandRefused(
                f"servo {servo.id} was turned by {turned} counts since its way was told; remedy: say again where to"
            )
        servo.aim(count_of(move.goal_rad))
        began = clock.now()
        deadline = began + 1.5 * abs(move.way_rad) / move.speed_rad_s + PATIENCE_S
        rests_at, since = math.inf, began
        while True:
            seen = servo.look()
            if abs(seen.position_rad - rests_at) > ONE_STEP_RAD:
                rests_at, since = seen.position_rad, clock.now()
            if abs(seen.position_rad - move.goal_rad) <= move.near_rad and clock.now() - since >= STILL_S:
                return _done(servo, move, seen, arrived=True, keep_holding=keep_holding)
            if stop():
                servo.stop()
                return _done(servo, move, servo.look(), arrived=False, keep_holding=keep_holding)
            if clock.now() > deadline:
                raise NotReached(
                    f"servo {servo.id} did not get to {math.degrees(move.goal_rad):.1f} deg: "
                    f"it stands at {math.degrees(seen.position_rad):.1f} deg; "
                    f"limit: within {math.degrees(move.near_rad):.1f} deg; "
                    "remedy: free its shaft, or lighten its load"
                )


def _done(servo: Guarded, move: Move, last: Snapshot, *, arrived: bool, keep_holding: bool) -> Jogged:
    return Jogged(move, last, arrived, servo.has_watchdog, holds=servo.held_before or keep_holding)


def _range(line: ServoLine, pong: Pong, model: ServoModel) -> tuple[float, float]:
    """Shaft positions that a goal may have in the servo's operating mode."""
    table = model.table
    mode = read(line, pong.id, table.operating_mode)
    if mode not in _MODES:
        name = OperatingMode(mode).name if mode in tuple(OperatingMode) else str(mode)
        raise CommandRefused(
            f"servo {pong.id} is in operating mode {name}; limit: a mode with a position goal; "
            "remedy: set operating_mode to 3 with DYNAMIXEL Wizard, or connect with a rig"
        )
    if mode == OperatingMode.POSITION:
        return (
            _rad(read(line, pong.id, table.min_position_limit)),
            _rad(read(line, pong.id, table.max_position_limit)),
        )
    reach = MAX_TURNS * COUNTS_PER_TURN * RAD_PER_COUNT
    return -reach, reach


def _rad(count: int) -> float:
    return (count - CENTRE_COUNT) * RAD_PER_COUNT


def _degrees(rad: float) -> str:
    """With a digit behind the point, unless it is so many that nobody meant them."""
    degrees = math.degrees(rad)
    return f"{degrees:.1f} deg" if abs(degrees) < 1e7 else f"{degrees:.3g} deg"
