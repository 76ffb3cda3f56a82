"""The command line in this process: loading it takes a second, and most tests ask about what it does then."""

from __future__ import annotations

import contextlib
import subprocess
from pathlib import Path

from click.testing import CliRunner

from ori_deploy.cli import main


def run(*words: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """What the same words would have done in a process of their own; an exception that escapes is raised."""
    given = [str(word) for word in words]
    with contextlib.chdir(cwd):
        done = CliRunner().invoke(main, given, prog_name="ori-deploy", catch_exceptions=False)
    return subprocess.CompletedProcess(given, done.exit_code, done.stdout, done.stderr)
