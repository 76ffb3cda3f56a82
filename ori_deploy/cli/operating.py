"""A session's side of the commands from other terminals."""

from __future__ import annotations

import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import click

from ori_deploy.actuators.bus import ActuatorBus
from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.cli.frame import warn
from ori_deploy.clock import Clock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.states import State
from ori_deploy.errors import FileError
from ori_deploy.motion import Plan
from ori_deploy.operate.desk import Desk, Session
from ori_deploy.operate.server import OperatorSocket


class Operator:
    """Whoever commands a session from another terminal.

    Parameters
    ----------
    controller
        What is commanded.
    desk, socket
        How.
    """

    def __init__(self, controller: Controller, desk: Desk, socket: OperatorSocket) -> None:
        self._controller, self._desk, self._socket = controller, desk, socket
        self._told = False

    @property
    def stopped_by(self) -> str | None:
        """Who stopped the command from another terminal, or None."""
        return self._desk.stopped_by

    @property
    def keeps_waiting(self) -> bool:
        """Whether a held command is waited for: somebody can still resume or stop it."""
        return self._controller.state is State.HOLD and self._socket.listening

    def poll(self) -> None:
        """Serve what has come, and tell this terminal once when the motion is held."""
        self._socket.poll()
        held = self.keeps_waiting
        if held and not self._told:
            _say("held: `ori-deploy resume` goes on; `ori-deploy stop`, or Ctrl-C here, gives it up")
        self._told = held


@contextmanager
def operated(
    controller: Controller, plan: Plan, rig: ResolvedRig, bus: ActuatorBus, clock: Clock, session: Session
) -> Iterator[Operator | None]:
    """Let a session be commanded from other terminals; None where no socket can be made, with a warning."""
    desk = Desk(controller, session, plan, rig, bus, clock.now())
    try:
        socket = OperatorSocket(desk)
    except (FileError, OSError) as wrong:
        warn(f"no commands from other terminals: {wrong}")
        yield None
        return
    controller.add_observer(desk)
    with socket:
        yield Operator(controller, desk, socket)


def _say(text: str) -> None:
    """A line on the error stream, unless its terminal takes none now: the cycle waits for nobody."""
    try:
        if select.select([], [sys.stderr], [], 0.0)[1]:
            click.echo(text, err=True)
    except (OSError, ValueError):
        pass  # closed, or no file at all
