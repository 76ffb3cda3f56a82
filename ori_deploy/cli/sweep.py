"""`ori-deploy sweep`: designs over a grid."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from ori_deploy.cli.frame import EXIT_INTERRUPTED, IN, Heeding, console, print_table, warn
from ori_deploy.cli.session import StopRequest
from ori_deploy.cli.steps import SPEC_ENDING, refuse_overwriting
from ori_deploy.errors import InputError
from ori_deploy.files import load_spec, load_sweep
from ori_deploy.files.spec import SPEC_SCHEMA
from ori_deploy.files.text import read_toml
from ori_deploy.sweep import Backend, Cluster, Grid, Job, Processes, Store, Sweep, jobs_of, parse_grid
from ori_deploy.sweep.job import FAILED, FOUND, INFEASIBLE, Row


@click.command(
    cls=Heeding,
    epilog="\b\nExample:\n  ori-deploy sweep examples/sweep_ellipse.toml -o ellipse.parquet",
)
@click.argument("spec", type=IN)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False, writable=True),
    help="Parquet file; one that is there is gone on with.  [default: NAME.parquet]",
)
@click.option("--grid", "grid_file", type=IN, help="Grid file, in place of SPEC's [sweep] table.")
@click.option("--workers", type=click.IntRange(1, 1024), help="Processes.  [default: one per processor]")
@click.option("--dask", "address", metavar="ADDRESS", help="Run on a Dask cluster: tcp://host:port of its scheduler.")
@click.option(
    "--retry-failed", is_flag=True, help="Do again what ended a worker or broke; designs found infeasible stay."
)
def sweep(
    spec: Path,
    output: Path | None,
    grid_file: Path | None,
    workers: int | None,
    address: str | None,
    retry_failed: bool,
) -> None:
    """Make the designs of a grid round SPEC, one row of a Parquet table each.

    The grid is SPEC's [sweep] table. Rows land as designs are finished; run again, the same command goes on where it
    was interrupted. A design that cannot be built is a row with its error.
    """
    path = output or Path(spec.name.removesuffix(SPEC_ENDING) + ".parquet")
    refuse_overwriting(path, spec, *([grid_file] if grid_file else []))
    if workers is not None and address is not None:
        raise InputError("--workers: goes without --dask", remedy="a cluster has the workers it has")
    grid, jobs = _wanted(spec, grid_file)
    with Store(path, grid.axes) as store, StopRequest() as stop:
        if retry_failed:
            store.forget_failed()
        backend: Backend = Processes(workers) if address is None else Cluster(address)
        under_way = Sweep(store, backend, stop=lambda: stop.requested)
        _carry_out(under_way, jobs, len(grid))
        _print(spec, path, grid, store, under_way)
    if under_way.stopped:
        click.echo(f"interrupted: what was finished is in {path}; the same command goes on from there", err=True)
        sys.exit(EXIT_INTERRUPTED)


def _wanted(spec: Path, grid_file: Path | None) -> tuple[Grid, Iterator[Job]]:
    """The grid and its jobs; the specification is checked but for what the grid replaces."""
    document = read_toml(spec, SPEC_SCHEMA)
    if grid_file is not None:
        wanted = load_sweep(grid_file)
    else:
        own = load_spec(spec).sweep
        if own is None:
            raise InputError(
                "sweep: nothing to sweep over",
                limit="a [sweep] table with a grid, or --grid FILE",
                remedy='for example [sweep] grid = { "structure.wall_m" = [0.0, 0.001] }',
                source=str(spec),
            )
        wanted = own
    try:
        grid = parse_grid(wanted.grid, wanted.seed)
        return grid, jobs_of(document, grid, spec.parent)
    except InputError as wrong:
        wrong.source = wrong.source or str(grid_file or spec)
        raise


def _bar() -> Progress:
    """A bar on a terminal; nothing elsewhere, where the table at the end says it all."""
    return Progress(
        TextColumn("designs"),
        BarColumn(bar_width=28),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("best eta {task.fields[best]}"),
        console=console,
        disable=not console.is_terminal,
    )


def _carry_out(under_way: Sweep, jobs: Iterator[Job], total: int) -> None:
    best = float("-inf")
    with _bar() as bar:
        task = bar.add_task("designs", total=total, best="-")

        def tell(row: Row) -> None:
            nonlocal best
            best = max(best, row.get("eta") or best)
            done = under_way.reused + sum(under_way.count.values())
            bar.update(task, completed=done, best=f"{best:.4f}" if best > 0.0 else "-")

        under_way.tell = tell
        under_way.carry_out(jobs)


def _print(spec: Path, path: Path, grid: Grid, store: Store, under_way: Sweep) -> None:
    count = under_way.count
    rows = [
        ("combinations", str(len(grid))),
        ("made now", f"{count.get(FOUND, 0)} structures, {count.get(INFEASIBLE, 0)} infeasible"),
        ("there already", str(under_way.reused)),
    ]
    if under_way.lost_workers or count.get(FAILED, 0):
        rows.append(
            (
                "broken",
                f"{count.get(FAILED, 0)} designs failed; workers that ended took {under_way.lost_workers} along",
            )
        )
    found = [row for row in store.rows() if row["status"] == FOUND]
    if found:
        best = max(found, key=lambda row: float(row["eta"]))
        where = ", ".join(f"{name} = {_shown(best.get(name))}" for name in grid.names)
        rows.append(("best eta", f"{best['eta']:.5g} at {where or 'the specification'}"))
    infeasible = [row for row in store.rows() if row["status"] == INFEASIBLE]
    if infeasible:
        where = ", ".join(f"{name} = {_shown(infeasible[0].get(name))}" for name in grid.names)
        rows.append((f"first of {len(infeasible)} infeasible", f"{where}: {infeasible[0]['error']}"))
    print_table(
        f"{spec.name.removesuffix(SPEC_ENDING)}: {len(store.rows())} designs", [*rows, ("written", str(path))]
    )
    failed = [row for row in store.rows() if row["status"] == FAILED]
    if failed:
        warn(f"{len(failed)} designs failed, the first: {failed[0]['error']}; --retry-failed does them again")


def _shown(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
