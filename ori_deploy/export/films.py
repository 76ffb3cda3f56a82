"""Films on panels: how far each is let in and glued, as thick as the panel is once its clearance is off.

A recess begins below the finished face and leaves `film.floor_mm` of panel under it. At a crease where the panel runs
out to a thin edge it begins only where that much is left; the film is glued from there on. A thin edge within the
film's free length is taken off, and so is any on an inner face: film over it would hold the two panels apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ori_deploy.export.kernel import Body, Triangles, depths, joined, slab, surface
from ori_deploy.export.parts_spec import ClearanceSpec, FilmSpec, PartsSpec
from ori_deploy.export.recesses import beyond, creases_of, film_face, film_row, middle
from ori_deploy.export.rulings import Rulings
from ori_deploy.export.workpiece import FilmStrip, Workpiece
from ori_deploy.layout import Layout
from ori_deploy.motion import CREASES
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors

Marks = NDArray[np.bool_]

FREE_THICKNESSES = 20.0
"""Free length across a crease over the film's thickness: folded shut it is stretched by pi / 40, or 8 %, outside."""

_STEP = 5e-5
"""Distance, metres, between places across a strip at which the panel's thickness is looked at."""
_FINER = 57
"""Places between two such where it begins to be thick enough."""
_ROWS = 25
"""Places along a cone's span at which it is looked at; on a cylinder they are all alike."""
_INSET = 1e-6
"""How far from a strip's ends, metres, the outermost places are; and below a face, to see whether there is any."""
_KEPT = 1e-7
"""How much less than the floor, metres, may be left: rounding."""
_CRUMB = 1e-6
"""Part of what lies under a film below which a piece that is missing of it is rounding."""
_ALL = 1.05
"""How much deeper than the floor, as a part of it, a thin edge is taken off, so that no crumb of it is left."""
_BROAD = 0.9
"""Part of the wished width that a strip on a cone's broad facet has, at least."""
_AT_END = 1e-4
"""How near the end of a film, metres, something is that shortens it."""


def free_m(spec: FilmSpec) -> float:
    """How far from the crease a film stays free on either side."""
    return 0.5 * FREE_THICKNESSES * 1e-6 * spec.thickness_um


@dataclass(frozen=True)
class _Strip:
    """The surface beside a crease: lines that begin at the crease, and how far the finished face lies below it."""

    row: Rulings
    even: bool
    clear_m: float

    @property
    def outwards(self) -> Rulings:
        """Counter-clockwise round the panel, as `slab` wants it."""
        return self.row.reversed() if self.even else self.row

    def width(self, s: float) -> float:
        return float(self.row.widths(s).sum())

    def places(self, s: float, x: Reals) -> tuple[Vectors, Vectors]:
        """(n, 3) places at distances (n,) from the crease, and normals out of the panel."""
        wide, points = self.row.widths(s), self.row.at(s)
        along = np.append(0.0, np.cumsum(wide))
        k = np.clip(np.searchsorted(along, x, side="right") - 1, 0, len(wide) - 1)
        share = ((x - along[k]) / wide[k])[:, None]
        normal = self.row.normals(s)[k] * (-1.0 if self.even else 1.0)
        return points[k] + share * (points[k + 1] - points[k]), normal

    def fence(self, x: float, s_low: float, s_high: float) -> tuple[Vectors, float]:
        """The plane upright on the surface along a line at a distance from the crease: normal, away, and offset."""
        (a,), (up,) = self.places(s_low, np.array([x]))
        (b,), (there,) = self.places(s_high, np.array([x]))
        away = np.cross(b - a, up + there)
        away /= np.linalg.norm(away)
        if float(away @ (a - self.row.at(s_low)[0])) < 0.0:
            away = -away
        return away, float(away @ a)

    def narrowed(self, width: float, s: float) -> _Strip:
        return replace(self, row=self.row.first(width, s))


@dataclass(frozen=True)
class _Room:
    """Where a strip may be let in: between a distance from the crease and a part of its width, from a place along it.

    Attributes
    ----------
    start_m, share, s_low
        Those.
    rest
        What lies between crease and `start_m`: nothing, an edge that is too thin all over, or some of both.
    """

    start_m: float
    share: float
    s_low: float
    rest: str


@dataclass(frozen=True)
class LetIn:
    """A film that is let in: which of a panel's, its strip and the panel right under it."""

    number: int
    strip: _Strip
    under: Body


def measure_films(piece: Workpiece, spec: FilmSpec, layout: Layout) -> None:
    """Note what both films of a panel cover, whether or not they are let in."""
    cell = layout.cell_ids[piece.shape.panel // 4]
    for number, opening in zip(creases_of(piece.shape.panel), (True, False), strict=True):
        row, _ = film_row(piece.shape, opening, 1e-3 * spec.glue_mm, piece.s_high)
        if row is None:
            continue
        at = piece.placed(middle(row, piece))
        width, length = float(row.widths(piece.s_high).sum()), piece.s_high - piece.s_low
        shape = 0.5 * (1.0 + piece.s_low / piece.s_high) if piece.shape.on_cone else 1.0
        strip = FilmStrip(f"{cell}.{CREASES[number]}", width, length, shape * width * length, at, 0.0)
        piece.films.append(_ended(piece, strip, row, piece.s_low, piece.s_high))


def _ended(piece: Workpiece, strip: FilmStrip, row: Rulings, s_low: float, s_high: float) -> FilmStrip:
    """A strip that ends where a row of facets does, and as far along it as told."""
    reach = _angle(row) if piece.shape.on_cone else float(row.widths(s_high).sum())
    return replace(strip, reach=reach, s_low=s_low, s_high=s_high)


def _angle(row: Rulings) -> float:
    """What a row of rays takes of a cone laid flat, radians."""
    ray, after = row.direction[:-1], row.direction[1:]
    sine = np.linalg.norm(np.cross(ray, after), axis=1)
    return float(np.arctan2(sine, (ray * after).sum(axis=1)).sum())


def let_in_films(piece: Workpiece, pieces: Mapping[int, Workpiece], spec: PartsSpec, layout: Layout) -> list[LetIn]:
    """Cut the recesses for both films of a panel; what is narrower than wished, or does not fit, is told.

    Parameters
    ----------
    pieces
        All of its segment, by panel.
    """
    cell, panel = layout.cell_ids[piece.shape.panel // 4], piece.shape.panel
    made = []
    for number, opening in zip(creases_of(panel), (True, False), strict=True):
        name, by_hand = f"{cell}.{CREASES[number]}", ""
        row, width = film_row(piece.shape, opening, 1e-3 * spec.film.glue_mm, piece.s_high)
        if opening and not layout.is_slit[panel]:
            by_hand = _by_hand(pieces.get(int(layout.neighbour[panel])), width, free_m(spec.film))
        if row is None or min(width, 1e-3 * spec.film.glue_mm) <= free_m(spec.film):
            _too_narrow(piece, spec.film, name, width, by_hand)
            continue
        even = panel % 2 == 0
        clear_m = _cleared(piece, opening, spec.clearance, bool(layout.is_slit[panel]))
        strip = _Strip(row.reversed() if even else row, even, clear_m)
        found = _let_in(piece, spec.film, name, strip, opening, by_hand)
        made += [] if found is None else [found]
    return made


def _by_hand(neighbour: Workpiece | None, width_m: float, free: float) -> str:
    """A remedy where the outline goes on over a bonded neighbour: the two move as one."""
    skin = None if neighbour is None else neighbour.shape.face("skin", neighbour.s_high)
    if neighbour is None or skin is None or width_m + float(skin.rulings.widths(neighbour.s_high).sum()) <= free:
        return ""
    return f"a film cut wider and glued over the bonded neighbour {neighbour.id} by hand, "


def _cleared(piece: Workpiece, opening: bool, spec: ClearanceSpec, is_slit: bool) -> float:
    """How far below the design's face the finished one lies, metres."""
    face = film_face(piece.shape, opening, piece.s_high)
    named = {"inner": spec.inner_mm, "back": spec.slit_mm if is_slit else spec.bond_mm}
    return 0.0 if face is None else 1e-3 * named.get(face.kind, 0.0)


def _too_narrow(piece: Workpiece, spec: FilmSpec, name: str, width: float, by_hand: str) -> None:
    """Say that a panel's face, or all that may be glued of it, is no more than has to stay free."""
    if width > 1e-3 * spec.glue_mm:
        by_hand = "a thinner film, a larger film.glue_mm, "
    _left_out(piece, spec, name, f"{min(1e3 * width, spec.glue_mm):.2f} mm to glue to", by_hand)


def _left_out(piece: Workpiece, spec: FilmSpec, name: str, value: str, by_hand: str) -> None:
    """Say that a crease has no film hinge on a panel, and what can be done."""
    piece.remark(
        f"film {name}",
        value,
        f"more than {1e3 * free_m(spec):.2g} mm, where it has to be free to bend, with "
        f"{1e-3 * spec.thickness_um + spec.floor_mm:.2g} mm of panel: film and film.floor_mm",
        f"{by_hand}a thicker wall_m in the specification, or another layout",
    )


def _let_in(piece: Workpiece, spec: FilmSpec, name: str, strip: _Strip, opening: bool, by_hand: str) -> LetIn | None:
    """Cut one film's recess as far as there is panel under it."""
    free, depth, floor = free_m(spec), 1e-6 * spec.thickness_um, 1e-3 * spec.floor_mm
    high, room = _range(piece)[1], _room(piece, strip, spec)
    if room is None:
        value = f"{_thickest(piece, strip, free):.2f} mm of panel at most, from {1e3 * free:.2g} mm off the crease on"
        _left_out(piece, spec, name, value, by_hand)
        return None
    start = max(room.start_m, free)
    is_edge = room.rest == "edge" and (room.start_m <= free or not opening)
    kept = strip.narrowed(room.share * strip.width(piece.s_high), piece.s_high)
    tool = _tool(piece, kept, room, depth, _ALL * floor if is_edge else 0.0)
    row = kept.outwards
    if not piece.cut(tool, "film", f"film {name}", middle(row, piece)):
        return None
    number = next(k for k, film in enumerate(piece.films) if film.crease == name)
    piece.films[number] = replace(_ended(piece, piece.films[number], row, room.s_low, high), glue_from_m=start)
    _tell(piece, spec, name, (strip, kept), room, is_edge)
    return LetIn(number, kept, _under(piece, kept, replace(room, start_m=start), depth, floor))


def _tool(piece: Workpiece, kept: _Strip, room: _Room, depth: float, edge: float) -> Body:
    """What a film's recess takes off: its own depth, and a thin edge that much deeper, where `edge` is not 0."""
    below, (low, high) = kept.clear_m + depth, _beyond(piece, room)
    tool = slab(kept.outwards, below, max(below, 1e-4), low, high)
    if room.rest == "nothing":
        return tool
    normal, off = _fence(piece, kept, room)
    if edge == 0.0:
        return tool.trim_by_plane(normal, off)
    return joined([tool, slab(kept.outwards, below + edge, max(below, 1e-4), low, high).trim_by_plane(-normal, -off)])


def _under(piece: Workpiece, kept: _Strip, room: _Room, depth: float, floor: float) -> Body:
    """A layer within the panel under where a film is glued; it shares no face with the panel but at the ends."""
    inner = kept.narrowed(0.99 * kept.width(piece.s_high), piece.s_high)
    below = kept.clear_m + depth
    layer = slab(inner.outwards, below + 0.75 * floor, -below - 0.25 * floor, *_beyond(piece, room))
    return layer.trim_by_plane(*_fence(piece, kept, room)) ^ piece.body


def _beyond(piece: Workpiece, room: _Room) -> tuple[float, float]:
    """From where a recess begins to beyond the part's end, and beyond its beginning where it begins there."""
    low, high = beyond(piece)
    return (room.s_low if room.s_low > _range(piece)[0] else low), high


def _fence(piece: Workpiece, kept: _Strip, room: _Room) -> tuple[Vectors, float]:
    """The plane from which on a film is let in; on a cone it stands where the strip is that wide."""
    high = _range(piece)[1]
    wide = kept.width(room.s_low)
    # Only a cone's strip is narrower somewhere: in proportion to the distance from the apex.
    first = room.s_low if wide >= room.start_m else high * room.start_m / kept.width(high)
    return kept.fence(room.start_m, first, high)


def _tell(
    piece: Workpiece, spec: FilmSpec, name: str, strips: tuple[_Strip, _Strip], room: _Room, is_edge: bool
) -> None:
    """Say where a film is let in over less than wished: of the strip that it could have had, only so much."""
    free, glue, (low, high) = free_m(spec), 1e-3 * spec.glue_mm, _range(piece)
    wished, end = (strip.width(high) for strip in strips)
    # Chords of a cone's broad facets are a little shorter than what was asked for.
    is_whole = room.share == 1.0 and wished >= _BROAD * glue
    if room.start_m <= free and is_whole and room.s_low <= low:
        return
    outer = f" at {1e3 * piece.s_high:.0f} mm from the apex" if piece.shape.on_cone else ""
    found = f"glued from {1e3 * max(free, room.start_m):.2f} to {1e3 * end:.2f} mm from the crease{outer}"
    if room.start_m > free:
        edge = "taken off" if is_edge else "not let in"
        found += f", {1e3 * room.start_m:.2f} mm of it unsupported and its thin edge {edge}"
    if room.s_low > low:
        found += f", only from {1e3 * room.s_low:.0f} mm on, too thin nearer the apex"
    narrow = "a smaller film.glue_mm, vertices further apart"
    thin = "a thinner film, a smaller film.floor_mm"
    piece.remark(
        f"film {name}",
        found,
        f"from {1e3 * free:.2g} to {spec.glue_mm:g} mm over {spec.floor_mm:g} mm of panel",
        f"{thin if room.start_m > free or room.s_low > low else narrow}, or a thicker wall_m in the specification",
        left_out=False,
    )


def _range(piece: Workpiece) -> tuple[float, float]:
    """Where along its lines a part begins and ends: a cylinder's segment without its clearance."""
    if piece.shape.on_cone:
        return piece.s_low, piece.s_high
    box = piece.body.bounding_box()
    return max(piece.s_low, float(box[2])), min(piece.s_high, float(box[5]))


def _room(piece: Workpiece, strip: _Strip, spec: FilmSpec) -> _Room | None:
    """Where a strip may be let in so that the floor is kept: where most of it can be glued, or nowhere."""
    free, depth, floor = free_m(spec), 1e-6 * spec.thickness_um, 1e-3 * spec.floor_mm
    low, high = _range(piece)
    edge = 1e-3 * (high - low)
    rows = np.linspace(low + edge, high - edge, _ROWS) if piece.shape.on_cone else np.array([0.5 * (low + high)])
    share = _shares(strip.width(piece.s_high))
    seen = [_left(piece, strip, float(s), share, depth) for s in rows]
    fits = np.array([left >= floor - _KEPT for left, _ in seen])
    some = np.array([there for _, there in seen])
    best: tuple[float, _Room | None] = 0.0, None
    first, last = np.zeros(len(rows)), np.zeros(len(rows), dtype=int)
    for i in reversed(range(len(rows))):
        start, last[i] = _longest(fits[i], int((share * strip.width(float(rows[i])) < free).sum()))
        if last[i] <= start:
            break
        first[i] = share[start] * strip.width(float(rows[i])) if start > 0 else 0.0
        begin, end = float(first[i:].max()), int(last[i:].min())
        # What is no panel any more beyond the end is no reason to end there.
        whole = not some[i:, end + 1 :].any()
        upto = 1.0 if whole else float(share[end])
        wide = np.array([upto * strip.width(float(s)) - max(begin, free) for s in rows[i:]])
        area = float(np.maximum(wide, 0.0).sum())
        if area > best[0]:
            s_low = low if i == 0 else float(rows[i])
            best = area, _Room(begin, upto, s_low, _before(strip, rows[i:], share, begin, some[i:], fits[i:]))
    return None if best[1] is None else _sharper(piece, strip, best[1], first, rows, (depth, floor))


def _sharper(
    piece: Workpiece, strip: _Strip, room: _Room, first: Reals, rows: Reals, layers: tuple[float, float]
) -> _Room:
    """A place whose beginning is looked at once more, between the last place that did not fit and the first that did.

    Parameters
    ----------
    first
        (n,) where each row may begin.
    layers
        Depth of the recess, and of the floor under it.
    """
    begin, rest = 0.0, room.rest
    count = len(_shares(strip.width(piece.s_high))) - 1
    for at in sorted(np.flatnonzero(rows >= room.s_low), key=lambda k: -first[k]):
        if first[at] <= begin:
            break  # rows from here on begin nearer to the crease
        width = strip.width(float(rows[at]))
        x = np.linspace(max(first[at] - 1.1 * width / count, 0.0), first[at], _FINER)
        left, some = _left(piece, strip, float(rows[at]), x / width, layers[0])
        thin = left < layers[1] - _KEPT
        begin = max(begin, float(x[min(int(np.flatnonzero(thin).max(initial=-1)) + 1, _FINER - 1)]))
        rest = "edge" if rest == "nothing" and (thin & some).any() else rest
    return replace(room, start_m=begin, rest=rest)


def _before(strip: _Strip, rows: Reals, share: Reals, begin: float, some: Marks, fits: Marks) -> str:
    """What lies between the crease and where the recess may begin."""
    near = np.array([share * strip.width(float(s)) < begin * (1.0 - 1e-12) for s in rows])
    if not (near & some).any():
        return "nothing"
    return "both" if len(rows) == 1 and (near & fits).any() else "edge"


def _shares(width: float) -> Reals:
    """(n,) places across a strip, as parts of its width there."""
    inset = min(_INSET / width, 0.25)
    count = int(np.clip(np.ceil(width / _STEP), 8, 400))
    return np.linspace(inset, 1.0 - inset, count + 1)


def _left(piece: Workpiece, strip: _Strip, s: float, share: Reals, depth: float) -> tuple[Reals, Marks]:
    """(n,) how thick the panel would be under a recess, and (n,) whether there is any before."""
    at, out = strip.places(s, share * strip.width(s))
    points, triangles = _crossed(piece, strip, s)
    if not len(triangles):  # near an apex clearance takes all of the panel
        return np.zeros(len(share)), np.zeros(len(share), dtype=bool)
    left = depths(points, triangles, at - (strip.clear_m + depth) * out, -out)
    there = depths(points, triangles, at - (strip.clear_m + _INSET) * out, -out)
    return left, there > 0.0


def _crossed(piece: Workpiece, strip: _Strip, s: float) -> tuple[Vectors, Triangles]:
    """A part's surface, only those triangles that a plane across the crease meets."""
    points, triangles = surface(piece.body)
    along = strip.row.direction[0]
    height = (points - strip.row.at(s)[0]) @ along
    slack = 1e-3 * float(np.ptp(height))
    near = height[triangles]
    kept = (near.min(axis=1) <= slack) & (near.max(axis=1) >= -slack)
    return points, triangles[kept]


def _thickest(piece: Workpiece, strip: _Strip, free: float) -> float:
    """The most panel there is under a strip beyond its free length, near its end, millimetres."""
    low, high = _range(piece)
    s = high - 1e-3 * (high - low)
    share = _shares(strip.width(s))
    return 1e3 * float(_left(piece, strip, s, share[share * strip.width(s) >= free], 0.0)[0].max(initial=0.0))


def _longest(fits: Marks, counted: int) -> tuple[int, int]:
    """First and last place of the run that fits and is longest, counted from a place on; twice the same for none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], fits, [False]]).astype(int))).reshape(-1, 2)
    if not len(edges):
        return 0, 0
    long = edges[:, 1] - np.maximum(edges[:, 0], counted)
    start, stop = edges[int(np.argmax(long))]
    return int(start), int(stop) - 1


def shorten_films(piece: Workpiece, films: list[LetIn]) -> None:
    """Let films end where something else was cut out under them since, as horns are at the end of the span."""
    for film in films:
        strip = piece.films[film.number]
        low, high = strip.s_low, strip.s_high
        total = float(film.under.volume())
        gone = [part for part in (film.under - piece.body).decompose() if float(part.volume()) > _CRUMB * total]
        spans = sorted(_span(piece, part) for part in gone)
        for first, last in spans:
            low = max(low, last) if first <= low + _AT_END else low
        for first, last in reversed(spans):
            high = min(high, first) if last >= high - _AT_END else high
        if (low, high) != (strip.s_low, strip.s_high) and low < high:
            piece.films[film.number] = _ended(piece, strip, film.strip.row, low, high)
        inside = [first for first, last in spans if first < high and last > low]
        if low >= high or inside:
            piece.remark(
                f"film {strip.crease}",
                f"another pocket under it, {1e3 * (inside[0] if inside else low):.0f} mm along the span",
                "none under a film, but at its ends",
                "smaller or thinner horns, hinges or magnets",
                left_out=False,
            )


def _span(piece: Workpiece, part: Body) -> tuple[float, float]:
    """Where along the lines a shape begins and ends."""
    points = surface(part)[0]
    s = np.linalg.norm(points, axis=1) if piece.shape.on_cone else points[:, 2]
    return float(s.min()), float(s.max())
