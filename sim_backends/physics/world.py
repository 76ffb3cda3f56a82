"""A model in motion: a millisecond at a time, with air, magnets and motors acting on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.loads import skin_forces
from ori_deploy.profiles.sphere import cross
from sim_backends.physics.model import LOOP_SOFTNESS, STEP_S, Model
from sim_backends.physics.need import mujoco

FloatArray = NDArray[np.float64]


@dataclass
class Work:
    """Work done since the start, joule.

    Attributes
    ----------
    motors, air, magnets
        By what acts from outside on the structure and its energy of weight, springs and motion.
    lost
        To viscous and dry friction of the creases.
    """

    motors: float = 0.0
    air: float = 0.0
    magnets: float = 0.0
    lost: float = 0.0


class World:
    """A structure that moves.

    Parameters
    ----------
    model
        What moves.
    fold
        Where it begins, at rest: a fold of all cells, or (n_cells,) of each.

    Attributes
    ----------
    model
        As given.
    accounts
        Whether `work` is kept: it takes as long as the motion.
    work
        Account of energy.
    push
        (n_bodies, 6) more forces and torques at the bodies' centres, from outside; kept until changed.
    """

    def __init__(self, model: Model, fold: ArrayLike = 1.0) -> None:
        self._mujoco: Any = mujoco()
        self.model = model
        self._m: Any = self._mujoco.MjModel.from_xml_string(model.xml(cuts_apart=True))
        self._d: Any = self._mujoco.MjData(self._m)
        layout = model.design.structure.layout
        self._joint = np.array([self._m.joint(model.joint(h.cell, h.crease)).qposadr[0] for h in model.hangs])
        self._where = np.empty((layout.n_cells, 4), dtype=np.intp)
        for address, hang in zip(self._joint, model.hangs, strict=True):
            self._where[hang.cell, hang.crease] = address
        names = [model.body(p) for p in range(layout.n_panels)]
        self._body = np.array([0 if name == "world" else self._m.body(name).id for name in names])
        self._driven = np.array([self._where[d.cell, d.crease] for d in model.drives], dtype=np.intp)
        deployed = model.linkage.four_bars.deployed
        self._driven_deployed = np.array([deployed[d.cell, d.crease] for d in model.drives])
        skin = model.solids.skin
        blown = np.flatnonzero(self._body[skin.panel] > 0)  # what is held feels nothing
        self._skin = replace(skin, **{f.name: getattr(skin, f.name)[blown] for f in fields(skin)})
        self._skin_body = self._body[self._skin.panel]
        halves = [(h.panel, layout.panel_ids[h.panel]) for h in model.hangs if h.half]
        self._cuts = np.array(
            [[self._m.site(f"{body} {name}").id for body in (model.body(p), f"{name} half")] for p, name in halves]
        )
        # An equality gives in proportion to the force on it and to the inverse weight of its bodies; MuJoCo lets no
        # impedance exceed 0.9999, and that left loops open by what turned panels by 1e-4 rad.
        self._m.body_invweight0[np.unique(self._m.site_bodyid[self._cuts])] *= LOOP_SOFTNESS
        self._sites = [
            [[self._m.site(f"{slit.point} {end} {side}").id for side in "ab"] for end in ("opening", "inner")]
            for slit in model.slits
        ]
        self.push = np.zeros((self._m.nbody, 6))
        self.accounts = False
        self.work = Work()
        self.put(fold)

    # -- state ---------------------------------------------------------------------------------------

    def put(self, fold: ArrayLike) -> None:
        """Set every crease to a fold, at rest."""
        self._put(self.model.positions(fold))

    def put_angles(self, angles: FloatArray) -> None:
        """Set every crease to inner angles (n_cells, 4), at rest."""
        self._put(self.model.of_angles(angles))

    def _put(self, positions: FloatArray) -> None:
        self._d.qpos[self._joint] = positions
        self._d.qvel[:] = 0.0
        self._d.qacc_warmstart[:] = 0.0
        self._mujoco.mj_forward(self._m, self._d)

    @property
    def time_s(self) -> float:
        """Since the start."""
        return float(self._d.time)

    @property
    def angles(self) -> FloatArray:
        """(n_cells, 4) inner angles, radians."""
        return np.asarray(self.model.linkage.four_bars.deployed + self._d.qpos[self._where])

    @property
    def driven(self) -> tuple[FloatArray, FloatArray]:
        """(n_drives,) each: inner angles of the driven creases, and their rates."""
        return self._driven_deployed + self._d.qpos[self._driven], self._d.qvel[self._driven]

    @property
    def rates(self) -> FloatArray:
        """(n_cells, 4) rates of the inner angles, rad/s."""
        return np.array(self._d.qvel[self._where])

    @property
    def matrices(self) -> FloatArray:
        """(n_panels, 4, 4) rigid motions of the panels from the deployed state."""
        out = np.zeros((len(self._body), 4, 4))
        out[:, :3, :3] = self._d.xmat.reshape(-1, 3, 3)[self._body]
        out[:, :3, 3] = self._d.xpos[self._body]
        out[:, 3, 3] = 1.0
        return out

    @property
    def loop_gap_m(self) -> float:
        """By how much the halves of a cut panel have come apart, at most."""
        place = self._d.site_xpos[self._cuts]
        return float(np.linalg.norm(place[:, 0] - place[:, 1], axis=1).max())

    @property
    def slit_gaps_m(self) -> FloatArray:
        """(n_slits, 2) distance between the two faces of each slit, at its opening and at its inner vertex."""
        place = self._d.site_xpos
        gaps = [[np.linalg.norm(place[a] - place[b]) for a, b in ends] for ends in self._sites]
        return np.array(gaps).reshape(-1, 2)

    @property
    def n_contacts(self) -> int:
        """Places where panels touch each other or an obstacle."""
        return int(self._d.ncon)

    @property
    def energy_j(self) -> float:
        """Of weight, springs and motion."""
        self._mujoco.mj_energyPos(self._m, self._d)
        self._mujoco.mj_energyVel(self._m, self._d)
        return float(self._d.energy.sum())

    # -- what is done to it --------------------------------------------------------------------------

    def latch(self, names: set[str]) -> None:
        """Close these latches, and open all others: slits, cells, "stow"."""
        for i in range(self._m.neq):
            name = self._m.equality(i).name
            if name.startswith(("slit:", "cell:", "stow ")):
                self._d.eq_active[i] = name.split(" ")[0] in names

    def lock(self, cell: int, crease: int) -> None:
        """Seize a crease where it stands, for ever: its stops close in on it."""
        name = self.model.joint(cell, crease)
        self._m.joint(name).range[:] = self._d.qpos[self._where[cell, crease]]

    def step(self, torque_nm: ArrayLike | None = None) -> None:
        """Let a millisecond pass, the drives giving these torques (n_drives,) at their shafts."""
        m, d, module = self._m, self._d, self._mujoco
        module.mj_step1(m, d)
        np.copyto(d.xfrc_applied, self.push)
        by_air, by_magnets = self._blow(), self._attract()
        if torque_nm is not None:
            d.ctrl[:] = torque_nm
        before = np.array(d.qvel) if self.accounts else None
        module.mj_step2(m, d)
        module.mj_kinematics(m, d)  # places as of now, not as of the step's beginning
        if before is None:
            return
        # Mean speed over the step: what implicit integration moves by is the new one, what acts saw the old.
        mean = 0.5 * (before + d.qvel)
        self.work.motors += STEP_S * float(d.qfrc_actuator @ d.qvel)
        self.work.air += STEP_S * by_air
        self.work.magnets += STEP_S * by_magnets
        self.work.lost += STEP_S * float((m.dof_damping * mean**2 + m.dof_frictionloss * np.abs(mean)).sum())

    def _velocity(self, body: NDArray[np.intp], place: FloatArray) -> FloatArray:
        """(n, 3) of places on bodies."""
        d = self._d
        turn, move = d.cvel[body, :3], d.cvel[body, 3:]
        origin = d.subtree_com[self._m.body_rootid[body]]
        return np.asarray(move + cross(turn, place - origin))

    def _act(self, body: NDArray[np.intp], place: FloatArray, force: FloatArray) -> float:
        """Apply forces (n, 3) at places on bodies; their power, watt."""
        arm = place - self._d.xipos[body]
        both = np.concatenate([force, cross(arm, force)], axis=1)
        own = np.arange(self._m.nbody)[:, None] == body
        self._d.xfrc_applied += own @ both
        return float((self._velocity(body, place) * force).sum()) if self.accounts else 0.0

    def _blow(self) -> float:
        air = self.model.loads.air
        if air.still:
            return 0.0
        body, skin = self._skin_body, self._skin
        turn = self._d.xmat.reshape(-1, 3, 3)[body]
        period = self.model.design.structure.profile.period
        force = skin_forces(skin, air, turn[None], period)[0]
        place = self._d.xpos[body] + np.einsum("nij,nj->ni", turn, skin.point)
        return self._act(body, place, force)

    def _attract(self) -> float:
        magnets = self.model.loads.magnets
        if magnets.force_n == 0.0 or not self._sites:
            return 0.0
        power = 0.0
        for ends in self._sites:
            place = self._d.site_xpos[ends[0]]
            apart = place[1] - place[0]
            gap = math.hypot(*apart)
            if gap < 1e-9 or gap > magnets.capture_m:
                continue
            pair = np.array(ends[0])
            force = float(magnets.pull_n(np.array(gap))) * apart / gap
            power += self._act(self._m.site_bodyid[pair], place, np.stack([force, -force]))
        return power
