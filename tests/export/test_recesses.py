"""What is cut from panels: as much as is told, at the right places, and told where it does not fit."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from shapely import LineString, Polygon

from ori_deploy.design import ConeStructure
from ori_deploy.errors import InputError
from ori_deploy.export.lettering import _letters
from ori_deploy.export.parts import Part, build_parts
from ori_deploy.export.parts_spec import PartsSpec
from ori_deploy.export.rulings import panel_shape
from ori_deploy.export.workpiece import FilmStrip
from ori_deploy.files import Design
from ori_deploy.motion import CREASES
from ori_deploy.profiles.profile import Reals
from tests.export.film_checks import STEP, Films
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


@cache
def films(name: str, clear: bool) -> Films:
    return Films(build_parts(design(name), PartsSpec() if clear else WITHOUT_CLEARANCE))


def stations(d: Design) -> list[float]:
    """Places along the span where films are let in and nothing else is: before the first magnet, and at the end."""
    if isinstance(d.structure, ConeStructure):
        return [d.r_min_m + 0.008, d.r_min_m + 0.5 * d.span_m, d.r_min_m + 0.9 * d.span_m]
    return [0.008, d.span_m - 0.008]


SHAPES = some_slow(
    [], ["wing", "helix", "two inner vertices", "ellipse 6 without wall", "tapered", "cone elliptic 6"]
)


@pytest.mark.parametrize("clear", [False, True])
@pytest.mark.parametrize("name", SHAPES)
def test_wherever_a_film_is_let_in_its_depth_is_taken_and_the_floor_is_left(name: str, clear: bool) -> None:
    """In sections of finished meshes, below every place; depths count from the finished face."""
    seen = films(name, clear)
    spec = seen.made.spec
    depth, found = 1e-3 * spec.film.thickness_um, 0
    for part, crease in seen.sides:
        opening = CREASES[crease].startswith("open")
        film = next((f for f in part.films if f.crease == seen.name(part, crease)), None)
        for s in stations(seen.made.design):
            under = seen.columns(part, crease, s, 7.0)
            if under is None or film is None:
                continue  # an opening crease where no skin is left
            # Below the skin there is no clearance. Beside a joint with clearance there is air, not a recess.
            below = depth if opening else depth + spec.clearance.inner_mm
            let_in = (under.left > 0.0) & (np.abs(under.gap - below) < 2e-3 if clear else under.gap > 0.5 * below)
            found += int(let_in.sum())
            assert (under.left[let_in] >= spec.film.floor_mm - 2e-3).all(), (part.id, film.crease, s)
            if film.glue_from_m is None and not clear:
                assert not let_in.any()
    assert found > 100 * len(seen.made.parts)


@pytest.mark.parametrize("name", SHAPES)
def test_a_recess_lies_on_the_side_to_which_its_crease_folds_and_nowhere_else(name: str) -> None:
    """Opening creases' on the outline of all panels, closing ones' in the void; all that is cut is found there."""
    seen = films(name, False)
    skins, s = 0, stations(seen.made.design)[0]
    for part in {part.id: part for part, _ in seen.sides}.values():
        both = {crease: seen.columns(part, crease, s, 7.0) for each, crease in seen.sides if each is part}
        if any(under is None for under in both.values()):
            continue
        taken = 0.0
        for crease, under in both.items():
            assert under is not None
            film = next((f for f in part.films if f.crease == seen.name(part, crease)), None)
            gone = under.left == 0.0
            taken += STEP * float(np.where(gone, under.before, under.gap).sum())
            if film is not None and film.glue_from_m is not None and film.s_low <= s <= film.s_high:
                first, last = extent(seen, film, s)
                inside = (under.x > first + STEP) & (under.x < last - STEP)
                assert inside.sum() > 3 or last - first < 4.0 * STEP
                assert (np.abs(under.gap[inside] - 0.1) < 2e-3).all(), (part.id, film.crease)
                skins += CREASES[crease].startswith("open")
        # On a cone the plane across one crease cuts the other's recess at a slant.
        slant = 0.04 if seen.is_cylinder else 0.15
        assert taken == pytest.approx(seen.cut_mm2(part, s), rel=slant, abs=0.02), part.id
    assert skins >= 2


def extent(seen: Films, film: FilmStrip, s: float) -> tuple[float, float]:
    """From where to where a film is glued, millimetres from the crease."""
    assert film.glue_from_m is not None
    return 1e3 * film.glue_from_m, 1e3 * film.reach * (1.0 if seen.is_cylinder else s)


@pytest.mark.parametrize("name", ["wing", pytest.param("ellipse 6 without wall", marks=pytest.mark.slow)])
def test_a_film_over_more_than_its_free_length_is_told(name: str) -> None:
    seen = films(name, True)
    told = {(r.part, r.thing) for r in seen.made.remarks if "unsupported" in r.value}
    assert told
    for part in seen.made.parts:
        for film in part.films:
            far = film.glue_from_m is not None and film.glue_from_m > 1.0e-3
            assert far == ((part.id, f"film {film.crease}") in told)


@pytest.mark.parametrize("name", ["wing", pytest.param("ellipse 6 without wall", marks=pytest.mark.slow)])
def test_folded_flat_no_film_on_an_inner_face_holds_two_panels_apart(name: str) -> None:
    """Where a closing crease's film is, free or glued, the panel is as far below the plain face as it takes."""
    seen = films(name, True)
    needed, looked = 1e-3 * seen.made.spec.film.thickness_um + seen.made.spec.clearance.inner_mm, 0
    for part, crease in seen.sides:
        film = next((f for f in part.films if f.crease == seen.name(part, crease)), None)
        if CREASES[crease].startswith("open") or film is None or film.glue_from_m is None:
            continue
        under = seen.columns(part, crease, stations(seen.made.design)[0], 1e3 * film.reach - STEP)
        assert under is not None
        assert ((under.gap >= needed - 2e-3) | (under.left == 0.0)).all(), (part.id, film.crease)
        looked += 1
    assert looked >= len(seen.made.parts) // 2


def test_round_pockets_marks_and_letters_take_their_area_times_their_depth() -> None:
    d, spec = design("helix"), WITHOUT_CLEARANCE
    made = build_parts(d, spec)
    magnet, mark, depth = spec.magnet, 1e-3 * spec.magnet.mark_mm, 1e-3 * spec.text.depth_mm
    expected = {
        "magnet": np.pi * (0.5e-3 * magnet.pocket_mm) ** 2 * 1e-3 * magnet.pocket_depth_mm,
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
                # A thin edge that is taken off, narrower than half a millimetre, comes on top.
                edge = 0.5e-3 * 0.5e-3 * strip.length_m
                assert 0.95e-4 * strip.area_m2 < cut[0].volume_m3 < 1.05e-4 * strip.area_m2 + edge
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
    assert "mm of panel in one place; limit: 4.90 mm over 6.8 mm; remedy: smaller or thinner magnets" in line


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
