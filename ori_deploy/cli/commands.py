"""The commands. Each reads files, calls the rooms, writes files, and says what came out."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from scipy.spatial.transform import Rotation

import ori_deploy
from ori_deploy.cli.bus import bus
from ori_deploy.cli.doctor import doctor
from ori_deploy.cli.figures import figures
from ori_deploy.cli.frame import EXIT_INTERRUPTED, EXIT_NOT_DONE, Commands, console, print_table, warn
from ori_deploy.cli.layouts import layouts_command
from ori_deploy.cli.limit import limit
from ori_deploy.cli.mcu import mcu
from ori_deploy.cli.operate import operator
from ori_deploy.cli.optimise import Request, default_workers
from ori_deploy.cli.replay import replay
from ori_deploy.cli.session import Command, Options, StoppedBy, carry_out
from ori_deploy.cli.size import size
from ori_deploy.cli.spanwise import design_rows, plan_rows, span_option, span_poses, tell_span
from ori_deploy.cli.steps import (
    DESIGN_ENDING,
    PLAN_ENDING,
    SPEC_ENDING,
    make_design,
    make_optimum,
    make_plan,
    write_report,
)
from ori_deploy.cli.strip import strip
from ori_deploy.cli.sweep import sweep
from ori_deploy.deploy.result import MotionResult, Outcome
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
@click.option("--optimize", is_flag=True, help="Move the vertices to where the wish in [optimize] is met best.")
@click.option("--starts", type=click.IntRange(1, 100_000), help="Local searches per layout.  [default: 8]")
@click.option("--cells", type=click.IntRange(1, 200), help="Number of cells, instead of the layout in SPEC: a ring.")
@click.option("--search-layouts", is_flag=True, help="Try every layout of --cells cells.")
@click.option("--save-spec", type=_OUT, help="Write what was found as a specification, too.")
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
    path = output or _beside(spec, SPEC_ENDING, DESIGN_ENDING)
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


@main.command(epilog=_example("ori-deploy poses wing.design.json --fold 0.3 --fold-cell c2=0.5 --json"))
@click.argument("design_file", metavar="DESIGN", type=_IN)
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
            *plan_rows(made),
            ("written", str(path)),
        ],
    )


def _motion_options(command: Callable[..., None]) -> Callable[..., None]:
    """What every command that moves takes."""
    for option in reversed(
        (
            click.argument("plan_file", metavar="PLAN", type=_IN),
            click.option("--rig", type=_IN, required=True, help="Rig file the plan was made with."),
            click.option("--log", type=_OUT, help="Flight log to write (MCAP)."),
            click.option(
                "--realtime",
                is_flag=True,
                help="Pace to the wall instead of the virtual clock. Other terminals can command a motion only with "
                "this, or on hardware.",
            ),
            click.option("--port", help="Device of the bus, instead of the one in the rig."),
            click.option(
                "--mcu-port",
                help="Device of a microcontroller that has latches alone, instead of the one in the rig.",
            ),
            click.option(
                "--stands",
                type=click.Choice(["stowed", "deployed"]),
                help="Your word for where the structure stands, where servos alone cannot tell.",
            ),
            click.option(
                "--journal",
                type=_OUT,
                help="Where word is left before each stage.  [default: in ~/.local/state, one per rig; none for "
                "simulated devices]",
            ),
            click.option(
                "--trust-measured",
                is_flag=True,
                help="Your word that the structure stands as measured, whatever the journal says.",
            ),
            click.option("--speed", type=float, default=1.0, show_default=True, help="Part of the plan's speed."),
        )
    ):
        command = option(command)
    return command


def _tell_end(results: tuple[MotionResult, ...], stopped: StoppedBy | None, ends: str) -> None:
    """Say what did not go as it should, and leave with the status for it."""
    if not results:
        click.echo("interrupted: before anything moved", err=True)
        sys.exit(EXIT_INTERRUPTED)
    for problem in results[-1].observer_errors:
        warn(f"the motion went on without an observer: {problem}")
    if stopped and not results[-1].succeeded:
        where = "brought to rest along its path" if results[-1].outcome is Outcome.STOPPED else "see the fault above"
        click.echo(f"interrupted: {where}; asked for by {stopped}", err=True)
        sys.exit(EXIT_INTERRUPTED)
    if not results[-1].succeeded:
        click.echo(f"error: not {ends}", err=True)
        sys.exit(EXIT_NOT_DONE)


def _motion_command(name: Command, text: str, ends: str) -> None:
    @main.command(
        name,
        help=text,
        epilog=_example(f"ori-deploy {name} wing.plan.json --rig examples/rig_mock.toml --log run.mcap"),
    )
    @_motion_options
    @span_option(name)
    def command(plan_file: Path, rig: Path, **given: Any) -> None:
        made, results, stopped = carry_out(plan_file, rig, (name,), Options(**given))
        _tell_end(results, stopped, ends)
        tell_span(made, name)


_motion_command(
    "deploy", "Carry PLAN out: unlock, open, latch. Ends with every latch confirmed, or says why not.", "deployed"
)
_motion_command("stow", "Carry PLAN out backwards: unlatch, close. Ends measured flat, or says why not.", "stowed")


@main.command(epilog=_example("ori-deploy recover wing.plan.json --rig rig.toml --design wing.design.json"))
@_motion_options
@click.option("--design", type=_IN, required=True, help="Design file, to check every pose of the way with.")
def recover(plan_file: Path, rig: Path, **given: Any) -> None:
    """Bring cells that are out of step back onto the path, along a way that is checked for interference.

    Ends holding, all cells at one fold; then deploy or stow.
    """
    _, results, stopped = carry_out(plan_file, rig, ("recover",), Options(**given))
    _tell_end(results, stopped, "in step")


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


main.add_command(replay)
main.add_command(limit)
main.add_command(size)
main.add_command(layouts_command)
main.add_command(sweep)
main.add_command(strip)
main.add_command(figures)
main.add_command(bus)
main.add_command(mcu)
main.add_command(doctor)
for command in operator.commands.values():
    main.add_command(command)
