"""What differs between the design files of cylinders and cones: how points are told, and which lengths there are.

A cylinder's points are (x, y) in its cross-section, metres. A cone's are unit vectors from the apex along the
user's axes: `apex + r xyz` is a place in space.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from ori_deploy.design import ConeStructure, Structure, build, build_cone, embed, embed_cone
from ori_deploy.layout import Layout
from ori_deploy.motion import ConeMechanism, Mechanism
from ori_deploy.profiles import cone_from_description, from_description, xy
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.profiles.sphere import Vectors

AnyStructure = Structure | ConeStructure


class ShapeEntries(Protocol):
    """The entries of a design file that depend on the kind of shape."""

    @property
    def kind(self) -> str:
        """The file's `kind`."""

    @property
    def place(self) -> str:
        """Key of a vertex's place."""

    def lengths(self) -> dict[str, Any]:
        """Entries that say how far the structure reaches, and its wall."""

    def vertices(self) -> list[list[float]]:
        """Places of the vertices."""

    def creases(self) -> Reals:
        """(n_cells, 4, 2 or 3) places of the creases."""

    def outlines(self) -> list[list[list[float]]]:
        """Outline of each panel, deployed, counter-clockwise seen from outside."""

    def packaging(self) -> dict[str, Any]:
        """Areas, eta, and the folded stack's smallest box."""

    def posed(self, fold: Reals) -> tuple[Reals, list[list[list[float]]]]:
        """Homogeneous transforms (n_panels, 3 or 4, 3 or 4) and moved outlines at one fold vector (n_cells,)."""


@dataclass(frozen=True)
class CylinderEntries:
    """Entries of a cylinder's file."""

    structure: Structure
    span_m: float

    kind = "cylinder"
    place = "xy"

    def lengths(self) -> dict[str, Any]:
        return {"span_m": self.span_m, "wall_m": self.structure.wall_m}

    def vertices(self) -> list[list[float]]:
        return _pairs(self.structure.embedding.z)

    def creases(self) -> Reals:
        return xy(self.structure.cells.crease)

    def outlines(self) -> list[list[list[float]]]:
        return [_pairs(outline) for outline in self.structure.panel_outlines()]

    def packaging(self) -> dict[str, Any]:
        box = Mechanism(self.structure).stack_box_m
        return {
            **_areas(self.structure),
            "stack_box_m": list(box),
            "box_ratio": self.structure.profile.area / (box[0] * box[1]),
        }

    def posed(self, fold: Reals) -> tuple[Reals, list[list[list[float]]]]:
        poses = Mechanism(self.structure).poses(fold[None])
        outlines = self.structure.panel_outlines()
        moved = [_pairs(poses.turn[p, 0] * outline + poses.shift[p, 0]) for p, outline in enumerate(outlines)]
        return poses.matrices()[0], moved


@dataclass(frozen=True)
class ConeEntries:
    """Entries of a cone's file; it is cut off by spheres of these radii round its apex."""

    structure: ConeStructure
    r_min_m: float
    r_max_m: float

    kind = "cone"
    place = "xyz"

    def lengths(self) -> dict[str, Any]:
        wall = self.structure.wall_rad
        return {
            "apex": self.structure.profile.apex.tolist(),
            "r_min_m": self.r_min_m,
            "r_max_m": self.r_max_m,
            "span_m": self.r_max_m - self.r_min_m,
            "wall_rad": wall,
            "wall_m": wall * self.r_max_m,
        }

    def vertices(self) -> list[list[float]]:
        return self._told(self.structure.embedding.u)

    def creases(self) -> Reals:
        return self.structure.profile.to_user(self.structure.cells.crease)

    @cached_property
    def _from_outside(self) -> tuple[Vectors, ...]:
        """Outlines in the cone's frame. Where that is a mirror image, counter-clockwise is the other way round."""
        outlines = self.structure.panel_outlines()
        return outlines if self.structure.profile.is_right_handed else tuple(o[::-1] for o in outlines)

    def outlines(self) -> list[list[list[float]]]:
        return [self._told(outline) for outline in self._from_outside]

    def packaging(self) -> dict[str, Any]:
        box = ConeMechanism(self.structure, self.r_max_m).stack_box_m(self.r_min_m, self.r_max_m)
        volume = self.structure.profile.solid_angle * (self.r_max_m**3 - self.r_min_m**3) / 3.0
        return {
            **_areas(self.structure),
            "volume_m3": volume,
            "stack_box_m": list(box),
            "box_ratio": volume / float(np.prod(box)),
        }

    def posed(self, fold: Reals) -> tuple[Reals, list[list[list[float]]]]:
        matrices = ConeMechanism(self.structure, self.r_max_m).poses(fold[None]).matrices()[0]
        # All panels turn about the apex: directions need the rotation only.
        told = [self.structure.profile.to_user(outline) for outline in self._from_outside]
        return matrices, [(outline @ m[:3, :3].T).tolist() for outline, m in zip(told, matrices, strict=True)]

    def _told(self, directions: Vectors) -> list[list[float]]:
        told: list[list[float]] = self.structure.profile.to_user(directions).tolist()
        return told


def entries_of(structure: AnyStructure, span_m: float, r_min_m: float = 0.0) -> ShapeEntries:
    """The entries of a structure: the one place of this room that asks what it is."""
    if isinstance(structure, ConeStructure):
        return ConeEntries(structure, r_min_m, r_min_m + span_m)
    return CylinderEntries(structure, span_m)


def rebuilt(data: Mapping[str, Any], layout: Layout) -> AnyStructure:
    """The structure that a design file's profile, wall and vertex places describe.

    Raises
    ------
    KeyError, TypeError, ValueError
        Entries that are missing or not of their type.
    InputError
        Entries that make no structure.
    """
    vertices = data["layout"]["vertices"]
    outline = {v["id"]: float(v["s"]) for v in vertices if not v["inner"]}
    if data["kind"] == ConeEntries.kind:
        cone = cone_from_description(data["profile"])
        inner = {}
        for v in vertices:
            if v["inner"]:
                direction = np.array(v["xyz"], dtype=float)
                if direction.shape != (3,):
                    raise ValueError(f"vertex {v['id']}: xyz is not three numbers")
                z = complex(cone.onto_base(cone.from_user(direction)))
                inner[v["id"]] = (z.real, z.imag)
        return build_cone(embed_cone(cone, layout, outline, inner), float(data["wall_rad"]))
    inner = {v["id"]: (float(v["xy"][0]), float(v["xy"][1])) for v in vertices if v["inner"]}
    return build(embed(from_description(data["profile"]), layout, outline, inner), float(data["wall_m"]))


def _areas(structure: AnyStructure) -> dict[str, Any]:
    """Areas in m2 (a cone's are solid angles, steradians) and eta."""
    return {
        "area": structure.profile.area,
        "material_area": float(structure.panel_areas.sum()),
        "eta": structure.eta,
    }


def _pairs(points: Points) -> list[list[float]]:
    pairs: list[list[float]] = xy(np.atleast_1d(points)).tolist()
    return pairs
