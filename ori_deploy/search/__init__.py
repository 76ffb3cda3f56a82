"""Search: the best structure for a wish, by many local searches with exact derivatives."""

from __future__ import annotations

from ori_deploy.search.many import Failure, Job, best_first, closest, run_jobs
from ori_deploy.search.solve import Solution, solve
from ori_deploy.search.wish import Fixed, OnLine, Pin, Spar, Symmetric, Wish

__all__ = [
    "Failure",
    "Fixed",
    "Job",
    "OnLine",
    "Pin",
    "Solution",
    "Spar",
    "Symmetric",
    "Wish",
    "best_first",
    "closest",
    "run_jobs",
    "solve",
]
