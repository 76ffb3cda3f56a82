"""The deployed cross-section: what is cut, where it folds, what is bonded and what stays open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.ticker import MaxNLocator

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.profiles import xy
from ori_deploy.profiles.profile import Points
from ori_deploy.view.deployed import Deployed, deployed
from ori_deploy.view.ink import FAINT, INK, PAPER, SLIT, cell_colour, edge_colour, house_style

_WIDEST_IN, _TALLEST_IN = 8.3, 5.6
_PAD_IN = 0.5
"""Room round the outline for the vertices' names."""


@dataclass(frozen=True)
class _Scale:
    """Sizes that shrink with the number of cells, in points."""

    name: float
    vertex: float
    marker: float
    line: float

    @classmethod
    def of(cls, n_cells: int) -> _Scale:
        crowd = float(np.clip((n_cells - 6) / 12.0, 0.0, 1.0))
        return cls(
            name=11.0 - 3.5 * crowd, vertex=8.5 - 1.5 * crowd, marker=5.2 - 2.4 * crowd, line=1.5 - 0.7 * crowd
        )


def draw_section(structure: Structure | ConeStructure) -> Figure:
    """Draw the deployed cross-section: a cylinder's true to scale in millimetres, a cone's as seen from its apex.

    Every panel is one polygon with the gid `panel-<id>`, every slit one line with the gid
    `slit-<inner vertex>-<opening vertex>`, every bond one with `bond-…`.
    """
    shown = deployed(structure)
    with house_style():
        figure, axes = _sheet(shown)
        scale = _Scale.of(shown.layout.n_cells)
        _draw_panels(axes, shown)
        _draw_outline(axes, shown, scale)
        _draw_edges(axes, shown, scale)
        _draw_creases(axes, shown, scale)
        _name_cells(axes, shown, scale)
        _name_vertices(axes, shown, scale)
        _add_legend(figure, shown)
    return figure


def _sheet(shown: Deployed) -> tuple[Figure, Axes]:
    """A figure just large enough for the outline at one scale in both directions."""
    low, high = shown.extent
    size = high - low
    scale = min(_WIDEST_IN / size[0], _TALLEST_IN / size[1])
    plot = size * scale + 2.0 * _PAD_IN
    left, bottom, top, right = 0.62, 1.02, 0.1, 0.1
    width = max(plot[0] + left + right, 6.4)
    height = plot[1] + bottom + top
    figure = Figure(figsize=(width, height))
    shift = (width - left - right - plot[0]) / 2.0
    axes = figure.add_axes(((left + shift) / width, bottom / height, plot[0] / width, plot[1] / height))
    pad = _PAD_IN / scale
    axes.set_xlim(low[0] - pad, high[0] + pad)
    axes.set_ylim(low[1] - pad, high[1] + pad)
    axes.set_aspect("equal")
    axes.xaxis.set_major_locator(MaxNLocator(8))
    axes.yaxis.set_major_locator(MaxNLocator(max(2, min(8, int(plot[1] / 0.5)))))
    axes.set_xlabel(f"x ({shown.unit})")
    axes.set_ylabel(f"y ({shown.unit})")
    return figure, axes


def _draw_panels(axes: Axes, shown: Deployed) -> None:
    layout = shown.layout
    for p, outline in enumerate(shown.panels):
        axes.add_patch(
            Polygon(
                xy(outline),
                closed=True,
                facecolor=cell_colour(p // 4, layout.n_cells),
                edgecolor=edge_colour(p // 4, layout.n_cells),
                linewidth=0.3,
                joinstyle="round",
                gid=f"panel-{layout.panel_ids[p]}",
                zorder=2,
            )
        )


def _draw_outline(axes: Axes, shown: Deployed, scale: _Scale) -> None:
    axes.add_patch(
        Polygon(
            xy(shown.target), closed=True, fill=False, edgecolor=INK, linewidth=scale.line, gid="profile", zorder=3
        )
    )


def _draw_edges(axes: Axes, shown: Deployed, scale: _Scale) -> None:
    """Inner edges of the layout: slits over bonds."""
    layout = shown.layout
    ids = [v.id for v in layout.vertices]
    tail, head = layout.corners.ravel(), np.roll(layout.corners, -1, axis=1).ravel()
    for p in np.flatnonzero(layout.bonded_to > np.arange(layout.n_panels)):
        a, b = int(tail[p]), int(head[p])
        line = shown.edge(a, b)
        axes.plot(
            line.real, line.imag, color=INK, linewidth=0.6 * scale.line, gid=f"bond-{ids[a]}-{ids[b]}", zorder=3
        )
    width = 1.2 + 0.9 * scale.line
    halo = [patheffects.Stroke(linewidth=width + 1.2, foreground=PAPER, capstyle="butt"), patheffects.Normal()]
    for a, b in layout.slits:
        line = shown.edge(a, b)
        axes.plot(
            line.real,
            line.imag,
            color=SLIT,
            linewidth=width,
            linestyle=(0, (2.2, 1.1)),
            dash_capstyle="butt",
            path_effects=halo,
            gid=f"slit-{ids[a]}-{ids[b]}",
            zorder=4,
        )


def _draw_creases(axes: Axes, shown: Deployed, scale: _Scale) -> None:
    for places, style in ((shown.crease[:, :2], _OPENING), (shown.crease[:, 2:], _CLOSING)):
        flat = places.ravel()
        axes.plot(flat.real, flat.imag, linestyle="none", markersize=scale.marker, zorder=5, **style)


_OPENING: dict[str, Any] = {"marker": "o", "markerfacecolor": PAPER, "markeredgecolor": INK, "markeredgewidth": 1.1}
_CLOSING: dict[str, Any] = {"marker": "D", "markerfacecolor": INK, "markeredgecolor": PAPER, "markeredgewidth": 0.5}


def _name_cells(axes: Axes, shown: Deployed, scale: _Scale) -> None:
    middle = _centroids(shown.void)
    for name, z in zip(shown.layout.cell_ids, middle, strict=True):
        axes.text(
            z.real,
            z.imag,
            name,
            ha="center",
            va="center",
            fontsize=scale.name,
            fontweight="bold",
            zorder=6,
        )


def _centroids(corners: Points) -> Points:
    """(n,) centroids of (n, k) polygons."""
    after = np.roll(corners, -1, axis=1)
    cross = (np.conj(corners) * after).imag
    return np.asarray(((corners + after) * cross).sum(axis=1) / (3.0 * cross.sum(axis=1)))


def _name_vertices(axes: Axes, shown: Deployed, scale: _Scale) -> None:
    layout = shown.layout
    halo = [patheffects.withStroke(linewidth=2.5, foreground=PAPER)]
    slit_at = {opening: layout.vertices[inner].id for inner, opening in layout.slits}
    for i, v in enumerate(layout.vertices):
        z, away = shown.vertices[i], shown.outwards[i]
        reach = scale.vertex + 5.0
        is_slit = i in slit_at
        axes.annotate(
            f"slit {slit_at[i]}–{v.id}" if is_slit else v.id,
            (z.real, z.imag),
            (reach * away.real, reach * away.imag),
            textcoords="offset points",
            ha=_side(away.real, ("right", "center", "left")) if is_slit else "center",
            va="center",
            fontsize=scale.vertex + (1.0 if is_slit else 0.0),
            fontweight="bold" if is_slit or v.inner else "normal",
            color=SLIT if is_slit else INK if v.inner else FAINT,
            path_effects=halo,
            zorder=7,
        )


def _side(x: float, names: tuple[str, str, str]) -> str:
    return names[0] if x < -0.4 else names[2] if x > 0.4 else names[1]


def _add_legend(figure: Figure, shown: Deployed) -> None:
    entries: list[Line2D | Patch] = [
        Line2D([], [], color=INK, linewidth=1.5, label="target profile"),
        Patch(facecolor=cell_colour(0, shown.layout.n_cells), label="panels, coloured by cell"),
        Line2D([], [], color=INK, linewidth=0.9, label="bond"),
        Line2D([], [], linestyle="none", markersize=5.2, label="opening crease", **_OPENING),
        Line2D([], [], linestyle="none", markersize=5.2, label="closing crease", **_CLOSING),
    ]
    if shown.layout.slits:
        entries.append(Line2D([], [], color=SLIT, linewidth=2.6, linestyle=(0, (2.2, 1.1)), label="slit"))
    figure.legend(handles=entries, loc="lower center", ncols=3, columnspacing=2.0, handlelength=2.4)
