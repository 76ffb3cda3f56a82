"""`ori-deploy figures`: the paper's results as pictures and data."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from ori_deploy.cli.frame import EXIT_INTERRUPTED, Heeding, console, print_table
from ori_deploy.cli.optimise import default_workers
from ori_deploy.cli.session import StopRequest
from ori_deploy.errors import FileError
from ori_deploy.search import Failure
from ori_deploy.search.many import Result

if TYPE_CHECKING:
    from ori_deploy.cli.figure_sheets import Made

NAMES = ("fig3", "fig4a", "fig4c", "fig4d", "fig5", "walls")


@click.command(cls=Heeding, epilog="\b\nExample:\n  ori-deploy figures --out out/figures fig4c walls")
@click.argument("names", type=click.Choice(NAMES), nargs=-1, metavar=f"[{'|'.join(NAMES)}]...")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Folder to write to; made if it is not there.",
)
@click.option("--workers", type=click.IntRange(1, 1024), help="Processes for searches.  [default: one per processor]")
@click.option("--quick", is_flag=True, help="A preview, as NAME.quick.*: few points, few starts.")
def figures(names: tuple[str, ...], out: Path, workers: int | None, quick: bool) -> None:
    """Make the paper's figures, each as PNG and SVG, and the data behind them as CSV. All when none is named.

    \b
    fig3   prototypes: clover, heart, circular and elliptic cone
    fig4a  the optimised ellipse with 4 and 6 cells
    fig4c  packaging ratio against number of cells, beside equation (8)
    fig4d  packaging ratio per cell over superellipses
    fig5   the wing with two spars: section, fold, span in three
    walls  packaging ratio against number of cells with real walls

    Ctrl-C keeps what is finished; searches done so far for a figure that is not are in NAME.part.csv.
    """
    from ori_deploy.cli.figure_sheets import MAKERS, Effort

    _refuse_bad_folder(out)
    wanted = [name for name in NAMES if name in names or not names]
    effort = Effort(workers or default_workers(), quick)
    rows: list[tuple[str, str]] = []
    told: str | None = None
    endings = "NAME.quick.*: previews, as PNG, SVG and CSV" if quick else "of each PNG, SVG and CSV"
    with StopRequest() as stop, _bar() as bar:
        for name in wanted:
            made = _made(partial(MAKERS[name], effort), bar, name, stop)
            written = made.write(out, preview=quick) if made is not None else []
            if made is None or made.interrupted:
                told = _interrupted(out, [row[0] for row in rows], name, made, written)
                break
            rows.append((name, made.told))
    if rows:
        print_table(f"figures in {out}", [*rows, ("written", endings)])
    if told is not None:
        click.echo(told, err=True)
        sys.exit(EXIT_INTERRUPTED)


def _refuse_bad_folder(out: Path) -> None:
    """Tell before minutes of work, not after."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as wrong:
        raise FileError(
            f"{out}: no folder to write to", value=wrong.strerror, remedy="choose another with --out"
        ) from wrong
    if not os.access(out, os.W_OK | os.X_OK):
        raise FileError(f"{out}: no folder to write to", value="not writable", remedy="choose another with --out")


def _bar() -> Progress:
    return Progress(
        TextColumn("{task.description:<6}"), BarColumn(bar_width=28), MofNCompleteColumn(), TimeElapsedColumn(),
        TextColumn("{task.fields[best]}"), console=console, transient=True, disable=not console.is_terminal,
    )  # fmt: skip


class _OnBar:
    """Steps of one figure on a progress bar."""

    def __init__(self, bar: Progress, name: str, stop: StopRequest) -> None:
        self._bar, self._stop, self._best = bar, stop, 0.0
        self._task: TaskID = bar.add_task(name, total=None, best="")
        self._look()

    def _look(self) -> None:
        if self._stop.requested:
            raise KeyboardInterrupt

    def expect(self, steps: int) -> None:
        self._bar.update(self._task, total=steps)
        self._look()

    def step(self, result: Result | None = None) -> None:
        if result is not None and not isinstance(result, Failure):
            self._best = max(self._best, result[1].eta)
        self._bar.update(self._task, advance=1, best=f"best eta {self._best:.4f}" if self._best else "")
        self._look()


def _made(make: Callable[[_OnBar], Made], bar: Progress, name: str, stop: StopRequest) -> Made | None:
    """The figure; None where it was interrupted and nothing of it is worth keeping."""
    try:
        return make(_OnBar(bar, name, stop))
    except KeyboardInterrupt:
        return None


def _interrupted(out: Path, finished: list[str], name: str, made: Made | None, written: list[Path]) -> str:
    kept = f"{', '.join(finished)} in {out}" if finished else "no figure"
    part = f"; of {name} {made.told} in {written[0].name}" if made is not None and written else ""
    return f"interrupted: finished and kept: {kept}{part}"
