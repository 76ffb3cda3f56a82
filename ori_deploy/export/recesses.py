"""Clearance on faces that meet, and which strip of a panel's surface a crease's film lies on.

A crease's film lies where the crease folds to: an opening crease's on the outer skin, or on the back where no skin is
left beside it, a closing crease's on the inner faces. On a cone the strip's width shrinks towards the apex like the
panels. How it is let in there: `films`.
"""

from __future__ import annotations

import numpy as np

from ori_deploy.export.kernel import punch, slab
from ori_deploy.export.parts_spec import ClearanceSpec
from ori_deploy.export.rulings import Face, Kind, PanelShape, Rulings
from ori_deploy.export.workpiece import Workpiece
from ori_deploy.profiles.sphere import Vectors

_LEAST_TURN = np.radians(10.0)
"""Corner below which two faces count as one that goes on."""


def creases_of(panel: int) -> tuple[int, int]:
    """Numbers, in the order of `CREASES`, of a panel's opening and closing crease."""
    k = panel % 4
    return k // 2, 2 if k in (0, 3) else 3


def clear(piece: Workpiece, spec: ClearanceSpec, is_slit: bool) -> None:
    """Take the clearance off the panel's faces, but for its skin."""
    back = ("slit", spec.slit_mm) if is_slit else ("bond", spec.bond_mm)
    named = {
        "joint_open": ("opening joint", spec.joint_mm),
        "joint_close": ("closing joint", spec.joint_mm),
        "inner": ("inner face", spec.inner_mm),
        "back": back,
    }
    for kind, (name, width_mm) in named.items():
        face = piece.shape.face(kind, piece.s_high)  # type: ignore[arg-type]
        if face is None or width_mm == 0.0:
            continue
        depth = 1e-3 * width_mm
        reach = [depth / np.tan(turn) if _LEAST_TURN < turn < 0.5 * np.pi else 0.0 for turn in _turns(face)]
        row = face.rulings.extended(reach[0], reach[1], piece.s_high)
        low, high = beyond(piece)
        piece.cut(slab(row, depth, depth, low, high), "clearance", f"clearance {name}", middle(row, piece))


def clear_end(piece: Workpiece, at_high: bool, width_m: float) -> None:
    """Take the clearance off an end of a cylinder's segment."""
    if width_m == 0.0:
        return
    flat = piece.shape.points
    low, high = flat.min(axis=0), flat.max(axis=0)
    x, y = np.stack([low, high], axis=1) + np.array([-1.0, 1.0]) * float((high - low).max())
    drawn = np.array([[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]])
    end = np.array([0.0, 0.0, piece.s_high if at_high else piece.s_low])
    tool = punch([drawn], end, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), width_m, width_m)
    piece.cut(tool, "clearance", "clearance segment", end + np.array([*flat.mean(axis=0), 0.0]))


def _turns(face: Face) -> tuple[float, float]:
    return face.turn_before, face.turn_after


def beyond(piece: Workpiece) -> tuple[float, float]:
    """A range of `s` that ends outside the part at both ends, but never behind an apex."""
    span = piece.s_high - piece.s_low
    return (0.5 * piece.s_low if piece.shape.on_cone else piece.s_low - span), piece.s_high + span


def middle(row: Rulings, piece: Workpiece) -> Vectors:
    """(3,) about the middle of a face."""
    return np.asarray(row.at(0.5 * (piece.s_low + piece.s_high)).mean(axis=0))


def film_face(shape: PanelShape, opening: bool, s_high: float) -> Face | None:
    """The face of a panel that the film of its opening or closing crease lies on."""
    kinds: tuple[Kind, ...] = ("skin", "back") if opening else ("inner",)
    return next((face for kind in kinds if (face := shape.face(kind, s_high))), None)


def film_row(shape: PanelShape, opening: bool, width_m: float, s_high: float) -> tuple[Rulings | None, float]:
    """The strip of a panel's surface beside a crease that its film may cover, and the face's width at `s_high`."""
    face = film_face(shape, opening, s_high)
    if face is None:
        return None, 0.0
    row = face.rulings
    # Even panels' faces run towards the crease, odd ones' away from it.
    strip = row.reversed().first(width_m, s_high).reversed() if shape.panel % 2 == 0 else row.first(width_m, s_high)
    return strip, float(row.widths(s_high).sum())
