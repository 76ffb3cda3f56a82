"""The optimised ellipses of the paper's Fig. 4a."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ori_deploy.design import Structure
from ori_deploy.design.continuum import continuum_limit
from ori_deploy.errors import CellError
from ori_deploy.figures.packaging import Watch, balanced_ring, ring_layout
from ori_deploy.figures.table import Table, Value
from ori_deploy.motion.slits import with_free_slits
from ori_deploy.profiles import Superellipse
from ori_deploy.search import Failure, Job, Wish, best_first, run_jobs

ELLIPSE = (1.0, 0.6)
"""Half-axes of the ellipse of eccentricity 0.8, metres."""
PAPER_ETA = {4: 4.2, 6: 6.4}
"""Numbers of cells of Fig. 4a, and the packaging ratios that the paper gives for them."""
STARTS = 4
_MARGIN_RAD = 0.002
"""Dead-centre margin, next to nothing: the paper knows none."""


@dataclass(frozen=True)
class Optimum:
    """The best ring of so many cells on the ellipse, without walls.

    Attributes
    ----------
    n_cells
        How many.
    structure
        With slits that let it deploy without touching.
    paper_eta
        What the paper gives for it.
    """

    n_cells: int
    structure: Structure
    paper_eta: float


def optimum(n_cells: int, *, starts: int = STARTS, workers: int = 1, watch: Watch | None = None) -> Optimum:
    """The best ring of `n_cells` on the ellipse, one of `PAPER_ETA`.

    Raises
    ------
    CellError
        No start led anywhere.
    KeyboardInterrupt
        Interrupted before all starts were searched.
    """
    limit = continuum_limit(Superellipse(*ELLIPSE))
    layout = ring_layout(n_cells)
    wish = Wish(margin_rad=_MARGIN_RAD)
    jobs = [
        Job(f"{n_cells} cells", limit.profile, layout, 0.0, wish, balanced_ring(limit, layout, k / starts))
        for k in range(starts)
    ]
    results, interrupted = run_jobs(jobs, workers=workers, watch=watch)
    if interrupted:
        raise KeyboardInterrupt
    ranked = best_first(results)
    if not ranked:
        told = next(r.error for r in results if isinstance(r, Failure))
        raise CellError(told.thing, value=told.value, limit=told.limit, remedy=told.remedy)
    return Optimum(n_cells, with_free_slits(ranked[0][1].cylinder), PAPER_ETA[n_cells])


def optimum_table(optima: Sequence[Optimum]) -> Table:
    """One row per vertex."""
    rows: list[tuple[Value, ...]] = []
    for o in optima:
        places = o.structure.embedding.z
        for v, z in zip(o.structure.layout.vertices, places, strict=True):
            eta = float(o.structure.eta)
            rows.append((o.n_cells, eta, o.paper_eta, v.id, v.role, v.inner, float(z.real), float(z.imag)))
    return Table(("cells", "eta", "paper_eta", "vertex", "role", "inner", "x_m", "y_m"), rows)
