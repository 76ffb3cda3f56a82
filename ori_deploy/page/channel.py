"""The operator's own socket on the page: what the buttons ask, and how things are, as JSON texts both ways.

News have numbers. An order tells the number of the news that its operator saw; when those are old, something between
them hung meanwhile, and an order that may lead to a motion is not passed on. Nothing of that holds for a stop.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection, broadcast

from ori_deploy.operate.messages import MAY_MOVE, Answer, Code, Do, Request
from ori_deploy.page.control import Control
from ori_deploy.page.line import LineLost, Lines

MAX_WORDS = 200
"""Characters of the longest message of a browser of ours, and some."""
FRESH_S = 2.5
"""News that are older are no ground to order anything on; a browser that is busy drawing may be a second behind."""
_NEWS_KEPT = 256
_LONGEST_KEY = 64


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
class Asked:
    """A message of a browser.

    Attributes
    ----------
    do
        `STOP` or a `Wish`.
    seen
        Number of the news that were on the screen.
    id, again
        Of a stop: comes back with its answer; and whether it was sent before, and not confirmed.
    span_unfolded
        With a deployment: the operator's word for it.
    """

    do: str
    seen: int = 0
    id: int = 0
    again: bool = False
    span_unfolded: bool = False


@dataclass(frozen=True)
class Outcome:
    """What became of something that was asked, for the browser that asked; `took` is None where nobody knows."""

    do: str
    took: bool | None
    why: str | None
    code: str | None = None
    id: int = 0


def outcome(do: str, answer: Answer) -> Outcome:
    """An answer in fewer words."""
    return Outcome(do, answer.took, answer.why, None if answer.code is None else str(answer.code))


def unanswered(do: str, lost: LineLost) -> Outcome:
    """No answer in words; it is known that nothing was taken where there is no controller, or nothing was sent.

    Of a stop that is not enough: as long as there is a controller it is not confirmed, and is sent again.
    """
    if lost.ended:
        return Outcome(do, False, "there is no controller any more: it has ended")
    if lost.shut:
        why = "the controller takes no commands any more, and may be moving: press Ctrl-C in its terminal"
        return Outcome(do, None if do == STOP else False, why)
    if do == STOP:
        return Outcome(do, None, "the controller does not answer: press Ctrl-C in its terminal, or ori-deploy estop")
    return Outcome(do, None, "the controller does not answer: whether it was taken is not known; see the state")


class Channel:
    """Serves all browsers; lives in the event loop that serves the page.

    Parameters
    ----------
    lines
        To the controller.
    now
        CLOCK_MONOTONIC, which the controller has, too.
    """

    def __init__(self, lines: Lines, now: Callable[[], float] = time.monotonic) -> None:
        self._lines, self._now = lines, now
        self.control = Control()
        self._browsers: dict[str, ServerConnection] = {}
        self._count = 0
        self._news: dict[str, Any] | None = None
        self._number = 0
        self._told_s: deque[tuple[int, float]] = deque(maxlen=_NEWS_KEPT)
        # A stop never waits behind an order that is being answered.
        self._stopping = ThreadPoolExecutor(1, "stop")
        self._ordering = ThreadPoolExecutor(2, "order")
        self._stop: asyncio.Task[Outcome] | None = None
        self._tasks: set[asyncio.Task[Any]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def browsers(self) -> int:
        """How many look at the page."""
        return len(self._browsers)

    async def __call__(self, connection: ServerConnection) -> None:
        """Serve one browser until it goes; its going is no command."""
        self._loop = asyncio.get_running_loop()
        who = self._name_of(connection)
        before = self._browsers.get(who)
        self._browsers[who] = connection
        if before is not None:  # the same tab, whose old connection has not noticed yet that it is lost
            self._do(before.close())
        self.control = self.control.came(who)
        self._tell_newcomer(connection)
        self._tell_control()
        try:
            async for words in connection:
                self._do(self._heard(who, connection, words))  # not awaited: the next message may be a stop
        finally:
            if self._browsers.get(who) is connection:
                del self._browsers[who]
                self.control = self.control.gone(who)
                self._tell_control()

    def tell(self, news: dict[str, Any]) -> None:
        """Tell all browsers how things are; from any thread, waits for none."""
        loop = self._loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._tell, news)

    # --- in the loop ----------------------------------------------------------------------------------

    def _do(self, work: Any) -> None:
        assert self._loop is not None
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _name_of(self, connection: ServerConnection) -> str:
        """A tab's own key; somebody without one is somebody else each time."""
        self._count += 1
        path = "" if connection.request is None else connection.request.path
        key = parse_qs(urlsplit(path).query).get("tab", [""])[0]
        return f"tab {key}" if 0 < len(key) <= _LONGEST_KEY else f"nameless {self._count}"

    def _tell(self, news: dict[str, Any]) -> None:
        self._number += 1
        self._news = news
        self._told_s.append((self._number, self._now()))
        broadcast(self._browsers.values(), json.dumps({"now": news, "number": self._number, "age_s": 0.0}))

    def _tell_newcomer(self, connection: ServerConnection) -> None:
        """How things were when it was told last, and how long ago that was."""
        if self._news is not None:
            age_s = self._age_s(self._number)
            broadcast([connection], json.dumps({"now": self._news, "number": self._number, "age_s": age_s}))

    def _tell_control(self) -> None:
        for who, connection in self._browsers.items():
            holder = self.control.holder
            held = "nobody" if holder is None else "you" if holder == who else "other"
            broadcast([connection], json.dumps({"control": held}))

    def _age_s(self, number: int) -> float | None:
        """How long ago these news were told; None where nobody remembers."""
        told_s = next((at for one, at in reversed(self._told_s) if one == number), None)
        return None if told_s is None else self._now() - told_s

    def _is_old(self, number: int) -> bool:
        """Whether these news are no ground to begin a motion on."""
        age_s = self._age_s(number)
        return age_s is None or age_s > FRESH_S

    async def _heard(self, who: str, connection: ServerConnection, words: str | bytes) -> None:
        asked = asked_for(words)
        if asked is None:
            return
        result = await self._asked(who, asked)
        if result is not None:
            broadcast([connection], json.dumps({"answer": asdict(result)}))

    async def _asked(self, who: str, asked: Asked) -> Outcome | None:
        if asked.do == STOP:
            return replace(await self._stopped(asked.again), id=asked.id)
        wish = Wish(asked.do)
        if wish in _ORDERS:
            return await self._ordered(who, wish, asked)
        change = {Wish.CLAIM: self.control.claim, Wish.TAKE: self.control.take, Wish.RELEASE: self.control.release}
        self.control = change[wish](who)
        self._tell_control()
        return None

    async def _ordered(self, who: str, wish: Wish, asked: Asked) -> Outcome:
        if not self.control.may_command(who):
            return Outcome(wish, False, "you do not hold control")
        if _ORDERS[wish] in MAY_MOVE and self._is_old(asked.seen):
            why = "what you saw is not how things are now: look at the state, and ask again"
            return Outcome(wish, False, why, str(Code.TOO_LATE))
        request = Request(_ORDERS[wish], asked_s=self._now(), span_unfolded=asked.span_unfolded)
        return await self._ask(self._ordering, wish, lambda: self._lines.order(request))

    async def _stopped(self, again: bool) -> Outcome:
        """A stop; one that is sent again while the first is still being asked waits for that one's answer."""
        if not (again and self._stop is not None and not self._stop.done()):
            work = self._ask(self._stopping, STOP, lambda: self._lines.stop(again=again))
            self._stop = asyncio.get_running_loop().create_task(work)
        return await asyncio.shield(self._stop)

    async def _ask(self, pool: ThreadPoolExecutor, asked: str, ask: Callable[[], Answer]) -> Outcome:
        try:
            return outcome(asked, await asyncio.get_running_loop().run_in_executor(pool, ask))
        except LineLost as lost:
            return unanswered(asked, lost)


def asked_for(words: str | bytes) -> Asked | None:
    """What a message asks for, or None where it is none of ours."""
    if not isinstance(words, str) or len(words) > MAX_WORDS:
        return None
    try:
        document = json.loads(words)
    except ValueError:
        return None
    do = document.get("do") if isinstance(document, dict) else None
    if not isinstance(do, str) or not (do == STOP or do in set(Wish)):
        return None
    seen, number = document.get("seen"), document.get("id")
    return Asked(
        do,
        seen if isinstance(seen, int) else 0,
        number if isinstance(number, int) else 0,
        document.get("again") is True,
        document.get("span_unfolded") is True,
    )
