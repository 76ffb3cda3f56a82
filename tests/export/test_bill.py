"""Bill of materials, masses, centre of mass and print check."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from ori_deploy.errors import FileError
from ori_deploy.export.bill import bill_of
from ori_deploy.export.parts import build_parts
from ori_deploy.export.parts_spec import PartsSpec, load_parts_spec
from ori_deploy.export.print_check import check_text, print_check
from ori_deploy.loads import Solids
from tests.export.solid_checks import design, parts, some_slow

EXAMPLE = Path(__file__).parents[2] / "examples" / "parts_wing.toml"


@pytest.mark.parametrize("name", some_slow(["wing"], ["cone elliptic 6", "tapered"]))
def test_bare_panels_weigh_what_the_loads_say_and_balance_where_they_say(name: str) -> None:
    d = design(name)
    light = PartsSpec.model_validate(
        {"film": {"density_kg_m3": 0.0}, "material": {"density_kg_m3": 500.0}, "magnet": {"mass_g": 0.0}}
    )
    bill = bill_of(build_parts(d, light, plain=True), np.ones(1))
    solids = Solids.of(d.structure, d.span_m, d.r_min_m)
    assert bill.mass_kg == pytest.approx(500.0 * solids.volume.sum(), rel=1e-3)
    centre = (solids.volume @ solids.centroid) / solids.volume.sum()
    assert np.abs(bill.centre_m[0] - centre).max() < 1e-3 * d.structure.profile.size * d.unit_m
    assert list(bill.panel_kg.values()) == pytest.approx(500.0 * solids.volume, rel=2e-3)


@pytest.mark.slow
def test_the_bill_counts_what_is_there() -> None:
    made = parts("segments")
    bill = bill_of(made, 3)
    count = {item.thing: item.count for item in bill.items}
    assert count == {
        "panels of PLA, 20 % infill": 48, "polyester film, 100 µm": 16, "magnet 5 x 1 mm": 24, "servo": 4,
        "piano hinge, pin 1.2 mm": 2,
    }  # fmt: skip
    assert bill.mass_kg == pytest.approx(sum(bill.panel_kg.values()), rel=1e-12)
    assert bill.fold.tolist() == [0.0, 0.5, 1.0]
    assert bill.data()["centre_of_mass"]["centre_m"] == bill.centre_m.tolist()
    text = bill.text()
    assert "servo                       4      mounts for 1 of them" in text
    things, over_the_fold = text.split("\n\ncentre of mass over the fold\n")
    assert len(things.splitlines()) == 1 + len(bill.items) + 1, "a head, the things, all of them together"
    assert len(over_the_fold.splitlines()) == 1 + len(bill.fold)


def test_the_centre_of_mass_moves_along_the_fold_but_not_along_a_cylinders_span() -> None:
    bill = bill_of(parts("wing"))
    assert np.ptp(bill.centre_m[:, 2]) < 1e-12
    assert np.ptp(bill.centre_m[:, 0]) > 0.02
    steps = np.linalg.norm(np.diff(bill.centre_m, axis=0), axis=1)
    assert steps.max() < 3.0 * np.median(steps), "no jumps"


def test_print_check_finds_thin_walls_and_parts_too_long_for_the_bed() -> None:
    d = design("helix")
    made = build_parts(d, PartsSpec.model_validate({"print": {"bed_mm": [450.0, 300.0, 50.0]}}), plain=True)
    found = {(f.part, f.check): f for f in print_check(made)}
    assert len(found) == 3 * len(made.parts)
    assert all(f.ok for (_, check), f in found.items() if check == "bed")
    walls = [
        float(f.value.split()[0]) for (part, check), f in found.items() if check == "wall" and part.endswith("ac")
    ]
    slab = 1e3 * float((d.structure.cells.rim + d.structure.cells.offset)[0, 0])
    assert walls[0] == round(slab, 2), "two parallel faces"
    short = print_check(build_parts(d, plain=True))
    bed = [f for f in short if f.check == "bed"]
    assert not any(f.ok for f in bed)
    assert "400 x " in bed[0].value
    assert "remedy: span_segments = 2 in the specification" in str(bed[0])
    assert check_text(short).splitlines()[-1].startswith("print check: ")


@pytest.mark.parametrize("name", some_slow([], ["wing", "segments"]))
def test_plain_parts_have_the_bill_of_finished_ones_but_for_their_volume(name: str) -> None:
    """Magnets and piano hinges are bought whether or not their pockets are printed."""
    plain, whole = (bill_of(parts(name, plain=p)).items for p in (True, False))
    servos = {item.thing for item in whole} - {item.thing for item in plain}
    assert servos == {"servo"}, "the plain parts of these tests are driven nowhere"
    bought = [[(i.thing, i.count, i.mass_kg) for i in items if i.thing != "servo"][1:] for items in (plain, whole)]
    assert len(bought[0]) == (3 if name == "segments" else 2)
    assert bought[0] == bought[1]
    assert plain[0].mass_kg > whole[0].mass_kg


@pytest.mark.slow
def test_pockets_are_seen_by_the_print_check() -> None:
    """A magnet pocket so deep that half a millimetre is left under it."""
    spec = PartsSpec.model_validate(
        {"print": {"wall_mm": 0.5, "bed_mm": [450.0, 300.0, 50.0]}, "magnet": {"depth_mm": 3.3}}
    )
    made = build_parts(design("helix"), spec)
    deep = {part.id for part in made.parts for p in part.pockets if p.kind == "magnet"}
    assert deep
    for finding in print_check(made):
        if finding.check == "wall" and finding.part in deep:
            assert float(finding.value.split()[0]) < 0.7
            assert finding.at is not None


def test_the_example_says_every_key_at_its_default() -> None:
    assert load_parts_spec(EXAMPLE) == PartsSpec()
    told = tomllib.loads(EXAMPLE.read_text())
    known = PartsSpec().model_dump(by_alias=True)
    assert {key: set(value) if isinstance(value, dict) else value for key, value in told.items()} == {
        key: set(value) if isinstance(value, dict) else value for key, value in known.items()
    }


def test_a_wrong_key_is_named(tmp_path: Path) -> None:
    wrong = tmp_path / "parts.toml"
    wrong.write_text('schema = "ori-deploy/parts/1"\n[film]\nglue = 3.0\n')
    with pytest.raises(FileError, match=r"parts\.toml: key film\.glue"):
        load_parts_spec(wrong)
    wrong.write_text('schema = "ori-deploy/parts/1"\n[film]\nglue_mm = -3.0\n')
    with pytest.raises(FileError, match=r"key film\.glue_mm; found -3\.0"):
        load_parts_spec(wrong)
