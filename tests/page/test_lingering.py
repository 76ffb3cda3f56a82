"""A page whose controller has ended: it stays for who looks, also across a reload, and not for ever."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from ori_deploy.page import __main__ as page

DESERTED_S = 1.0


@dataclass
class Looked:
    """As many browsers as the test tells."""

    browsers: int = 0


class Waiting:
    """A page's program that waits for its end, in a thread; its starter has the other end of the line."""

    def __init__(self) -> None:
        self.channel = Looked()
        end, self.starter = socket.socketpair()
        channel: Any = self.channel
        self._thread = threading.Thread(target=page._until_over, args=(end, channel), daemon=True)
        self._thread.start()

    def stays(self, for_s: float) -> bool:
        self._thread.join(for_s)
        return self._thread.is_alive()


@pytest.fixture
def waiting(monkeypatch: pytest.MonkeyPatch) -> Iterator[Waiting]:
    monkeypatch.setattr(page, "_DESERTED_S", DESERTED_S)
    monkeypatch.setattr(page, "_LOOK_S", 0.02)
    one = Waiting()
    yield one
    one.starter.close()


def test_a_reload_does_not_end_it(waiting: Waiting) -> None:
    """Reproduced: the first 0.2 s without a browser ended it, and a reload found nobody."""
    waiting.channel.browsers = 1
    assert waiting.stays(0.1)
    waiting.starter.close()
    for _ in range(3):
        assert waiting.stays(0.3)
        waiting.channel.browsers = 0
        assert waiting.stays(0.5 * DESERTED_S)
        waiting.channel.browsers = 1
    assert waiting.stays(1.5 * DESERTED_S)
    waiting.channel.browsers = 0
    begin = time.monotonic()
    assert not waiting.stays(10.0)
    assert time.monotonic() - begin >= 0.9 * DESERTED_S


def test_it_does_not_stay_for_ever(waiting: Waiting, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "_LINGERS_S", 0.5)
    waiting.channel.browsers = 1
    assert waiting.stays(0.1)
    waiting.starter.close()
    assert not waiting.stays(10.0)


def test_where_nobody_has_looked_for_long_it_ends_with_its_controller(waiting: Waiting) -> None:
    assert waiting.stays(1.2 * DESERTED_S)
    waiting.starter.close()
    assert not waiting.stays(0.5 * DESERTED_S)


def test_a_word_of_its_starter_ends_it_at_once(waiting: Waiting) -> None:
    waiting.channel.browsers = 1
    waiting.starter.sendall(b"x")
    assert not waiting.stays(0.5 * DESERTED_S)
