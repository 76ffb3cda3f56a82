"""STEP files through build123d (the extra `cad`): every part a solid of plane faces, named, in millimetres."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ori_deploy.export.kernel import Triangles, need
from ori_deploy.export.parts import Part, Parts
from ori_deploy.files import write_atomically
from ori_deploy.profiles.sphere import Vectors

_FLAT = 3e-11
"""Metres by which triangles may leave a plane and still be one face: OpenCASCADE takes 1e-7 mm for a plane."""


def write_step(parts: Parts, path: Path) -> None:
    """All parts in one file, where they are when deployed.

    Raises
    ------
    FileError, InputError
        It cannot be written, or the extra is missing.
    """
    cad = need("build123d", "cad")
    solids = [_solid(cad, part) for part in parts.parts]
    whole = cad.Compound(label=parts.design.name, children=solids)
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / "parts.step"
        cad.export_step(whole, str(written))
        write_atomically(path, written.read_bytes())


def _solid(cad: Any, part: Part) -> Any:
    points = 1e3 * part.points
    faces = []
    for loops in plane_faces(part.points, part.triangles):
        wires = [cad.Wire.make_polygon([tuple(points[i]) for i in loop], close=True) for loop in loops]
        faces.append(cad.Face(wires[0], wires[1:]))
    solid = cad.Solid(cad.Shell(faces))
    solid.label = part.id
    return solid


def plane_faces(points: Vectors, triangles: Triangles) -> list[list[NDArray[np.int64]]]:
    """Triangles that touch in one plane, joined: per face its outer loop of point numbers, then its holes.

    Loops run counter-clockwise round the face's outward normal, holes clockwise. A face whose loops touch at a point
    stays in triangles.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    normal /= np.where(size > 0.0, size, 1.0)[:, None]
    faces: list[list[NDArray[np.int64]]] = []
    for group in _groups(points, triangles, normal, size):
        loops = _loops(triangles[group])
        if loops is None:
            faces += [[triangles[t]] for t in group]
            continue
        axis = normal[group[int(np.argmax(size[group]))]]
        loops.sort(key=lambda loop: -_area(points[loop], axis))
        faces.append(loops)
    return faces


def _groups(points: Vectors, triangles: Triangles, normal: Vectors, size: Vectors) -> list[NDArray[np.int64]]:
    """Triangles by plane, each grown from its largest one, so that a gently curved skin is not one plane."""
    owner: dict[tuple[int, int], int] = {}
    for t, (i, j, k) in enumerate(triangles.tolist()):
        owner[i, j] = owner[j, k] = owner[k, i] = t
    left = np.ones(len(triangles), dtype=bool)
    groups = []
    for seed in np.argsort(-size, kind="stable"):
        if not left[seed]:
            continue
        height = np.abs((points - points[triangles[seed, 0]]) @ normal[seed])
        left[seed] = False
        group, front = [int(seed)], [int(seed)]
        while front:
            i, j, k = triangles[front.pop()].tolist()
            for other in (owner[j, i], owner[k, j], owner[i, k]):
                if left[other] and height[triangles[other]].max() <= _FLAT and normal[other] @ normal[seed] > -0.5:
                    left[other] = False
                    group.append(other)
                    front.append(other)
        groups.append(np.array(group, dtype=np.int64))
    return groups


def _loops(triangles: Triangles) -> list[NDArray[np.int64]] | None:
    """The boundary of some triangles; None where it passes a point twice."""
    edges = {(i, j) for a, b, c in triangles.tolist() for i, j in ((a, b), (b, c), (c, a))}
    rim = [(i, j) for i, j in edges if (j, i) not in edges]
    follow = dict(rim)
    if len(follow) < len(rim):
        return None
    loops = []
    while follow:
        start, here = next(iter(follow.items()))
        del follow[start]
        loop = [start]
        while here != start:
            loop.append(here)
            here = follow.pop(here)
        loops.append(np.array(loop, dtype=np.int64))
    return loops


def _area(loop: Vectors, axis: Vectors) -> float:
    near = loop - loop[0]
    return 0.5 * float(np.cross(near, np.roll(near, -1, axis=0)).sum(axis=0) @ axis)
