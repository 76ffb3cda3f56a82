"""What is watched in every cycle, and the limits at which it becomes a fault."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import HardwareError, HealthReadings, HingeReadings, LatchReading, believable
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.actuators.rig import Latch
from ori_deploy.deploy.going_on import reset_command
from ori_deploy.deploy.result import Fault, FaultKind
from ori_deploy.deploy.states import State
from ori_deploy.motion.plan import Plan

FloatArray = NDArray[np.float64]

CRAWL = 0.05
"""Path rate below which slowing down has become standing still."""


class Monitor:
    """Judges readings. It remembers what was lost and what was last known, and decides nothing else.

    Attributes
    ----------
    lost_replies
        Replies that were lost, corrupt or stale so far, over all hinges.
    folds
        (n_cells,) fold of every cell when it last answered; NaN before the first answer.
    worst_tracking_rad, worst_tracking_hinge
        Largest distance of commanded and measured since `restart`, at the driven crease.
    """

    def __init__(self, plan: Plan, rig: ResolvedRig) -> None:
        self._plan = plan
        self._rig = rig
        self._settings = rig.controller
        self._gear = np.abs(rig.shaft_per_crease)
        n = len(rig.hinges)
        self._fresh = np.zeros(n, dtype=np.bool_)
        self._streak = np.zeros(n, dtype=np.int64)
        self._health_streak = np.zeros(n, dtype=np.int64)
        self._latch_streak: dict[str, int] = {}
        self.lost_replies = 0
        self.folds = np.full(n, np.nan)
        self.restart()

    def restart(self) -> None:
        """Forget the worst tracking error and what latches did not say."""
        self.worst_tracking_rad = 0.0
        self.worst_tracking_hinge = self._rig.hinge_ids[0]
        self._latch_streak.clear()
        self._health_streak[:] = 0

    def seed(self, folds: FloatArray) -> None:
        """Begin from a reading in which every hinge answered, so that the first cycle may lose some."""
        self.folds = folds
        self._streak[:] = 0

    def judge_replies(self, readings: HingeReadings, folds: FloatArray, now: float) -> Fault | None:
        """Count what was lost; too many in a row from one hinge is a fault.

        Parameters
        ----------
        readings
            Of this cycle.
        folds
            (n_cells,) what they mean; NaN where not valid.
        now
            To judge their age.
        """
        fresh = believable(readings, now, self._settings.max_reading_age_s)
        self._fresh = fresh
        if fresh.all():
            self._streak[:] = 0
            self.folds = folds
            return None
        self.folds = np.where(fresh, folds, self.folds)
        self._streak = np.where(fresh, 0, self._streak + 1)
        self.lost_replies += int((~fresh).sum())
        worst = int(np.argmax(self._streak))
        if self._streak[worst] <= self._settings.lost_replies_allowed:
            return None
        return Fault(
            FaultKind.LOST_REPLIES,
            self._rig.hinge_ids[worst],
            f"{self._streak[worst]} valid replies missing in a row; limit: {self._settings.lost_replies_allowed}",
            "check its cable and power",
            now,
        )

    def judge_tracking(self, readings: HingeReadings, commanded_rad: FloatArray, now: float) -> Fault | None:
        """Compare measured with commanded positions, at the driven creases."""
        error = np.abs(readings.position_rad - commanded_rad) / self._gear
        worst = int(np.argmax(np.where(self._fresh, error, -1.0)))
        if not self._fresh[worst]:  # nobody answered
            return None
        value = float(error[worst])
        if value > self.worst_tracking_rad:
            self.worst_tracking_rad = value
            self.worst_tracking_hinge = self._rig.hinge_ids[worst]
        if value <= self._settings.path_tolerance_rad:
            return None
        hinge = self._rig.hinges[worst]
        return Fault(
            FaultKind.PATH_TOLERANCE,
            self._rig.hinge_ids[worst],
            f"crease {hinge.crease} of cell {hinge.cell} is {value:.4f} rad from its command; "
            f"limit: path_tolerance_rad = {self._settings.path_tolerance_rad:.4f}",
            "find what blocks or overloads it",
            now,
        )

    def at_goal(self, readings: HingeReadings, goal_rad: FloatArray) -> bool:
        """Whether every crease is believably measured within `goal_tolerance_rad`, in this cycle's readings."""
        away = np.abs(readings.position_rad - goal_rad) / self._gear
        return bool((self._fresh & (away <= self._settings.goal_tolerance_rad)).all())

    def goal_fault(self, readings: HingeReadings, goal_rad: FloatArray, now: float) -> Fault:
        """The crease that is farthest from its goal; silent ones first."""
        away = np.abs(readings.position_rad - goal_rad) / self._gear
        i = int(np.argmax(np.where(self._fresh, away, np.inf)))
        hinge = self._rig.hinges[i]
        where = f"{away[i]:.4f} rad from where it was to go" if self._fresh[i] else "silent"
        return Fault(
            FaultKind.GOAL_TOLERANCE,
            self._rig.hinge_ids[i],
            f"crease {hinge.crease} of cell {hinge.cell} is {where}; "
            f"limit: goal_tolerance_rad = {self._settings.goal_tolerance_rad:.4f}",
            "find what holds it back",
            now,
        )

    def judge_step(
        self, commanded_fold: float, rate_limit: float, allowed: float, now: float, rate: float = CRAWL
    ) -> Fault | None:
        """Fault when cells are out of step by `allowed` or more, or leave room for less than `rate`."""
        away = np.abs(self.folds - commanded_fold)
        spread = float(self.folds.max() - self.folds.min())
        if spread < allowed and rate_limit >= rate:
            return None
        worst = int(np.argmax(away))
        cell = f"fold {self.folds[worst]:.4f}, commanded {commanded_fold:.4f}, spread of all cells {spread:.4f}"
        limit = f"the plan's step tolerance, here {allowed:.4f}"
        thing, remedy = self._plan.cell_ids[worst], "find what holds this cell back"
        if spread >= allowed:
            detail = f"{cell}; limit: {limit}"
        elif float(away.min()) <= spread:
            detail = f"{cell}; that leaves no room to stop within {limit}"
        else:  # all alike: no cell is to blame
            thing, remedy = "all cells", "find what holds them all back, or why their goals come late"
            detail = f"at least {away.min():.4f} of fold from the command, {commanded_fold:.4f}; "
            detail += f"that leaves no room to stop within {limit}"
        return Fault(FaultKind.OUT_OF_STEP, thing, detail, remedy, now)

    def judge_health(self, health: HealthReadings, torque_wanted: bool, now: float) -> Fault | None:
        """Look for hardware errors, lost torque, silence, heat and low voltage, in this order."""
        settings, valid = self._settings, health.sound
        self._health_streak = np.where(valid, 0, self._health_streak + 1)
        errors = health.valid & (health.hardware_error != 0)
        if errors.any():
            i = int(np.argmax(errors))
            name = str(HardwareError(int(health.hardware_error[i])).name)
            remedy = ", then ".join(["remove its cause", *filter(None, [reset_command(self._rig, i)])])
            return self._health_fault(FaultKind.HARDWARE_ERROR, i, f"reports {name}", remedy, now)
        limp = health.valid & ~health.torque_on
        if torque_wanted and limp.any():
            return self._health_fault(
                FaultKind.TORQUE_LOST,
                int(np.argmax(limp)),
                "torque is off though it was turned on: it restarted or lost power",
                "check its supply",
                now,
            )
        worst = int(np.argmax(self._health_streak))
        if self._health_streak[worst] > settings.lost_replies_allowed:
            detail = f"{self._health_streak[worst]} valid health replies missing in a row; "
            detail += f"limit: {settings.lost_replies_allowed}"
            return self._health_fault(FaultKind.LOST_REPLIES, worst, detail, "check its cable and power", now)
        hot = valid & (health.temperature_c > settings.max_temperature_c)
        if hot.any():
            i = int(np.argmax(hot))
            detail = f"{health.temperature_c[i]:.1f} °C; limit: {settings.max_temperature_c:.1f} °C"
            return self._health_fault(FaultKind.OVER_TEMPERATURE, i, detail, "let it cool", now)
        low = valid & (health.voltage_v < settings.min_voltage_v)
        if low.any():
            i = int(np.argmax(low))
            detail = f"{health.voltage_v[i]:.2f} V; limit: {settings.min_voltage_v:.2f} V"
            return self._health_fault(FaultKind.LOW_VOLTAGE, i, detail, "check the supply", now)
        return None

    def _health_fault(self, kind: FaultKind, hinge: int, detail: str, remedy: str, now: float) -> Fault:
        return Fault(kind, self._rig.hinge_ids[hinge], detail, remedy, now)

    def judge_latches(self, state: State, readings: tuple[LatchReading, ...], now: float) -> Fault | None:
        """What latches may say in a state: while moving nothing impossible, at rest that they hold."""
        if state is State.MOVING:
            return self.judge_impossible_latches(readings, now)
        held = {State.DEPLOYED: self._rig.latches, State.STOWED: self._rig.stow_locks}.get(state, ())
        return self.judge_held_latches(readings, held, now)

    def judge_impossible_latches(self, readings: tuple[LatchReading, ...], now: float) -> Fault | None:
        """A latch that says closed at the other end of the motion has a sensor that cannot be believed."""
        fold = float(self.folds.mean())
        n_latches = len(self._rig.latches)
        for i, reading in enumerate(readings):
            far = fold < 0.5 if i < n_latches else fold > 0.5
            if far and reading.valid and reading.confirmed:
                return Fault(
                    FaultKind.LATCH_SENSOR,
                    reading.id,
                    f"says closed at fold {fold:.3f}, where it cannot be",
                    "check its sensor",
                    now,
                )
        return None

    def judge_held_latches(
        self, readings: tuple[LatchReading, ...], held: tuple[Latch, ...], now: float
    ) -> Fault | None:
        """A latch that held and no longer says so, more often in a row than replies may be lost."""
        wanted = {latch.id for latch in held}
        for reading in (reading for reading in readings if reading.id in wanted):
            streak = 0 if reading.valid and reading.confirmed else self._latch_streak.get(reading.id, 0) + 1
            self._latch_streak[reading.id] = streak
            if streak > self._settings.lost_replies_allowed:
                return Fault(
                    FaultKind.LATCH_LOST if reading.valid else FaultKind.LOST_REPLIES,
                    reading.id,
                    f"was confirmed and now is {describe(reading)}",
                    "look at the latch",
                    now,
                )
        return None


def describe(reading: LatchReading) -> str:
    """What a latch reading says, in words."""
    if not reading.valid:
        return "silent"
    if reading.confirmed is None:
        return "unknown: its sensor cannot tell"
    return "closed" if reading.confirmed else "open"
