"""What there is to see of a design: panels, creases, slits and latches, each on the rigid body that carries it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.colors import to_rgb

from ori_deploy.design import ConeStructure
from ori_deploy.files import Design
from ori_deploy.motion import CREASES, NEXT_CREASE
from ori_deploy.page.solids import SAGITTA, Lift, Solid
from ori_deploy.profiles.cone import Cone
from ori_deploy.profiles.profile import Reals
from ori_deploy.view.ink import SLIT, cell_colour, edge_colour

Rgb = tuple[int, int, int]
CreaseKind = Literal["opening", "closing"]


def rgb(colour: str) -> Rgb:
    """A colour as three bytes."""
    red, green, blue = (round(255.0 * part) for part in to_rgb(colour))
    return red, green, blue


CREASE_COLOURS: dict[CreaseKind, Rgb] = {"opening": rgb("#16202e"), "closing": rgb("#7b2fd0")}
SLIT_COLOUR = rgb(SLIT)
RED: Rgb = (255, 0, 24)
"""Panels that reach into each other; no cell has it."""
GREY: Rgb = (196, 200, 206)
"""Panels of which nobody knows where they are."""


@dataclass(frozen=True)
class Panel:
    """A panel's body.

    Attributes
    ----------
    id, cell, body
        Its name, the cell it belongs to and the rigid body it is part of, by their numbers.
    solid
        Deployed, in the first span segment.
    colour, rim_colour
        Of its cell.
    """

    id: str
    cell: int
    body: int
    solid: Solid
    colour: Rgb
    rim_colour: Rgb


@dataclass(frozen=True)
class Line:
    """A crease or a rim of a slit.

    Attributes
    ----------
    id, body
        Its name and what carries it.
    segments
        (n, 2, 3) deployed, in the first span segment.
    colour
        Of its kind.
    """

    id: str
    body: int
    segments: Reals
    colour: Rgb


@dataclass(frozen=True)
class Latch:
    """Where a latch is: `place` (3,) deployed, on a body."""

    id: str
    body: int
    place: Reals


@dataclass(frozen=True)
class Content:
    """Everything that is uploaded once.

    Attributes
    ----------
    panels, creases, slits, latches
        In the order of the layout; creases four to a cell.
    segments
        How many pieces the span is cut into; all show the same.
    segment_m
        Length of a piece.
    cone
        Whether it is one: its outer end is then no plane.
    seen
        (3, 3) rows: to the right, up, and towards an eye that looks along the axis at the outer end.
    """

    panels: tuple[Panel, ...]
    creases: tuple[Line, ...]
    slits: tuple[Line, ...]
    latches: tuple[Latch, ...]
    segments: int
    segment_m: float
    cone: bool
    seen: Reals

    @property
    def bodies(self) -> tuple[int, ...]:
        """Numbers of the rigid bodies that carry something; each is that of a panel which is part of it."""
        carried: tuple[Panel | Line | Latch, ...] = (*self.panels, *self.creases, *self.slits, *self.latches)
        return tuple(sorted({one.body for one in carried}))


def lift_of(design: Design) -> Lift:
    """Into the first span segment."""
    if isinstance(design.structure, ConeStructure):
        return Lift(design.structure, design.r_min_m, design.r_max_m)
    return Lift(design.structure, 0.0, design.span_m / design.span_segments)


def content_of(design: Design) -> Content:
    """What there is to see of a design."""
    lift = lift_of(design)
    return Content(
        panels=_panels(design, lift),
        creases=_creases(design, lift),
        slits=_slits(design, lift),
        latches=_latches(design, lift),
        segments=design.span_segments,
        segment_m=lift.high_m - lift.low_m,
        cone=isinstance(design.structure, ConeStructure),
        seen=_seen(design),
    )


def _seen(design: Design) -> Reals:
    return seen_along(design.structure.profile) if isinstance(design.structure, ConeStructure) else np.eye(3)


def seen_along(cone: Cone) -> Reals:
    """(3, 3) right, up and towards an eye on the middle of a cone's rays; y is up as far as that goes."""
    axis = cone.to_user(cone.point(np.linspace(0.0, cone.period, 256, endpoint=False))).mean(axis=0)
    axis /= np.linalg.norm(axis)
    up = np.array([0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [0.0, 0.0, -1.0])
    right = np.cross(up, axis)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(axis, right), axis])


def _panels(design: Design, lift: Lift) -> tuple[Panel, ...]:
    structure, layout = design.structure, design.structure.layout
    made = []
    for p, outline in enumerate(structure.panel_outlines(SAGITTA * structure.profile.size)):
        if len(outline) < 3 or structure.panel_areas[p] <= 0.0:
            continue  # a flat skin without a wall has no body
        cell = p // 4
        colour, rim = cell_colour(cell, layout.n_cells), edge_colour(cell, layout.n_cells)
        made.append(
            Panel(layout.panel_ids[p], cell, int(layout.bodies[p]), lift.solid(outline), rgb(colour), rgb(rim))
        )
    return tuple(made)


def _creases(design: Design, lift: Lift) -> tuple[Line, ...]:
    layout = design.structure.layout
    low, high = (
        end.reshape(layout.n_cells, 4, 3)
        for end in lift.ends(design.structure.cells.crease.reshape(4 * layout.n_cells, *_deep(design)))
    )
    before = {crease: k for k, crease in enumerate(NEXT_CREASE)}
    return tuple(
        Line(
            f"{layout.cell_ids[cell]}.{name}",
            int(layout.bodies[4 * cell + before[k]]),
            np.stack([low[cell, k], high[cell, k]])[None],
            CREASE_COLOURS["opening" if name.startswith("open") else "closing"],
        )
        for cell in range(layout.n_cells)
        for k, name in enumerate(CREASES)
    )


def _deep(design: Design) -> tuple[int, ...]:
    return (3,) if isinstance(design.structure, ConeStructure) else ()


def _vertices(design: Design, lift: Lift) -> Reals:
    """(2, n_vertices, 3) places of the layout's vertices at both ends."""
    structure = design.structure
    return lift.ends(structure.embedding.u if isinstance(structure, ConeStructure) else structure.embedding.z)


def _slits(design: Design, lift: Lift) -> tuple[Line, ...]:
    """The rim of both faces of every slit."""
    layout, ends = design.structure.layout, _vertices(design, lift)
    tail, head = layout.corners.ravel(), np.roll(layout.corners, -1, axis=1).ravel()
    made = []
    for p in np.flatnonzero(layout.is_slit):
        corners = np.stack([ends[0, tail[p]], ends[0, head[p]], ends[1, head[p]], ends[1, tail[p]]])
        rim = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        made.append(Line(layout.panel_ids[p], int(layout.bodies[p]), rim, SLIT_COLOUR))
    return tuple(made)


def _latches(design: Design, lift: Lift) -> tuple[Latch, ...]:
    """At the end that one looks at, where it can be seen: of a slit, or of a cell's first opening crease."""
    layout, ends = design.structure.layout, _vertices(design, lift)
    tail, head = layout.corners.ravel(), np.roll(layout.corners, -1, axis=1).ravel()
    on_slit = {frozenset((int(tail[p]), int(head[p]))): int(p) for p in np.flatnonzero(layout.is_slit)}
    creases = _creases(design, lift)
    made = []
    slits = {f"slit:{layout.vertices[a].id}-{layout.vertices[b].id}": frozenset((a, b)) for a, b in layout.slits}
    for point in layout.latch_points:
        if point in slits:
            p = on_slit[slits[point]]
            made.append(Latch(point, int(layout.bodies[p]), ends[1, [tail[p], head[p]]].mean(axis=0)))
        else:
            crease = creases[4 * layout.cell_ids.index(point.removeprefix("cell:"))]
            made.append(Latch(point, crease.body, crease.segments[0, 1]))
    return tuple(made)
