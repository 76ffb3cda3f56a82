"""Lines to a controller: silence is not an end, and a stop waits for nothing."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ori_deploy.deploy.states import State
from ori_deploy.operate.messages import Answer, Do, Request
from ori_deploy.page.channel import STOP, unanswered
from ori_deploy.page.line import Line, LineLost, Lines
from ori_deploy.page.process import Process
from tests.operate.served import Served, served

pytestmark = pytest.mark.usefixtures("runtime_folder")


@contextmanager
def stepping(one: Served) -> Iterator[None]:
    """The loop runs by itself."""
    ended = threading.Event()

    def run() -> None:
        while not ended.is_set():
            one.cycles()
            ended.wait(0.001)

    loop = threading.Thread(target=run)
    loop.start()
    try:
        yield
    finally:
        ended.set()
        loop.join()


@pytest.fixture
def silent(tmp_path: Path) -> Iterator[tuple[Path, socket.socket]]:
    """A socket at which somebody listens and says nothing."""
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen(16)
        yield path, listener


def test_lines_ask_order_and_stop_and_survive_being_dropped() -> None:
    with served() as one:
        lines = Lines(one.socket.path)
        with stepping(one):
            first = lines.status()
            assert first.status is not None
            assert first.status.takes_orders is False
            lines.keep_stop_open()
        for client in list(one.socket._clients.values()):
            one.socket._drop(client)
        with stepping(one):
            assert lines.status().status is not None
            one.bench.controller.deploy()
            assert lines.order(Request(Do.PAUSE)).took
            assert lines.stop().took
            assert lines.stop().state is State.FAULT  # pressed twice is pressed once
        lines.close()
    with pytest.raises(LineLost) as lost:
        lines.status()
    assert lost.value.shut


def test_silence_is_no_end_and_is_waited_for_once(silent: tuple[Path, socket.socket]) -> None:
    """Reproduced: over a line that stood, a silence was waited for twice, and called the end of the controller."""
    path, listener = silent
    line = Line(path, 0.2)
    with pytest.raises(LineLost):
        line.ask(Request(Do.ESTOP))
    begin = time.monotonic()
    with pytest.raises(LineLost) as lost:
        line.ask(Request(Do.ESTOP))
    assert time.monotonic() - begin < 0.35
    assert not lost.value.ended
    listener.accept()[0].close()
    line.close()


def test_a_controller_that_hangs_is_not_crowded_with_connections(silent: tuple[Path, socket.socket]) -> None:
    """It has room for a few that wait; a stop is to be among them."""
    path, listener = silent
    line = Line(path, 0.01)
    for _ in range(100):
        with pytest.raises(LineLost):
            line.ask(Request(Do.STATUS), again=True)
    link, _ = listener.accept()
    listener.setblocking(False)
    with pytest.raises(BlockingIOError):
        listener.accept()
    assert link.recv(10_000).count(b"\n") == 1  # and asked the same once
    link.close()
    line.close()


def test_where_nobody_listens_it_has_ended_only_if_its_process_is_gone(
    tmp_path: Path, silent: tuple[Path, socket.socket]
) -> None:
    path, listener = silent
    listener.close()
    here = Process.of(os.getpid())
    later = Process(os.getpid(), (here.began or 0) - 1)  # its number was given to another one
    for place in (path, tmp_path / "never"):
        for process, ended in ((None, False), (here, False), (later, True), (Process(os.getpid(), None), True)):
            with pytest.raises(LineLost) as lost:
                Lines(place, process).status()
            assert (lost.value.ended, lost.value.shut) == (ended, True)


def test_a_process_is_gone_when_it_has_ended_whether_or_not_somebody_asked_how() -> None:
    started = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    process = Process.of(started.pid)
    assert not process.gone
    started.kill()
    os.waitid(os.P_PID, started.pid, os.WEXITED | os.WNOWAIT)
    assert process.gone
    started.communicate()
    assert process.gone
    assert Process.of(started.pid).gone


@pytest.mark.parametrize("how", ["its socket failed", "its folder was removed"])
def test_a_controller_that_takes_no_commands_any_more_is_not_said_to_have_ended(
    how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reproduced: STOP was answered "there is no controller any more: it has ended", and the motion went on."""
    with served() as one:
        lines = Lines(one.socket.path, Process.of(os.getpid()))
        with stepping(one):
            lines.status()
            lines.keep_stop_open()
            one.bench.controller.deploy()
            if how == "its socket failed":
                monkeypatch.setattr(one.desk, "status", lambda: 1 / 0)
                with pytest.raises(LineLost) as silent:
                    lines.status()
                assert not silent.value.ended
                stop = unanswered(STOP, _lost(lines.stop))
                assert (stop.took, stop.code) == (None, None)
                assert "press Ctrl-C" in str(stop.why)
                assert unanswered(STOP, _lost(lambda: lines.stop(again=True))).took is None
            else:
                shutil.rmtree(one.socket.path.parent)
                assert lines.status().state is not None
            order = unanswered("pause", _lost(lambda: lines.order(Request(Do.PAUSE))))
            assert order.took is False
            assert "takes no commands any more" in str(order.why)
            assert "ended" not in str(order.why)
            assert one.bench.controller.under_way
            if how == "its folder was removed":
                assert lines.stop().took  # over the line that was kept
        lines.close()


def _lost(ask: Callable[[], Answer]) -> LineLost:
    with pytest.raises(LineLost) as lost:
        ask()
    return lost.value


def test_what_one_line_has_heard_of_the_end_all_know() -> None:
    """The process lives on where a page is looked at, and an order has a line of its own."""
    with served() as one:
        lines = Lines(one.socket.path, Process.of(os.getpid()))
        with stepping(one):
            lines.status()
        one.socket.close()
        assert _lost(lines.status).last is not None
        lost = _lost(lambda: lines.order(Request(Do.DEPLOY)))
        assert lost.ended
        assert lost.last is not None
        lines.close()


def test_an_answer_that_comes_too_late_is_not_taken_for_another_one_s() -> None:
    with served() as one:
        line = Line(one.socket.path, 0.2)
        with pytest.raises(LineLost):
            line.ask(Request(Do.STATUS))
        one.cycles(2)  # it is answered now
        with stepping(one):
            answer = line.ask(Request(Do.ESTOP))
        assert answer.state is State.FAULT
        assert answer.status is None
        line.close()


def test_the_last_word_is_heard_and_is_nobody_s_answer() -> None:
    with served() as one:
        lines = Lines(one.socket.path)
        with stepping(one):
            lines.status()
            lines.keep_stop_open()
            one.bench.controller.deploy()
            deadline = time.monotonic() + 30.0
            while one.bench.controller.under_way and time.monotonic() < deadline:
                time.sleep(0.01)
        one.socket.close()
        with pytest.raises(LineLost) as lost:
            lines.stop()  # its line was kept, too
        assert lost.value.ended
        with pytest.raises(LineLost) as lost:
            lines.status()
        assert lost.value.last is not None
        assert lost.value.last.state is State.DEPLOYED
        assert lost.value.last.at_rest
        lines.close()


def test_seeing_to_the_stop_s_line_keeps_no_stop_waiting() -> None:
    """Reproduced: once a second a stop stood behind the question how things are."""
    with served() as one:
        lines = Lines(one.socket.path)
        with stepping(one):
            lines.keep_stop_open()
        link = lines._stop._link
        lines.keep_stop_open()  # nobody answers now, and nobody is asked
        assert lines._stop._link is link
        for client in list(one.socket._clients.values()):
            one.socket._drop(client)
        opening = threading.Thread(target=lines.keep_stop_open)
        opening.start()
        time.sleep(0.1)
        assert lines._stop._turn.acquire(timeout=0.0)
        lines._stop._turn.release()
        with stepping(one):
            opening.join()
            assert lines._stop._link is not link
            assert lines.stop().took
        lines.close()
