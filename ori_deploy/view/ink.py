"""How everything that is drawn looks: colours, type, line weights.

Cells are told apart by the Okabe-Ito colours, which colour-blind readers tell apart too, without its
yellow and black: yellow lines vanish on white, black is the outline's.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Literal

import matplotlib.style
from matplotlib.colors import to_hex, to_rgb

INK = "#16202e"
"""Text, outlines and markers."""
FAINT = "#6b7684"
"""Axes, captions, bonds."""
SLIT = "#d4002a"
"""Slits and faults: what a person must not overlook."""
PAPER = "#ffffff"

Dash = Literal["-"] | tuple[float, tuple[float, ...]]

_CELLS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#8c8c8c")
_DASHES: tuple[Dash, ...] = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 1.5, 1.5, 1.5)))

_HOUSE: dict[str, object] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same everywhere
    "mathtext.fontset": "dejavusans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e7ec",
    "grid.linewidth": 0.7,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.solid_capstyle": "round",
    "text.color": INK,
    "text.parse_math": False,  # names come from files: a dollar sign is a dollar sign
    "figure.facecolor": PAPER,
    "svg.fonttype": "path",  # the same letters on every machine
    "svg.hashsalt": "ori-deploy",  # the same bytes in every run
}


def house_style() -> AbstractContextManager[None]:
    """Matplotlib's own defaults with the house's on top, whatever the user's settings; undone at the end."""
    return matplotlib.style.context(["default", _HOUSE])


def _period(n_cells: int) -> int:
    """How many colours to use so that the first and the last cell of a ring differ."""
    full = len(_CELLS)
    return next((k for k in (full, full - 1, full - 2) if n_cells <= k or n_cells % k != 1), full)


def cell_colour(cell: int, n_cells: int) -> str:
    """Colour of a cell, the same in every figure of a structure of `n_cells`."""
    return _CELLS[cell % _period(n_cells)]


def cell_dash(cell: int, n_cells: int) -> Dash:
    """Dash pattern of a cell's line: where colours come round again, dashes differ."""
    return _DASHES[cell // _period(n_cells) % len(_DASHES)]


def edge_colour(cell: int, n_cells: int) -> str:
    """Colour for the rims of a cell's panels: its own, darkened."""
    own, ink = to_rgb(cell_colour(cell, n_cells)), to_rgb(INK)
    red, green, blue = (0.6 * a + 0.4 * b for a, b in zip(own, ink, strict=True))
    return to_hex((red, green, blue))
