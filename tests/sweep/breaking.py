"""Jobs that break, by what their specification's name says. Other processes import this."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from ori_deploy.sweep.grid import Job
from ori_deploy.sweep.job import Row, run_job


def breaking(job: Job) -> Row:
    """`run_job`, but for walls that stand for mishaps (metres): see `tests/sweep/test_sweep.py`."""
    wall = job.values["structure.wall_m"]
    if wall == 0.0011:
        os._exit(3)
    if wall == 0.0012:
        os.kill(os.getpid(), signal.SIGKILL)
    if wall == 0.0013:
        raise RuntimeError("a fault in the program\nover two lines")
    if wall == 0.0014:  # breaks once, as by a passing shortage of memory
        mark = Path(os.environ["ORI_DEPLOY_TEST_MARK"])
        if not mark.exists():
            mark.touch()
            os._exit(4)
    if wall == 0.0015:
        time.sleep(600.0)
    return run_job(job)
