"""A simulated microcontroller on a pty: `python -m sim_backends.mcu --link PATH`.

A host cannot tell it from a board with servos and latches. It ends on SIGINT or SIGTERM.
"""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path

import click

from ori_deploy.errors import InputError, OriDeployError
from sim_backends.microcontroller.build import Port
from sim_backends.microcontroller.from_rig import Start, linked_world_for_files, world_for_files
from sim_backends.microcontroller.launcher import Microcontroller
from sim_backends.microcontroller.linked import LinkedStructure
from sim_backends.microcontroller.spec import HingeSpec, LatchSpec, WorldSpec

__all__ = ["HingeSpec", "LatchSpec", "Microcontroller", "WorldSpec", "main"]

EXIT_BAD_INPUT = 2
LINK_PERIOD_S = 0.02


class _End:
    """Whether SIGINT or SIGTERM has come.

    Nothing is raised where one comes: raised within `subprocess`, between the taking and the giving back of its
    lock, it left a process that waited for its board for ever.
    """

    def __init__(self) -> None:
        self.asked = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def _ask(self, *_: object) -> None:
        self.asked = True


def bench() -> WorldSpec:
    """Twelve servos with pots, nothing between them."""
    return WorldSpec(hinges=tuple(HingeSpec(output=k, adc=k) for k in range(12)))


def _world(
    rig_file: Path | None,
    plan_file: Path | None,
    start: Start,
    plant: Path | None,
    loads: Path | None,
    *,
    linked: bool,
) -> tuple[WorldSpec, tuple[int, ...]]:
    """The world, and the servos on another bus that turn its hinges."""
    if (plant is not None and (linked or rig_file is None)) or (loads is not None and plant is None):
        raise InputError(
            "--plant and --loads", limit="--plant with --rig and --plan, without --servos; --loads with --plant",
            remedy="give the others as well; beside servos on another bus, their own --plant",
        )  # fmt: skip
    if rig_file is not None and plan_file is not None:
        if linked:
            return linked_world_for_files(rig_file, plan_file, start)
        return world_for_files(rig_file, plan_file, start, plant, loads), ()
    if rig_file is not None or plan_file is not None or linked:
        raise InputError(
            "--rig, --plan and --servos", limit="--rig and --plan together; --servos with both",
            remedy="give the others as well",
        )  # fmt: skip
    return bench(), ()


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--link", type=click.Path(path_type=Path), required=True, help="Name of the port.")
@click.option("--port", type=click.Choice(["host", "atmega2560"]), default="atmega2560", show_default=True)
@click.option("--elf", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="Another program.")
@click.option(
    "--rig", "rig_file", type=click.Path(path_type=Path), help="Rig file whose servos and latches are simulated."
)
@click.option("--plan", "plan_file", type=click.Path(path_type=Path), help="Plan of the structure between them.")
@click.option("--plant", type=click.Path(path_type=Path, dir_okay=False), help="With --plan: the design it drives.")
@click.option("--loads", type=click.Path(path_type=Path, dir_okay=False), help="With --plant: its loads file.")
@click.option("--start", type=click.Choice(["stowed", "deployed"]), default="stowed", show_default=True)
@click.option(
    "--servos",
    type=click.Path(path_type=Path),
    metavar="CONTROL",
    help="Control socket of a simulated Dynamixel bus, whose servos turn the hinges: latches close where they stand.",
)
@click.option("--eeprom", type=click.Path(path_type=Path, dir_okay=False), help="File that keeps the EEPROM.")
def main(
    link: Path,
    port: Port,
    elf: Path | None,
    rig_file: Path | None,
    plan_file: Path | None,
    plant: Path | None,
    loads: Path | None,
    start: Start,
    servos: Path | None,
    eeprom: Path | None,
) -> None:
    """The firmware on a simulated board, behind a pty, until Ctrl-C.

    \b
    Example:
      python -m sim_backends.mcu --link out/ttyMCU --rig rig.toml --plan wing.plan.json
    """

    end = _End()
    try:
        world, ids = _world(rig_file, plan_file, start, plant, loads, linked=servos is not None)
        with Microcontroller(world, link, port=port, program=elf, eeprom=eeprom) as board:
            structure = None if servos is None else LinkedStructure(board, servos, ids)
            if structure is not None:
                structure.step()  # before anybody is told that it is there
            click.echo(board.greeting)
            while not end.asked and board.running:
                time.sleep(LINK_PERIOD_S)
                if structure is not None:
                    structure.step()
    except OriDeployError as wrong:
        click.echo(f"error: {wrong}", err=True)
        sys.exit(EXIT_BAD_INPUT)


if __name__ == "__main__":
    main()
