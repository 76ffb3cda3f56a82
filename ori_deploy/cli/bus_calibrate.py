"""`ori-deploy bus calibrate`: find the zeros of a rig's hinges, and write them into it."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

import click
import numpy as np

from ori_deploy.actuators.dynamixel.line import Pong, ServoLine
from ori_deploy.actuators.dynamixel.startup import find_servos, read
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.bench.calibration import HingeZero, NotCalibrated, Zero, held_zero
from ori_deploy.bench.servos import torque_off
from ori_deploy.bench.walk import Limits, require_walk, stop_zero
from ori_deploy.cli.bus_common import Place, confirm, place, tell_json
from ori_deploy.cli.bus_rig import DECIMALS, check_new, from_template, save_rig, with_zeros
from ori_deploy.cli.frame import EXIT_INTERRUPTED, IN, Heeding, example, warn
from ori_deploy.cli.session import StopRequest, rig_for
from ori_deploy.clock import MonotonicClock
from ori_deploy.errors import FileError, InputError, RigError, begun
from ori_deploy.files import digest, load_plan
from ori_deploy.motion import Plan

End = Literal["stowed", "deployed"]

_END_OF_STOP: dict[str, End] = {"closing": "stowed", "opening": "deployed"}


@click.command(
    cls=Heeding,
    epilog=example("ori-deploy bus calibrate rig.toml --plan wing.plan.json --pose stowed --port /dev/ttyUSB0"),
)
@click.argument("rig_file", metavar="RIG", type=IN)
@click.option("--plan", "plan_file", type=IN, required=True, help="Plan whose poses are meant.")
@click.option("--hinge", "names", multiple=True, metavar="NAME", help="Actuator or cell; repeatable.  [default: all]")
@click.option("--pose", type=click.Choice(["stowed", "deployed"]), help="The structure is held in this pose by hand.")
@click.option("--stop", type=click.Choice(["closing", "opening"]), help="Walk each hinge to its stop at this end.")
@click.option("--current", type=float, metavar="A", help="With --stop: most current.  [default: 15 % of stall]")
@click.option(
    "--speed", type=float, default=15.0, show_default=True, metavar="DEG_S", help="With --stop: of the shaft."
)
@click.option("--yes", is_flag=True, help="Do not ask, neither for torque off nor at each hinge.")
@click.option("--port", help="Device.  [default: the rig's]")
@click.option("--baud", type=int, help="Rate.  [default: the rig's]")
@click.option("--json", "as_json", is_flag=True, help="Answer with one JSON document.")
def calibrate(
    rig_file: Path,
    plan_file: Path,
    names: tuple[str, ...],
    pose: End | None,
    stop: str | None,
    current: float | None,
    speed: float,
    yes: bool,
    port: str | None,
    baud: int | None,
    as_json: bool,
) -> None:
    """Find zero_rad of every hinge of RIG, and write it into the file; the old file is kept as RIG.bak.

    With --pose the servos are limp and you hold the structure in that pose of the plan. With --stop each hinge is
    walked against its stop at that end, twice, slowly and with little current, and let go of. Something rigid that
    blocks it before its stop is taken for the stop: compare what is printed with what the old zero had.
    """
    end = _end(pose, stop, current, speed)
    plan = load_plan(plan_file)
    rig = rig_for(rig_file, plan)
    where = place(port, baud, rig_file)
    hinges = _hinges(rig, plan, end, names)
    limits = Limits(math.radians(speed), current, rig.controller.max_temperature_c, rig.controller.min_voltage_v)
    found = _measure(where, rig, hinges, None if pose is not None else limits, yes=yes)
    _write(rig_file, rig, plan, found, as_json=as_json)


def _end(pose: End | None, stop: str | None, current: float | None, speed: float) -> End:
    if (pose is None) == (stop is None):
        raise InputError("--pose, --stop: one of the two", remedy="for example --pose stowed")
    if current is not None and pose is not None:
        raise InputError("--current: goes with --stop", value=current, remedy="leave it out")
    for name, value in (("--current", current), ("--speed", speed)):
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"{name}: has to be above 0", value=value, remedy="choose another value")
    return pose if pose is not None else _END_OF_STOP[stop or ""]


def _hinges(rig: ResolvedRig, plan: Plan, end: End, names: tuple[str, ...]) -> tuple[HingeZero, ...]:
    """The hinges that were named, in the order of the cells; all of them without names."""
    if rig.wiring is None:
        raise RigError(
            "nothing to calibrate", value=f'backend = "{rig.backend}"', limit='backend = "dynamixel"',
            remedy="give the rig of the servos", source=rig.source,
        )  # fmt: skip
    known = {name: k for k, hinge in enumerate(rig.hinges) for name in (hinge.cell, hinge.actuator)}
    for name in names:
        if name not in known:
            raise InputError(
                "--hinge: no such hinge", value=name, limit=f"one of {', '.join(rig.hinge_ids)}, or a cell",
                remedy="correct the name",
            )  # fmt: skip
    stowed, deployed = rig.driven(plan.crease_angles_rad[0]), rig.driven(plan.crease_angles_rad[-1])
    here, there = (stowed, deployed) if end == "stowed" else (deployed, stowed)
    chosen = sorted({known[name] for name in names}) or range(len(rig.hinges))
    return tuple(
        HingeZero(
            servo=rig.wiring.hinges[k],
            cell=rig.hinges[k].cell,
            crease=rig.hinges[k].crease,
            shaft_per_crease=float(rig.shaft_per_crease[k]),
            old_zero_rad=rig.hinges[k].zero_rad,
            crease_rad=float(here[k]),
            other_rad=float(there[k]),
        )
        for k in chosen
    )


def _measure(
    where: Place, rig: ResolvedRig, hinges: tuple[HingeZero, ...], limits: Limits | None, *, yes: bool
) -> list[Zero]:
    """Every hinge in turn; by its stop with limits, held by hand without."""
    if rig.wiring is None:
        raise ValueError("the hinges have servos")
    clock = MonotonicClock()
    found: list[Zero] = []
    with where.opened() as line:
        wiring = replace(rig.wiring, hinges=tuple(hinge.servo for hinge in hinges), pins=())
        pongs = find_servos(line, wiring)
        chosen = [pongs[hinge.servo.id] for hinge in hinges]
        # What cannot be walked is found out before what the others hold up comes down.
        fastest = {} if limits is None else {pong.id: require_walk(line, pong, limits) for pong in chosen}
        limp = _let_go(line, chosen, yes=yes)
        for hinge, pong in zip(hinges, chosen, strict=True):
            name = f"{hinge.servo.name} (id {hinge.servo.id}, {hinge.crease} of cell {hinge.cell})"
            with begun(already=limp or (limits is not None and bool(found))):  # those before it have been walked
                if limits is None:
                    confirm(f"{name}: held at {math.degrees(hinge.crease_rad):.2f} deg of its crease?", yes=yes)
                    zero = held_zero(line, pong, hinge, clock, partial(_warn_of_turns, hinge))
                else:
                    speed = math.degrees(fastest[pong.id])
                    click.echo(f"{name}: walks to its stop, at up to {speed:.2f} deg/s of the shaft", err=True)
                    confirm(f"{name}: is its way free?", yes=yes)
                    zero = _by_stop(line, pong, hinge, limits)
            found.append(zero)
            found_at = "" if limits is None else f"; {_against_old(zero)}"
            click.echo(f"{name}: zero_rad {hinge.old_zero_rad:.6f}, found {zero.zero_rad:.6f}{found_at}", err=True)
    return found


def _warn_of_turns(hinge: HingeZero) -> None:
    """Said at once: it has forgotten them however its calibration ends."""
    if not hinge.servo.one_turn:
        warn(
            f"{hinge.servo.name}, of more than one turn, has forgotten its turns: "
            "say --stands stowed or --stands deployed with the next motion"
        )


def _against_old(zero: Zero) -> str:
    """Where a stop was met: what blocks a hinge before its stop is seen by nothing else."""
    where = "before" if zero.short_rad > 0.0 else "beyond"
    return f"its stop {math.degrees(abs(zero.short_rad)):.2f} deg of the shaft {where} where the old zero has it"


def _by_stop(line: ServoLine, pong: Pong, hinge: HingeZero, limits: Limits) -> Zero:
    with StopRequest() as stop:
        try:
            zero = stop_zero(
                line, pong, hinge, limits, MonotonicClock(), lambda: stop.requested, partial(_warn_of_turns, hinge)
            )
            why = "at its stop"
        except NotCalibrated as ended:
            if not stop.requested:
                raise
            zero, why = None, str(ended)
    # Looked at once no signal is only noted any more. One at the stop itself ends it too: no other hinge may move.
    if zero is None or stop.requested:
        click.echo(f"interrupted: {why}; it is limp, and nothing was written", err=True)
        sys.exit(EXIT_INTERRUPTED)
    return zero


def _let_go(line: ServoLine, pongs: list[Pong], *, yes: bool) -> bool:
    """Servos have to be limp before they are calibrated; whether any was not."""
    holding = [p for p in pongs if p.model is not None and read(line, p.id, p.model.table.torque_enable)]
    if holding:
        ids = ", ".join(str(pong.id) for pong in holding)
        confirm(f"Servo {ids} holds torque, and goes limp with what it holds up. Torque off?", yes=yes)
        torque_off(line, holding)
    return bool(holding)


def _write(rig_file: Path, rig: ResolvedRig, plan: Plan, found: list[Zero], *, as_json: bool) -> None:
    zeros = {zero.hinge.cell: zero.zero_rad for zero in found}
    with StopRequest():  # a signal waits until both files are there
        try:
            backup, new_entries = _save(rig_file, rig, plan, zeros)
        except (FileError, OSError, ValueError) as wrong:  # no bad input any more: hinges have been calibrated
            what = ", ".join(f"{cell} {zero:.{DECIMALS}f}" for cell, zero in zeros.items())
            raise NotCalibrated(
                f"zero_rad were found and not written, {what}: {_remedied(wrong, rig_file)}"
            ) from wrong
    if as_json:
        tell_json(
            {
                "rig": str(rig_file),
                "backup": str(backup),
                "new_entries": new_entries,
                "hinges": [_zero_json(zero) for zero in found],
            }
        )
        return
    largest = max(found, key=lambda zero: abs(zero.zero_rad - zero.hinge.old_zero_rad))
    moved = abs(largest.zero_rad - largest.hinge.old_zero_rad)
    click.echo(f"{len(found)} zeros written to {rig_file}, the largest change {np.degrees(moved):.2f} deg of a shaft")
    if new_entries:
        click.echo(
            f"cells {', '.join(new_entries)} came from [each_cell], which has one zero for all: "
            "they have [[actuator]] and [[hinge]] entries of their own now"
        )
    click.echo(f"the old file is {backup}")


def _save(rig_file: Path, rig: ResolvedRig, plan: Plan, zeros: dict[str, float]) -> tuple[Path, list[str]]:
    """Write the zeros into the file that was read at first; where the old one is, and cells with new entries."""
    if digest(rig_file) != rig.sha256:  # what came instead may be anything, half a file among it
        raise FileError(
            f"{rig_file}: changed while the hinges were calibrated",
            limit="the file that was read",
            remedy="put them in by hand, or calibrate again",
        )
    old = rig_file.read_bytes().decode("utf-8")  # line ends as they are
    new_entries = [cell for cell in from_template(old, rig) if cell in zeros]
    text = with_zeros(old, rig, zeros)
    check_new(text, rig, plan, zeros)
    return save_rig(rig_file, text, rig.sha256), new_entries


def _remedied(wrong: Exception, rig_file: Path) -> str:
    if isinstance(wrong, FileError):
        return str(wrong)
    return f"{rig_file}: {wrong}; remedy: put them in by hand, or calibrate again"


def _zero_json(zero: Zero) -> dict[str, object]:
    hinge = zero.hinge
    return {
        "hinge": hinge.servo.name,
        "id": hinge.servo.id,
        "cell": hinge.cell,
        "crease": hinge.crease,
        "crease_rad": hinge.crease_rad,
        "shaft_rad": zero.shaft_rad,
        "scatter_rad": zero.scatter_rad,
        "old_zero_rad": hinge.old_zero_rad,
        "zero_rad": round(zero.zero_rad, DECIMALS),
    }
