"""The fold as a strip of frames, flat to deployed, all at one scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from ori_deploy.design import ConeStructure, Structure
from ori_deploy.layout import Layout
from ori_deploy.motion import Mechanism, mechanism_of
from ori_deploy.profiles import xy
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.view.cone_views import cone_views
from ori_deploy.view.ink import FAINT, INK, SLIT, cell_colour, edge_colour, house_style

FRAMES: tuple[float, ...] = (0.0, 0.1, 0.25, 0.45, 0.65, 0.85, 1.0)
"""Folds to show: closer together near flat, where the creases turn fastest."""

_MM = 1e3
WIDTH_IN, _HEIGHT_IN = 9.5, 7.6
CAPTION_IN = 0.52
GAP_IN = 0.3
_STEPS_BETWEEN = 8
_NEAR_LARGEST = 0.85


@dataclass(frozen=True)
class Frame:
    """One pose, turned for the eye.

    Attributes
    ----------
    fold
        Of all cells.
    outlines
        Panel polygons, their box's lower left corner at 0; millimetres, of a cone degrees of arc.
    size
        (2,) width and height of the box.
    slit_faces
        Lines along both faces of every slit, placed like the outlines.
    closing_rad, opening_rad
        Smallest and largest inner angle at the closing and at the opening creases.
    """

    fold: float
    outlines: tuple[Points, ...]
    size: Reals
    slit_faces: tuple[Points, ...]
    closing_rad: tuple[float, float]
    opening_rad: tuple[float, float]


def fold_frames(structure: Structure | ConeStructure, folds: Sequence[float] = FRAMES) -> tuple[Frame, ...]:
    """Poses of the strip: the flat stack lies level, the deployed section stands as designed.

    Between two poses a panel can have turned any way, so a frame is turned to match the one before as
    closely as rigid motion can, weighing panels by area; what is then missing from the designed attitude
    is spread evenly over the fold.

    Parameters
    ----------
    folds
        Increasing, from 0 to 1.
    """
    angles = mechanism_of(structure).four_bars.angles(np.asarray(folds))
    faced = np.flatnonzero(structure.layout.is_slit)
    if isinstance(structure, ConeStructure):
        views = cone_views(structure, mechanism_of(structure), folds, faced)
    else:
        views = _plane_views(structure, mechanism_of(structure), folds, faced)
    frames = []
    for k, (fold, (placed, slit_faces)) in enumerate(zip(folds, views, strict=True)):
        every = np.concatenate(placed)
        corner = complex(every.real.min(), every.imag.min())
        frames.append(
            Frame(
                fold=float(fold),
                outlines=tuple(outline - corner for outline in placed),
                size=np.array([np.ptp(every.real), np.ptp(every.imag)]),
                slit_faces=tuple(face - corner for face in slit_faces),
                closing_rad=(float(angles[k, :, 2:].min()), float(angles[k, :, 2:].max())),
                opening_rad=(float(angles[k, :, :2].min()), float(angles[k, :, :2].max())),
            )
        )
    return tuple(frames)


def _plane_views(
    structure: Structure, mechanism: Mechanism, folds: Sequence[float], faced: NDArray[np.intp]
) -> list[tuple[list[Points], list[Points]]]:
    """Panel polygons, and the faces of the panels `faced`, on paper at each fold, millimetres."""
    outlines = structure.panel_outlines()
    turn = _attitudes(structure, mechanism, np.asarray(folds))
    poses = mechanism.poses(folds)
    layout = structure.layout
    edges = np.stack([layout.corners.ravel(), np.roll(layout.corners, -1, axis=1).ravel()], axis=1)
    views = []
    for k in range(len(folds)):

        def place(p: int, points: Points, k: int = k) -> Points:
            return np.asarray(_MM * turn[k] * (poses.turn[p, k] * points + poses.shift[p, k]))

        placed = [place(p, outline) for p, outline in enumerate(outlines)]
        views.append((placed, [place(int(p), structure.embedding.z[edges[p]]) for p in faced]))
    return views


def _attitudes(structure: Structure, mechanism: Mechanism, folds: Reals) -> Points:
    """(n,) unit numbers that turn the poses at `folds` for the eye."""
    pieces = [np.linspace(a, b, _STEPS_BETWEEN, endpoint=False) for a, b in pairwise(folds)]
    fine = np.append(np.concatenate(pieces), folds[-1])
    poses = mechanism.poses(fine)
    middle = np.array([outline.mean() for outline in structure.panel_outlines()])
    place = poses.turn * middle[:, None] + poses.shift
    weight = structure.panel_areas[:, None] / structure.panel_areas.sum()
    place = place - (weight * place).sum(axis=0)
    # Best rotation of each pose onto the one before: of the panels' places, and of the panels themselves.
    own = structure.profile.size**2 / 50.0
    match = (weight * place[:, :-1] * np.conj(place[:, 1:])).sum(axis=0)
    match = match + own * (weight * poses.turn[:, :-1] * np.conj(poses.turn[:, 1:])).sum(axis=0)
    level = np.conj(structure.cells.direction[0, 0] * poses.turn[0, 0])
    turned = level * np.concatenate([[1.0], np.cumprod(match / np.abs(match))])
    # A stack upside down is as level: the shorter way to the designed attitude decides.
    missing = np.angle(np.conj(turned[-1]) ** 2) / 2.0
    upright = np.conj(turned[-1]) * np.exp(-1j * missing)
    return np.asarray((turned * upright * np.exp(1j * missing * fine))[::_STEPS_BETWEEN])


def draw_strip(structure: Structure | ConeStructure) -> Figure:
    """Draw the fold from flat to deployed. Every panel is one polygon with the gid `frame<k>-panel-<id>`."""
    frames = fold_frames(structure)
    with house_style():
        scale, rows = arrange([frame.size for frame in frames])
        heights = [max(frames[k].size[1] for k in row) * scale + CAPTION_IN for row in rows]
        height = sum(heights) + GAP_IN * (len(rows) + 1)
        figure = Figure(figsize=(WIDTH_IN, height))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(0.0, WIDTH_IN)
        axes.set_ylim(0.0, height)
        top = height - GAP_IN
        for row, row_height in zip(rows, heights, strict=True):
            _draw_row(axes, structure, [(k, frames[k]) for k in row], scale, top, row_height)
            top -= row_height + GAP_IN
        unit = "°" if isinstance(structure, ConeStructure) else " mm"
        draw_scale_bar(axes, scale, max(frame.size[0] for frame in frames), unit)
        if structure.layout.slits:
            axes.plot([0.25, 0.6], [0.14, 0.14], color=SLIT, linewidth=1.6)
            axes.text(0.68, 0.14, "faces of the slits", va="center", fontsize=8.0)
    return figure


def arrange(sizes: Sequence[Reals]) -> tuple[float, list[list[int]]]:
    """Inches per millimetre, and which frames go into each row; sizes (2,) are in millimetres.

    Every way to break the strip into rows is tried on a sheet not much taller than wide: of those that
    come near the largest scale, the one with the fewest rows.
    """
    n = len(sizes)
    found = []
    for breaks in product((False, True), repeat=n - 1):
        ends = [0, *(k for k, broken in enumerate(breaks, 1) if broken), n]
        rows = [list(range(a, b)) for a, b in pairwise(ends)]
        found.append((_largest_scale(sizes, rows), rows))
    largest = max(scale for scale, _ in found)
    near = [(scale, rows) for scale, rows in found if scale >= _NEAR_LARGEST * largest]
    return min(near, key=lambda choice: (len(choice[1]), -choice[0]))


def _largest_scale(sizes: Sequence[Reals], rows: list[list[int]]) -> float:
    across = min((WIDTH_IN - GAP_IN * (len(row) + 1)) / sum(sizes[k][0] for k in row) for row in rows)
    tall = sum(max(sizes[k][1] for k in row) for row in rows)
    down = (_HEIGHT_IN - (CAPTION_IN + GAP_IN) * len(rows) - GAP_IN) / tall
    return float(min(across, down))


def _draw_row(
    axes: Axes,
    structure: Structure | ConeStructure,
    row: Sequence[tuple[int, Frame]],
    scale: float,
    top: float,
    height: float,
) -> None:
    layout = structure.layout
    room = WIDTH_IN - sum(frame.size[0] * scale for _, frame in row)
    gap = room / (len(row) + 1)
    x = gap
    body = height - CAPTION_IN
    for k, frame in row:
        width, tall = frame.size * scale
        corner = complex(x, top - 0.5 * (body + tall))
        draw_frame(axes, layout, frame, corner, scale, f"frame{k}")
        _draw_caption(axes, frame, x + 0.5 * width, top - body - 0.1)
        x += width + gap


def draw_frame(axes: Axes, layout: Layout, frame: Frame, corner: complex, scale: float, gid: str) -> None:
    """Draw a frame's panels and slit faces, its lower left corner at `corner`; gids begin with `gid`."""
    for p, outline in enumerate(frame.outlines):
        axes.add_patch(
            Polygon(
                xy(corner + scale * outline),
                closed=True,
                facecolor=cell_colour(p // 4, layout.n_cells),
                edgecolor=edge_colour(p // 4, layout.n_cells),
                linewidth=0.3,
                joinstyle="round",
                gid=f"{gid}-panel-{layout.panel_ids[p]}",
            )
        )
    for face, line in enumerate(frame.slit_faces):
        ends = corner + scale * line
        axes.plot(ends.real, ends.imag, color=SLIT, linewidth=1.1, gid=f"{gid}-slit{face}")


def round_length(most: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not more than `most`: for scale bars."""
    decade = 10.0 ** np.floor(np.log10(most))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= most))


def _draw_caption(axes: Axes, frame: Frame, x: float, y: float) -> None:
    ends = {0.0: " (flat)", 1.0: " (deployed)"}
    axes.text(x, y, f"fold {frame.fold:g}{ends.get(frame.fold, '')}", ha="center", va="top", fontweight="bold")
    closing, opening = _span(frame.closing_rad), _span(frame.opening_rad)
    axes.text(x, y - 0.17, f"closing {closing}\nopening {opening}", ha="center", va="top", fontsize=7.5, color=FAINT)


def _span(angles_rad: tuple[float, float]) -> str:
    low, high = (f"{np.degrees(angle):.0f}" for angle in angles_rad)
    return f"{low}°" if low == high else f"{low}–{high}°"


def draw_scale_bar(axes: Axes, scale: float, widest: float, unit: str = " mm") -> None:
    """A bar of a round length, not more than 0.4 of the widest frame; `scale` is inches per unit."""
    length = round_length(0.4 * widest)
    x, y = WIDTH_IN - 0.25, 0.14
    axes.plot([x - length * scale, x], [y, y], color=INK, linewidth=2.0, solid_capstyle="butt", gid="scale-bar")
    axes.text(x - length * scale - 0.07, y, f"{length:g}{unit}", ha="right", va="center", fontsize=8.0)
