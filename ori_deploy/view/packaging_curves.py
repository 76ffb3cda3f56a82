"""Packaging ratio against number of cells: without walls beside the continuum limit, and with walls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from ori_deploy.figures.packaging import PackagingPoint
from ori_deploy.figures.walls import WallPoint, WallRow, wall_rows
from ori_deploy.view.ink import FAINT, INK, PAPER, cell_colour, house_style

_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_KINDS = 7
"""Colours and markers before they come round again."""


def draw_packaging(points: Sequence[PackagingPoint]) -> Figure:
    """Draw Fig. 4c: eta above, the coefficient of variation of the cells' areas below.

    The best of each aspect and number of cells is one filled marker, what other starts led to is faint; lines
    with the gid `limit-<aspect>` are equation (8).

    Raises
    ------
    ValueError
        Nothing to draw.
    """
    drawn = [p for p in points if np.isfinite(p.eta)]
    if not drawn:
        raise ValueError("points: no search led anywhere")
    aspects = sorted({p.aspect for p in drawn}, reverse=True)
    with house_style():
        figure = Figure(figsize=(6.8, 7.2), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.7, 1.0))
        for k, aspect in enumerate(aspects):
            own = [p for p in drawn if p.aspect == aspect]
            _draw_limit(top, own, k)
            _draw_maxima(top, own, [p.eta for p in own], k, f"eta-{aspect:g}")
            _draw_maxima(bottom, own, [p.variation for p in own], k, f"variation-{aspect:g}")
        top.set_ylabel("packaging ratio η")
        top.set_ylim(bottom=0.0)
        bottom.set_ylabel("coefficient of variation of cell areas")
        bottom.set_ylim(bottom=-0.02)
        bottom.set_xlabel("number of cells n")
        bottom.xaxis.set_major_locator(MaxNLocator(integer=True))
        _add_key(top, aspects)
    return figure


def _draw_limit(axes: Axes, own: Sequence[PackagingPoint], k: int) -> None:
    line = sorted({(p.n_cells, p.limit) for p in own})
    axes.plot(*zip(*line, strict=True), color=_colour(k), linewidth=1.1, gid=f"limit-{own[0].aspect:g}", zorder=2)


def _draw_maxima(axes: Axes, own: Sequence[PackagingPoint], y: Sequence[float], k: int, gid: str) -> None:
    """Others first, as outlines; then one filled marker per number of cells."""
    best: dict[int, int] = {}
    for i, p in enumerate(own):
        if p.best:
            best.setdefault(p.n_cells, i)
    other = [i for i, p in enumerate(own) if not p.best]
    axes.plot(
        [own[i].n_cells for i in other], [y[i] for i in other], linestyle="none", marker=_MARKERS[k % _KINDS],
        markersize=4.2, markerfacecolor="none", markeredgecolor=_colour(k), markeredgewidth=0.6, alpha=0.55,
        gid=f"{gid}-others", zorder=3,
    )  # fmt: skip
    axes.plot(
        [own[i].n_cells for i in best.values()], [y[i] for i in best.values()], gid=f"{gid}-best", zorder=4,
        **_filled(k),
    )  # fmt: skip


def _colour(k: int) -> str:
    return cell_colour(k % _KINDS, _KINDS)


def _filled(k: int) -> dict[str, Any]:
    return {
        "linestyle": "none",
        "marker": _MARKERS[k % _KINDS],
        "markersize": 5.6,
        "markerfacecolor": _colour(k),
        "markeredgecolor": INK,
        "markeredgewidth": 0.5,
    }


def _add_key(axes: Axes, aspects: Sequence[float]) -> None:
    entries = [Line2D([], [], label=f"aspect {aspect:g}", **_filled(k)) for k, aspect in enumerate(aspects)]
    entries += [
        Line2D([], [], color=INK, linewidth=1.1, label="continuum limit, equation (8)"),
        Line2D([], [], linestyle="none", marker="o", markersize=4.2, markerfacecolor="none", markeredgecolor=FAINT,
               label="from other starts"),
    ]  # fmt: skip
    axes.legend(handles=entries, loc="upper left")


def draw_walls(points: Sequence[WallPoint]) -> Figure:
    """Draw eta against number of cells wall by wall, one picture per shape.

    Every row is a line with the gid `wall-<shape>-<wall>`; a ring marks its maximum, a cross where it ends.

    Raises
    ------
    ValueError
        Nothing to draw.
    """
    rows = [row for row in wall_rows(points) if row.points]
    if not rows:
        raise ValueError("points: no structure with any wall")
    shapes = list(dict.fromkeys(row.shape for row in rows))
    with house_style():
        figure = Figure(figsize=(4.9 * max(len(shapes), 1), 5.9), layout="constrained")
        for axes, shape in zip(figure.subplots(1, len(shapes), squeeze=False)[0], shapes, strict=True):
            own = [row for row in rows if row.shape == shape]
            _draw_shape(axes, own)
            axes.set_title(shape)
            axes.set_xlabel("number of cells n")
            axes.set_ylabel("packaging ratio η")
        figure.legend(
            handles=[Line2D([], [], label=told, **mark) for told, mark in _MARKS],
            loc="outside lower center",
            ncols=2,
        )
    return figure


_RING: dict[str, Any] = {
    "linestyle": "none", "marker": "o", "markersize": 9.5, "markerfacecolor": "none", "markeredgecolor": INK,
    "markeredgewidth": 1.2,
}  # fmt: skip
_CROSS: dict[str, Any] = {
    "linestyle": "none", "marker": "x", "markersize": 7.0, "markeredgecolor": INK, "markeredgewidth": 1.6,
}  # fmt: skip
_MARKS = (("largest of its wall", _RING), ("row ends", _CROSS))


def _draw_shape(axes: Axes, rows: Sequence[WallRow]) -> None:
    for k, row in enumerate(rows):
        n, eta = [p.n_cells for p in row.points], [p.eta for p in row.points]
        axes.plot(
            n, eta, color=_colour(k), linewidth=1.2, marker=_MARKERS[k % _KINDS], markersize=4.4,
            markerfacecolor=_colour(k), markeredgecolor=INK, markeredgewidth=0.4, label=_told(row),
            gid=f"wall-{row.shape}-{row.wall:g}", zorder=3,
        )  # fmt: skip
        best = row.best
        inside = best is not None and best is not row.points[-1]
        if best is not None and inside:
            axes.plot([best.n_cells], [best.eta], gid=f"best-{row.shape}-{row.wall:g}", zorder=4, **_RING)
        if row.ended_by:
            axes.plot(n[-1:], eta[-1:], gid=f"end-{row.shape}-{row.wall:g}", zorder=5, **_CROSS)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.06), fontsize=8.0, facecolor=PAPER)


def _told(row: WallRow) -> str:
    best = row.best
    assert best is not None  # rows without a structure are left out
    last = row.points[-1].n_cells
    what = f"wall {row.wall:g}: "
    if best.n_cells == last and not row.ended_by:
        return f"{what}no maximum up to n = {last}"
    top = f"η {best.eta:.2f} at n = {best.n_cells}"
    return what + top + (f", ends at {last}: {row.ended_by}" if row.ended_by else f", goes on beyond {last}")
