"""Layouts side by side, each drawn straight: which there are, at a glance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ori_deploy.layout import Layout
from ori_deploy.profiles import xy
from ori_deploy.profiles.profile import Points
from ori_deploy.view.ink import FAINT, INK, PAPER, SLIT, cell_colour, house_style

MOST_DRAWN = 400
"""Layouts on one sheet; beyond it a page is slow to open and nobody looks at all of it."""

_WIDTH_IN = 9.5
_LARGEST_IN = 3.6
"""Width of one drawing where there are few."""
_COLUMNS = ((4, 4), (12, 5), (30, 6), (80, 8), (MOST_DRAWN, 12))
"""Up to so many layouts, so many to a row."""
_NAMED = 12
"""Up to so many layouts their vertices are named; more would leave no room."""
_TINT, _PALE = 0.5, 0.82
"""Share of white in a cell's colour: marks and captions have to stand out on it."""
_LETTER = 0.64
"""Width of a digit over the size of the type."""
_ARC_STEP = 0.06
"""Turn between points of a drawn arc, radians: its sagitta is below a thousandth of the radius."""
_PITCH, _CAPTION, _RADIUS = 2.7, 0.62, 1.0
"""Distance between drawings, room for the caption, and the outline's radius, in one unit."""
_SLIT_DASHES = (0, (2.2, 1.1))


@dataclass(frozen=True)
class Entry:
    """One drawing of a sheet.

    Attributes
    ----------
    layout
        With the slits to mark.
    caption
        One or two lines below it.
    places
        (n_vertices,) where its vertices are, in any unit; on a circle if left out.
    """

    layout: Layout
    caption: str
    places: Points | None = None


def on_circle(layout: Layout) -> Points:
    """(n_vertices,) a straight drawing without crossings: outline vertices evenly on the unit circle.

    An inner vertex is at the mean of its neighbours (W. T. Tutte, How to draw a graph, 1963). They are
    all on the outline if it is closing, and no two inner vertices' hulls overlap; so its edges cross
    nothing, and no system of equations is needed. The middle of the outline's first run is at the top.
    """
    z = np.zeros(len(layout.vertices), dtype=np.complex128)
    loop = list(layout.outline)
    z[loop] = np.exp(2j * np.pi * (np.arange(len(loop)) / len(loop) + 0.25))
    tail, head = layout.corners.ravel(), np.roll(layout.corners, -1, axis=1).ravel()
    for i, v in enumerate(layout.vertices):
        if v.inner:
            z[i] = z[head[tail == i]].mean()
    return z


def draw_contact_sheet(entries: Sequence[Entry], *, title: str, total: int) -> Figure:
    """Draw layouts in rows: cells tinted, closing vertices dark diamonds, opening ones white circles, slits dashed.

    A layout that cannot fold flat with its slits is drawn paler.

    Parameters
    ----------
    entries
        Only the first `MOST_DRAWN` are drawn.
    title
        What they are.
    total
        How many there are. Where that is more than are drawn, the sheet says so.
    """
    shown = entries[:MOST_DRAWN]
    columns = max(1, min(len(shown), next(c for most, c in _COLUMNS if len(shown) <= most)))
    rows = max(-(-len(shown) // columns), 1)
    inch = min(_WIDTH_IN / (columns * _PITCH), _LARGEST_IN / _PITCH)
    head, foot = 0.5, 0.55
    height = rows * (_PITCH + _CAPTION) * inch + head + foot
    side = 0.5 * (_WIDTH_IN / inch - columns * _PITCH)
    with house_style():
        figure = Figure(figsize=(_WIDTH_IN, height))
        axes = figure.add_axes((0.0, foot / height, 1.0, (height - head - foot) / height))
        axes.set_xlim(-side, columns * _PITCH + side)
        axes.set_ylim(-rows * (_PITCH + _CAPTION), 0.0)
        axes.axis("off")
        places = [_place(k, columns) for k in range(len(shown))]
        _draw(axes, [_Drawing.of(entry, at) for entry, at in zip(shown, places, strict=True)], 72.0 * inch)
        left_out = f": the first {len(shown)} are drawn" if total > len(shown) else ""
        figure.text(
            0.18 / _WIDTH_IN, 1.0 - 0.3 / height, title + left_out, fontsize=11.0, fontweight="bold", va="center"
        )
        _add_legend(figure, any(e.layout.slits for e in shown))
    return figure


def _place(k: int, columns: int) -> complex:
    """The middle of the k-th drawing."""
    row, column = divmod(k, columns)
    return complex((column + 0.5) * _PITCH, -row * (_PITCH + _CAPTION) - 0.5 * _PITCH - 0.08)


@dataclass(frozen=True)
class _Drawing:
    """An entry in its place on the sheet: polygons and lines as (n, 2) points."""

    cells: list[NDArray[np.float64]]
    tints: list[tuple[float, float, float]]
    outline: NDArray[np.float64]
    bonds: list[NDArray[np.float64]]
    slits: list[NDArray[np.float64]]
    closing: Points
    opening: Points
    caption: str
    below: complex
    pale: bool
    names: list[tuple[complex, complex, str]]
    """Where each vertex is, which way its name goes, and the name."""

    @classmethod
    def of(cls, entry: Entry, middle: complex) -> _Drawing:
        layout = entry.layout
        z = _fitted(on_circle(layout) if entry.places is None else entry.places)
        side = _arcs(layout, z) if entry.places is None else {}
        pale = bool(layout.overfull_vertices)
        loop = layout.outline
        closing = np.array([v.role == "closing" for v in layout.vertices])
        return cls(
            cells=[xy(_along(cell, z, side) + middle) for cell in layout.cells],
            tints=[_tint(i, layout.n_cells, _PALE if pale else _TINT) for i in range(layout.n_cells)],
            outline=xy(_along((*loop, loop[0]), z, side) + middle),
            bonds=[xy(z[list(edge)] + middle) for edge in _bonds(layout)],
            slits=[xy(z[list(edge)] + middle) for edge in layout.slits],
            closing=z[closing] + middle,
            opening=z[~closing] + middle,
            caption=entry.caption,
            below=middle - 1j * (_RADIUS + 0.3),
            pale=pale,
            names=[(z[i] + middle, _outwards(z[i], v.inner), v.id) for i, v in enumerate(layout.vertices)],
        )


def _outwards(z: complex, inner: bool) -> complex:
    """Unit direction from the drawing's middle; 0 for what is not at its rim."""
    return 0j if inner or abs(z) < 1e-3 * _RADIUS else complex(z / abs(z))


def _arcs(layout: Layout, z: Points) -> dict[tuple[int, int], Points]:
    """Points between the ends of every outline edge, on the circle."""
    loop = layout.outline
    found = {}
    for a, b in zip(loop, (*loop[1:], loop[0]), strict=True):
        turn = float(np.angle(z[b] / z[a])) % (2.0 * np.pi)
        found[a, b] = z[a] * np.exp(1j * turn * np.linspace(0.0, 1.0, 2 + int(turn / _ARC_STEP))[1:-1])
    return found


def _along(loop: Sequence[int], z: Points, side: dict[tuple[int, int], Points]) -> Points:
    """The points of a walk over vertices, along the outline where it runs there."""
    none = np.empty(0, dtype=np.complex128)
    after = (*loop[1:], loop[0])
    return np.concatenate([p for a, b in zip(loop, after, strict=True) for p in (z[[a]], side.get((a, b), none))])


def _draw(axes: Axes, drawings: Sequence[_Drawing], point: float) -> None:
    """Everything of one kind in one go: a path per cell, not an axes per layout.

    Parameters
    ----------
    point
        Points of type per unit of the sheet.
    """
    line = float(np.clip(0.02 * point, 0.45, 1.2))
    fills = [cell for d in drawings for cell in d.cells]
    tints = [tint for d in drawings for tint in d.tints]
    axes.add_collection(PolyCollection(fills, facecolors=tints, edgecolors="none", gid="cells", zorder=1))
    bonds = [bond for d in drawings for bond in d.bonds]
    slits = [slit for d in drawings for slit in d.slits]
    for name, lines, colour, width in (
        ("outline", [d.outline for d in drawings], INK, 1.3 * line),
        ("bonds", bonds, INK, 0.7 * line),
        ("slit-halos", slits, PAPER, 3.6 * line),
    ):
        axes.add_collection(LineCollection(lines, colors=colour, linewidths=width, gid=name, zorder=2))
    axes.add_collection(
        LineCollection(slits, colors=SLIT, linewidths=2.2 * line, linestyles=[_SLIT_DASHES], gid="slits", zorder=3)
    )
    marks: dict[str, Any] = {"linestyle": "none", "markersize": float(np.clip(0.09 * point, 1.5, 5.2)), "zorder": 4}
    none = [np.empty(0, dtype=np.complex128)]
    for name, places, style in (
        ("opening", [d.opening for d in drawings], _OPENING),
        ("closing", [d.closing for d in drawings], _CLOSING),
    ):
        z = np.concatenate(places or none)
        axes.plot(z.real, z.imag, gid=name, **marks, **style)
    size = float(np.clip(0.115 * point, 3.6, 8.0))
    for d in drawings:
        axes.text(
            d.below.real,
            d.below.imag,
            _wrapped(d.caption, int(0.95 * _PITCH * point / (_LETTER * size))),
            ha="center",
            va="top",
            fontsize=size,
            linespacing=1.25,
            color=FAINT if d.pale else INK,
        )
    if len(drawings) <= _NAMED:
        _name_vertices(axes, drawings, size)


def _wrapped(text: str, letters: int) -> str:
    """Lines of so many letters at most, broken anywhere: codes have no spaces."""
    return "\n".join(line[i : i + letters] for line in text.splitlines() for i in range(0, len(line), letters))


def _name_vertices(axes: Axes, drawings: Sequence[_Drawing], size: float) -> None:
    """Outside the outline, or on an inner vertex's right."""
    halo = [patheffects.withStroke(linewidth=2.0, foreground=PAPER)]
    for z, away, name in (entry for d in drawings for entry in d.names):
        reach = size * (complex(1.6 * away.real, 1.4 * away.imag) or 1.1 - 0.75j)
        axes.annotate(
            name,
            (z.real, z.imag),
            (reach.real, reach.imag),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=size,
            color=INK if away == 0 else FAINT,
            path_effects=halo,
            zorder=3.5,
        )


_OPENING: dict[str, Any] = {
    "marker": "o",
    "markerfacecolor": PAPER,
    "markeredgecolor": INK,
    "markeredgewidth": 0.8,
}
_CLOSING: dict[str, Any] = {
    "marker": "D",
    "markerfacecolor": INK,
    "markeredgecolor": PAPER,
    "markeredgewidth": 0.4,
}


def _fitted(z: Points) -> Points:
    """Moved and scaled into a circle of `_RADIUS` about 0."""
    low, high = complex(z.real.min(), z.imag.min()), complex(z.real.max(), z.imag.max())
    away = z - 0.5 * (low + high)
    return np.asarray(away * (_RADIUS / np.abs(away).max()))


def _tint(cell: int, n_cells: int, white: float) -> tuple[float, float, float]:
    red, green, blue = (white + (1.0 - white) * c for c in to_rgb(cell_colour(cell, n_cells)))
    return red, green, blue


def _bonds(layout: Layout) -> list[tuple[int, int]]:
    tail, head = layout.corners.ravel(), np.roll(layout.corners, -1, axis=1).ravel()
    once = np.flatnonzero(layout.bonded_to > np.arange(layout.n_panels))
    return [(int(tail[p]), int(head[p])) for p in once]


def _add_legend(figure: Figure, any_slit: bool) -> None:
    entries = [
        Line2D([], [], linestyle="none", markersize=5.2, label="closing vertex", **_CLOSING),
        Line2D([], [], linestyle="none", markersize=5.2, label="opening vertex", **_OPENING),
        Line2D([], [], color=INK, linewidth=1.5, label="outline"),
        Line2D([], [], color=INK, linewidth=0.8, label="bond"),
    ]
    if any_slit:
        entries.append(Line2D([], [], color=SLIT, linewidth=2.4, linestyle=_SLIT_DASHES, label="slit"))
    figure.legend(handles=entries, loc="lower center", ncols=5, columnspacing=2.0, labelcolor=FAINT)
