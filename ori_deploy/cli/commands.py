"""The commands. Each reads files, calls the rooms, writes files, and says what came out."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np

import ori_deploy
from ori_deploy.cli.frame import EXIT_INTERRUPTED, EXIT_NOT_DONE, Commands, console, print_table, warn
from ori_deploy.cli.session import Command, carry_out
from ori_deploy.cli.steps import DESIGN_ENDING, PLAN_ENDING, SPEC_ENDING, make_design, make_plan, write_report
from ori_deploy.deploy.result import Outcome
from ori_deploy.errors import InputError
from ori_deploy.files import Design, load_design, pose_data
from ori_deploy.motion import Plan

_IN = click.Path(path_type=Path, dir_okay=False)
_OUT = click.Path(path_type=Path, dir_okay=False, writable=True)


def _beside(path: Path, ending: str, new: str) -> Path:
    """The default output: same stem, in the working folder."""
    return Path(path.name.removesuffix(ending) + new)


def _example(line: str) -> str:
    return f"\b\nExample:\n  {line}"


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(ori_deploy.__version__, prog_name="ori-deploy")
def main() -> None:
    """Deployable thick origami: design it, plan it, check it, deploy it.

    \b
    spec.toml -> design -> NAME.design.json -> plan -> NAME.plan.json -> deploy -> run.mcap -> report
    """


@main.command(epilog=_example("ori-deploy design examples/wing_naca2412.toml -o wing.design.json"))
@click.argument("spec", type=_IN)
@click.option("-o", "--output", type=_OUT, help="Design file to write.  [default: NAME.design.json]")
def design(spec: Path, output: Path | None) -> None:
    """Build the structure that SPEC describes."""
    _print_design(make_design(spec, output or _beside(spec, SPEC_ENDING, DESIGN_ENDING)))


def _print_design(made: tuple[Design, dict[str, Any], Path]) -> None:
    built, data, path = made
    s, packaging = built.structure, data["packaging"]
    margin = float(np.degrees(s.cells.dead_centre_margin.min()))
    box = packaging["stack_box_m"]
    print_table(
        f"{built.name}: {s.layout.n_cells} cells, {s.layout.n_panels} panels",
        [
            ("packaging ratio eta", f"{packaging['eta']:.5g}"),
            ("volume reduction", f"{100.0 * (1.0 - 1.0 / packaging['eta']):.1f} %"),
            ("folded stack", f"{1e3 * box[0]:.1f} x {1e3 * box[1]:.1f} mm, box ratio {packaging['box_ratio']:.4g}"),
            ("smallest dead-centre margin", f"{margin:.2f} deg"),
            ("wall offsets", f"{1e3 * s.cells.offset.min():.3g} to {1e3 * s.cells.offset.max():.3g} mm"),
            ("written", str(path)),
        ],
    )


@main.command(epilog=_example("ori-deploy poses wing.design.json --fold 0.3 --fold-cell c2=0.5 --json"))
@click.argument("design_file", metavar="DESIGN", type=_IN)
@click.option("--fold", type=float, required=True, help="Fold variable of all cells: 0 flat, 1 deployed.")
@click.option("--fold-cell", "fold_cells", multiple=True, metavar="ID=FOLD", help="One cell's own; repeatable.")
@click.option("--json", "as_json", is_flag=True, help="Transforms (3x3) and outlines, metres.")
def poses(design_file: Path, fold: float, fold_cells: tuple[str, ...], as_json: bool) -> None:
    """Print where every panel of DESIGN is at a fold state."""
    structure = load_design(design_file).structure
    folds = np.full(structure.layout.n_cells, fold)
    for given in fold_cells:
        cell, value = _fold_of_cell(given, structure.layout.cell_ids)
        folds[cell] = value
    panels = pose_data(structure, folds)
    if as_json:
        click.echo(json.dumps(panels, allow_nan=False))
        return
    for panel in panels:
        (cos, _, x), (sin, _, y), _ = panel["transform"]
        angle = math.degrees(math.atan2(sin, cos))
        click.echo(f"{panel['id']:<8} turned {angle:9.3f} deg, shifted ({1e3 * x:9.3f}, {1e3 * y:9.3f}) mm")


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


@main.command(epilog=_example("ori-deploy plan wing.design.json --rig examples/rig_mock.toml -o wing.plan.json"))
@click.argument("design_file", metavar="DESIGN", type=_IN)
@click.option("--rig", type=_IN, required=True, help="Rig file: limits of every crease, rate, latches.")
@click.option("-o", "--output", type=_OUT, help="Plan file to write.  [default: NAME.plan.json]")
def plan(design_file: Path, rig: Path, output: Path | None) -> None:
    """Plan the deployment of DESIGN: check it for interference and time it."""
    path = output or _beside(design_file, DESIGN_ENDING, PLAN_ENDING)
    _print_plan(make_plan(design_file, rig, path), path)


def _print_plan(made: Plan, path: Path) -> None:
    check, steps = made.check, made.step_tolerance
    low, high = check.clearance_fold_range
    deepest, allowed = 1e3 * check.deepest_penetration_m, 1e3 * check.allowed_penetration_m
    where = f"{check.clearance_panels[0]} and {check.clearance_panels[1]}, fold {check.clearance_fold:.2f}"
    clearance = (
        f"{1e3 * check.smallest_clearance_m:.3g} mm ({where})" if check.clearance_panels[0] else "no free pair"
    )
    print_table(
        f"{made.design_name}: {made.duration_s:.2f} s at {made.rate_hz:g} Hz",
        [
            ("poses checked", str(check.n_poses)),
            ("deepest penetration", f"below {deepest:.2g} mm (allowed {allowed:.2g} mm)"),
            (f"clearance at fold {low:g} to {high:g}", clearance),
            ("safe step tolerance", f"fold {steps.smallest:.3g} between cells, up to fold {steps.seating_fold:.3g}"),
            ("seating beyond", f"slits touch, up to {1e3 * steps.seating_depth_m:.2g} mm deep"),
            ("to latch", ", ".join(made.latch_points)),
            ("written", str(path)),
        ],
    )


def _motion_command(name: Command, text: str, ends: str) -> None:
    @main.command(
        name,
        help=text,
        epilog=_example(f"ori-deploy {name} wing.plan.json --rig examples/rig_mock.toml --log run.mcap"),
    )
    @click.argument("plan_file", metavar="PLAN", type=_IN)
    @click.option("--rig", type=_IN, required=True, help="Rig file the plan was made with.")
    @click.option("--log", type=_OUT, help="Flight log to write (MCAP).")
    @click.option("--realtime", is_flag=True, help="Pace to the wall instead of the virtual clock.")
    def command(plan_file: Path, rig: Path, log: Path | None, realtime: bool) -> None:
        _, results, stopped = carry_out(plan_file, rig, (name,), log, realtime=realtime)
        if not results:
            click.echo("interrupted: before anything moved", err=True)
            sys.exit(EXIT_INTERRUPTED)
        for problem in results[-1].observer_errors:
            warn(f"the motion went on without an observer: {problem}")
        if stopped and not results[-1].succeeded:
            where = (
                "brought to rest along its path" if results[-1].outcome is Outcome.STOPPED else "see the fault above"
            )
            click.echo(f"interrupted: {where}", err=True)
            sys.exit(EXIT_INTERRUPTED)
        if not results[-1].succeeded:
            click.echo(f"error: not {ends}", err=True)
            sys.exit(EXIT_NOT_DONE)


_motion_command(
    "deploy", "Carry PLAN out: unlock, open, latch. Ends with every latch confirmed, or says why not.", "deployed"
)
_motion_command("stow", "Carry PLAN out backwards: unlatch, close. Ends measured flat, or says why not.", "stowed")


@main.command(
    epilog=_example("ori-deploy report run.mcap --design wing.design.json --plan wing.plan.json -o report.html")
)
@click.argument("log", type=_IN)
@click.option("--design", "design_file", type=_IN, help="Design file, for the drawings.")
@click.option("--plan", "plan_file", type=_IN, help="Plan file, for the curves.")
@click.option("-o", "--output", type=_OUT, help="Page to write.  [default: NAME.html]")
def report(log: Path, design_file: Path | None, plan_file: Path | None, output: Path | None) -> None:
    """Make a page of figures from a flight LOG."""
    path = output or _beside(log, ".mcap", ".html")
    write_report(path, log, design_file, plan_file)
    console.print(f"written {path}", markup=False, soft_wrap=True)


@main.command(epilog=_example("ori-deploy demo -o out/demo"))
@click.argument("spec", type=_IN, required=False)
@click.option("--rig", type=_IN, help="Rig file.  [default: the mock rig that is shipped]")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, file_okay=False), default=Path("out/demo"), show_default=True
)
@click.option("--realtime", is_flag=True, help="Pace to the wall instead of the virtual clock.")
def demo(spec: Path | None, rig: Path | None, output: Path, realtime: bool) -> None:
    """Design, plan, deploy and stow a wing on simulated servos, and report.

    SPEC is a specification; the example wing when left out.
    """
    from ori_deploy.cli.demo import run_demo

    sys.exit(run_demo(spec, rig, output, realtime=realtime))
