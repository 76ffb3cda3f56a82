"""`ori-deploy report`: a page of figures from a flight log."""

from __future__ import annotations

from pathlib import Path

import click

from ori_deploy.cli.frame import IN, OUT, console, example, named_after, warn
from ori_deploy.cli.given import held
from ori_deploy.cli.steps import refuse_overwriting
from ori_deploy.files import digest, load_design, load_plan, write_atomically
from ori_deploy.telemetry.read import read_run
from ori_deploy.view import render_report


@click.command(
    epilog=example("ori-deploy report run.mcap --design wing.design.json --plan wing.plan.json -o report.html")
)
@click.argument("log", type=IN)
@click.option("--design", "design_file", type=IN, help="Design file, for the drawings.")
@click.option("--plan", "plan_file", type=IN, help="Plan file, for the curves.")
@click.option("-o", "--output", type=OUT, help="Page to write.  [default: NAME.html]")
def report(log: Path, design_file: Path | None, plan_file: Path | None, output: Path | None) -> None:
    """Make a page of figures from a flight LOG."""
    path = output or named_after(log, ".mcap", ".html")
    write_report(path, log, design_file, plan_file)
    console.print(f"written {path}", markup=False, soft_wrap=True)


def write_report(path: Path, log: Path, design_file: Path | None, plan_file: Path | None) -> None:
    """One self-contained page from what is at hand."""
    if plan_file is not None:
        plan_file = held(plan_file)
    built = load_design(design_file) if design_file is not None else None
    made = load_plan(plan_file) if plan_file is not None else None
    refuse_overwriting(path, *(p for p in (log, design_file, plan_file) if p is not None))
    run = read_run(log)
    for what, theirs, ours in (
        ("design", run.info["design_sha256"], built.sha256 if built is not None else None),
        ("plan", run.info["plan_sha256"], digest(plan_file) if plan_file is not None else None),
    ):
        if ours is not None and theirs and theirs != ours:
            warn(f"{log} is not a run of this {what}: the page mixes two")
    page = render_report(
        built.name if built is not None else str(run.info["design_name"]),
        structure=built.structure if built is not None else None,
        span_m=built.span_m if built is not None else None,
        r_min_m=built.r_min_m if built is not None else 0.0,
        span_segments=built.span_segments if built is not None else 1,
        plan=made,
        run=run,
        design_sha256=built.sha256 if built is not None else "",
        plan_sha256=digest(plan_file) if plan_file is not None else "",
    )
    write_atomically(path, page)
