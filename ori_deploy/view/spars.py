"""The deployed section with its spars picked out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from ori_deploy.design import Structure
from ori_deploy.view.ink import INK, PAPER, house_style
from ori_deploy.view.section import draw_section

_MM = 1e3
_STEP_PT, _FARTHEST_PT = 3.0, 60.0
"""How far a name is moved at once, and at most, until it lies on no other."""


def draw_sparred_section(structure: Structure, spars: Sequence[Sequence[int]]) -> Figure:
    """Draw the deployed cross-section and its spars, each one line with the gid `spar-<k>`, numbered from 1.

    Parameters
    ----------
    structure
        What to draw.
    spars
        Vertices of each, from skin to skin.
    """
    figure = draw_section(structure)
    axes = figure.axes[0]
    halo = [patheffects.Stroke(linewidth=6.2, foreground=PAPER, capstyle="butt"), patheffects.Normal()]
    with house_style():
        for k, spar in enumerate(spars, 1):
            z = _MM * structure.embedding.z[list(spar)]
            axes.plot(
                z.real, z.imag, color=INK, linewidth=4.2, solid_capstyle="butt", path_effects=halo, gid=f"spar-{k}",
                zorder=3.5,
            )  # fmt: skip
            low = z[z.imag.argmin()]
            axes.annotate(
                f"spar {k}", (low.real, low.imag), (0.0, -14.0), textcoords="offset points", ha="center", va="center",
                fontweight="bold",
            )  # fmt: skip
        _part_names(figure, axes)
    return figure


def _part_names(figure: Figure, axes: Axes) -> None:
    """Move names outwards, the way they already stand off, until none lies on another; slits' names stay."""
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    names = [text for text in axes.texts if isinstance(text, Annotation)]
    placed: list[Bbox] = []
    for name in sorted(names, key=lambda text: not text.get_text().startswith("slit")):
        x, y = name.xyann
        length = float(np.hypot(x, y))
        for reach in np.arange(length, length + _FARTHEST_PT, _STEP_PT) if length > 0.0 else (0.0,):
            if length > 0.0:
                name.xyann = (x * reach / length, y * reach / length)
            box = name.get_window_extent(renderer)
            if not any(box.overlaps(other) for other in placed):
                break
        placed.append(box)
