"""The suite's second try: only for a few, and never for what fails alone, too."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

RUN_SUITE = Path(__file__).parents[1] / "tools" / "run_suite.py"

PASSES_ALONE = """
import os
def test_passes_alone():
    assert "PYTEST_XDIST_WORKER" not in os.environ
"""
NEVER_PASSES = """
def test_never_passes():
    raise AssertionError
"""


def run(folder: Path, *tests: str) -> subprocess.CompletedProcess[str]:
    for number, test in enumerate(tests):
        (folder / f"test_{number}.py").write_text(test)
    command = [sys.executable, str(RUN_SUITE), "2", "not slow"]
    # This test may run in a suite itself.
    outside = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    return subprocess.run(command, cwd=folder, env=outside, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_what_passes_alone_is_passed_and_named(tmp_path: Path) -> None:
    done = run(tmp_path, PASSES_ALONE, "def test_good(): pass")
    assert done.returncode == 0
    assert done.stdout.splitlines()[-1] == "PASSED ONLY ALONE, look into it: test_0.py::test_passes_alone"
    assert "1 failed, 1 passed" in done.stdout


@pytest.mark.slow
def test_what_fails_alone_too_has_failed(tmp_path: Path) -> None:
    done = run(tmp_path, PASSES_ALONE, NEVER_PASSES)
    assert done.returncode == 1
    assert "PASSED ONLY ALONE" not in done.stdout


@pytest.mark.slow
def test_many_failures_get_no_second_try(tmp_path: Path) -> None:
    done = run(tmp_path, *[PASSES_ALONE] * 4)
    assert done.returncode == 1
    assert "now alone" not in done.stdout


@pytest.mark.slow
def test_what_could_not_be_run_gets_none_either(tmp_path: Path) -> None:
    done = run(tmp_path, "import nothing_of_this_name")
    assert done.returncode != 0
    assert "PASSED ONLY ALONE" not in done.stdout
