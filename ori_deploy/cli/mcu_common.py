"""What the commands for a microcontroller share: which board, at which port, and what its parts are called."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click

from ori_deploy.actuators.mcu.settings import McuSettings, Thermistor
from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.actuators.resolve import resolve_rig
from ori_deploy.actuators.rig import STOW_POINT, Rig, load_rig
from ori_deploy.bench.board import BOOT_WAIT_S, Board, board
from ori_deploy.cli.bus_common import adapters
from ori_deploy.cli.frame import IN, nothing_moved
from ori_deploy.cli.session import rig_for
from ori_deploy.clock import MonotonicClock
from ori_deploy.errors import InputError, RigError
from ori_deploy.files import load_plan

BAUD = 500_000
"""The one rate that the firmware knows."""

_F = TypeVar("_F", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class Place:
    """Where a board is looked for.

    Attributes
    ----------
    port
        Device.
    boot_wait_s
        As `McuSettings.boot_wait_s`.
    hinges, latches
        What the rig calls them, as far as it is known.
    thermistor
        The rig's, if there is a rig.
    """

    port: str
    boot_wait_s: float
    hinges: tuple[str, ...] = ()
    latches: tuple[str, ...] = ()
    thermistor: Thermistor | None = None

    @contextmanager
    def opened(self) -> Iterator[Board]:
        """The board, for this process alone. Raises as `ori_deploy.bench.board.board`."""
        names = (self.hinges, self.latches)
        with ExitStack() as open_ones:
            with nothing_moved():
                found = open_ones.enter_context(board(self.port, BAUD, MonotonicClock(), self.boot_wait_s, names))
            yield found


def place(port: str | None, settings: McuSettings | None, wiring: McuWiring | None = None) -> Place:
    """What was said, else what the rig says, else the only board there is.

    Raises
    ------
    InputError
        No board is plugged in, or more than one to choose from.
    """
    if port is None and settings is None:
        port = _only_board()
    return Place(
        port or (settings.port if settings else ""),
        settings.boot_wait_s if settings else BOOT_WAIT_S,
        () if wiring is None else tuple(hinge.name for hinge in wiring.hinges),
        () if wiring is None else tuple(latch.name for latch in wiring.latches),
        settings.thermistor if settings else None,
    )


def _only_board() -> str:
    found = adapters()
    if len(found) == 1:
        return found[0]
    raise InputError(
        "--port: which one?" if found else "--port: no board is plugged in",
        value=", ".join(found) or None,
        limit="the only one is taken without asking",
        remedy=f"give --port, for example --port {found[0]}" if found else "plug it in, or give --port",
    )


def with_board(rig: Rig) -> McuSettings:
    """What a rig says of its microcontroller.

    Raises
    ------
    RigError
        It has none.
    """
    if rig.mcu is None:
        raise _no_board(rig.backend, rig.source)
    return rig.mcu


def _no_board(backend: str, source: str | None) -> RigError:
    return RigError(
        "no microcontroller here", value=f'backend = "{backend}"', limit="a table [mcu]",
        remedy="give another rig, or --port", source=source,
    )  # fmt: skip


def looked_up(port: str | None, rig_file: Path | None, plan_file: Path | None) -> Place:
    """Where the board is, and what its parts are called, as far as rig and plan tell.

    Raises
    ------
    InputError
        A file cannot be used; the rig has no microcontroller; a plan without a rig.
    """
    if rig_file is None:
        if plan_file is not None:
            raise InputError("--plan: goes with a rig", value=str(plan_file), remedy="give --rig as well")
        return place(port, None)
    rig = load_rig(rig_file)
    settings = with_board(rig)
    wiring = wiring_of(rig_file, plan_file)[0] if plan_file is not None else named_wiring(rig)
    return place(port, settings, wiring)


def wiring_of(rig_file: Path, plan_file: Path) -> tuple[McuWiring, float]:
    """What a rig wires to its board for the cells and latch points of a plan, and its rate. Raises as `looked_up`."""
    rig = rig_for(rig_file, load_plan(plan_file))
    if rig.mcu is None:
        raise _no_board(rig.backend, rig.source)
    return rig.mcu, rig.rate_hz


def named_wiring(rig: Rig) -> McuWiring | None:
    """What is named in the rig itself; None where templates decide what is wired where."""
    if rig.each_cell is not None or (rig.backend == "mcu" and not rig.hinge):
        return None
    points = tuple(latch.secures for latch in rig.latch if latch.secures != STOW_POINT)
    try:
        return resolve_rig(rig, tuple(hinge.cell for hinge in rig.hinge), points).mcu
    except RigError:
        return None  # it does not fit without a plan, and names are all that is lost


def _known_rate(ctx: click.Context, param: click.Parameter, value: int | None) -> None:
    if value is not None and value != BAUD:
        raise click.BadParameter(f"{value} is no rate of the firmware; limit: {BAUD}", ctx, param)


def where_options(command: _F) -> _F:
    """The options that say where the board is, and how to answer."""
    for option in reversed(
        (
            click.option("--port", help="Device.  [default: the rig's, else the only board]"),
            click.option(
                "--baud", type=int, callback=_known_rate, expose_value=False, help=f"{BAUD}: there is no other."
            ),
            click.option("--rig", "rig_file", type=IN, help="Rig file: its port, and the names of its parts."),
            click.option("--plan", "plan_file", type=IN, help="Plan of the rig: names what its templates make."),
            click.option("--json", "as_json", is_flag=True, help="Answer with one JSON document."),
        )
    ):
        command = option(command)
    return command
