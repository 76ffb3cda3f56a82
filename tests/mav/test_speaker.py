"""The process that speaks MAVLink, from the loop's side: gone, and started again."""

from __future__ import annotations

import logging
import os
import signal
import time
from collections.abc import Iterator

import pytest

from ori_deploy.mav import speaker as module
from ori_deploy.mav.settings import Settings
from ori_deploy.mav.speaker import RESTART_S, Speaker
from ori_deploy.mav.words import Alive, Ask, Ended, Failed, Tune, Word
from tests.mav.world import world


@pytest.fixture
def speaker() -> Iterator[Speaker]:
    with Speaker(Settings()) as made:
        yield made


def said(speaker: Speaker, kind: type[Word]) -> Word:
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline:
        for word in speaker.words():
            if isinstance(word, kind):
                return word
        time.sleep(0.01)
    raise AssertionError(f"no {kind.__name__}")


def gone(speaker: Speaker) -> None:
    os.kill(speaker.pid, signal.SIGKILL)
    while not speaker.lost:
        speaker.say(Ended(0, "stopped", ""))
        time.sleep(0.01)


def test_what_one_that_is_gone_had_asked_for_counts_no_more(speaker: Speaker) -> None:
    said(speaker, Tune)
    gone(speaker)
    speaker._waiting = [Ask(k, "deploy", "a station", False, 0.0) for k in range(20)]
    assert list(speaker.words()) == []


def test_one_that_hangs_is_taken_as_gone_and_ended(speaker: Speaker, monkeypatch: pytest.MonkeyPatch) -> None:
    said(speaker, Alive)
    monkeypatch.setattr(module, "SILENT_S", 1.0)
    said(speaker, Alive)
    pid = speaker.pid
    os.kill(pid, signal.SIGSTOP)
    while not speaker.lost:
        list(speaker.words())
        time.sleep(0.01)
    assert os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    speaker._lost_s = time.monotonic() - RESTART_S
    speaker.restart()
    assert said(speaker, Alive)


def test_one_that_speaks_is_never_taken_as_hanging(speaker: Speaker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SILENT_S", 2.0)
    until = time.monotonic() + 5.0
    while time.monotonic() < until:
        list(speaker.words())
        assert not speaker.lost
        time.sleep(0.01)


def test_one_that_cannot_be_started_again_now_is_later(speaker: Speaker, monkeypatch: pytest.MonkeyPatch) -> None:
    gone(speaker)

    def fails(*_: object) -> None:
        raise BlockingIOError("no processes left")

    with monkeypatch.context() as patched:
        patched.setattr(module, "spawn", fails)
        patched.setattr(speaker, "_lost_s", time.monotonic() - RESTART_S)
        speaker.restart()
        assert speaker.lost
    speaker._lost_s = time.monotonic() - RESTART_S
    speaker.restart()
    assert not speaker.lost
    assert said(speaker, Tune)


def test_why_it_cannot_open_its_links_again_is_told(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.ERROR):
        world().bridge.attend(Failed("udpin:127.0.0.1:1: in use"))
    assert "in use" in caplog.text
