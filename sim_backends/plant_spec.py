"""Which plant the servos of a virtual bus drive: plain data, for processes that are started with a specification."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.errors import InputError
from sim_backends.load import Load


@dataclass(frozen=True)
class PlantSpec:
    """A structure and what drives it; one entry per hinge in the order of the cells.

    Attributes
    ----------
    design, loads
        Files; None for default loads.
    names, creases, shaft_per_crease, zero_rad
        Actuators: what they are called, the crease they drive in the order of the design's creases, and how.
    torque_nm
        The most they give, at the shaft.
    crease_rad
        (n_cells, 4) inner angles at the start.
    play_rad
        Between shafts and creases, at the shaft.
    """

    design: str
    loads: str | None
    names: tuple[str, ...]
    creases: tuple[int, ...]
    shaft_per_crease: tuple[float, ...]
    zero_rad: tuple[float, ...]
    torque_nm: tuple[float, ...]
    crease_rad: tuple[tuple[float, ...], ...]
    play_rad: float = 0.0

    @classmethod
    def of_rig(
        cls,
        rig: ResolvedRig,
        design: Path,
        loads: Path | None,
        crease_rad: ArrayLike,
        torque_nm: Sequence[float],
    ) -> Self:
        """The plant of a rig whose actuators give this much (n_hinges,)."""
        angles = np.asarray(crease_rad, dtype=np.float64)
        return cls(
            design=str(design),
            loads=None if loads is None else str(loads),
            names=rig.hinge_ids,
            creases=tuple(int(c) for c in rig.crease_index),
            shaft_per_crease=tuple(float(g) for g in rig.shaft_per_crease),
            zero_rad=tuple(float(z) for z in rig.zero_rad),
            torque_nm=tuple(float(t) for t in torque_nm),
            crease_rad=tuple(tuple(float(a) for a in row) for row in angles),
        )

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """From what `asdict` made, once it has been through JSON."""
        lists = {key: tuple(value) for key, value in data.items() if isinstance(value, (list, tuple))}
        return cls(**{**data, **lists, "crease_rad": tuple(tuple(row) for row in data["crease_rad"])})

    def make(self) -> Load:
        """The plant.

        Raises
        ------
        InputError
            A file cannot be used, or belongs to another structure; MuJoCo is missing.
        """
        from ori_deploy.files import load_design, load_loads  # slow to import, and wanted for this alone
        from sim_backends.physics.model import Drive, Model
        from sim_backends.physics.plant import Plant
        from sim_backends.physics.world import World

        made = load_design(Path(self.design))
        if made.structure.layout.n_cells != len(self.names):
            raise InputError(
                "plant: the design has another number of cells", value=made.structure.layout.n_cells,
                limit=f"{len(self.names)} driven cells", remedy="give the design that the plan was made from",
                source=self.design,
            )  # fmt: skip
        parts = zip(
            self.names, self.creases, self.shaft_per_crease, self.zero_rad, self.torque_nm, strict=True
        )  # fmt: skip
        drives = tuple(Drive(n, cell, c, g, z, t) for cell, (n, c, g, z, t) in enumerate(parts))
        if self.loads is None:
            world = World(Model(made, drives=drives))
        else:
            world = World(Model(made, load_loads(Path(self.loads)), drives))
        world.put_angles(np.array(self.crease_rad))
        return Plant(world, self.play_rad)
