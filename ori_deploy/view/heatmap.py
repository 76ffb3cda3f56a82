"""A quantity over two others, as coloured cells with contour lines: the paper's Fig. 4d."""

from __future__ import annotations

import numpy as np
from matplotlib import patheffects
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ori_deploy.profiles.profile import Reals
from ori_deploy.view.ink import INK, PAPER, house_style

_LEVELS = 8
_ROOM = 0.045
"""Least distance of a contour's name from the frame, over the frame's sides: half of the name's length."""


def draw_heatmap(
    x: ArrayLike,
    y: ArrayLike,
    value: ArrayLike,
    *,
    x_label: str,
    y_label: str,
    value_label: str,
    title: str = "",
) -> Figure:
    """Draw a heatmap.

    Parameters
    ----------
    x, y
        (k,) and (n,) increasing.
    value
        (n, k), finite.
    x_label, y_label, value_label, title
        What people read.

    Raises
    ------
    ValueError
        Shapes that do not fit, or values that are not numbers.
    """
    across, up, shown = (np.asarray(a, dtype=float) for a in (x, y, value))
    if shown.shape != (len(up), len(across)) or min(shown.shape, default=0) < 2:
        raise ValueError(f"value: shape {shown.shape}, wanted {(len(up), len(across))}, at least 2 x 2")
    if not np.isfinite(shown).all():
        raise ValueError("value: not all finite")
    with house_style():
        figure = Figure(figsize=(6.8, 4.6), layout="constrained")
        axes = figure.add_subplot()
        axes.grid(False)
        mesh = axes.pcolormesh(across, up, shown, cmap="viridis", shading="gouraud", rasterized=True)
        lines = axes.contour(across, up, shown, levels=_LEVELS, colors=PAPER, linewidths=0.8)
        names = axes.clabel(lines, fontsize=8.0, fmt="%.3g", inline_spacing=4, manual=_middles(lines, across, up))
        for name in names:
            name.set_color(PAPER)
            name.set_path_effects([patheffects.withStroke(linewidth=1.6, foreground=INK)])
        bar = figure.colorbar(mesh, ax=axes, pad=0.02)
        bar.set_label(value_label, color=INK)
        bar.add_lines(lines)
        bar.outline.set_visible(False)
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        if title:
            axes.set_title(title)
    return figure


def _middles(lines: QuadContourSet, x: Reals, y: Reals) -> list[tuple[float, float]]:
    """Where the names of contours go: nearest to the middle of the longest piece, with room up to the frame.

    A contour that nowhere has that room goes without a name; the colour bar has it.
    """
    corner, size = np.array([x[0], y[0]]), np.array([np.ptp(x), np.ptp(y)])
    middles = []
    for pieces in lines.allsegs:
        places = max(
            (_evenly((piece - corner) / size) for piece in pieces if len(piece) > 1), key=_length, default=None
        )
        if places is None:
            continue
        room = np.minimum(places, 1.0 - places).min(axis=1) >= _ROOM
        if room.any():
            from_middle = np.abs(np.arange(len(places)) - 0.5 * (len(places) - 1))
            at = places[int(np.argmin(np.where(room, from_middle, np.inf)))] * size + corner
            middles.append((float(at[0]), float(at[1])))
    return middles


def _evenly(piece: Reals) -> Reals:
    """(101, 2) places spaced evenly along a polyline."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(piece, axis=0).T))])
    even = np.linspace(0.0, along[-1], 101)
    return np.column_stack([np.interp(even, along, piece[:, k]) for k in (0, 1)])


def _length(places: Reals) -> float:
    return float(np.hypot(*np.diff(places, axis=0).T).sum())
