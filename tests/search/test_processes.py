"""Work in processes: interrupts keep what is done, a second one ends the wait, killed processes lose nothing."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from pathlib import Path

import pytest

from ori_deploy.search.processes import Processes

AGES = 600.0
"""Seconds no test would wait."""


def doubled(number: int) -> int:
    return 2 * number


def slept(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def begun_and_slept(work: tuple[float, Path | None]) -> float:
    """Leaves a mark before it sleeps."""
    seconds, mark = work
    if mark is not None:
        mark.touch()
    return slept(seconds)


def killed_at_first(place: tuple[Path, int]) -> int:
    """Ends its process the first time it is at the number 3."""
    folder, number = place
    mark = folder / "seen"
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def killed_always(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def refused(what: object, how: str) -> None:
    pytest.fail(f"{what} given up: {how}")


def nothing() -> None:
    pass


def test_all_is_carried_out() -> None:
    taken: list[int] = []
    Processes(doubled, 2, taken.append, refused, nothing).carry_out(range(20))
    assert sorted(taken) == list(range(0, 40, 2))


def test_no_more_is_drawn_than_is_under_way() -> None:
    drawn: list[int] = []
    taken: list[int] = []

    def take(one: int) -> None:
        taken.append(one)
        assert len(drawn) <= len(taken) + 4

    def work() -> object:
        for k in range(20):
            drawn.append(k)
            yield k

    Processes(doubled, 2, take, refused, nothing).carry_out(work())  # type: ignore[arg-type]
    assert len(taken) == 20


def test_what_was_with_a_killed_process_is_done_again(tmp_path: Path) -> None:
    taken: list[int] = []
    Processes(killed_at_first, 2, taken.append, refused, nothing).carry_out((tmp_path, k) for k in range(12))
    assert sorted(taken) == list(range(12))


def test_what_ends_two_processes_is_given_up_and_the_rest_is_done() -> None:
    taken: list[int] = []
    lost: list[tuple[int, str]] = []
    Processes(killed_always, 2, taken.append, lambda *one: lost.append(one), nothing).carry_out(range(12))
    assert sorted(taken) == [k for k in range(12) if k != 3]
    assert lost == [(3, "killed by signal 9")]


def test_an_interrupt_takes_what_finishes_soon(tmp_path: Path) -> None:
    begun, soon = tmp_path / "begun", 0.3
    taken: list[float] = []
    heard: list[str] = []

    def take(seconds: float) -> None:
        taken.append(seconds)
        if len(taken) == 1:
            while not begun.exists():  # what has not begun is not waited for
                time.sleep(0.001)
            os.kill(os.getpid(), signal.SIGINT)

    work = [(0.0, None), (soon, begun), *[(AGES, None)] * 50]
    with pytest.raises(KeyboardInterrupt):
        Processes(begun_and_slept, 2, take, refused, lambda: heard.append("stopping")).carry_out(work)
    assert sorted(taken) == [0.0, soon]
    assert heard == ["stopping"]


def test_a_second_interrupt_ends_it_and_keeps_what_is_done() -> None:
    taken: list[float] = []

    def take(seconds: float) -> None:
        taken.append(seconds)
        os.kill(os.getpid(), signal.SIGINT)

    def again() -> None:
        os.kill(os.getpid(), signal.SIGINT)

    before = set(multiprocessing.active_children())
    with pytest.raises(KeyboardInterrupt):
        Processes(slept, 2, take, refused, again).carry_out([0.0, *[AGES] * 50])
    assert taken == [0.0]
    for process in set(multiprocessing.active_children()) - before:
        while process.exitcode is None:  # not joined: the pool's thread does, and one of two learns it first
            time.sleep(0.01)
        assert process.exitcode == -signal.SIGTERM


def test_what_a_worker_raises_ends_it_all() -> None:
    with pytest.raises(TypeError):
        Processes(doubled, 2, lambda _: None, refused, nothing).carry_out([{}, *[1] * 20])  # type: ignore[list-item]
