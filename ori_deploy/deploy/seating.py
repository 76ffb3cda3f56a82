"""Seating: the last of the path, where slits close on each other, and what is made of their touching.

With its slits closed the structure is over-constrained: cells meet at faces, and each of them is driven all the same.
So hinges push with a part of their strength there; that a cell touches is expected and noted; and when the motion
ends in a fault, what was noted tells whether it touched too early, unevenly, or not at all. A deployment that the
latches confirm is a good one whatever was noted.
"""

from __future__ import annotations

import logging
import math
from dataclasses import replace

import numpy as np

from ori_deploy.actuators.bus import BoolArray, HingeReadings
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.link import Link
from ori_deploy.deploy.monitor import FloatArray, Monitor
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.queued import Place
from ori_deploy.deploy.result import Fault, FaultKind
from ori_deploy.deploy.states import State
from ori_deploy.motion.plan import Plan, StageName

log = logging.getLogger(__name__)

DEBOUNCE_S = 0.03
"""For so long a cell has to look like touching; three cycles at least."""

LEAST_CYCLES = 20
"""Of free motion, before it is known how far a hinge lags while nothing is in its way."""

SIGMAS = 5.0
"""Of what the lag strayed in free motion: beyond it, something is in the way."""

SMALLEST_LAG_RAD = 0.003
"""At the crease; a smaller lag is backlash and resolution."""

PUSHING = 1.5
"""Times the largest current of the free motion: with that, half as much lag says that a cell touches."""

_OFF_PATH = frozenset({FaultKind.PATH_TOLERANCE, FaultKind.OUT_OF_STEP, FaultKind.GOAL_TOLERANCE})

_LOOK = {
    FaultKind.SEATING_EARLY: "see what is in its slit; if nothing is, correct zero_rad of its hinge or raise "
    "seating_effort",
    FaultKind.SEATING_UNEVEN: "see what holds this cell, and compare zero_rad of the hinges",
    FaultKind.SEATING_LATE: "see whether its slit is closed: if so look at the latch, if not correct zero_rad of its "
    "hinge",
}


class FreeLag:
    """How far the driven creases lag behind their goals while nothing is in their way, learnt from free motion.

    A servo's lag grows with its speed: `lag = tau * speed`, with one tau per hinge by least squares. What is left
    over is noise, play, and the sag under load.
    """

    def __init__(self, n_hinges: int, unknown_rad: float) -> None:
        self._unknown_rad = unknown_rad
        self._count, self._lag2, self._cross, self._speed2, self._current_a = np.zeros((5, n_hinges))

    def learn(self, lag_rad: FloatArray, speed_rad_s: FloatArray, current_a: FloatArray) -> None:
        """One cycle; (n_hinges,) each, at the creases. NaN teaches nothing."""
        known = np.isfinite(lag_rad)
        lag, speed = np.where(known, lag_rad, 0.0), np.where(known, speed_rad_s, 0.0)
        self._count += known
        self._lag2 += lag * lag
        self._cross += lag * speed
        self._speed2 += speed * speed
        self._current_a = np.fmax(self._current_a, current_a)

    def touching(self, lag_rad: FloatArray, speed_rad_s: FloatArray, current_a: FloatArray) -> BoolArray:
        """(n_hinges,) which hinges lag so that something must be in their way; False where the lag is NaN."""
        tau = np.divide(self._cross, self._speed2, out=np.zeros_like(self._cross), where=self._speed2 > 0.0)
        left = np.maximum(self._lag2 - tau * self._cross, 0.0)
        spread = SIGMAS * np.sqrt(left / np.maximum(self._count, 1.0))
        margin = np.clip(spread, SMALLEST_LAG_RAD, self._unknown_rad)
        margin = np.where(self._count >= LEAST_CYCLES, margin, self._unknown_rad)
        beyond = lag_rad - tau * speed_rad_s
        pushes = (self._current_a > 0.0) & (current_a > PUSHING * self._current_a)
        return np.asarray(beyond > np.where(pushes, 0.5 * margin, margin))


class Seating:
    """Limits the effort, notes who touches where, and names faults after it.

    Parameters
    ----------
    plan, table, rig
        Where seating begins, the path, and the settings.
    link, monitor
        The bus, and the folds that were last measured.

    Attributes
    ----------
    contact_fold
        (n_cells,) fold of every cell that touches, where it began to; NaN for the others.
    """

    def __init__(self, plan: Plan, table: PathTable, rig: ResolvedRig, link: Link, monitor: Monitor) -> None:
        self._table, self._rig, self._link, self._monitor = table, rig, link, monitor
        self._settings = rig.controller
        self._begins = plan.step_tolerance.seating_fold
        self._seats = self._begins < 1.0  # no slit closes in some plans
        self._limits = link.bus.limits_effort
        self._told = False
        self._per_crease = rig.shaft_per_crease
        self._opening = np.sign((table.shaft_rad[-1] - table.shaft_rad[0]) / self._per_crease)
        n = len(rig.hinges)
        self._free = FreeLag(n, self._settings.goal_tolerance_rad)
        self._debounce = max(3, math.ceil(DEBOUNCE_S * rig.rate_hz))
        self._active = False
        self.contact_fold = np.full(n, np.nan)
        self._forget()

    def _forget(self) -> None:
        n = len(self.contact_fold)
        self.contact_fold = np.full(n, np.nan)
        self._streak = np.zeros(n, dtype=np.int64)
        self._began = np.full(n, np.nan)
        self._touched = np.zeros(n, dtype=np.bool_)

    def within(self, stage: StageName | None, fold: float) -> bool:
        """Whether slits close there."""
        return self._seats and (stage == "latch" or (stage == "open" and fold >= self._begins))

    # -- effort --------------------------------------------------------------------------------------

    def limit(self, state: State, stage: StageName | None, place: Place, fault: Fault | None, now: float) -> None:
        """Let hinges push as hard as what they do asks for; what has a fault goes on as it was.

        Unless the fault is that a latch let go: then nothing but the hinges holds the structure.

        Parameters
        ----------
        state, stage
            At the end of a cycle.
        place
            Where the goals are.
        fault
            The latched one.
        now
            For faults of the bus.
        """
        if state is State.DEPLOYED:
            part = self._settings.holding_effort
        elif state in (State.MOVING, State.LATCHING, State.HOLD, State.STOPPING):
            closes = self._seats and place.fold >= self._begins and place.rate > 0.0  # turning round, say
            part = self._settings.seating_effort if closes or self.within(stage, place.fold) else 1.0
        elif state is State.FAULT and fault is not None and fault.kind is FaultKind.LATCH_LOST:
            part = 1.0
        else:
            return
        if self._limits:
            self._link.limit_effort(part, now)
        elif part < 1.0 and not self._told:
            self._told = True
            log.warning("these hinges cannot be told to push less (seating_effort, holding_effort)")

    # -- contact -------------------------------------------------------------------------------------

    def watch(self, readings: HingeReadings, due: Place, state: State, stage: StageName | None) -> None:
        """Look at one cycle's readings, before they are judged.

        Parameters
        ----------
        readings
            Of this cycle.
        due
            Where the motion should be.
        state, stage
            What is being done.
        """
        self._active = False
        if not self._seats or state not in (State.MOVING, State.LATCHING):
            return
        self._active = self.within(stage, due.fold)
        if not self._active:
            self._forget()
        if not due.on_path or stage not in ("open", "latch"):
            return
        behind = (due.goal_rad - readings.position_rad) / self._per_crease
        lag = np.where(readings.valid, self._opening * behind, np.nan)
        speed = np.abs(due.rate * self._table.shaft_rate_at(due.path_time_s) / self._per_crease)
        if self._active:
            self._note(self._free.touching(lag, speed, readings.current_a), np.isfinite(lag))
        elif state is State.MOVING:
            self._free.learn(lag, speed, readings.current_a)

    def _note(self, touching: BoolArray, known: BoolArray) -> None:
        """A cell that stands where slits do not close yet does not touch, whatever holds it."""
        folds = self._monitor.folds
        touching = touching & (folds >= self._begins)
        begins = touching & (self._streak == 0)
        self._began = np.where(begins, folds, self._began)
        self._streak = np.where(known, np.where(touching, self._streak + 1, 0), self._streak)
        in_contact = self._streak >= self._debounce
        self._touched |= in_contact
        self.contact_fold = np.where(in_contact, self._began, np.nan)

    # -- faults --------------------------------------------------------------------------------------

    def named(self, fault: Fault) -> Fault:
        """The same fault, as what it is while slits close; every other as it is."""
        if not self._active:
            return fault
        if fault.kind is FaultKind.LATCH_TIMEOUT:
            return self._of_latch(fault)
        if fault.kind in _OFF_PATH and (self._monitor.folds >= self._begins).all():
            return self._of_motion(fault)
        return fault

    def _of_motion(self, fault: Fault) -> Fault:
        """Cells that could not go on."""
        cells = np.ones(len(self.contact_fold), dtype=np.bool_)
        found = self._uneven(fault, cells) or (
            self._early(fault, cells) if fault.kind is FaultKind.OUT_OF_STEP else None
        )
        if found is not None:
            return found
        if fault.kind is FaultKind.OUT_OF_STEP:
            cells_by_name = self._rig.cell_ids
            if fault.thing not in cells_by_name:
                return fault  # all alike, and late: that is not uneven
            return self._renamed(fault, FaultKind.SEATING_UNEVEN, cells_by_name.index(fault.thing))
        cell = self._rig.hinge_ids.index(fault.thing)
        touches = np.isfinite(self.contact_fold[cell])
        return self._renamed(fault, FaultKind.SEATING_EARLY, cell) if touches else fault

    def _of_latch(self, fault: Fault) -> Fault:
        """A latch that did not confirm; one whose sensor is silent or cannot tell says nothing of slits."""
        latch = next((latch for latch in self._rig.latches if latch.id == fault.thing), None)
        reading = next((reading for reading in self._link.latches if reading.id == fault.thing), None)
        if latch is None or reading is None or reading.confirmed is not False:
            return fault
        cells = np.isfinite(self._rig.latch_reach(latch))
        found = self._uneven(fault, cells) or self._early(fault, cells)
        if found is None and not self._touched[cells].any():
            least = int(np.argmin(np.where(cells, self._monitor.folds, np.inf)))
            found = self._renamed(fault, FaultKind.SEATING_LATE, least)
        return found or fault

    def _uneven(self, fault: Fault, cells: BoolArray) -> Fault | None:
        contact = self.contact_fold[cells & np.isfinite(self.contact_fold)]
        if len(contact) < 2 or np.ptp(contact) <= self._settings.seating_tolerance:
            return None
        return self._renamed(fault, FaultKind.SEATING_UNEVEN, self._first(cells))

    def _early(self, fault: Fault, cells: BoolArray) -> Fault | None:
        contact = self.contact_fold[cells & np.isfinite(self.contact_fold)]
        if not len(contact) or 1.0 - contact.min() <= self._settings.seating_tolerance:
            return None
        return self._renamed(fault, FaultKind.SEATING_EARLY, self._first(cells))

    def _first(self, cells: BoolArray) -> int:
        """The cell among these that touched first."""
        return int(np.nanargmin(np.where(cells, self.contact_fold, np.nan)))

    def _renamed(self, fault: Fault, kind: FaultKind, cell: int) -> Fault:
        names, contact = self._rig.cell_ids, self.contact_fold
        touch = [f"{names[i]} at fold {contact[i]:.4f}" for i in np.argsort(contact) if np.isfinite(contact[i])]
        detail = (
            f"cells in contact: {', '.join(touch) or 'none'}; this one is at fold {self._monitor.folds[cell]:.4f}"
        )
        limit = f"limit: seating_tolerance = {self._settings.seating_tolerance:g}"
        return replace(
            fault,
            kind=kind,
            thing=names[cell],
            detail=f"{detail}; {limit}; found by {fault.kind}: {fault.thing}: {fault.detail}",
            remedy=_LOOK[kind],
        )
