"""Servo horns: let into the end of the span about a driven crease, and screwed to the panel that follows it.

The servo sits beyond the end, fixed to the panel before the crease; its horn turns in both panels' recess. A
cylinder's servos sit at z = 0, a cone's at its outer radius.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ori_deploy.errors import InputError
from ori_deploy.export.kernel import circle, punch, upright
from ori_deploy.export.parts_spec import HornSpec
from ori_deploy.export.workpiece import Workpiece
from ori_deploy.layout import Layout
from ori_deploy.motion import CREASES, NEXT_CREASE
from ori_deploy.motion.mechanism import AnyStructure
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

_SCAN = 72
"""Directions round the crease in which screws are tried."""


def check_driven(driven: Mapping[str, str], layout: Layout) -> None:
    """Refuse driven creases that the design does not have.

    Parameters
    ----------
    driven
        Crease ("close_a") by cell ("c1").

    Raises
    ------
    InputError
        An unknown cell or crease.
    """
    for cell, crease in driven.items():
        if cell not in layout.cell_ids or crease not in CREASES:
            known = f"{layout.cell_ids[0]} to {layout.cell_ids[-1]}; {', '.join(CREASES)}"
            raise InputError("driven crease", value=f"{cell}.{crease}", limit=known, remedy="a rig for this design")


def crease_line(structure: AnyStructure, cell: int, crease: int) -> tuple[Vectors, Vectors]:
    """(3,) base and direction of a crease, in the design's own frame."""
    place = structure.cells.crease[cell, crease]
    if np.ndim(place) == 0:
        return np.array([place.real, place.imag, 0.0]), np.array([0.0, 0.0, 1.0])
    return np.zeros(3), np.asarray(place)


def mount_horn(
    pieces: Mapping[int, Workpiece], structure: AnyStructure, cell: int, name: str, spec: HornSpec
) -> None:
    """Cut a horn's recess into both panels at a crease, and screw holes into the one that follows.

    Parameters
    ----------
    pieces
        By panel, the parts at the end of the span where servos sit.
    """
    crease = CREASES.index(name)
    base, along = crease_line(structure, cell, crease)
    k = NEXT_CREASE.index(crease)
    before, after = 4 * cell + k, 4 * cell + (k + 1) % 4
    thing = f"horn {structure.layout.cell_ids[cell]}.{name}"
    if before not in pieces or after not in pieces:
        return
    piece = pieces[after]
    outward = along if piece.shape.on_cone else -along
    end = base + (piece.s_high if piece.shape.on_cone else piece.s_low) * along
    thickness, depth = 1e-3 * spec.thickness_mm, 1e-3 * spec.depth_mm
    floor = end - thickness * outward
    right, up = upright(outward)
    screws = _screws(piece, floor, outward, right, up, spec)
    if not len(screws):
        piece.remark(
            thing,
            "no screw hits the panel",
            f"1 of {spec.screws} on a circle of {spec.screw_circle_mm:g} mm, and {1e3 * piece.wall_m:g} mm round it",
            "a horn with a smaller screw circle, thicker panels, or another driven crease",
        )
        return
    for panel in (before, after):
        tool = punch([circle(0.5e-3 * spec.hub_diameter_mm)], end, right, up, thickness, 10.0 * thickness)
        pieces[panel].cut(tool, "horn", thing, floor)
    for number, (x, y) in enumerate(screws):
        at = floor + x * right + y * up
        hole = punch([circle(0.5e-3 * spec.screw_diameter_mm)], at, right, up, depth, 10.0 * thickness)
        piece.cut(hole, "screw", f"screw {number + 1} of {thing}", at)


def _screws(piece: Workpiece, floor: Vectors, outward: Vectors, right: Vectors, up: Vectors, spec: HornSpec) -> Reals:
    """(n, 2) places of screws on the panel: the horn turned so that most of them hit it."""
    angle = 2.0 * np.pi * np.arange(_SCAN) / _SCAN
    circle_m = 0.5e-3 * spec.screw_circle_mm
    reach = 0.5e-3 * spec.screw_diameter_mm + piece.wall_m
    centre = circle_m * np.column_stack([np.cos(angle), np.sin(angle)])
    ring = reach * np.column_stack([np.cos(angle[::9]), np.sin(angle[::9])])
    places = (centre[:, None] + ring).reshape(-1, 2)
    origins = floor + places[:, :1] * right + places[:, 1:] * up
    deep = piece.depth(origins, -outward).reshape(_SCAN, -1).min(axis=1)
    fits = deep >= 1e-3 * spec.depth_mm + piece.wall_m
    steps = np.round(np.arange(spec.screws) * _SCAN / spec.screws).astype(int)
    together = np.array([fits[(first + steps) % _SCAN].sum() for first in range(_SCAN)])
    # Of several directions that are as good, the middle of the first run: furthest from the panel's faces.
    best = np.flatnonzero(together == together.max())
    run = best[: int(np.argmax(np.append(np.diff(best), 2) > 1)) + 1]
    chosen = (run[len(run) // 2] + steps) % _SCAN
    return np.asarray(centre[chosen[fits[chosen]]])
