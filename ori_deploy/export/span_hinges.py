"""Pockets for piano hinges between span segments: a groove for the pin's knuckles, and one for a leaf on each side.

The pin's axis lies in the panel's face at the cut (`motion.spanwise`), so that segments fold face onto face.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ori_deploy.export.kernel import circle, punch
from ori_deploy.export.parts_spec import SpanHingeSpec
from ori_deploy.export.workpiece import Workpiece
from ori_deploy.motion.spanwise import SpanHinge
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

_PLACES = 41
"""Places along a hinge's line at which the panel's thickness is looked at."""


def let_in_hinge(piece: Workpiece, hinge: SpanHinge, spec: SpanHingeSpec) -> None:
    """Cut a hinge's pockets into one of the two parts it joins: the one whose span ends or begins there."""
    ends = hinge.line_m
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    pin, leaf, thick = (1e-3 * x for x in (0.5 * spec.pin_diameter_mm, spec.leaf_width_mm, spec.leaf_thickness_mm))
    up = np.array([0.0, 0.0, 1.0 if abs(piece.s_low - ends[0, 2]) < abs(piece.s_high - ends[0, 2]) else -1.0])
    outward = _outward(piece, ends.mean(axis=0) + 0.5 * leaf * up, np.cross(along, up))
    needed = max(pin, thick) + piece.wall_m
    places = ends[0] + np.linspace(0.0, 1.0, _PLACES)[:, None] * (ends[1] - ends[0])
    found = piece.depth(places + 0.5 * leaf * up, -outward)
    run = _longest(found >= needed)
    length = (run[1] - run[0]) * hinge.length_m / (_PLACES - 1)
    if length < leaf:
        piece.remark(
            f"piano hinge {hinge.id}",
            f"{1e3 * float(np.median(found)):.2f} mm of panel, {1e3 * length:.1f} mm of it thick enough",
            f"{1e3 * needed:.2f} mm: hinge and thinnest wall, over {1e3 * leaf:g} mm",
            "a thinner hinge, or a larger wall_m in the specification",
        )
        return
    if length < hinge.length_m - 2.0 * piece.wall_m:
        piece.remark(
            f"piano hinge {hinge.id}",
            f"{1e3 * length:.1f} mm of thick enough panel",
            f"{1e3 * hinge.length_m:.1f} mm of flat face",
            "a thinner hinge, or a larger wall_m in the specification",
            left_out=False,
        )
    first, last = places[run[0]], places[run[1]]
    right = along if float(np.cross(along, up) @ outward) > 0.0 else -along
    start = first if right @ along > 0.0 else last
    drawn = np.array([[0.0, -leaf], [length, -leaf], [length, leaf], [0.0, leaf]])
    middle = 0.5 * (first + last)
    piece.cut(punch([drawn], start, right, up, thick, thick), "leaf", f"leaf of {hinge.id}", middle, length)
    groove = punch([circle(pin)], start, outward, np.cross(right, outward), 0.0, length)
    piece.cut(groove, "pin", f"pin of {hinge.id}", middle)


def _longest(fits: NDArray[np.bool_]) -> tuple[int, int]:
    """First and last place of the longest run of places that fit; the same twice where none does."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], fits, [False]]).astype(int)))
    runs = edges.reshape(-1, 2)
    if not len(runs):
        return 0, 0
    start, stop = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
    return int(start), int(stop) - 1


def _outward(piece: Workpiece, at: Vectors, either: Vectors) -> Vectors:
    """The direction, of two opposite ones, that leaves the panel at a place on its face."""
    inside: Reals = piece.depth(np.array([at, at]), np.array([either, -either]))
    return -either if inside[0] > inside[1] else either
