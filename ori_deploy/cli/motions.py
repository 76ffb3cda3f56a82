"""`ori-deploy deploy | stow | recover`: a plan carried out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from ori_deploy.cli.frame import EXIT_INTERRUPTED, EXIT_NOT_DONE, IN, OUT, Heeding, example, warn
from ori_deploy.cli.given import named
from ori_deploy.cli.session import Command, Options, StoppedBy, carry_out, lost_observers
from ori_deploy.cli.spanwise import span_option, tell_span
from ori_deploy.cli.viewing import view_options, viewed, viewing
from ori_deploy.deploy.result import MotionResult, Outcome


def _motion_options(command: Callable[..., None]) -> Callable[..., None]:
    """What every command that moves takes."""
    for option in reversed(
        (
            click.argument("plan_file", metavar="PLAN", type=IN),
            click.option("--rig", type=IN, required=True, help="Rig file the plan was made with."),
            click.option("--log", type=OUT, help="Flight log to write (MCAP)."),
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
                type=OUT,
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
    if not results and stopped is None:
        click.echo(f"{ends} already: measured there, every latch of that end confirmed; nothing was moved")
        return
    if not results:
        click.echo("interrupted: before anything moved", err=True)
        sys.exit(EXIT_INTERRUPTED)
    for line in lost_observers(results[-1]):
        warn(line)
    if stopped and not results[-1].succeeded:
        where = "brought to rest along its path" if results[-1].outcome is Outcome.STOPPED else "see the fault above"
        click.echo(f"interrupted: {where}; asked for by {stopped}", err=True)
        sys.exit(EXIT_INTERRUPTED)
    if not results[-1].succeeded:
        click.echo(f"error: not {ends}", err=True)
        sys.exit(EXIT_NOT_DONE)


def _motion_command(name: Command, text: str, ends: str) -> click.Command:
    @click.command(
        name,
        cls=Heeding,
        help=text,
        epilog=example(f"ori-deploy {name} wing.plan.json --rig examples/rig_mock.toml --log run.mcap"),
    )
    @_motion_options
    @view_options
    @click.option("--beyond-loopback", is_flag=True, help="Let other machines see the page of --view.")
    @span_option(name)
    def command(plan_file: Path, rig: Path, **given: Any) -> None:
        how = viewing(given)
        given["realtime"] |= how.wanted  # a virtual clock is done before anybody has looked
        with viewed(plan_file, how, stays=True):
            made, results, stopped = carry_out(
                plan_file, rig, (name,), Options(**given, also_read=named((how.design,)))
            )
            _tell_end(results, stopped, ends)
            tell_span(made, name)

    return command


deploy = _motion_command(
    "deploy", "Carry PLAN out: unlock, open, latch. Ends with every latch confirmed, or says why not.", "deployed"
)
stow = _motion_command(
    "stow", "Carry PLAN out backwards: unlatch, close. Ends measured flat, or says why not.", "stowed"
)


@click.command(
    cls=Heeding, epilog=example("ori-deploy recover wing.plan.json --rig rig.toml --design wing.design.json")
)
@_motion_options
@click.option("--design", type=IN, required=True, help="Design file, to check every pose of the way with.")
def recover(plan_file: Path, rig: Path, **given: Any) -> None:
    """Bring cells that are out of step back onto the path, along a way that is checked for interference.

    Ends holding, all cells at one fold; then deploy or stow.
    """
    _, results, stopped = carry_out(plan_file, rig, ("recover",), Options(**given))
    _tell_end(results, stopped, "in step")
