"""Sheets are the films: as large as crease and glue say, with the same lines in DXF and SVG."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
from functools import cache
from typing import Any

import ezdxf
import numpy as np
import pytest
from shapely import LineString, Polygon

from ori_deploy.export.films import FREE_THICKNESSES
from ori_deploy.export.parts import Parts, build_parts
from ori_deploy.export.parts_spec import FilmSpec, PartsSpec
from ori_deploy.export.sheet_files import CUT, FOLD, GLUE, LABEL, dxf_bytes, svg_text
from ori_deploy.export.sheets import Ring, Sheet, sheets_of
from ori_deploy.export.skeleton import Skeleton
from ori_deploy.motion import CREASES
from tests.export.designs import NAMES, design
from tests.export.film_checks import STEP, Films
from tests.export.solid_checks import some_slow

SVG = "{http://www.w3.org/2000/svg}"
SPEC = PartsSpec()


@cache
def made(name: str, driven: bool = False) -> Parts:
    """Parts with the default spec, with servos at closing creases of two cells or none."""
    return build_parts(design(name), SPEC, driven={"c1": "close_a", "c2": "close_a"} if driven else {})


@cache
def sheets(name: str) -> tuple[Sheet, ...]:
    return sheets_of(made(name))


def read(sheet: Sheet) -> Any:
    return ezdxf.read(io.StringIO(dxf_bytes(sheet).decode()))


def ring_of(polyline: Any) -> Ring:
    points = np.array(list(polyline.get_points("xyb")))
    return Ring(1e-3 * points[:, :2], points[:, 2])


@pytest.mark.parametrize("name", some_slow(["wing"], [*(n for n in NAMES if n != "wing"), "segments"]))
def test_every_crease_has_a_film_of_its_length_and_width(name: str) -> None:
    d = design(name)
    segments = d.span_segments
    assert len({sheet.id for sheet in sheets(name)}) == len(sheets(name)) == 4 * d.structure.layout.n_cells * segments
    for sheet in sheets(name):
        assert sheet.width_m <= 2e-3 * SPEC.film.glue_mm * (1.0 + 1e-4)
        assert sheet.length_m <= (d.span_m - 1e-4 * (segments - 1)) / segments + 1e-9
        on_cone = name.startswith("cone") or name == "tapered"
        if on_cone and {r for r in sheet.remarks if "on, too thin" in r.value}:
            continue  # begins further out on one side
        # A sector is as wide as its radius is long.
        area = sheet.length_m * sheet.width_m * (1.0 - 0.5 * sheet.length_m / d.r_max_m if on_cone else 1.0)
        assert sheet.cut.area_m2 == pytest.approx(area, rel=1e-9)
        assert sheet.length_m == pytest.approx(d.span_m / segments, abs=2e-4 if segments > 1 else 1e-9)


@pytest.mark.parametrize("name", some_slow(["wing"], ["tapered", "cone tip", "cone elliptic 6"]))
def test_glue_lies_on_the_film_and_leaves_the_crease_free(name: str) -> None:
    free = 0.5 * FREE_THICKNESSES * 1e-6 * SPEC.film.thickness_um
    for sheet in sheets(name):
        film = Polygon(sheet.cut.corners).buffer(1e-9)
        bulge = float(np.abs(sheet.cut.bulge).max()) * sheet.width_m  # of arcs, which a polygon leaves out
        for zone in sheet.glue:
            assert film.buffer(bulge).contains(Polygon(zone.ring.corners))
            nearest = np.abs(zone.ring.corners[:, 1]).min()
            told = [r.value for r in sheet.remarks if r.part == zone.panel and "unsupported" in r.value]
            from_crease = [float(m) for text in told for m in re.findall(r"from ([0-9.]+) to", text)]
            assert 1e3 * nearest == pytest.approx(from_crease[0] if from_crease else 1e3 * free, abs=6e-3)
            assert zone.ring.area_m2 > 0.0
        assert len(sheet.glue) + sum(remark.left_out for remark in sheet.remarks) == 2
        covered = sum(zone.ring.area_m2 for zone in sheet.glue)
        assert covered < sheet.cut.area_m2 - 0.9 * free * sheet.length_m


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "driven"),
    [("wing", False), *((name, True) for name in ("helix", "wing", "tapered", "segments", "cone elliptic 6"))],
)
def test_glue_is_where_the_finished_part_has_a_recess_with_panel_under_it(name: str, driven: bool) -> None:
    """For every crease and side, in sections of finished meshes: between the places where both begin and end."""
    seen = Films(made(name, driven))
    drawn = {sheet.id: sheet for sheet in sheets_of(seen.made)}
    d, looked, shortened = design(name), 0, 0
    undriven = {sheet.id: sheet.length_m for sheet in sheets(name)}
    for part, crease in seen.sides:
        film = next((f for f in part.films if f.crease == seen.name(part, crease)), None)
        if film is None:
            continue
        sheet = drawn[film.crease + (f".s{part.segment + 1}" if d.span_segments > 1 else "")]
        both = [f for p in seen.made.parts if p.segment == part.segment for f in p.films if f.crease == film.crease]
        begins = min((f.s_low for f in both if f.glue_from_m is not None), default=0.0)
        zone = next((z for z in sheet.glue if z.panel == d.structure.layout.panel_ids[part.panel]), None)
        assert (zone is None) == (film.glue_from_m is None)
        if zone is None or film.glue_from_m is None:
            continue
        shortened += sheet.length_m < undriven[sheet.id] - 1e-3
        for s in (film.s_low + 0.003, film.s_high - (0.003 if seen.is_cylinder else 0.1 * d.span_m)):
            line = Polygon(zone.ring.corners).intersection(LineString([(s - begins, -1.0), (s - begins, 1.0)]))
            under = seen.columns(part, crease, s, 7.0)
            if under is None:
                continue
            below = 1e-3 * SPEC.film.thickness_um + (
                0.0 if CREASES[crease].startswith("open") else SPEC.clearance.inner_mm
            )
            let_in = under.x[(np.abs(under.gap - below) < 2e-3) & (under.left > SPEC.film.floor_mm - 2e-3)]
            glued = let_in[let_in >= 1e3 * film.glue_from_m - STEP]
            if line.is_empty:
                assert len(glued) <= 2
                continue
            ends = np.sort(np.abs([1e3 * line.bounds[1], 1e3 * line.bounds[3]]))
            assert np.array([glued.min(), glued.max()]) == pytest.approx(ends, abs=0.06), (part.id, film.crease, s)
            assert len(glued) * STEP == pytest.approx(ends[1] - ends[0], abs=0.06)
            looked += 1
    assert looked >= 8
    names = {seen.name(*side) for side in seen.sides}
    assert bool(shortened) == bool(names & set(seen.made.mounted))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wing", "cone elliptic 6"])
def test_a_film_ends_where_a_horn_s_recess_begins(name: str) -> None:
    """On the driven crease; beyond the film's end there is nothing under all of it."""
    parts = made(name, True)
    seen, horn = Films(parts), SPEC.horn
    assert "c2.close_a" in parts.mounted
    deep = 1e-3 * (horn.thickness_mm + horn.clearance_mm)
    with_horn, without = (
        {sheet.id: sheet for sheet in sheets_of(each)}["c2.close_a"] for each in (parts, made(name))
    )
    assert deep - 1e-5 <= without.length_m - with_horn.length_m <= deep + 2e-3 * horn.clearance_mm
    for part in parts.parts:
        for film in (f for f in part.films if f.crease == "c2.close_a" and f.glue_from_m is not None):
            assert film.s_low > deep - 1e-9 or film.s_high < design(name).r_max_m - deep + 1e-9
            if seen.is_cylinder:
                over = seen.columns(part, CREASES.index("close_a"), 0.5 * film.s_low, 7.0)
                assert over is None or (over.gap[over.x < 5.9] > 1.0).all()


def test_glue_zones_name_the_two_panels_of_the_crease() -> None:
    panels = {
        "open_c": {"c1.ac", "c1.cb"}, "open_d": {"c1.bd", "c1.da"}, "close_a": {"c1.ac", "c1.da"},
        "close_b": {"c1.cb", "c1.bd"},
    }  # fmt: skip
    by_id = {sheet.id: sheet for sheet in sheets("wing")}
    for crease, both in panels.items():
        sheet = by_id[f"c1.{crease}"]
        assert {zone.panel for zone in sheet.glue} | {r.part for r in sheet.remarks if r.left_out} == both
    # Seen from outside, span to the right: what comes first counter-clockwise is above; the other way from inside.
    assert by_id["c1.open_c"].glue[0].panel == "c1.ac"
    assert by_id["c1.close_a"].glue[0].panel == "c1.ac"


@pytest.mark.parametrize("name", some_slow(["wing"], ["tapered", "cone elliptic 6", "two inner vertices"]))
def test_a_sheet_is_what_one_sees_from_the_side_to_which_its_crease_folds(name: str) -> None:
    skeleton = Skeleton(design(name))
    ids, centroid = skeleton.layout.panel_ids, skeleton.solids.centroid
    for sheet in sheets(name):
        cell = skeleton.layout.cell_ids.index(sheet.id.split(".")[0])
        number = skeleton.crease_names[cell].index(sheet.id)
        near, far = skeleton.crease_ends[cell, number]
        inwards = skeleton.crease_ends[cell].mean(axis=(0, 1)) - 0.5 * (near + far)
        towards_eye = -inwards if "open" in sheet.id else inwards
        up = np.cross(towards_eye, far - near)  # the crease runs to the right
        heights = [float((centroid[ids.index(zone.panel)] - near) @ up) for zone in sheet.glue]
        assert heights == sorted(heights, reverse=True)
        drawn = [float(zone.ring.corners[:, 1].mean()) for zone in sheet.glue]
        assert drawn == sorted(drawn, reverse=True)


def test_a_crease_without_a_hinge_on_a_panel_is_told_with_what_can_help() -> None:
    told = {str(remark) for sheet in sheets("wing") for remark in sheet.remarks if remark.left_out}
    assert told == {str(r) for r in made("wing").remarks if r.thing.startswith("film") and r.left_out}
    (narrow,) = (line for line in told if line.startswith("c4.ac"))
    assert narrow == (
        "c4.ac: film c4.open_c left out; found 0.25 mm to glue to; limit: more than 1 mm, where it has to be free to "
        "bend, with 0.3 mm of panel: film and film.floor_mm; remedy: a film cut wider and glued over the bonded "
        "neighbour c3.da by hand, a thicker wall_m in the specification, or another layout"
    )
    assert design("wing").structure.layout.neighbour[4 * 3] == 4 * 2 + 3
    assert not design("wing").structure.layout.is_slit[4 * 3]


def test_free_length_grows_with_the_film() -> None:
    thick = PartsSpec(film=FilmSpec(thickness_um=200.0))
    for spec, free in ((SPEC, 1e-3), (thick, 2e-3)):
        zone = sheets_of(build_parts(design("helix"), spec))[2].glue[0]
        assert zone.ring.corners[:, 1].min() == pytest.approx(free)


@pytest.mark.parametrize("name", some_slow(["wing"], ["tapered", "cone tip", "segments"]))
def test_dxf_read_back_is_the_sheet_in_millimetres(name: str) -> None:
    for sheet in sheets(name)[:6]:
        drawing = read(sheet)
        assert drawing.units == ezdxf.units.MM
        assert not drawing.audit().errors
        space = drawing.modelspace()
        (cut,) = space.query(f'LWPOLYLINE[layer=="{CUT}"]')
        assert cut.closed
        assert ring_of(cut).area_m2 == pytest.approx(sheet.cut.area_m2, rel=1e-12)
        glue = space.query(f'LWPOLYLINE[layer=="{GLUE}"]')
        assert [ring_of(each).area_m2 for each in glue] == pytest.approx([z.ring.area_m2 for z in sheet.glue])
        (fold,) = space.query(f'LINE[layer=="{FOLD}"]')
        assert fold.dxf.start.distance(fold.dxf.end) == pytest.approx(1e3 * sheet.length_m)
        texts = [each.dxf.text for each in space.query(f'TEXT[layer=="{LABEL}"]')]
        assert [zone.panel in text for zone, text in zip(sheet.glue, texts, strict=True)] == [True] * len(texts)
        assert sheet.id in texts[0]


@pytest.mark.parametrize("name", ["wing", "tapered", "cone tip"])
def test_svg_is_true_to_size_and_its_paths_are_the_dxf_s(name: str) -> None:
    for sheet in sheets(name)[:6]:
        root = ET.fromstring(svg_text(sheet))
        box = [float(v) for v in root.attrib["viewBox"].split()]
        assert root.attrib["width"] == f"{box[2]:.6g}mm"
        assert root.attrib["height"] == f"{box[3]:.6g}mm"
        assert box[2] == pytest.approx(1e3 * sheet.length_m + 10.0, abs=0.2)
        groups = {group.attrib["id"]: group for group in root.iter(f"{SVG}g")}
        assert set(groups) == {"cut", "fold", "glue", "label"}
        (path,) = groups["cut"]
        assert path_area(path.attrib["d"]) == pytest.approx(1e6 * sheet.cut.area_m2, rel=1e-4)
        assert [path_area(p.attrib["d"]) for p in groups["glue"]] == pytest.approx(
            [1e6 * zone.ring.area_m2 for zone in sheet.glue], rel=2e-4, abs=1e-2
        )
        (fold,) = groups["fold"]
        assert float(fold.attrib["x2"]) - float(fold.attrib["x1"]) == pytest.approx(1e3 * sheet.length_m, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wing", "tapered", "cone tip"])
def test_sheets_are_as_large_as_the_film_that_the_parts_are_covered_by(name: str) -> None:
    covered: dict[str, float] = {}
    on_cone = name != "wing"
    for part in made(name).parts:
        for film in part.films:
            both = [f for p in made(name).parts for f in p.films if f.crease == film.crease]
            ends = (
                film if film.glue_from_m is not None else next((f for f in both if f.glue_from_m is not None), film)
            )
            length = 0.5 * (ends.s_high**2 - ends.s_low**2) if on_cone else ends.s_high - ends.s_low
            covered[film.crease] = covered.get(film.crease, 0.0) + film.reach * length
    assert {sheet.id: sheet.cut.area_m2 for sheet in sheets(name)} == pytest.approx(covered, rel=1e-9)


def path_area(d: str) -> float:
    """What a path of M, L and A commands encloses, by what SVG says they mean."""
    words = d.split()
    here, start, area = np.zeros(2), np.zeros(2), 0.0
    while words:
        word = words.pop(0)
        if word == "Z":
            end = start
        elif word == "A":
            radius, _, _, large, sweep = (float(words.pop(0)) for _ in range(5))
            end = np.array([float(words.pop(0)), float(words.pop(0))])
            angle = 2.0 * np.arcsin(min(1.0, 0.5 * float(np.linalg.norm(end - here)) / radius))
            angle = 2.0 * np.pi - angle if large else angle
            # With y downwards, sweep = 1 goes with the clock seen on paper: that is positive in these axes.
            area += (1.0 if sweep else -1.0) * 0.5 * radius**2 * (angle - np.sin(angle))
        else:
            end = np.array([float(words.pop(0)), float(words.pop(0))])
            start = end if word == "M" else start
            here = end if word == "M" else here
        area += 0.5 * float(here[0] * end[1] - here[1] * end[0])
        here = end
    return -area
