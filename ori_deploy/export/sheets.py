"""Films of the creases, laid flat: what to cut, where it folds, where it is glued to which panel.

A film lies over its crease in the recesses of both panels (`films`), and is cut as these were: on a cylinder a
rectangle as long as the span, or as a segment of it, less a horn's recess; on a cone a sector between two radii,
because everything there narrows towards the apex. Along the crease it stays free over a length in proportion to its
thickness, or where the panel is too thin, and is glued beyond. A sheet is drawn as seen on the finished structure,
from outside for opening creases and from inside the cell for closing ones, with the crease along x from the beginning
of the span.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ori_deploy.design import ConeStructure
from ori_deploy.export.parts import Part, Parts
from ori_deploy.export.skeleton import Skeleton
from ori_deploy.export.workpiece import FilmStrip, Remark
from ori_deploy.files import Design
from ori_deploy.motion import CREASES, NEXT_CREASE
from ori_deploy.profiles.profile import Reals


@dataclass(frozen=True)
class Ring:
    """A closed line of straight sides and arcs.

    Attributes
    ----------
    corners
        (n, 2) metres, counter-clockwise.
    bulge
        (n,) of the side from each corner to the next: the tangent of a quarter of its arc's angle, positive where it
        bends to the left; 0 for a straight side.
    """

    corners: Reals
    bulge: Reals

    @property
    def area_m2(self) -> float:
        """What it encloses, arcs and all."""
        p, n = self.corners, np.roll(self.corners, -1, axis=0)
        straight = 0.5 * float((p[:, 0] * n[:, 1] - p[:, 1] * n[:, 0]).sum())
        angle = 4.0 * np.arctan(self.bulge)
        half_chord = 0.5 * np.linalg.norm(n - p, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            radius = np.where(angle != 0.0, half_chord / np.sin(0.5 * np.abs(angle)), 0.0)
        return straight + 0.5 * float((radius**2 * (angle - np.sin(angle))).sum())


@dataclass(frozen=True)
class GlueZone:
    """Where a film is glued to a panel."""

    panel: str
    ring: Ring


@dataclass(frozen=True)
class Sheet:
    """The film of one crease, flat.

    Attributes
    ----------
    id
        "c1.open_c"; with span segments "c1.open_c.s2".
    cut
        Its outline.
    fold
        (2, 2) ends of the crease.
    glue
        Its zones, the upper one first; one of them is missing where the film is not let into its panel.
    length_m
        Of the crease.
    width_m
        Across it, at the wider end.
    remarks
        Of its two panels, what does not fit.
    """

    id: str
    cut: Ring
    fold: Reals
    glue: tuple[GlueZone, ...]
    length_m: float
    width_m: float
    remarks: tuple[Remark, ...] = ()


@dataclass(frozen=True)
class _Side:
    """A film on one panel: how far across it reaches (on a cone: radians), between which places, glued how."""

    panel: str
    reach: float
    s_low: float
    s_high: float
    glue_from_m: float | None


def sheets_of(parts: Parts) -> tuple[Sheet, ...]:
    """The films of all creases as they are let into finished parts, those of every span segment apart."""
    design, worked = parts.design, parts.worked
    skeleton = Skeleton(design)
    found = {(part.panel, part.segment): part for part in worked.parts}
    made = []
    for cell, names in enumerate(skeleton.crease_names):
        for crease, name in enumerate(names):
            panels = [4 * cell + k for k in _panels(skeleton, crease)]
            for segment in range(design.span_segments):
                both = [found.get((panel, segment)) for panel in panels]
                films = [None if part is None else _film(part, name) for part in both]
                sides = _sides([skeleton.layout.panel_ids[panel] for panel in panels], films)
                if sides is None:
                    continue  # two panels without material
                ending = "" if design.span_segments == 1 else f".s{segment + 1}"
                ids = {part.id for part in both if part is not None}
                told = tuple(r for r in worked.remarks if r.part in ids and r.thing == f"film {name}")
                made.append(_sheet(design, f"{name}{ending}", sides, told))
    return tuple(made)


def _film(part: Part, crease: str) -> FilmStrip | None:
    return next((film for film in part.films if film.crease == crease), None)


def _panels(skeleton: Skeleton, crease: int) -> tuple[int, int]:
    """Numbers within its cell of a crease's two panels, the one that is drawn above first."""
    first, opening = NEXT_CREASE.index(crease), CREASES[crease].startswith("open")
    after = (first + 1) % 4
    # Seen from outside, with the crease to the right, the panel that comes first counter-clockwise is above.
    return (first, after) if opening == skeleton.right_handed else (after, first)


def _sides(panels: list[str], films: list[FilmStrip | None]) -> tuple[_Side, _Side] | None:
    """The film on both panels; None where neither has a face for it.

    A side that is not glued is as long as the other: a horn that shortens that one is in its way, too.
    """
    there = [film for film in films if film is not None]
    if not there:
        return None
    glued = [film for film in there if film.glue_from_m is not None] or there
    low, high = min(film.s_low for film in glued), max(film.s_high for film in glued)
    sides = []
    for panel, film in zip(panels, films, strict=True):
        if film is None or film.glue_from_m is None:
            sides.append(_Side(panel, 0.0 if film is None else film.reach, low, high, None))
        else:
            sides.append(_Side(panel, film.reach, film.s_low, film.s_high, film.glue_from_m))
    return sides[0], sides[1]


def _sheet(design: Design, name: str, sides: tuple[_Side, _Side], remarks: tuple[Remark, ...]) -> Sheet:
    above, below = sides
    low, high = min(side.s_low for side in sides), max(side.s_high for side in sides)
    on_cone = isinstance(design.structure, ConeStructure)
    zones = [(above.panel, _zone(above, on_cone)), (below.panel, _mirrored(_zone(below, on_cone)))]
    glue = tuple(GlueZone(panel, _moved(ring, low)) for panel, ring in zones if ring is not None)
    width = (above.reach + below.reach) * (high if on_cone else 1.0)
    fold = np.array([[0.0, 0.0], [high - low, 0.0]])
    return Sheet(name, _moved(_outline(above, below, on_cone), low), fold, glue, high - low, width, remarks)


def _moved(ring: Ring, low: float) -> Ring:
    """A ring drawn with the crease's own `s` along x, moved so that the film begins at 0."""
    return Ring(ring.corners - np.array([low, 0.0]), ring.bulge)


def _zone(side: _Side, on_cone: bool) -> Ring | None:
    """Where a film is glued to the panel above its crease; None where it is not."""
    free = side.glue_from_m
    if free is None:
        return None
    if on_cone:
        return _sector_beyond(side.s_low, side.s_high, free, side.reach)
    corners = [[side.s_low, free], [side.s_high, free], [side.s_high, side.reach], [side.s_low, side.reach]]
    return Ring(np.array(corners), np.zeros(4)) if side.reach > free else None


def _outline(above: _Side, below: _Side, on_cone: bool) -> Ring:
    """Both sides of a film as one, with a step at the crease where they do not begin or end together."""
    over, under = (above.s_low, above.s_high), (below.s_low, below.s_high)
    bends = [float(np.tan(0.25 * side.reach)) if on_cone else 0.0 for side in (above, below)]
    row = [
        (under[0], -below.reach, 0.0), (under[1], -below.reach, bends[1]), (under[1], 0.0, 0.0),
        (over[1], 0.0, bends[0]), (over[1], above.reach, 0.0), (over[0], above.reach, -bends[0]),
        (over[0], 0.0, 0.0), (under[0], 0.0, -bends[1]),
    ]  # fmt: skip
    if over == under:
        whole = float(np.tan(0.25 * (above.reach + below.reach))) if on_cone else 0.0
        row = [row[0], (*row[1][:2], whole), row[4], (*row[5][:2], -whole)]
    s, across, bulge = np.array(row).T
    corners = np.column_stack([s * np.cos(across), s * np.sin(across)] if on_cone else [s, across])
    # Corners that are one, at an apex or where sides begin together, are drawn once.
    apart = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1) > 1e-12
    return Ring(corners[apart], bulge[apart])


def _sector_beyond(r_low: float, r_high: float, free: float, last: float) -> Ring | None:
    """What of the sector up to the angle `last` lies further than `free` from the crease; None where nothing does."""
    if free >= r_high * np.sin(last):
        return None
    ray, meets = np.array([np.cos(last), np.sin(last)]), free / np.sin(last)
    outer = [np.sqrt(r_high**2 - free**2), free]
    bulge = np.tan(0.25 * (last - np.arcsin(free / r_high)))
    if meets >= r_low:
        return Ring(np.array([meets * ray, outer, r_high * ray]), np.array([0.0, bulge, 0.0]))
    inner = [np.sqrt(r_low**2 - free**2), free]
    back = np.tan(0.25 * (last - np.arcsin(free / r_low)))
    corners = np.array([inner, outer, r_high * ray, r_low * ray])
    return Ring(corners, np.array([0.0, bulge, 0.0, -back]))


def _mirrored(ring: Ring | None) -> Ring | None:
    """On the other side of the crease, counter-clockwise again."""
    if ring is None:
        return None
    return Ring(ring.corners[::-1] * [1.0, -1.0], np.roll(ring.bulge[::-1], -1))
