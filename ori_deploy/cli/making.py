"""`ori-deploy design | plan | poses`: from a shape to a structure, its motion, and where its panels are."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from scipy.spatial.transform import Rotation

from ori_deploy.cli.frame import IN, OUT, example, named_after, print_table, warn
from ori_deploy.cli.optimise import Request, default_workers
from ori_deploy.cli.spanwise import design_rows, plan_rows, span_poses
from ori_deploy.cli.steps import (
    DESIGN_ENDING,
    PLAN_ENDING,
    SPEC_ENDING,
    make_design,
    make_optimum,
    make_plan,
)
from ori_deploy.errors import InputError
from ori_deploy.files import Design, load_design, pose_data
from ori_deploy.motion import Plan

LARGE_M = 50.0
"""What is larger than that was probably meant in millimetres."""


@click.command(epilog=example("ori-deploy design examples/wing_naca2412.toml -o wing.design.json"))
@click.argument("spec", type=IN)
@click.option("-o", "--output", type=OUT, help="Design file to write.  [default: NAME.design.json]")
@click.option("--optimize", is_flag=True, help="Move the vertices to where the wish in [optimize] is met best.")
@click.option("--starts", type=click.IntRange(1, 100_000), help="Local searches per layout.  [default: 8]")
@click.option("--cells", type=click.IntRange(1, 200), help="Number of cells, instead of the layout in SPEC: a ring.")
@click.option("--search-layouts", is_flag=True, help="Try every layout of --cells cells.")
@click.option("--save-spec", type=OUT, help="Write what was found as a specification, too.")
@click.option("--seed", type=click.IntRange(0), help="Of starts that are drawn at random.  [default: 0]")
@click.option("--workers", type=click.IntRange(1, 1024), help="Processes.  [default: one per processor]")
def design(
    spec: Path,
    output: Path | None,
    optimize: bool,
    starts: int | None,
    cells: int | None,
    search_layouts: bool,
    save_spec: Path | None,
    seed: int | None,
    workers: int | None,
) -> None:
    """Build the structure that SPEC describes, or the best near it.

    Ctrl-C ends a search early and keeps the best found so far.
    """
    path = output or named_after(spec, SPEC_ENDING, DESIGN_ENDING)
    if not optimize:
        for name, value in (
            ("--starts", starts),
            ("--cells", cells),
            ("--search-layouts", search_layouts or None),
            ("--save-spec", save_spec),
            ("--seed", seed),
            ("--workers", workers),
        ):
            if value is not None:
                raise InputError(f"{name}: goes with --optimize", remedy="add --optimize")
        _print_design(make_design(spec, path))
        return
    request = Request(starts or 8, cells, search_layouts, seed or 0, workers or default_workers())
    made, rows = make_optimum(spec, path, request, save_spec)
    _print_design(made, rows)


def _print_design(made: tuple[Design, dict[str, Any], Path], more: Sequence[tuple[str, str]] = ()) -> None:
    built, data, path = made
    s, packaging = built.structure, data["packaging"]
    margin = float(np.degrees(s.cells.dead_centre_margin.min()))
    box = " x ".join(f"{1e3 * side:.1f}" for side in packaging["stack_box_m"])
    offset_mm = 1e3 * built.unit_m * s.cells.offset
    print_table(
        f"{built.name}: {s.layout.n_cells} cells, {s.layout.n_panels} panels",
        [
            ("packaging ratio eta", f"{packaging['eta']:.5g}"),
            ("volume reduction", f"{100.0 * (1.0 - 1.0 / packaging['eta']):.1f} %"),
            ("folded stack", f"{box} mm, box ratio {packaging['box_ratio']:.4g}"),
            ("smallest dead-centre margin", f"{margin:.2f} deg"),
            ("wall offsets", f"{offset_mm.min():.3g} to {offset_mm.max():.3g} mm"),
            *design_rows(data),
            *more,
            ("written", str(path)),
        ],
    )
    size_m = max(built.unit_m * s.profile.size, built.span_m)
    if size_m > LARGE_M:
        warn(f"this is {size_m:.4g} m large: lengths whose key ends in _m are metres; 0.25 for 250 mm")


@click.command(epilog=example("ori-deploy poses wing.design.json --fold 0.3 --fold-cell c2=0.5 --json"))
@click.argument("design_file", metavar="DESIGN", type=IN)
@click.option("--fold", type=float, required=True, help="Fold variable of all cells: 0 flat, 1 deployed.")
@click.option("--fold-cell", "fold_cells", multiple=True, metavar="ID=FOLD", help="One cell's own; repeatable.")
@click.option("--span-fold", type=float, help="Span in segments: 0 straight, 1 folded zig-zag; wants --fold 0.")
@click.option(
    "--json", "as_json", is_flag=True, help="Transforms (3x3; 4x4 of cones and with --span-fold) and outlines."
)
def poses(
    design_file: Path, fold: float, fold_cells: tuple[str, ...], span_fold: float | None, as_json: bool
) -> None:
    """Print where every panel of DESIGN is at a fold state."""
    built = load_design(design_file)
    structure = built.structure
    folds = np.full(structure.layout.n_cells, fold)
    for given in fold_cells:
        cell, value = _fold_of_cell(given, structure.layout.cell_ids)
        folds[cell] = value
    if span_fold is not None:
        span_poses(built, folds, span_fold, as_json=as_json)
        return
    panels = pose_data(structure, folds)
    if as_json:
        click.echo(json.dumps(panels, allow_nan=False))
        return
    for panel in panels:
        click.echo(f"{panel['id']:<8} {_motion(panel['transform'])}")


def _motion(transform: list[list[float]]) -> str:
    """A panel's rigid motion in words: in the plane (3x3), or about a cone's apex (4x4)."""
    if len(transform) == 4:
        turn = Rotation.from_matrix(np.array(transform)[:3, :3]).as_rotvec(degrees=True)
        angle = float(np.linalg.norm(turn))
        x, y, z = turn / angle if angle > 0.0 else (0.0, 0.0, 1.0)
        return f"turned {angle:9.3f} deg about ({x:7.4f}, {y:7.4f}, {z:7.4f}) through the apex"
    (cos, _, x), (sin, _, y), _ = transform
    angle = math.degrees(math.atan2(sin, cos))
    return f"turned {angle:9.3f} deg, shifted ({1e3 * x:9.3f}, {1e3 * y:9.3f}) mm"


def _fold_of_cell(given: str, cell_ids: tuple[str, ...]) -> tuple[int, float]:
    name, _, text = given.partition("=")
    if name not in cell_ids:
        raise InputError(
            "--fold-cell: unknown cell", value=repr(given), limit=", ".join(cell_ids), remedy="write ID=FOLD"
        )
    try:
        return cell_ids.index(name), float(text)
    except ValueError:
        raise InputError(
            "--fold-cell: not a number", value=repr(given), limit="ID=FOLD", remedy="for example c2=0.5"
        ) from None


@click.command(epilog=example("ori-deploy plan wing.design.json --rig examples/rig_mock.toml -o wing.plan.json"))
@click.argument("design_file", metavar="DESIGN", type=IN)
@click.option("--rig", type=IN, required=True, help="Rig file: limits of every crease, rate, latches.")
@click.option("-o", "--output", type=OUT, help="Plan file to write.  [default: NAME.plan.json]")
def plan(design_file: Path, rig: Path, output: Path | None) -> None:
    """Plan the deployment of DESIGN: check it for interference and time it."""
    path = output or named_after(design_file, DESIGN_ENDING, PLAN_ENDING)
    _print_plan(make_plan(design_file, rig, path), path)


def _print_plan(made: Plan, path: Path) -> None:
    check, steps = made.check, made.step_tolerance
    low, high = check.clearance_fold_range
    deepest, allowed = 1e3 * check.deepest_penetration_m, 1e3 * check.allowed_penetration_m
    where = f"{check.clearance_panels[0]} and {check.clearance_panels[1]}, fold {check.clearance_fold:.2f}"
    clearance = f"{1e3 * check.smallest_clearance_m:.3g} mm ({where})" if check.has_clearance else "no free pair"
    print_table(
        f"{made.design_name}: {made.duration_s:.2f} s of motion at {made.rate_hz:g} Hz",
        [
            ("poses checked", str(check.n_poses)),
            ("deepest penetration", f"below {deepest:.2g} mm (allowed {allowed:.2g} mm)"),
            (f"clearance at fold {low:g} to {high:g}", clearance),
            ("safe step tolerance", f"fold {steps.smallest:.3g} between cells, up to fold {steps.seating_fold:.3g}"),
            ("seating beyond", f"slits touch, up to {1e3 * steps.seating_depth_m:.2g} mm deep"),
            ("to latch", ", ".join(made.latch_points)),
            *plan_rows(made),
            ("written", str(path)),
        ],
    )
