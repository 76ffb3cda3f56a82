"""The tutorial runs from an empty folder, its pictures show something, and the site builds without a warning."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ori_deploy.view import to_png
from tools.doc_blocks import blocks, run_shell
from tools.doc_figures import FIGURES
from tools.make_doc_pictures import DOCS, TUTORIAL, tutorial_pictures

ROOT = Path(__file__).parents[2]


def shows_something(data: bytes) -> bool:
    """Whether a picture is more than paper."""
    dots = np.asarray(Image.open(io.BytesIO(data)).convert("L"))
    return bool(min(dots.shape) > 200 and (dots < 200).mean() > 0.005)


@pytest.mark.slow
def test_the_tutorial_runs_and_its_pictures_show_what_came_of_it() -> None:
    made = tutorial_pictures()
    assert list(made) == list(TUTORIAL)
    assert all(shows_something(data) for data in made.values())
    moving = Image.open(io.BytesIO(made["tutorial-fold.gif"]))
    assert moving.n_frames > 50  # type: ignore[attr-defined]
    assert len(made["tutorial-fold.gif"]) < 1_500_000


def test_a_command_that_fails_is_told_with_what_it_said(tmp_path: Path) -> None:
    assert run_shell("echo out && pwd", tmp_path).split() == ["out", str(tmp_path)]
    with pytest.raises(AssertionError, match=r"false-name[\s\S]*cannot be read"):
        run_shell("ori-deploy design false-name.toml\necho not reached", tmp_path)


def test_the_tutorial_is_written_for_an_empty_folder() -> None:
    written: set[str] = set()
    for block in blocks(DOCS / "tutorial.md", "sh"):
        used = set(re.findall(r"(?<= )[\w.]+\.(?:toml|json|mcap)\b", block)) - set(re.findall(r"> (\S+) <<", block))
        written |= set(re.findall(r"(?:-o|--save-spec|--log|>) (\S+)", block))
        written |= {f"{name}.design.json" for name in re.findall(r"design (\w+)\.toml", block)}
        written |= {f"{name}.plan.json" for name in re.findall(r"plan (\w+)\.design", block)}
        assert used <= written, block


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(FIGURES))
def test_figures_of_the_mathematics_show_something(name: str) -> None:
    assert shows_something(to_png(FIGURES[name](), 100.0))


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_asks_the_net_for_nothing(tmp_path: Path) -> None:
    env = {**os.environ, "ORI_DOCS_WITHOUT_PICTURES": "1", "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", tmp_path / "site"]
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "site" / "mathematics.html").read_text()
    assert page.count("<math") > 50
    assert "arithmatex" in page
    assert r"\frac" not in re.sub(r"<annotation.*?</annotation>", "", page)
    assert "fonts.googleapis" not in page
    assert "Interference" in (tmp_path / "site" / "api" / "motion.html").read_text()
    assert (tmp_path / "site" / "source" / "examples" / "mavlink.toml").exists()
