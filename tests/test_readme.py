"""What the README and the package's docstring show is what happens."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import numpy as np
import pytest

import ori_deploy
from ori_deploy.files import build_from_file
from ori_deploy.motion import Interference, Mechanism

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def test_five_line_example_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    block = re.search(r"```python\n(.*?)```", README, re.DOTALL)
    assert block is not None
    names: dict[str, object] = {}
    exec(block.group(1), names)
    assert "eta 2.1311" in capsys.readouterr().out
    assert names["half_open"].shape == (1, 16, 3, 3)  # type: ignore[attr-defined]


def test_docstring_of_the_package_is_true(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    result = doctest.testmod(ori_deploy)
    assert result.attempted >= 5
    assert result.failed == 0


def test_readme_fits_a_screen_and_shows_the_fold_early() -> None:
    lines = README.splitlines()
    assert len(lines) < 50
    assert any("(docs/pictures/fold.gif)" in line for line in lines[:15])
    assert (ROOT / "docs" / "pictures" / "fold.gif").stat().st_size > 10_000


def test_every_place_that_the_rooms_name_is_there_and_every_room_is_named() -> None:
    rooms = (ROOT / "docs" / "rooms.md").read_text()
    named = set(re.findall(r"`((?:examples|ori_deploy|tests|sim_backends|firmware|docs|tools)/[\w/.]*)`", rooms))
    assert len(named) > 40
    for name in named:
        assert (ROOT / name).exists(), name
    for folder in sorted((ROOT / "ori_deploy").iterdir()):
        if (folder / "__init__.py").exists():
            assert f"ori_deploy/{folder.name}/" in rooms, folder.name


def test_example_of_the_specification_page_builds_and_deploys_free(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "specification.md").read_text()
    block = re.search(r"```toml\n(.*?)```", page, re.DOTALL)
    assert block is not None
    (tmp_path / "five.toml").write_text(block.group(1))
    _, built = build_from_file(tmp_path / "five.toml")
    assert built.layout.n_cells == 5
    assert Interference(Mechanism(built)).first_collision(np.linspace(0.0, 1.0, 201)) is None
