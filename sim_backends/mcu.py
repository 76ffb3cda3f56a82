"""A simulated microcontroller on a pty: `python -m sim_backends.mcu --link PATH`.

A host cannot tell it from a board with servos and latches. It ends on SIGINT or SIGTERM.
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import click

from ori_deploy.errors import InputError, OriDeployError
from sim_backends.microcontroller.build import Port
from sim_backends.microcontroller.from_rig import Start, world_for_files
from sim_backends.microcontroller.launcher import Microcontroller
from sim_backends.microcontroller.spec import HingeSpec, LatchSpec, WorldSpec

__all__ = ["HingeSpec", "LatchSpec", "Microcontroller", "WorldSpec", "main"]

EXIT_BAD_INPUT = 2


def bench() -> WorldSpec:
    """Twelve servos with pots, nothing between them."""
    return WorldSpec(hinges=tuple(HingeSpec(output=k, adc=k) for k in range(12)))


def _world(rig_file: Path | None, plan_file: Path | None, start: Start) -> WorldSpec:
    if rig_file is not None and plan_file is not None:
        return world_for_files(rig_file, plan_file, start)
    if rig_file is not None or plan_file is not None:
        raise InputError("--rig and --plan", limit="both or none", remedy="give the other one as well")
    return bench()


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--link", type=click.Path(path_type=Path), required=True, help="Name of the port.")
@click.option("--port", type=click.Choice(["host", "atmega2560"]), default="atmega2560", show_default=True)
@click.option("--elf", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="Another program.")
@click.option(
    "--rig", "rig_file", type=click.Path(path_type=Path), help="Rig file whose servos and latches are simulated."
)
@click.option("--plan", "plan_file", type=click.Path(path_type=Path), help="Plan of the structure between them.")
@click.option("--start", type=click.Choice(["stowed", "deployed"]), default="stowed", show_default=True)
@click.option("--eeprom", type=click.Path(path_type=Path, dir_okay=False), help="File that keeps the EEPROM.")
def main(
    link: Path,
    port: Port,
    elf: Path | None,
    rig_file: Path | None,
    plan_file: Path | None,
    start: Start,
    eeprom: Path | None,
) -> None:
    """The firmware on a simulated board, behind a pty, until Ctrl-C.

    \b
    Example:
      python -m sim_backends.mcu --link out/ttyMCU --rig rig.toml --plan wing.plan.json
    """

    def end(*_: object) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, end)
    try:
        with Microcontroller(
            _world(rig_file, plan_file, start), link, port=port, program=elf, eeprom=eeprom
        ) as board:
            click.echo(board.greeting)
            board.wait()
    except OriDeployError as wrong:
        click.echo(f"error: {wrong}", err=True)
        sys.exit(EXIT_BAD_INPUT)
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
