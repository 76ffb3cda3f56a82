"""Packaging ratio against number of cells: the paper's Fig. 4c."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ori_deploy.design import Embedding
from ori_deploy.design.continuum import ContinuumLimit, continuum_limit
from ori_deploy.figures.table import Table
from ori_deploy.layout import Layout, make_layout, ring
from ori_deploy.profiles import Superellipse
from ori_deploy.search import Failure, Job, Wish, run_jobs
from ori_deploy.search.many import Result

ASPECTS = (1.0, 0.6, 0.4, 0.2)
"""Of the ellipses of Fig. 4c."""
COUNTS = tuple(range(4, 21))
"""Numbers of cells of Fig. 4c."""
STARTS = 8
TOLERANCE, MOST_ITERATIONS = 1e-7, 60
"""Of the local searches: what is finer than a marker is not seen."""

_MARGIN_RAD = 0.002
"""Dead-centre margin, next to nothing: the paper knows none."""
_OFF_CENTRE = 0.3
"""Share of the half-axes by which the inner vertex stands off the middle in every fourth start: flat ellipses
pack best without symmetry, and a search that begins with it keeps it."""
_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
_SAME = 1e-6
"""Relative difference in eta below which two searches found the same maximum."""

Watch = Callable[[Result], None]
"""Told of every local search as it ends; may raise KeyboardInterrupt to stop."""


@dataclass(frozen=True)
class PackagingPoint:
    """What one local search of Fig. 4c came to.

    Attributes
    ----------
    aspect, n_cells, start
        Which search.
    eta
        Packaging ratio; NaN where the search led nowhere.
    variation
        Coefficient of variation of the cells' folded areas; NaN likewise.
    limit
        Equation (8): `n_cells` times the efficiency per cell.
    settled
        Whether the search came to rest at a local maximum.
    best
        Whether it is the largest of its aspect and number of cells, or as large.
    """

    aspect: float
    n_cells: int
    start: int
    eta: float
    variation: float
    limit: float
    settled: bool
    best: bool


def ring_layout(n: int) -> Layout:
    """A ring of `n` cells."""
    vertices, cells = ring(n)
    return make_layout(vertices, cells, [("P", "O1")])


def balanced_ring(limit: ContinuumLimit, layout: Layout, share: float) -> Embedding:
    """A ring whose cells fold to equal areas in the limit of many cells: close to an optimum.

    Parameters
    ----------
    limit
        Equation (8) on the profile.
    layout
        A ring.
    share
        Part of a cell by which all are turned on.
    """
    n = layout.n_cells
    index = {v.id: i for i, v in enumerate(layout.vertices)}
    openings = limit.best_openings(n, share)
    closings = limit.best_closings(openings)
    s = np.full(len(layout.vertices), np.nan)
    s[[index[f"O{i + 1}"] for i in range(n)]] = openings
    s[[index[f"C{i + 1}"] for i in range(n)]] = closings
    z = np.full(len(s), limit.center, dtype=complex)
    outline = np.isfinite(s)
    z[outline] = limit.profile.point(s[outline])
    return Embedding(limit.profile, layout, s % limit.profile.period, z)


def packaging_points(
    aspects: Sequence[float] = ASPECTS,
    counts: Sequence[int] = COUNTS,
    *,
    starts: int = STARTS,
    workers: int = 1,
    watch: Watch | None = None,
) -> tuple[list[PackagingPoint], bool]:
    """Local maxima of the packaging ratio on elliptic cylinders without walls: the paper's Fig. 4c.

    Returns
    -------
    One point per local search that ended, in the order of aspects, counts and starts; and whether an
    interrupt (Ctrl-C) left some out.
    """
    limits = {aspect: [_seen_from(aspect, start) for start in range(starts)] for aspect in aspects}
    jobs: dict[str, tuple[float, int, int, Job]] = {}
    for aspect in aspects:
        for n in counts:
            layout = ring_layout(n)
            for start in range(starts):
                name = f"{aspect}/{n}/{start}"
                limit = limits[aspect][start]
                begin = balanced_ring(limit, layout, start / starts)
                wish = Wish(margin_rad=_MARGIN_RAD)
                job = Job(
                    name, limit.profile, layout, 0.0, wish, begin,
                    tolerance=TOLERANCE, most_iterations=MOST_ITERATIONS,
                )  # fmt: skip
                jobs[name] = (aspect, n, start, job)
    results, interrupted = run_jobs([job for *_, job in jobs.values()], workers=workers, watch=watch)
    ended = {(r.job if isinstance(r, Failure) else r[0]).name: r for r in results}
    best: dict[tuple[float, int], float] = {}
    for name, (aspect, n, _, _) in jobs.items():
        best[aspect, n] = max(best.get((aspect, n), -np.inf), _eta(ended.get(name)))
    return [
        _point(aspect, n, start, ended[name], limits[aspect][0].eta_per_cell, best[aspect, n])
        for name, (aspect, n, start, _) in jobs.items()
        if name in ended
    ], interrupted


def _seen_from(aspect: float, start: int) -> ContinuumLimit:
    """The continuum limit about the inner vertex that a start begins with."""
    profile = Superellipse(1.0, aspect)
    if start % 4 != 3:
        return continuum_limit(profile)
    away = _OFF_CENTRE * np.exp(1j * _GOLDEN_ANGLE * start)
    return continuum_limit(profile, complex(away.real, aspect * away.imag))


def _eta(result: Result | None) -> float:
    return -np.inf if result is None or isinstance(result, Failure) else result[1].eta


def _point(aspect: float, n: int, start: int, result: Result, per_cell: float, best: float) -> PackagingPoint:
    if isinstance(result, Failure):
        return PackagingPoint(aspect, n, start, np.nan, np.nan, n * per_cell, settled=False, best=False)
    found = result[1]
    areas = found.structure.material_areas
    variation = float(areas.std() / areas.mean())
    return PackagingPoint(
        aspect, n, start, found.eta, variation, n * per_cell,
        settled=found.settled, best=bool(found.eta >= best * (1.0 - _SAME)),
    )  # fmt: skip


def packaging_table(points: Sequence[PackagingPoint]) -> Table:
    """One row per local search."""
    columns = ("aspect", "cells", "start", "eta", "area_variation", "limit_eta", "settled", "best")
    return Table(
        columns,
        [(p.aspect, p.n_cells, p.start, p.eta, p.variation, p.limit, p.settled, p.best) for p in points],
    )
