"""Models as MuJoCo reads them, set to folds and compared with our own poses."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ori_deploy.export.bodies import Bodies, Drive, plain_meshes
from ori_deploy.export.skeleton import Skeleton
from ori_deploy.export.urdf import UrdfModel, mesh_folder, urdf_model
from tests.export.designs import design

NAMES = ("wing", "two inner vertices", "one cell", "cone elliptic", "cone tip", "tapered", "helix", "spiral")

FOLDS = (1.0, 0.83, 0.5, 0.21, 0.04, 0.0)


@cache
def bodies(name: str, crease: int | None = None) -> Bodies:
    """A design as bodies; driven at one crease of every cell."""
    made = design(name)
    n = made.structure.layout.n_cells
    drives = () if crease is None else tuple(Drive(f"servo_{k + 1}", crease, 5.0, 2.0, 2.0) for k in range(n))
    return Bodies(made, plain_meshes(made), 300.0, drives)


class Posed:
    """A loaded model, its joints set by name to what the crease angles are at a fold."""

    def __init__(self, made: Bodies, model: Any) -> None:
        self.bodies, self.model, self.data = made, model, mujoco.MjData(model)

    def put(self, fold: Any) -> None:
        n = self.bodies.skeleton.layout.n_cells
        values = self.bodies.positions(np.broadcast_to(fold, (1, n)))[0]
        for hang, value in zip(self.bodies.tree.joints, values, strict=True):
            name = self.bodies.joint(hang.cell, hang.crease)
            self.data.qpos[self.model.joint(name).qposadr[0]] = value
        mujoco.mj_kinematics(self.model, self.data)

    def frames(self) -> Any:
        """(n_panels, 4, 4) places of the bodies."""
        made = np.tile(np.eye(4), (self.bodies.skeleton.layout.n_panels, 1, 1))
        for panel, name in enumerate(self.bodies.skeleton.layout.panel_ids):
            body = self.data.body(name)
            made[panel, :3, :3], made[panel, :3, 3] = body.xmat.reshape(3, 3), body.xpos
        return made


def own_poses(made: Bodies, fold: Any) -> Any:
    """(n_panels, 4, 4) by the mechanism."""
    skeleton: Skeleton = made.skeleton
    return skeleton.poses(np.broadcast_to(fold, (1, skeleton.layout.n_cells)))[0]


def written(made: Bodies, folder: Path) -> tuple[Path, UrdfModel]:
    """A URDF file with its meshes beside it, and what it holds."""
    path = folder / "wing.urdf"
    model = urdf_model(made, mesh_folder(path))
    (folder / mesh_folder(path)).mkdir()
    for name, content in model.meshes.items():
        (folder / name).write_bytes(content)
    path.write_text(model.xml)
    return path, model
