"""Packaging ratio against number of cells with real walls: beyond the paper.

Without a wall every further cell packs better. A wall adds its own thickness to every panel, so eta has a
maximum over the number of cells; further on panels get thicker than they are long, and the row ends.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ori_deploy.design import Embedding, Structure
from ori_deploy.design.continuum import continuum_limit
from ori_deploy.errors import ProfileError
from ori_deploy.figures.packaging import MOST_ITERATIONS, TOLERANCE, Watch, balanced_ring, ring_layout
from ori_deploy.figures.table import Table
from ori_deploy.layout import Layout
from ori_deploy.profiles import Naca4, Profile, Superellipse
from ori_deploy.profiles.profile import Reals
from ori_deploy.search import Failure, Job, Wish, best_first, run_jobs
from ori_deploy.search.many import Result

WALLS = (0.0, 0.0025, 0.005, 0.01, 0.02)
"""Wall thicknesses over the ellipse's longer half-axis, or over the chord."""
STARTS = 4
LEAST_CELLS, MOST_CELLS = 3, 24

_GROWN = 2
"""Starts made of the best structure with one cell less: its largest cells cut in two."""
_ROW_ENDS_AFTER = 2
"""Numbers of cells in a row without any structure at which a wall's row ends."""
_CORNER_RAD = 0.1
"""Turn of the outline at which a closing vertex has to stay there: no panel can be bent round it."""

_BOUNDS = {
    "margin": "dead-centre margin",
    "face": "length of an inner face",
    "raise": "wall offset",
    "opening angle": "opening angle",
    "closing angle": "closing angle",
}
"""What the search calls its bounds, and what people do."""


@dataclass(frozen=True)
class WallPoint:
    """The best structure of so many cells with a real wall.

    Attributes
    ----------
    shape, wall, n_cells
        Which; the wall over the shape's unit of length.
    eta
        NaN where no start led to a structure.
    held_back_by
        Kinds of bounds the best structure sits on; of no structure, the condition that most starts broke.
    """

    shape: str
    wall: float
    n_cells: int
    eta: float
    held_back_by: str


@dataclass(frozen=True)
class WallRow:
    """The points of one shape and wall that have a structure, and how they end.

    Attributes
    ----------
    shape, wall
        Which.
    points
        Those with a structure, by number of cells.
    ended_by
        What the last structure sits on, or, where that is nothing, what more cells break; empty where the row
        goes on beyond what was searched.
    """

    shape: str
    wall: float
    points: tuple[WallPoint, ...]
    ended_by: str

    @property
    def best(self) -> WallPoint | None:
        """The largest eta; None where there is no structure at all."""
        return max(self.points, key=lambda p: p.eta, default=None)


def wall_shapes() -> dict[str, Profile]:
    """The shapes of the figure, each with its unit of length."""
    return {"ellipse 1 x 0.6": Superellipse(1.0, 0.6), "NACA 2412": Naca4("2412", 1.0)}


def wall_points(
    walls: Sequence[float] = WALLS,
    most_cells: int = MOST_CELLS,
    *,
    starts: int = STARTS,
    workers: int = 1,
    watch: Watch | None = None,
) -> tuple[list[WallPoint], bool]:
    """The best packaging ratio against number of cells, wall by wall, until no structure is left.

    Parameters
    ----------
    walls
        Increasing: the best structure of a thinner wall is one more start.

    Returns
    -------
    The points, with those at which a row ended; and whether an interrupt (Ctrl-C) left some out.
    """
    points: list[WallPoint] = []
    for shape, profile in wall_shapes().items():
        thinner: dict[int, Embedding] = {}
        for wall in walls:
            row, thinner, interrupted = _row(shape, profile, wall, most_cells, thinner, (starts, workers), watch)
            points += row
            if interrupted:
                return points, True
    return points, False


def _row(
    shape: str,
    profile: Profile,
    wall: float,
    most_cells: int,
    thinner: dict[int, Embedding],
    effort: tuple[int, int],
    watch: Watch | None,
) -> tuple[list[WallPoint], dict[int, Embedding], bool]:
    starts, workers = effort
    points: list[WallPoint] = []
    found: dict[int, Embedding] = {}
    smaller: Structure | None = None
    for n in range(LEAST_CELLS, most_cells + 1):
        begins = [*_begins(profile, n, starts), *([thinner[n]] if n in thinner else [])]
        begins += [] if smaller is None else grown(smaller, _GROWN)
        jobs = [
            Job(str(n), profile, ring_layout(n), wall, Wish(), begin,
                tolerance=TOLERANCE, most_iterations=MOST_ITERATIONS)
            for begin in begins
        ]  # fmt: skip
        results, interrupted = run_jobs(jobs, workers=min(workers, len(jobs)), watch=watch)
        if interrupted:
            return points, found, True
        points.append(_point(shape, wall, n, results))
        ranked = best_first(results)
        smaller = ranked[0][1].cylinder if ranked else None
        if smaller is not None:
            found[n] = smaller.embedding
        if len(points) >= _ROW_ENDS_AFTER and all(np.isnan(p.eta) for p in points[-_ROW_ENDS_AFTER:]):
            break
    return points, found, False


def _begins(profile: Profile, n: int, starts: int) -> list[int | Embedding]:
    """Starts in which all cells fold alike where that is known, numbered ones elsewhere."""
    try:
        limit = continuum_limit(profile)
    except ProfileError:
        return list(range(starts))
    return [balanced_ring(limit, ring_layout(n), k / starts) for k in range(starts)]


def grown(structure: Structure, most: int) -> list[Embedding]:
    """Rings of one cell more: one of the cells with the most material cut in two, not checked.

    Parameters
    ----------
    structure
        A ring.
    most
        How many of its cells to try.
    """
    e = structure.embedding
    period, n = e.profile.period, e.layout.n_cells
    index = {v.id: i for i, v in enumerate(e.layout.vertices)}
    opening, closing = (np.array([e.s[index[f"{kind}{i + 1}"]] for i in range(n)]) for kind in "OC")
    opening = np.append(opening[0] + (opening - opening[0]) % period, opening[0] + period)
    closing = opening[:-1] + (closing - opening[:-1]) % period
    before, after = e.profile.tangents(closing)
    kept = np.abs(np.angle(after / before)) > _CORNER_RAD
    layout, centre = ring_layout(n + 1), e.z[index["P"]]
    rings = []
    for i in np.argsort(-structure.material_areas, kind="stable")[:most]:
        cut, first, second = _cut(opening[i], closing[i], opening[i + 1], kept=bool(kept[i]))
        rings.append(
            _ring_at(
                e.profile,
                layout,
                np.insert(opening[:-1], i + 1, cut),
                np.concatenate([closing[:i], [first, second], closing[i + 1 :]]),
                centre,
            )
        )
    return rings


def _cut(start: float, middle: float, stop: float, *, kept: bool) -> tuple[float, float, float]:
    """Where a cell is cut on the outline, and the closing vertices of its parts; `kept`: `middle` stays one."""
    if not kept:
        return middle, 0.5 * (start + middle), 0.5 * (middle + stop)
    if middle - start > stop - middle:
        cut = 0.5 * (start + middle)
        return cut, 0.5 * (start + cut), middle
    cut = 0.5 * (middle + stop)
    return cut, middle, 0.5 * (cut + stop)


def _ring_at(profile: Profile, layout: Layout, opening: Reals, closing: Reals, centre: complex) -> Embedding:
    index = {v.id: i for i, v in enumerate(layout.vertices)}
    s = np.full(len(layout.vertices), np.nan)
    for kind, places in (("O", opening), ("C", closing)):
        s[[index[f"{kind}{i + 1}"] for i in range(len(places))]] = places
    z = np.full(len(s), centre, dtype=complex)
    outline = np.isfinite(s)
    z[outline] = profile.point(s[outline])
    return Embedding(profile, layout, s % profile.period, z)


def _point(shape: str, wall: float, n: int, results: Sequence[Result]) -> WallPoint:
    ranked = best_first(results)
    if ranked:
        return WallPoint(shape, wall, n, ranked[0][1].eta, _kinds(ranked[0][1].active))
    told = [r.error for r in results if isinstance(r, Failure)]
    broken = Counter(_kinds([str(e.value if e.value is not None else e.thing)]) for e in told)
    return WallPoint(shape, wall, n, float("nan"), broken.most_common(1)[0][0])


def _kinds(bounds: Sequence[str]) -> str:
    """Bounds without the cells they are of, each once, those met most often first."""
    kinds = Counter(
        _BOUNDS.get(one.split(" of ")[0], one.split(" of ")[0])
        for text in bounds
        for one in text.split(", ")
        if not one.startswith("wall ")  # the wall is what is asked about
    )
    return "; ".join(kind for kind, _ in kinds.most_common())


def wall_rows(points: Sequence[WallPoint]) -> list[WallRow]:
    """The points by shape and wall."""
    rows = []
    for shape, wall in dict.fromkeys((p.shape, p.wall) for p in points):
        own = [p for p in points if (p.shape, p.wall) == (shape, wall)]
        last = max((p.n_cells for p in own if np.isfinite(p.eta)), default=0)
        after = [p for p in own if p.n_cells > last]
        built = tuple(p for p in own if np.isfinite(p.eta))
        held = next((p.held_back_by for p in built if p.n_cells == last), "")
        rows.append(WallRow(shape, wall, built, (held or after[0].held_back_by) if after else ""))
    return rows


def wall_table(points: Sequence[WallPoint]) -> Table:
    """One row per shape, wall and number of cells; eta is empty where there is no structure."""
    best = {(r.shape, r.wall): r.best for r in wall_rows(points)}
    return Table(
        ("shape", "wall", "cells", "eta", "held_back_by", "largest_of_its_wall"),
        [(p.shape, p.wall, p.n_cells, p.eta, p.held_back_by, p == best[p.shape, p.wall]) for p in points],
    )
