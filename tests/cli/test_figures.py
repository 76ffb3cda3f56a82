"""`ori-deploy figures` as a user meets it."""

from __future__ import annotations

import csv
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from ori_deploy.cli import main
from ori_deploy.cli.figure_sheets import MAKERS, Effort, Made, Steps
from ori_deploy.cli.figures import NAMES
from ori_deploy.figures import Table

SHEETS = {name: (name,) for name in NAMES} | {"fig5": ("fig5_section", "fig5_fold", "fig5_span")}
HEAD = '<g id="head">'
TABLES = {name: (name,) for name in NAMES} | {"fig5": ("fig5", "fig5_vertices")}


def run(*words: str | Path) -> Result:
    return CliRunner().invoke(main, ["figures", *(str(word) for word in words)])


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_every_name_has_a_maker() -> None:
    assert tuple(MAKERS) == NAMES


SLOW = ("walls",)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in NAMES if name != "fig3"],
)
def test_a_figure_is_written_as_pictures_and_data(name: str, tmp_path: Path) -> None:
    done = run("--out", tmp_path / "new" / "folder", "--quick", "--workers", "1", name)
    assert done.exit_code == 0, done.output
    folder = tmp_path / "new" / "folder"
    wanted = {f"{stem}.quick{ending}" for stem in SHEETS[name] for ending in (".png", ".svg")}
    wanted |= {f"{stem}.quick.csv" for stem in TABLES[name]}
    assert {path.name for path in folder.iterdir()} == wanted
    assert name in done.stdout
    for path in folder.iterdir():
        start = path.read_bytes()[:8]
        assert start == b"\x89PNG\r\n\x1a\n" if path.suffix == ".png" else start
        assert path.suffix != ".csv" or rows(path)


def test_the_csv_has_what_the_picture_shows(tmp_path: Path) -> None:
    done = run("--out", tmp_path, "--quick", "--workers", "1", "fig4c")
    assert done.exit_code == 0
    data = rows(tmp_path / "fig4c.quick.csv")
    svg = (tmp_path / "fig4c.quick.svg").read_text()
    for aspect in {row["aspect"] for row in data}:
        best = [row for row in data if row["aspect"] == aspect and row["best"] == "yes"]
        (drawn,) = re.findall(rf'<g id="eta-{float(aspect):g}-best">(.*?)</g>\s*</g>', svg, re.DOTALL)
        assert drawn.count("<use") == len({row["cells"] for row in best})


def test_figures_are_made_in_their_own_order_each_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    for name in NAMES:

        def make(effort: Effort, steps: Steps, name: str = name) -> Made:
            del effort, steps
            made.append(name)
            return Made("told", {name: Table(("a",), [(1,)])})

        monkeypatch.setitem(MAKERS, name, make)
    assert run("--out", tmp_path, "walls", "fig3", "walls").exit_code == 0
    assert made == ["fig3", "walls"]
    made.clear()
    assert run("--out", tmp_path).exit_code == 0
    assert made == list(NAMES)


def test_an_interrupt_keeps_what_is_finished_and_what_was_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = MAKERS["fig4c"]

    class Impatient:
        """Presses Ctrl-C after the first search."""

        def __init__(self, steps: Steps) -> None:
            self.expect = steps.expect
            self._steps = steps

        def step(self, result: object = None) -> None:
            del result
            signal.raise_signal(signal.SIGINT)
            self._steps.step()

    monkeypatch.setitem(MAKERS, "fig4c", lambda effort, steps: whole(effort, Impatient(steps)))
    done = run("--out", tmp_path, "--quick", "--workers", "1", "fig4a", "fig4c", "fig4d")
    assert done.exit_code == 130
    assert done.stderr.strip() == (
        f"interrupted: finished and kept: fig4a in {tmp_path}; of fig4c 1 searches in fig4c.quick.part.csv"
    )
    assert {p.name for p in tmp_path.iterdir()} == {
        "fig4a.quick.png", "fig4a.quick.svg", "fig4a.quick.csv", "fig4c.quick.part.csv",
    }  # fmt: skip
    assert len(rows(tmp_path / "fig4c.quick.part.csv")) == 1
    monkeypatch.undo()
    assert run("--out", tmp_path, "--quick", "--workers", "1", "fig4c").exit_code == 0
    assert not (tmp_path / "fig4c.quick.part.csv").exists()


def test_a_preview_leaves_the_real_figure_alone_and_says_what_it_is(tmp_path: Path) -> None:
    real = {}
    for words in ((), ("--quick",)):
        assert run("--out", tmp_path, *words, "fig4d").exit_code == 0
        real = real or {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert {path: path.read_bytes() for path in real} == real
    assert {p.name for p in tmp_path.iterdir()} == {
        f"fig4d{quick}.{ending}" for quick in ("", ".quick") for ending in ("png", "svg", "csv")
    }
    assert HEAD in (tmp_path / "fig4d.quick.svg").read_text()
    assert HEAD not in (tmp_path / "fig4d.svg").read_text()


@pytest.mark.slow
def test_ctrl_c_on_a_terminal_ends_workers_too(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "ori_deploy.cli",
            "figures",
            "--out",
            tmp_path / "f",
            "--workers",
            "2",
            "fig4a",
            "fig4c",
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not (tmp_path / "f" / "fig4a.svg").exists():  # the last file of the first figure: then comes the search
        assert process.poll() is None
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130, error
    assert error.startswith(f"interrupted: finished and kept: fig4a in {tmp_path / 'f'}")
    assert "Traceback" not in error
    assert not (tmp_path / "f" / "fig4c.png").exists()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("fig6",), "fig6"),
        (("fig3", "--workers", "0"), "workers"),
    ],
)
def test_bad_words_are_refused(words: tuple[str, ...], why: str, tmp_path: Path) -> None:
    done = run("--out", tmp_path, *words)
    assert done.exit_code == 2
    assert why in done.stderr


def test_a_folder_that_cannot_be_made_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = run("--out", tmp_path / "file" / "below")
    assert done.exit_code == 2
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert "--out" in done.stderr
