"""Local searches in worker processes: stopped when asked, and none lost when a worker is killed."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from multiprocessing.process import BaseProcess
from typing import Generic, TypeVar

Work = TypeVar("Work")
Made = TypeVar("Made")

_PATIENCE_S = 3.0
"""How long an interrupt waits for work under way that may be about to finish."""

_LOOK_UP_S = 0.5
"""How often a wait looks up: an interrupt that another thread was woken by is only noticed then."""

_ENDED_WITHIN_S = 5.0
"""How long a broken pool takes at most to end the workers it has left."""


class Processes(Generic[Work, Made]):
    """Carries work out in processes.

    Parameters
    ----------
    run
        What to do; a function of a module, so that it can be sent.
    workers
        How many processes.
    take
        Given every result as it comes.
    give_up
        Given work whose process ended twice, the second time with nothing else in it, and how it ended.
    stopping
        Called at the first interrupt, before what is under way is waited for.
    """

    def __init__(
        self,
        run: Callable[[Work], Made],
        workers: int,
        take: Callable[[Made], None],
        give_up: Callable[[Work, str], None],
        stopping: Callable[[], None],
    ) -> None:
        self._run, self._workers, self._take = run, workers, take
        self._give_up, self._stopping = give_up, stopping

    def carry_out(self, work: Iterable[Work]) -> None:
        """Carry all of it out.

        Raises
        ------
        KeyboardInterrupt
            When interrupted; what was finished by then, or within a few seconds, has been taken. A second
            interrupt ends the wait.
        """
        queue = iter(work)
        while lost := self._in_one_pool(queue, self._workers)[0]:
            for one in lost:
                again, how = self._in_one_pool(iter([one]), 1)
                for still in again:
                    self._give_up(still, how)

    def _in_one_pool(self, queue: Iterator[Work], workers: int) -> tuple[list[Work], str]:
        """Work from a queue until that is empty or a process ends; then what was under way, and how it ended."""
        others = set(multiprocessing.active_children())
        pool = ProcessPoolExecutor(workers, initializer=_leave_interrupts_to_the_parent)
        running: dict[Future[Made], Work] = {}
        lost: list[Work] = []
        ours: set[BaseProcess] = set()
        finished = False
        try:
            while True:
                for one in islice(queue, 2 * workers - len(running)):
                    with _interrupts_held():
                        try:
                            running[pool.submit(self._run, one)] = one
                        except BrokenProcessPool:
                            lost.append(one)
                    if lost:
                        break
                ours |= set(multiprocessing.active_children()) - others
                if not running:
                    break
                done, _ = wait(running, timeout=_LOOK_UP_S, return_when=FIRST_COMPLETED)
                lost += self._taken(done, running)
                if lost:
                    while wait(running, timeout=_LOOK_UP_S).not_done:
                        pass
                    lost += self._taken(set(running), running)
                    break
            finished = True
            return lost, _how(ours) if lost else ""
        except KeyboardInterrupt:
            self._last_ones(running)
            raise
        finally:
            with _interrupts_held():
                if not finished:
                    for process in ours | set(multiprocessing.active_children()) - others:
                        process.terminate()
                pool.shutdown(wait=finished, cancel_futures=True)

    def _taken(self, done: set[Future[Made]], running: dict[Future[Made], Work]) -> list[Work]:
        """Take what is done; returns what was lost with its process."""
        lost: list[Work] = []
        for future in done:
            try:
                made = future.result()
            except CancelledError:
                del running[future]
            except BrokenProcessPool:
                lost.append(running.pop(future))
            else:
                with _interrupts_held():  # taken and crossed off, or neither
                    del running[future]
                    self._take(made)
        return lost

    def _last_ones(self, running: dict[Future[Made], Work]) -> None:
        """What finishes soon after an interrupt; even if another one comes, what has finished."""
        try:
            self._stopping()
            for future in running:
                future.cancel()
            until = time.monotonic() + _PATIENCE_S
            while pending := {future for future in running if not future.done()}:
                left = until - time.monotonic()
                if left <= 0.0:
                    break
                wait(pending, timeout=left, return_when=FIRST_COMPLETED)
        finally:
            with _interrupts_held():
                self._taken({future for future in running if future.done()}, running)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Interrupts wait until this is over, and never reach processes begun meanwhile."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A handler of the command line's, inherited, would end a worker with a traceback.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _how(ours: set[BaseProcess]) -> str:
    """How processes ended, but for those that the pool itself ended after the first."""
    until = time.monotonic() + _ENDED_WITHIN_S
    while any(process.exitcode is None for process in ours) and time.monotonic() < until:
        time.sleep(0.01)
    codes = {process.exitcode for process in ours} - {None, 0, -signal.SIGTERM}
    ends = [f"killed by signal {-code}" if code < 0 else f"exit status {code}" for code in codes if code is not None]
    return ", ".join(sorted(ends)) or "cause unknown"
