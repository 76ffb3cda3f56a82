"""Antenna strips: a band of sheet metal wound round the outer surface of a deployed structure.

The surface of a cylinder or a cone is developable: cut along one ruling it lies flat, and a band drawn on the
flat sheet bends onto it without stretching. A place on it is (arc, height): on a cylinder arc length along the
outline and length along the axis, metres; on a cone arc length along the curve on the unit sphere, radians,
and radius from the apex, metres. Arcs are counted on past a whole turn.

- A helical band lies between two helices, geodesics that are parallel straight lines on the flat sheet. Its ends
  follow rulings, so flat it is one straight parallelogram.
- A conical spiral band lies between two equiangular spirals, `radius = start exp(k arc)`, which cross all rulings
  under one angle: on the flat sheet two logarithmic spirals. Every turn is a scaled copy of the one before.

Panels carry what of the band lies on them, cut at the joints between panels. What becomes of the band at a joint
when the structure folds is the joint's kind:

- "rigid": both panels are bonded, the band runs on;
- "fold": an opening crease lies on the outline: the band is folded sharply along it;
- "part": the panels separate (at a slit, and at closing vertices, whose hinge lies inside by the wall's
  offset): the band has to be cut there and joined by a contact or a slack loop as long as the gap
  (`motion.strip_gaps`). Without wall the hinge of a closing vertex lies on the outline: "fold", outwards.

The band has no thickness.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ori_deploy.design.band import Band, HelixBand, SpiralBand
from ori_deploy.design.cone import ConeStructure
from ori_deploy.design.structure import Structure
from ori_deploy.errors import StripError
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.tolerance import TOLERANCE

JointKind = Literal["rigid", "fold", "part"]


@dataclass(frozen=True)
class Joint:
    """A ruling on which two panels of the outer surface meet, counter-clockwise `before` and `after`.

    Attributes
    ----------
    at
        Crease ("c1.open_c") or outline vertex.
    kind
        See the module's notes.
    before, after
        Panel numbers.
    s, arc
        Parameter and arc, within the first turn from the outline's start or next to it.
    fold_rad
        Angle by which the surface turns about the ruling until flat, where it is the panels' hinge: positive
        where it is folded inwards (a valley seen from outside), negative outwards; 0 at other joints.
    """

    at: str
    kind: JointKind
    before: int
    after: int
    s: float
    arc: float
    fold_rad: float


@dataclass(frozen=True)
class Piece:
    """What of a band lies on one panel in one turn, between two rulings.

    Attributes
    ----------
    panel
        Panel number.
    turn
        0 for the turn in which the band begins, counted from the outline's start.
    start, stop
        Arcs, unrolled like the band's.
    area_m2
        Exact.
    """

    panel: int
    turn: int
    start: float
    stop: float
    area_m2: float


@dataclass(frozen=True)
class Strip:
    """A band laid onto a structure. Make one with `lay_strip`.

    Attributes
    ----------
    band
        The band.
    pieces
        On the panels, in the band's order from its beginning.
    joints
        All joints round the outline, counter-clockwise.
    """

    band: Band
    pieces: tuple[Piece, ...]
    joints: tuple[Joint, ...]

    @property
    def area_m2(self) -> float:
        return self.band.area_m2(self.band.first, self.band.last)

    def crossings(self, joint: Joint) -> Reals:
        """Arcs at which the band runs across a joint, ends of the band not counted."""
        turn, first, last = self.band.turn_arc, self.band.first, self.band.last
        slack = TOLERANCE.vertex_gap * turn
        k = np.arange(np.floor((first - joint.arc) / turn), np.ceil((last - joint.arc) / turn) + 1.0)
        arcs = joint.arc + k * turn
        return arcs[(arcs > first + slack) & (arcs < last - slack)]

    def polygon(self, piece: Piece, sagitta_m: float) -> Reals:
        """(n, 2) arc within the panel's own turn and height of a piece's corners, lower edge first."""
        arc = self.band.stations(piece.start, piece.stop, sagitta_m)
        low, high = self.band.edges(arc)
        own = arc - piece.turn * self.band.turn_arc
        return np.concatenate([np.stack([own, low], axis=1), np.stack([own, high], axis=1)[::-1]])

    def across(self, arc: float) -> Points:
        """(2,) ends of the band's ruling at `arc` on the flat sheet, lower edge first; complex, metres."""
        return self.band.unrolled(np.array([arc, arc]), np.array(self.band.edges(arc)))

    def development(self, sagitta_m: float, start: float | None = None, stop: float | None = None) -> Points:
        """Outline of the band on the flat sheet between two arcs, its ends when left out; complex, metres."""
        first = self.band.first if start is None else start
        last = self.band.last if stop is None else stop
        arc = self.band.stations(first, last, sagitta_m)
        low, high = self.band.edges(arc)
        return np.concatenate([self.band.unrolled(arc, low), self.band.unrolled(arc, high)[::-1]])


def lay_strip(structure: Structure | ConeStructure, band: Band, low_m: float, high_m: float) -> Strip:
    """Cut a band into the pieces that its panels carry.

    Parameters
    ----------
    structure
        What carries it.
    band
        On this structure's surface: its `turn_arc` is the perimeter.
    low_m, high_m
        Heights between which there is a surface: 0 and the span of a cylinder, the two radii of a cone.

    Raises
    ------
    StripError
        The band leaves the surface, or overlaps its own next turn.
    """
    _check_band(band, low_m, high_m)
    joints = joints_of(structure)
    turn, slack = band.turn_arc, TOLERANCE.vertex_gap * band.turn_arc
    pieces = []
    for opening, closing in zip(joints, (*joints[1:], joints[0]), strict=True):
        start, stop = opening.arc, closing.arc + (turn if closing is joints[0] else 0.0)
        for k in range(int(np.floor((band.first - stop) / turn)), int(np.ceil((band.last - start) / turn)) + 1):
            a, b = max(start + k * turn, band.first), min(stop + k * turn, band.last)
            if b - a > slack:
                pieces.append(Piece(opening.after, k, a, b, band.area_m2(a, b)))
    if not pieces:
        raise StripError(
            "strip: shorter than any panel could carry",
            value=f"{band.length_m:.3g} m",
            limit=f"more than {TOLERANCE.vertex_gap:g} of a turn",
            remedy="give more turns",
        )
    return Strip(band, tuple(sorted(pieces, key=lambda piece: piece.start)), joints)


def joints_of(structure: Structure | ConeStructure) -> tuple[Joint, ...]:
    """Where panels meet on the outer surface, counter-clockwise from the first at or after the outline's start."""
    span = structure.outline_pieces
    profile, layout = structure.profile, structure.layout
    slack = TOLERANCE.vertex_gap * profile.period
    on_surface = np.flatnonzero(span[:, 1] - span[:, 0] > slack)
    order = on_surface[np.argsort((span[on_surface, 0] + slack) % profile.period)]
    found = []
    for before, after in zip(np.roll(order, 1), order, strict=True):
        s = float((span[after, 0] + slack) % profile.period - slack)
        at, kind, fold = _meeting(structure, int(before), int(after), s)
        found.append(Joint(at, kind, int(before), int(after), s, float(profile.arc_length(s)), fold))
    if len(found) == 1:
        raise StripError("strip: the outer surface is one panel", limit=f"{layout.n_cells} cells with joints")
    return tuple(found)


def _meeting(structure: Structure | ConeStructure, before: int, after: int, s: float) -> tuple[str, JointKind, float]:
    """Name, kind and fold angle of the joint between two panels."""
    layout = structure.layout
    cell, k = divmod(before, 4)
    same_cell = after == 4 * cell + (k + 1) % 4
    if same_cell and k in (0, 2):
        angle = float(structure.cells.angle[cell, k // 2])
        return f"{layout.cell_ids[cell]}.open_{'cd'[k // 2]}", "fold", np.pi - angle
    period = structure.profile.period
    away = np.abs((structure.embedding.s - s + 0.5 * period) % period - 0.5 * period)
    vertex = int(np.nanargmin(away))
    at = layout.vertices[vertex].id
    if same_cell:
        which = 3 if k == 1 else 2
        hinge, place = structure.cells.crease[cell, which], structure.profile.point(structure.embedding.s[vertex])
        if np.linalg.norm(np.atleast_1d(hinge - place)) <= TOLERANCE.vertex_gap * structure.profile.size:
            return at, "fold", -float(structure.cells.angle[cell, which])
    return at, "rigid" if layout.bodies[before] == layout.bodies[after] else "part", 0.0


def _check_band(band: Band, low_m: float, high_m: float) -> None:
    low, high = band.edges(np.array([band.first, band.last]))
    if low.min() < low_m - 1e-12 * high_m or high.max() > high_m * (1.0 + 1e-12):
        raise StripError(
            "strip: leaves the surface that is to carry it",
            value=f"{float(low.min()):.6g} to {float(high.max()):.6g} m",
            limit=f"{low_m:.6g} to {high_m:.6g} m",
            remedy="fewer turns, a narrower strip, or another start_m",
        )
    if band.last - band.first > band.turn_arc:
        here, there = (edge[0] for edge in band.edges(np.array([band.first]))), band.edges(band.first + band.turn_arc)
        bottom, top = here
        if float(there[0]) < float(top) and float(there[1]) > float(bottom):
            gap = max(float(there[0]) - float(top), float(bottom) - float(there[1]))
            raise StripError(
                "strip: overlaps its own next turn",
                value=f"by {-gap:.6g} m where it begins",
                limit="less than one turn, or edges apart",
                remedy="a narrower strip or a larger rise per turn",
            )


def helix(
    structure: Structure,
    span_m: float,
    *,
    pitch_m: float,
    width_m: float,
    turns: float,
    start_m: float | None = None,
    start_arc: float = 0.0,
) -> Strip:
    """A helical strip on a cylinder.

    Parameters
    ----------
    structure, span_m
        The cylinder.
    pitch_m, width_m, turns, start_m
        See `HelixBand`; without `start_m` the strip begins at the end of the span it rises from.
    start_arc
        Where it begins, as a fraction of the outline's length from its start.

    Raises
    ------
    StripError
        A measure out of range, or the strip does not fit.
    """
    _check_positive(width_m=width_m, turns=turns, start_arc=start_arc + 1.0)
    if not (np.isfinite(pitch_m) and pitch_m != 0.0):
        raise StripError("strip: pitch_m", value=pitch_m, limit="not 0", remedy="negative for a left-handed helix")
    turn = structure.profile.perimeter
    band = HelixBand(turn, pitch_m, width_m, turns, 0.0, start_arc * turn)
    if start_m is None:
        start_m = 0.5 * band.height_m if pitch_m > 0.0 else span_m - 0.5 * band.height_m
    band = HelixBand(turn, pitch_m, width_m, turns, start_m, start_arc * turn)
    return lay_strip(structure, band, 0.0, span_m)


def spiral(
    structure: ConeStructure,
    r_min_m: float,
    r_max_m: float,
    *,
    growth: float,
    width_turns: float,
    turns: float,
    start_m: float | None = None,
    start_arc: float = 0.0,
) -> Strip:
    """A conical spiral strip.

    Parameters
    ----------
    structure, r_min_m, r_max_m
        The cone and the radii at which it is cut off.
    growth, width_turns, turns, start_m
        See `SpiralBand`; without `start_m` the strip begins at the end of the surface it winds away from.
    start_arc
        Where it begins, as a fraction of the outline's length from its start.

    Raises
    ------
    StripError
        A measure out of range, or the strip does not fit.
    """
    _check_positive(width_turns=width_turns, turns=turns, growth=growth, start_arc=start_arc + 1.0)
    if growth == 1.0:
        raise StripError("strip: growth", value=growth, limit="not 1", remedy="1.5 is half as far again every turn")
    profile = structure.profile
    turn, handed = profile.perimeter, 1.0 if profile.is_right_handed else -1.0
    if start_m is None:
        edge = np.sqrt(growth**width_turns)
        start_m = float(r_min_m * edge if growth > 1.0 else r_max_m * edge)
    if not start_m > 0.0:
        raise StripError(
            "strip: begins at the apex", value=f"{start_m:g} m", limit="> 0", remedy="give start_m, or r_min_m > 0"
        )
    band = SpiralBand(turn, growth, width_turns, turns, start_m, start_arc * turn, handed)
    return lay_strip(structure, band, r_min_m, r_max_m)


def _check_positive(**measures: float) -> None:
    for name, value in measures.items():
        if not (np.isfinite(value) and value > 0.0):
            raise StripError(f"strip: {name}", value=value, limit="> 0", remedy="mend the value")
