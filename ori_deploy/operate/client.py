"""The operator's side: find the controller that is meant, ask it, and hear what it answers."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from ori_deploy.errors import InputError, OriDeployError
from ori_deploy.operate.messages import MAY_MOVE, Answer, Do, Request, Status, parse_answer, request_line
from ori_deploy.operate.places import listened_at, remove_stale, sockets
from ori_deploy.runtime_dir import runtime_dirs

PATIENCE_S = 5.0
"""How long a controller may take to answer: it looks at its socket once per cycle."""

MAX_ANSWER_BYTES = 1 << 20


class NoController(InputError):
    """There is none to command, or more than one and nothing said which."""

    refused = True


class NotAnswering(OriDeployError):
    """A controller is there and does not answer, or ended before it did."""


@dataclass(frozen=True, slots=True)
class Found:
    """A running controller's process and socket."""

    pid: int
    path: Path


def find(pid: int | None = None, port: str | None = None) -> Found:
    """The controller that is meant: the only one, or that of a process or of a serial device.

    Raises
    ------
    NoController
        There is none such, or several; the error lists what there is.
    """
    running = _running(_owner(pid))
    if not running:
        raise NoController(
            "no controller is running that can be commanded",
            value=None if pid is None else f"--pid {pid}",
            limit="on hardware or with --realtime, of your own",
            remedy="start one with `ori-deploy deploy`; root names another user's with --pid",
        )
    chosen = [one for one in running if pid is None or one.pid == pid]
    if port is not None:
        chosen = [one for one in chosen if _has_port(_status(one), port)]
    if len(chosen) == 1:
        return chosen[0]
    raise NoController(
        "more than one controller is running" if chosen else "no such controller is running",
        value="; ".join(_line(one) for one in chosen or running),
        remedy="choose one with --pid or --port",
    )


def ask(where: Found, request: Request) -> Generator[Answer, None, None]:
    """Send a request; yields its answer, and the one at rest if `request.wait`.

    What may lead to a motion says when it was asked: a controller that hangs meanwhile does not do it later.

    Raises
    ------
    NotAnswering
        It does not, within `PATIENCE_S`; or it ended before it was at rest.
    """
    if request.do in MAY_MOVE:
        request = replace(request, asked_s=time.monotonic())
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
        link.settimeout(PATIENCE_S)
        try:
            link.connect(str(where.path))
            link.sendall(request_line(request))
            with link.makefile("rb") as lines:
                answer = _next(lines.readline(MAX_ANSWER_BYTES), where)
                yield answer
                if request.wait and answer.took:
                    link.settimeout(None)
                    yield _next(lines.readline(MAX_ANSWER_BYTES), where)
        except OSError as wrong:
            unknown = "" if request.do is Do.STATUS else f"; whether it took {request.do} is not known"
            raise NotAnswering(
                f"the controller with pid {where.pid} does not answer ({wrong}){unknown}; remedy: press Ctrl-C in "
                f"its terminal, or kill -INT {where.pid}: it comes to rest along its path"
            ) from wrong


def _next(line: bytes, where: Found) -> Answer:
    if not line.endswith(b"\n"):
        raise NotAnswering(
            f"the controller with pid {where.pid} ended without an answer; remedy: see its terminal for how it ended"
        )
    try:
        return parse_answer(line)
    except ValueError as wrong:
        raise NotAnswering(
            f"the controller with pid {where.pid} answers in another version's words; "
            "remedy: use the same version of ori-deploy in both terminals"
        ) from wrong


def _owner(pid: int | None) -> int:
    """Whose controllers to look at: one's own; root may name anybody's."""
    own = os.geteuid()
    if pid is None or own != 0:
        return own
    try:
        return Path(f"/proc/{pid}").stat().st_uid
    except OSError:
        return own


def _running(uid: int) -> tuple[Found, ...]:
    found: list[Found] = []
    for folder in runtime_dirs(uid):
        remove_stale(folder)
        found += [Found(pid, path) for pid, path in sockets(folder) if listened_at(path)]
    return tuple(found)


def _status(one: Found) -> Status | None:
    with closing(ask(one, Request(Do.STATUS))) as answers:
        try:
            return next(answers).status
        except NotAnswering:
            return None


def _has_port(status: Status | None, port: str) -> bool:
    device = os.path.realpath(port)
    return status is not None and any(os.path.realpath(held) == device for held in status.ports)


def _line(one: Found) -> str:
    status = _status(one)
    if status is None:
        return f"pid {one.pid} (does not answer)"
    port = ", ".join(status.ports) or "no port"
    return f"pid {one.pid} ({Path(status.plan).name}, {port}, {status.state})"
