"""What is on the screen while a motion runs, drawn here or, where time is real, by another process.

`python -m ori_deploy.cli.screen SOCKET` draws what it is told on its standard output until nobody tells it more.
Drawing takes milliseconds, and a terminal that was stopped with Ctrl-S takes for ever: neither is for a control loop.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from io import UnsupportedOperation
from typing import Protocol

from rich.progress import BarColumn, Progress, TaskID, TextColumn

from ori_deploy.cli.frame import console
from ori_deploy.telemetry.channel import NAP_S, Sender, incoming, spawn

_ROOM_BYTES = 1 << 16
_STOP_S = 5.0


class Screen(Protocol):
    """Where a motion is shown."""

    def begin(self, command: str) -> None:
        """A command was given."""

    def show(self, state: str, opened: float, at_s: float, off_deg: float, latches: str) -> None:
        """Where it is; `opened` from 0 to 1."""

    def line(self, text: str) -> None:
        """Something to keep."""

    def end(self, state: str, at_s: float, verdict: str) -> None:
        """The command ended."""

    def close(self) -> None:
        """Nothing more comes."""


class LocalScreen:
    """Draws by itself: a bar on a terminal, lines elsewhere. Goes silent when its output fails."""

    def __init__(self) -> None:
        self._progress = Progress(
            TextColumn("{task.description:<7}"),
            BarColumn(bar_width=28),
            TextColumn("{task.percentage:>3.0f} % open"),
            TextColumn("{task.fields[state]:<9} t = {task.fields[at]:5.2f} s  off path {task.fields[off]:4.2f} deg"),
            TextColumn("{task.fields[latches]}"),
            console=console,
            auto_refresh=False,
            disable=not console.is_terminal,
        )
        self._task: TaskID | None = None
        self._silent = False
        self._progress.start()

    def begin(self, command: str) -> None:
        self._task = self._progress.add_task(command, total=1.0, state="", at=0.0, off=0.0, latches="")

    def show(self, state: str, opened: float, at_s: float, off_deg: float, latches: str) -> None:
        if self._task is not None and not self._silent:
            try:
                self._progress.update(
                    self._task, completed=opened, state=state, at=at_s, off=off_deg, latches=latches, refresh=True
                )
            except OSError:
                self._hush()

    def line(self, text: str) -> None:
        if not self._silent:
            try:
                console.print(text, markup=False, soft_wrap=True)
            except OSError:
                self._hush()

    def end(self, state: str, at_s: float, verdict: str) -> None:
        if self._task is not None and not self._silent:
            try:
                self._progress.update(self._task, state=state, at=at_s, refresh=True)
            except OSError:
                self._hush()
        self.line(verdict)

    def close(self) -> None:
        self._progress.stop()

    def _hush(self) -> None:
        """A full disk or a closed pipe behind the output: the motion is what matters, and it has its log."""
        self._silent = console.quiet = True


class RemoteScreen:
    """Has another process draw, and never waits for it; what it is too slow for is not shown."""

    def __init__(self, stdout: int) -> None:
        self._process, end = spawn("ori_deploy.cli.screen", (), stdout=stdout)
        self._sender = Sender(end, waits=False, room_bytes=_ROOM_BYTES)

    def begin(self, command: str) -> None:
        self._tell(True, "begin", command)

    def show(self, state: str, opened: float, at_s: float, off_deg: float, latches: str) -> None:
        self._tell(False, "show", state, opened, at_s, off_deg, latches)

    def line(self, text: str) -> None:
        self._tell(True, "line", text)

    def end(self, state: str, at_s: float, verdict: str) -> None:
        self._tell(True, "end", state, at_s, verdict)

    def close(self) -> None:
        """Wait until all is drawn, with a bound: what comes after goes below it."""
        deadline = time.monotonic() + _STOP_S
        with suppress(OSError):  # it may be gone, or its terminal stand still
            for _ in self._sender.finish(deadline):
                pass
        self._sender.close()
        try:
            self._process.wait(max(0.1, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _tell(self, urgent: bool, *words: object) -> None:
        with suppress(OSError):  # nobody draws any more; the motion is what matters
            self._sender.send([words], urgent=urgent)


def screen(*, real: bool) -> Screen:
    """A screen for a motion on a real clock or a virtual one.

    Output that is no file of the system's is somebody's buffer, and nothing to wait for.
    """
    if not real:
        return LocalScreen()
    try:
        stdout = sys.stdout.fileno()
        sys.stdout.flush()
    except (UnsupportedOperation, OSError, ValueError, AttributeError):
        return LocalScreen()
    return RemoteScreen(stdout)


def main(words: list[str]) -> None:
    """Draw until nobody tells more."""
    drawn = LocalScreen()
    does: dict[str, Callable[..., None]] = {
        "begin": drawn.begin,
        "show": drawn.show,
        "line": drawn.line,
        "end": drawn.end,
    }
    try:
        for frame in incoming(socket.socket(fileno=int(words[0])), 3600.0, NAP_S):
            for name, *arguments in frame or ():
                if name in does:
                    does[name](*arguments)
    finally:
        drawn.close()


if __name__ == "__main__":
    main(sys.argv[1:])
