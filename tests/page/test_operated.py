"""A page of a real controller, without a browser: what is ordered while it hangs, and how the end is told."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from ori_deploy.operate.client import ask, find
from ori_deploy.operate.messages import Do, Request
from ori_deploy.page.channel import FRESH_S
from tests.page.browser import Command, page_process
from tests.page.conftest import RIG

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("runtime_folder")]


class Tab:
    """What a browser would hear and say."""

    def __init__(self, link: ClientConnection) -> None:
        self._link, self.number = link, 0

    def send(self, do: str, **more: Any) -> None:
        self._link.send(json.dumps({"do": do, "seen": self.number, **more}))

    def hear(self, within_s: float = 20.0) -> dict[str, Any]:
        told: dict[str, Any] = json.loads(self._link.recv(within_s))
        self.number = told.get("number", self.number)
        return told

    def until(self, **news: str) -> dict[str, Any]:
        """Until the news have these words."""
        while True:
            now: dict[str, Any] = self.hear().get("now", {})
            if all(word in str(now.get(key)) for key, word in news.items()):
                return now

    def answer(self) -> dict[str, Any]:
        while True:
            told = self.hear()
            if "answer" in told:
                answer: dict[str, Any] = told["answer"]
                return answer


@contextmanager
def tab(served: Command) -> Iterator[Tab]:
    with connect(served.address.replace("http", "ws") + "/operate?tab=test") as link:
        yield Tab(link)


def state_of(served: Command) -> str:
    answer = next(iter(ask(find(pid=served.process.pid), Request(Do.STATUS))))
    return str(answer.state)


def hang(pid: int) -> None:
    """Stop a process, and wait until all of its threads are: on a busy machine one may still hear what is sent."""
    os.kill(pid, signal.SIGSTOP)
    deadline = time.monotonic() + 10.0
    threads = Path(f"/proc/{pid}/task")
    while any(one.read_text().rpartition(")")[2].split()[0] != "T" for one in threads.glob("*/stat")):
        assert time.monotonic() < deadline
        time.sleep(0.001)


@pytest.mark.parametrize(("do", "why", "then"), [("deploy", "not known", "armed"), ("stop", "Ctrl-C", "fault")])
def test_what_was_ordered_while_the_controller_hung_is_not_begun_when_all_have_left_but_a_stop_is(
    do: str, why: str, then: str, made: Path, tmp_path: Path
) -> None:
    """Reproduced: "not taken", given back, closed, killed; the controller then went on, and deployed."""
    words = ("serve", made / "wing.plan.json", "--rig", RIG, "--view", "--view-port", 0)
    with Command(*words, cwd=tmp_path) as served:
        with tab(served) as one:
            one.until(state="ready")
            one.send("claim")
            one.send("arm")
            assert one.answer()["took"]
            one.until(state="armed")
            os.kill(served.process.pid, signal.SIGSTOP)
            try:
                one.send(do)
                answer = one.answer()
                assert answer["took"] is None
                assert why in answer["why"]
                assert "may be moving" in one.until(link="does not answer")["link"]
                one.send("release")
            finally:
                os.kill(page_process(served), signal.SIGKILL)
                os.kill(served.process.pid, signal.SIGCONT)
            with suppress(Exception):
                one.hear()
        deadline = time.monotonic() + 2.0
        while time.monotonic() < deadline:
            assert state_of(served) == then


def test_what_was_ordered_of_a_page_that_hung_is_not_passed_on(made: Path, tmp_path: Path) -> None:
    words = ("serve", made / "wing.plan.json", "--rig", RIG, "--view", "--view-port", 0)
    with Command(*words, cwd=tmp_path) as served, tab(served) as one:
        one.until(state="ready")
        one.send("claim")
        one.send("arm")
        assert one.answer()["took"]
        one.until(state="armed")
        page = page_process(served)
        hang(page)
        one.send("deploy")
        time.sleep(FRESH_S + 1.0)
        os.kill(page, signal.SIGCONT)
        answer = one.answer()
        assert (answer["took"], answer["code"]) == (False, "too_late")
        assert state_of(served) == "armed"


def test_a_controller_that_was_killed_has_ended(made: Path, tmp_path: Path) -> None:
    words = ("serve", made / "wing.plan.json", "--rig", RIG, "--view", "--view-port", 0)
    with Command(*words, cwd=tmp_path) as served, tab(served) as one:
        one.until(state="ready")
        os.kill(served.process.pid, signal.SIGKILL)
        assert "did not say how" in one.until(link="has ended")["alarms"][0]
        one.send("stop", id=3)
        answer = one.answer()
        assert (answer["took"], answer["id"]) == (False, 3)


def test_a_deployment_that_succeeds_says_so_at_its_end(made: Path, tmp_path: Path) -> None:
    words = ("deploy", made / "wing.plan.json", "--rig", RIG, "--view", "--view-port", 0)
    with Command(*words, cwd=tmp_path) as served, tab(served) as one:
        told = one.until(link="ended")
        assert told == {"link": "ended: deployed", "alarms": []}
        one.send("stop", id=3)
        answer = one.answer()
        assert (answer["took"], answer["id"]) == (False, 3)
        assert "ended" in answer["why"]
