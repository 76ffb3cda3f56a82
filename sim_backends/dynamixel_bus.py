"""A virtual Dynamixel bus on a pty: `python -m sim_backends.dynamixel_bus --servos 1-12:xm430 --link PATH`.

A host cannot tell it from a U2D2 with servos. It ends on SIGINT or SIGTERM.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from itertools import chain
from pathlib import Path

import click

from ori_deploy.errors import InputError, OriDeployError
from sim_backends.dynamixel.from_rig import Start, spec_for_files
from sim_backends.dynamixel.launcher import VirtualBus
from sim_backends.dynamixel.process import Process
from sim_backends.dynamixel.spec import NEWEST_FIRMWARE, BusSpec, PinSpec, ServoSpec

__all__ = ["BusSpec", "PinSpec", "ServoSpec", "VirtualBus", "main"]

EXIT_BAD_INPUT = 2


def parse_servos(text: str, firmware: int = NEWEST_FIRMWARE) -> tuple[ServoSpec, ...]:
    """Servos of `IDS:MODEL`, where IDS are numbers and ranges: "1-3,7:xm430".

    Raises
    ------
    InputError
        It cannot be read so.
    """
    ids, _, model = text.rpartition(":")
    try:
        ranges = [[int(end) for end in part.split("-")] for part in ids.split(",")]
    except ValueError:
        ranges = []
    if not ranges or any(len(bounds) > 2 or bounds[0] > bounds[-1] for bounds in ranges):
        raise InputError("--servos", value=repr(text), limit="IDS:MODEL", remedy="for example 1-12:xm430")
    numbers = chain.from_iterable(range(bounds[0], bounds[-1] + 1) for bounds in ranges)
    return tuple(ServoSpec(id=i, model=model, firmware=firmware) for i in numbers)


def make_spec(
    servos: tuple[str, ...],
    rig: Path | None,
    plan: Path | None,
    spec: Path | None,
    start: Start,
    baud: int | None,
    firmware: int,
    plant: Path | None = None,
    loads: Path | None = None,
) -> BusSpec:
    """What the options describe; exactly one of servos, rig and spec."""
    given = [name for name, value in (("--servos", servos), ("--rig", rig), ("--spec", spec)) if value]
    if len(given) != 1:
        raise InputError(
            "what is on the bus", value=" and ".join(given) or "nothing", limit="one of --servos, --rig, --spec",
            remedy="give one of them",
        )  # fmt: skip
    if plant is not None and rig is None:
        raise InputError("--plant: which servo drives which crease", limit="a rig", remedy="give --rig and --plan")
    if loads is not None and plant is None:
        raise InputError("--loads: goes with --plant", remedy="add --plant DESIGN")
    if spec is not None:
        made = _load_spec(spec)
    elif rig is not None:
        made = spec_for_files(rig, plan, start, plant, loads)
    else:
        made = BusSpec(servos=tuple(servo for text in servos for servo in parse_servos(text, firmware)))
    return made if baud is None else replace(made, baud=baud)


def _load_spec(path: Path) -> BusSpec:
    try:
        return BusSpec.from_json(json.loads(path.read_text()))
    except (OSError, ValueError, KeyError, TypeError) as wrong:
        raise InputError(
            f"{path}: no specification of a bus",
            value=f"{type(wrong).__name__}: {wrong}",
            remedy="write what BusSpec.to_json() makes",
        ) from wrong


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--servos", multiple=True, metavar="IDS:MODEL", help="For example 1-12:xm430; repeatable.")
@click.option("--rig", type=click.Path(path_type=Path, dir_okay=False), help="The servos of a rig file.")
@click.option("--plan", type=click.Path(path_type=Path, dir_okay=False), help="With --rig: the structure's motion.")
@click.option("--plant", type=click.Path(path_type=Path, dir_okay=False), help="With --plan: the design they drive.")
@click.option("--loads", type=click.Path(path_type=Path, dir_okay=False), help="With --plant: its loads file.")
@click.option("--start", type=click.Choice(["stowed", "deployed"]), default="stowed", show_default=True)
@click.option("--spec", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="A specification in JSON.")
@click.option("--baud", type=int, help="Rate of the servos.  [default: 1000000, or the rig's]")
@click.option("--firmware", type=int, default=NEWEST_FIRMWARE, show_default=True, help="Of --servos.")
@click.option("--link", type=click.Path(path_type=Path), required=True, help="Name of the port.")
@click.option("--control", type=click.Path(path_type=Path), help="Control socket.  [default: LINK.control]")
@click.option("--wire-timing/--no-wire-timing", default=None, help="Whether answers take their time.  [default: yes]")
@click.option("--usb-latency-ms", type=float, help="Of the adapter.  [default: 1]")
@click.option("--seed", type=int, help="Of the noise in readings.  [default: 0]")
def main(
    servos: tuple[str, ...],
    rig: Path | None,
    plan: Path | None,
    plant: Path | None,
    loads: Path | None,
    start: Start,
    spec: Path | None,
    baud: int | None,
    firmware: int,
    link: Path,
    control: Path | None,
    wire_timing: bool | None,
    usb_latency_ms: float | None,
    seed: int | None,
) -> None:
    """Simulated Dynamixel X-series servos behind a pty, until Ctrl-C.

    \b
    Examples:
      python -m sim_backends.dynamixel_bus --servos 1-12:xm430 --baud 4000000 --link /tmp/ttyDXL
      python -m sim_backends.dynamixel_bus --rig RIG --plan PLAN --link /tmp/ttyDXL
      python -m sim_backends.dynamixel_bus --rig RIG --plan PLAN --plant DESIGN --link /tmp/ttyDXL
    """
    try:
        made = make_spec(servos, rig, plan, spec, start, baud, firmware, plant, loads)
        if wire_timing is not None:
            made = replace(made, wire_timing=wire_timing)
        if usb_latency_ms is not None:
            made = replace(made, usb_latency_s=1e-3 * usb_latency_ms)
        if seed is not None:
            made = replace(made, seed=seed)
        process = Process(made, link, control or link.with_name(f"{link.name}.control"))
        process.run(lambda line: click.echo(line))
    except OriDeployError as wrong:
        click.echo(f"error: {wrong}", err=True)
        sys.exit(EXIT_BAD_INPUT)


if __name__ == "__main__":
    main()
