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


@dataclass
class _Row:
    """A row of parts on a plate: where it is, how deep, and how far it is filled."""

    plate: int
    y: float
    depth: float
    x: float


def lay_out(parts: Parts) -> tuple[Placed, ...]:
    """All parts on plates, in rows: the deepest parts first, each in the first row or plate that has room for it.

    A part longer than the bed lies askew where that helps.
    """
    bed = 1e-3 * np.array(parts.spec.print.bed_mm)
    gap = 1e-3 * parts.spec.print.part_gap_mm
    flat = [(part, *_on_bed(part, bed)) for part in parts.parts]
    fitting = [item for item in flat if (item[2] <= bed + 1e-9).all()]
    rows: list[_Row] = []
    placed = []
    for part, matrix, size in sorted(fitting, key=lambda item: -item[2][1]):
        row = next((r for r in rows if r.x + size[0] <= bed[0] + 1e-9), None)  # none is deeper than an earlier row
        if row is None:
            row = _new_row(rows, float(size[1]), float(bed[1]), gap)
            rows.append(row)
        placed.append(Placed(part, row.plate, _moved(matrix, row.x, row.y), size, fits=True))
        row.x += float(size[0]) + gap
    placed.sort(key=lambda item: item.plate)
    first = placed[-1].plate + 1 if placed else 0
    alone = [item for item in flat if not (item[2] <= bed + 1e-9).all()]
    placed += [Placed(part, first + k, matrix, size, fits=False) for k, (part, matrix, size) in enumerate(alone)]
    return tuple(placed)


def _new_row(rows: list[_Row], depth: float, bed_depth: float, gap: float) -> _Row:
    """On the first plate that has room behind its last row, or on a new one."""
    last = {row.plate: row for row in rows}
    for plate, row in sorted(last.items()):
        y = row.y + row.depth + gap
        if y + depth <= bed_depth + 1e-9:
            return _Row(plate, y, depth, 0.0)
    return _Row(len(last), 0.0, depth, 0.0)


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
