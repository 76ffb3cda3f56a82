"""`ori-deploy gcs ...`: a structure on a vehicle's MAVLink network, from the ground."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import click

from ori_deploy.cli.frame import EXIT_NOT_DONE, EXIT_REFUSED, IN, Commands, console, example, print_table
from ori_deploy.errors import InputError
from ori_deploy.mav.ground import GroundStation, Structure, Text, Verdict
from ori_deploy.wire.vehicle import Party, dialect

DEFAULT_LINK = "udpout:127.0.0.1:14560"

_SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")
_F = TypeVar("_F", bound=Callable[..., Any])


def _link_options(command: _F) -> _F:
    for option in reversed(
        (
            click.option(
                "--link",
                default=DEFAULT_LINK,
                show_default=True,
                help="udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD.",
            ),
            click.option("--beyond-loopback", is_flag=True, help="Listen to other machines, too."),
            click.option("--key", "key_file", type=IN, help="File of the key to sign with."),
            click.option(
                "--system", type=click.IntRange(1, 255), default=255, show_default=True, help="Our system id."
            ),
            click.option(
                "--vehicle", type=click.IntRange(1, 255), default=1, show_default=True, help="Its system id."
            ),
            click.option(
                "--component",
                type=click.IntRange(1, 255),
                default=dialect.MAV_COMP_ID_SERVO1,
                show_default=True,
                help="The structure's component id.",
            ),
        )
    ):
        command = option(command)
    return command


def _station(
    link: str, beyond_loopback: bool, key_file: Path | None, system: int, vehicle: int, component: int
) -> GroundStation:
    return GroundStation(
        link,
        party=Party(system, dialect.MAV_COMP_ID_MISSIONPLANNER),
        vehicle=vehicle,
        component=component,
        key_file=key_file,
        beyond_loopback=beyond_loopback,
    )


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
def gcs() -> None:
    """Command a structure on a vehicle's MAVLink network, and see how it is."""


def _progress() -> Callable[[int], None]:
    """Percent on one line of a terminal; a line for every tenth elsewhere."""
    told = -1

    def show(percent: int) -> None:
        nonlocal told
        if console.is_terminal:
            console.print(f"\r{percent:3d} %", end="", markup=False)
        elif percent // 10 > told:
            told = percent // 10
            console.print(f"{percent:3d} %", markup=False)

    return show


def _end(verdict: Verdict, *, as_json: bool = False) -> None:
    """Say how it ended, and leave with the status for it."""
    if as_json:
        click.echo(json.dumps({"result": verdict.result.name.lower(), "reason": verdict.reason}))
        if verdict.accepted:
            return
        sys.exit(EXIT_REFUSED if verdict.refused else EXIT_NOT_DONE)
    if console.is_terminal:
        console.print("\r", end="")
    if verdict.accepted:
        console.print(str(verdict), markup=False)
        return
    click.echo(f"error: {verdict}", err=True)
    sys.exit(EXIT_REFUSED if verdict.refused else EXIT_NOT_DONE)


def _motion(name: str, text: str) -> None:
    @gcs.command(name, help=text, epilog=example(f"ori-deploy gcs {name} --link {DEFAULT_LINK}"))
    @_link_options
    @click.option("--force", is_flag=True, help="Past the interlock, where the component's settings allow it.")
    @click.option("--json", "as_json", is_flag=True, help="Answer with JSON, at the end.")
    def command(force: bool, as_json: bool, **link: Any) -> None:
        with _station(**link) as station:
            move = station.deploy if name == "deploy" else station.fold
            _end(move(force=force, progress=None if as_json else _progress()), as_json=as_json)


_motion("deploy", "Deploy and lock the structure; ends when every latch is confirmed, or says why not.")
_motion("fold", "Unlock and fold the structure; refused unless the vehicle is on the ground and disarmed.")


@gcs.command(epilog=example("ori-deploy gcs stop"))
@_link_options
def stop(**link: Any) -> None:
    """Bring the structure to rest along its path, and give up what it was doing."""
    with _station(**link) as station:
        _end(station.stop())


@gcs.command("clear-fault", epilog=example("ori-deploy gcs clear-fault"))
@_link_options
def clear_fault(**link: Any) -> None:
    """Forget the latched fault; nothing moves."""
    with _station(**link) as station:
        _end(station.clear_fault())


@gcs.command(epilog=example("ori-deploy gcs status --json"))
@_link_options
@click.option("--json", "as_json", is_flag=True, help="Answer with JSON.")
def status(as_json: bool, **link: Any) -> None:
    """Tell how the structure is."""
    with _station(**link) as station:
        told = station.status()
    if as_json:
        click.echo(json.dumps(_plain(told), allow_nan=False))
    else:
        print_table(f"structure: {told.state.name.lower()}", _rows(told))


@gcs.command(epilog=example("ori-deploy gcs monitor"))
@_link_options
@click.option("--json", "as_json", is_flag=True, help="A JSON document per line.")
@click.option("--seconds", type=click.FloatRange(min=0.0), help="For so long.  [default: until Ctrl-C]")
def monitor(as_json: bool, seconds: float | None, **link: Any) -> None:
    """Show what the structure tells, line by line, until Ctrl-C."""
    heard = False
    with _station(**link) as station:
        try:
            for told in station.monitor(timeout_s=math.inf if seconds is None else seconds):
                heard = True
                click.echo(json.dumps(_plain(told), allow_nan=False) if as_json else _line(told))
        except KeyboardInterrupt:
            return  # as it is meant to end
    if not heard:
        click.echo(f"error: nothing was heard on {link['link']}", err=True)
        sys.exit(EXIT_NOT_DONE)


@gcs.command(epilog=example("ori-deploy gcs params ORI_SPEED=0.5"))
@_link_options
@click.argument("change", metavar="[NAME=VALUE]", required=False)
def params(change: str | None, **link: Any) -> None:
    """List the parameters, or set one; it lasts over restarts."""
    with _station(**link) as station:
        if change is None:
            print_table("parameters", [(name, f"{value:g}") for name, value in station.parameters().items()])
            return
        name, value = _assignment(change)
        holds = station.set_parameter(name, value)
    console.print(f"{name} = {holds:g}", markup=False)
    if not math.isclose(holds, value, rel_tol=1e-6):
        click.echo(f"error: {name}: {value:g} was refused; see `ori-deploy gcs monitor` for why", err=True)
        sys.exit(EXIT_REFUSED)


def _assignment(change: str) -> tuple[str, float]:
    name, _, text = change.partition("=")
    try:
        return name, float(text)
    except ValueError:
        raise InputError("params: not a change", value=change, limit="NAME=VALUE, a number") from None


def _plain(told: Structure | Text) -> dict[str, Any]:
    """Fields by name, as JSON knows them."""
    if isinstance(told, Text):
        return {"severity": _SEVERITIES[min(told.severity, 7)], "text": told.text}
    fields = {**asdict(told), "state": told.state.name.lower()}
    return {name: None if isinstance(v, float) and not math.isfinite(v) else v for name, v in fields.items()}


def _line(told: Structure | Text) -> str:
    if isinstance(told, Text):
        return f"{_SEVERITIES[min(told.severity, 7)]}: {told.text}"
    percent = "" if told.progress is None else f"  {told.progress:3d} %"
    latches = f"latches {told.latches_confirmed}/{told.latches}"
    fault = f"  fault {told.fault}" if told.fault else ""
    fold = _known(told.fold, f"{told.fold:6.3f}")
    return f"{told.state.name.lower():12s} fold {fold}{percent}  {latches}{fault}"


def _known(value: float, text: str) -> str:
    return text if math.isfinite(value) else "not known"


def _rows(told: Structure) -> list[tuple[str, str]]:
    return [
        ("stage", told.stage or "none"),
        ("fault", told.fault or "none"),
        ("fold commanded", _known(told.fold, f"{told.fold:.4f}")),
        ("fold measured", _known(told.fold_lowest, f"{told.fold_lowest:.4f} to {told.fold_highest:.4f}")),
        ("progress", "none" if told.progress is None else f"{told.progress} %"),
        ("latches", f"{told.latches_confirmed} of {told.latches} confirmed"),
        ("deployed and locked", "yes" if told.locked else "no"),
        ("may fold now", "yes" if told.may_fold else "no"),
        ("may deploy now", "yes" if told.may_deploy else "no"),
        ("worst tracking", f"{math.degrees(told.worst_tracking_rad):.2f} deg"),
    ]
