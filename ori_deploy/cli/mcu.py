"""`ori-deploy mcu`: the microcontroller at the bench."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.claim import DeviceClaim
from ori_deploy.actuators.mcu.configure import read_config, write_config
from ori_deploy.actuators.mcu.faults import state_name
from ori_deploy.actuators.mcu.records import Record, config_hash, records
from ori_deploy.actuators.mcu.settings import McuSettings
from ori_deploy.actuators.rig import load_rig
from ori_deploy.bench.board import (
    BOOT_WAIT_S,
    Board,
    board,
    clear_fault,
    fault_words,
    firmware_version,
    reset_cause,
)
from ori_deploy.cli.bus_common import IN, adapters, example, tell_json
from ori_deploy.cli.frame import EXIT_NOT_DONE
from ori_deploy.cli.mcu_monitor import watch
from ori_deploy.cli.session import rig_for
from ori_deploy.clock import MonotonicClock
from ori_deploy.errors import InputError, RigError
from ori_deploy.files import load_plan

DEFAULT_BAUD = 500_000
BOOTLOADER_BAUD = 115_200
HEX = Path("firmware") / "build" / "ori_atmega2560.hex"

_F = TypeVar("_F", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class _Place:
    port: str
    baud: int
    boot_wait_s: float

    @contextmanager
    def opened(self) -> Iterator[Board]:
        with board(self.port, self.baud, MonotonicClock(), self.boot_wait_s) as found:
            yield found


def _place(port: str | None, baud: int | None, settings: McuSettings | None) -> _Place:
    """What was said, else what the rig says, else the only board there is."""
    if port is None and settings is None:
        port = _only_board()
    return _Place(
        port or (settings.port if settings else ""),
        baud or (settings.baud if settings else DEFAULT_BAUD),
        settings.boot_wait_s if settings else BOOT_WAIT_S,
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


def _settings(rig_file: Path | None) -> McuSettings | None:
    if rig_file is None:
        return None
    rig = load_rig(rig_file)
    if rig.mcu is None:
        raise RigError(
            "no microcontroller here", value=f'backend = "{rig.backend}"', limit="a table [mcu]",
            remedy="give another rig, or --port", source=rig.source,
        )  # fmt: skip
    return rig.mcu


def _where_options(command: _F) -> _F:
    for option in reversed(
        (
            click.option("--port", help="Device.  [default: the rig's, else the only board]"),
            click.option("--baud", type=int, help=f"Rate.  [default: the rig's, else {DEFAULT_BAUD}]"),
            click.option("--rig", "rig_file", type=IN, help="Rig file to take port and rate from."),
            click.option("--json", "as_json", is_flag=True, help="Answer with one JSON document."),
        )
    ):
        command = option(command)
    return command


@click.group(epilog=example("ori-deploy mcu info --port /dev/ttyACM0"))
def mcu() -> None:
    """Flash, configure and watch the microcontroller that drives hinges and latches."""


@mcu.command(epilog=example("ori-deploy mcu info --port /dev/ttyACM0"))
@_where_options
def info(port: str | None, baud: int | None, rig_file: Path | None, as_json: bool) -> None:
    """Tell what the device is, how it is, and what it is configured for. Nothing is changed."""
    with _place(port, baud, _settings(rig_file)).opened() as found:
        state, config = found.state(), read_config(found.line)
        document = {
            "port": found.line.port.path,
            "board": found.info.port,
            "firmware": firmware_version(found.info),
            "starts": found.info.boot,
            "last_start": reset_cause(found.info),
            "state": state_name(state.state),
            "fault": fault_words(state, found.naming),
            "supply_v": round(1e-3 * state.supply_mv, 3),
            "config_hash": f"{found.info.config_hash:08x}" if config else None,
            "hinges": found.info.hinges,
            "latches": found.info.latches,
        }
        if as_json:
            tell_json({**document, "config": [_record_json(record) for record in config]})
            return
        for key, value in document.items():
            click.echo(f"{key.replace('_', ' '):12} {'-' if value is None else value}")


def _record_json(record: Record) -> dict[str, object]:
    kind = record.get_type().removeprefix("ORI_CONFIG_").lower()
    return {"record": kind, **{name: getattr(record, name) for name in record.fieldnames if name != "token"}}


@mcu.command(epilog=example("ori-deploy mcu config rig.toml --plan wing.plan.json"))
@click.argument("rig_file", metavar="RIG", type=IN)
@click.option("--plan", "plan_file", type=IN, required=True, help="Plan whose cells and latch points the rig drives.")
@click.option("--port", help="Device, instead of the one in the rig.")
@click.option("--check", is_flag=True, help="Only compare; status 1 when the device has another configuration.")
@click.option("--json", "as_json", is_flag=True, help="Answer with one JSON document.")
def config(rig_file: Path, plan_file: Path, port: str | None, check: bool, as_json: bool) -> None:
    """Write what a rig says of servos, limits and latches into the device, where it outlasts power.

    Every hinge and latch has to be off. The device takes no other limits from anybody until this is done again.
    """
    rig = rig_for(rig_file, load_plan(plan_file))
    if rig.mcu is None:
        raise RigError("no microcontroller here", limit="a table [mcu]", remedy="give another rig", source=rig.source)
    wanted = records(rig.mcu)
    with _place(port, None, rig.mcu.settings).opened() as found:
        found_hash = found.info.config_hash
        same = found_hash == config_hash(wanted)
        if not same and not check:
            write_config(found.line, wanted)
        document = {
            "port": found.line.port.path,
            "before": f"{found_hash:08x}" if found_hash else None,
            "rig": f"{config_hash(wanted):08x}",
            "written": not same and not check,
        }
    if as_json:
        tell_json(document)
    elif same:
        click.echo(f"{document['port']}: has the rig's configuration, {document['rig']}; nothing was written")
    else:
        before = document["before"] or "none"
        if check:
            click.echo(f"{document['port']}: has configuration {before}; the rig's is {document['rig']}")
        else:
            click.echo(f"{document['port']}: configuration {document['rig']} written; before: {before}")
    if check and not same:
        raise SystemExit(EXIT_NOT_DONE)


@mcu.command(epilog=example("ori-deploy mcu monitor --rate 10 --port /dev/ttyACM0"))
@_where_options
@click.option("--rate", "rate_hz", type=click.FloatRange(0.1, 50.0), default=5.0, show_default=True, metavar="HZ")
@click.option("--count", type=click.IntRange(1), help="Stop after so many; without it, Ctrl-C does.")
def monitor(
    port: str | None, baud: int | None, rig_file: Path | None, as_json: bool, rate_hz: float, count: int | None
) -> None:
    """Show hinges, latches, queue and supply until Ctrl-C. With --json, one document per line."""
    with _place(port, baud, _settings(rig_file)).opened() as found:
        watch(found, rate_hz, count, as_json=as_json)


@mcu.command("clear-fault", epilog=example("ori-deploy mcu clear-fault --port /dev/ttyACM0"))
@_where_options
def clear_fault_command(port: str | None, baud: int | None, rig_file: Path | None, as_json: bool) -> None:
    """Forget the fault that the device has latched, if its cause is gone. Nothing moves because of it."""
    with _place(port, baud, _settings(rig_file)).opened() as found:
        name = clear_fault(found)
    if as_json:
        tell_json({"cleared": name})
    else:
        click.echo("no fault is latched" if name is None else f"cleared: {name}")


@mcu.command(epilog=example("ori-deploy mcu flash --port /dev/ttyACM0"))
@click.option("--port", required=True, help="Device.")
@click.option(
    "--hex", "image", type=IN, default=HEX, show_default=True, help="Image, as `make -C firmware` builds it."
)
def flash(port: str, image: Path) -> None:
    """Write the firmware onto an Arduino Mega 2560 through its bootloader, with avrdude."""
    if not image.is_file():
        raise InputError(f"{image}: no image here", remedy="build it with `make -C firmware`, or give --hex")
    avrdude = shutil.which("avrdude")
    if avrdude is None:
        raise InputError("avrdude is not installed", remedy="install it (Debian: apt-get install avrdude)")
    words = [avrdude, "-c", "wiring", "-p", "m2560", "-b", str(BOOTLOADER_BAUD), "-D", "-P", port]
    with DeviceClaim(port):  # before avrdude restarts the board under whoever has it
        done = subprocess.run([*words, "-U", f"flash:w:{image}:i"], check=False)
    if done.returncode != 0:
        raise CommandRefused(
            f"avrdude ended with status {done.returncode}; remedy: read what it says above, check port and cable"
        )
    click.echo(f"{port}: {image.name} written and verified")
