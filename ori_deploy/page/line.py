"""Lines to a running controller: kept open, so that a stop does not wait for one to be opened."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress
from pathlib import Path

from ori_deploy.errors import OriDeployError
from ori_deploy.operate.messages import Answer, Do, Request, parse_answer, request_line

PATIENCE_S = 2.0
"""How long an answer may take: a controller looks at its socket once per cycle."""

_READ_BYTES = 1 << 16


class LineLost(OriDeployError):
    """Nobody answers at the other end."""


class Line:
    """One connection to an operator's socket, opened again when it was lost.

    Only for what may be asked twice without harm.

    Parameters
    ----------
    path
        The socket.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._link: socket.socket | None = None
        self._turn = threading.Lock()

    def ask(self, do: Do) -> Answer:
        """Ask, and once more over a new connection where the old one was dropped.

        Raises
        ------
        LineLost
            Nobody answers.
        """
        with self._turn:
            fresh = self._link is None
            try:
                return self._ask(do)
            except (OSError, ValueError) as wrong:
                self._drop()
                if fresh:
                    raise LineLost(str(wrong)) from wrong
            try:
                return self._ask(do)
            except (OSError, ValueError) as wrong:
                self._drop()
                raise LineLost(str(wrong)) from wrong

    def close(self) -> None:
        """Let go of it."""
        with self._turn:
            self._drop()

    def _connected(self) -> socket.socket:
        if self._link is None:
            link = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            link.settimeout(PATIENCE_S)
            try:
                link.connect(str(self._path))
            except OSError:
                link.close()
                raise
            self._link = link
        return self._link

    def _ask(self, do: Do) -> Answer:
        link = self._connected()
        link.sendall(request_line(Request(do)))
        heard = b""
        while not heard.endswith(b"\n"):
            data = link.recv(_READ_BYTES)
            if not data:
                raise ConnectionResetError("the controller has let go of the line")
            heard += data
        return parse_answer(heard)

    def _drop(self) -> None:
        if self._link is not None:
            with suppress(OSError):
                self._link.close()
            self._link = None


class Lines:
    """All lines of a page to its controller; none waits for another.

    Parameters
    ----------
    path
        The operator's socket.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stop, self._status = Line(path), Line(path)

    def status(self) -> Answer:
        """How the controller is. Raises `LineLost`."""
        return self._status.ask(Do.STATUS)

    def order(self, do: Do) -> Answer:
        """Ask for something else than a stop, over a line of its own, and never twice.

        An order whose answer was lost may have been carried out, and countermanded since by somebody else.

        Raises
        ------
        LineLost
            Nobody answers; whether it was taken, the status tells.
        """
        line = Line(self._path)
        try:
            return line.ask(do)
        finally:
            line.close()

    def stop(self) -> Answer:
        """As fast as can be. Raises `LineLost`."""
        return self._stop.ask(Do.ESTOP)

    def keep_stop_open(self) -> None:
        """See that the stop's line stands: with many clients a controller drops those it has heard least of."""
        with suppress(LineLost):
            self._stop.ask(Do.STATUS)

    def close(self) -> None:
        """Let go of all."""
        for line in (self._stop, self._status):
            line.close()
