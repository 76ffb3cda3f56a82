"""Graph files: TOML and JSON, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ori_deploy.errors import FileError, InputError, LayoutError
from ori_deploy.files import load_graph

EDGES = [["A", "B"], ["B", "C"], ["C", "D"], ["D", "E"], ["E", "F"], ["F", "A"], ["M", "A"], ["M", "C"], ["M", "E"]]
XY = {"A": [2, 0], "B": [1, 2], "C": [-1, 2], "D": [-2, 0], "E": [-1, -2], "F": [1, -2], "M": [0, 0]}
GRAPH: dict[str, Any] = {
    "schema": "ori-deploy/graph/1",
    "edges": EDGES,
    "vertex": [{"id": v, "xy": xy} for v, xy in XY.items()],
}


def toml(graph: dict[str, Any]) -> str:
    lines = [f"{k} = {json.dumps(v)}" for k, v in graph.items() if k != "vertex"]
    for vertex in graph["vertex"]:
        lines += ["[[vertex]]", *(f"{k} = {json.dumps(v)}" for k, v in vertex.items())]
    return "\n".join(lines)


def test_toml_and_json_say_the_same(tmp_path: Path) -> None:
    graph = GRAPH | {"slits": [["M", "E"]]}
    (tmp_path / "g.json").write_text(json.dumps(graph))
    (tmp_path / "g.toml").write_text(toml(graph))
    drawn = load_graph(tmp_path / "g.json")
    assert drawn == load_graph(tmp_path / "g.toml")
    assert drawn.layout.n_cells == 3
    assert drawn.layout.slits == ((6, 4),)
    assert drawn.places[1] == 1 + 2j


def test_the_file_in_the_documentation_is_one(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "specification.md").read_text()
    (block,) = (b.split("```")[0] for b in page.split("```toml\n")[1:] if "ori-deploy/graph/1" in b.split("```")[0])
    (tmp_path / "g.toml").write_text(block)
    drawn = load_graph(tmp_path / "g.toml")
    assert (drawn.layout.n_cells, drawn.layout.slits) == (3, ((6, 0),))


def test_a_role_in_the_file_counts(tmp_path: Path) -> None:
    path = tmp_path / "g.toml"
    for role, refused in (("closing", False), ("opening", True)):
        vertex = [v | ({"role": role} if v["id"] == "M" else {}) for v in GRAPH["vertex"]]
        path.write_text(toml(GRAPH | {"vertex": vertex}))
        if refused:
            with pytest.raises(LayoutError, match="M is closing, not opening"):
                load_graph(path)
        else:
            assert load_graph(path).layout.vertices[6].role == "closing"


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"schema": "ori-deploy/spec/1"}, FileError, "key schema"),
        ({"edges": [["A"]]}, LayoutError, "edge A: does not join two"),
        ({"edges": "AB"}, FileError, "key edges"),
        ({"colour": 1}, FileError, "key colour"),
        ({"vertex": [{"id": "A"}]}, FileError, r"key vertex\[A\].xy"),
        ({"vertex": [{"id": "A", "xy": [1, 2, 3]}]}, FileError, r"key vertex\[A\].xy"),
        ({"vertex": [{"id": "A", "xy": [1, 1e300]}]}, FileError, r"key vertex\[A\].xy"),
        ({"vertex": [{"id": "A", "xy": [1, "2"]}]}, FileError, r"key vertex\[A\].xy"),
        ({"vertex": [{"id": "A", "xy": [1, True]}]}, FileError, r"key vertex\[A\].xy"),
        ({"vertex": [{"id": "A b", "xy": [1, 1]}]}, FileError, r"key vertex\[A b\].id"),
        ({"vertex": [*GRAPH["vertex"], {"id": "M", "xy": [9, 9]}]}, LayoutError, "vertex M: id given twice"),
        ({"edges": EDGES[:-1]}, LayoutError, "not a quadrilateral"),
        ({"slits": [["M", "B"]]}, LayoutError, "slit M-B: not an edge"),
        ({"slits": []}, LayoutError, "vertex M: 0 slits"),
    ],
)
@pytest.mark.parametrize("name", ["g.toml", "g.json"])
def test_bad_files_name_file_and_fault(
    tmp_path: Path, name: str, change: dict[str, Any], kind: type[InputError], message: str
) -> None:
    graph = GRAPH | change
    (tmp_path / name).write_text(json.dumps(graph) if name.endswith("json") else toml(graph))
    with pytest.raises(kind, match=message) as refused:
        load_graph(tmp_path / name)
    assert str(tmp_path / name) in str(refused.value)
