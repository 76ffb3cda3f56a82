"""One slow deployment of a plant: torque at every hinge beside what `size` says, energy, slits."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ori_deploy.loads import hinge_torques
from ori_deploy.motion import CREASES
from sim_backends.physics.plant import Plant
from sim_backends.physics.world import Work

FloatArray = NDArray[np.float64]

SETTLE_S = 0.5
CLOSE_A = CREASES.index("close_a")
_FRAME_S = 0.002
_EVERY = 25


@dataclass
class Trial:
    """What was seen.

    Attributes
    ----------
    fold
        (n, n_cells) where the cells were; what magnets pull at is left out.
    torque_nm, sized_nm
        (n, n_hinges) at the driven creases, positive opening: in the plant, and by virtual work.
    loop_gap_m
        Largest gap of a loop that was cut.
    slit_gap_m
        (n_slits,) at the end, the larger of both ends of each slit.
    contacts
        Places where panels touched, at most.
    gained_j, work
        Energy gained, and who did what.
    """

    fold: FloatArray = field(default_factory=lambda: np.empty(0))
    torque_nm: FloatArray = field(default_factory=lambda: np.empty(0))
    sized_nm: FloatArray = field(default_factory=lambda: np.empty(0))
    loop_gap_m: float = 0.0
    slit_gap_m: FloatArray = field(default_factory=lambda: np.empty(0))
    contacts: int = 0
    gained_j: float = 0.0
    work: Work = field(default_factory=Work)

    @property
    def unexplained_j(self) -> float:
        """Energy that came from nowhere."""
        done = self.work.motors + self.work.air + self.work.magnets - self.work.lost
        return self.gained_j - done

    @property
    def turnover_j(self) -> float:
        """Energy that went to and fro, for comparison."""
        work = self.work
        return abs(work.motors) + abs(work.air) + abs(work.magnets) + work.lost + abs(self.gained_j)


def deploy_slowly(plant: Plant, duration_s: float = 10.0) -> Trial:
    """Turn the shafts of a stowed plant as the design says, all cells in step, and hold at the end."""
    world, seen = plant.world, Trial()
    model = world.model
    drives = model.drives
    cell, crease = np.array([d.cell for d in drives]), np.array([d.crease for d in drives])
    gear, zero = np.array([d.shaft_per_crease for d in drives]), np.array([d.zero_rad for d in drives])
    n = round(duration_s / _FRAME_S)
    along = np.linspace(0.0, 1.0, n + 1)
    fold = along**2 * (3.0 - 2.0 * along)
    shaft = zero + gear * model.linkage.four_bars.angles(fold)[:, cell, crease]
    world.accounts, before = True, world.energy_j
    rows: list[tuple[FloatArray, FloatArray]] = []
    deployed = model.linkage.four_bars.deployed[:, CLOSE_A]
    reach = model.loads.magnets.capture_m if model.loads.magnets.force_n else 0.0
    for k in range(1, n + 1 + round(SETTLE_S / _FRAME_S)):
        plant.step(shaft[min(k, n)], _FRAME_S)
        seen.contacts = max(seen.contacts, world.n_contacts)
        seen.loop_gap_m = max(seen.loop_gap_m, world.loop_gap_m)
        if k % _EVERY == 0 and k <= n and (world.slit_gaps_m[:, 0] >= reach).all():
            rows.append((np.clip(world.angles[:, CLOSE_A] / deployed, 0.0, 1.0), plant.torque_nm * gear))
    seen.fold = np.array([row[0] for row in rows])
    seen.torque_nm = np.array([row[1] for row in rows])
    order = np.argsort(cell)
    sized = hinge_torques(model.linkage, model.solids, model.loads, crease[order], seen.fold)
    opening = np.sign(model.linkage.four_bars.transmission(seen.fold)[:, cell, crease])
    seen.sized_nm = sized.holding[:, cell] + opening * sized.friction[:, cell]
    seen.slit_gap_m = world.slit_gaps_m.max(axis=1)
    seen.gained_j, seen.work = world.energy_j - before, world.work
    return seen
