"""The process that speaks MAVLink, as the control loop has it: started, heard and told without ever waiting."""

from __future__ import annotations

import logging
import pickle
import select
import subprocess
import time
from collections.abc import Iterator
from types import TracebackType
from typing import Self

from ori_deploy.errors import OriDeployError
from ori_deploy.mav.settings import Settings
from ori_deploy.mav.words import Failed, Ready, Snapshot, Word, item_of, word_of
from ori_deploy.telemetry.channel import Sender, spawn

START_S = 20.0
STOP_S = 5.0
"""How long the process may take to open its links, and to end."""

ROOM_BYTES = 1 << 18
WORDS_PER_CYCLE = 8
RESTART_S = 2.0

SILENT_S = 3.0
"""One that says nothing for so long hangs: it is ended, and taken as gone. It has something to say far oftener."""

log = logging.getLogger(__name__)


class LinksFailed(OriDeployError):
    """The links of the MAVLink network cannot be opened."""


class Speaker:
    """The process, and what is said to it and by it.

    Parameters
    ----------
    settings
        Of the network.

    Attributes
    ----------
    lost
        Whether it is gone; `restart` starts another.

    Raises
    ------
    LinksFailed
        A link cannot be opened.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._waiting: list[Word] = []
        self._lost_s: float | None = None
        self._process, self._sender = self._start()
        try:
            self._await_ready()
        except BaseException:
            self.close()
            raise

    @property
    def lost(self) -> bool:
        """Whether it is gone."""
        return self._lost_s is not None

    def words(self) -> Iterator[Word]:
        """What it has said, as much as fits into a cycle; the rest comes in the next.

        Of one that is gone nothing more counts: nobody on the network could take back what it asked for.
        """
        if self.lost:
            return
        try:
            for frame in self._sender.heard():
                self._silent_from_s = time.monotonic() + SILENT_S
                self._waiting.extend(word for word in map(word_of, frame) if word is not None)
            if time.monotonic() > self._silent_from_s:
                self._process.kill()  # its links, with whatever hangs in them, go with it
                raise TimeoutError(f"it has said nothing for {SILENT_S:g} s")
        except OSError as wrong:
            self._lose(wrong)
            return
        now, self._waiting = self._waiting[:WORDS_PER_CYCLE], self._waiting[WORDS_PER_CYCLE:]
        yield from now

    def say(self, word: Word) -> None:
        """Tell it something; what it has no room for is left out, unless it is an answer."""
        if self.lost:
            return
        try:
            self._sender.send([item_of(word)], urgent=not isinstance(word, Snapshot))
        except OSError as wrong:
            self._lose(wrong)

    def restart(self) -> None:
        """Start it again when it is gone, now and then; this takes longer than a cycle."""
        if self._lost_s is None or time.monotonic() - self._lost_s < RESTART_S:
            return
        self.close()
        self._lost_s, self._waiting = None, []
        try:
            self._process, self._sender = self._start()
        except OSError as wrong:  # no memory, no processes left: tried again
            self._lose(wrong)

    def close(self) -> None:
        """End it. Safe to call twice."""
        self._sender.close()
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def _start(self) -> tuple[subprocess.Popen[bytes], Sender]:
        process, end = spawn("ori_deploy.mav.process", ())
        sender = Sender(end, waits=False, room_bytes=ROOM_BYTES)
        sender.send([("settings", pickle.dumps(self._settings))])
        self._silent_from_s = time.monotonic() + START_S
        return process, sender

    def _await_ready(self) -> None:
        """Wait until the links are open."""
        deadline = time.monotonic() + START_S
        while time.monotonic() < deadline:
            select.select([self._sender], [], [], 0.1)
            ended = self._process.poll() is not None
            for frame in self._sender.heard():
                for word in map(word_of, frame):
                    if isinstance(word, Failed):
                        raise LinksFailed(word.text)
                    if isinstance(word, Ready):
                        return
            if ended:
                break
        raise LinksFailed("the process that speaks MAVLink does not come up; remedy: see what it says above")

    def _lose(self, wrong: OSError) -> None:
        log.error("the process that speaks MAVLink is gone (%s)", wrong)
        self._lost_s = self._lost_s or time.monotonic()
