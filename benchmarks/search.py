"""What a local search costs.

Each line: processor time of one local search after warm-up, median of several runs, the target, their ratio
(below 1 is within it). Processor time is what a quiet machine would take: the searches run in one thread. The load
of the machine is told because its caches and clock are shared.
"""

from __future__ import annotations

import os
import platform
import statistics
import time
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ori_deploy.layout import Layout, make_layout, ring
from ori_deploy.profiles import Naca4, Profile, Superellipse
from ori_deploy.profiles.profile import Reals
from ori_deploy.search import Wish
from ori_deploy.search.problem import Problem, Values
from ori_deploy.search.sqp import minimise
from ori_deploy.search.starts import start_embedding

RUNS = 7
CLOSE = 1e-6
"""Of eta: how near the optimum a search has to come for its time to count."""


def ring_layout(n: int) -> Layout:
    """Cells round one inner vertex."""
    vertices, cells = ring(n)
    return make_layout(vertices, cells, [("P", "O1")])


@dataclass(frozen=True)
class Case:
    """One local search, and the seconds it may take."""

    what: str
    profile: Profile
    n: int
    wall_m: float
    start: int
    target_s: float | None


CASES = (
    Case("ellipse 1 x 0.6, n = 4, equal angles", Superellipse(1.0, 0.6), 4, 0.0, 0, None),
    Case("ellipse 1 x 0.6, n = 6, equal angles", Superellipse(1.0, 0.6), 6, 0.0, 0, 0.1),
    Case("ellipse 1 x 0.6, n = 24, equal angles", Superellipse(1.0, 0.6), 24, 0.0, 0, 1.5),
    Case("ellipse 1 x 0.6, n = 6, wall 0.02", Superellipse(1.0, 0.6), 6, 0.02, 0, None),
    Case("ellipse 1 x 0.6, n = 6, drawn start", Superellipse(1.0, 0.6), 6, 0.0, 2, None),
    Case("ellipse 1 x 0.4, n = 12, drawn start", Superellipse(1.0, 0.4), 12, 0.0, 3, None),
    Case("NACA 2412, n = 4, wall 0.006, margin 2 deg", Naca4("2412", 1.0), 4, 0.006, 0, None),
)


def timed(case: Case) -> tuple[float, float, int, float]:
    """Processor seconds of a whole search and until `CLOSE` to its optimum, iterations, eta."""
    trace: list[tuple[float, float, float]] = []
    begin = 0.0

    def watch(_: Reals, values: Values) -> None:
        trace.append((time.process_time() - begin, 1.0 / values.objective, values.violation))

    whole, near, iterations, eta = [], [], 0, 0.0
    for _ in range(RUNS + 1):  # the first warms up
        trace.clear()
        begin = time.process_time()
        problem = Problem(start_embedding(case.profile, ring_layout(case.n), case.start), case.wall_m, Wish())
        found = minimise(problem, watch=watch)
        whole.append(time.process_time() - begin)
        assert found is not None
        assert found.feasible
        iterations, eta = found.iterations, 1.0 / found.values.objective
        near.append(next((t for t, e, v in trace if abs(e - eta) <= CLOSE and v <= CLOSE), whole[-1]))
    return statistics.median(whole[1:]), statistics.median(near[1:]), iterations, eta


def main() -> None:
    """Print the table."""
    load = f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} processors"
    print(f"search: {platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}, load {load}")
    with threadpool_limits(1, user_api="blas"):
        for case in CASES:
            whole, near, iterations, eta = timed(case)
            ratio = (
                f"target {1e3 * case.target_s:6.4g} ms  ratio {near / case.target_s:5.2f}" if case.target_s else ""
            )
            print(
                f"{case.what:<44} eta {eta:9.6f}  {iterations:>3} steps  {1e3 * whole:7.4g} ms, "
                f"to within {CLOSE:g} {1e3 * near:7.4g} ms  {ratio}"
            )


if __name__ == "__main__":
    main()
