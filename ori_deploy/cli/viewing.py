"""`--view`: the page of a session, in a process of its own that knows the session by its operator's socket only."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

import click

from ori_deploy.cli.frame import IN
from ori_deploy.cli.starting import answer_interrupt
from ori_deploy.errors import InputError
from ori_deploy.files import load_plan
from ori_deploy.page.listening import PORT, listening, own_host
from ori_deploy.telemetry.channel import spawn

LOOPBACK = "127.0.0.1"
_COMES_UP_S = 60.0

_F = TypeVar("_F", bound=Callable[..., Any])


@dataclass(frozen=True)
class Viewing:
    """How a page is served.

    Attributes
    ----------
    wanted
        Whether there is to be one.
    port, host, beyond_loopback
        Where it listens; a port of None is the usual one, or the next one that is free.
    design
        Its design file; looked for beside the plan without.
    """

    wanted: bool = False
    port: int | None = None
    host: str = LOOPBACK
    beyond_loopback: bool = False
    design: Path | None = None


_NEEDS = {"viser": ((1, 1), (2,)), "shapely": ((2, 1), (3,))}
"""At least, and below: what is older or newer than was tried would end in a traceback, or in a page unguarded."""


def require_viser() -> None:
    """Raise `InputError` where what draws the page is not installed, or not in a version that does."""
    if find_spec("viser") is None:
        raise InputError(
            "the page needs viser, which is not installed",
            remedy="pip install -e '.[view]'",
        )
    for name, (least, below) in _NEEDS.items():
        told = version(name)
        number = tuple(int(part) for part in re.findall(r"\d+", told)[:2])
        if not least <= number < below:
            raise InputError(
                f"the page cannot be made with this {name}",
                value=told,
                limit=f">= {'.'.join(map(str, least))}, < {below[0]}",
                remedy="pip install -e '.[view]'",
            )


def view_options(command: _F) -> _F:
    """Whether there is a page, where it listens, and what it shows; `viewing` takes them out of what was given."""
    for option in reversed(
        (
            click.option("--view", is_flag=True, help="Show and command it on a page in the browser."),
            click.option(
                "--view-port",
                type=click.IntRange(0, 65535),
                help="Its port; 0: any.  [default: 8080, or the next free]",
            ),
            click.option("--view-host", default=LOOPBACK, show_default=True, help="Where it listens."),
            click.option("--design", type=IN, help="Design file, for the page.  [default: the one beside the plan]"),
        )
    ):
        command = option(command)
    return command


def viewing(given: dict[str, Any]) -> Viewing:
    """Take what `view_options` and --beyond-loopback gave out of a command's words."""
    return Viewing(
        wanted=given.pop("view"),
        port=given.pop("view_port"),
        host=given.pop("view_host"),
        beyond_loopback=given.pop("beyond_loopback"),
        design=given.pop("design"),
    )


@contextmanager
def viewed(plan_path: Path, how: Viewing, *, stays: bool = False) -> Iterator[None]:
    """Until the end of the block there is a page of this process's session.

    Parameters
    ----------
    plan_path
        What the session carries out.
    how
        How it is served.
    stays
        Whether it stays after a motion until Ctrl-C, so that the end can be looked at.

    Raises
    ------
    InputError
        It does not come up: nothing has moved yet.
    """
    if not how.wanted:
        yield
        return
    process, end = _page(plan_path, how)
    with end:  # a page lives for as long as its starter holds its end, or somebody looks
        try:
            yield
        except SystemExit:
            _stay(process, stays)
            raise
        _stay(process, stays)


def _page(plan_path: Path, how: Viewing) -> tuple[subprocess.Popen[bytes], socket.socket]:
    """Start it, and say where it is."""
    require_viser()
    if plan_path.exists() and not plan_path.is_file():
        raise InputError(
            "--view: PLAN cannot be read a second time, for the page",
            value=str(plan_path),
            limit="a regular file",
            remedy="write it into one",
        )
    load_plan(plan_path)  # what is wrong with it is told by the command itself, in its own words
    words = {
        "pid": os.getpid(),
        "plan": str(plan_path.absolute()),
        "design": None if how.design is None else str(how.design.absolute()),
        "host": how.host,
        "port": how.port,
        "beyond_loopback": how.beyond_loopback,
    }
    _refuse_place(how)
    process, end = spawn("ori_deploy.page", [json.dumps(words)])
    end.settimeout(_COMES_UP_S)
    told: dict[str, str] = {}
    with suppress(OSError, ValueError), end.makefile("rb") as lines:
        told = json.loads(lines.readline())
    if "address" not in told:
        process.kill()
        process.wait()
        raise InputError("--view: the page does not come up", value=told.get("error", "it says nothing"))
    click.echo(f"page: {told['address']}", err=True)
    if (moved := moved_on(how.port, told["address"])) is not None:
        click.echo(moved, err=True)
    return process, end


def _refuse_place(how: Viewing) -> None:
    """Raise `InputError`, in this command's words, for where no page can be."""
    host = own_host(how.host, beyond_loopback=how.beyond_loopback, option="--view-host")
    listening(host, how.port, ("--view-host", "--view-port")).close()


def moved_on(wanted: int | None, address: str) -> str | None:
    """What to say where a page that nobody gave a port is not on the usual one: what is there may be an old page."""
    port = urlsplit(address).port
    if wanted is not None or port == PORT:
        return None
    return f"port {PORT} is in use, perhaps by an earlier page: this one is on {port}"


def _stay(process: subprocess.Popen[bytes], stays: bool) -> None:
    if not stays or process.poll() is not None:
        return
    with suppress(KeyboardInterrupt):
        # As is said next, and in the background too, where a shell has it ignored.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        click.echo("the page stays until Ctrl-C", err=True)
        sys.stderr.flush()
        answer_interrupt()
        process.wait()
