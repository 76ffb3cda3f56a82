"""What commands load before they do anything: nobody waits at the field for what is not used."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize("room", ["ori_deploy.cli.session", "ori_deploy.cli.serve", "ori_deploy.cli.operate"])
def test_commands_that_operate_do_not_load_what_designs_are_made_with(room: str) -> None:
    told = f"import {room}, sys; print(*(name for name in sys.modules if '.' in name))"
    loaded = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True).stdout.split()
    assert room in loaded
    assert not [name for name in loaded if name.startswith(("scipy.", "trimesh.", "matplotlib.", "mujoco."))]


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads of a process are counted in Linux's /proc")
@pytest.mark.parametrize(("asked", "threads"), [(None, 1), ("2", min(2, os.cpu_count() or 1))])
def test_linear_algebra_keeps_to_one_thread_unless_told_otherwise(asked: str | None, threads: int) -> None:
    told = (
        "from ori_deploy.cli import main; import numpy, os; a = numpy.ones((512, 512)); a @ a;"
        "print(len(os.listdir('/proc/self/task')))"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    if asked is not None:
        environment["OPENBLAS_NUM_THREADS"] = asked
    run = subprocess.run([sys.executable, "-c", told], env=environment, capture_output=True, text=True, check=True)
    assert int(run.stdout) == threads
