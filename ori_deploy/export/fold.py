"""FOLD files (version 1.2): the structure as an origami of rigid faces, in frames from deployed to flat.

Every panel is drawn as the flat face between its two creases, over the whole span: these faces share exactly the
edges about which the panels really turn, so edges keep their lengths and fold angles are those of the hinges. Neither
the panels' mid-surfaces nor their skins do: both creases of a thick panel lie on its rim, on different sides of
it. With thickness left out, cells are tubes of four faces each that touch nothing: which faces are bonded to one
rigid body, and which meet at a slit, is told in keys of our own.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ori_deploy
from ori_deploy.design import ConeStructure
from ori_deploy.errors import InputError
from ori_deploy.export.skeleton import Skeleton, body_numbers
from ori_deploy.files import Design, write_atomically
from ori_deploy.layout import Layout
from ori_deploy.motion import BEFORE_CREASE, NEXT_CREASE
from ori_deploy.profiles.profile import Reals

FRAMES = 21
"""Frames where nobody asks for a number."""

_OURS = "ori_deploy"
"""Prefix of keys that FOLD does not have."""

_DESCRIPTION = (
    "Thick origami as rigid faces: each face runs from one crease of its panel to the other, over the whole span. "
    "Faces of one ori_deploy:faces_body move as one. ori_deploy:edges_innerAngle is the angle between the panels' "
    "inner faces at the crease, degrees; ori_deploy:fold is 1 deployed, 0 flat."
)


def fold_data(design: Design, frames: int = FRAMES) -> dict[str, Any]:
    """A FOLD file as plain data: the deployed frame in the key frame, the others after it, the flat one last.

    Lengths in metres, angles in degrees, as FOLD has them. Faces are counter-clockwise seen from inside their cell,
    so every crease is a valley: 180 where its faces lie on each other, 0 where they lie in one plane.

    Parameters
    ----------
    frames
        How many, at least 2, at equal steps of the fold variable.

    Raises
    ------
    InputError
        Too few frames.
    """
    if frames < 2:
        raise InputError("FOLD frames", value=frames, limit="2 or more: deployed and flat", remedy="ask for more")
    skeleton = Skeleton(design)
    folds = np.linspace(1.0, 0.0, frames)
    mesh = _mesh(skeleton)
    places = mesh.places(skeleton, folds)
    turned = np.clip(np.degrees(skeleton.fold_rad(folds)), 0.0, 180.0)  # beyond lies rounding only
    inner = np.degrees(skeleton.inner_rad(folds))
    told = [_frame(mesh, *each) for each in zip(folds, places, turned, inner, strict=True)]
    return {
        "file_spec": 1.2,
        "file_creator": f"ori-deploy {ori_deploy.__version__}",
        "file_title": design.name,
        "file_description": _DESCRIPTION,
        "file_classes": ["animation"],
        **told[0],
        "frame_attributes": ["3D", "manifold", "orientable"],
        "frame_unit": "m",
        "edges_vertices": mesh.edges,
        "edges_assignment": ["B" if name is None else "V" for name in mesh.creases],
        "faces_vertices": mesh.faces,
        f"{_OURS}:edges_crease": mesh.creases,
        **_panels(skeleton.layout),
        "file_frames": [{**frame, "frame_parent": 0, "frame_inherit": True} for frame in told[1:]],
    }


def write_fold(design: Design, path: Path, frames: int = FRAMES) -> None:
    """Write a FOLD file, whole or not at all. Raises as `fold_data` and `write_atomically`."""
    write_atomically(path, json.dumps(fold_data(design, frames), allow_nan=False) + "\n")


@dataclass(frozen=True)
class _Mesh:
    """Of every cell the ends of its creases, its creases, both ends of its four links, and its links.

    Attributes
    ----------
    number
        (n_cells, 4, 2) vertex at each end of each crease.
    edges, faces
        Vertices; edges in the order of `creases`.
    creases
        Name of each edge's crease, None for the ends of links.
    """

    number: NDArray[np.intp]
    edges: list[list[int]]
    creases: list[str | None]
    faces: list[list[int]]

    def places(self, skeleton: Skeleton, folds: Reals) -> Reals:
        """(n_poses, n_vertices, 3) metres."""
        poses, ends = skeleton.poses(folds), skeleton.crease_ends
        placed = np.empty((len(folds), int(self.number.max()) + 1, 3))
        for cell, numbers in enumerate(self.number):
            for k, crease in enumerate(NEXT_CREASE):  # every crease ends one panel
                turn = poses[:, 4 * cell + k]
                moved = np.einsum("tij,ej->tei", turn[:, :3, :3], ends[cell, crease]) + turn[:, None, :3, 3]
                placed[:, numbers[crease]] = moved
        return placed

    def per_edge(self, of_creases: Reals) -> list[float]:
        """Values (n_cells, 4) of creases as values of edges, 0 for the ends of links."""
        value = iter(of_creases.ravel().tolist())
        return [0.0 if name is None else next(value) for name in self.creases]


def _mesh(skeleton: Skeleton) -> _Mesh:
    design, n = skeleton.design, skeleton.layout.n_cells
    pointed = isinstance(design.structure, ConeStructure) and design.r_min_m == 0.0
    number = np.arange(8 * n).reshape(n, 4, 2)
    if pointed:  # all creases of a cell end in the apex: one vertex there
        number = 5 * np.arange(n)[:, None, None] + np.array([[0, k + 1] for k in range(4)])
    edges: list[list[int]] = []
    creases: list[str | None] = []
    faces: list[list[int]] = []
    for cell, names in zip(number.tolist(), skeleton.crease_names, strict=True):
        edges += cell
        creases += names
        for start, end in zip(BEFORE_CREASE, NEXT_CREASE, strict=True):
            near, far = zip(cell[start], cell[end], strict=True)
            edges += [list(far)] if pointed else [list(near), list(far)]
            ring = [near[0], far[0], far[1], *([] if pointed else [near[1]])]  # seen from inside
            faces.append(ring if skeleton.right_handed else ring[::-1])
        creases += [None] * (len(edges) - len(creases))
    return _Mesh(number, edges, creases, faces)


def _frame(mesh: _Mesh, fold: float, places: Reals, turned_deg: Reals, inner_deg: Reals) -> dict[str, Any]:
    return {
        "frame_title": f"fold {fold:.4g}" + {1.0: ", deployed", 0.0: ", flat"}.get(fold, ""),
        "frame_classes": ["foldedForm"],
        "vertices_coords": places.tolist(),
        "edges_foldAngle": mesh.per_edge(turned_deg),
        f"{_OURS}:fold": fold,
        f"{_OURS}:edges_innerAngle": mesh.per_edge(inner_deg),
    }


def _panels(layout: Layout) -> dict[str, Any]:
    """What is known of the panels that the faces stand for, by number of the face."""

    def pairs(partner: NDArray[np.intp]) -> list[list[int]]:
        return [[p, int(q)] for p, q in enumerate(partner) if q > p]

    return {
        f"{_OURS}:faces_panel": list(layout.panel_ids),
        f"{_OURS}:faces_body": body_numbers(layout).tolist(),
        f"{_OURS}:bonds": pairs(layout.bonded_to),
        f"{_OURS}:slits": pairs(np.where(layout.is_slit, layout.neighbour, -1)),
    }
