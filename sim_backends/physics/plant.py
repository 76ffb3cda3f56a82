"""The structure as what simulated servos drive: torque against position, whatever bus they are on."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.errors import InputError
from ori_deploy.files import Design
from ori_deploy.loads import Loads
from sim_backends.load import Reaction
from sim_backends.physics.model import GEAR_RAD_S, STEP_S, Drive, Model, Obstacle
from sim_backends.physics.world import World

FloatArray = NDArray[np.float64]

FASTEST_RAD_S = 30.0


class Plant:
    """A structure behind gears that give and have play. A `sim_backends.load.Load`.

    Parameters
    ----------
    world
        The structure, with a drive for every shaft.
    play_rad
        Free play between shaft and crease, at the shaft.

    Attributes
    ----------
    world
        As given.
    """

    def __init__(self, world: World, play_rad: float = 0.0) -> None:
        drives = world.model.drives
        self.world = world
        self._cell = np.array([d.cell for d in drives], dtype=np.intp)
        self._crease = np.array([d.crease for d in drives], dtype=np.intp)
        self._per_crease = np.array([d.shaft_per_crease for d in drives])
        self._zero = np.array([d.zero_rad for d in drives])
        self._stiffness = np.array([d.stiffness_nm for d in drives])
        # Critical for the rotor on the spring of its gears.
        self._damping = 2.0 * self._stiffness / GEAR_RAD_S
        self._play = 0.5 * play_rad
        self._efficiency = world.model.loads.efficiency
        self._shaft = self.output_rad
        self._torque = np.zeros(len(drives))
        self._secured: frozenset[str] = frozenset()

    @property
    def output_rad(self) -> FloatArray:
        """(n,) where the driven creases are, as shaft positions."""
        return self._zero + self._per_crease * self.world.angles[self._cell, self._crease]

    @property
    def torque_nm(self) -> FloatArray:
        """(n,) mean torque in the shafts over the last step, before the gears' losses."""
        return self._torque.copy()

    def rest(self) -> Reaction:
        """How it stands and pulls now."""
        return Reaction(self._torque.copy(), self.output_rad)

    def step(self, shaft_rad: FloatArray, duration_s: float) -> Reaction:
        """Let time pass, whole milliseconds, while the shafts turn evenly to `shaft_rad` (n,)."""
        steps = max(1, round(duration_s / STEP_S))
        start = self._shaft
        # A shaft that somebody turned by hand jumps: its speed is no speed of gears.
        speed = np.clip((shaft_rad - start) / (steps * STEP_S), -FASTEST_RAD_S, FASTEST_RAD_S)
        total = np.zeros_like(start)
        for k in range(1, steps + 1):
            torque = self._gears(start + (shaft_rad - start) * (k / steps), speed)
            self.world.step(torque)
            total += torque
        self._shaft = np.array(shaft_rad, dtype=np.float64)
        self._torque = total / steps
        drives = self._torque * speed > 0.0
        return Reaction(np.where(drives, self._torque / self._efficiency, self._torque), self.output_rad)

    def secure(self, points: Iterable[str]) -> None:
        """Hold what latches hold from now on, and let go of all else."""
        wanted = frozenset(points)
        if wanted != self._secured:
            self._secured = wanted
            self.world.latch(set(wanted))

    def _gears(self, shaft: FloatArray, speed: FloatArray) -> FloatArray:
        """Torque that passes from shafts to creases, at the shafts."""
        angle, rate = self.world.driven
        twist = shaft - self._zero - self._per_crease * angle
        torque: FloatArray = self._damping * (speed - self._per_crease * rate)
        if self._play == 0.0:
            return np.asarray(torque + self._stiffness * twist)
        beyond = twist - np.minimum(np.maximum(twist, -self._play), self._play)
        return np.asarray(np.where(beyond != 0.0, torque + self._stiffness * beyond, 0.0))


def drives_of(rig: ResolvedRig) -> tuple[Drive, ...]:
    """The actuators of a rig, in the order of the cells."""
    parts = zip(rig.actuators, rig.crease_index, rig.shaft_per_crease, rig.zero_rad, strict=True)
    return tuple(
        Drive(actuator.id, cell, int(crease), float(gear), float(zero), actuator.max_torque_nm)
        for cell, (actuator, crease, gear, zero) in enumerate(parts)
    )


def plant_of(
    design: Design,
    rig: ResolvedRig,
    loads: Loads | None = None,
    *,
    crease_rad: ArrayLike | None = None,
    play_rad: float = 0.0,
    contact: bool = True,
    obstacles: tuple[Obstacle, ...] = (),
) -> Plant:
    """A design driven as a rig says.

    Parameters
    ----------
    crease_rad
        (n_cells, 4) inner angles at the start; stowed without them.
    play_rad
        Free play, at the shafts.

    Raises
    ------
    InputError
        The rig drives another design, or MuJoCo is missing.
    """
    layout = design.structure.layout
    if rig.cell_ids != layout.cell_ids:
        raise InputError(
            "plant: the rig's cells are not the design's", value=", ".join(rig.cell_ids),
            limit=", ".join(layout.cell_ids), remedy="give the design that the plan was made from",
        )  # fmt: skip
    model = Model(design, Loads() if loads is None else loads, drives_of(rig), contact, obstacles)
    world = World(model, 0.0)
    if crease_rad is not None:
        world.put_angles(np.asarray(crease_rad, dtype=np.float64))
    return Plant(world, play_rad)
