"""What all commands share: how errors reach the user, how tables are printed."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ori_deploy.cli.output import EXIT_UNHEARD, EXIT_UNTOLD, Status, told
from ori_deploy.cli.starting import remembered_interrupts
from ori_deploy.errors import InputError, OriDeployError
from ori_deploy.spelling import near

EXIT_NOT_DONE, EXIT_BAD_INPUT, EXIT_REFUSED, EXIT_INTERRUPTED = 1, 2, 3, 130

EXIT_STATUSES = {
    0: "done",
    EXIT_NOT_DONE: "carried out, and not with the end that was meant: a fault, a problem, a difference",
    EXIT_BAD_INPUT: "words or files that cannot be used; nothing was begun",
    EXIT_REFUSED: "refused, and nothing moved: by the device, the port, the structure, the controller",
    EXIT_UNTOLD: "standard output cannot be written: what came of it is not known from here",
    EXIT_INTERRUPTED: "interrupted by a signal or `ori-deploy stop`, and brought to rest",
    EXIT_UNHEARD: "nobody reads standard output any more: the pipe was closed",
}
"""What every command ends with, in words; `ori-deploy --help` prints them."""

IN = click.Path(path_type=Path, dir_okay=False)
OUT = click.Path(path_type=Path, dir_okay=False, writable=True)
"""Files that commands read and write."""

_NO_WORDS: tuple[type[Exception], ...] = tuple(
    kind for kind in [getattr(click.exceptions, "NoArgsIsHelpError", None)] if kind is not None
)
"""What newer versions of click raise for a group without a command; older ones print its help themselves."""


class _Screen(Console):
    """A console that goes quiet when nobody listens any more: what it shows must not end what it shows."""

    def on_broken_pipe(self) -> None:
        self.quiet = True


console = _Screen(highlight=False)


class Commands(click.Group):
    """A group whose commands end in one clear line and one of `EXIT_STATUSES`, never in a traceback."""

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        **extra: Any,
    ) -> Any:
        if not standalone_mode:
            return super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
        sys.exit(told(lambda: self._ended(args, prog_name, complete_var, extra)))

    def _ended(
        self, args: Sequence[str] | None, prog_name: str | None, complete_var: str | None, extra: dict[str, Any]
    ) -> Status:
        """Run a command; the status that it ends with."""
        try:
            status = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
        except click.exceptions.Abort:
            click.echo("interrupted", err=True)
            return EXIT_INTERRUPTED
        except click.ClickException as wrong:
            _show(wrong)
            return wrong.exit_code
        return status if isinstance(status, int) else 0

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if self.get_command(ctx, name) is None and not name.startswith("-") and not ctx.resilient_parsing:
            likely = near(name, self.list_commands(ctx))
            raise click.UsageError(
                f"No such command {name!r}" + (f" (did you mean {' or '.join(likely)}?)" if likely else ""), ctx
            )
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        # What matters of a log message is in the result; a bug still shows its traceback.
        logging.basicConfig(level=logging.CRITICAL)
        try:
            return super().invoke(ctx)
        except OriDeployError as wrong:
            click.echo(f"error: {wrong}", err=True)
            bad = EXIT_BAD_INPUT if isinstance(wrong, InputError) else EXIT_NOT_DONE
            sys.exit(EXIT_REFUSED if wrong.refused else bad)
        except KeyboardInterrupt:
            click.echo("interrupted", err=True)
            sys.exit(EXIT_INTERRUPTED)


class Heeding(click.Command):
    """A command that moves or makes limp: `StopRequest` and `confirm` lose no interrupt that came since its begin."""

    def invoke(self, ctx: click.Context) -> Any:
        with remembered_interrupts():
            return super().invoke(ctx)


@contextmanager
def nothing_moved() -> Iterator[None]:
    """Until the end of the block nothing is set in motion: what a bus refuses there was not begun."""
    try:
        yield
    except OriDeployError as wrong:
        wrong.refused = wrong.refused or not isinstance(wrong, InputError)
        raise


def _show(wrong: click.ClickException) -> None:
    """What click found wrong with the words of a command, in the one line that all other errors have."""
    if isinstance(wrong, _NO_WORDS):
        wrong.show()  # the help
        return
    ctx = wrong.ctx if isinstance(wrong, click.UsageError) else None
    text = " ".join(wrong.format_message().split()).removesuffix(".")
    remedy = f"; remedy: see {ctx.command_path} --help" if ctx is not None else ""
    click.echo(f"error: {text}{remedy}", err=True)


def print_table(title: str, rows: Iterable[tuple[str, str]]) -> None:
    """Two columns, names and values."""
    table = Table(title=escape(title), show_header=False, title_justify="left", title_style="bold")
    table.add_column(no_wrap=True)
    table.add_column()
    for name, value in rows:
        table.add_row(escape(name), escape(value))
    console.print(table)


def example(line: str) -> str:
    """Epilogue of a help page."""
    return f"\b\nExample:\n  {line}"


def named_after(path: Path, ending: str, new: str) -> Path:
    """The default output: same stem, in the working folder."""
    return Path(path.name.removesuffix(ending) + new)


def warn(text: str) -> None:
    """One line on the error stream."""
    click.echo(f"warning: {text}", err=True)
