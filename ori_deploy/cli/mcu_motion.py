"""`ori-deploy mcu jog` and `torque-off`: one servo a little, and all of them limp."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import click

from ori_deploy.actuators.mcu.records import config_hash, records
from ori_deploy.actuators.mcu.startup import check_config, check_firmware
from ori_deploy.bench.board import release
from ori_deploy.bench.board_jog import Jog, Jogged, carry_out, plan_again, plan_jog
from ori_deploy.cli.bus_common import DIGITS, confirm, tell_json
from ori_deploy.cli.frame import EXIT_INTERRUPTED, IN, Heeding, example
from ori_deploy.cli.mcu_common import looked_up, place, where_options, wiring_of
from ori_deploy.cli.session import StopRequest
from ori_deploy.clock import MonotonicClock
from ori_deploy.errors import InputError


@click.command(cls=Heeding, epilog=example("ori-deploy mcu jog rig.toml --plan wing.plan.json servo_1 --by 0.1"))
@click.argument("rig_file", metavar="RIG", type=IN)
@click.argument("actuator")
@click.option("--plan", "plan_file", type=IN, required=True, help="Plan whose cells and latch points the rig drives.")
@click.option("--by", "by_rad", type=float, metavar="RAD", help="Turn its shaft by so much.")
@click.option("--to", "to_rad", type=float, metavar="RAD", help="Turn its shaft to here.")
@click.option("--rate", "rate_rad_s", type=float, default=0.2, show_default=True, metavar="RAD_S", help="At most.")
@click.option("--release", "let_go", is_flag=True, help="Turn it off at the end; without it, it holds.")
@click.option("--yes", is_flag=True, help="Do not ask.")
@click.option("--port", help="Device, instead of the one in the rig.")
@click.option("--json", "as_json", is_flag=True, help="Answer with one JSON document.")
def jog(
    rig_file: Path,
    actuator: str,
    plan_file: Path,
    by_rad: float | None,
    to_rad: float | None,
    rate_rad_s: float,
    let_go: bool,
    yes: bool,
    port: str | None,
    as_json: bool,
) -> None:
    """Turn the shaft of one servo slowly and smoothly. Hinges that are off stay off; Ctrl-C brakes."""
    if (by_rad is None) == (to_rad is None):
        raise InputError("--by, --to: one of the two", remedy="for example --by 0.1")
    for name, value in (("--by", by_rad), ("--to", to_rad), ("--rate", rate_rad_s)):
        if value is not None and not math.isfinite(value):
            raise InputError(f"{name}: not a number of radians", value=value, remedy="for example 0.1")
    wiring, rate_hz = wiring_of(rig_file, plan_file)
    with place(port, wiring.settings, wiring).opened() as found:
        check_firmware(found.info, found.line.port.path)
        check_config(found.info, config_hash(records(wiring)), found.line.port.path)
        move = plan_jog(found, wiring, actuator, rate_rad_s, by_rad=by_rad, to_rad=to_rad)
        confirm(_question(move), yes=yes)
        move = plan_again(found, wiring, move, rate_rad_s)
        with StopRequest() as stop:
            clock = MonotonicClock()
            done = carry_out(found, wiring, move, rate_hz, clock, lambda: stop.requested, release=let_go)
    _tell(done, as_json=as_json)
    if not done.arrived:
        sys.exit(EXIT_INTERRUPTED)


def _question(move: Jog) -> str:
    others = f"{', '.join(move.others_on)} hold" if move.others_on else "no other hinge is on"
    return (
        f"{move.hinge.name} turns from {move.start_rad:.4f} to {move.goal_rad:.4f} rad in {move.duration_s:.1f} s, "
        f"and with it what it is coupled to; {others}. Turn it?"
    )


def _tell(done: Jogged, *, as_json: bool) -> None:
    move = done.jog
    if as_json:
        tell_json(
            {
                "actuator": move.hinge.name,
                "start_rad": round(move.start_rad, DIGITS),
                "goal_rad": round(move.goal_rad, DIGITS),
                "told_rad": round(done.told_rad, DIGITS),
                "measured_rad": None if done.measured_rad is None else round(done.measured_rad, DIGITS),
                "arrived": done.arrived,
                "holds": done.holds,
            }
        )
        return
    measured = "not measured" if done.measured_rad is None else f"measured at {done.measured_rad:.4f} rad"
    text = f"{move.hinge.name}: {move.start_rad:.4f} to {done.told_rad:.4f} rad, {measured}; "
    text += "it holds" if done.holds else "off"
    if done.arrived:
        click.echo(text)
    else:
        click.echo(f"interrupted: {text}, stopped on its way to {move.goal_rad:.4f} rad", err=True)


@click.command("torque-off", cls=Heeding, epilog=example("ori-deploy mcu torque-off --rig rig.toml"))
@where_options
@click.option("--latches", "with_latches", is_flag=True, help="Also let electromagnets and lock pins go.")
@click.option("--yes", is_flag=True, help="Do not ask.")
def torque_off(
    port: str | None, rig_file: Path | None, plan_file: Path | None, as_json: bool, with_latches: bool, yes: bool
) -> None:
    """Turn every hinge off. What they hold up falls. Refused while anything moves."""
    with looked_up(port, rig_file, plan_file).opened() as found:
        on = found.hinges_on()
        engaged = found.latches_engaged() if with_latches else ()
        if on or engaged:
            confirm(_what_falls(on, engaged), yes=yes)
        latches = release(found, with_latches=with_latches)
    if as_json:
        tell_json({"released": list(on), "latches": list(latches), "torque_on": False})
        return
    click.echo(f"off: {', '.join(on)}; the structure holds itself, or is held by hand" if on else "no hinge was on")
    if latches:
        click.echo(f"let go: {', '.join(latches)}")


def _what_falls(on: Sequence[str], engaged: Sequence[str]) -> str:
    """The question before it does."""
    what = [f"what {', '.join(on)} holds up falls"] if on else []
    what += [f"what {', '.join(engaged)} holds together comes apart"] if engaged else []
    text = f"{', and '.join(what)}, unless somebody holds it. {'Torque off' if on else 'Let go'}?"
    return text[0].upper() + text[1:]
