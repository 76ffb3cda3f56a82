"""Walk a hinge against the stop at one end of its motion, slowly and with little force, to find its zero."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import median

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.dynamixel.line import Pong, ServoLine
from ori_deploy.actuators.dynamixel.startup import read, velocity_units
from ori_deploy.actuators.dynamixel.wiring import RAD_PER_COUNT
from ori_deploy.bench.calibration import (
    LEAD_RAD,
    SCATTER_RAD,
    TURN,
    HingeZero,
    NotCalibrated,
    StopDetector,
    Zero,
    knows_turns,
    zero_at,
)
from ori_deploy.bench.guarded import Guarded, count_of, require_no_error
from ori_deploy.bench.jog import require_speed
from ori_deploy.bench.meaning import PWM_FULL
from ori_deploy.bench.servos import Snapshot, known_model
from ori_deploy.clock import Clock
from ori_deploy.wire.dynamixel import OperatingMode, Register
from ori_deploy.wire.dynamixel.registers import COUNTS_PER_TURN

GENTLE = 0.15
"""Part of the stall current that pushes against a stop, unless somebody says otherwise."""

TOUCHES = 2
"""How often a stop is met before it is believed."""

BACK_OFF_RAD = 0.1
CAME_AWAY_RAD = 0.5 * BACK_OFF_RAD
"""A hinge that does not come away that far from where it stood did not stand at a stop; far beyond `SCATTER_RAD`."""

PAST_RAD = SCATTER_RAD + 4.0 * RAD_PER_COUNT
"""A hinge that goes farther than this past where it stood still has not stood at its stop."""

TOO_FAR = 1.1
TOO_FAR_RAD = 0.2
"""No stop is looked for beyond the hinge's whole motion and this much more."""

COOL_C = 5.0
"""Distance to keep from the servo's own temperature limit."""


@dataclass(frozen=True, slots=True)
class Limits:
    """When a walk against a stop is given up, and how it is made.

    Attributes
    ----------
    speed_rad_s
        Of the shaft.
    current_a
        Most that the motor may take; None for a gentle part of its stall current.
    max_temperature_c, min_voltage_v
        Of the rig.
    """

    speed_rad_s: float
    current_a: float | None
    max_temperature_c: float
    min_voltage_v: float


def stop_zero(
    line: ServoLine,
    pong: Pong,
    hinge: HingeZero,
    limits: Limits,
    clock: Clock,
    stop: Callable[[], bool],
    forgets: Callable[[], None] = lambda: None,
) -> Zero:
    """Walk a hinge against the stop at one end of its motion, twice, and back off a little; the zero it gives.

    What gives way is met at two places or passed by, and what is stuck does not come away from one. What is as
    rigid as the stop, and before it each time, cannot be told from it: that shows in `Zero.short_rad`, to whoever
    trusts the old zero.

    Parameters
    ----------
    stop
        Looked at all the time: whether to give up.
    forgets
        As of `Guarded`: its mode has to be changed.

    Raises
    ------
    NotCalibrated
        There is no stop within the motion, it is met at two places, or the hinge does not come away from it; the
        servo gets hot or its supply sags; or `stop` says so.
    CommandRefused
        As `require_walk`; nothing was set. Or the servo does not take what it is set to.
    BusError
        The servo reports an error or does not answer. It is limp and as it was found, as far as it answers; turns
        that it forgot stay forgotten.
    """
    require_walk(line, pong, limits)
    with Guarded(line, pong, clock, forgets=forgets) as servo:
        turns_known, found = knows_turns(servo), servo.read(servo.table.present_position)
        effort_limit = _limit_force(servo, pong, limits)
        lost = round((found - servo.read(servo.table.present_position)) / COUNTS_PER_TURN)
        servo.set(servo.table.profile_velocity, velocity_units(limits.speed_rad_s))
        servo.hold()
        walk = _Walk(servo, hinge, limits, stop)
        places: list[float] = []
        spread = 0.0
        for _ in range(TOUCHES):
            detector = walk.to_stop(StopDetector(effort_limit), places)
            places.append(detector.position_rad)
            spread = max(spread, detector.scatter_rad, max(places) - min(places))
            walk.back_off(places[-1])
        position = _one_place(places, walk.name)
    if turns_known:
        position += lost * TURN  # those that the change of mode made it forget
    return zero_at(line, pong, hinge, position, spread, wrap=True, turns_known=turns_known)


def require_walk(line: ServoLine, pong: Pong, limits: Limits) -> float:
    """Make sure, without setting anything, that a servo can be walked as it is wished; most speed that it then has.

    Raises
    ------
    CommandRefused
        It cannot turn so fast or so slowly, may not take so much current, or reports a hardware error.
    BusError
        It does not answer.
    """
    fastest = require_speed(line, pong, limits.speed_rad_s)
    _force(line, pong, limits)
    require_no_error(line, pong)
    return fastest


def _one_place(places_rad: Sequence[float], name: str) -> float:
    """The middle of the places where a stop was met, if they are one."""
    apart = max(places_rad) - min(places_rad)
    if apart > SCATTER_RAD:
        raise NotCalibrated(
            f"{name}: stood still at places {math.degrees(apart):.2f} deg of the shaft apart; "
            f"limit: {math.degrees(SCATTER_RAD):.2f} deg, as of one stop; "
            "remedy: see what is in its way or makes it stick, then calibrate again"
        )
    return median(places_rad)


def _limit_force(servo: Guarded, pong: Pong, limits: Limits) -> float:
    """Bring a servo into a mode in which it gives way; return the most effort it then shows.

    The goal may lie outside the first turn in either mode.
    """
    table = servo.table
    servo.remember(
        (
            table.operating_mode, table.profile_acceleration, table.profile_velocity, table.goal_pwm,
            table.goal_current, table.velocity_p_gain, table.velocity_i_gain, table.position_p_gain,
            table.position_i_gain, table.position_d_gain, table.feedforward_1st_gain, table.feedforward_2nd_gain,
        )
    )  # fmt: skip
    effort = _force(servo.line, pong, limits)
    servo.set(table.drive_mode, 0)
    servo.set(table.operating_mode, effort.mode)
    servo.set(effort.register, effort.units)
    return effort.units * effort.shown


@dataclass(frozen=True, slots=True)
class _Force:
    """What a servo may push with: the register that limits it, in the mode in which it does.

    Attributes
    ----------
    mode, register, units
        To be set.
    shown
        What one unit is in readings of its effort.
    """

    mode: OperatingMode
    register: Register
    units: int
    shown: float


def _force(line: ServoLine, pong: Pong, limits: Limits) -> _Force:
    """The current to push with, at most what the servo is set to."""
    model = known_model(pong)
    table, unit = model.table, model.current_unit_a
    if table.goal_current is None or table.current_limit is None or unit is None:
        most, unit = read(line, pong.id, table.pwm_limit), model.stall_current_a / PWM_FULL
        kind = _Force(OperatingMode.EXTENDED_POSITION, table.goal_pwm, most, 1.0 / PWM_FULL)
    else:
        most = read(line, pong.id, table.current_limit)
        kind = _Force(OperatingMode.CURRENT_BASED_POSITION, table.goal_current, most, unit)
    if limits.current_a is None:
        return replace(kind, units=min(max(1, round(GENTLE * model.stall_current_a / unit)), most))
    units = max(1, round(limits.current_a / unit))
    if units > most:
        raise CommandRefused(
            f"servo {pong.id}: --current {limits.current_a:g} A; limit: {most * unit:.2f} A, as it is set; "
            "remedy: choose less"
        )
    return replace(kind, units=units)


class _Walk:
    """A hinge on its way to its stop and back again; how far it may go counts from where it stood at first."""

    def __init__(self, servo: Guarded, hinge: HingeZero, limits: Limits, stop: Callable[[], bool]) -> None:
        self.name = f"{hinge.servo.name} (id {servo.id})"
        self._servo, self._limits, self._stop = servo, limits, stop
        self._towards = hinge.towards
        self._start = servo.look().position_rad
        self._farthest = TOO_FAR * hinge.way_rad + TOO_FAR_RAD
        self._hottest = min(limits.max_temperature_c, servo.read(servo.table.temperature_limit) - COOL_C)

    def to_stop(self, detector: StopDetector, met_rad: Sequence[float]) -> StopDetector:
        """Go on until the hinge stands against its stop, which it has met at these places before."""
        servo, speed = self._servo, self._limits.speed_rad_s
        seen = servo.look()
        goal, aimed = seen.position_rad, servo.clock.now()
        # A stop that is not reached shows as a hinge that goes too far, or as one that gets nowhere.
        deadline = servo.clock.now() + 2.0 * self._farthest / speed + 5.0
        while not detector.at_stop(servo.clock.now(), seen.position_rad, _effort(seen)):
            self._heed("stopped before its stop was found")
            self._require_way(seen.position_rad, met_rad)
            if servo.clock.now() > deadline:
                way = abs(seen.position_rad - self._start)
                raise NotCalibrated(
                    f"{self.name}: neither moving nor at a stop: {math.degrees(way):.1f} deg of the shaft, pressing "
                    f"with {abs(_effort(seen)):.3g}; limit: {detector.least:.3g} at a stop; "
                    "remedy: give --current more, or less where it holds its own weight"
                )
            _require_health(self.name, seen, self._hottest, self._limits.min_voltage_v)
            now = servo.clock.now()  # a round is as long as the line makes it
            goal, aimed = goal + self._towards * speed * (now - aimed), now
            goal = min(max(goal, seen.position_rad - LEAD_RAD), seen.position_rad + LEAD_RAD)
            servo.aim(count_of(goal))
            seen = servo.look()
        return detector

    def _require_way(self, position_rad: float, met_rad: Sequence[float]) -> None:
        """What has met its stop goes no farther: all that may stand behind what gave way is the structure."""
        if met_rad and self._towards * (position_rad - met_rad[0]) > PAST_RAD:
            met, now, limit = (math.degrees(rad) for rad in (met_rad[0], position_rad, PAST_RAD))
            raise NotCalibrated(
                f"{self.name}: stood still at {met:.2f} deg of the shaft, and went on past it to {now:.2f} deg; "
                f"limit: within {limit:.2f} deg, as of one stop; "
                "remedy: see what was in its way or makes it stick, then calibrate again"
            )
        way = abs(position_rad - self._start)
        if way > self._farthest:
            raise NotCalibrated(
                f"{self.name}: no stop within {math.degrees(way):.1f} deg of the shaft; "
                f"limit: {math.degrees(self._farthest):.1f} deg, its whole motion and a little; "
                "remedy: check that the hinge is coupled, direction and gear_ratio; or use --pose"
            )

    def back_off(self, stop_rad: float) -> None:
        """Take the load off the stop, and make sure that it was one: what only sticks stays where it is.

        A hinge that has not left a place meets it once, however often it is looked at.
        """
        servo = self._servo
        self._heed("stopped at its stop, which it still leans on")
        servo.aim(count_of(stop_rad - self._towards * BACK_OFF_RAD))
        deadline = servo.clock.now() + 2.0 * BACK_OFF_RAD / self._limits.speed_rad_s + 2.0
        came = 0.0
        while servo.clock.now() < deadline and came < 0.9 * BACK_OFF_RAD:
            came = self._towards * (stop_rad - servo.look().position_rad)
            self._heed("stopped while it backed off from its stop")
        if came < CAME_AWAY_RAD:
            raise NotCalibrated(
                f"{self.name}: does not come away from where it stood: {math.degrees(came):.2f} deg of the shaft; "
                f"limit: {math.degrees(CAME_AWAY_RAD):.2f} deg; it is stuck, or --current is too little to lift it "
                "off; remedy: free it, or give more"
            )

    def _heed(self, where: str) -> None:
        if self._stop():
            raise NotCalibrated(f"{self.name}: {where}")


def _require_health(name: str, seen: Snapshot, hottest_c: float, lowest_v: float) -> None:
    for what, value, limit, bad in (
        ("too hot", f"{seen.temperature_c:.0f} °C", f"{hottest_c:.0f} °C", seen.temperature_c >= hottest_c),
        ("supply too low", f"{seen.voltage_v:.1f} V", f"{lowest_v:.1f} V", seen.voltage_v < lowest_v),
    ):
        if bad:
            raise NotCalibrated(f"{name}: {what}: {value}; limit: {limit}; remedy: see to it, then calibrate again")


def _effort(seen: Snapshot) -> float:
    """Current in amperes, or load as part of the stall torque."""
    return seen.current_a if seen.current_a is not None else seen.load or 0.0
