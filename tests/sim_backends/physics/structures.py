"""Structures, rigs and plants that the physics tests share."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import parse_rig
from ori_deploy.files import Design, build_from_file
from ori_deploy.loads import Film, Loads
from sim_backends.physics.model import Model
from sim_backends.physics.plant import Plant, plant_of
from tests import cones, shapes

EXAMPLES = Path(__file__).parents[3] / "examples"

CALM = Loads(gravity_m_s2=(0.0, 0.0, 0.0), film=Film(thickness_m=0.0))
"""Nothing pulls."""

RIG: dict[str, Any] = {
    "schema": "ori-deploy/rig/1",
    "backend": "mock",
    "rate_hz": 100.0,
    "each_cell": {
        "crease": "close_a",
        "gear_ratio": 4.0,
        "actuator": {
            "max_velocity_rad_s": 4.0,
            "max_acceleration_rad_s2": 20.0,
            "max_torque_nm": 2.0,
            "min_position_rad": -1.0,
            "max_position_rad": 26.0,
        },
    },
    "each_latch_point": {"kind": "magnet"},
}


@cache
def design(name: str) -> Design:
    """A structure of the catalogues as a design: "wing" and "tapered" as in the examples."""
    if name == "wing":
        return Design(name, 1.26, shapes.wing(0.005, chord=0.25))
    if name == "tapered":
        spec, structure = build_from_file(EXAMPLES / "wing_tapered.toml")
        return Design(name, spec.structure.span_m, structure, r_min_m=spec.structure.r_min_m)
    if name in shapes.CATALOGUE:
        return Design(name, 0.3, shapes.structure(name))
    return Design(name, 0.4, cones.cone(name.removeprefix("cone ")), r_min_m=0.4)


def rig_for(made: Design, **tables: Any) -> ResolvedRig:
    """The rig above fitted to a design; `tables` replace its tables."""
    layout = made.structure.layout
    return resolve_rig(parse_rig({**RIG, **tables}), layout.cell_ids, layout.latch_points)


def plant(name: str, loads: Loads | None = None, torque_nm: float = 2.0, **more: Any) -> Plant:
    """A plant on that rig, its actuators as strong as wished."""
    made = design(name)
    each: Any = {**RIG["each_cell"], "actuator": {**RIG["each_cell"]["actuator"], "max_torque_nm": torque_nm}}
    return plant_of(made, rig_for(made, each_cell=each), loads, **more)


def poses_of(model: Model, fold: Any) -> Any:
    """(n_panels, 4, 4) by the mechanism, as seen from the clamp."""
    from ori_deploy.loads import clamped, in_space

    folds = np.broadcast_to(np.asarray(fold, dtype=float), (model.linkage.n_cells,))
    return clamped(in_space(model.linkage.poses(folds[None]).matrices()), model.clamp)[0]
