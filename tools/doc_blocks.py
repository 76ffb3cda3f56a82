"""Blocks of code in a page, and running those of a shell: what a page shows is what is tested and drawn."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

_FENCE = re.compile(r"^```([\w-]+)[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def blocks(page: Path, language: str) -> list[str]:
    """The page's blocks in a language, in order."""
    return [text for name, text in _FENCE.findall(page.read_text()) if name == language]


def run_shell(block: str, folder: Path) -> str:
    """Run a block in a folder with this interpreter's programs first on the path; its output.

    Raises
    ------
    AssertionError
        A command failed; with what it said.
    """
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block],
        cwd=folder,
        env={**os.environ, "PATH": path, "COLUMNS": "100"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise AssertionError(f"{block}\n{done.stdout}{done.stderr}")
    return done.stdout
