"""Where jobs run: processes of this machine, or a Dask cluster. Both through `concurrent.futures`."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from typing import Any, Protocol

from ori_deploy.errors import InputError, OriDeployError
from ori_deploy.sweep.grid import Job
from ori_deploy.sweep.job import Row

_ENDED_WITHIN_S = 5.0
"""How long a broken pool takes at most to end the workers it has left."""

_DESERTED_S = 60.0
"""How long a cluster may be without a worker: nannies take some seconds to start one again."""

Run = Callable[[Job], Row]


class WorkerLost(OriDeployError):
    """A worker ended while it had work; the work may be what ended it."""


class Backend(Protocol):
    """Something that runs jobs."""

    @property
    def width(self) -> int:
        """How many jobs to hand over at a time: enough to keep every worker busy, few enough to stop soon."""

    @property
    def breaks(self) -> bool:
        """Whether losing one worker loses all, and all jobs under way have to be handed over again."""

    def submit(self, run: Run, job: Job) -> Future[Row]:
        """Hand a job over. Raises `WorkerLost` where that cannot be done any more."""

    def lost(self, error: BaseException) -> str | None:
        """Whether an error of a future says that a worker ended, and how; None where the job itself failed."""

    def renewed(self, workers: int | None = None) -> Backend:
        """A backend of the same kind with all its workers, or `workers` of them, in place of this one."""

    def check(self) -> None:
        """Raise `OriDeployError` where no job can come to its end any more."""

    def close(self) -> None:
        """Drop everything under way, at once."""


def _begin() -> None:
    """In a worker: leave signals to the parent, and end with it even if it was killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: BaseProcess) -> None:
    wait([parent.sentinel])
    os._exit(1)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Processes that begin here never get an interrupt, not even while they are still loading."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Processes:
    """Worker processes of this machine.

    Parameters
    ----------
    workers
        How many; one per processor where left out.
    """

    def __init__(self, workers: int | None = None) -> None:
        self.workers = workers or len(os.sched_getaffinity(0))
        self._others = set(multiprocessing.active_children())
        self._ours: set[BaseProcess] = set()
        # Spawned, not forked: workers take no locks, files or threads along.
        context = multiprocessing.get_context("spawn")
        self._pool: Executor = ProcessPoolExecutor(self.workers, context, initializer=_begin)

    @property
    def breaks(self) -> bool:
        return True

    @property
    def width(self) -> int:
        return 2 * self.workers

    def submit(self, run: Run, job: Job) -> Future[Row]:
        try:
            with _interrupts_held():
                future = self._pool.submit(run, job)
        except BrokenProcessPool as broken:
            raise WorkerLost(self._how()) from broken
        self._ours |= set(multiprocessing.active_children()) - self._others
        return future

    def lost(self, error: BaseException) -> str | None:
        return self._how() if isinstance(error, BrokenProcessPool) else None

    def _how(self) -> str:
        """How workers ended, but for those that the pool itself ended after the first."""
        # Waiting for them is of no use: the pool's own thread does, and only one of two learns how a process ended.
        patience = time.monotonic() + _ENDED_WITHIN_S
        while any(process.exitcode is None for process in self._ours) and time.monotonic() < patience:
            time.sleep(0.01)
        codes = {process.exitcode for process in self._ours} - {None, 0, -signal.SIGTERM}
        ends = [
            f"killed by signal {-code}" if code < 0 else f"exit status {code}" for code in codes if code is not None
        ]
        return f"worker process ended: {', '.join(sorted(ends)) or 'cause unknown'}"

    def renewed(self, workers: int | None = None) -> Processes:
        self.close()
        return Processes(workers or self.workers)

    def check(self) -> None:
        """Nothing: a pool that breaks says so."""

    def close(self) -> None:
        for process in self._ours:
            if process.is_alive():
                process.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)


class Cluster:
    """A Dask cluster.

    Parameters
    ----------
    address
        Of its scheduler, such as "tcp://10.0.0.5:8786".
    within_s
        How long to wait for it, and for its first worker.

    Raises
    ------
    InputError
        The extra is missing, or there is no scheduler or no worker there.
    """

    def __init__(self, address: str, within_s: float = 10.0) -> None:
        try:
            import distributed
        except ImportError as missing:
            raise InputError(
                "--dask: dask.distributed is not installed",
                limit="the extra `cluster`",
                remedy="pip install -e '.[cluster]'",
            ) from missing
        room: Any = distributed
        self.address = address
        try:
            self._client: Any = room.Client(address, timeout=within_s, set_as_default=False)
        except (OSError, TimeoutError, ValueError, TypeError) as wrong:
            raise InputError(
                "--dask: no scheduler answers", value=address, limit="tcp://host:port", remedy="check the address"
            ) from wrong
        try:
            self._client.wait_for_workers(1, timeout=within_s)
        except TimeoutError as wrong:
            self._client.close()
            raise InputError(
                "--dask: the scheduler has no worker", value=address, limit="one or more", remedy="start workers"
            ) from wrong
        self._pool: Executor = self._client.get_executor(pure=False)
        self._seen = time.monotonic()

    @property
    def breaks(self) -> bool:
        return (
            False  # the scheduler hands jobs over again by itself, and gives up on those that end workers too often
        )

    @property
    def width(self) -> int:
        return 2 * max(sum(map(int, self._client.ncores().values())), 1)

    def submit(self, run: Run, job: Job) -> Future[Row]:
        return self._pool.submit(run, job)

    def lost(self, error: BaseException) -> str | None:
        # Killed workers, lost connections and cancelled futures: the cluster's own errors, not the job's.
        theirs = type(error).__module__.partition(".")[0] == "distributed"
        return f"workers ended: {type(error).__name__}: {error}" if theirs else None

    def renewed(self, workers: int | None = None) -> Cluster:
        del workers
        return self

    def check(self) -> None:
        """Raise when the cluster has had no scheduler or no worker for `_DESERTED_S`."""
        now = time.monotonic()
        if self._client.status == "running" and self._client.scheduler_info(n_workers=1)["workers"]:
            self._seen = now
        elif now > self._seen + _DESERTED_S:
            raise OriDeployError(f"the cluster at {self.address} has no workers left")

    def close(self) -> None:
        self._pool.shutdown(wait=False)  # cancels what has not begun
        self._client.close()
