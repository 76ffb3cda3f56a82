"""Many searches: the same in processes as in one, and nothing lost when they are interrupted."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest

from ori_deploy.errors import CellError, InputError, LayoutError
from ori_deploy.search import Failure, Fixed, Job, Wish, best_first, closest, run_jobs
from ori_deploy.search.many import Result, worth
from ori_deploy.search.shortfall import NoStructureError
from ori_deploy.search.wish import UnmetPinError
from tests.search.cases import ELLIPSE, ring_layout


def jobs(n: int, wall_m: float = 0.01) -> list[Job]:
    return [Job(f"job {k}", ELLIPSE, ring_layout(4), wall_m, Wish(), k, seed=5) for k in range(n)]


def names(results: list[Result]) -> list[str]:
    return [r.job.name if isinstance(r, Failure) else r[0].name for r in results]


def test_workers_find_what_this_process_finds() -> None:
    here, there = run_jobs(jobs(4)), run_jobs(jobs(4), workers=2)
    assert not here[1]
    assert not there[1]
    assert names(here[0]) == [f"job {k}" for k in range(4)]
    assert sorted(names(there[0])) == names(here[0])
    by_name = {job.name: found for job, found in best_first(there[0])}
    for job, found in best_first(here[0]):
        assert np.array_equal(found.structure.embedding.z, by_name[job.name].structure.embedding.z)
        assert found.eta == by_name[job.name].eta
    assert [j.name for j, _ in best_first(here[0])] == [j.name for j, _ in best_first(there[0])]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_interrupt_keeps_what_is_done(workers: int) -> None:
    seen: list[Result] = []

    def watch(result: Result) -> None:
        seen.append(result)
        if len(seen) == 2:
            os.kill(os.getpid(), signal.SIGINT)

    results, interrupted = run_jobs(jobs(30), workers=workers, watch=watch)
    assert interrupted
    assert 2 <= len(results) < 30
    assert len(best_first(results)) == len(results)


def test_failures_say_why_and_do_not_stop_the_rest() -> None:
    mixed = [*jobs(1), *jobs(2, wall_m=0.5), *jobs(1)]
    results, interrupted = run_jobs(mixed)
    assert not interrupted
    failed = [r for r in results if isinstance(r, Failure)]
    assert len(failed) == 2
    assert len(best_first(results)) == 2
    for failure in failed:
        assert "no structure meets every condition" in str(failure.error)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_wish_nobody_can_fulfil_is_raised_at_once(workers: int) -> None:
    told: list[Result] = []
    bad = [Job("bad", ELLIPSE, ring_layout(4), 0.01, Wish(pins=(Fixed("nobody"),)), k) for k in range(4)]
    with pytest.raises(LayoutError, match="unknown vertex"):
        run_jobs(bad, workers=workers, watch=told.append)
    assert not told


def test_the_best_comes_first() -> None:
    results, _ = run_jobs(jobs(5))
    ranked = best_first(results)
    values = [worth(found, job.wish) for job, found in ranked]
    assert values == sorted(values, reverse=True) or np.ptp(values) < 1e-9
    assert values[0] == pytest.approx(max(r[1].eta for r in results if not isinstance(r, Failure)), abs=1e-9)


def test_pins_that_hold_from_no_start_are_failures_of_each() -> None:
    pins = (Fixed("P", 0.1 + 0j), Fixed("P", -0.1 + 0j))
    results, _ = run_jobs([Job("apart", ELLIPSE, ring_layout(4), 0.01, Wish(pins=pins), k) for k in range(3)])
    errors = [r.error for r in results if isinstance(r, Failure)]
    assert len(errors) == 3
    assert all(isinstance(e, UnmetPinError) and "fixed P" in str(e) for e in errors)


def test_the_failure_that_came_closest_speaks_for_all() -> None:
    (job,) = jobs(1)
    near, far, pin = NoStructureError("near"), NoStructureError("far"), UnmetPinError("pin")
    near.short, far.short = 0.1, 2.0
    errors: list[InputError] = [InputError("killed"), pin, CellError("built, but"), far, near]
    for k in range(len(errors), 0, -1):
        assert closest([Failure(job, e) for e in errors[:k]]) is errors[k - 1]
