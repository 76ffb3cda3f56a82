"""`ori-deploy bus monitor`: servos as they are, again and again."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

import click
from rich.live import Live
from rich.text import Text

from ori_deploy.actuators.dynamixel.line import Pong, ServoLine
from ori_deploy.bench.meaning import error_words
from ori_deploy.bench.servos import Snapshot, find, find_all, known_model, snapshots
from ori_deploy.cli.bus_common import DIGITS, ID, Place, columns, model_name, place, place_options
from ori_deploy.cli.frame import Heeding, console, example
from ori_deploy.cli.session import StopRequest
from ori_deploy.clock import MonotonicClock
from ori_deploy.wire.dynamixel.models import RPM

_HEADER = ("id", "model", "deg", "rad", "rpm", "effort", "volt", "°C", "torque", "error")


@click.command(cls=Heeding, epilog=example("ori-deploy bus monitor 1 2 3 --rate 10 --port /dev/ttyUSB0"))
@click.argument("ids", nargs=-1, type=ID)
@click.option("--rate", "rate_hz", type=click.FloatRange(0.1, 100.0), default=5.0, show_default=True, metavar="HZ")
@click.option("--count", type=click.IntRange(1), help="Stop after so many; without it, Ctrl-C does.")
@place_options
def monitor(
    ids: tuple[int, ...],
    rate_hz: float,
    count: int | None,
    port: str | None,
    baud: int | None,
    rig_file: Path | None,
    as_json: bool,
) -> None:
    """Show positions, speeds, currents, voltages, temperatures and errors until Ctrl-C.

    With --json, one document per line. Nothing is written to the servos.
    """
    where = place(port, baud, rig_file)
    with where.opened() as line, StopRequest() as stop:
        pongs = _servos(where, line, ids)
        clock = MonotonicClock()
        began = clock.now()
        shown = 0
        in_place = console.is_terminal and not as_json
        with Live(console=console, auto_refresh=False) if in_place else nullcontext() as live:
            while not stop.requested:
                time_s = clock.now() - began
                seen = snapshots(line, pongs)
                if as_json:
                    click.echo(json.dumps(_document(time_s, pongs, seen), allow_nan=False))
                elif live is not None:
                    live.update(Text(_table(pongs, seen)), refresh=True)
                else:
                    click.echo(_table(pongs, seen))
                shown += 1
                if shown == count:
                    break
                clock.sleep_until(began + shown / rate_hz)


def _servos(where: Place, line: ServoLine, ids: tuple[int, ...]) -> tuple[Pong, ...]:
    """Those that were named, at the rate of the first; or all."""
    if not ids:
        return tuple(pong for pong in find_all(line, where.bauds) if known_model(pong))
    first = find(line, ids[0], where.bauds)
    rate = (line.port.getBaudRate(),)
    pongs = (first, *(find(line, servo_id, rate) for servo_id in dict.fromkeys(ids[1:]) if servo_id != first.id))
    return tuple(pong for pong in pongs if known_model(pong))


def _document(time_s: float, pongs: Sequence[Pong], seen: Sequence[Snapshot | None]) -> dict[str, object]:
    return {
        "time_s": round(time_s, 4),
        "servos": [
            {"id": pong.id, "answered": False}
            if one is None
            else {
                "id": one.id,
                "answered": True,
                "position_rad": round(one.position_rad, DIGITS),
                "velocity_rad_s": round(one.velocity_rad_s, DIGITS),
                "current_a": None if one.current_a is None else round(one.current_a, DIGITS),
                "load_fraction": None if one.load is None else round(one.load, DIGITS),
                "voltage_v": round(one.voltage_v, DIGITS),
                "temperature_c": one.temperature_c,
                "torque_on": one.torque_on,
                "error_bits": one.error_bits,
                "error": error_words(one.error_bits),
            }
            for pong, one in zip(pongs, seen, strict=True)
        ],
    }


def _table(pongs: Sequence[Pong], seen: Sequence[Snapshot | None]) -> str:
    return columns(_HEADER, [_row(pong, one) for pong, one in zip(pongs, seen, strict=True)])


def _row(pong: Pong, one: Snapshot | None) -> tuple[str, ...]:
    if one is None:
        return (str(pong.id), model_name(pong), "-", "-", "-", "-", "-", "-", "-", "no answer")
    effort = f"{one.current_a:+.3f} A" if one.current_a is not None else f"{100.0 * (one.load or 0.0):+.1f} %"
    return (
        str(one.id),
        model_name(pong),
        f"{math.degrees(one.position_rad):+.2f}",
        f"{one.position_rad:+.4f}",
        f"{one.velocity_rad_s / RPM:+.2f}",
        effort,
        f"{one.voltage_v:.1f}",
        f"{one.temperature_c:.0f}",
        "on" if one.torque_on else "off",
        error_words(one.error_bits),
    )
