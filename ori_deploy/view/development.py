"""An antenna strip unrolled: the flat sheet to cut, where it folds, and where it parts from panel to panel."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.design.band import HelixBand
from ori_deploy.design.strip import JointKind, Strip
from ori_deploy.profiles import xy
from ori_deploy.profiles.profile import Points
from ori_deploy.view.ink import FAINT, INK, SLIT, cell_colour, house_style

_MM = 1e3
_WIDTH_IN = 9.5
_PAD_IN = 0.15
_ROW_GAP = 1.4
"""Distance between the rows of a helix, in its widths; a row is at least `_LEAST_ROW_IN` high."""
_LEAST_ROW_IN = 0.42
_FINE = 1e-4
"""Sagitta of drawn curves over the drawing's width."""

_LINES: dict[JointKind, dict[str, Any]] = {
    "fold": {"color": INK, "linewidth": 1.1, "linestyle": (0, (4, 1.6))},
    "part": {"color": SLIT, "linewidth": 1.8, "linestyle": "-"},
    "rigid": {"color": FAINT, "linewidth": 0.8, "linestyle": "-"},
}
_MEANING: dict[JointKind, str] = {
    "fold": "fold",
    "part": "parts: cut, and bridge the gap",
    "rigid": "bonded panels: runs on",
}


def draw_development(strip: Strip, structure: Structure | ConeStructure) -> Figure:
    """Draw a strip on the flat sheet, seen from outside, true to scale, in millimetres.

    A helix is a long straight band: every turn has a row of its own, the first on top. Pieces have the gid
    `piece-<panel>-<turn>`, lines where two of them meet `fold-…`, `part-…` or `rigid-<joint>-<turn>`.
    """
    band = strip.band
    width_m = float(np.ptp(strip.development(1e-3 * band.length_m).real))
    turns = 1
    drop_m = 0.0
    if isinstance(band, HelixBand):
        turns = max(1, int(np.ceil(band.turns - 1e-9)))
        width_m = band.length_m / band.turns * min(band.turns, 1.0)
        scale = (_WIDTH_IN - 2.0 * _PAD_IN) / width_m
        drop_m = max(_ROW_GAP * band.width_m, _LEAST_ROW_IN / scale)
    with house_style():
        figure = Figure(figsize=(_WIDTH_IN, 6.0))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        for piece in strip.pieces:
            row = _row(strip, 0.5 * (piece.start + piece.stop), turns)
            sheet = strip.development(_FINE * width_m, piece.start, piece.stop)
            panel = structure.layout.panel_ids[piece.panel]
            axes.add_patch(
                Polygon(
                    _MM * xy(_placed(strip, sheet, row, turns, drop_m)),
                    facecolor=cell_colour(piece.panel // 4, structure.layout.n_cells),
                    edgecolor="none",
                    gid=f"piece-{panel}-{piece.turn}",
                    zorder=2,
                )
            )
        _draw_joints(axes, strip, turns, drop_m)
        _frame(figure, axes, strip, structure)
    return figure


def _row(strip: Strip, arc: float, turns: int) -> int:
    """Which row an arc is drawn in."""
    return min(int((arc - strip.band.first) / strip.band.turn_arc), turns - 1) if turns > 1 else 0


def _placed(strip: Strip, sheet: Points, row: int, turns: int, drop_m: float) -> Points:
    along = strip.band.length_m * strip.band.turn_arc / (strip.band.last - strip.band.first) if turns > 1 else 0.0
    return np.asarray(sheet - row * (along + 1j * drop_m))


def _draw_joints(axes: Axes, strip: Strip, turns: int, drop_m: float) -> None:
    for joint in strip.joints:
        for arc in strip.crossings(joint):
            row = _row(strip, float(arc), turns)
            ends = _MM * _placed(strip, strip.across(float(arc)), row, turns, drop_m)
            turn = int(np.floor((arc - joint.arc) / strip.band.turn_arc + 0.5))
            axes.plot(
                ends.real,
                ends.imag,
                gid=f"{joint.kind}-{joint.at}-{turn}",
                solid_capstyle="butt",
                dash_capstyle="butt",
                zorder=4 if joint.kind == "part" else 3,
                **_LINES[joint.kind],
            )


def _frame(figure: Figure, axes: Axes, strip: Strip, structure: Structure | ConeStructure) -> None:
    """One scale in both directions, as large as the sheet allows, with what it is and a legend under it."""
    corners = np.concatenate([np.asarray(patch.get_path().vertices) for patch in axes.patches])
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = high - low
    scale = min((_WIDTH_IN - 2.0 * _PAD_IN) / size[0], 7.0 / size[1])
    head, foot = 0.45, 0.75
    plot = size[1] * scale + 2.0 * _PAD_IN
    height = head + plot + foot
    figure.set_size_inches(_WIDTH_IN, height)
    axes.set_position((0.0, foot / height, 1.0, plot / height))
    half = 0.5 * _WIDTH_IN / scale
    middle = 0.5 * (low + high)
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(low[1] - _PAD_IN / scale, high[1] + _PAD_IN / scale)
    axes.set_aspect("equal")
    axes.axis("off")
    band = strip.band
    turns = (band.last - band.first) / band.turn_arc
    told = f"{turns:g} turns, {_MM * band.length_m:.0f} mm long, {1e4 * strip.area_m2:.1f} cm²"
    figure.text(_PAD_IN / _WIDTH_IN, 1.0 - 0.26 / height, f"Unrolled {band.kind} strip", weight="bold")
    figure.text(1.0 - _PAD_IN / _WIDTH_IN, 1.0 - 0.26 / height, told, ha="right", color=FAINT)
    bar = _round_length(0.2 * 2.0 * half)
    y = foot * 0.42 / height
    x = _PAD_IN / _WIDTH_IN
    figure.add_artist(
        Line2D([x, x + bar * scale / _WIDTH_IN], [y, y], color=INK, linewidth=1.6, solid_capstyle="butt")
    )
    figure.text(x, y + 0.06 / height, f"{bar:g} mm", fontsize=8.0, va="bottom")
    kinds = [kind for kind in _LINES if any(j.kind == kind and len(strip.crossings(j)) for j in strip.joints)]
    entries: list[Line2D | Patch] = [Line2D([], [], label=_MEANING[kind], **_LINES[kind]) for kind in kinds]
    entries.insert(0, Patch(facecolor=cell_colour(0, structure.layout.n_cells), label="pieces, coloured by cell"))
    figure.legend(handles=entries, loc="lower right", ncols=4, columnspacing=1.6, handlelength=2.4)


def _round_length(least: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is no longer."""
    power = 10.0 ** np.floor(np.log10(least))
    return float(power * max(k for k in (1.0, 2.0, 5.0) if k * power <= least * (1.0 + 1e-9)))
