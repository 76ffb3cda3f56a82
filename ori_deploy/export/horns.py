"""Servo horns: let into the end of the span about a driven crease, and screwed to the panel that follows it.

The servo sits beyond the end, fixed to the panel before the crease; its horn turns in a recess of both panels, of
panels bonded to them, and of all others that pass it at some fold. Where horns would meet each other, or a recess
would break a panel, a horn is left out and told. A cylinder's servos sit at z = 0, a cone's at its outer radius.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ori_deploy.errors import InputError
from ori_deploy.export.hub_room import FOLDS, Hub, Sweep, distances
from ori_deploy.export.kernel import around, circle, punch, upright
from ori_deploy.export.parts_spec import HornSpec, PartsSpec, ServoSpec
from ori_deploy.export.workpiece import Cut, Remark, Workpiece, take_together
from ori_deploy.files import Design
from ori_deploy.layout import Layout
from ori_deploy.motion import CREASES, NEXT_CREASE
from ori_deploy.motion.mechanism import AnyStructure
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

_SCAN = 72
"""Directions round the crease in which a horn's first screw is tried."""
_TURNS = 36
"""Directions in which a servo's body is tried."""
_RIM = 8
"""Places round a screw at which the panel's thickness is looked at."""
_FEW = 2
"""Screws below which a horn's mount is told."""
_TOUCH = 1e-12
"""Part of a panel that a recess has to take."""
_UNDER = 1e-6
"""How far below the end of the span, metres, screws are looked at."""


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


@dataclass(frozen=True)
class _Horn:
    """A horn to mount: its crease ("c1.close_a"), the panels before and after it, its hub and frame."""

    crease: str
    before: int
    hub: Hub
    end: Vectors
    outward: Vectors

    @property
    def name(self) -> str:
        return f"horn {self.crease}"

    @property
    def right_up(self) -> tuple[Vectors, Vectors]:
        return upright(self.outward)


def mount_horns(
    pieces: Mapping[int, Workpiece], design: Design, driven: Mapping[str, str], spec: PartsSpec
) -> list[Remark]:
    """Cut recesses and screw holes for all horns; those that do not fit are left out, and told.

    Parameters
    ----------
    pieces
        By panel, the parts at the end of the span where servos sit.
    driven
        Crease by cell.
    """
    layout, remarks = design.structure.layout, []
    sweep = Sweep(design, {panel: piece.shape for panel, piece in pieces.items()})
    mounted: list[_Horn] = []
    for cell, name in driven.items():
        number, crease = layout.cell_ids.index(cell), CREASES.index(name)
        k = NEXT_CREASE.index(crease)
        before, after = 4 * number + k, 4 * number + (k + 1) % 4
        missing = [layout.panel_ids[panel] for panel in (before, after) if panel not in pieces]
        if missing:
            told = f"no panel {' and no '.join(missing)}", "both panels at the crease"
            remedy = "a wall_m above 0 in the specification, or another driven crease"
            remarks.append(Remark(layout.panel_ids[after], f"horn {cell}.{name}", *told, remedy))
            continue
        horn = _horn(pieces[after], design.structure, number, crease, before, spec.horn)
        refused = _neighbours(sweep, horn, mounted, spec)
        if refused is not None:
            pieces[after].remark(horn.name, *refused)
        elif _mount(pieces, sweep, horn, layout, spec):
            mounted.append(horn)
    return remarks


def _horn(piece: Workpiece, structure: AnyStructure, cell: int, crease: int, before: int, spec: HornSpec) -> _Horn:
    base, along = crease_line(structure, cell, crease)
    on_cone = piece.shape.on_cone
    deep = 1e-3 * (spec.thickness_mm + spec.clearance_mm)
    s_end = piece.s_high if on_cone else piece.s_low
    hub = Hub(piece.shape.panel, base, along, s_end - deep if on_cone else s_end + deep)
    name = f"{structure.layout.cell_ids[cell]}.{CREASES[crease]}"
    return _Horn(name, before, hub, base + s_end * along, along if on_cone else -along)


def _neighbours(sweep: Sweep, horn: _Horn, mounted: list[_Horn], spec: PartsSpec) -> tuple[str, str, str] | None:
    """A hub that is there already and comes too near, or its servo does."""
    needed = max(spec.horn.recess_mm, 2.0 * spec.servo.reach_mm)
    for other in mounted:
        away = 1e3 * np.linalg.norm(sweep.place(other.hub, horn.hub), axis=1)
        if away.min() < needed:
            when = FOLDS[int(np.argmin(away))]
            return (
                f"{away.min():.2f} mm from horn {other.crease} at fold {when:.2f}",
                f"{needed:.2f} mm: horn.hub_diameter_mm and clearance, or twice servo.reach_mm",
                "smaller horns and servos, or other driven creases",
            )
    return None


def _mount(pieces: Mapping[int, Workpiece], sweep: Sweep, horn: _Horn, layout: Layout, spec: PartsSpec) -> bool:
    """Cut a horn's recess and its screws, then the servo's; False where there is no horn."""
    piece = pieces[horn.hub.panel]
    right, up = horn.right_up
    gap, thick = 1e-3 * spec.horn.clearance_mm, 1e-3 * spec.horn.thickness_mm
    depth, beyond = 1e-3 * spec.horn.depth_mm, 10.0 * thick
    floor = horn.end - (thick + gap) * horn.outward
    screws = _screws(piece, floor, horn, spec.horn)
    if not len(screws):
        piece.remark(
            horn.name,
            "no screw hits the panel",
            f"1 of {spec.horn.screws} on a circle of {spec.horn.screw_circle_mm:g} mm, "
            f"and {1e3 * piece.wall_m:g} mm round it",
            "a horn with a smaller screw circle, thicker panels, or another driven crease",
        )
        return False
    cuts = _recesses(pieces, sweep, horn, layout, spec.horn)
    for number, (x, y) in enumerate(screws):
        at = floor + x * right + y * up
        hole = punch([circle(0.5e-3 * spec.horn.screw_diameter_mm)], at, right, up, depth, beyond)
        bottom = (at - depth * horn.outward)[None]
        cut = Cut(hole, "screw", f"screw {number + 1} of {horn.name}", at, floor=bottom, into=-horn.outward)
        cuts.append((piece, cut))
    if not take_together(cuts):
        return False
    if len(screws) < min(_FEW, spec.horn.screws):
        piece.remark(
            f"screws of {horn.name}",
            f"{len(screws)} of {spec.horn.screws} hit the panel",
            f"{_FEW}: one alone takes all of the torque",
            "a horn with a smaller screw circle, thicker panels, or glue",
            left_out=False,
        )
    _bolt(pieces[horn.before], horn, spec.servo, beyond)
    return True


def _recesses(
    pieces: Mapping[int, Workpiece], sweep: Sweep, horn: _Horn, layout: Layout, spec: HornSpec
) -> list[tuple[Workpiece, Cut]]:
    """A hub's recess in every panel that it reaches at some fold: at rest, or along its way."""
    gap, thick, radius = 1e-3 * spec.clearance_mm, 1e-3 * spec.thickness_mm, 0.5e-3 * spec.recess_mm
    bodies, own = layout.bodies, horn.hub.panel
    floor = horn.end - (thick + gap) * horn.outward
    cuts = []
    for panel, piece in pieces.items():
        near = distances(sweep.outline(panel, horn.hub)) < radius
        # The horn rests on its own panel and what is bonded to it; against all others it turns.
        follows = bodies[panel] == bodies[own]
        deep = thick + (gap if follows else 2.0 * gap)
        tool = punch([around(radius)], horn.end, *horn.right_up, deep, 10.0 * thick)
        name = horn.name
        if not follows and bodies[panel] != bodies[horn.before]:
            if not near.any():
                continue
            tool, name = sweep.way(tool, panel, horn.hub, near), f"way of {horn.name}"
        # What only clearance touches is no recess.
        if panel == own or float((piece.body ^ tool).volume()) > _TOUCH * piece.plain_m3:
            cuts.append((piece, Cut(tool, "horn", name, floor)))
    return cuts


def _screws(piece: Workpiece, floor: Vectors, horn: _Horn, spec: HornSpec) -> Reals:
    """(n, 2) places of screws on the panel: the horn turned so that most of them hit it."""
    # So fine a circle that every screw lies on it exactly, whichever direction the first one has.
    fine = int(np.lcm(_SCAN, spec.screws))
    angle = 2.0 * np.pi * np.arange(fine) / fine
    centre = 0.5e-3 * spec.screw_circle_mm * np.column_stack([np.cos(angle), np.sin(angle)])
    fits = _fits(piece, floor, horn, centre, 0.5e-3 * spec.screw_diameter_mm, 1e-3 * spec.depth_mm)
    first, steps = np.arange(_SCAN) * (fine // _SCAN), np.arange(spec.screws) * (fine // spec.screws)
    together = fits[(first[:, None] + steps) % fine].sum(axis=1)
    # Of several directions that are as good, the middle of the first run: furthest from the panel's faces.
    best = np.flatnonzero(together == together.max())
    run = best[: int(np.argmax(np.append(np.diff(best), 2) > 1)) + 1]
    chosen = (first[run[len(run) // 2]] + steps) % fine
    return np.asarray(centre[chosen[fits[chosen]]])


def _fits(
    piece: Workpiece, origin: Vectors, horn: _Horn, centre: Reals, radius: float, depth: float
) -> NDArray[np.bool_]:
    """(n,) whether holes at places (n, 2) of a plane across the crease lie in the panel, a wall round them."""
    right, up = horn.right_up
    angle = 2.0 * np.pi * np.arange(_RIM) / _RIM
    ring = (radius + piece.wall_m) * np.column_stack([np.cos(angle), np.sin(angle)])
    places = (centre[:, None] + ring).reshape(-1, 2)
    origins = origin + places[:, :1] * right + places[:, 1:] * up
    deep = piece.room(origins, -horn.outward, 0.0).reshape(len(centre), -1).min(axis=1)
    return np.asarray(deep >= depth + piece.wall_m)


def _bolt(piece: Workpiece, horn: _Horn, spec: ServoSpec, beyond: float) -> None:
    """Holes for the servo's body, in the end of the panel before the crease; those that miss it are told."""
    drawn = 1e-3 * np.array(spec.bolts_mm).reshape(-1, 2)
    if not len(drawn):
        return
    if float(np.linalg.det(piece.to_user[:3, :3])) < 0.0:  # a mirrored frame would show the pattern from behind
        drawn = drawn * np.array([-1.0, 1.0])
    radius, depth = 0.5e-3 * spec.bolt_diameter_mm, 1e-3 * spec.depth_mm
    furthest = float(np.linalg.norm(drawn, axis=1).max()) + radius + piece.wall_m
    # A cone ends in a sphere: it lies further back the further from the crease.
    sag = furthest**2 / piece.s_high if piece.shape.on_cone else 0.0
    turn = 2.0 * np.pi * np.arange(_TURNS) / _TURNS
    x, y = drawn.T
    at = np.stack(
        [
            np.outer(np.cos(turn), x) - np.outer(np.sin(turn), y),
            np.outer(np.sin(turn), x) + np.outer(np.cos(turn), y),
        ],
        -1,
    )
    top = horn.end - (sag + _UNDER) * horn.outward
    fits = _fits(piece, top, horn, at.reshape(-1, 2), radius, depth).reshape(_TURNS, -1)
    best = int(np.argmax(fits.sum(axis=1)))
    right, up = horn.right_up
    made = 0
    for number in np.flatnonzero(fits[best]):
        place = horn.end + at[best, number, 0] * right + at[best, number, 1] * up
        hole = punch([circle(radius)], place, right, up, sag + depth, beyond)
        bottom = (place - (sag + depth) * horn.outward)[None]
        name = f"bolt {number + 1} of servo {horn.crease}"
        made += piece.take(Cut(hole, "bolt", name, place, floor=bottom, into=-horn.outward))
    if made < len(drawn):
        piece.remark(
            f"servo {horn.crease}: {len(drawn) - made} of {len(drawn)} bolts",
            f"{made} hit the end of the panel beside the horn",
            f"{spec.depth_mm:g} mm deep, and {1e3 * piece.wall_m:g} mm round each",
            "a bracket of your own, other servo.bolts_mm, or thicker panels",
        )
