"""The operator's own socket on the page: what the buttons ask, and how things are, as JSON texts both ways."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from websockets.asyncio.server import ServerConnection, broadcast

from ori_deploy.operate.messages import Answer, Do
from ori_deploy.page.control import Control
from ori_deploy.page.line import LineLost, Lines

MAX_WORDS = 200
"""Characters of the longest message of a browser of ours, and some."""


class Wish(StrEnum):
    """What a browser can ask for besides a stop."""

    CLAIM = "claim"
    TAKE = "take"
    RELEASE = "release"
    ARM = "arm"
    DEPLOY = "deploy"
    STOW = "stow"
    PAUSE = "pause"
    RESUME = "resume"
    CLEAR_FAULT = "clear_fault"


STOP = "stop"

_ORDERS = {
    Wish.ARM: Do.ARM,
    Wish.DEPLOY: Do.DEPLOY,
    Wish.STOW: Do.STOW,
    Wish.PAUSE: Do.PAUSE,
    Wish.RESUME: Do.RESUME,
    Wish.CLEAR_FAULT: Do.CLEAR_FAULT,
}


@dataclass(frozen=True)
class Outcome:
    """What became of something that was asked, for the browser that asked."""

    do: str
    took: bool
    why: str | None


def outcome(do: str, answer: Answer) -> Outcome:
    """An answer in fewer words."""
    return Outcome(do, answer.took, answer.why)


class Channel:
    """Serves all browsers; lives in the event loop that serves the page.

    Parameters
    ----------
    lines
        To the controller.
    """

    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self.control = Control()
        self._browsers: dict[str, ServerConnection] = {}
        self._count = 0
        self._last: dict[str, Any] = {}
        # A stop never waits behind an order that is being answered.
        self._stopping = ThreadPoolExecutor(1, "stop")
        self._ordering = ThreadPoolExecutor(2, "order")
        self._tasks: set[asyncio.Task[None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def browsers(self) -> int:
        """How many look at the page."""
        return len(self._browsers)

    async def __call__(self, connection: ServerConnection) -> None:
        """Serve one browser until it goes; its going is no command."""
        self._loop = asyncio.get_running_loop()
        self._count += 1
        who = str(self._count)
        self._browsers[who] = connection
        self.control = self.control.came(who)
        self._tell_control()
        try:
            async for words in connection:
                # Not awaited: the next message may be a stop.
                task = self._loop.create_task(self._heard(who, connection, words))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
        finally:
            del self._browsers[who]
            self.control = self.control.gone(who)
            self._tell_control()

    def tell(self, news: dict[str, Any]) -> None:
        """Tell all browsers how things are; from any thread, waits for none."""
        loop = self._loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._tell, news)

    # --- in the loop ----------------------------------------------------------------------------------

    def _tell(self, news: dict[str, Any]) -> None:
        self._last = news
        broadcast(self._browsers.values(), json.dumps({"now": news}))

    def _tell_control(self) -> None:
        for who, connection in self._browsers.items():
            holder = self.control.holder
            held = "nobody" if holder is None else "you" if holder == who else "other"
            told = {"control": held, "browsers": len(self._browsers)}
            broadcast([connection], json.dumps(told | ({"now": self._last} if self._last else {})))

    async def _heard(self, who: str, connection: ServerConnection, words: str | bytes) -> None:
        asked = asked_for(words)
        if asked is None:
            return
        result = await self._asked(who, asked)
        if result is not None:
            broadcast([connection], json.dumps({"answer": asdict(result)}))

    async def _asked(self, who: str, asked: str) -> Outcome | None:
        if asked == STOP:
            return await self._ask(self._stopping, asked, self._lines.stop)
        wish = Wish(asked)
        if wish in _ORDERS:
            if not self.control.may_command(who):
                return Outcome(asked, False, "you do not hold control")
            return await self._ask(self._ordering, asked, lambda: self._lines.order(_ORDERS[wish]))
        change = {Wish.CLAIM: self.control.claim, Wish.TAKE: self.control.take, Wish.RELEASE: self.control.release}
        self.control = change[wish](who)
        self._tell_control()
        return None

    async def _ask(self, pool: ThreadPoolExecutor, asked: str, ask: Callable[[], Answer]) -> Outcome:
        try:
            return outcome(asked, await asyncio.get_running_loop().run_in_executor(pool, ask))
        except LineLost:
            return Outcome(asked, False, "the controller does not answer; stop it in its own terminal with Ctrl-C")


def asked_for(words: str | bytes) -> str | None:
    """What a message asks for, or None where it is none of ours."""
    if not isinstance(words, str) or len(words) > MAX_WORDS:
        return None
    try:
        document = json.loads(words)
    except ValueError:
        return None
    do = document.get("do") if isinstance(document, dict) else None
    return do if isinstance(do, str) and (do == STOP or do in set(Wish)) else None
