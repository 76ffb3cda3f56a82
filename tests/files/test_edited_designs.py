"""A design file is what its layout gives, in every entry: people build from all of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from ori_deploy.cli.steps import make_design
from ori_deploy.errors import FileError, InputError
from ori_deploy.files import load_design

EXAMPLES = Path(__file__).parents[2] / "examples"
SHAPES = ("wing_span_3", "antenna_helix", "cone_circular_6")


@pytest.fixture(
    scope="module", params=[SHAPES[0], *(pytest.param(name, marks=pytest.mark.slow) for name in SHAPES[1:])]
)
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("designs") / "made.design.json"
    make_design(EXAMPLES / f"{request.param}.toml", path)
    return path


def numbers(entry: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Ways to one number of every list and table, so that no kind of entry is left out."""
    if isinstance(entry, dict):
        for key, value in entry.items():
            yield from numbers(value, (*way, key))
    elif isinstance(entry, list):
        if entry and isinstance(entry[0], list | dict):
            yield from numbers(entry[len(entry) // 2], (*way, len(entry) // 2))
        elif entry and isinstance(entry[0], float):
            yield (*way, 0)
    elif isinstance(entry, float):
        yield way


def edited(data: dict[str, Any], way: tuple[Any, ...]) -> dict[str, Any]:
    """A copy in which one number is another."""
    changed = deepcopy(data)
    place: Any = changed
    for step in way[:-1]:
        place = place[step]
    place[way[-1]] = place[way[-1]] * 1.5 + 0.37
    return changed


def test_every_number_of_a_design_file_counts(written: Path, tmp_path: Path) -> None:
    data = json.loads(written.read_text())
    load_design(written)
    # The profile is what everything follows from; of a cylinder's span nothing else does.
    ways = list(numbers({k: v for k, v in data.items() if k not in ("profile", "span_m")}))
    assert len(ways) > 20
    for way in ways:
        path = tmp_path / "edited.json"
        path.write_text(json.dumps(edited(data, way)))
        with pytest.raises(InputError):
            load_design(path)


@pytest.mark.parametrize(
    "edit",
    [
        lambda d: d["panels"][3].update(outline=[[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]),
        lambda d: d["panels"].pop(),
        lambda d: d["panels"][2].update(bonded_to="c1.ac"),
        lambda d: d["cells"][0].pop("creases"),
        lambda d: d.update(span_m="NaN"),
        lambda d: d.update(span_m=True),
    ],
    ids=["outline", "panel gone", "bond", "creases gone", "span no number", "span a boolean"],
)
def test_lists_and_names_count_too(edit: Callable[[dict[str, Any]], object], written: Path, tmp_path: Path) -> None:
    data = json.loads(written.read_text())
    edit(data)
    path = tmp_path / "edited.json"
    path.write_text(json.dumps(data))
    with pytest.raises(FileError):
        load_design(path)


def test_hinges_and_joints_cannot_be_left_out(tmp_path: Path) -> None:
    for name, entry, inside in (("wing_span_3", "span", "hinges"), ("antenna_helix", "strip", "joints")):
        path = tmp_path / f"{name}.json"
        make_design(EXAMPLES / f"{name}.toml", path)
        data = json.loads(path.read_text())
        data[entry][inside] = []
        path.write_text(json.dumps(data))
        with pytest.raises(FileError, match=inside):
            load_design(path)
