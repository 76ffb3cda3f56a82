"""`ori-deploy limit`: what it prints, what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from ori_deploy.cli import main

EXAMPLES = Path(__file__).parents[2] / "examples"


def run(*words: str | Path) -> Result:
    return CliRunner().invoke(main, ["limit", *(str(w) for w in words)])


def test_json_holds_profile_area_slope_and_place() -> None:
    done = run(EXAMPLES / "ellipse_6.toml", "--json")
    assert done.exit_code == 0
    data = json.loads(done.stdout)
    assert set(data) == {"profile", "area", "eta_per_cell", "center_m"}
    assert data["profile"] == {"kind": "ellipse", "a_m": 0.1, "b_m": 0.06}
    assert data["area"] == pytest.approx(3.14159265358979 * 0.006, rel=1e-12)
    assert data["eta_per_cell"] == pytest.approx(1.106525, abs=2e-6)
    assert data["center_m"] == pytest.approx([0.0, 0.0], abs=1e-15)


def test_another_place_of_the_inner_vertex_gives_less() -> None:
    data = json.loads(run(EXAMPLES / "circle_6.toml", "--center", "0.02", "-0.03", "--json").stdout)
    assert data["center_m"] == [0.02, -0.03]
    assert 0.8 < data["eta_per_cell"] < 1.2732395


def test_people_get_a_table() -> None:
    done = run(EXAMPLES / "circle_6.toml")
    assert done.exit_code == 0
    assert "eta per cell" in done.stdout
    assert "1.27324" in done.stdout


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ((EXAMPLES / "wing_naca2412.toml",), "corner"),
        ((EXAMPLES / "heart_6.toml", "--json"), "hollow"),
        ((EXAMPLES / "cone_circular_6.toml",), "that of a cylinder"),
        ((EXAMPLES / "circle_6.toml", "--center", "1", "0"), "center"),
        ((EXAMPLES / "circle_6.toml", "--center", "nan", "0"), "center"),
        (("not there.toml",), "cannot be read"),
        ((EXAMPLES / "rig_mock.toml",), "schema"),
    ],
)
def test_bad_input_is_one_line_and_status_2(words: tuple[str | Path, ...], why: str) -> None:
    done = run(*words)
    assert done.exit_code == 2
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert why in done.stderr
    assert done.stderr.count("\n") == 1
    if words[0] != "not there.toml":
        assert str(words[0]) in done.stderr


def test_what_is_left_of_a_nought_by_rounding_is_not_printed(tmp_path: Path) -> None:
    spec = tmp_path / "a.toml"
    for profile in (
        'kind = "clover"\nradius_m = 0.1\ndepth = 0.05',
        'kind = "ellipse"\na_m = 0.1\nb_m = 0.03',
    ):
        spec.write_text(f'schema = "ori-deploy/spec/1"\n[profile]\n{profile}\n[structure]\nspan_m = 1\nwall_m = 0\n')
        assert "(0.000, 0.000) mm" in run(spec).stdout
        assert json.loads(run(spec, "--json").stdout)["center_m"] == [0.0, 0.0]
    assert "(0.000, 0.000) mm" in run(spec, "--center", "-1e-8", "-1e-9").stdout


def test_an_outline_too_slender_for_its_own_centroid_is_told_so(tmp_path: Path) -> None:
    spec = tmp_path / "thin.toml"
    spec.write_text(
        'schema = "ori-deploy/spec/1"\n[profile]\nkind = "ellipse"\na_m = 1e4\nb_m = 1e-6\n'
        "[structure]\nspan_m = 1\nwall_m = 0\n"
    )
    done = run(spec)
    assert done.exit_code == 2
    assert "slender" in done.stderr
    assert "leave it out" not in done.stderr
