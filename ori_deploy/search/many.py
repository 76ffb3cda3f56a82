"""Many local searches at once, over starts and layouts; what is found so far is never lost."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice

from ori_deploy.design import ConeStructure, Embedding
from ori_deploy.errors import CellError, InputError
from ori_deploy.layout import Layout
from ori_deploy.motion import Mechanism
from ori_deploy.profiles import Cone, Profile
from ori_deploy.search.solve import Solution, solve
from ori_deploy.search.wish import Wish


@dataclass(frozen=True)
class Job:
    """One local search, see `solve`; `name` says whose it is."""

    name: str
    profile: Profile | Cone
    layout: Layout
    wall_m: float
    wish: Wish
    start: int | Embedding
    seed: int = 0
    tolerance: float = 1e-9
    most_iterations: int = 120


@dataclass(frozen=True)
class Failure:
    """A local search that led nowhere, and why."""

    job: Job
    error: InputError


Result = tuple[Job, Solution] | Failure


def run_job(job: Job) -> Result:
    """Carry one job out. Pins that contradict each other are the caller's mistake and are raised."""
    try:
        found = solve(
            job.profile, job.layout, job.wall_m, job.wish, start=job.start, seed=job.seed,
            tolerance=job.tolerance, most_iterations=job.most_iterations,
        )  # fmt: skip
    except CellError as wrong:
        return Failure(job, wrong)
    return job, found


def run_jobs(
    jobs: Iterable[Job], *, workers: int = 1, watch: Callable[[Result], None] | None = None
) -> tuple[list[Result], bool]:
    """Carry jobs out.

    Parameters
    ----------
    jobs
        Drawn as workers get free.
    workers
        Processes; 1 works in this one.
    watch
        Told of every result as it comes.

    Returns
    -------
    What came out, and whether an interrupt (Ctrl-C) ended it early.

    Raises
    ------
    LayoutError
        A wish that no start can fulfil: unknown names, pins that contradict each other.
    """
    results: list[Result] = []

    def take(result: Result) -> None:
        results.append(result)
        if watch is not None:
            watch(result)

    try:
        if workers <= 1:
            for job in jobs:
                take(run_job(job))
        else:
            _in_processes(iter(jobs), workers, take)
    except KeyboardInterrupt:
        return results, True
    return results, False


def _in_processes(jobs: Iterable[Job], workers: int, take: Callable[[Result], None]) -> None:
    queue = iter(jobs)
    pool = ProcessPoolExecutor(workers, initializer=_leave_interrupts_to_the_parent)
    try:
        running: set[Future[Result]] = {pool.submit(run_job, job) for job in islice(queue, 2 * workers)}
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                take(future.result())
            running |= {pool.submit(run_job, job) for job in islice(queue, len(done))}
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def worth(solution: Solution, wish: Wish) -> float:
    """What a wish maximises."""
    if wish.objective == "eta":
        return solution.eta
    structure = solution.structure
    if isinstance(structure, ConeStructure):
        return structure.wall_rad / structure.profile.size
    if wish.objective == "wall":
        return structure.wall_m / structure.profile.size
    box = Mechanism(structure).stack_box_m
    return structure.profile.area / (box[0] * box[1])


def best_first(results: Sequence[Result]) -> list[tuple[Job, Solution]]:
    """Solutions, the best first; of several equal ones the earliest start."""
    found = [r for r in results if not isinstance(r, Failure)]
    return sorted(found, key=lambda r: (-round(worth(r[1], r[0].wish), 9), r[1].start))
