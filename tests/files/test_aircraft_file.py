"""Aircraft files: what they say, and how they are refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from ori_deploy.errors import InputError
from ori_deploy.files import load_aircraft, load_loads, save_loads
from ori_deploy.files.design_file import Design, save_design
from ori_deploy.files.spec import build_from_file
from ori_deploy.loads import Air, Film, Loads, Magnets

EXAMPLES = Path(__file__).parents[2] / "examples"
UAV = (EXAMPLES / "uav_table1.toml").read_text().replace('"wing_naca2412.toml"', f'"{EXAMPLES}/wing_naca2412.toml"')
SMALL = """schema = "ori-deploy/aircraft/1"
name = "small"
mass = { takeoff_kg = 0.5, cg_chord = 0.2 }
cruise = { speed_m_s = 10.0 }
wing = { naca = "23012", span_m = 1.0, area_m2 = 0.2 }
power = { efficiency = 0.5, battery_wh = 5.0 }
"""


def test_the_example_says_what_table_1_says() -> None:
    given = load_aircraft(EXAMPLES / "uav_table1.toml")
    craft, said = given.craft, given.craft.published
    assert (craft.mass_kg, craft.wing.span_m, craft.wing.area_m2, craft.cruise_m_s) == (0.85, 1.26, 0.315, 8.5)
    assert (said.cruise_cl, said.static_margin, said.endurance_s) == (0.65, (0.08, 0.10), 540.0)
    assert said.polar is not None
    assert (said.polar.cd0, said.polar.k, said.polar.cl0) == (0.029, 0.072, 0.034)
    assert craft.power.efficiency == 0.45
    assert craft.power.propeller_m == pytest.approx(0.2032)
    assert craft.wing.dihedral_rad == pytest.approx(np.radians(10.0))
    assert given.built is not None
    assert given.built.slit_gap_m == pytest.approx(2.5e-4)
    # Nothing that the paper gives is marked as an assumption, and nothing else is not.
    assert not {"mass.takeoff_kg", "cruise", "wing.span_m", "wing.area_m2", "power.efficiency"} & set(craft.assumed)
    assert {"tail", "mass.cg_chord", "power.battery_wh", "gust"} <= set(craft.assumed)


def test_the_least_that_flies(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    given = load_aircraft(path)
    assert given.section_name == "NACA 23012"
    assert given.built is None
    assert given.craft.tail is None
    assert given.craft.published.polar is None


def test_a_wing_may_have_the_section_of_a_design_file_alone(tmp_path: Path) -> None:
    spec, structure = build_from_file(EXAMPLES / "wing_naca2412.toml")
    save_design(Design("wing", spec.structure.span_m, structure), tmp_path / "wing.design.json")
    path = tmp_path / "small.toml"
    path.write_text(SMALL.replace('naca = "23012"', 'design = "wing.design.json"'))
    given = load_aircraft(path)
    assert given.section_name == "wing"
    assert given.built is not None
    assert given.built.structure.eta == pytest.approx(structure.eta)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("takeoff_kg = 0.85", "takeoff_kg = -1.0", r"mass\.takeoff_kg.*greater than 0"),
        ("takeoff_kg = 0.85", "takeoff_kg = nan", r"mass\.takeoff_kg"),
        ("takeoff_kg = 0.85", 'takeoff_kg = "850 g"', r"mass\.takeoff_kg.*850 g"),
        ("takeoff_kg", "takeof_kg", r"mass\.takeof_kg.*did you mean takeoff_kg"),
        ("speed_m_s = 8.5", "speed_m_s = 340.0", r"cruise\.speed_m_s.*100"),
        ("area_m2 = 0.315", "area_m2 = 0.0", r"wing\.area_m2"),
        ("mount_m = 0.06", "mount_m = 1.3", r"less than span_m"),
        ('naca = "2412"', 'naca = "24x2"', r"wing\.naca.*24x2"),
        ('"power.battery_wh"', '"power.battery_mah"', r"there is no key 'power.battery_mah'"),
        ("[0.08, 0.10]", "[0.10, 0.08]", r"lowest, highest"),
        ("diameter_m = 0.06", "diameter_m = 0.6", r"at least 4 times"),
        ("efficiency = 0.45", "efficiency = 45.0", r"power\.efficiency.*less than or equal to 1"),
        ("ori-deploy/aircraft/1", "ori-deploy/loads/1", r"key schema"),
        ("wing_naca2412.toml", "no_such.toml", r"no_such\.toml"),
        ("wing_naca2412.toml", "cone_circular_6.toml", r"wing\.design.*a cylinder"),
    ],
)
def test_a_file_is_refused_by_key_value_and_limit(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in UAV
    path = tmp_path / "uav.toml"
    path.write_text(UAV.replace(old, new, 1) if old != "wing_naca2412.toml" else UAV.replace(old, new))
    with pytest.raises(InputError) as refused:
        load_aircraft(path)
    assert re.search(said, str(refused.value)), str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('naca = "23012", ', ""), "needs a section"),
        (("power =", "fin = { height_m = 0.1, chord_m = 0.1 }\npower ="), "add a tail"),
    ],
)
def test_parts_that_do_not_fit_each_other_are_refused(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    path = tmp_path / "small.toml"
    path.write_text(SMALL.replace(*change))
    with pytest.raises(InputError, match=said):
        load_aircraft(path)


def test_loads_that_are_written_are_read_again(tmp_path: Path) -> None:
    loads = Loads(
        density_kg_m3=171.5, extra_kg={"c1.ac": 0.02}, gravity_m_s2=(1.5, -19.0, 0.0),
        film=Film(2e-4, 2e-3, 3e9, 1.2, 3.0, 2.5),
        air=Air(1.0, ((0.0, -3.5), (1.0, 44.0)), (0.0, 1.0, 2.0), 1.1, 1.3),
        magnets=Magnets(20.0, 1e-3, 9e-3, 3e-4), friction_nm=0.01, damping_nm_s=0.02, clamp="c2", efficiency=0.8,
    )  # fmt: skip
    path = tmp_path / "a.loads.toml"
    save_loads(loads, path, ("made by a test",))
    assert path.read_text().startswith("# made by a test\nschema = ")
    assert "    [0.0, -3.5],\n" in path.read_text()
    back = load_loads(path)
    assert back.air == loads.air
    assert (back.clamp, back.extra_kg, back.gravity_m_s2) == (loads.clamp, loads.extra_kg, loads.gravity_m_s2)
    for part in ("film", "magnets"):
        ours, theirs = vars(getattr(loads, part)), vars(getattr(back, part))
        assert {k: pytest.approx(v) for k, v in ours.items()} == theirs
    assert load_loads(path).efficiency == 0.8


def test_loads_that_could_not_be_read_again_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="density"):
        save_loads(Loads(density_kg_m3=float("inf")), tmp_path / "a.toml")
    assert not list(tmp_path.iterdir())
