"""Several structures on one sheet, each folding from left to right: deployed section first, flat stack last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.view.ink import FAINT, INK, SLIT, house_style
from ori_deploy.view.strip import Frame, draw_frame, fold_frames, round_length

_WIDTH_IN, _GAP_IN, _HEAD_IN, _FOOT_IN = 9.5, 0.32, 0.5, 0.34
_TALLEST_IN = 2.1


@dataclass(frozen=True)
class FoldRow:
    """One structure of the sheet.

    Attributes
    ----------
    title, detail
        What is written above it.
    structure
        What folds.
    """

    title: str
    detail: str
    structure: Structure | ConeStructure


def draw_fold_rows(rows: Sequence[FoldRow], folds: Sequence[float], *, one_scale: bool = False) -> Figure:
    """Draw a sheet of folding structures.

    Every panel is one polygon with the gid `row<j>-frame<k>-panel-<id>`.

    Parameters
    ----------
    rows
        From top to bottom.
    folds
        Increasing, from 0 to 1; drawn from right to left.
    one_scale
        Draw all rows at one scale, which says something where they are of one size.

    Raises
    ------
    ValueError
        No rows.
    """
    if not rows:
        raise ValueError("rows: none")
    frames = [fold_frames(row.structure, folds)[::-1] for row in rows]
    scales = [_scale(own) for own in frames]
    if one_scale:
        scales = [min(scales)] * len(scales)
    tall = [scale * max(float(f.size[1]) for f in own) for own, scale in zip(frames, scales, strict=True)]
    height = sum(tall) + len(rows) * (_HEAD_IN + _FOOT_IN + _GAP_IN) + _GAP_IN
    with house_style():
        figure = Figure(figsize=(_WIDTH_IN, height))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(0.0, _WIDTH_IN)
        axes.set_ylim(0.0, height)
        top = height - 0.5 * _GAP_IN
        for j, (row, own, scale, body) in enumerate(zip(rows, frames, scales, tall, strict=True)):
            axes.text(_GAP_IN, top, row.title, va="top", fontweight="bold", fontsize=10.5)
            axes.text(_GAP_IN, top - 0.2, row.detail, va="top", fontsize=8.5, color=FAINT)
            _draw_row(axes, j, row.structure, own, scale, (top - _HEAD_IN, body))
            top -= _HEAD_IN + body + _FOOT_IN + _GAP_IN
        if any(row.structure.layout.slits for row in rows):
            axes.plot([_GAP_IN, _GAP_IN + 0.35], [0.17, 0.17], color=SLIT, linewidth=1.6)
            axes.text(_GAP_IN + 0.43, 0.17, "faces of the slit", va="center", fontsize=8.0)
    return figure


def _scale(frames: Sequence[Frame]) -> float:
    """Inches per unit at which a row fits the sheet."""
    across = (_WIDTH_IN - _GAP_IN * (len(frames) + 1)) / sum(float(f.size[0]) for f in frames)
    return min(across, _TALLEST_IN / max(float(f.size[1]) for f in frames))


def _draw_row(
    axes: Axes,
    j: int,
    structure: Structure | ConeStructure,
    frames: Sequence[Frame],
    scale: float,
    place: tuple[float, float],
) -> None:
    top, body = place
    gap = (_WIDTH_IN - scale * sum(float(f.size[0]) for f in frames)) / (len(frames) + 1)
    x = gap
    for k, frame in enumerate(frames):
        width, tall = (float(side) for side in scale * frame.size)
        corner = complex(x, top - 0.5 * (body + tall))
        draw_frame(axes, structure.layout, frame, corner, scale, f"row{j}-frame{k}")
        ends_told = {0.0: "flat", 1.0: "deployed"}
        told = ends_told.get(frame.fold, f"fold {frame.fold:g}")
        axes.text(x + 0.5 * width, top - body - 0.08, told, ha="center", va="top", fontsize=8.5, color=INK)
        x += width + gap
    unit = "°" if isinstance(structure, ConeStructure) else " mm"
    _draw_bar(axes, scale, float(frames[0].size[0]), unit, top + 0.3)


def _draw_bar(axes: Axes, scale: float, size: float, unit: str, y: float) -> None:
    """A bar of a round length, not more than 0.5 of the deployed frame, at the right of the row's head."""
    length = round_length(0.5 * size)
    right = _WIDTH_IN - _GAP_IN
    axes.plot([right - length * scale, right], [y, y], color=INK, linewidth=2.0, solid_capstyle="butt")
    told = f"{length / 1e3:g} m" if unit == " mm" and length >= 1e3 else f"{length:g}{unit}"
    axes.text(right - length * scale - 0.07, y, told, ha="right", va="center", fontsize=8.0)
