"""Films of the creases, laid flat: what to cut, where it folds, where it is glued to which panel.

A film lies over its crease in the recesses of both panels (`recesses`): on a cylinder a rectangle as long as the
span, or as a segment of it; on a cone a sector between two radii, because everything there narrows towards the apex.
Along the crease it stays free over a length in proportion to its thickness, and is glued beyond. A sheet is drawn as
seen on the finished structure, from outside for opening creases and from inside the cell for closing ones, with the
crease along x from the beginning of the span.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ori_deploy.design import ConeStructure
from ori_deploy.export.parts_spec import PartsSpec
from ori_deploy.export.recesses import film_row
from ori_deploy.export.rulings import Rulings, panel_shape, s_range
from ori_deploy.export.skeleton import Skeleton
from ori_deploy.export.workpiece import Remark
from ori_deploy.files import Design
from ori_deploy.motion import CREASES, NEXT_CREASE
from ori_deploy.profiles.profile import Reals

FREE_THICKNESSES = 20.0
"""Free length across a crease over the film's thickness: folded shut it is stretched by pi / 40, or 8 %, outside."""


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
        Its zones, the upper one first; one of them is missing where its panel has too narrow a face.
    length_m
        Of the crease.
    width_m
        Across it, at the wider end.
    remarks
        Panels whose face beside the crease is too narrow to glue it to.
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
    """A film on one panel: how far across it reaches from the crease; metres, on a cone radians."""

    panel: str
    reach: float


def sheets_of(design: Design, spec: PartsSpec) -> tuple[Sheet, ...]:
    """The films of all creases, those of every span segment apart."""
    skeleton = Skeleton(design)
    low, high = s_range(design.structure, design.span_m, design.r_min_m)
    made = []
    for cell, names in enumerate(skeleton.crease_names):
        for crease, name in enumerate(names):
            sides = _sides(skeleton, cell, crease, 1e-3 * spec.film.glue_mm, 1e-3 * spec.print.chord_mm)
            if not any(side.reach > 0.0 for side in sides):
                continue  # two panels without material
            for ending, start, stop in _segments(design, low, high, 1e-3 * spec.clearance.segment_mm):
                made.append(_sheet(design, f"{name}{ending}", sides, start, stop, 1e-6 * spec.film.thickness_um))
    return tuple(made)


def _segments(design: Design, low: float, high: float, gap_m: float) -> list[tuple[str, float, float]]:
    """Ending of the id, beginning and end of every span segment, with clearance at the cuts."""
    n = design.span_segments
    if n == 1:
        return [("", low, high)]
    cuts = np.linspace(low, high, n + 1)
    starts, stops = cuts[:-1] + gap_m * (np.arange(n) > 0), cuts[1:] - gap_m * (np.arange(n) < n - 1)
    return [(f".s{k + 1}", float(a), float(b)) for k, (a, b) in enumerate(zip(starts, stops, strict=True))]


def _sides(skeleton: Skeleton, cell: int, crease: int, glue_m: float, chord_m: float) -> tuple[_Side, _Side]:
    """The film on both panels of a crease, the one that is drawn above first; it reaches 0 without a face for it."""
    structure, unit = skeleton.design.structure, skeleton.design.unit_m
    first, opening = NEXT_CREASE.index(crease), CREASES[crease].startswith("open")
    sides = []
    for k in (first, (first + 1) % 4):
        panel = 4 * cell + k
        shape = panel_shape(structure, panel, chord_m / unit)
        far = skeleton.design.r_max_m
        strip = None if shape is None else film_row(shape, opening, glue_m, far)[0]
        reach = 0.0 if strip is None else _reach(strip, isinstance(structure, ConeStructure))
        sides.append(_Side(skeleton.layout.panel_ids[panel], reach))
    # Seen from outside, with the crease to the right, the panel that comes first counter-clockwise is above.
    above_first = opening == skeleton.right_handed
    return (sides[0], sides[1]) if above_first else (sides[1], sides[0])


def _reach(strip: Rulings, on_cone: bool) -> float:
    if not on_cone:
        return float(strip.widths(0.0).sum())
    ray, after = strip.direction[:-1], strip.direction[1:]
    sine = np.linalg.norm(np.cross(ray, after), axis=1)
    return float(np.arctan2(sine, (ray * after).sum(axis=1)).sum())


def _sheet(design: Design, name: str, sides: tuple[_Side, _Side], low: float, high: float, thick_m: float) -> Sheet:
    above, below = sides
    free, length = 0.5 * FREE_THICKNESSES * thick_m, high - low
    on_cone = isinstance(design.structure, ConeStructure)
    zone = partial(_sector_beyond, low, high) if on_cone else partial(_band_beyond, length)
    zones = [(above.panel, zone(free, above.reach)), (below.panel, _mirrored(zone(free, below.reach)))]
    cut = _sector(low, high, -below.reach, above.reach) if on_cone else _band(length, -below.reach, above.reach)
    width = (above.reach + below.reach) * (high if on_cone else 1.0)
    fold = np.array([[0.0, 0.0], [length, 0.0]])
    glue = tuple(GlueZone(panel, ring) for panel, ring in zones if ring is not None)
    narrow = [side for side, (_, ring) in zip(sides, zones, strict=True) if ring is None]
    remarks = tuple(_too_narrow(name, side, side.reach * (high if on_cone else 1.0), free) for side in narrow)
    return Sheet(name, cut, fold, glue, length, width, remarks)


def _too_narrow(name: str, side: _Side, found_m: float, free_m: float) -> Remark:
    return Remark(
        side.panel,
        f"glue of film {name}",
        f"{1e3 * found_m:.2f} mm of face",
        f"more than {1e3 * free_m:.2g} mm, where it has to be free to bend",
        "a thinner film, or vertices further apart",
    )


def _band(length: float, low: float, high: float) -> Ring:
    """A rectangle along the crease, from `low` to `high` across it."""
    return Ring(np.array([[0.0, low], [length, low], [length, high], [0.0, high]]), np.zeros(4))


def _sector(r_low: float, r_high: float, first: float, last: float) -> Ring:
    """What lies between two radii and two angles about the apex at (-r_low, 0)."""
    arc = np.tan(0.25 * (last - first))
    rays = np.array([[np.cos(a), np.sin(a)] for a in (first, last)])
    if r_low == 0.0:
        return Ring(np.vstack([[[0.0, 0.0]], r_high * rays]), np.array([0.0, arc, 0.0]))
    corners = np.vstack([r_low * rays[0], r_high * rays, r_low * rays[1]]) - [r_low, 0.0]
    return Ring(corners, np.array([0.0, arc, 0.0, -arc]))


def _band_beyond(length: float, free: float, reach: float) -> Ring | None:
    """What of the film lies further than `free` from the crease; None where nothing does."""
    return _band(length, free, reach) if reach > free else None


def _sector_beyond(r_low: float, r_high: float, free: float, last: float) -> Ring | None:
    """What of the sector up to the angle `last` lies further than `free` from the crease; None where nothing does."""
    if free >= r_high * np.sin(last):
        return None
    ray, meets = np.array([np.cos(last), np.sin(last)]), free / np.sin(last)
    outer = [np.sqrt(r_high**2 - free**2), free]
    bulge = np.tan(0.25 * (last - np.arcsin(free / r_high)))
    if meets >= r_low:
        return Ring(np.array([meets * ray, outer, r_high * ray]) - [r_low, 0.0], np.array([0.0, bulge, 0.0]))
    inner = [np.sqrt(r_low**2 - free**2), free]
    back = np.tan(0.25 * (last - np.arcsin(free / r_low)))
    corners = np.array([inner, outer, r_high * ray, r_low * ray]) - [r_low, 0.0]
    return Ring(corners, np.array([0.0, bulge, 0.0, -back]))


def _mirrored(ring: Ring | None) -> Ring | None:
    """On the other side of the crease, counter-clockwise again."""
    if ring is None:
        return None
    return Ring(ring.corners[::-1] * [1.0, -1.0], np.roll(ring.bulge[::-1], -1))
