"""What every figure consists of: pictures, the data behind them, and a line about what came out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.figure import Figure

from ori_deploy import figures as data
from ori_deploy.figures.optima import PAPER_ETA
from ori_deploy.figures.optima import STARTS as OPTIMUM_STARTS
from ori_deploy.figures.packaging import ASPECTS, COUNTS
from ori_deploy.figures.packaging import STARTS as PACKAGING_STARTS
from ori_deploy.figures.walls import LEAST_CELLS, MOST_CELLS, WALLS, wall_shapes
from ori_deploy.figures.walls import STARTS as WALL_STARTS
from ori_deploy.figures.wing import PLAIN
from ori_deploy.files import write_atomically
from ori_deploy.search.many import Result
from ori_deploy.view import draw_spanwise, draw_strip, to_png, to_svg
from ori_deploy.view.fold_rows import FoldRow, draw_fold_rows
from ori_deploy.view.heatmap import draw_heatmap
from ori_deploy.view.packaging_curves import draw_packaging, draw_walls
from ori_deploy.view.sheet import add_head
from ori_deploy.view.spars import draw_sparred_section

_FOLDS = (0.0, 0.12, 0.35, 0.65, 1.0)
_MM = 1e3


class Steps(Protocol):
    """Where a figure tells how far it is; every call may raise KeyboardInterrupt."""

    def expect(self, steps: int) -> None:
        """How many steps there will be at most."""

    def step(self, result: Result | None = None) -> None:
        """One of them is done."""


@dataclass(frozen=True)
class Effort:
    """How much to spend.

    Attributes
    ----------
    workers
        Processes for searches.
    quick
        Few points and few starts: a preview.
    """

    workers: int
    quick: bool = False


@dataclass(frozen=True)
class Made:
    """One figure.

    Attributes
    ----------
    told
        What came out, in a line.
    tables, sheets
        Data and pictures by the stem of their files; no pictures where it was interrupted.
    interrupted
        Whether some of the data are missing.
    """

    told: str
    tables: dict[str, data.Table]
    sheets: dict[str, Figure] = field(default_factory=dict)
    interrupted: bool = False

    def write(self, folder: Path, *, preview: bool = False) -> list[Path]:
        """Write everything, each file whole or not at all.

        The data of an interrupted figure go to NAME.part.csv. A preview says so on every picture, and all its
        files are NAME.quick.*: it never takes the place of the real figure.
        """
        quick = ".quick" if preview else ""
        ending = f"{quick}.part.csv" if self.interrupted else f"{quick}.csv"
        written = []
        for stem, table in self.tables.items():
            if table.rows:
                written.append(folder / f"{stem}{ending}")
                write_atomically(written[-1], table.csv())
        for stem, sheet in self.sheets.items():
            if preview:
                add_head(sheet, f"{stem}: PREVIEW, made with --quick")
            written += [folder / f"{stem}{quick}.png", folder / f"{stem}{quick}.svg"]
            write_atomically(written[-2], to_png(sheet))
            write_atomically(written[-1], to_svg(sheet))
        if not self.interrupted:
            for stem in self.tables:
                (folder / f"{stem}{quick}.part.csv").unlink(missing_ok=True)
        return written


def _fig3(effort: Effort, steps: Steps) -> Made:
    del effort
    steps.expect(len(data.PROTOTYPES) + 1)
    built = []
    for name, _ in data.PROTOTYPES:
        built.append(data.shipped_prototype(name))
        steps.step()
    rows = [FoldRow(p.name, _described(p), p.design.structure) for p in built]
    sheet = draw_fold_rows(rows, _FOLDS)
    steps.step()
    etas = ", ".join(f"{p.name} {p.eta:.3g}" for p in built)
    return Made(f"eta: {etas}", {"fig3": data.prototype_table(built)}, {"fig3": sheet})


def _described(p: data.Prototype) -> str:
    structure, design = p.design.structure, p.design
    wall = f"wall {_MM * p.wall_m:.3g} mm" + (
        f" at radius {design.r_max_m:g} m" if design.entries.kind == "cone" else ""
    )
    return (
        f"{structure.layout.n_cells} cells, {wall}, η {p.eta:.3f}, box ratio {p.box_ratio:.3f}, "
        f"smallest dead-centre margin {np.degrees(p.margin_rad):.1f}°"
    )


def _fig4a(effort: Effort, steps: Steps) -> Made:
    starts = 1 if effort.quick else OPTIMUM_STARTS
    steps.expect(starts * len(PAPER_ETA))
    optima = [data.optimum(n, starts=starts, workers=effort.workers, watch=steps.step) for n in PAPER_ETA]
    rows = [
        FoldRow(
            f"{o.n_cells} cells",
            f"η {o.structure.eta:.4f} (paper: {o.paper_eta:g}), vertices optimised, no wall",
            o.structure,
        )
        for o in optima
    ]
    told = ", ".join(f"eta {o.structure.eta:.4f} with {o.n_cells} cells (paper {o.paper_eta:g})" for o in optima)
    return Made(told, {"fig4a": data.optimum_table(optima)}, {"fig4a": draw_fold_rows(rows, _FOLDS, one_scale=True)})


def _fig4c(effort: Effort, steps: Steps) -> Made:
    aspects, counts, starts = (ASPECTS[1:3], (4, 6), 1) if effort.quick else (ASPECTS, COUNTS, PACKAGING_STARTS)
    steps.expect(len(aspects) * len(counts) * starts)
    points, interrupted = data.packaging_points(
        aspects, counts, starts=starts, workers=effort.workers, watch=steps.step
    )
    tables = {"fig4c": data.packaging_table(points)}
    if interrupted:
        return Made(f"{len(points)} searches", tables, interrupted=True)
    best = max(counts)
    reached = [p.eta / p.limit for p in points if p.best and p.n_cells == best]
    told = f"{len(points)} searches; at n = {best} eta is {min(reached):.3f} to {max(reached):.3f} of (8)"
    return Made(told, tables, {"fig4c": draw_packaging(points)})


def _fig4d(effort: Effort, steps: Steps) -> Made:
    del effort
    steps.expect(1)
    found = data.efficiency_map()
    sheet = draw_heatmap(
        found.exponent, found.aspect, found.eta_per_cell,
        x_label="exponent m", y_label="aspect γ", value_label="packaging ratio per cell, equation (8)",
    )  # fmt: skip
    steps.step()
    low, high = found.eta_per_cell.min(), found.eta_per_cell.max()
    return Made(f"{low:.4f} to {high:.4f} per cell", {"fig4d": data.efficiency_table(found)}, {"fig4d": sheet})


def _fig5(effort: Effort, steps: Steps) -> Made:
    del effort
    steps.expect(4)
    wing = data.wing()
    span = wing if wing.folding is not None else data.wing(PLAIN)
    steps.step()
    sheets = {"fig5_section": draw_sparred_section(wing.structure, wing.spars)}
    steps.step()
    sheets["fig5_fold"] = draw_strip(wing.structure)
    steps.step()
    told = (
        f"{wing.built.design.name}: {len(wing.spars)} vertical spars, eta {wing.built.eta:.4f} (paper 2.13), "
        f"wall {_MM * wing.built.wall_m:.3g} mm"
    )
    if span.folding is not None:
        sheets["fig5_span"] = draw_spanwise(span.folding)
        if span is not wing:
            sheets["fig5_span"].text(0.02, 0.985, f"stand-in: {span.built.design.name}, without spars", va="top")
        told += f", span to 1/{span.folding.segments}"
    if wing.refused:
        told += f" shown of {span.built.design.name}: its own folded stack has no room for piano hinges"
    steps.step()
    tables = {"fig5": data.wing_summary_table(wing, span), "fig5_vertices": data.wing_vertex_table(wing)}
    return Made(told, tables, sheets)


def _walls(effort: Effort, steps: Steps) -> Made:
    walls, most, starts = ((0.0, 0.02), 4, 1) if effort.quick else (WALLS, MOST_CELLS, WALL_STARTS)
    steps.expect(len(wall_shapes()) * len(walls) * (most - LEAST_CELLS + 1) * (starts + 3))
    points, interrupted = data.wall_points(walls, most, starts=starts, workers=effort.workers, watch=steps.step)
    tables = {"walls": data.wall_table(points)}
    if interrupted:
        return Made(f"{len(points)} structures", tables, interrupted=True)
    ended = [row for row in data.wall_rows(points) if row.ended_by]
    told = f"{len(points)} numbers of cells, {len(ended)} rows end"
    return Made(told, tables, {"walls": draw_walls(points)})


MAKERS: dict[str, Callable[[Effort, Steps], Made]] = {
    "fig3": _fig3,
    "fig4a": _fig4a,
    "fig4c": _fig4c,
    "fig4d": _fig4d,
    "fig5": _fig5,
    "walls": _walls,
}
