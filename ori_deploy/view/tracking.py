"""A run as curves: every driven crease commanded against measured, over the states it passed through."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby, pairwise

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FormatStrFormatter, NullFormatter
from numpy.typing import NDArray

from ori_deploy.motion.plan import Plan
from ori_deploy.profiles.profile import Reals
from ori_deploy.telemetry.read import Run
from ori_deploy.view.events import RunEvent, fault_events, latch_events
from ori_deploy.view.ink import FAINT, INK, PAPER, SLIT, cell_colour, cell_dash, house_style

STATE_COLOURS = {
    "disconnected": "#f1f1f1",
    "ready": "#e7ebf0",
    "armed": "#d3dcea",
    "moving": "#d9ecfb",
    "latching": "#fdeebf",
    "deployed": "#cfeeda",
    "stowed": "#e2dcf6",
    "hold": "#fbdcc0",
    "stopping": "#f5cbb5",
    "fault": "#fbc9d0",
}
"""One shade per state of the controller."""

_CONFIRMED = "#00724f"
_BUCKETS = 700
_LEGEND_COLUMNS = 4


def draw_tracking(run: Run, plan: Plan | None = None) -> Figure:
    """Draw a run.

    Parameters
    ----------
    run
        From a flight log.
    plan
        What was carried out; gives the limit for cells out of step.
    """
    hinges = list(zip(run.info["hinge_ids"], run.info["cell_ids"], run.info["driven_creases"], strict=True))
    legend_in = 0.34 + 0.19 * -(-(len(hinges) + 1) // _LEGEND_COLUMNS)
    with house_style():
        height = 6.6 + legend_in
        figure = Figure(figsize=(9.5, height))
        grid = figure.add_gridspec(
            4,
            1,
            height_ratios=(0.22, 3.0, 1.2, 1.2),
            left=0.1,
            right=0.985,
            top=1.0 - 0.12 / height,
            bottom=(legend_in + 0.5) / height,
            hspace=0.13,
        )
        ribbon, angles, errors, spread = (figure.add_subplot(grid[k]) for k in range(4))
        time = run.time_s - run.time_s[0]
        _draw_states(run, time, ribbon, (angles, errors, spread))
        _draw_angles(run, time, angles)
        _draw_errors(run, time, errors)
        _draw_spread(run, plan, time, spread)
        _draw_marks(run, float(time[-1]), (angles, errors, spread))
        for axes in (ribbon, angles, errors, spread):
            axes.set_xlim(0.0, max(float(time[-1]), 1e-3))
            axes.tick_params(labelbottom=axes is spread)
        spread.set_xlabel("time since the first cycle (s)")
        figure.align_ylabels([angles, errors, spread])
        _add_legends(figure, run, hinges, height)
    return figure


def _segments(names: tuple[str, ...], time: Reals, gaps: NDArray[np.int64]) -> list[tuple[str, float, float]]:
    """Stretches of equal names without a gap: name, from, to."""
    found: list[tuple[str, float, float]] = []
    for rows in np.split(np.arange(len(time)), gaps):
        start, end = int(rows[0]), int(rows[-1])
        for name, group in groupby(names[start : end + 1]):
            stop = start + len(list(group))
            found.append((name, float(time[start]), float(time[min(stop, end)])))
            start = stop
    return found


def _draw_states(run: Run, time: Reals, ribbon: Axes, below: tuple[Axes, ...]) -> None:
    for state, start, stop in _segments(run.state, time, run.after_gap):
        for axes in below:
            axes.axvspan(start, stop, color=STATE_COLOURS.get(state, PAPER), linewidth=0.0, zorder=0)
    ribbon.set_axis_off()
    ribbon.set_ylim(0.0, 1.0)
    per_second = 8.5 / max(float(time[-1]), 1e-3)
    for stage, start, stop in _segments(run.stage, time, run.after_gap):
        if not stage:
            continue
        ribbon.plot([start, stop], [0.12, 0.12], color=FAINT, linewidth=2.4, solid_capstyle="butt")
        if (stop - start) * per_second > 0.085 * len(stage):
            ribbon.text(0.5 * (start + stop), 0.3, stage, ha="center", va="bottom", fontsize=8.0, color=FAINT)


def _drawn(run: Run, time: Reals, values: Reals) -> tuple[Reals, Reals]:
    """(m, n) times and values to draw: thinned, and with no line over what was not there."""
    ats, kepts = [], []
    for rows in np.split(np.arange(len(time)), run.after_gap):
        at, kept = _thinned(time[rows], values[rows], max(1, _BUCKETS * len(rows) // len(time)))
        ats += [at, at[-1:]]
        kepts += [kept, np.full_like(kept[-1:], np.nan)]
    return np.concatenate(ats[:-1]), np.concatenate(kepts[:-1])


def _thinned(time: Reals, values: Reals, buckets: int) -> tuple[Reals, Reals]:
    """(m, n) times and values with the lowest and highest of each of so many stretches kept.

    A page has fewer pixels than a long log has cycles; peaks must not get lost.
    """
    n = len(time)
    if n <= 2 * buckets:
        return np.broadcast_to(time[:, None], values.shape), values
    edges = np.linspace(0, n, buckets + 1).astype(int)
    low, high = np.where(np.isnan(values), np.inf, values), np.where(np.isnan(values), -np.inf, values)
    rows = []
    for a, b in pairwise(edges):
        pair = np.sort(np.stack([a + low[a:b].argmin(axis=0), a + high[a:b].argmax(axis=0)]), axis=0)
        rows.append(pair)
    index = np.concatenate(rows)
    return time[index], np.take_along_axis(values, index, axis=0)


def _plot_hinges(run: Run, axes: Axes, time: Reals, values: Reals, gid: str, width: float = 1.3) -> None:
    at, kept = _drawn(run, time, values)
    n = values.shape[1]
    for i in range(n):
        axes.plot(
            at[:, i],
            kept[:, i],
            color=cell_colour(i, n),
            linestyle=cell_dash(i, n),
            linewidth=width,
            gid=f"{gid}-{i}",
        )


def _draw_angles(run: Run, time: Reals, axes: Axes) -> None:
    _plot_hinges(run, axes, time, np.degrees(run.measured_crease_rad), "measured", 2.4)
    at, commanded = _drawn(run, time, np.degrees(run.commanded_crease_rad))
    for i in range(commanded.shape[1]):
        axes.plot(
            at[:, i],
            commanded[:, i],
            color=INK,
            linewidth=0.9,
            linestyle=(0, (3, 2)),
            gid=f"commanded-{i}",
        )
    axes.set_ylabel("driven crease (°)")


def _draw_errors(run: Run, time: Reals, axes: Axes) -> None:
    error = np.degrees(run.tracking_error_rad)
    _plot_hinges(run, axes, time, error, "error", 0.9)
    axes.set_ylabel("error (°)")
    if np.isfinite(error).any():
        row, hinge = np.unravel_index(int(np.nanargmax(np.abs(error))), error.shape)
        worst = float(error[row, hinge])
        axes.plot([time[row]], [worst], "o", markersize=5.0, markerfacecolor="none", markeredgecolor=INK)
        _note(
            axes,
            float(time[row]),
            worst,
            f"{abs(worst):.2f}° {_short(run.info['hinge_ids'][hinge], 24)}",
            float(time[-1]),
        )
        reach = 1.45 * abs(worst) + 1e-3
        axes.set_ylim(-reach, reach)


def _note(axes: Axes, x: float, y: float, text: str, end: float) -> None:
    left = x > 0.5 * end
    axes.annotate(
        text,
        (x, y),
        (-7.0 if left else 7.0, 7.0 if y > 0.0 else -7.0),
        textcoords="offset points",
        ha="right" if left else "left",
        va="center",
        fontsize=8.0,
        path_effects=[patheffects.withStroke(linewidth=2.5, foreground=PAPER)],
    )


def _draw_spread(run: Run, plan: Plan | None, time: Reals, axes: Axes) -> None:
    """Difference of fold between the cell furthest open and the one furthest behind."""
    floor = 1e-4
    spread = np.maximum(run.fold.max(axis=1) - run.fold.min(axis=1), floor)
    at, kept = _drawn(run, time, spread[:, None])
    axes.plot(at[:, 0], kept[:, 0], color=INK, linewidth=0.9, gid="spread")
    if plan is not None:
        lead = run.fold.max(axis=1)
        limit = [plan.step_tolerance.allowed(float(x)) if np.isfinite(x) else np.nan for x in lead]
        at, kept = _drawn(run, time, np.array(limit)[:, None])
        axes.plot(at[:, 0], kept[:, 0], color=SLIT, linewidth=1.2, linestyle=(0, (4, 2)), gid="spread-limit")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_ylim(floor, 2.0)
    axes.set_ylabel("spread of fold")


def _draw_marks(run: Run, span: float, axes: tuple[Axes, ...]) -> None:
    for colour, marks in (
        (_CONFIRMED, [e for e in latch_events(run) if e.is_confirmation]),
        (SLIT, fault_events(run)),
    ):
        for time_s, label in _gathered(marks, span):
            for a in axes:
                a.axvline(time_s, color=colour, linewidth=1.2, linestyle=(0, (1, 1)), zorder=4)
            late = time_s > 0.03 * span
            axes[0].annotate(
                label,
                (time_s, 0.04),
                (-3.0 if late else 3.0, 0.0),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                rotation=90,
                ha="right" if late else "left",
                va="bottom",
                fontsize=8.0,
                color=colour,
                path_effects=[patheffects.withStroke(linewidth=2.5, foreground=PAPER)],
                zorder=6,
            )


def _gathered(events: Sequence[RunEvent], span: float) -> list[tuple[float, str]]:
    """Times and labels; events too close together for a label each share one."""
    groups: list[list[RunEvent]] = []
    for event in events:
        if groups and event.time_s - groups[-1][0].time_s < 0.03 * span:
            groups[-1].append(event)
        else:
            groups.append([event])
    return [(g[0].time_s, _short(g[0].short, 34) if len(g) == 1 else f"{len(g)} × {g[0].what}") for g in groups]


def _short(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def _add_legends(figure: Figure, run: Run, hinges: list[tuple[str, str, str]], height: float) -> None:
    n = len(hinges)
    lines = [Line2D([], [], color=INK, linewidth=0.9, linestyle=(0, (3, 2)), label="commanded")]
    for i, (hinge, cell, crease) in enumerate(hinges):
        line = Line2D([], [], color=cell_colour(i, n), linestyle=cell_dash(i, n), linewidth=2.4)
        line.set_label(_short(f"{hinge} ({cell} {crease})", 30))
        lines.append(line)
    figure.legend(
        handles=[line for column in range(_LEGEND_COLUMNS) for line in lines[column::_LEGEND_COLUMNS]],  # by rows
        loc="lower center",
        ncols=_LEGEND_COLUMNS,
        handlelength=2.6,
        bbox_to_anchor=(0.53, 0.22 / height),
    )
    seen = dict.fromkeys(run.state)
    shades = [Patch(facecolor=STATE_COLOURS.get(state, PAPER), label=state) for state in seen]
    figure.legend(handles=shades, loc="lower center", ncols=len(shades), bbox_to_anchor=(0.53, 0.0))
