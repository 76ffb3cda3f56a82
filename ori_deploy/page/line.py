"""Lines to a running controller: kept open, so that a stop does not wait for one to be opened."""

from __future__ import annotations

import select
import socket
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ori_deploy.errors import OriDeployError
from ori_deploy.operate.messages import Answer, Do, Request, parse_answer, request_line
from ori_deploy.page.process import Process

PATIENCE_S = 2.0
"""How long an answer may take: a controller looks at its socket once per cycle."""
STATUS_PATIENCE_S = 0.5
"""And how long until the page says that none comes."""

_READ_BYTES = 1 << 16


class LineLost(OriDeployError):
    """Nobody answers at the other end.

    Attributes
    ----------
    ended
        Whether the controller is known to have ended; otherwise it may be moving.
    last
        What it said when it ended, if it did.
    shut
        Whether there is nobody at its socket: over a line of its own, what was asked was not even sent. No end by
        itself: a controller whose socket has failed, or whose folder was removed, goes on with what it does.
    """

    def __init__(self, text: str, *, ended: bool = False, last: Answer | None = None, shut: bool = False) -> None:
        super().__init__(text)
        self.ended, self.last, self.shut = ended, last, shut


@dataclass
class Known:
    """What all lines to a controller know of its end.

    Attributes
    ----------
    process
        Its; None where that is not known: then only its last word tells that it has ended.
    last
        Its last word, once one of the lines has heard it.
    """

    process: Process | None = None
    last: Answer | None = None

    @property
    def ended(self) -> bool:
        """Whether it has, for certain."""
        return self.last is not None or (self.process is not None and self.process.gone)


class Line:
    """One connection to an operator's socket, opened again when it was dropped.

    An answer that did not come in time is waited for again by the next request: to open more connections to a
    controller that hangs would only use up the few that it has room for.

    Parameters
    ----------
    path
        The socket.
    patience_s
        How long an answer may take.
    known
        Shared with other lines to the same controller.
    """

    def __init__(self, path: Path, patience_s: float = PATIENCE_S, known: Known | None = None) -> None:
        self._path, self._patience_s = path, patience_s
        self._known = Known() if known is None else known
        self._link: socket.socket | None = None
        self._heard = b""
        self._owed = 0  # answers that were not waited for to their end
        self._turn = threading.Lock()

    def ask(self, request: Request, *, again: bool = False) -> Answer:
        """Ask, and once more over a new connection where the old one was dropped; never again after a silence.

        Parameters
        ----------
        request
            What.
        again
            Whether it is the same wish as before: an answer that is still owed is then answer enough.

        Raises
        ------
        LineLost
            Nobody answers.
        """
        with self._turn:
            stood = self._link is not None
            try:
                return self._ask(request, again)
            except (OSError, ValueError) as wrong:
                self._drop()
                if not stood:
                    raise self._lost(wrong) from wrong
            try:
                return self._ask(request, again)
            except (OSError, ValueError) as wrong:
                self._drop()
                raise self._lost(wrong) from wrong

    def stand(self) -> None:
        """Open it where it does not stand; what is asked meanwhile does not wait for that."""
        if self._link is not None and not _hung_up(self._link):
            return
        new = Line(self._path, self._patience_s, self._known)
        try:
            new.ask(Request(Do.STATUS, keep=True))
        except LineLost:
            new.close()
            return
        with self._turn:
            if self._link is None or _hung_up(self._link):
                self._drop()
                self._link, new._link = new._link, None
        new.close()

    def close(self) -> None:
        """Let go of it."""
        with self._turn:
            self._drop()

    def _lost(self, wrong: Exception) -> LineLost:
        shut = isinstance(wrong, ConnectionRefusedError | FileNotFoundError)
        return LineLost(str(wrong), ended=self._known.ended, last=self._known.last, shut=shut)

    def _connected(self) -> socket.socket:
        if self._link is None:
            link = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            link.settimeout(self._patience_s)
            try:
                link.connect(str(self._path))
            except OSError:
                link.close()
                raise
            self._link = link
        return self._link

    def _ask(self, request: Request, again: bool) -> Answer:
        try:
            link = self._connected()
            self._catch_up(link)
            if not (again and self._owed):
                self._send(link, request)
                self._owed += 1
            while self._owed > 1:
                self._answer(link)
            return self._answer(link)
        except (TimeoutError, BlockingIOError) as silent:  # the latter where too many wait to be let in
            raise self._lost(TimeoutError(f"no answer within {self._patience_s:g} s")) from silent

    def _send(self, link: socket.socket, request: Request) -> None:
        try:
            link.sendall(request_line(request))
        except TimeoutError:
            raise
        except OSError:  # it has let go: perhaps not without a word
            with suppress(OSError, ValueError):
                while True:
                    self._answer(link)
            raise

    def _answer(self, link: socket.socket) -> Answer:
        """The next answer; raises `ConnectionResetError` where it is the last word."""
        while b"\n" not in self._heard:
            data = link.recv(_READ_BYTES)
            if not data:
                raise ConnectionResetError("the controller has let go of the line")
            self._heard += data
        line, _, self._heard = self._heard.partition(b"\n")
        answer = parse_answer(line)
        if answer.last:
            self._known.last = answer
            raise ConnectionResetError("the controller has ended")
        self._owed -= 1
        return answer

    def _catch_up(self, link: socket.socket) -> None:
        """Read answers that came too late for who asked: they tell how things were."""
        while self._owed and (b"\n" in self._heard or select.select([link], [], [], 0.0)[0]):
            self._answer(link)

    def _drop(self) -> None:
        if self._link is not None:
            with suppress(OSError):
                self._link.close()
        self._link, self._heard, self._owed = None, b"", 0


def _hung_up(link: socket.socket) -> bool:
    """Whether the other end has let go; waits for nothing and says nothing."""
    poll = select.poll()
    try:
        poll.register(link, select.POLLRDHUP)
        return bool(poll.poll(0))
    except (OSError, ValueError):  # let go of here meanwhile
        return True


class Lines:
    """All lines of a page to its controller; none waits for another.

    Parameters
    ----------
    path
        The operator's socket.
    process
        The controller's, by which it is known to have ended where it had no last word.
    """

    def __init__(self, path: Path, process: Process | None = None) -> None:
        self._path, self._known = path, Known(process)
        self._stop = Line(path, known=self._known)
        self._status = Line(path, STATUS_PATIENCE_S, self._known)

    def status(self) -> Answer:
        """How the controller is. Raises `LineLost`, with its last word where it has ended."""
        return self._status.ask(Request(Do.STATUS, keep=True), again=True)

    def order(self, request: Request) -> Answer:
        """Ask for something else than a stop, over a line of its own, and never twice.

        An order whose answer was lost may have been carried out, and countermanded since by somebody else.

        Raises
        ------
        LineLost
            Nobody answers; whether it was taken, the status tells.
        """
        line = Line(self._path, known=self._known)
        try:
            return line.ask(request)
        finally:
            line.close()

    def stop(self, *, again: bool = False) -> Answer:
        """As fast as can be. Raises `LineLost`: unless the controller has ended, it may yet be carried out."""
        return self._stop.ask(Request(Do.ESTOP), again=again)

    def keep_stop_open(self) -> None:
        """See that the stop's line stands: with many clients a controller may have dropped it."""
        self._stop.stand()

    def close(self) -> None:
        """Let go of all."""
        for line in (self._stop, self._status):
            line.close()
