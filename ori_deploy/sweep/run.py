"""A sweep: jobs handed to a backend, rows kept as they come."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field

from ori_deploy.sweep.backends import Backend, Run, WorkerLost
from ori_deploy.sweep.grid import Job
from ori_deploy.sweep.job import FAILED, Row, run_job
from ori_deploy.sweep.store import Store

_POLL_S = 0.2

_WRITING = 20.0
"""Rows wait to be written for this many times as long as writing takes: a twentieth of the time goes into it."""

_LONGEST_S = 1.0
"""But no longer than this while writing is quick: what a killed sweep can lose."""


def _nothing(row: Row) -> None:
    del row


def _never() -> bool:
    return False


@dataclass
class Sweep:
    """A sweep under way.

    Attributes
    ----------
    store
        Where rows go, and what has been done already.
    backend
        Where jobs run.
    stop
        Looked at several times a second; once true, nothing is handed over any more and what is under
        way is dropped. It is done again when the sweep is resumed.
    tell
        Called with every row.
    run
        What makes a row of a job, a function that other processes can import.
    """

    store: Store
    backend: Backend
    stop: Callable[[], bool] = _never
    tell: Callable[[Row], None] = _nothing
    run: Run = run_job
    count: dict[str, int] = field(default_factory=dict)
    reused: int = 0
    lost_workers: int = 0
    stopped: bool = False
    _due: float = 0.0
    _spent_s: float = 0.0

    def carry_out(self, jobs: Iterable[Job]) -> None:
        """Run all jobs that the store has no row of.

        A worker that ends takes its jobs with it, not the rows that have come. Which job ended it is not
        known, so each is tried alone, and fails for good if that ends two workers in a row.

        Raises
        ------
        OriDeployError
            No job can come to its end any more; rows that have come are kept.
        """
        queue = self._new(jobs)
        pending: dict[Future[Row], Job] = {}
        suspects: list[Job] = []
        try:
            while not self._stopping():
                suspects += self._hand_over(queue, pending)
                if not pending and not suspects:
                    return  # before collecting: all that was handed over may come at once, and more be to do
                suspects += self._collect(pending)
                if suspects and (self.backend.breaks or not pending):
                    while pending and not self.stopped:  # a broken pool ends all it holds
                        suspects += self._collect(pending)
                    self._again(suspects)
                    suspects = []
                self._flush()
                self.backend.check()
        finally:
            self.backend.close()
            self.store.flush()

    def _new(self, jobs: Iterable[Job]) -> Iterator[Job]:
        done = self.store.finished()
        for job in jobs:
            if job.digest in done:
                self.reused += 1
            else:
                yield job

    def _hand_over(self, queue: Iterator[Job], pending: dict[Future[Row], Job]) -> list[Job]:
        """Fill the backend up; returns jobs that it did not take because a worker was lost."""
        while not self._stopping() and len(pending) < self.backend.width:
            job = next(queue, None)
            if job is None:
                break
            try:
                pending[self.backend.submit(self.run, job)] = job
            except WorkerLost:
                return [job]
        return []

    def _collect(self, pending: dict[Future[Row], Job]) -> list[Job]:
        """Keep the rows that have come; returns jobs that lost their worker."""
        if not pending:
            return []
        done, _ = wait(pending, timeout=_POLL_S, return_when=FIRST_COMPLETED)
        self._stopping()
        suspects = []
        for future in done:
            job = pending.pop(future)
            # A cluster that is restarted cancels what it had.
            row = None if future.cancelled() else self._row(self.backend, future, job)
            if row is None:
                suspects.append(job)
            else:
                self._keep(row)
        return suspects

    def _row(self, backend: Backend, future: Future[Row], job: Job) -> Row | None:
        """The row of a future that is done; None where a worker was lost."""
        error = future.exception()
        if error is None:
            return future.result()
        how = backend.lost(error)
        if how is None:
            return _failed(job, _told(error))
        self.lost_workers += 1
        return None

    def _again(self, suspects: list[Job]) -> None:
        """Each job alone, in a worker of its own: one that ends two of them is to blame."""
        for job in suspects:
            row = self._alone(job) or self._alone(job, last=True)
            if self.stopped:
                return
            if row is not None:
                self._keep(row)
                self._flush()
        self.backend = self.backend.renewed()

    def _alone(self, job: Job, *, last: bool = False) -> Row | None:
        """Row of a job that runs alone; None where it ended its worker, unless `last`, or the sweep was stopped."""
        backend = self.backend.renewed(workers=1)
        try:
            future = backend.submit(self.run, job)
            while not future.done():
                if self._stopping():
                    return None
                wait([future], timeout=_POLL_S)
                backend.check()
            if future.cancelled():
                return _failed(job, "cancelled by the cluster, twice") if last else None
            error = future.exception()
            if error is None:
                return future.result()
            how = backend.lost(error)
            if how is None:
                return _failed(job, _told(error))
            self.lost_workers += 1
            return _failed(job, f"{how}, twice") if last else None
        finally:
            if backend is not self.backend:
                backend.close()

    def _stopping(self) -> bool:
        self.stopped = self.stopped or self.stop()
        return self.stopped

    def _keep(self, row: Row) -> None:
        self.store.add(row)
        self.count[row["status"]] = self.count.get(row["status"], 0) + 1
        self.tell(row)

    def _flush(self) -> None:
        now = time.monotonic()
        if now >= self._due:
            self.store.flush()
            spent = time.monotonic() - now
            # One slow write (the first loads a library) says nothing of the next: two in a row do.
            self._due = now + max(_LONGEST_S, _WRITING * min(spent, self._spent_s))
            self._spent_s = spent


def _told(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"


def _failed(job: Job, error: str) -> Row:
    return {"job": job.digest, "status": FAILED, "error": " ".join(error.split()), **job.values}
