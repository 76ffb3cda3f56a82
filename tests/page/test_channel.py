"""What browsers ask and hear: over real web sockets, with a controller that is made up."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.asyncio.server import serve

from ori_deploy.deploy.states import State
from ori_deploy.operate.messages import Answer, Do, Request
from ori_deploy.page.channel import FRESH_S, Channel
from ori_deploy.page.line import LineLost


class MadeUp:
    """Lines to a controller that does, or is silent, or is gone."""

    def __init__(self) -> None:
        self.lost: LineLost | None = None
        self.orders: list[Request] = []
        self.stops: list[bool] = []
        self.goes_on = threading.Event()
        self.goes_on.set()

    def order(self, request: Request) -> Answer:
        self.orders.append(request)
        return self._answer()

    def stop(self, *, again: bool = False) -> Answer:
        self.stops.append(again)
        self.goes_on.wait(10.0)
        return self._answer()

    def _answer(self) -> Answer:
        if self.lost is not None:
            raise self.lost
        return Answer(True, State.FAULT)


class Page:
    """A channel that is served, at a time that the test tells."""

    def __init__(self) -> None:
        self.lines, self.now = MadeUp(), 100.0
        self.channel = Channel(self.lines, lambda: self.now)  # type: ignore[arg-type]
        self.port = 0

    async def tab(self, key: str = "") -> ClientConnection:
        return await connect(f"ws://127.0.0.1:{self.port}/token/operate?tab={key}")

    async def tell(self, **news: Any) -> None:
        self.channel.tell({"link": "ok", **news})
        await asyncio.sleep(0.01)


async def heard(tab: ClientConnection, key: str) -> dict[str, Any]:
    """The next message with something in it."""
    while True:
        told: dict[str, Any] = json.loads(await asyncio.wait_for(tab.recv(), 10.0))
        if key in told:
            return told


async def ask(tab: ClientConnection, do: str, **more: Any) -> dict[str, Any]:
    await tab.send(json.dumps({"do": do, **more}))
    answer: dict[str, Any] = (await heard(tab, "answer"))["answer"]
    return answer


async def control(tab: ClientConnection, do: str) -> str:
    await tab.send(json.dumps({"do": do}))
    return str((await heard(tab, "control"))["control"])


def on(test: Callable[[Page], Awaitable[None]]) -> None:
    async def run() -> None:
        page = Page()
        async with serve(page.channel, "127.0.0.1", 0) as server:
            page.port = next(iter(server.sockets)).getsockname()[1]
            await test(page)

    asyncio.run(run())


def test_an_order_says_when_it_was_asked_and_on_which_news() -> None:
    async def test(page: Page) -> None:
        tab = await page.tab("a")
        await heard(tab, "control")
        await control(tab, "claim")
        await page.tell(state="armed")
        number = (await heard(tab, "now"))["number"]
        page.now += 0.9 * FRESH_S
        assert (await ask(tab, "deploy", seen=number, span_unfolded=True))["took"]
        assert page.lines.orders == [Request(Do.DEPLOY, asked_s=page.now, span_unfolded=True)]

    on(test)


def test_an_order_that_was_given_on_old_news_is_not_passed_on() -> None:
    """A page that hung, or a slow tunnel: what was pressed long ago would begin now."""

    async def test(page: Page) -> None:
        tab = await page.tab("a")
        await heard(tab, "control")
        await control(tab, "claim")
        await page.tell(state="armed")
        number = (await heard(tab, "now"))["number"]
        page.now += 1.1 * FRESH_S
        await page.tell(state="armed")
        for seen in (number, number + 100, 0):
            answer = await ask(tab, "deploy", seen=seen)
            assert (answer["took"], answer["code"]) == (False, "too_late")
        assert page.lines.orders == []
        assert (await ask(tab, "stop"))["took"]

    on(test)


def test_a_pause_may_come_late() -> None:
    """Reproduced: a tunnel hung for three seconds, and the Pause that came out of it was refused as too late."""

    async def test(page: Page) -> None:
        tab = await page.tab("a")
        await heard(tab, "control")
        await control(tab, "claim")
        await page.tell(state="moving")
        number = (await heard(tab, "now"))["number"]
        page.now += 2.0 * FRESH_S
        await page.tell(state="moving")
        for seen in (number, number + 100, 0):
            assert (await ask(tab, "pause", seen=seen))["took"]
        for do in ("resume", "stow", "arm", "clear_fault"):
            assert (await ask(tab, do, seen=number))["code"] == "too_late"
        assert [one.do for one in page.lines.orders] == [Do.PAUSE] * 3

    on(test)


def test_a_stop_is_not_given_up_while_there_is_a_controller() -> None:
    """Reproduced: its socket had failed, it moved on, and STOP was answered with a no that ended the asking."""

    async def test(page: Page) -> None:
        tab = await page.tab("a")
        await heard(tab, "control")
        await control(tab, "claim")
        page.lines.lost = LineLost("refused", shut=True)
        await page.tell(state="moving")
        number = (await heard(tab, "now"))["number"]
        stop, order = await ask(tab, "stop", id=5), await ask(tab, "deploy", seen=number)
        assert (stop["took"], stop["id"], order["took"]) == (None, 5, False)
        for answer in (stop, order):
            assert "takes no commands any more" in answer["why"]
            assert "Ctrl-C" in answer["why"]
            assert "ended" not in answer["why"]

    on(test)


def test_a_silence_is_unknown_and_only_an_end_is_no() -> None:
    """Reproduced: "not taken", and the structure moved two seconds later."""

    async def test(page: Page) -> None:
        tab = await page.tab("a")
        await heard(tab, "control")
        await control(tab, "claim")
        for lost, took in ((LineLost("silent"), None), (LineLost("gone", ended=True), False)):
            page.lines.lost = lost
            await page.tell(state="armed")
            number = (await heard(tab, "now"))["number"]
            for answer in (await ask(tab, "deploy", seen=number), await ask(tab, "stop", id=5)):
                assert answer["took"] is took
            assert answer["id"] == 5

    on(test)


def test_a_stop_that_is_sent_again_waits_for_the_first_and_a_new_one_does_not_count_as_that() -> None:
    async def test(page: Page) -> None:
        tab = await page.tab("a")
        page.lines.goes_on.clear()
        for again in (False, True, True):
            await tab.send(json.dumps({"do": "stop", "id": 1, "again": again}))
        await tab.send(json.dumps({"do": "stop", "id": 2}))
        await asyncio.sleep(0.1)
        page.lines.goes_on.set()
        answers = [(await heard(tab, "answer"))["answer"] for _ in range(4)]
        assert sorted(one["id"] for one in answers) == [1, 1, 1, 2]
        assert page.lines.stops == [False, False]

    on(test)


def test_only_who_comes_is_told_again_how_things_were_and_how_old_that_is() -> None:
    """Reproduced: somebody opened the page, and what was 40 s old counted as news for everybody."""

    async def test(page: Page) -> None:
        first = await page.tab("a")
        await heard(first, "control")
        await page.tell(state="moving")
        assert (await heard(first, "now"))["age_s"] == 0.0
        page.now += 40.0
        second = await page.tab("b")
        assert (await heard(second, "now"))["age_s"] == pytest.approx(40.0)
        await first.send(json.dumps({"do": "claim"}))
        told = [json.loads(await asyncio.wait_for(first.recv(), 10.0)) for _ in range(2)]
        assert all("control" in one and "now" not in one for one in told)

    on(test)


def test_a_tab_that_comes_again_takes_the_place_of_its_lost_self() -> None:
    """Reproduced: after a lost connection the old one held control until its pings ran out."""

    async def test(page: Page) -> None:
        old = await page.tab("a")
        await heard(old, "control")
        assert await control(old, "claim") == "you"
        other = await page.tab("b")
        assert (await heard(other, "control"))["control"] == "other"
        new = await page.tab("a")
        assert (await heard(new, "control"))["control"] == "you"
        await asyncio.wait_for(old.wait_closed(), 10.0)
        await page.tell(state="armed")
        number = (await heard(new, "now"))["number"]
        assert page.channel.browsers == 2
        assert (await ask(new, "deploy", seen=number))["took"]
        assert not (await ask(other, "deploy", seen=number))["took"]
        await new.close()
        assert await control(other, "claim") in ("nobody", "you")
        assert page.channel.control.holder == "tab b"

    on(test)


def test_tabs_without_a_key_are_not_each_other() -> None:
    async def test(page: Page) -> None:
        one, other = await page.tab(), await page.tab("x" * 65)
        await heard(one, "control")
        await heard(other, "control")
        assert page.channel.browsers == 2

    on(test)
