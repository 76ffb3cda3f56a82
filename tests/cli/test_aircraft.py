"""`ori-deploy aircraft`: figures beside the paper's, loads for `ori-deploy size`, and the page that shows them."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from ori_deploy.aero.figures import Figure
from ori_deploy.cli import main
from ori_deploy.cli.aircraft import difference, find, number, published
from ori_deploy.files import build_from_file, load_loads, save_design
from ori_deploy.files.design_file import Design

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
UAV = EXAMPLES / "uav_table1.toml"
RIG = str(EXAMPLES / "rig_wing_dynamixel.toml")
SMALL = """schema = "ori-deploy/aircraft/1"
name = "small"
mass = { takeoff_kg = 0.4, cg_chord = 0.25 }
cruise = { speed_m_s = 10.0 }
wing = { naca = "2412", span_m = 1.0, area_m2 = 0.2 }
power = { efficiency = 0.5, battery_wh = 5.0 }
"""
HEAD = "| | value | method | published | off by |"
_OFF = 0.02
_NEAR = 0.002
"""How far a page's figures may be from those of other versions of NeuralFoil and AeroSandbox, in parts; or at all."""


def run(*words: str | Path, status: int = 0) -> str:
    result = CliRunner().invoke(main, [str(w) for w in words])
    assert result.exit_code == status, result.output
    return result.output


def test_help_and_a_wrong_file_take_no_time(tmp_path: Path) -> None:
    assert "--loads-out" in run("aircraft", "--help")
    path = tmp_path / "small.toml"
    path.write_text(SMALL.replace("0.4", "-0.4"))
    told = run("aircraft", path, status=2)
    assert "mass.takeoff_kg" in told
    assert "-0.4" in told
    assert len(told.splitlines()) == 1


def test_a_missing_package_is_one_line_with_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "aerosandbox", None)
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    told = run("aircraft", path, status=2)
    assert "pip install -e '.[aero]'" in told
    assert len(told.splitlines()) == 1


def test_a_wing_without_a_structure_bears_no_loads(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    told = run("aircraft", path, "--loads-out", tmp_path / "loads", status=2)
    assert "wing.design" in told
    assert not (tmp_path / "loads").exists()


def test_an_aircraft_that_stalls_is_refused_with_its_file(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text(SMALL.replace("0.4", "4.0"))
    told = run("aircraft", path, status=2)
    assert re.search(r"small\.toml: .*stalls; found C_l 3\.\d+ .*remedy: fly faster", told)


@pytest.mark.slow
def test_an_aircraft_of_a_few_lines_gets_its_own_figures_and_none_of_the_papers(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    told = run("aircraft", path, "--plot", tmp_path / "small.png", "--json", tmp_path / "small.json")
    assert "time of flight" in told
    assert (tmp_path / "small.png").stat().st_size > 30_000
    for word in ("published", "assumed:", "static margin", "Endurance", "tail", "Section"):
        assert word not in told.replace("published off by assumed", ""), word
    data = json.loads((tmp_path / "small.json").read_text())
    assert all(row["published"] is None and row["difference"] is None for row in data["figures"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    out = tmp_path_factory.mktemp("aircraft")
    told = run(
        "aircraft", UAV, "--json", out / "a.json", "--plot", out / "a.png", "--loads-out", out / "loads"
    )  # fmt: skip
    return out, told


@pytest.mark.slow
def test_every_figure_names_its_method_and_what_it_rests_on(folder: tuple[Path, str]) -> None:
    out, told = folder
    data = json.loads((out / "a.json").read_text())
    rows = data["figures"]
    assert all(row["method"] for row in rows)
    by = {(row["quantity"], row["method"]): row for row in rows}
    lift = by["C_L", "weight / (q S)"]
    assert lift["value"] == pytest.approx(0.598, abs=5e-4)
    assert lift["published"] == 0.65
    assert lift["difference"] == pytest.approx(0.598 / 0.65 - 1.0, abs=1e-3)
    margin = by["static margin", "VLM + NeuralFoil"]
    assert margin["published"] == [8.0, 10.0]
    assert {"tail", "mass.cg_chord"} <= set(margin["assumed"])
    assert by["time of flight", "published polar"]["published"] == 9.0
    for method in ("VLM + NeuralFoil", "AeroBuildup"):
        drag = by["C_D at cruise", method]
        assert drag["published"] == pytest.approx(0.029 + 0.072 * (lift["value"] - 0.034) ** 2)
        assert 0.6 < drag["value"] / drag["published"] < 1.1
    assert "0.924 kg" in told.replace("\n", " ")
    assert (out / "a.png").stat().st_size > 50_000


@pytest.mark.slow
def test_the_built_section_is_the_wanted_one(folder: tuple[Path, str]) -> None:
    rows = {(r["quantity"], r["unit"]): r["value"] for r in json.loads((folder[0] / "a.json").read_text())["figures"]}
    assert rows["max, as designed", "mm"] < 1e-3
    assert rows["RMS, open 0.25 mm", "mm"] < rows["max, open 0.25 mm", "mm"] < 1.0
    assert rows["max, open 0.25 mm", "% c"] == pytest.approx(rows["max, open 0.25 mm", "mm"] / 2.5)
    for state in ("as designed", "open 0.25 mm"):
        assert rows[f"C_l, {state}", ""] == pytest.approx(rows["C_l, NACA 2412", ""], abs=0.03)
        assert rows[f"C_d, {state}", ""] == pytest.approx(rows["C_d, NACA 2412", ""], rel=0.1)


@pytest.mark.slow
def test_loads_of_cruise_and_gust_are_sized_at_the_deployed_pose(folder: tuple[Path, str], tmp_path: Path) -> None:
    spec, structure = build_from_file(EXAMPLES / "wing_naca2412.toml")
    wing = tmp_path / "wing.design.json"
    save_design(Design("wing", spec.structure.span_m, structure), wing)
    air = {}
    for name in ("cruise", "gust"):
        path = folder[0] / "loads" / f"{name}.loads.toml"
        loads = load_loads(path)
        assert len(loads.air.pressure_at) > 100
        # The wing of 0.5 kg, and the load factor that the head of the file tells.
        mass = loads.density_kg_m3 * float(structure.panel_areas.sum()) * spec.structure.span_m  # type: ignore[union-attr]
        assert mass == pytest.approx(0.5)
        factor = float(re.search(r"([\d.]+) times its weight", path.read_text()).group(1))  # type: ignore[union-attr]
        assert np.linalg.norm(loads.gravity_m_s2) == pytest.approx(9.80665 * factor, rel=1e-3)
        rows = json.loads(run("size", wing, "--rig", RIG, "--deployed", "--loads", path, "--json"))
        assert {row["fold"] for row in rows} == {1.0}
        air[name] = np.array([row["air"] for row in rows])
    assert (np.abs(air["gust"]) > np.abs(air["cruise"])).all()


def page_rows(figures: Sequence[Figure]) -> list[str]:
    """The table of docs/aircraft.md: `python -m tests.cli.test_aircraft` prints it."""
    rows = [HEAD, "|---|---|---|---|---|"]
    for f in figures:
        value = f"{number(f.value)} {f.unit}".strip()
        rows.append(f"| {f.quantity} | {value} | {f.method} | {published(f)} | {difference(f)} |")
    return rows


def _cells(row: str) -> tuple[str, float, str]:
    name, value, method = (cell.strip() for cell in row.split("|")[1:4])
    return name, float(value.split()[0].replace(",", "")), method


@pytest.mark.slow
def test_the_page_shows_what_comes_out(folder: tuple[Path, str]) -> None:
    page = (ROOT / "docs" / "aircraft.md").read_text().splitlines()
    start = page.index(HEAD)
    shown = [_cells(row) for row in page[start + 2 :] if row.startswith("| ")]
    figures = json.loads((folder[0] / "a.json").read_text())["figures"]
    found = [Figure(**{key: value for key, value in f.items() if key != "difference"}) for f in figures]
    ours = [_cells(row) for row in page_rows([replace(f, published=None) for f in found])[2:]]
    assert [(name, method) for name, _, method in shown] == [(name, method) for name, _, method in ours]
    for (name, there, _), (_, here, _) in zip(shown, ours, strict=True):
        assert there == pytest.approx(here, rel=_OFF, abs=_NEAR), name


if __name__ == "__main__":
    print("\n".join(page_rows(find(UAV).figures)))
