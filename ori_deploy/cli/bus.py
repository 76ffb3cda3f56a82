"""`ori-deploy bus`: single servos at the bench."""

from __future__ import annotations

from pathlib import Path

import click

from ori_deploy.actuators.dynamixel.line import Pong, ServoLine
from ori_deploy.actuators.dynamixel.startup import read
from ori_deploy.bench.every_rate import Found, find_at_every_rate, torque_off_at_every_rate
from ori_deploy.bench.meaning import Meaning, error_words
from ori_deploy.bench.restart import Reset, errors_of, reset_error
from ori_deploy.bench.servos import (
    USUAL_BAUDS,
    Census,
    census,
    known_model,
    registers,
    set_baud,
    set_id,
    torque_off,
)
from ori_deploy.cli.bus_calibrate import calibrate
from ori_deploy.cli.bus_common import (
    DIGITS,
    ID,
    Place,
    columns,
    confirm,
    model_name,
    place,
    place_options,
    pong_json,
    tell_json,
    which_servo,
)
from ori_deploy.cli.bus_jog import jog
from ori_deploy.cli.bus_monitor import monitor
from ori_deploy.cli.frame import Commands, Heeding, example, nothing_moved, warn
from ori_deploy.clock import MonotonicClock
from ori_deploy.errors import begun
from ori_deploy.wire.dynamixel import BAUD_CODES

_UNITS = {"rad": "rad", "rad_s": "rad/s", "rad_s2": "rad/s2", "a": "A", "v": "V", "c": "°C", "s": "s"}


@click.group(cls=Commands, epilog=example("ori-deploy bus scan --port /dev/ttyUSB0"))
def bus() -> None:
    """Find, name, calibrate and watch single Dynamixel servos."""


@bus.command(epilog=example("ori-deploy bus scan --port /dev/ttyUSB0"))
@place_options
@click.option("--every-baud", is_flag=True, help="Also try the rates that are hardly ever used.")
def scan(port: str | None, baud: int | None, rig_file: Path | None, as_json: bool, every_baud: bool) -> None:
    """Tell who is on the bus, and at which rate.

    Tries all usual rates, whatever a rig says, unless --baud is given.
    """
    where = place(port, baud, rig_file)
    bauds = (baud,) if baud is not None else tuple(BAUD_CODES) if every_baud else USUAL_BAUDS
    with where.opened() as line:
        found = [census(line, rate) for rate in bauds]
    if as_json:
        tell_json(
            {
                "port": where.port,
                "bauds_tried": list(bauds),
                "servos": [pong_json(pong, one.baud) for one in found for pong in one.pongs],
                "damaged": [{"id": i, "baud": one.baud} for one in found for i in one.damaged],
            }
        )
        return
    _print_scan(where.port, found)


def _print_scan(port: str, found: list[Census]) -> None:
    rows = [
        (str(pong.id), str(one.baud), model_name(pong), str(pong.firmware), "alert" if pong.alert else "")
        for one in found
        for pong in one.pongs
    ]
    tried = ", ".join(str(one.baud) for one in found)
    if rows:
        click.echo(columns(("id", "baud", "model", "firmware", ""), rows))
    else:
        click.echo(f"nobody answers on {port}; tried {tried} baud; remedy: check power and wiring, or --every-baud")
    for one in found:
        for servo_id in one.damaged:
            warn(
                f"id {servo_id} at {one.baud} baud: something answers with damage, most often two servos with one id"
            )


@bus.command(epilog=example("ori-deploy bus ping 3 --port /dev/ttyUSB0"))
@click.argument("servo_id", metavar="ID", type=ID)
@place_options
def ping(servo_id: int, port: str | None, baud: int | None, rig_file: Path | None, as_json: bool) -> None:
    """Ask one servo who it is."""
    where = place(port, baud, rig_file)
    with where.opened() as line:
        pong = where.one(line, servo_id)
        rate = line.port.getBaudRate()
    if as_json:
        tell_json(pong_json(pong, rate))
        return
    alert = ", reports a hardware error" if pong.alert else ""
    click.echo(f"servo {pong.id}: {model_name(pong)}, firmware {pong.firmware}, at {rate} baud{alert}")


@bus.command(epilog=example("ori-deploy bus info 3 --port /dev/ttyUSB0"))
@click.argument("servo_id", metavar="ID", type=ID)
@click.option("--all", "everything", is_flag=True, help="Every register, not only those that matter most.")
@place_options
def info(
    servo_id: int, everything: bool, port: str | None, baud: int | None, rig_file: Path | None, as_json: bool
) -> None:
    """Print the registers of one servo, and what they mean."""
    where = place(port, baud, rig_file)
    with where.opened() as line:
        pong = where.one(line, servo_id)
        rate = line.port.getBaudRate()
        found = registers(line, pong, everything=everything)
    if as_json:
        tell_json(pong_json(pong, rate) | {"registers": {m.register.name: _meaning_json(m) for m in found}})
        return
    click.echo(f"servo {pong.id}: {model_name(pong)}, firmware {pong.firmware}, at {rate} baud")
    rows = [(str(m.register.address), m.register.name, str(m.value), _meaning_text(m)) for m in found]
    click.echo(columns(("address", "register", "value", "meaning"), rows))


def _meaning_json(one: Meaning) -> dict[str, object]:
    told: dict[str, object] = {"address": one.register.address, "value": one.value}
    if one.unit is not None:
        told[f"value_{one.unit}"] = None if one.si is None else round(one.si, DIGITS)
    if one.words:
        told["meaning"] = one.words
    return told


def _meaning_text(one: Meaning) -> str:
    if one.unit is None or one.si is None:
        return one.words
    return f"{100.0 * one.si:.1f} %" if one.unit == "fraction" else f"{one.si:.5g} {_UNITS[one.unit]}"


@bus.command("set-id", epilog=example("ori-deploy bus set-id 1 7 --port /dev/ttyUSB0"))
@click.argument("old", type=ID)
@click.argument("new", type=ID)
@place_options
def set_id_command(
    old: int, new: int, port: str | None, baud: int | None, rig_file: Path | None, as_json: bool
) -> None:
    """Give servo OLD the id NEW. Torque has to be off, and nobody may have NEW."""
    where = place(port, baud, rig_file)
    with where.opened() as line:
        pong = set_id(line, where.one(line, old), new)
        rate = line.port.getBaudRate()
    if as_json:
        tell_json({"old_id": old} | pong_json(pong, rate))
        return
    click.echo(f"servo {old} is servo {pong.id} now, and answers; the rig file has to name it so")


@bus.command("set-baud", epilog=example("ori-deploy bus set-baud all 1000000 --port /dev/ttyUSB0"))
@click.argument("which", metavar="ID|all", callback=which_servo)
@click.argument("new", metavar="BAUD", type=int)
@place_options
def set_baud_command(
    which: int | None, new: int, port: str | None, baud: int | None, rig_file: Path | None, as_json: bool
) -> None:
    """Set the rate of one servo, or of all, to BAUD. Torque has to be off."""
    where = place(port, baud, rig_file)
    with where.opened() as line:
        pongs = set_baud(line, _some(where, line, which), new)
    if as_json:
        tell_json({"baud": new, "servos": [pong_json(pong, new) for pong in pongs]})
    else:
        click.echo(f"at {new} baud, and answering: servo {_ids(pongs)}")
    warn(f"a rig for these servos has to say baud = {new} in [dynamixel]")


@bus.command("reset-error", cls=Heeding, epilog=example("ori-deploy bus reset-error 3 --port /dev/ttyUSB0"))
@click.argument("which", metavar="ID|all", callback=which_servo)
@click.option("--yes", is_flag=True, help="Restart servos that hold torque without asking.")
@place_options
def reset_error_command(
    which: int | None, yes: bool, port: str | None, baud: int | None, rig_file: Path | None, as_json: bool
) -> None:
    """Restart a servo, or all that report an error, which clears hardware errors. It is limp afterwards."""
    where = place(port, baud, rig_file)
    with where.opened() as line:
        pongs = _some(where, line, which)
        if which is None:
            pongs = tuple(pong for pong in pongs if errors_of(line, pong))
        holding = tuple(pong for pong in pongs if _holds(line, pong))
        if holding:
            confirm(f"Servo {_ids(holding)} holds torque, and goes limp. Restart?", yes=yes)
        done: list[Reset] = []
        try:
            for pong in pongs:
                with begun(already=bool(done)):
                    done.append(reset_error(line, pong, MonotonicClock()))
        finally:  # those before one that failed have been restarted
            _tell_resets(done, as_json=as_json)
    if not pongs and not as_json:
        click.echo("no servo reports an error; nothing was restarted")


def _tell_resets(done: list[Reset], *, as_json: bool) -> None:
    if as_json:
        tell_json(
            {"servos": [{"id": r.id, "error_bits": r.error_bits, "error": error_words(r.error_bits)} for r in done]}
        )
    else:
        for reset in done:
            click.echo(f"servo {reset.id}: reported {error_words(reset.error_bits)}; restarted, no error now")
    if done:
        warn(
            "a servo that was restarted is limp, and one of more than one turn has forgotten its turns: "
            "say --stands stowed or --stands deployed with the next motion"
        )


def _holds(line: ServoLine, pong: Pong) -> bool:
    return bool(read(line, pong.id, known_model(pong).table.torque_enable))


@bus.command("torque-off", cls=Heeding, epilog=example("ori-deploy bus torque-off all --port /dev/ttyUSB0"))
@click.argument("which", metavar="ID|all", callback=which_servo)
@click.option("--yes", is_flag=True, help="Do not ask.")
@place_options
def torque_off_command(
    which: int | None, yes: bool, port: str | None, baud: int | None, rig_file: Path | None, as_json: bool
) -> None:
    """Let one servo, or all, go limp. What they hold up falls."""
    where = place(port, baud, rig_file)
    with where.opened() as line:
        found = _at_every_rate(where, line) if which is None and len(where.bauds) > 1 else None
        pongs = where.some(line, which) if found is None else found.pongs
        confirm(f"Servo {_ids(pongs)} goes limp, and with it what it holds up. Torque off?", yes=yes)
        if found is None:
            torque_off(line, pongs)
        else:
            torque_off_at_every_rate(line, found)
    if as_json:
        tell_json({"ids": [pong.id for pong in pongs], "torque_on": False})
    else:
        click.echo(f"limp: servo {_ids(pongs)}; the structure holds itself, or is held by hand")


def _at_every_rate(where: Place, line: ServoLine) -> Found:
    """All servos, whatever their rate: one that was not asked would hold, and all be called limp."""
    with nothing_moved():
        found = find_at_every_rate(line, where.bauds)
    if found.unasked:
        warn(
            f"not asked: servos at {', '.join(map(str, found.unasked))} baud, which the adapter does not make; "
            "such a servo goes on holding"
        )
    return found


def _some(where: Place, line: ServoLine, which: int | None) -> tuple[Pong, ...]:
    """As `Place.some`; of all, those at the first rate at which somebody answers, and a warning of that."""
    pongs = where.some(line, which)
    rate = line.port.getBaudRate()
    others = where.bauds[where.bauds.index(rate) + 1 :] if which is None else ()
    if others:
        warn(
            f"all is all at {rate} baud; servos at {', '.join(map(str, others))} baud were not asked; "
            "remedy: ori-deploy bus scan shows whether there are any, --baud reaches them"
        )
    return pongs


def _ids(pongs: tuple[Pong, ...]) -> str:
    return ", ".join(str(pong.id) for pong in pongs)


bus.add_command(calibrate)
bus.add_command(jog)
bus.add_command(monitor)
