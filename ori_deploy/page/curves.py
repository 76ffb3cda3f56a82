"""Curves on the page: what is drawn against what, as arrays."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ori_deploy.motion import CREASES, Linkage
from ori_deploy.motion.poses import Placement
from ori_deploy.page.thinning import Flags, thinned
from ori_deploy.page.timeline import Timeline, busy_in
from ori_deploy.profiles.profile import Reals
from ori_deploy.telemetry.read import Run
from ori_deploy.view.ink import cell_colour

_CREASE_COLOURS = ("#0072b2", "#56b4e9", "#d55e00", "#e69f00")
ALL_CELLS = "all cells"
_GAP_S = 1e-6
"""How far a gap is behind what was known last; times come in thousandths of a second."""


@dataclass(frozen=True)
class Curves:
    """One chart.

    Attributes
    ----------
    title
        With the unit.
    across
        What x is.
    x
        (n,) increasing.
    names, colours
        Of the curves.
    y
        One (n,) per curve; NaN leaves a gap.
    """

    title: str
    across: str
    x: Reals
    names: tuple[str, ...]
    colours: tuple[str, ...]
    y: tuple[Reals, ...]


def crease_curves(mechanism: Linkage[Placement], timeline: Timeline, cell: str, *, over_fold: bool) -> Curves:
    """Angles of the creases of one cell, or of the first closing crease of every cell."""
    # Angles only grow or fall with the fold: where that is lowest or highest, so are they.
    x, fold = thinned(timeline.time_s, timeline.fold, timeline.busy)
    if over_fold:
        x = np.linspace(0.0, 1.0, 201)
        fold = np.repeat(x[:, None], mechanism.n_cells, axis=1)
    angles = np.degrees(mechanism.four_bars.angles(fold))
    ids, n = mechanism.layout.cell_ids, mechanism.n_cells
    across = "fold" if over_fold else "time (s)"
    if cell in ids:
        i = ids.index(cell)
        return Curves(
            f"crease angles of {cell} (°)",
            across,
            x,
            CREASES,
            _CREASE_COLOURS,
            tuple(angles[:, i, k] for k in range(4)),
        )
    k = CREASES.index("close_a")
    colours = tuple(cell_colour(i, n) for i in range(n))
    return Curves("angle of crease close_a (°)", across, x, ids, colours, tuple(angles[:, i, k] for i in range(n)))


def flown_curves(run: Run) -> tuple[Curves, ...]:
    """Current and temperature of every actuator in a log."""
    names = tuple(str(name) for name in run.info["hinge_ids"])
    busy, begin = busy_in(run), run.time_s[0]
    made = [_of("servo current (A)", run.time_s - begin, run.current_a, busy, names)]
    if len(run.health_time_s) > 1:
        now = np.clip(np.searchsorted(run.time_s, run.health_time_s), 0, len(busy) - 1)
        made.append(_of("temperature (°C)", run.health_time_s - begin, run.temperature_c, busy[now], names))
    return tuple(made)


def _of(title: str, time_s: Reals, values: Reals, busy: Flags, names: tuple[str, ...]) -> Curves:
    x, y = thinned(time_s, values, busy)
    colours = tuple(cell_colour(k, len(names)) for k in range(len(names)))
    return Curves(title, "time (s)", x, names, colours, tuple(y[:, k] for k in range(len(names))))


class Recent:
    """The last minute of what a controller tells.

    Parameters
    ----------
    title
        With the unit.
    names
        Of the curves.
    """

    def __init__(self, title: str, names: Sequence[str], rows: int = 300) -> None:
        self._title, self._names = title, tuple(names)
        self._rows: deque[tuple[float, tuple[float, ...]]] = deque(maxlen=rows)

    def add(self, time_s: float, values: Sequence[float | None]) -> None:
        """One more row; what is not known is a gap, and so is what there is too much of."""
        told = [float("nan") if v is None else float(v) for v in values[: len(self._names)]]
        told += [float("nan")] * (len(self._names) - len(told))
        if not self._rows or time_s > self._rows[-1][0]:
            self._rows.append((time_s, tuple(told)))

    def gap(self) -> None:
        """Nothing is known for a while: what comes next is not joined to what was."""
        if self._rows and not np.isnan(self._rows[-1][1]).all():
            self._rows.append((self._rows[-1][0] + _GAP_S, (float("nan"),) * len(self._names)))

    @property
    def curves(self) -> Curves:
        """All of it."""
        n = len(self._names)
        colours = tuple(cell_colour(i, n) for i in range(n))
        x = np.array([at for at, _ in self._rows])
        table = np.array([row for _, row in self._rows]).reshape(len(self._rows), n)
        return Curves(self._title, "time (s)", x, self._names, colours, tuple(table[:, k] for k in range(n)))
