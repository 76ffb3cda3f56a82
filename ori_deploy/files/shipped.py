"""Where the files are that come with the package."""

from __future__ import annotations

import sysconfig
from pathlib import Path


def shipped(name: str) -> Path:
    """A file of the examples: beside the package in a clone, under the prefix where installed."""
    clone = Path(__file__).parents[2] / "examples" / name
    return clone if clone.exists() else Path(sysconfig.get_path("data")) / "share" / "ori-deploy" / "examples" / name
