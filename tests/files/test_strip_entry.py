"""The strip from specification to design file and back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from ori_deploy.cli import main
from ori_deploy.cli.steps import make_design
from ori_deploy.errors import FileError, InputError, StripError
from ori_deploy.files import load_design, load_spec

EXAMPLES = Path(__file__).parents[2] / "examples"
HELIX, SPIRAL = EXAMPLES / "antenna_helix.toml", EXAMPLES / "antenna_conical_spiral.toml"


@pytest.fixture(scope="module", params=[HELIX, pytest.param(SPIRAL, marks=pytest.mark.slow)], ids=["helix", "spiral"])
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    path = tmp_path_factory.mktemp("strip") / "antenna.design.json"
    make_design(request.param, path)
    return path, json.loads(path.read_text())


def shoelace(corners: list[list[float]]) -> float:
    x, y = np.array(corners).T
    return float(0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def test_the_entry_adds_up(written: tuple[Path, dict[str, Any]]) -> None:
    _, data = written
    strip = data["strip"]
    assert sum(p["area_m2"] for p in strip["pieces"]) == pytest.approx(strip["area_m2"], rel=1e-6)
    assert abs(shoelace(strip["development"]["outline"])) == pytest.approx(strip["area_m2"], rel=1e-3)
    assert {p["panel"] for p in strip["pieces"]} <= {p["id"] for p in data["panels"]}
    crossed = {j["at"]: j["crossings"] for j in strip["joints"]}
    lines = [line["at"] for line in strip["development"]["lines"]]
    assert {at: lines.count(at) for at in crossed} == crossed
    ends = [np.array(line["ends"]) for line in strip["development"]["lines"]]
    assert sum(crossed.values()) == len(strip["pieces"]) - 1 == len(ends)
    for joint in strip["joints"]:
        assert (joint["largest_gap_m"] > 0.0) == (joint["kind"] == "part")
        assert 0.0 <= joint["flat_gap_m"] <= joint["largest_gap_m"]
        assert (joint["fold_rad"] != 0.0) == (joint["kind"] == "fold")


def test_a_helixs_polygons_have_their_areas(tmp_path: Path) -> None:
    _, data, _ = make_design(HELIX, tmp_path / "antenna.design.json")
    strip = data["strip"]
    for piece in strip["pieces"]:
        assert shoelace(piece["polygon"]) == pytest.approx(piece["area_m2"], rel=1e-9)  # counter-clockwise
        assert min(z for _, z in piece["polygon"]) >= 0.0
        assert max(z for _, z in piece["polygon"]) <= data["span_m"]
    perimeter = load_spec(HELIX).profile.make(EXAMPLES).perimeter
    assert strip["length_m"] == pytest.approx(2.5 * np.hypot(perimeter, 0.14))
    assert strip["area_m2"] == pytest.approx(0.02 * strip["length_m"])


def test_a_design_with_a_strip_is_read_as_written_and_an_edited_one_refused(
    written: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    path, data = written
    design = load_design(path)
    assert design.strip is not None
    assert design.strip.kind == data["strip"]["kind"]
    laid = design.strip.lay(design.structure, design.r_min_m, design.r_max_m)
    assert len(laid.pieces) == len(data["strip"]["pieces"])
    other = tmp_path / "edited.design.json"
    for key, value in (("turns", 1.0), ("length_m", 1.0), ("area_m2", None), ("kind", "band"), ("turns", "many")):
        other.write_text(json.dumps({**data, "strip": {**data["strip"], key: value}}))
        with pytest.raises(FileError, match="strip"):
            load_design(other)
    other.write_text(json.dumps({**data, "strip": [1]}))
    with pytest.raises(FileError, match="strip"):
        load_design(other)


@pytest.mark.parametrize(
    ("spec", "old", "new", "why"),
    [
        (HELIX, 'kind = "helix"', 'kind = "band"', "strip.kind"),
        (HELIX, "pitch_m = 0.14", "rise_m = 0.14", "strip.rise_m"),
        (HELIX, "turns = 2.5", "turns = 0.0", "strip.turns"),
        (HELIX, "start_arc = 0.25", "start_arc = 1.0", "strip.start_arc"),
        (HELIX, "width_m = 0.02", "width_m = nan", "strip.width_m"),
        (HELIX, "span_m = 0.4", "span_m = 0.4\nspan_segments = 2", "segments"),
        (SPIRAL, "growth = 1.5", "pitch_m = 1.5", "strip.pitch_m"),
    ],
)
def test_a_strip_that_is_written_wrong_is_refused_by_its_key(
    tmp_path: Path, spec: Path, old: str, new: str, why: str
) -> None:
    text = spec.read_text()
    assert old in text
    file = tmp_path / "wrong.toml"
    file.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=why):
        load_spec(file)


@pytest.mark.parametrize(
    ("spec", "old", "new", "why"),
    [
        (HELIX, "turns = 2.5", "turns = 3.5", "leaves the surface"),
        (HELIX, "pitch_m = 0.14", "pitch_m = 0.0", "pitch_m"),
        (SPIRAL, "turns = 3.0", "turns = 3.5", "leaves the surface"),
        (SPIRAL, "growth = 1.5", "growth = 1.0", "growth"),
    ],
)
def test_a_strip_that_does_not_fit_is_refused_with_the_file_and_nothing_written(
    tmp_path: Path, spec: Path, old: str, new: str, why: str
) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(spec.read_text().replace(old, new))
    done = CliRunner().invoke(main, ["design", str(file), "-o", str(tmp_path / "x.design.json")])
    assert done.exit_code == 2
    assert done.stderr.startswith(f"error: {file}: strip")
    assert why in done.stderr
    assert not (tmp_path / "x.design.json").exists()


def test_each_kind_of_strip_has_its_kind_of_surface() -> None:
    helix, spiral = load_spec(HELIX), load_spec(SPIRAL)
    assert helix.strip is not None
    assert spiral.strip is not None
    with pytest.raises(StripError, match="spiral"):
        helix.strip.lay(spiral.build(EXAMPLES), 0.1, 0.4)
    with pytest.raises(StripError, match="helix"):
        spiral.strip.lay(helix.build(EXAMPLES), 0.0, 0.4)


def test_the_command_tells_and_draws(written: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    path, data = written
    for name, head in (("strip.svg", b"<?xml"), ("strip.png", b"\x89PNG")):
        done = CliRunner().invoke(main, ["strip", str(path), "--draw", str(tmp_path / name)])
        assert done.exit_code == 0, done.output
        assert (tmp_path / name).read_bytes().startswith(head)
        assert f"{1e3 * data['strip']['length_m']:.1f} mm" in done.stdout
    for words, why in (
        (["strip", str(path), "--draw", "strip.doc"], "--draw"),
        (["strip", str(tmp_path / "none.design.json")], "cannot be read"),
    ):
        done = CliRunner().invoke(main, words)
        assert done.exit_code == 2
        assert why in done.stderr


def test_the_command_refuses_a_design_without_a_strip(tmp_path: Path) -> None:
    make_design(EXAMPLES / "circle_6.toml", tmp_path / "circle.design.json")
    done = CliRunner().invoke(main, ["strip", str(tmp_path / "circle.design.json")])
    assert done.exit_code == 2
    assert "carries no strip" in done.stderr
