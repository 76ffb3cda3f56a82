"""`ori-deploy demo`: the whole chain on real input, with everything it makes left in one folder."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import click

from ori_deploy.actuators.rig import load_rig
from ori_deploy.cli.frame import EXIT_INTERRUPTED, EXIT_NOT_DONE, IN, Heeding, example, print_table, warn
from ori_deploy.cli.given import held
from ori_deploy.cli.report import write_report
from ori_deploy.cli.session import Options, carry_out, lost_observers
from ori_deploy.cli.steps import DESIGN_ENDING, PLAN_ENDING, SPEC_ENDING, make_design, make_plan
from ori_deploy.design import Structure
from ori_deploy.errors import FileError, InputError
from ori_deploy.files import write_atomically
from ori_deploy.files.shipped import shipped
from ori_deploy.motion import Mechanism, SpanFolding
from ori_deploy.telemetry.read import read_run
from ori_deploy.telemetry.summary import summarise
from ori_deploy.view import draw_plan, draw_section, draw_spanwise, draw_strip, draw_tracking, to_png, to_svg


@click.command(cls=Heeding, epilog=example("ori-deploy demo -o out/demo"))
@click.argument("spec", type=IN, required=False)
@click.option("--rig", type=IN, help="Rig file, of simulated servos.  [default: the one that is shipped]")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, file_okay=False), default=Path("out/demo"), show_default=True
)
@click.option("--realtime", is_flag=True, help="Pace to the wall instead of the virtual clock.")
def demo(spec: Path | None, rig: Path | None, output: Path, realtime: bool) -> None:
    """Design, plan, deploy and stow a wing on simulated servos, and report.

    SPEC is a specification; the example wing when left out.
    """
    sys.exit(run_demo(spec, rig, output, realtime=realtime))


def run_demo(spec: Path | None, rig: Path | None, output: Path, *, realtime: bool) -> int:
    """Run the demo; returns the exit status."""
    spec = spec or shipped("wing_naca2412.toml")
    rig = held(rig or shipped("rig_mock.toml"))
    if (backend := load_rig(rig).backend) != "mock":
        raise InputError(
            f"--rig: {rig} is of hardware, and a demo moves what nobody has looked at",
            value=f'backend = "{backend}"',
            limit='backend = "mock"',
            remedy="design, plan and deploy, one after another",
        )
    name = spec.name.removesuffix(SPEC_ENDING)
    design_file, plan_file, log = (
        output / f"{name}{DESIGN_ENDING}",
        output / f"{name}{PLAN_ENDING}",
        output / "run.mcap",
    )
    built, data, _ = make_design(spec, design_file)
    made = make_plan(design_file, rig, plan_file)
    _, results, stopped = carry_out(
        plan_file, rig, ("deploy", "stow"), Options(log=log, realtime=realtime, span_unfolded=True)
    )
    for line in dict.fromkeys(line for result in results for line in lost_observers(result)):
        warn(line)
    done = len(results) == 2 and results[-1].succeeded
    if stopped and not done:
        warn(f"interrupted, at rest: no figures were made; the flight so far is in {log}")
        return EXIT_INTERRUPTED
    try:
        run = read_run(log)
    except FileError as lost:  # no bad input: the motions have been made
        warn(f"no figures were made: {lost}")
        return EXIT_NOT_DONE
    figures = {
        "section": draw_section(built.structure),
        "strip": draw_strip(built.structure),
        "plan": draw_plan(made),
        "tracking": draw_tracking(run, made),
    }
    if built.span_segments > 1 and isinstance(built.structure, Structure):
        figures["span"] = draw_spanwise(SpanFolding(Mechanism(built.structure), built.span_m, built.span_segments))
    for figure_name, figure in figures.items():
        write_atomically(output / f"{figure_name}.svg", to_svg(figure))
        write_atomically(output / f"{figure_name}.png", to_png(figure))
    write_report(output / "report.html", log, design_file, plan_file)
    packaging, worst = data["packaging"], summarise(run).worst_tracking
    print_table(
        f"{name}: {', '.join(f'{r.command} {r.outcome}' for r in results)}",
        [
            ("packaging ratio eta", f"{packaging['eta']:.4f}"),
            ("volume reduction", f"{100.0 * (1.0 - 1.0 / packaging['eta']):.1f} %"),
            ("box ratio", f"{packaging['box_ratio']:.4f}"),
            ("duration", ", ".join(f"{r.command} {r.duration_s:.2f} s" for r in results)),
            (
                "worst tracking error",
                "not read"
                if worst is None
                else f"{math.degrees(worst.error_rad):.3f} deg (hinge {worst.hinge_id}, cell {worst.cell_id})",
            ),
            (
                f"clearance at fold {made.check.clearance_fold_range[0]:g} to {made.check.clearance_fold_range[1]:g}",
                f"{1e3 * made.check.smallest_clearance_m:.3f} mm ({' and '.join(made.check.clearance_panels)}, "
                f"fold {made.check.clearance_fold:.2f})",
            ),
            ("report", str(output / "report.html")),
        ],
    )
    return 0 if done else EXIT_NOT_DONE
