"""The plan as curves: fold over time; crease angles, transmission and step tolerance over fold."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.ticker import FormatStrFormatter, MultipleLocator, NullFormatter

from ori_deploy.motion.plan import CREASES, Plan
from ori_deploy.motion.step_tolerance import SEATING_SPREAD
from ori_deploy.profiles.profile import Reals
from ori_deploy.view.ink import FAINT, INK, SLIT, cell_colour, cell_dash, house_style

_SEATING = "#fde8c8"
_POINTS = 400
"""Samples per curve: more than a page has pixels for."""

_NAMES = {
    "open_c": "opening crease c",
    "open_d": "opening crease d",
    "close_a": "closing crease a",
    "close_b": "closing crease b",
}


def draw_plan(plan: Plan) -> Figure:
    """Draw a plan: fold(t), step tolerance, and all four creases of every cell over fold."""
    with house_style():
        legend_rows = -(-len(plan.cell_ids) // _LEGEND_COLUMNS)
        height = 8.0 + 0.18 * legend_rows
        figure = Figure(figsize=(9.5, height))
        rows = figure.add_gridspec(
            3,
            1,
            left=0.075,
            right=0.985,
            top=1.0 - 0.32 / height,
            bottom=(0.62 + 0.18 * legend_rows) / height,
            hspace=0.5,
        )
        above = rows[0].subgridspec(1, 2, wspace=0.2)
        _draw_timing(figure.add_subplot(above[0]), plan)
        _draw_tolerance(figure.add_subplot(above[1]), plan)
        table = _even_rows(plan)
        angles, ratios = np.degrees(plan.crease_angles_rad[table]), np.degrees(plan.transmission[table])
        axes = _draw_creases(figure, rows[1], plan.fold[table], angles)
        axes.set_ylabel("inner angle (°)")
        axes.yaxis.set_major_locator(MultipleLocator(45.0))
        axes = _draw_creases(figure, rows[2], plan.fold[table], np.abs(ratios))
        axes.set_ylabel("|transmission| (°/fold)")
        _log_scale(axes)
        _add_legend(figure, plan)
    return figure


_LEGEND_COLUMNS = 12


def _even_rows(plan: Plan) -> Reals:
    """Rows of the plan's table that lie about evenly both in fold and in time, both ends included."""
    n = len(plan.fold)
    by_fold = np.searchsorted(plan.fold, np.linspace(0.0, 1.0, _POINTS // 2))
    by_time = np.linspace(0, n - 1, _POINTS // 2).astype(int)
    return np.unique(np.clip(np.concatenate([by_fold, by_time]), 0, n - 1))


def _draw_timing(axes: Axes, plan: Plan) -> None:
    rows = _even_rows(plan)
    axes.set_title("Fold over time")
    axes.plot(plan.time_s[rows], plan.fold[rows], color=INK, linewidth=1.8, gid="fold")
    axes.set_xlim(0.0, plan.duration_s)
    axes.set_ylim(0.0, 1.0)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("fold (0 flat, 1 deployed)")


def _draw_tolerance(axes: Axes, plan: Plan) -> None:
    """How far cells may fall out of step: what is free of interference, and what the controller allows."""
    steps = plan.step_tolerance
    floor = 1e-3
    lead = np.concatenate([[0.0], steps.lead])
    free = np.maximum(np.concatenate([steps.spread[:1], steps.spread]), floor)
    axes.set_title("Safe step tolerance")
    if steps.seating_fold < 1.0:
        axes.axvspan(steps.seating_fold, 1.0, color=_SEATING, linewidth=0.0, gid="seating")
        axes.annotate(
            f"seating from {steps.seating_fold:.3g}",
            (steps.seating_fold, 0.06),
            (-4.0, 0.0),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="right",
            fontsize=8.0,
        )
    axes.plot(
        lead, free, drawstyle="steps-pre", color=FAINT, linewidth=3.2, label="free of interference", gid="spread"
    )
    axes.plot(
        lead,
        np.maximum(free, SEATING_SPREAD),
        drawstyle="steps-pre",
        color=SLIT,
        linestyle=(0, (4, 2)),
        linewidth=1.2,
        label="controller stops beyond",
    )
    _log_scale(axes)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(floor, 1.6)
    axes.set_xlabel("fold of the cell furthest open")
    axes.set_ylabel("difference of fold")
    axes.legend(loc="lower left")


def _log_scale(axes: Axes) -> None:
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _draw_creases(figure: Figure, row: SubplotSpec, fold: Reals, values: Reals) -> Axes:
    """One axes per crease on one scale, and the first of them; `values` is (n, n_cells, 4)."""
    n_cells = values.shape[1]
    places = row.subgridspec(1, len(CREASES), wspace=0.12)
    first: Axes | None = None
    for k, crease in enumerate(CREASES):
        axes = figure.add_subplot(places[k], sharex=first, sharey=first)
        axes.set_title(_NAMES[crease])
        for cell in range(n_cells):
            axes.plot(
                fold,
                values[:, cell, k],
                color=cell_colour(cell, n_cells),
                linestyle=cell_dash(cell, n_cells),
            )
        axes.set_xlabel("fold")
        if first is None:
            first = axes
            axes.set_xlim(0.0, 1.0)
            axes.xaxis.set_major_locator(MultipleLocator(0.25))
            axes.xaxis.set_major_formatter(FormatStrFormatter("%g"))
        else:
            axes.tick_params(labelleft=False)
    assert first is not None
    return first


def _add_legend(figure: Figure, plan: Plan) -> None:
    n = len(plan.cell_ids)
    handles = [
        Line2D([], [], color=cell_colour(i, n), linestyle=cell_dash(i, n), linewidth=2.0, label=name)
        for i, name in enumerate(plan.cell_ids)
    ]
    figure.legend(handles=handles, loc="lower center", ncols=min(n, _LEGEND_COLUMNS), columnspacing=1.4)
