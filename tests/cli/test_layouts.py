"""`ori-deploy layouts` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from ori_deploy.cli.commands import main
from ori_deploy.layout import PlaneTree, Vertex, make_layout
from tests.files.test_graph_file import EDGES, GRAPH, toml


def run(*words: str | Path) -> Result:
    return CliRunner().invoke(main, ["layouts", *(str(w) for w in words)])


@pytest.fixture
def graph(tmp_path: Path) -> Path:
    path = tmp_path / "ring.toml"
    path.write_text(toml(GRAPH))
    return path


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--cells", "1"), {"cells": 1, "total": 1, "by_inner": {"0": 1}}),
        (("--cells", "6"), {"cells": 6, "total": 154, "by_inner": {"0": 108, "1": 42, "2": 4}}),
        (("--cells", "5", "--mirror-apart"), {"cells": 5, "total": 64, "by_inner": {"0": 49, "1": 14, "2": 1}}),
        (("--cells", "6", "--inner", "1"), {"cells": 6, "total": 42, "by_inner": {"1": 42}}),
        (("--cells", "4", "--inner", "3"), {"cells": 4, "total": 0, "by_inner": {"3": 0}}),
        (("--cells", "6", "--foldable"), {"cells": 6, "total": 24, "by_inner": {"0": 10, "1": 11, "2": 3}}),
    ],
)
def test_counts(words: tuple[str, ...], told: dict[str, object]) -> None:
    done = run(*words, "--count", "--json")
    assert done.exit_code == 0
    assert json.loads(done.stdout) == told
    plain = run(*words, "--count")
    assert plain.stdout.startswith(f"{told['total']} layout")


def test_json_holds_layouts_that_can_be_made() -> None:
    found = json.loads(run("--cells", "5", "--json").stdout)
    assert len({entry["code"] for entry in found}) == 38
    for entry in found:
        tree = PlaneTree.from_code(entry["code"])
        assert entry["inner"] == tree.n_inner
        vertices = [Vertex(**v) for v in entry["vertices"]]
        for slits in entry["slits"]:
            assert not make_layout(vertices, entry["cells"], slits).overfull_vertices
        assert entry["slit_choices"] >= len(entry["slits"])
        assert entry["symmetry_order"] in (entry["rotations"], 2 * entry["rotations"])


def test_a_line_per_layout() -> None:
    lines = run("--cells", "4").stdout.splitlines()
    assert len(lines) == 9
    assert "14141414                 1 inner   symmetry 8    folds flat, 1 of 1 slit choices" in lines
    assert any("cannot fold flat" in line for line in lines)


def test_no_layouts_are_an_answer() -> None:
    assert json.loads(run("--cells", "2", "--inner", "1", "--json").stdout) == []
    done = run("--cells", "2", "--inner", "1")
    assert (done.exit_code, done.stdout) == (0, "no layouts\n")


@pytest.mark.parametrize("name", ["sheet.svg", "sheet.PNG"])
def test_sheets_are_written(tmp_path: Path, name: str) -> None:
    done = run("--cells", "3", "--json", "--draw", tmp_path / name)
    assert len(json.loads(done.stdout)) == 4
    assert f"written {tmp_path / name}" in done.stderr
    assert (tmp_path / name).read_bytes()[:5] in (b"<?xml", b"\x89PNG\r")
    assert run("--cells", "3", "--count", "--draw", tmp_path / name).stdout.endswith(f"written {tmp_path / name}\n")


def test_a_graph_becomes_a_layout(graph: Path, tmp_path: Path) -> None:
    done = run("--graph", graph, "--draw", tmp_path / "ring.svg")
    assert done.exit_code == 0
    assert done.stdout.startswith("131313 ")
    assert 'cells = [["B", "C", "M", "A"], ' in done.stdout
    assert 'slits = [["M", ' in done.stdout
    assert "<svg" in (tmp_path / "ring.svg").read_text()
    (told,) = json.loads(run("--graph", graph, "--json").stdout)
    assert told["outline"] == ["A", "B", "C", "D", "E", "F"]


def test_a_graph_is_refused_with_the_reason(graph: Path) -> None:
    graph.write_text(toml(GRAPH | {"edges": EDGES[:-1]}))
    done = run("--graph", graph)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"error: {graph}: face ")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "give either --cells or --graph; found neither"),
        (("--cells", "3", "--graph", "x.toml"), "found both"),
        (("--graph", "x.toml", "--inner", "1"), "--graph: checks one layout"),
        (("--graph", "missing.toml"), "missing.toml: cannot be read"),
        (("--cells", "0"), "too few cells; found 0"),
        (("--cells", "-4", "--count"), "too few cells; found -4"),
        (("--cells", "15"), "--cells: too many to go through; found 15; limit: 14"),
        (("--cells", "9" * 30, "--count"), "too many to go through"),
        (("--cells", "4", "--inner", "-1"), "number of inner vertices; found -1"),
        (("--cells", "4", "--draw", "sheet.pdf"), "--draw: not a drawing; found sheet.pdf"),
    ],
)
def test_bad_input_is_one_line_and_status_2(words: tuple[str, ...], message: str) -> None:
    done = run(*words)
    assert done.exit_code == 2
    assert message in done.stderr
    assert "remedy: " in done.stderr
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1


def test_help_has_an_example() -> None:
    assert "ori-deploy layouts --cells" in run("--help").stdout.split("Example:")[1]
