"""What the models of a structure have in common, whatever format they are written in: bodies, joints, loops.

Joints stand at 0 when deployed; a joint's value is how much larger its crease's inner angle is than then.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.design import Structure
from ori_deploy.export.kernel import surface
from ori_deploy.export.rulings import panel_shape, s_range, to_user
from ori_deploy.export.skeleton import Skeleton
from ori_deploy.export.solids import panel_body
from ori_deploy.export.tree import Hang, Tree, tree_of
from ori_deploy.files import Design
from ori_deploy.profiles.profile import Reals

LEAST_KG = 1e-9
"""Of a panel without material: simulators refuse bodies that weigh nothing."""

LEAST_KG_M2 = 2e-14
"""Least moment of inertia of a body, whatever its size: MuJoCo refuses any below 1e-14."""

_PLATE = 1e-13
"""Moment added, over the largest: two of a thin plate's are the third to rounding, and must not fall short of it."""

RANGE_SLACK_RAD = 1e-3
"""By how much a joint may go beyond closed and beyond open flat, so that limits do not push at both ends."""


MESH_CHORD = 5e-4
"""How far the meshes of models may be from the true outline, relative to the profile's size: to be looked at."""


@dataclass(frozen=True)
class Mesh:
    """Triangles of a panel's surface, counter-clockwise seen from outside.

    Attributes
    ----------
    vertices
        (n, 3) deployed, in the design's coordinates, metres.
    faces
        (m, 3).
    """

    vertices: Reals
    faces: NDArray[np.intp]


@dataclass(frozen=True)
class Drive:
    """A driven crease.

    Attributes
    ----------
    name
        Of its actuator.
    crease
        In the order of `CREASES`.
    torque_nm, velocity_rad_s
        The most it gives, at the crease.
    gear_ratio
        Turns of the shaft per turn of the crease, negative where they turn against each other.
    """

    name: str
    crease: int
    torque_nm: float
    velocity_rad_s: float
    gear_ratio: float = 1.0


@dataclass(frozen=True)
class Bodies:
    """A design as rigid bodies.

    Attributes
    ----------
    design
        What it is made from.
    meshes
        (n_panels) surface of each panel; None where it has no material.
    density_kg_m3
        Of the panels.
    drives
        (n_cells) what drives each cell; empty where nothing does.
    """

    design: Design
    meshes: tuple[Mesh | None, ...]
    density_kg_m3: float
    drives: tuple[Drive, ...] = ()

    @cached_property
    def skeleton(self) -> Skeleton:
        return Skeleton(self.design)

    @cached_property
    def tree(self) -> Tree:
        return tree_of(self.skeleton.layout, [drive.crease for drive in self.drives] or None)

    def link(self, panel: int) -> str:
        """Name of a panel's body."""
        return self.skeleton.layout.panel_ids[panel]

    def joint(self, cell: int, crease: int) -> str:
        """Name of a crease's joint."""
        return self.skeleton.crease_names[cell][crease]

    def axis(self, hang: Hang) -> Reals:
        """(3,) about which the panel turns while the inner angle grows."""
        return np.asarray(hang.sense * self.skeleton.solids.crease_axis[hang.cell, hang.crease])

    def point(self, hang: Hang) -> Reals:
        """(3,) the middle of the crease."""
        return np.asarray(self.skeleton.solids.crease_point[hang.cell, hang.crease])

    def range_rad(self, hang: Hang) -> tuple[float, float]:
        """Joint values at which the crease is closed and open flat, with `RANGE_SLACK_RAD`."""
        deployed = float(self.skeleton.linkage.four_bars.deployed[hang.cell, hang.crease])
        return -deployed - RANGE_SLACK_RAD, np.pi - deployed + RANGE_SLACK_RAD

    def drive_of(self, hang: Hang) -> Drive | None:
        """What drives a joint."""
        drive = self.drives[hang.cell] if self.drives and not hang.bonded else None
        return drive if drive is not None and drive.crease == hang.crease else None

    def positions(self, fold: ArrayLike) -> Reals:
        """(n_poses, n_joints) values of the joints of `tree.joints`, for folds as in `Skeleton.poses`."""
        opened = self.skeleton.inner_rad(fold) - self.skeleton.linkage.four_bars.deployed
        return np.stack([opened[:, hang.cell, hang.crease] for hang in self.tree.joints], axis=1)

    @cached_property
    def volume_m3(self) -> Reals:
        """(n_panels,) of the panels without pockets; exact."""
        design, structure = self.design, self.design.structure
        if isinstance(structure, Structure):
            return structure.panel_areas * design.span_m
        return structure.panel_areas * (design.r_max_m**3 - design.r_min_m**3) / 3.0

    def mass_kg(self, panel: int) -> float:
        """Of a panel without pockets."""
        return max(self.density_kg_m3 * float(self.volume_m3[panel]), LEAST_KG)

    def centroid(self, panel: int) -> Reals:
        """(3,) deployed, metres."""
        return np.asarray(self.skeleton.solids.centroid[panel])

    def inertia(self, panel: int) -> Reals:
        """(3, 3) about the centroid, kg m^2; of light bodies raised to what simulators take."""
        drawn = self.skeleton.solids  # as polygons: all but the panel's volume
        share = float(self.volume_m3[panel] / drawn.volume[panel]) if drawn.volume[panel] > 0.0 else 0.0
        inertia = self.density_kg_m3 * share * drawn.inertia(panel)
        moments = np.linalg.eigvalsh(inertia)
        least = max(LEAST_KG * (0.01 * self.design.span_m) ** 2, LEAST_KG_M2)
        return np.asarray(inertia + max(least - moments[0], _PLATE * moments[-1]) * np.eye(3))


def plain_meshes(design: Design) -> tuple[Mesh | None, ...]:
    """(n_panels) surfaces of the panels without pockets, for `Bodies`.

    Raises
    ------
    InputError
        The extra `export` is not installed.
    """
    structure = design.structure
    low, high = s_range(structure, design.span_m, design.r_min_m)
    chord = MESH_CHORD * structure.profile.size
    frame = to_user(structure)
    made: list[Mesh | None] = []
    for panel, area in enumerate(structure.panel_areas):
        shape = panel_shape(structure, panel, chord)
        if shape is None:
            made.append(None)
            continue
        points, triangles = surface(panel_body(shape, low, high, float(area), chord * design.unit_m))
        if np.linalg.det(frame) < 0.0:
            triangles = triangles[:, ::-1]
        made.append(Mesh(points @ frame[:3, :3].T + frame[:3, 3], triangles))
    return tuple(made)


def text(values: Iterable[float]) -> str:
    """Numbers with all their digits."""
    return " ".join(f"{float(v):.17g}" for v in values)
