"""A rig fitted to a design: every crease that moves has one actuator, every latch point a latch.

The cells and latch points are names here; what they mean is the design's business.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.actuators.dynamixel.throughput import check_rate, check_watchdog, planned_times
from ori_deploy.actuators.dynamixel.wiring import Wiring, resolve_wiring
from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.actuators.mcu.wiring import resolve_wiring as resolve_mcu
from ori_deploy.actuators.rig import (
    CREASE_ORDER,
    STOW_POINT,
    Actuator,
    Backend,
    CellTemplate,
    ControllerSettings,
    Hinge,
    Latch,
    MockSettings,
    PassiveCreases,
    Rig,
)
from ori_deploy.errors import RigError

FloatArray = NDArray[np.float64]


FROM_TEMPLATE = "latch_"
"""Latches of an [each_latch_point] template have this before the name of their point."""


@dataclass(frozen=True, eq=False)
class ResolvedRig:
    """One driven crease per cell; arrays over hinges are in the order of the cells.

    Attributes
    ----------
    cell_ids
        Cells, as the design orders them; n_cells = n_hinges.
    hinges, actuators
        The hinge and the actuator of every cell.
    latches, stow_locks
        Latches that secure the deployed state, and those that secure the stowed one.
    passive
        Limits of the creases that are not driven.
    backend, rate_hz, controller, mock
        As in the rig file.
    wiring
        Which Dynamixel servo is which; None for other backends.
    mcu
        What is wired to a microcontroller: everything, or latches alone; None without one.
    source, sha256
        The file and its digest; None and "" for a rig that came from no file.
    """

    cell_ids: tuple[str, ...]
    hinges: tuple[Hinge, ...]
    actuators: tuple[Actuator, ...]
    latches: tuple[Latch, ...]
    stow_locks: tuple[Latch, ...]
    passive: PassiveCreases
    backend: Backend
    rate_hz: float
    controller: ControllerSettings
    mock: MockSettings
    wiring: Wiring | None
    mcu: McuWiring | None
    source: str | None
    sha256: str

    @property
    def hinge_ids(self) -> tuple[str, ...]:
        """Ids of the actuators, in the order of the cells."""
        return tuple(actuator.id for actuator in self.actuators)

    @property
    def latch_ids(self) -> tuple[str, ...]:
        """Ids of all latches: those of the deployed state, then the stow locks."""
        return tuple(latch.id for latch in self.latches + self.stow_locks)

    @property
    def delay_s(self) -> float:
        """How long after its command a goal is due: a microcontroller has goals queued."""
        return self.mcu.settings.lead_s if self.mcu is not None and self.mcu.hinges else 0.0

    @property
    def crease_index(self) -> NDArray[np.intp]:
        """(n_hinges,) which of the four creases of its cell each hinge drives."""
        return np.array([CREASE_ORDER.index(hinge.crease) for hinge in self.hinges], dtype=np.intp)

    @property
    def shaft_per_crease(self) -> FloatArray:
        """(n_hinges,) signed gear ratio."""
        return np.array([hinge.direction * hinge.gear_ratio for hinge in self.hinges])

    @property
    def zero_rad(self) -> FloatArray:
        """(n_hinges,) shaft positions at which the driven creases' inner angles are 0."""
        return np.array([hinge.zero_rad for hinge in self.hinges])

    @property
    def position_limits_rad(self) -> FloatArray:
        """(n_hinges, 2) smallest and largest position of every shaft."""
        return np.array([(a.min_position_rad, a.max_position_rad) for a in self.actuators])

    def driven(self, crease_values: ArrayLike) -> FloatArray:
        """Pick the driven creases: (..., n_cells, 4) to (..., n_hinges)."""
        values = np.asarray(crease_values, dtype=np.float64)
        return values[..., np.arange(len(self.cell_ids)), self.crease_index]

    def to_actuator(self, crease_angles_rad: ArrayLike) -> FloatArray:
        """Shaft positions (..., n_hinges) for crease angles (..., n_cells, 4)."""
        return self.zero_rad + self.shaft_per_crease * self.driven(crease_angles_rad)

    def to_crease(self, shaft_rad: ArrayLike) -> FloatArray:
        """Angles of the driven creases (..., n_hinges) for shaft positions (..., n_hinges)."""
        return (np.asarray(shaft_rad, dtype=np.float64) - self.zero_rad) / self.shaft_per_crease

    def crease_limits(self) -> tuple[FloatArray, FloatArray]:
        """Velocity and acceleration limits of every crease, each (n_cells, 4); inf where unlimited.

        A driven crease has the smaller of its own limit and its actuator's through the gear.
        """
        velocity = np.full((len(self.cell_ids), 4), self.passive.max_velocity_rad_s or np.inf)
        acceleration = np.full_like(velocity, self.passive.max_acceleration_rad_s2 or np.inf)
        for i, (hinge, actuator) in enumerate(zip(self.hinges, self.actuators, strict=True)):
            c = CREASE_ORDER.index(hinge.crease)
            velocity[i, c] = min(
                actuator.max_velocity_rad_s / hinge.gear_ratio, hinge.max_crease_velocity_rad_s or np.inf
            )
            acceleration[i, c] = min(
                actuator.max_acceleration_rad_s2 / hinge.gear_ratio,
                hinge.max_crease_acceleration_rad_s2 or np.inf,
            )
        return velocity, acceleration

    def latch_reach(self, latch: Latch) -> FloatArray:
        """(n_hinges,) how far from closed a shaft may be for a latch to take hold; inf where it does not matter.

        A latch on a slit or on the stack depends on every cell, one on a cell on that cell alone.
        """
        reach = np.abs(self.shaft_per_crease) * latch.capture_range_rad
        kind, _, name = latch.secures.partition(":")
        if kind == "cell":
            reach = np.where([cell == name for cell in self.cell_ids], reach, np.inf)
        return reach

    def check_range(self, crease_angles_rad: ArrayLike) -> None:
        """Check that every shaft can follow a motion, with `start_tolerance_rad` to spare at both ends.

        Parameters
        ----------
        crease_angles_rad
            (n, n_cells, 4) the motion.

        Raises
        ------
        RigError
            Naming the actuator, the position it would have to reach and its range.
        """
        shaft = self.to_actuator(crease_angles_rad).reshape(-1, len(self.hinges))
        slack = self.controller.start_tolerance_rad * np.abs(self.shaft_per_crease)
        low, high = shaft.min(axis=0) - slack, shaft.max(axis=0) + slack
        limits = self.position_limits_rad
        for i in np.flatnonzero((low < limits[:, 0]) | (high > limits[:, 1])):
            actuator, hinge = self.actuators[i], self.hinges[i]
            raise RigError(
                f"actuator {actuator.id} ({hinge.crease} of cell {hinge.cell}): position range too small",
                value=f"motion from {low[i]:.4g} to {high[i]:.4g} rad at the shaft, start tolerance included",
                limit=f"{actuator.min_position_rad:.4g} to {actuator.max_position_rad:.4g} rad",
                remedy="widen min_position_rad and max_position_rad, or change zero_rad or gear_ratio",
                source=self.source,
            )


def resolve_rig(rig: Rig, cell_ids: Sequence[str], latch_points: Sequence[str]) -> ResolvedRig:
    """Fit a rig to a design.

    Parameters
    ----------
    rig
        From `load_rig`.
    cell_ids, latch_points
        What has to be driven and what has to be secured, as the plan names them.

    Raises
    ------
    RigError
        An unknown actuator, cell or latch point; two actuators on one crease; two creases on one actuator;
        two driven creases in one cell; a cell without a driven crease; a latch point without a latch.
    """
    actuators, hinges = _hinges(rig, cell_ids)
    latches = _latches(rig, latch_points)
    by_id = {actuator.id: actuator for actuator in actuators}
    by_cell = {hinge.cell: hinge for hinge in hinges}
    in_order = tuple(by_cell[cell] for cell in cell_ids)
    driven = tuple(by_id[hinge.actuator] for hinge in in_order)
    deployed = tuple(latch for latch in latches if latch.secures != STOW_POINT)
    stowed = tuple(latch for latch in latches if latch.secures == STOW_POINT)
    wiring, mcu = _wire(rig, driven, deployed + stowed)
    return ResolvedRig(
        cell_ids=tuple(cell_ids),
        hinges=in_order,
        actuators=driven,
        latches=deployed,
        stow_locks=stowed,
        passive=rig.passive_creases,
        backend=rig.backend,
        rate_hz=rig.rate_hz,
        controller=rig.controller,
        mock=rig.mock,
        wiring=wiring,
        mcu=mcu,
        source=rig.source,
        sha256=rig.sha256,
    )


def _wire(rig: Rig, driven: Sequence[Actuator], latches: Sequence[Latch]) -> tuple[Wiring | None, McuWiring | None]:
    """What is wired to which bus. Beside servos, a microcontroller has the latches without a servo of their own."""
    if rig.backend == "mcu" and rig.mcu is not None:
        return None, resolve_mcu(rig.mcu, driven, latches, rig.rate_hz, rig.source)
    if rig.backend != "dynamixel" or rig.dynamixel is None:
        return None, None
    on_servos, mcu = list(latches), None
    if rig.mcu is not None:
        pins = {servo.latch for servo in rig.dynamixel.servo}
        on_servos = [latch for latch in latches if latch.id in pins]
        others = [latch for latch in latches if latch.id not in pins]
        mcu = resolve_mcu(rig.mcu, (), others, rig.rate_hz, rig.source)
    wiring = resolve_wiring(rig.dynamixel, driven, on_servos, rig.source)
    check_watchdog(rig.dynamixel, rig.rate_hz, rig.source)
    check_rate(wiring, planned_times(wiring), rig.rate_hz, fast=rig.dynamixel.fast_sync_read, source=rig.source)
    return wiring, mcu


def _hinges(rig: Rig, cell_ids: Sequence[str]) -> tuple[list[Actuator], list[Hinge]]:
    """All actuators and hinges, those made from the template included, checked against the cells."""
    _check_hinges(rig, cell_ids)
    actuators, hinges = list(rig.actuator), list(rig.hinge)
    named = {hinge.cell for hinge in hinges}
    for cell in (cell for cell in cell_ids if cell not in named):
        if rig.each_cell is None:
            raise RigError(
                f"missing crease: cell {cell} has no driven crease",
                value=f"hinges for {', '.join(sorted(named)) or 'no cell'}",
                limit="one driven crease in every cell",
                remedy=f'add a [[hinge]] with cell = "{cell}", or an [each_cell] template',
                source=rig.source,
            )
        actuator, hinge = _from_template(rig.each_cell, cell)
        actuators.append(actuator)
        hinges.append(hinge)
    _refuse_duplicates("actuator id", [actuator.id for actuator in actuators], rig.source)
    return actuators, hinges


def _from_template(template: CellTemplate, cell: str) -> tuple[Actuator, Hinge]:
    drive = asdict(template)
    limits = drive.pop("actuator")
    name = f"servo_{cell}"
    return Actuator(id=name, **limits), Hinge(actuator=name, cell=cell, **drive)


def _check_hinges(rig: Rig, cell_ids: Sequence[str]) -> None:
    known = {actuator.id for actuator in rig.actuator}
    drives: dict[str, Hinge] = {}
    driven: dict[str, Hinge] = {}
    for i, hinge in enumerate(rig.hinge):
        where = f"hinge[{i}]"
        if hinge.actuator not in known:
            raise RigError(
                f"{where}.actuator: unknown actuator",
                value=hinge.actuator,
                limit=f"one of {', '.join(sorted(known)) or '(none defined)'}",
                remedy="define it in an [[actuator]] table, or correct its name",
                source=rig.source,
            )
        if hinge.cell not in cell_ids:
            raise RigError(
                f"{where}.cell: unknown cell",
                value=hinge.cell,
                limit=f"one of {', '.join(cell_ids)}",
                remedy="use a cell id of the design",
                source=rig.source,
            )
        if other := driven.get(hinge.cell):
            _refuse_second_drive(where, hinge, other, rig.source)
        if other := drives.get(hinge.actuator):
            raise RigError(
                f"{where}: two creases on one actuator",
                value=f"{hinge.actuator} drives {other.cell}/{other.crease} and {hinge.cell}/{hinge.crease}",
                limit="one crease per actuator",
                remedy="give each crease an actuator of its own",
                source=rig.source,
            )
        driven[hinge.cell] = drives[hinge.actuator] = hinge
    for name in sorted(known - drives.keys()):
        raise RigError(
            f"actuator {name} drives no crease",
            limit="every actuator has one [[hinge]]",
            remedy="add its [[hinge]], or remove the actuator",
            source=rig.source,
        )


def _refuse_second_drive(where: str, hinge: Hinge, other: Hinge, source: str | None) -> None:
    if hinge.crease == other.crease:
        raise RigError(
            f"{where}: two actuators on one crease",
            value=f"{other.actuator} and {hinge.actuator} on {hinge.cell}/{hinge.crease}",
            limit="one actuator per crease",
            remedy="remove one of the two hinges",
            source=source,
        )
    raise RigError(
        f"{where}: two driven creases in cell {hinge.cell}",
        value=f"{other.crease} by {other.actuator} and {hinge.crease} by {hinge.actuator}",
        limit="one driven crease per cell: a cell has one degree of freedom, and two drives fight",
        remedy="remove one of the two hinges",
        source=source,
    )


def _latches(rig: Rig, latch_points: Sequence[str]) -> list[Latch]:
    for i, latch in enumerate(rig.latch):
        if latch.secures != STOW_POINT and latch.secures not in latch_points:
            raise RigError(
                f"latch[{i}].secures: unknown latch point",
                value=latch.secures,
                limit=f"one of {', '.join([*latch_points, STOW_POINT])}",
                remedy="use a latch point of the plan",
                source=rig.source,
            )
    latches = list(rig.latch)
    secured = {latch.secures for latch in latches}
    for point in (point for point in latch_points if point not in secured):
        if rig.each_latch_point is None:
            raise RigError(
                f"latch point {point} has no latch",
                limit="at least one latch on every latch point, or the deployed state is not locked",
                remedy=f'add a [[latch]] with secures = "{point}", or an [each_latch_point] template',
                source=rig.source,
            )
        latches.append(Latch(id=f"{FROM_TEMPLATE}{point}", secures=point, **asdict(rig.each_latch_point)))
    _refuse_duplicates("latch id", [latch.id for latch in latches], rig.source)
    return latches


def _refuse_duplicates(what: str, names: list[str], source: str | None) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise RigError(
                f"duplicate {what}",
                value=name,
                limit="ids are unique",
                remedy="rename one of them",
                source=source,
            )
