"""What is cut from panels: as much as is told, at the right places, and told where it does not fit."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from shapely import LineString, Polygon
from shapely.ops import substring

from ori_deploy.errors import InputError
from ori_deploy.export.lettering import _letters
from ori_deploy.export.parts import Part, build_parts
from ori_deploy.export.parts_spec import PartsSpec
from ori_deploy.export.recesses import creases_of
from ori_deploy.export.rulings import panel_shape
from ori_deploy.files import Design
from ori_deploy.motion import CREASES
from ori_deploy.profiles.profile import Reals
from tests.export.solid_checks import WITHOUT_CLEARANCE, design, parts, some_slow


def polygon_and_faces(d: Design, panel: int, spec: PartsSpec) -> tuple[Polygon, dict[str, LineString]]:
    """A cylinder panel's polygon, and its faces as lines, counter-clockwise."""
    shape = panel_shape(d.structure, panel, 1e-3 * spec.print.chord_mm)
    assert shape is not None
    faces = {}
    for kind in ("skin", "inner", "back", "joint_open", "joint_close"):
        face = shape.face(kind, 1.0)  # type: ignore[arg-type]
        if face is not None:
            faces[kind] = LineString(face.rulings.base[:, :2])
    return Polygon(shape.points), faces


def expected_film(polygon: Polygon, face: LineString, from_end: bool, width: float, depth: float) -> float:
    """Area of what lies within `depth` of the first `width` of a face beside a crease."""
    line = LineString(face.coords[::-1]) if from_end else face
    strip = substring(line, 0.0, min(width, line.length))
    return float(strip.buffer(depth, cap_style="flat", join_style="mitre").intersection(polygon).area)


@pytest.mark.parametrize("name", some_slow(["helix"], ["wing"]))
def test_film_recesses_take_their_strips_area_times_the_span(name: str) -> None:
    d, spec = design(name), WITHOUT_CLEARANCE
    made = build_parts(d, spec)
    seen = 0
    for part in made.parts:
        polygon, faces = polygon_and_faces(d, part.panel, spec)
        for number, kind in zip(
            creases_of(part.panel), ("skin" if "skin" in faces else "back", "inner"), strict=True
        ):
            crease = f"film {d.structure.layout.cell_ids[part.panel // 4]}.{CREASES[number]}"
            cut = [pocket for pocket in part.pockets if pocket.name == crease]
            if not cut:
                assert any(r.part == part.id and r.thing == crease and r.left_out for r in made.remarks)
                continue
            area = expected_film(polygon, faces[kind], part.panel % 2 == 0, 6e-3, 1e-4)
            assert abs(cut[0].volume_m3 / (area * d.span_m) - 1.0) < 1e-6
            seen += 1
    assert seen > len(made.parts)


def test_round_pockets_marks_and_letters_take_their_area_times_their_depth() -> None:
    d, spec = design("helix"), WITHOUT_CLEARANCE
    made = build_parts(d, spec)
    magnet, mark, depth = spec.magnet, 1e-3 * spec.magnet.mark_mm, 1e-3 * spec.text.depth_mm
    expected = {
        "magnet": np.pi * (0.5e-3 * magnet.pocket_mm) ** 2 * 1e-3 * magnet.depth_mm,
        "mark +": (2.0 * 0.25 - 0.25**2) * mark**2 * depth,
        "mark −": 0.25 * mark**2 * depth,
    }
    counted = dict.fromkeys(expected, 0)
    for part in made.parts:
        for pocket in part.pockets:
            key = f"mark {pocket.name[-1]}" if pocket.kind == "mark" else pocket.kind
            if key in expected:
                assert abs(pocket.volume_m3 / expected[key] - 1.0) < 1e-6, pocket.name
                counted[key] += 1
            if pocket.kind == "text":
                loops, _ = _letters(part.id)
                area = sum(_signed_area(loop) for loop in loops) * (1e-3 * spec.text.height_mm) ** 2
                assert abs(pocket.volume_m3 / (area * depth) - 1.0) < 1e-6
    assert counted["magnet"] == counted["mark +"] + counted["mark −"] == 8


def _signed_area(loop: Reals) -> float:
    x, y = loop.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_clearance_moves_faces_that_meet_and_leaves_the_skin() -> None:
    """A convex panel less a strip along every face but its skin; where strips cross, each counts once."""
    d = design("helix")
    gaps = {"joint_mm": 0.2, "slit_mm": 0.1, "inner_mm": 0.15, "bond_mm": 0.05}
    made = build_parts(d, PartsSpec.model_validate({"clearance": gaps}))
    layout = d.structure.layout
    for part in made.parts:
        polygon, faces = polygon_and_faces(d, part.panel, made.spec)
        back = gaps["slit_mm"] if layout.is_slit[part.panel] else gaps["bond_mm"]
        taken = {
            "inner": gaps["inner_mm"],
            "joint_open": gaps["joint_mm"],
            "joint_close": gaps["joint_mm"],
            "back": back,
        }
        left = polygon
        for kind, width in taken.items():
            if kind in faces:
                left = left.difference(_long(faces[kind]).buffer(1e-3 * width, cap_style="flat"))
        told = sum(pocket.volume_m3 for pocket in part.pockets if pocket.kind == "clearance")
        assert abs((polygon.area - left.area) * d.span_m / told - 1.0) < 1e-6, part.id


def _long(line: LineString) -> LineString:
    """A straight line lengthened at both ends."""
    a, b = (np.array(p) for p in (line.coords[0], line.coords[-1]))
    return LineString([a - 0.5 * (b - a), b + 0.5 * (b - a)])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cone elliptic 6", "spiral"])
def test_films_on_cones_are_as_deep_everywhere(name: str) -> None:
    """To the corners' share: a strip's volume is its area times the film's thickness."""
    made = build_parts(
        design(name), PartsSpec.model_validate({"clearance": WITHOUT_CLEARANCE.clearance.model_dump()})
    )
    shortened = {(r.part, r.thing) for r in made.remarks}
    seen = 0
    for part in made.parts:
        for strip in part.films:
            cut = [p for p in part.pockets if p.name == f"film {strip.crease}"]
            if cut and (part.id, cut[0].name) not in shortened:
                assert cut[0].volume_m3 == pytest.approx(1e-4 * strip.area_m2, rel=0.05)
                seen += 1
    assert seen > 10


@pytest.mark.parametrize(
    "name", some_slow(["wing"], ["tapered", "cone elliptic 6", "two inner vertices", "segments"])
)
def test_magnets_of_mated_faces_coincide_and_attract(name: str) -> None:
    made = parts(name)
    found: dict[tuple[str, int], list[tuple[Part, str, Reals]]] = {}
    for part in made.parts:
        for pocket in part.pockets:
            if pocket.kind == "magnet":
                stem, sign = pocket.name[:-2], pocket.name[-1]
                found.setdefault((stem, part.segment), []).append((part, sign, pocket.at))
    assert found
    layout = design(name).structure.layout
    for (one, first, at), (other, second, there) in found.values():
        assert {first, second} == {"+", "−"}
        assert np.abs(at - there).max() < 1e-12
        assert layout.neighbour[one.panel] == other.panel
        assert layout.is_slit[one.panel]
    for slit in {stem.rsplit(" ", 1)[0] for stem, _ in found}:
        signs = [pair[0][1] for (stem, segment), pair in found.items() if stem.startswith(slit) and segment == 0]
        assert all(a != b for a, b in pairwise(signs)), "by turns along the slit"


@pytest.mark.slow
def test_a_pocket_that_does_not_fit_is_left_out_and_told() -> None:
    d = design("wing")
    spec = PartsSpec.model_validate(
        {"magnet": {"depth_mm": 4.0}, "film": {"floor_mm": 5.0}, "text": {"height_mm": 80.0}}
    )
    made = build_parts(d, spec, driven={"c1": "close_a"})
    assert not [p for part in made.parts for p in part.pockets if p.kind != "clearance"]
    told = {remark.thing.split()[0] for remark in made.remarks if remark.left_out}
    assert told == {"magnets", "film", "part", "horn"}
    line = next(str(remark) for remark in made.remarks if remark.thing.startswith("magnets"))
    assert "left out" in line
    assert "mm of panel in one place; limit: 4.80 mm over 6.8 mm; remedy: smaller or thinner magnets" in line


def test_horns_sit_about_the_driven_crease_at_the_end_of_the_span() -> None:
    d = design("helix")
    made = build_parts(d, WITHOUT_CLEARANCE, driven={"c2": "close_a"})
    with_horn = {part.id for part in made.parts for p in part.pockets if p.kind == "horn"}
    assert with_horn == {"c2.da", "c2.ac"}, "the panels on both sides of the crease"
    crease = d.structure.cells.crease[1, 2]
    for part in made.parts:
        screws = [p for p in part.pockets if p.kind == "screw"]
        assert bool(screws) == (part.id == "c2.ac"), "on the panel that follows"
        for screw in screws:
            away = complex(screw.at[0], screw.at[1]) - crease
            assert abs(away) == pytest.approx(8e-3, rel=1e-9)
            assert screw.at[2] == pytest.approx(2e-3, rel=1e-9)
            assert screw.volume_m3 == pytest.approx(np.pi * 0.8e-3**2 * 6e-3, rel=1e-6)


def test_a_driven_crease_of_another_design_is_refused() -> None:
    with pytest.raises(InputError, match=r"driven crease; found c9\.close_a; limit: c1 to c4"):
        build_parts(design("wing"), driven={"c9": "close_a"})
    with pytest.raises(InputError, match=r"found c1\.close"):
        build_parts(design("wing"), driven={"c1": "close"})


@pytest.mark.slow
def test_piano_hinges_are_let_into_both_segments_they_join() -> None:
    made = build_parts(design("segments"), WITHOUT_CLEARANCE)
    leaves = {(part.id, p.name) for part in made.parts for p in part.pockets if p.kind == "leaf"}
    assert leaves == {
        ("c1.da.s1", "leaf of h1"), ("c1.da.s2", "leaf of h1"),
        ("c2.ac.s2", "leaf of h2"), ("c2.ac.s3", "leaf of h2"),
    }  # fmt: skip
    spec = made.spec.span_hinge
    for part in made.parts:
        for leaf in (p for p in part.pockets if p.kind == "leaf"):
            section = 1e-6 * spec.leaf_width_mm * spec.leaf_thickness_mm
            assert leaf.volume_m3 == pytest.approx(leaf.length_m * section, rel=1e-6)
