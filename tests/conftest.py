"""A runtime folder of a test's own, with a name short enough for a socket."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from ori_deploy import runtime_dir


@pytest.fixture
def runtime_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where sockets and locks go; nothing of other programs on this machine is seen."""
    made = Path(tempfile.mkdtemp(prefix="od-"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(made))
    monkeypatch.setattr(runtime_dir, "FALLBACK", made / "tmp")
    monkeypatch.setattr(runtime_dir, "RUN_USER", made / "run")
    yield made / runtime_dir.NAME
    shutil.rmtree(made)
