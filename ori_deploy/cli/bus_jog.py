"""`ori-deploy bus jog`: turn one servo a little."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import click

from ori_deploy.bench.jog import LONG_WAY_RAD, Jogged, carry_out, plan_move
from ori_deploy.cli.bus_common import ID, confirm, model_name, place, place_options, tell_json
from ori_deploy.cli.frame import EXIT_INTERRUPTED, Heeding, example, warn
from ori_deploy.cli.session import StopRequest
from ori_deploy.clock import MonotonicClock
from ori_deploy.errors import InputError


@click.command(cls=Heeding, epilog=example("ori-deploy bus jog 3 --by 10 --port /dev/ttyUSB0"))
@click.argument("servo_id", metavar="ID", type=ID)
@click.option("--by", "by_deg", type=float, metavar="DEG", help="Turn by so much, counter-clockwise.")
@click.option("--to", "to_deg", type=float, metavar="DEG", help="Turn to here; 0 is the middle of the first turn.")
@click.option("--speed", "speed_deg_s", type=float, default=10.0, show_default=True, metavar="DEG_S")
@click.option("--hold", is_flag=True, help="Leave torque on at the end.")
@click.option("--yes", is_flag=True, help="Move more than 90 degrees without asking.")
@place_options
def jog(
    servo_id: int,
    by_deg: float | None,
    to_deg: float | None,
    speed_deg_s: float,
    hold: bool,
    yes: bool,
    port: str | None,
    baud: int | None,
    rig_file: Path | None,
    as_json: bool,
) -> None:
    """Turn one servo slowly, by or to so many degrees of its shaft.

    Torque goes on where it stands, and is as before at the end. Ctrl-C stops it where it is.
    """
    _check(by_deg, to_deg, speed_deg_s)
    where = place(port, baud, rig_file)
    with where.opened() as line:
        pong = where.one(line, servo_id)
        move = plan_move(
            line,
            pong,
            math.radians(speed_deg_s),
            by_rad=None if by_deg is None else math.radians(by_deg),
            to_rad=None if to_deg is None else math.radians(to_deg),
        )
        if abs(move.way_rad) > LONG_WAY_RAD:
            confirm(f"Servo {servo_id} would turn by {math.degrees(move.way_rad):.1f} deg. Turn it?", yes=yes)
        with StopRequest() as stop:
            done = carry_out(line, move, MonotonicClock(), lambda: stop.requested, keep_holding=hold)
    _tell(done, model_name(pong), as_json=as_json)
    if not done.arrived:
        sys.exit(EXIT_INTERRUPTED)


def _check(by_deg: float | None, to_deg: float | None, speed_deg_s: float) -> None:
    if (by_deg is None) == (to_deg is None):
        raise InputError("--by, --to: one of the two", remedy="for example --by 10")
    for name, value in (("--by", by_deg), ("--to", to_deg), ("--speed", speed_deg_s)):
        if value is not None and not math.isfinite(value):
            raise InputError(f"{name}: not a number of degrees", value=value, remedy="for example 10")


def _tell(done: Jogged, model: str, *, as_json: bool) -> None:
    move, last = done.move, done.last
    if not done.watched:
        warn(
            f"servo {move.pong.id} has firmware {move.pong.firmware}, without bus watchdog: "
            "it would have gone on without this program"
        )
    if as_json:
        tell_json(
            {
                "id": move.pong.id,
                "model": model,
                "start_rad": move.start_rad,
                "goal_rad": move.goal_rad,
                "position_rad": last.position_rad,
                "speed_rad_s": move.speed_rad_s,
                "arrived": done.arrived,
                "torque_on": done.holds,
                "watchdog": done.watched,
            }
        )
        return
    start, end = math.degrees(move.start_rad), math.degrees(last.position_rad)
    text = f"servo {move.pong.id}: {start:.2f} to {end:.2f} deg, torque {'on' if done.holds else 'off'}"
    if done.arrived:
        click.echo(text)
    else:
        click.echo(f"interrupted: {text}, stopped on its way to {math.degrees(move.goal_rad):.2f} deg", err=True)
