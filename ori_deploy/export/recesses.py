"""Recesses for film at every crease, and clearance on faces that meet.

A crease's film lies where the crease folds to: an opening crease's on the outer skin, or on the back where no skin is
left beside it, a closing crease's on the inner faces. It is let in flush, so faces close on each other over it. Its
strip keeps its depth everywhere; on a cone its width shrinks towards the apex like the panels.
"""

from __future__ import annotations

import numpy as np

from ori_deploy.export.kernel import punch, slab
from ori_deploy.export.parts_spec import ClearanceSpec, FilmSpec
from ori_deploy.export.rulings import Face, Kind, PanelShape, Rulings
from ori_deploy.export.workpiece import FilmStrip, Workpiece
from ori_deploy.layout import Layout
from ori_deploy.motion import CREASES
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


def film_row(shape: PanelShape, opening: bool, width_m: float, s_high: float) -> tuple[Rulings | None, float]:
    """The strip of a panel's surface beside a crease that its film is glued to, and the face's width at `s_high`."""
    even = shape.panel % 2 == 0
    kinds: tuple[Kind, ...] = ("skin", "back") if opening else ("inner",)
    face = next((f for kind in kinds if (f := shape.face(kind, s_high))), None)
    if face is None:
        return None, 0.0
    row = face.rulings
    # Even panels' faces run towards the crease, odd ones' away from it.
    strip = row.reversed().first(width_m, s_high).reversed() if even else row.first(width_m, s_high)
    return strip, float(row.widths(s_high).sum())


def measure_films(piece: Workpiece, spec: FilmSpec, layout: Layout) -> None:
    """Note what both films of a panel cover, whether or not they are let in."""
    cell = layout.cell_ids[piece.shape.panel // 4]
    for number, opening in zip(creases_of(piece.shape.panel), (True, False), strict=True):
        row, face = film_row(piece.shape, opening, 1e-3 * spec.glue_mm, piece.s_high)
        if row is None:
            continue
        length, width = piece.s_high - piece.s_low, min(face, 1e-3 * spec.glue_mm)
        shape = 0.5 * (1.0 + piece.s_low / piece.s_high) if piece.shape.on_cone else 1.0
        at = piece.placed(middle(row, piece))
        piece.films.append(FilmStrip(f"{cell}.{CREASES[number]}", width, length, shape * width * length, at))


def let_in_films(piece: Workpiece, spec: FilmSpec, layout: Layout) -> None:
    """Cut the recesses for both films of a panel; narrow ones and those that do not fit are told."""
    cell = layout.cell_ids[piece.shape.panel // 4]
    depth, glue = 1e-6 * spec.thickness_um, 1e-3 * spec.glue_mm
    for number, opening in zip(creases_of(piece.shape.panel), (True, False), strict=True):
        name = f"film {cell}.{CREASES[number]}"
        row, width = film_row(piece.shape, opening, glue, piece.s_high)
        if row is None or width <= depth:
            piece.remark(name, f"{1e3 * width:.2g} mm of face", f"{spec.glue_mm:g} mm", "another vertex, or a wall_m")
            continue
        needed = depth + 1e-3 * spec.floor_mm
        start = _thick_enough(piece, row, needed)
        if start >= piece.s_high:
            thin = _thickness(piece, row)
            piece.remark(
                name,
                f"{1e3 * thin:.2f} mm thick",
                f"{1e3 * needed:.2f} mm: film and film.floor_mm",
                "a thinner film, or a larger wall_m in the specification",
            )
            continue
        low, high = beyond(piece)
        if start > piece.s_low:
            low = start
            piece.remark(
                name,
                f"recess from {1e3 * start:.0f} mm on",
                f"from {1e3 * piece.s_low:.0f} mm: too thin nearer the apex",
                "a thinner film, or a larger r_min_m",
                left_out=False,
            )
        if width < glue * (1.0 - 1e-9):
            piece.remark(
                name,
                f"{1e3 * width:.2f} mm of face",
                f"{spec.glue_mm:g} mm",
                "a smaller film.glue_mm, or vertices further apart",
                left_out=False,
            )
        piece.cut(slab(row, depth, max(depth, 1e-4), low, high), "film", name, middle(row, piece))


def _thickness(piece: Workpiece, row: Rulings) -> float:
    """How thick the panel is under the middle of a strip, at `s_high` or just before."""
    s = piece.s_high - 1e-3 * (piece.s_high - piece.s_low)
    half = row.first(0.5 * float(row.widths(s).sum()), s)
    return float(piece.depth(half.at(s)[-1:], -half.normals(s)[-1])[0])


def _thick_enough(piece: Workpiece, row: Rulings, needed: float) -> float:
    """From where along the span a strip may be let in; on a cone thickness grows with the distance from the apex."""
    thin = _thickness(piece, row)
    if thin < needed:
        return piece.s_high
    return piece.s_high * needed / thin if piece.shape.on_cone else piece.s_low
