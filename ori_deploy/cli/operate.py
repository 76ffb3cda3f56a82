"""`ori-deploy status | pause | resume | stop | estop | ...`: a running controller, from another terminal."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable
from contextlib import closing, nullcontext
from dataclasses import asdict
from typing import Any, TypeVar

import click
from rich.live import Live
from rich.text import Text

from ori_deploy.cli.frame import EXIT_NOT_DONE, EXIT_REFUSED, console, example
from ori_deploy.deploy.states import State
from ori_deploy.operate.client import Found, NotAnswering, ask, find
from ori_deploy.operate.messages import Answer, Do, Request, Status

_REFRESH_S = 0.5

_REST = {
    Do.PAUSE: frozenset({State.HOLD}),
    Do.RESUME: frozenset({State.DEPLOYED, State.STOWED}),
    Do.STOP: frozenset({State.ARMED}),
    Do.ESTOP: frozenset({State.FAULT}),
    Do.CLEAR_FAULT: frozenset({State.ARMED, State.READY, State.DISCONNECTED}),
    Do.SPAN_UNFOLDED: frozenset(State),
}
"""Where each command means to come to rest."""

_NEXT = {
    State.MOVING: "ori-deploy pause, stop or estop",
    State.LATCHING: "ori-deploy pause, stop or estop",
    State.HOLD: "ori-deploy resume goes on; ori-deploy stop gives it up; estop",
    State.STOPPING: "nothing: it comes to rest, and its session ends; estop",
    State.FAULT: "what the fault's remedy says",
}
"""What there is to do for an operator; in other states nothing but an emergency stop."""

_F = TypeVar("_F", bound=Callable[..., Any])


def _which_options(command: _F) -> _F:
    for option in reversed(
        (
            click.option("--pid", type=click.IntRange(1), help="Process of the controller.  [default: the only one]"),
            click.option("--port", help="Serial device of the controller, instead of --pid."),
            click.option("--json", "as_json", is_flag=True, help="Answer with JSON."),
        )
    ):
        command = option(command)
    return command


@click.command(epilog=example("ori-deploy status --watch"))
@_which_options
@click.option("--watch", is_flag=True, help="Again and again, until Ctrl-C or until the controller ends.")
def status(pid: int | None, port: str | None, as_json: bool, watch: bool) -> None:
    """Tell what a running controller is doing.

    On hardware, and with --realtime, `deploy` and `stow` can be asked and commanded from another terminal of the
    same user, or of root.
    """
    where = find(pid, port)
    if not watch:
        _show(_status_of(where), as_json=as_json)
        return
    try:
        _watch(where, as_json=as_json)
    except KeyboardInterrupt:
        return  # as it is meant to end
    except NotAnswering:
        click.echo(f"the controller with pid {where.pid} has ended", err=True)


def _command(do: Do, text: str) -> click.Command:
    name = str(do).replace("_", "-")

    @click.command(name, help=text, epilog=example(f"ori-deploy {name} --wait"))
    @_which_options
    @click.option("--wait", is_flag=True, help="Until the structure is at rest; status 1 if not as was meant.")
    def command(pid: int | None, port: str | None, as_json: bool, wait: bool) -> None:
        where = find(pid, port)
        with closing(ask(where, Request(do, wait))) as answers:
            for index, answer in enumerate(answers):
                if as_json:
                    _tell_json(where, do, answer)
                elif answer.took:
                    click.echo(_taken(where, do, answer))
                if not answer.took:
                    _refuse(do, answer)
                if index == 1 and answer.state not in _REST[do]:
                    click.echo(f"error: {do}: it came to rest otherwise, in state {answer.state}", err=True)
                    sys.exit(EXIT_NOT_DONE)

    return command


pause = _command(
    Do.PAUSE, "Bring a running motion to rest along its path, and hold it there until `resume` or `stop`."
)
resume = _command(Do.RESUME, "Go on with a motion that is paused.")
stop = _command(
    Do.STOP,
    "Bring a running motion to rest along its path and give it up; its session then ends as after Ctrl-C, "
    "with status 130.",
)
estop = _command(
    Do.ESTOP,
    "Bring a running motion to rest along its path as fast as can be, as a fault; hinges go on holding. Its session "
    "ends with status 1.",
)
clear_fault = _command(
    Do.CLEAR_FAULT,
    "Have a controller that takes orders (`serve`) forget its fault, once at rest; nothing moves.",
)
span_unfolded = _command(
    Do.SPAN_UNFOLDED,
    "Your word to a controller that takes orders (`serve`) that a span in segments is unfolded, for its next "
    "deployment; nothing moves.",
)


def _status_of(where: Found) -> Status:
    with closing(ask(where, Request(Do.STATUS))) as answers:
        answer = next(answers)
    if answer.status is None:
        raise NotAnswering(f"the controller with pid {where.pid} does not tell its status: {answer.why}")
    return answer.status


def _watch(where: Found, *, as_json: bool) -> None:
    in_place = console.is_terminal and not as_json
    with Live(console=console, auto_refresh=False) if in_place else nullcontext() as live:
        while True:
            now = _status_of(where)
            if live is not None:
                live.update(Text(_page(now)), refresh=True)
            else:
                _show(now, as_json=as_json)
            time.sleep(_REFRESH_S)


def _refuse(do: Do, answer: Answer) -> None:
    allowed = ", ".join(answer.allowed)
    click.echo(f"error: {do} refused: {answer.why}; allowed in state {answer.state}: {allowed}", err=True)
    sys.exit(EXIT_REFUSED)


def _taken(where: Found, do: Do, answer: Answer) -> str:
    rest = "at rest" if answer.at_rest else "not at rest yet"
    fault = "" if answer.fault is None else f"; {answer.fault}"
    already = "" if answer.why is None else f"{answer.why}, "
    return f"{do}: {already}state {answer.state}, {rest} (pid {where.pid}){fault}"


def _tell_json(where: Found, do: Do, answer: Answer) -> None:
    told = {key: value for key, value in asdict(answer).items() if key != "status"}
    click.echo(json.dumps({"pid": where.pid, "do": do, **told}, allow_nan=False))


def _show(now: Status, *, as_json: bool) -> None:
    click.echo(json.dumps(asdict(now), allow_nan=False) if as_json else _page(now))


def _page(now: Status) -> str:
    """A status for people."""
    closed, latches = now.secured
    tracking = f"{math.degrees(now.worst_tracking_rad):.2f} deg"
    rows = {
        "state": f"{now.state}, {'at rest' if now.at_rest else 'not at rest'}",
        "stage": "none" if now.stage is None else now.stage + ("" if now.command is None else f" of {now.command}"),
        "fold": "not known" if now.fold is None else f"{now.fold:.4f}, rate {now.rate or 0.0:.2f}",
        "done": "not known" if now.progress_percent is None else f"{now.progress_percent:.0f} %",
        "remaining": "not known" if now.remaining_s is None else f"{now.remaining_s:.1f} s at full speed",
        "fault": _or_none(now.fault, "none"),
        "concern": _or_none(now.concern, "none"),
        "next": _NEXT.get(now.state, "ori-deploy estop"),
        "tracking": tracking
        + ("" if now.worst_tracking_hinge is None else f" at worst ({now.worst_tracking_hinge})"),
        "latches": f"{closed} of {latches} confirmed closed",
        "plan": now.plan,
        "rig": now.rig,
        "port": ", ".join(now.ports) or "none",
        "log": _or_none(now.log, "none"),
        "pid": f"{now.pid}, up {now.uptime_s:.1f} s, {now.cycles} cycles, {now.overruns} late, "
        f"{now.lost_replies} replies lost",
    }
    return "\n".join(f"{name:<9}  {value}" for name, value in rows.items())


def _or_none(value: str | None, otherwise: str) -> str:
    return otherwise if value is None else value
