"""Many local searches at once, over starts and layouts; what is found so far is never lost."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from ori_deploy.design import ConeStructure, Embedding
from ori_deploy.errors import CellError, InputError
from ori_deploy.layout import Layout
from ori_deploy.motion import Mechanism
from ori_deploy.profiles import Cone, Profile
from ori_deploy.search.processes import Processes
from ori_deploy.search.shortfall import NoStructureError
from ori_deploy.search.solve import Solution, solve
from ori_deploy.search.wish import UnmetPinError, Wish


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
    """Carry one job out. What no start can fulfil is the caller's mistake and is raised."""
    try:
        found = solve(
            job.profile, job.layout, job.wall_m, job.wish, start=job.start, seed=job.seed,
            tolerance=job.tolerance, most_iterations=job.most_iterations,
        )  # fmt: skip
    except (CellError, UnmetPinError) as wrong:
        return Failure(job, wrong)
    return job, found


def run_jobs(
    jobs: Iterable[Job],
    *,
    workers: int = 1,
    watch: Callable[[Result], None] | None = None,
    stopping: Callable[[], None] | None = None,
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
    stopping
        Called once when an interrupt is heard and processes are given a few seconds to finish; a second
        interrupt ends them at once.

    Returns
    -------
    What came out, and whether an interrupt (Ctrl-C) ended it early. A job whose process ended, killed or
    out of memory, is tried once more in a process of its own, and is then a failure.

    Raises
    ------
    LayoutError
        A wish that no start can fulfil, such as unknown names.
    """
    results: list[Result] = []

    def take(result: Result) -> None:
        results.append(result)
        if watch is not None:
            watch(result)

    def give_up(job: Job, how: str) -> None:
        take(Failure(job, _lost(job, how)))

    try:
        if workers <= 1:
            for job in jobs:
                take(run_job(job))
        else:
            Processes(run_job, workers, take, give_up, stopping or _nothing).carry_out(jobs)
    except KeyboardInterrupt:
        return results, True
    return results, False


def _nothing() -> None:
    pass


def _lost(job: Job, how: str) -> InputError:
    return InputError(
        f"{job.name}: the process that searched ended, twice", value=how,
        remedy="if memory ran short (signal 9), fewer --workers or cells",
    )  # fmt: skip


def closest(failures: Sequence[Failure]) -> InputError:
    """The error of the failure that came closest to a structure.

    A search that missed its conditions by a little says more than one that could not begin, and both more
    than pins that did not hold from one start or a process that was killed.
    """

    def rank(failure: Failure) -> tuple[int, float]:
        error = failure.error
        if isinstance(error, NoStructureError):
            return (-1 if error.of_eta else 0), error.short
        if isinstance(error, UnmetPinError):
            return 2, error.off_m
        return (1, 0.0) if isinstance(error, CellError) else (3, 0.0)

    return min(failures, key=rank).error


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
