"""`ori-deploy mcu`: the microcontroller at the bench."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import click

from ori_deploy.actuators.bus import BusError
from ori_deploy.actuators.claim import DeviceClaim
from ori_deploy.actuators.mcu.configure import read_config, write_config
from ori_deploy.actuators.mcu.faults import state_name
from ori_deploy.actuators.mcu.records import Record, config_hash, records
from ori_deploy.bench.board import clear_fault, fault_words, firmware_version, reset_cause
from ori_deploy.cli.bus_common import tell_json
from ori_deploy.cli.frame import EXIT_NOT_DONE, IN, Commands, Heeding, example
from ori_deploy.cli.mcu_common import looked_up, place, where_options, wiring_of
from ori_deploy.cli.mcu_monitor import Shown, watch
from ori_deploy.cli.mcu_motion import jog, torque_off
from ori_deploy.errors import InputError

BOOTLOADER_BAUD = 115_200
HEX = Path("firmware") / "build" / "ori_atmega2560.hex"


@click.group(cls=Commands, epilog=example("ori-deploy mcu info --port /dev/ttyACM0"))
def mcu() -> None:
    """Flash, configure and watch the microcontroller that drives hinges and latches."""


@mcu.command(epilog=example("ori-deploy mcu info --port /dev/ttyACM0"))
@where_options
def info(port: str | None, rig_file: Path | None, plan_file: Path | None, as_json: bool) -> None:
    """Tell what the device is, how it is, and what it is configured for. Nothing is changed."""
    with looked_up(port, rig_file, plan_file).opened() as found:
        state, config = found.state(), read_config(found.line)
        document = {
            "port": found.line.port.path,
            "board": found.info.port,
            "firmware": firmware_version(found.info),
            "starts": found.info.boot,
            "last_start": reset_cause(found.info),
            "state": state_name(state.state),
            "fault": fault_words(state, found.naming),
            "supply_v": round(1e-3 * state.supply_mv, 3) if config else None,
            "config_hash": f"{found.info.config_hash:08x}" if config else None,
            "hinges": found.info.hinges,
            "latches": found.info.latches,
        }
        if as_json:
            tell_json({**document, "config": [_record_json(record) for record in config]})
            return
        for key, value in document.items():
            missing = "not configured" if key == "supply_v" else "-"  # without its divider nobody can tell
            click.echo(f"{key.replace('_', ' '):12} {missing if value is None else value}")


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
    wiring, _ = wiring_of(rig_file, plan_file)
    wanted = records(wiring)
    with place(port, wiring.settings, wiring).opened() as found:
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


@mcu.command(cls=Heeding, epilog=example("ori-deploy mcu monitor --rate 10 --port /dev/ttyACM0"))
@where_options
@click.option("--rate", "rate_hz", type=click.FloatRange(0.1, 50.0), default=5.0, show_default=True, metavar="HZ")
@click.option("--count", type=click.IntRange(1), help="Stop after so many; without it, Ctrl-C does.")
def monitor(
    port: str | None,
    rig_file: Path | None,
    plan_file: Path | None,
    as_json: bool,
    rate_hz: float,
    count: int | None,
) -> None:
    """Show hinges, latches, queue and supply until Ctrl-C. With --json, one document per line."""
    where = looked_up(port, rig_file, plan_file)
    with where.opened() as found:
        watch(Shown(found, read_config(found.line), where.thermistor), rate_hz, count, as_json=as_json)


@mcu.command("clear-fault", epilog=example("ori-deploy mcu clear-fault --port /dev/ttyACM0"))
@where_options
def clear_fault_command(port: str | None, rig_file: Path | None, plan_file: Path | None, as_json: bool) -> None:
    """Forget the fault that the device has latched, if its cause is gone. Nothing moves because of it."""
    with looked_up(port, rig_file, plan_file).opened() as found:
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
    if not Path(port).is_char_device():  # avrdude would wait for it for ever
        raise InputError(
            f"{port}: no serial device here", limit="a device such as /dev/ttyACM0", remedy="check cable and name"
        )
    avrdude = shutil.which("avrdude")
    if avrdude is None:
        raise InputError("avrdude is not installed", remedy="install it (Debian: apt-get install avrdude)")
    words = [avrdude, "-c", "wiring", "-p", "m2560", "-b", str(BOOTLOADER_BAUD), "-D", "-P", port]
    with DeviceClaim(port):  # before avrdude restarts the board under whoever has it
        done = subprocess.run([*words, "-U", f"flash:w:{image}:i"], check=False)
    if done.returncode != 0:
        raise BusError(  # no refusal: it may have erased what was there
            f"avrdude ended with status {done.returncode}; remedy: read what it says above, check port and cable"
        )
    click.echo(f"{port}: {image.name} written and verified")


mcu.add_command(jog)
mcu.add_command(torque_off)
