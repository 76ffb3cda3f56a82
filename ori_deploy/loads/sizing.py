"""Torque that every driven crease asks for along the motion, by virtual work: nothing is fast, all cells in step.

Each cell has one degree of freedom and one driven crease. The work that the loads do while one cell folds a
little is what its own servo has to make up for: `T dθ + dW = 0`, θ the driven crease's inner angle. Slits are
not latched: a closed ring of cells would share the loads in a way that stiffness decides.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.errors import InputError
from ori_deploy.layout import Layout
from ori_deploy.loads.loads import Air, Loads
from ori_deploy.loads.solids import Skin, Solids
from ori_deploy.loads.twists import Twists
from ori_deploy.motion.mechanism import Linkage
from ori_deploy.profiles.profile import Reals

NO_LEVERAGE_RAD = 1e-9
"""A driven crease that turns less per unit of fold moves nothing."""


@dataclass(frozen=True)
class HingeTorques:
    """Torques at the driven creases; positive opens the crease's inner angle. Arrays (n_poses, n_cells), N m.

    Attributes
    ----------
    fold
        (n_poses,) fold of all cells, or (n_poses, n_cells), as it was asked for.
    gravity, film, air
        What holding still asks for because of each.
    friction
        Dry friction, always against the motion; not negative.
    """

    fold: Reals
    gravity: Reals
    film: Reals
    air: Reals
    friction: Reals

    @property
    def holding(self) -> Reals:
        """(n_poses, n_cells) without friction."""
        return self.gravity + self.film + self.air

    @property
    def worst(self) -> Reals:
        """(n_poses, n_cells) magnitude in the worse of the two directions of motion."""
        return np.abs(self.holding) + self.friction


def clamp_of(layout: Layout, loads: Loads) -> int:
    """Number of the panel by which the structure is held.

    Raises
    ------
    InputError
        There is no such panel or cell.
    """
    name = loads.clamp
    if name is None:
        return 0
    if name in layout.panel_ids:
        return layout.panel_ids.index(name)
    if name in layout.cell_ids:
        return 4 * layout.cell_ids.index(name)
    raise InputError(
        "clamp: unknown panel",
        value=repr(name),
        limit=f"a panel such as {layout.panel_ids[0]}, or a cell: {', '.join(layout.cell_ids)}",
        remedy="name what holds the structure; a cell stands for its first panel",
    )


def masses_kg(layout: Layout, solids: Solids, loads: Loads) -> Reals:
    """(n_panels,) masses, what is mounted on panels included.

    Raises
    ------
    InputError
        Extra mass on a panel that there is not.
    """
    unknown = sorted(set(loads.extra_kg) - set(layout.panel_ids))
    if unknown:
        raise InputError(
            "extra_kg: unknown panel", value=unknown[0], limit=", ".join(layout.panel_ids),
            remedy="name a panel of the design",
        )  # fmt: skip
    return loads.density_kg_m3 * solids.volume + [loads.extra_kg.get(name, 0.0) for name in layout.panel_ids]


def skin_forces(skin: Skin, air: Air, turn: Reals, period: float) -> Reals:
    """Force of the air on every patch of skin.

    Parameters
    ----------
    turn
        (n_poses, n, 3, 3) how the patches' panels are turned.
    period
        Range of the outline's parameter, after which a pressure table repeats.

    Returns
    -------
    (n_poses, n, 3) newton.
    """
    outward = np.einsum("tnij,nj->tni", turn, skin.area)
    pressure = np.full(len(skin.s), air.pressure_pa)
    if air.pressure_at:
        at, value = np.array(air.pressure_at).T
        pressure = pressure + np.interp(skin.s, at, value, period=period)
    force = -pressure[:, None] * outward
    wind = np.array(air.wind_m_s)
    if wind.any():
        area = np.linalg.norm(outward, axis=-1)
        facing = np.minimum(outward @ wind, 0.0) / area  # wind against the outward normal, m/s
        force = force - 0.5 * air.density_kg_m3 * air.coefficient * (facing**2)[..., None] * outward
    return np.asarray(force)


def hinge_torques(
    linkage: Linkage[Any], solids: Solids, loads: Loads, crease: NDArray[np.intp], fold: ArrayLike
) -> HingeTorques:
    """Torques at the driven creases along the motion.

    Parameters
    ----------
    linkage, solids
        The structure as a mechanism and as solids.
    crease
        (n_cells,) which crease of each cell is driven, in the order of `CREASES`.
    fold
        (n_poses,) from 0 flat to 1 deployed, all cells in step, or (n_poses, n_cells).

    Returns
    -------
    Infinite where the driven crease has no leverage.

    Raises
    ------
    InputError
        The clamp, or a panel with extra mass, is none of this design's.
    """
    at = np.atleast_1d(np.asarray(fold, dtype=float))
    layout = linkage.layout
    twists = Twists.of(linkage, solids, at, clamp_of(layout, loads))
    panels = np.arange(layout.n_panels)
    _, moving = twists.velocities(panels, solids.centroid)
    weight = np.outer(masses_kg(layout, solids, loads), loads.gravity_m_s2)
    by_gravity = np.einsum("tcpi,pi->tc", moving, weight)
    bend = twists.angles - loads.film.rest_rad
    by_film = -loads.film.stiffness_nm(solids.span_m) * (bend * twists.rates).sum(axis=2)
    rate = np.take_along_axis(twists.rates, np.broadcast_to(crease[:, None], (len(at), len(crease), 1)), 2)[..., 0]
    rate = np.where(np.abs(rate) > NO_LEVERAGE_RAD, rate, 0.0)
    by_friction = loads.friction_nm * np.abs(twists.rates).sum(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        return HingeTorques(
            at,
            gravity=-by_gravity / rate,
            film=-by_film / rate,
            air=(0.0 - _work_of_air(linkage, solids, loads.air, twists)) / rate,
            friction=by_friction / np.abs(rate),
        )


def _work_of_air(linkage: Linkage[Any], solids: Solids, air: Air, twists: Twists) -> Reals:
    """(n_poses, n_cells) virtual work of the air per unit of fold."""
    if air.still:
        return np.zeros(twists.rates.shape[:2])
    skin = solids.skin
    _, moving = twists.velocities(skin.panel, skin.point)
    period = linkage.structure.profile.period
    force = skin_forces(skin, air, twists.matrices[:, skin.panel, :3, :3], period)
    return np.asarray(np.einsum("tcni,tni->tc", moving, force))
