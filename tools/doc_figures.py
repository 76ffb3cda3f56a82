"""Figures of docs/mathematics.md, drawn by the code that they explain."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import FuncFormatter
from shapely.geometry import Polygon as Area

from ori_deploy.design import Structure, build
from ori_deploy.design.continuum import continuum_limit
from ori_deploy.design.creases import rim_thicknesses
from ori_deploy.figures.packaging import balanced_ring, ring_layout
from ori_deploy.files import build_from_file, load_loads
from ori_deploy.layout import layout_of
from ori_deploy.layout import layouts as every_layout
from ori_deploy.loads import Solids, hinge_torques
from ori_deploy.motion import CREASES, Interference, Mechanism, step_tolerance
from ori_deploy.motion.step_tolerance import out_of_step_patterns
from ori_deploy.profiles import Superellipse, xy
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.view.contact_sheet import Entry, draw_contact_sheet
from ori_deploy.view.ink import FAINT, INK, SLIT, cell_colour, house_style
from ori_deploy.view.section import draw_section

EXAMPLES = Path(__file__).parents[1] / "examples"
_MM = 1e3


@cache
def example(name: str) -> Any:
    """The structure of a shipped specification."""
    return build_from_file(EXAMPLES / f"{name}.toml")[1]


def _sheet(width: float, height: float, columns: int = 1) -> tuple[Figure, Any]:
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(1, columns)


def _cell_axes(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.axis("off")


def _name(axes: Axes, z: complex, words: str, shift: tuple[float, float], colour: str = INK) -> None:
    axes.annotate(
        words, (z.real, z.imag), xytext=shift, textcoords="offset points", ha="center", va="center", color=colour,
        fontsize=11.0, parse_math=True,
    )  # fmt: skip


def layouts() -> Figure:
    """Every layout of four cells."""
    found = [layout_of(tree) for tree in every_layout(4)]
    entries = [Entry(layout, f"{k + 1}") for k, layout in enumerate(found)]
    return draw_contact_sheet(entries, title="Every layout of four cells", total=len(entries))


def embedding() -> Figure:
    """A layout on a profile, built."""
    return draw_section(example("ellipse_6"))


def cell() -> Figure:
    """One cell of an ellipse with a wall that can be seen: its vertices, creases, h and t."""
    s = _thick()
    k, cells, e = 0, _thick().cells, _thick().embedding
    ids = [e.layout.vertices[i].id for i in e.layout.cells[k]]
    q1, q2, q3, q4 = (complex(e.z[i]) for i in e.layout.cells[k])
    c2, c4, v1, v3 = (complex(z) for z in cells.crease[k])
    with house_style():
        figure, axes = _sheet(7.0, 3.6)
        for p, outline in enumerate(s.panel_outlines()[4 * k : 4 * k + 4]):
            tint = (0.85, 0.6, 0.6, 0.85)[p]
            axes.add_patch(Polygon(_MM * xy(outline), facecolor=cell_colour(0, 4), alpha=tint, edgecolor="white"))
        skin = _MM * s.profile.point(np.linspace(0.0, s.profile.period, 400))
        axes.plot(skin.real, skin.imag, color=FAINT, linewidth=1.0)
        for z, words, shift in (
            (q1, "$q_1$", (-12, -8)), (q2, "$q_2$", (10, -8)), (q3, "$q_3$", (12, 8)), (q4, "$q_4$", (-12, 8)),
        ):  # fmt: skip
            axes.plot(_MM * z.real, _MM * z.imag, "o", color=INK, markersize=4)
            _name(axes, _MM * z, words, shift)
        for z, words, shift in (
            (c2, "$c_2$", (14, 4)), (c4, "$c_4$", (6, 13)), (v1, "$v_1$", (13, 6)), (v3, "$v_3$", (-13, -6)),
        ):  # fmt: skip
            axes.plot(_MM * z.real, _MM * z.imag, "o", color=SLIT, markersize=4)
            _name(axes, _MM * z, words, shift, SLIT)
        ring = _MM * np.array([v1, c2, v3, c4, v1])
        axes.plot(ring.real, ring.imag, color=SLIT, linewidth=1.0, linestyle=(0, (4, 2)))
        around = _MM * np.array([q1, q2, q3, q4, c2, c4])
        pad = 0.12 * np.ptp(around.real)
        axes.set_xlim(around.real.min() - pad, around.real.max() + pad)
        axes.set_ylim(around.imag.min() - pad, around.imag.max() + pad)
        _cell_axes(axes)
        axes.set_title(f"a cell ({', '.join(ids)}); dashed: the four-bar through its creases")
    return figure


@cache
def _thick() -> Structure:
    return build(example("ellipse_4").embedding, 0.004)


def crease() -> Figure:
    """Equation (1): both panels' rim thickness over the place of the crease, and where they meet."""
    s = example("ellipse_4")
    k = 0
    w, root = float(s.corner.s_w[k]), float(s.opening.s[k])
    far = float(s.corner.s_after[k] if s.corner.curved_after[k] else s.corner.s_before[k])
    at = np.linspace(w, w + 0.75 * (far - w), 80)
    rows = []
    for here in at:
        every = s.corner.s_w.copy()
        every[k] = here
        before, after, *_ = rim_thicknesses(s.profile, s.corner, every)
        rows.append((before[k], after[k]))
    curves = _MM * np.array(rows)
    curved = 1 if s.corner.curved_after[k] else 0
    with house_style():
        figure, axes = _sheet(6.5, 3.4)
        axes.plot(at, curves[:, 1 - curved], color=cell_colour(1, 4), label="straight panel: distance to its edge")
        axes.plot(at, curves[:, curved], color=cell_colour(0, 4), label="curved panel: bulge over its chord")
        axes.plot(root, _MM * float(s.opening.rim[k]), "o", color=SLIT)
        axes.annotate("crease", (root, _MM * float(s.opening.rim[k])), xytext=(8, 10), textcoords="offset points")
        axes.set_xlabel("parameter of the crease on the outline")
        axes.set_ylabel("rim thickness (mm)")
        axes.legend()
    return figure


def sphere() -> Figure:
    """A cone's cells, as seen from the apex."""
    return draw_section(example("cone_elliptic_6"))


def fourbar() -> Figure:
    """Angles of one cell's creases over its fold, with a wall and without."""
    fold = np.linspace(0.0, 1.0, 401)
    with house_style():
        figure, (left, right) = _sheet(9.0, 3.4, 2)
        for wall, dashes in ((0.004, "-"), (0.0, (0, (4, 2)))):
            bars = Mechanism(build(example("ellipse_4").embedding, wall)).four_bars
            angles, rates = np.degrees(bars.angles(fold)[:, 0]), bars.transmission(fold[1:])[:, 0]
            for c, name in enumerate(CREASES):
                words = name if wall else None
                left.plot(fold, angles[:, c], color=cell_colour(c, 4), linestyle=dashes, label=words)
            ratio = np.abs(rates[:, 2]) / np.abs(rates[:, 3])
            right.plot(fold[1:], ratio, color=INK, linestyle=dashes, label=f"wall {_MM * wall:g} mm")
        left.set_xlabel("fold")
        left.set_ylabel("inner angle (°)")
        left.legend()
        right.set_xlabel("fold")
        right.set_ylabel("turn of close_a / turn of close_b")
        right.set_ylim(0.0, None)
        right.legend()
    return figure


def interference() -> Figure:
    """The same structure with its cells in step, and out of step as far and as badly as can be."""
    s = _thick()
    mechanism = Mechanism(s)
    patterns = out_of_step_patterns(Interference(mechanism))
    apart = 0.95 - 0.5 * (1.0 - patterns)
    worst = max(apart, key=lambda fold: sum(shared.area for shared in _overlaps(_placed(s, mechanism, fold))))
    with house_style():
        figure, sheets = _sheet(9.0, 3.6, 2)
        for axes, fold, words in zip(
            sheets, (np.full(s.layout.n_cells, 0.9), worst), ("in step", "out of step"), strict=True
        ):
            placed = _placed(s, mechanism, fold)
            for p, outline in enumerate(placed):
                colour = cell_colour(p // 4, s.layout.n_cells)
                axes.add_patch(Polygon(_MM * xy(outline), facecolor=colour, alpha=0.6))
            shared = _overlaps(placed)
            for piece in shared:
                axes.add_patch(Polygon(_MM * np.array(piece.exterior.coords), facecolor=SLIT, edgecolor=SLIT))
            axes.autoscale_view()
            _cell_axes(axes)
            axes.set_title(f"{words}: {'panels cut into each other' if shared else 'free'}")
    return figure


def _placed(s: Structure, mechanism: Mechanism, fold: Reals) -> list[Points]:
    """Panel outlines where one fold vector (n_cells,) puts them."""
    poses = mechanism.poses(fold[None])
    return [poses.turn[p, 0] * outline + poses.shift[p, 0] for p, outline in enumerate(s.panel_outlines())]


def _overlaps(placed: list[Points]) -> list[Any]:
    """What two panels share; rounding along bonded edges left out."""
    areas = [Area(xy(outline)).buffer(0.0) for outline in placed]
    shared = (a.intersection(b) for a, b in combinations(areas, 2))
    pieces = [piece for some in shared for piece in getattr(some, "geoms", [some]) if piece.geom_type == "Polygon"]
    return [piece for piece in pieces if piece.area > 1e-8]


def tolerance() -> Figure:
    """How far cells may be out of step, for a thin and a thick wall."""
    with house_style():
        figure, axes = _sheet(6.5, 3.2)
        for k, wall in enumerate((0.0005, 0.002)):
            found = step_tolerance(Interference(Mechanism(build(example("ellipse_4").embedding, wall))))
            axes.step(found.lead, found.spread, where="pre", color=cell_colour(k, 4), label=f"wall {_MM * wall:g} mm")
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_xlabel("fold of the cell furthest open")
        axes.set_ylabel("spread of fold that is free")
        axes.legend()
    return figure


def packaging() -> Figure:
    """Equal cells on a circle, without wall, against equation (8)."""
    with house_style():
        figure, axes = _sheet(6.5, 3.4)
        for k, aspect in enumerate((1.0, 0.6, 0.4)):
            limit = continuum_limit(Superellipse(1.0, aspect))
            n = np.arange(4, 17)
            eta = [build(balanced_ring(limit, ring_layout(int(m)), 0.5), 0.0).eta for m in n]
            axes.plot(n, limit.eta_per_cell * n, color=cell_colour(k, 4), linewidth=0.9)
            axes.plot(n, eta, "o", color=cell_colour(k, 4), markersize=4, label=f"ellipse 1 : {aspect:g}")
        axes.set_xlabel("cells")
        axes.set_ylabel("packaging ratio eta")
        axes.legend(title="lines: equation (8)")
    return figure


def work() -> Figure:
    """What drives of the example wing have to overcome, and of what it is made."""
    s = example("wing_naca2412")
    fold = np.linspace(0.0, 1.0, 201)
    loads = load_loads(EXAMPLES / "loads_wing.toml")
    found = hinge_torques(Mechanism(s), Solids.of(s, 1.26), loads, np.full(s.layout.n_cells, 2), fold)
    with house_style():
        figure, axes = _sheet(6.5, 3.4)
        parts = (("weight", found.gravity), ("film", found.film), ("air", found.air), ("friction", found.friction))
        for k, (words, torque) in enumerate(parts):
            axes.plot(fold, torque[:, 2], color=cell_colour(k, 4), label=words)
        axes.set_xlabel("fold")
        axes.set_ylabel("torque at close_a of c3 (N m)")
        axes.legend()
    return figure


FIGURES: Mapping[str, Callable[[], Figure]] = {
    f"math-{draw.__name__}.png": draw
    for draw in (layouts, embedding, cell, crease, sphere, fourbar, interference, tolerance, packaging, work)
}
