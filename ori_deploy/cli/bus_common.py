"""What the bench commands share: which port, which rate, how results are shown."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click
from serial.tools import list_ports

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.dynamixel.adapter import latency_timer_s
from ori_deploy.actuators.dynamixel.line import MAX_ID, Pong, ServoLine
from ori_deploy.actuators.dynamixel.port import BlockingPort
from ori_deploy.actuators.rig import Rig, load_rig
from ori_deploy.bench.servos import USUAL_BAUDS, find, find_all
from ori_deploy.cli.frame import IN, nothing_moved
from ori_deploy.cli.starting import answer_interrupt
from ori_deploy.errors import InputError, RigError
from ori_deploy.wire.dynamixel import BAUD_CODES

BENCH_SLACK_S = 0.05
"""How late an answer may come at the bench, where nobody is in a hurry."""

_F = TypeVar("_F", bound=Callable[..., Any])

DIGITS = 9
"""Decimals of a quantity in JSON: far below what a servo resolves, and none of binary fractions' tails."""


@dataclass(frozen=True)
class Place:
    """Where servos are looked for.

    Attributes
    ----------
    port
        Device.
    bauds
        Rates to try, in order.
    rig
        The rig file that said so, if one was given.
    """

    port: str
    bauds: tuple[int, ...]
    rig: Rig | None

    @contextmanager
    def opened(self) -> Iterator[ServoLine]:
        """The line, for this process alone.

        Raises
        ------
        BusClosed
            The port cannot be opened.
        """
        slack = BENCH_SLACK_S + (latency_timer_s(self.port) or 0.0)
        port = BlockingPort(self.port, self.bauds[0], slack)
        with nothing_moved():
            port.open()
        try:
            yield ServoLine(port)
        finally:
            port.close()

    def some(self, line: ServoLine, which: int | None) -> tuple[Pong, ...]:
        """The servo of an id, or all of them for None; the port is left at their rate. Raises as `find`."""
        with nothing_moved():
            return find_all(line, self.bauds) if which is None else (find(line, which, self.bauds),)

    def one(self, line: ServoLine, servo_id: int) -> Pong:
        """The servo of an id, as `some`."""
        return self.some(line, servo_id)[0]


def adapters() -> tuple[str, ...]:
    """Devices of the serial adapters on USB that are plugged in."""
    return tuple(sorted(str(port.device) for port in list_ports.comports() if port.vid is not None))


def place(port: str | None, baud: int | None, rig_file: Path | None) -> Place:
    """Where to look: what was said, else what the rig says, else the only adapter there is.

    Raises
    ------
    InputError
        No such rate; a rig without Dynamixel servos; no adapter, or more than one to choose from.
    """
    rig = None if rig_file is None else load_rig(rig_file)
    if rig is not None and rig.dynamixel is None:
        raise RigError(
            "no Dynamixel servos here", value=f'backend = "{rig.backend}"', limit="a table [dynamixel]",
            remedy="give another rig, or --port", source=rig.source,
        )  # fmt: skip
    settings = None if rig is None else rig.dynamixel
    if baud is not None and baud not in BAUD_CODES:
        raise InputError(
            "--baud: not a rate of these servos", value=baud, limit=", ".join(map(str, BAUD_CODES)),
            remedy="choose one of them",
        )  # fmt: skip
    bauds = (baud,) if baud is not None else USUAL_BAUDS if settings is None else (settings.baud,)
    return Place(port or (settings.port if settings else _only_adapter()), bauds, rig)


def _only_adapter() -> str:
    found = adapters()
    if len(found) == 1:
        return found[0]
    raise InputError(
        "--port: which one?" if found else "--port: no serial adapter is plugged in",
        value=", ".join(found) or None,
        limit="the only adapter is taken without asking",
        remedy=f"give --port, for example --port {found[0]}" if found else "plug it in, or give --port or --rig",
    )


def which_servo(ctx: click.Context, param: click.Parameter, value: str) -> int | None:
    """Callback of an argument that is an id, or "all" for None."""
    if value == "all":
        return None
    if not value.isascii() or not value.isdigit() or int(value) > MAX_ID:
        raise click.BadParameter(f"{value!r} is neither an id from 0 to {MAX_ID} nor all", ctx, param)
    return int(value)


ID = click.IntRange(0, MAX_ID)


def place_options(command: _F) -> _F:
    """The options that say where servos are, and how to answer."""
    for option in reversed(
        (
            click.option("--port", help="Device.  [default: the rig's, else the only adapter]"),
            click.option("--baud", type=int, help="Rate.  [default: the rig's, else the usual ones in turn]"),
            click.option("--rig", "rig_file", type=IN, help="Rig file to take port and rate from."),
            click.option("--json", "as_json", is_flag=True, help="Answer with one JSON document."),
        )
    ):
        command = option(command)
    return command


def confirm(question: str, *, yes: bool) -> None:
    """Ask before something that cannot be undone.

    Raises
    ------
    CommandRefused
        The answer is no.
    KeyboardInterrupt
        One came before, and was lost (`Heeding`): what follows makes something limp, or moves it.
    """
    answer_interrupt()
    if yes:
        return
    try:
        agreed = click.confirm(question, err=True)
    except click.Abort as ended:
        if sys.stdin.isatty() or isinstance(ended.__context__, KeyboardInterrupt):
            raise
        click.echo(err=True)  # nobody there to answer
        agreed = False
    if not agreed:
        raise CommandRefused("not confirmed, and not done; remedy: answer y, or give --yes")


def tell_json(document: object) -> None:
    """One JSON document on standard output."""
    click.echo(json.dumps(document, allow_nan=False))


def columns(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Text in columns, one row per line."""
    table = [tuple(header), *map(tuple, rows)]
    widths = [max(len(row[k]) for row in table) for k in range(len(header))]
    padded = (zip(row, widths, strict=True) for row in table)
    return "\n".join("  ".join(cell.ljust(width) for cell, width in row).rstrip() for row in padded)


def model_name(pong: Pong) -> str:
    """A servo's model, or its number where it is not known."""
    return pong.model.name if pong.model else f"number {pong.model_number}"


def pong_json(pong: Pong, baud: int) -> dict[str, object]:
    """A servo as scan and ping tell of it."""
    return {
        "id": pong.id,
        "baud": baud,
        "model": pong.model.name if pong.model else None,
        "model_number": pong.model_number,
        "firmware": pong.firmware,
        "alert": pong.alert,
    }
