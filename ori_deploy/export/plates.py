"""Parts laid flat on build plates: each on a plane face, not overlapping, on as many plates as it takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ori_deploy.design.packaging import box_axis
from ori_deploy.export.parts import Part, Parts
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

_FIRST_LAYERS_M = 5e-4
"""Ceilings lower than this over the bed hang on nothing."""
_STEEP_DEG = 45.0
"""Overhang that asks for supports, where it is only asked which face to lie on."""


@dataclass(frozen=True)
class Placed:
    """A part on a plate.

    Attributes
    ----------
    part
        Which.
    plate
        Number of its plate, from 0.
    matrix
        (4, 4) from the design's coordinates to the plate's, metres: x and y from the plate's corner, z upwards.
    size_m
        (3,) its box there.
    fits
        Whether it fits on the bed; one that does not has a plate to itself.
    """

    part: Part
    plate: int
    matrix: Reals
    size_m: Reals
    fits: bool


def lie_flat(part: Part) -> tuple[Reals, Reals]:
    """(4, 4) that lays a part on a plane face, longest side along x, its box from the origin on; (3,) the box."""
    # On the face that leaves the least to be propped up; the inner one where several are as good.
    turn = min((_turned_down(face) for face in part.rests), key=lambda turn: _propped(part, turn))
    flat = part.points @ turn.T
    axis = np.conj(box_axis(flat[:, 0] + 1j * flat[:, 1]))
    turn = _about_z(axis) @ turn
    size = np.ptp(part.points @ turn.T, axis=0)
    if size[1] > size[0]:
        turn = _about_z(1j) @ turn
    at = part.points @ turn.T
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn, -at.min(axis=0)
    return out, np.ptp(at, axis=0)


def overhangs(part: Part, turn: Reals) -> Reals:
    """(m,) angles of its triangles from upright, degrees, for a part turned by (3, 3): 90 for a ceiling.

    Those on the bed hang over nothing, nor do ceilings of its first layers: recesses for film, letters. -90 for them.
    """
    normal, area = part.faces
    height = part.points @ turn[2]
    highest = height[part.triangles].max(axis=1) - height.min()
    angle = np.degrees(np.arcsin(np.clip(-normal @ turn[2], -1.0, 1.0)))
    return np.where((highest > _FIRST_LAYERS_M) & (area > 1e-10), angle, -90.0)


def _propped(part: Part, turn: Reals) -> float:
    """Area that hangs over, in square millimetres: rounding must not choose between faces."""
    return round(1e6 * float(part.faces[1][overhangs(part, turn) > _STEEP_DEG].sum()), 3)


def _turned_down(down: Vectors) -> Reals:
    """(3, 3) rotation that takes a unit vector to -z."""
    other = np.eye(3)[int(np.argmin(np.abs(down)))]
    x = np.cross(other, down)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(-down, x), -down])


def _about_z(turn: complex) -> Reals:
    return np.array([[turn.real, -turn.imag, 0.0], [turn.imag, turn.real, 0.0], [0.0, 0.0, 1.0]])


def lay_out(parts: Parts) -> tuple[Placed, ...]:
    """All parts on plates: rows of them, the deepest first, in the order in which they are packed.

    A part longer than the bed lies along its diagonal where that helps.
    """
    bed = 1e-3 * np.array(parts.spec.print.bed_mm)
    gap = 1e-3 * parts.spec.print.part_gap_mm
    flat = [(part, *_on_bed(part, bed)) for part in parts.parts]
    order = sorted(range(len(flat)), key=lambda i: (-flat[i][2][1], i))
    placed: list[Placed] = []
    alone = []
    plate, x, y, row = 0, 0.0, 0.0, 0.0
    for i in order:
        part, matrix, size = flat[i]
        if not (size <= bed + 1e-9).all():
            alone.append((part, matrix, size))
            continue
        if x > 0.0 and x + size[0] > bed[0]:
            x, y, row = 0.0, y + row + gap, 0.0
        if y > 0.0 and y + size[1] > bed[1]:
            plate, x, y, row = plate + 1, 0.0, 0.0, 0.0
        placed.append(Placed(part, plate, _moved(matrix, x, y), size, fits=True))
        x, row = x + size[0] + gap, max(row, float(size[1]))
    first = placed[-1].plate + 1 if placed else 0
    placed += [Placed(part, first + k, matrix, size, fits=False) for k, (part, matrix, size) in enumerate(alone)]
    return tuple(placed)


def _on_bed(part: Part, bed: Reals) -> tuple[Reals, Reals]:
    """As `lie_flat`, turned about z where only that makes it fit."""
    matrix, size = lie_flat(part)
    if (size <= bed).all():
        return matrix, size
    flat = part.points @ matrix[:3, :3].T
    for angle in np.radians(np.arange(1.0, 91.0)):
        turn = _about_z(np.exp(1j * angle))
        at = flat @ turn.T
        turned = np.ptp(at, axis=0)
        if (turned <= bed).all():
            out = np.eye(4)
            out[:3, :3], out[:3, 3] = turn @ matrix[:3, :3], -at.min(axis=0)
            return out, turned
    return matrix, size


def _moved(matrix: Reals, x: float, y: float) -> Reals:
    out = matrix.copy()
    out[:2, 3] += (x, y)
    return out
