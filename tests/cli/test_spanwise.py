"""A span in segments, from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.inside import run

ROOT = Path(__file__).parents[2]
RIG = ROOT / "examples" / "rig_mock.toml"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("span")
    for words in (
        ("design", ROOT / "examples" / "wing_span_3.toml", "-o", "wing.design.json"),
        ("plan", "wing.design.json", "--rig", RIG, "-o", "wing.plan.json"),
    ):
        done = run(*words, cwd=folder)
        assert done.returncode == 0, done.stderr
        assert "3 segments" in done.stdout
        assert "stowed" in done.stdout
    return folder


@pytest.mark.slow
def test_deploy_waits_for_the_word_and_stow_gives_it(made: Path) -> None:
    refused = run("deploy", "wing.plan.json", "--rig", RIG, "--log", "none.mcap", cwd=made)
    assert refused.returncode == 3
    assert len(refused.stderr.strip().splitlines()) == 1
    assert "span may still be folded" in refused.stderr
    assert "--span-unfolded" in refused.stderr
    assert not list(made.glob("none.mcap*"))
    done = run("deploy", "wing.plan.json", "--rig", RIG, "--span-unfolded", "--log", "run.mcap", cwd=made)
    assert done.returncode == 0, done.stderr
    assert "state deployed" in done.stdout
    assert "span can be folded" not in done.stdout
    page = made / "run.html"
    words = ("report", "run.mcap", "--design", "wing.design.json", "--plan", "wing.plan.json", "-o", page)
    assert run(*words, cwd=made).returncode == 0
    assert "Span in segments" in page.read_text()
    assert 'id="title-span"' in page.read_text()
    done = run("stow", "wing.plan.json", "--rig", RIG, cwd=made)
    assert done.returncode == 0, done.stderr
    assert "the span can be folded now, by hand, at hinges h1, h2" in done.stdout


@pytest.mark.slow
def test_poses_of_all_segments(made: Path) -> None:
    done = run("poses", "wing.design.json", "--fold", "0", "--span-fold", "1", "--json", cwd=made)
    panels = json.loads(done.stdout)
    assert len(panels) == 48
    assert [panel["segment"] for panel in panels[::16]] == [1, 2, 3]
    matrices = np.array([panel["transform"] for panel in panels])
    assert matrices.shape == (48, 4, 4)
    assert matrices[:, :3, :3] @ matrices[:, :3, :3].transpose(0, 2, 1) == pytest.approx(
        np.broadcast_to(np.eye(3), (48, 3, 3)), abs=1e-12
    )
    table = run("poses", "wing.design.json", "--fold", "0", "--span-fold", "0.5", cwd=made)
    assert table.stdout.splitlines()[1].startswith("segment 2   turned   90.000 deg")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--fold", "0.2", "--span-fold", "0.5"), "unfold the span first"),
        (("--fold", "0", "--span-fold", "1.5"), "--span-fold"),
        (("--fold", "0", "--span-fold", "nan"), "--span-fold"),
    ],
)
def test_bad_poses_are_told_in_one_line(made: Path, words: tuple[str, ...], message: str) -> None:
    done = run("poses", "wing.design.json", *words, cwd=made)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_span_in_one_piece_has_no_span_poses(tmp_path: Path) -> None:
    assert run("design", ROOT / "examples" / "ellipse_4.toml", "-o", "e.design.json", cwd=tmp_path).returncode == 0
    done = run("poses", "e.design.json", "--fold", "0", "--span-fold", "1", cwd=tmp_path)
    assert done.returncode == 2
    assert "in one piece" in done.stderr
