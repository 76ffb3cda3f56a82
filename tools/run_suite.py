"""Run the tests that have a mark, several at a time; then the few that failed once more, alone.

There are more workers than processors, and in a third of the tests motions run in real time: now and then a machine
stands still for longer than a motion may, and the controller rightly says so. What a change broke fails alone, too.
What passes only alone is named at the end, for somebody to look into: it may be a race.

Usage: run_suite.py WORKERS MARKS
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

AT_MOST = 3
"""More than these is no hiccup of a machine."""

FAILED = Path(".pytest_cache/v/cache/lastfailed")
SOME_FAILED = 1


def main(workers: str, marks: str) -> int:
    """Exit status for make."""
    pytest = [sys.executable, "-m", "pytest", "-q", "-m", marks]
    FAILED.unlink(missing_ok=True)
    status = subprocess.run([*pytest, "-n", workers, "--dist", "worksteal"], check=False).returncode
    if status != SOME_FAILED or not FAILED.exists():
        return status
    failed = sorted(json.loads(FAILED.read_text()))
    if len(failed) > AT_MOST:
        return status
    print(f"\nFAILED beside others, now alone: {', '.join(failed)}", flush=True)
    status = subprocess.run([*pytest, "--last-failed"], check=False).returncode
    if status == 0:
        print(f"\nPASSED ONLY ALONE, look into it: {', '.join(failed)}", flush=True)
    return status


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
