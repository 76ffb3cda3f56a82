"""Why a search found nothing, in words and units."""

from __future__ import annotations

import numpy as np

from ori_deploy.errors import CellError
from ori_deploy.profiles.profile import Reals
from ori_deploy.search.problem import Problem, Row, Values

_TOLD = 3
"""Conditions that an error names."""

UNSPOKEN = ("raise", "box")
"""Conditions that are part of how a problem is put, and no bounds of anybody's."""

PLACES: dict[str, tuple[str, ...]] = {
    "margin": ("a", "b"),
    "closing angle": ("a", "b"),
    "opening angle": ("c", "d"),
    "face": ("a-c", "c-b", "b-d", "d-a"),
    "panel": ("a-c", "c-b", "b-d", "d-a"),
}
"""What a condition's corner is: a cell's vertices are a, c, b, d in the order it lists them."""

_REMEDIES = {
    "margin": "a thinner wall, a smaller margin_rad, other cells or more --starts",
    "panel": "a smaller panel_m, fewer cells or more --starts",
    "eta": "a smaller eta_at_least, or another number of cells",
    "pin": "drop a pin or move it, or more --starts",
}
_REMEDY = "a thinner wall, fewer cells or more --starts"


class NoStructureError(CellError):
    """A local search that met no place where every condition holds.

    Attributes
    ----------
    short
        By how much the nearest one misses: radians, or lengths over the size; infinite where nothing could be built.

    of_eta
        Whether it misses the eta asked for: then no smaller miss of another condition says more.
    """

    short: float = np.inf
    of_eta: bool = False


def no_structure(name: str, problem: Problem, x: Reals | None) -> NoStructureError:
    """The error of a search that ended at `x`, or could not begin."""
    wish, wall = problem.wish, problem.wall_m
    limit = f"dead-centre margin {np.degrees(wish.margin_rad):.3g} deg, wall {wall:.4g} {problem.unit}"
    if wish.objective == "wall":
        limit = f"dead-centre margin {np.degrees(wish.margin_rad):.3g} deg, eta at least {wish.eta_at_least:.6g}"
    values = None if x is None else problem.values(x)
    kinds: list[str] = []
    told = "an opening crease has no place on the outline"
    if x is None and (passed := _passed(problem)):
        told, kinds = passed, ["pin"] if wish.pins else []
    if x is not None and values is not None:
        told, kinds = _told(problem, x, values)
    error = NoStructureError(
        f"{name}: no structure meets every condition",
        value=told,
        limit=limit,
        remedy=next((_REMEDIES[k] for k in ("eta", "pin", "panel", "margin") if k in kinds), _REMEDY),
    )
    error.short = np.inf if values is None else values.violation
    error.of_eta = "eta" in kinds
    return error


def _told(problem: Problem, x: Reals, values: Values) -> tuple[str, list[str]]:
    """The conditions furthest from holding, and their kinds; (3) itself only where it is the only one."""
    pins = problem.equations(x)
    off = np.abs(values.equation)
    if off.max(initial=0.0) > max(float(-values.inequality.min(initial=0.0)), 0.0):
        k = int(off.argmax())
        return f"pin {pins[k].name} is {_length(problem, off[k])} off", ["pin"]
    short = -values.inequality
    order = [
        int(k)
        for k in np.argsort(-short, kind="stable")
        if short[k] >= 0.5 * short.max() or (problem.rows[k].kind == "eta" and short[k] > 0.0)
    ]
    named = [k for k in order if problem.rows[k].kind not in UNSPOKEN] or order
    # What a person asked for comes before what any structure has to fulfil.
    kind = [problem.rows[k].kind for k in range(len(short))]
    asked = sorted(named, key=lambda k: (kind[k] != "eta", kind[k] not in _REMEDIES))[:_TOLD]
    said = [_words(problem, problem.rows[k], float(short[k])) for k in asked]
    return ", ".join(dict.fromkeys(said)), [problem.rows[k].kind for k in asked]


def _passed(problem: Problem) -> str:
    """Neighbours on the outline that the start has in the wrong order, as pins can bring about."""
    a, b = problem.order
    loop = problem.start.layout.outline
    ids = [problem.start.layout.vertices[i].id for i in loop]
    wrong = np.flatnonzero(a @ problem.first + b < 0.0)
    return ", ".join(f"{ids[k]} stands at or beyond {ids[(k + 1) % len(ids)]}" for k in wrong[:_TOLD])


def _words(problem: Problem, row: Row, short: float) -> str:
    cell, wish = problem.start.layout.cell_ids[row.cell], problem.wish
    place = PLACES[row.kind][row.corner] if row.kind in PLACES else ""
    if row.kind == "eta":
        return f"eta reaches {1.0 / (1.0 / wish.eta_at_least + short):.4g}"
    if row.kind == "margin":
        return f"the dead-centre margin of {cell} at {place} is {np.degrees(wish.margin_rad - short):.3g} deg"
    if row.kind in ("closing angle", "opening angle"):
        return f"the {row.kind} of {cell} at {place} is {np.degrees(short):.3g} deg beyond its end"
    if row.kind == "face":
        return f"the inner face {place} of {cell} is {_length(problem, short)} too short"
    if row.kind == "panel":
        return f"panel {place} of {cell} is {_length(problem, short)} too short"
    if row.kind == "raise":
        return f"the two sides of {cell} unfold to lengths that differ: a wall offset {_length(problem, short)} low"
    return f"the folded stack's box at {cell} is {_length(problem, short)} too small"


def _length(problem: Problem, over_size: float) -> str:
    """For people: millimetres; of a cone an angle seen from its apex."""
    length = float(over_size) * problem.size
    return f"{1e3 * length:.3g} mm" if problem.cone is None else f"{length:.3g} rad"
