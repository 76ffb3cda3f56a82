"""The page of a controller: what is not measured is not shown as if it were."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import viser

from ori_deploy.deploy.states import State
from ori_deploy.files import load_design, load_plan
from ori_deploy.operate.messages import Answer, LatchStatus, Status
from ori_deploy.page.line import LineLost
from ori_deploy.page.live import Live
from ori_deploy.page.shown import LATCH_COLOURS, UNKNOWN
from tests.page.test_news import STATUS

CREASES = "angle of crease close_a (°)"
N = 4


@dataclass
class Told:
    """Lines to a controller, and the channel to browsers: both made up."""

    status_: Status | None = None
    last: Answer | None = None
    news: list[dict[str, Any]] = field(default_factory=list)
    browsers: int = 0

    def status(self) -> Answer:
        if self.last is not None:
            raise LineLost("ended", ended=True, last=self.last)
        if self.status_ is None:
            raise LineLost("silent")
        return Answer(True, self.status_.state, self.status_.at_rest, status=self.status_)

    def keep_stop_open(self) -> None:
        pass

    def tell(self, news: dict[str, Any]) -> None:
        self.news.append(news)


class Page:
    """A page that asks when the test says so."""

    def __init__(self, server: viser.ViserServer, folder: Path) -> None:
        design, plan = load_design(folder / "wing.design.json"), load_plan(folder / "wing.plan.json")
        self.told, self._uptime = Told(), 1.0
        made_up: Any = self.told
        self.live = Live(server, made_up, made_up, design, plan)
        self.shown, self.viewer = self.live._viewer.shown, self.live._viewer
        points = design.structure.layout.latch_points
        self.deployed = replace(
            STATUS, state=State.DEPLOYED, at_rest=True, fold=1.0, folds=(1.0,) * N, current_a=(0.1,) * N,
            latches=tuple(LatchStatus(f"latch_{one}", True, True, one) for one in points),
        )  # fmt: skip

    def ask(self, status: Status | None, times: int = 1) -> None:
        for _ in range(times):
            self._uptime += 0.05
            self.told.status_ = None if status is None else replace(status, uptime_s=self._uptime)
            self.live._ask(0)

    def said(self, words: str) -> bool:
        """Whether it says so in the panel, within a few seconds."""
        return until(lambda: self.viewer._verdict is not None and words in self.viewer._verdict.content)

    def known_of_latches(self) -> set[str]:
        colours = {ball.color for balls in self.shown._latches.values() for ball in balls}
        return {name for name, colour in LATCH_COLOURS.items() if colour in colours}

    def angles(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """(rows, cells) as drawn."""
        return np.column_stack(self.live._recent[CREASES].curves.y)

    @property
    def is_dimensioned(self) -> bool:
        """Whether the section's drawing, or the table under it, tells a size."""
        shown = (self.viewer._section, self.viewer._sized)
        return any(one is None or " mm" in one.content for one in shown)

    @property
    def is_grey(self) -> bool:
        return set(self.shown._look.values()) == {None}


def until(so: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + 5.0
    while not so() and time.monotonic() < deadline:
        time.sleep(0.01)
    return so()


@pytest.fixture
def page(made: Path) -> Iterator[Page]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield Page(server, made)
    server.stop()


def without(page: Page, how: str) -> Status | None:
    """What is told where there are no readings."""
    if how == "silent":
        return None
    if how == "fault":
        return replace(page.deployed, state=State.FAULT, fault="link lost", folds=(None,) * N)
    return replace(page.deployed, state=State.DISCONNECTED, fold=None, folds=(), latches=(), current_a=())


@pytest.mark.parametrize("how", ["silent", "fault", "disconnected"])
def test_without_readings_nothing_is_told_of_the_structure(page: Page, how: str) -> None:
    """Reproduced: green latches, "No interference" and a level curve, of a structure nobody measured any more."""
    page.ask(page.deployed, 5)
    assert page.said("No interference")
    assert until(lambda: page.live._verdict is not None)
    assert page.known_of_latches() == {"closed"}
    assert not page.is_grey
    assert until(lambda: page.is_dimensioned)
    assert not np.isnan(page.angles()).any()
    page.ask(without(page, how), 3)
    assert page.known_of_latches() == {UNKNOWN}
    assert page.said("Not measured")
    assert until(lambda: page.live._verdict is None)
    assert until(lambda: not page.is_dimensioned)
    assert until(lambda: page.is_grey)
    assert np.isnan(page.angles()[-1]).all()
    assert not any("latches" in fact for fact in page.told.news[-1].get("facts", []))
    page.ask(page.deployed, 2)
    assert page.known_of_latches() == {"closed"}
    assert page.said("No interference")
    assert until(lambda: not page.is_grey)
    gap = np.isnan(page.angles()).all(axis=1)
    assert gap.any()
    assert not gap[-1]


def test_after_a_session_that_said_how_it_ended_all_stays_as_it_was_then(page: Page) -> None:
    page.ask(page.deployed, 5)
    assert page.said("No interference")
    page.told.last = Answer(True, State.DEPLOYED, True, status=page.deployed)
    page.ask(None, 2)
    assert page.known_of_latches() == {"closed"}
    assert page.said("No interference")
    assert not page.is_grey


def test_before_the_first_reading_nothing_is_told_either(page: Page) -> None:
    assert page.said("Not measured")
    page.ask(replace(page.deployed, state=State.READY, fold=None, folds=(None,) * N))
    assert page.is_grey
    assert page.known_of_latches() == {UNKNOWN}
    assert np.isnan(page.angles()).all()


def test_a_latch_of_which_nothing_is_told_any_more_is_not_known(page: Page) -> None:
    page.ask(page.deployed)
    page.ask(replace(page.deployed, latches=()))
    assert page.known_of_latches() == {UNKNOWN}


def test_a_curve_is_drawn_of_what_was_read_only(page: Page) -> None:
    page.ask(page.deployed)
    page.ask(replace(page.deployed, folds=(1.0, None, 1.0, 1.0)))
    assert np.isnan(page.angles()[-1]).tolist() == [False, True, False, False]


def test_a_curve_of_servos_has_a_gap_where_the_link_was_gone(page: Page) -> None:
    page.ask(page.deployed)
    page.ask(without(page, "disconnected"))
    page.ask(page.deployed)
    assert np.isnan(page.live._recent["servo current (A)"].curves.y[0]).tolist() == [False, True, False]


def test_a_pose_that_cannot_be_judged_has_no_verdict(page: Page) -> None:
    """Reproduced: what was said of the last pose that could be judged stayed, and went on to the bar as current."""
    page.ask(page.deployed)
    assert page.said("No interference")
    vars(page.viewer)["_judge"] = None
    page.ask(page.deployed)
    assert page.said("could not be judged")
    assert until(lambda: page.live._verdict is None)
    page.ask(page.deployed)
    assert not any("clearance" in fact or "touch" in fact for fact in page.told.news[-1]["facts"])


def test_meshes_are_not_sent_again_each_time(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    page.ask(page.deployed)
    assert page.said("No interference")
    page.ask(None)
    assert until(lambda: page.is_grey)
    sent: list[str] = []
    buffer = page.viewer.server._websock_server.get_message_buffer()
    monkeypatch.setattr(buffer, "push", lambda message: sent.append(type(message).__name__))
    for _ in range(2):
        page.ask(None, 3)
        assert until(lambda: page.is_grey)
        page.ask(page.deployed, 3)
        assert until(lambda: not page.is_grey)
    assert sent
    assert not any("Glb" in one for one in sent)
