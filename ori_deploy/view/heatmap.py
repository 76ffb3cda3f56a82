"""A quantity over two others, as coloured cells with contour lines: the paper's Fig. 4d."""

from __future__ import annotations

import numpy as np
from matplotlib import patheffects
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ori_deploy.view.ink import INK, PAPER, house_style

_LEVELS = 8


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
        names = axes.clabel(lines, fontsize=8.0, fmt="%.3g", inline_spacing=4, manual=_middles(lines))
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


def _middles(lines: QuadContourSet) -> list[tuple[float, float]]:
    """The middle of every contour's longest piece: a name there is not cut off by the frame."""
    middles = []
    for pieces in lines.allsegs:
        longest = max(pieces, key=len, default=())
        if len(longest) > 2:
            x, y = longest[len(longest) // 2]
            middles.append((float(x), float(y)))
    return middles
