"""Sheets are the films: as large as crease and glue say, with the same lines in DXF and SVG."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from typing import Any

import ezdxf
import numpy as np
import pytest
from shapely import Polygon

from ori_deploy.export.parts import build_parts
from ori_deploy.export.parts_spec import FilmSpec, PartsSpec
from ori_deploy.export.sheet_files import CUT, FOLD, GLUE, LABEL, dxf_bytes, svg_text
from ori_deploy.export.sheets import FREE_THICKNESSES, Ring, Sheet, sheets_of
from ori_deploy.export.skeleton import Skeleton
from tests.export.designs import NAMES, design

SVG = "{http://www.w3.org/2000/svg}"
SPEC = PartsSpec()


def read(sheet: Sheet) -> Any:
    return ezdxf.read(io.StringIO(dxf_bytes(sheet).decode()))


def ring_of(polyline: Any) -> Ring:
    points = np.array(list(polyline.get_points("xyb")))
    return Ring(1e-3 * points[:, :2], points[:, 2])


@pytest.mark.parametrize("name", [*NAMES, "segments"])
def test_every_crease_has_a_film_of_its_length_and_width(name: str) -> None:
    made = design(name)
    sheets = sheets_of(made, SPEC)
    segments = made.span_segments
    assert len({sheet.id for sheet in sheets}) == len(sheets) == 4 * made.structure.layout.n_cells * segments
    for sheet in sheets:
        area = sheet.length_m * sheet.width_m
        if name.startswith("cone") or name == "tapered":
            area *= 0.5 * (1.0 + made.r_min_m / made.r_max_m)  # a sector is as wide as its radius is long
        assert sheet.cut.area_m2 == pytest.approx(area, rel=1e-9)
        assert sheet.width_m <= 2e-3 * SPEC.film.glue_mm * (1.0 + 1e-4)
    assert sum(s.length_m for s in sheets) == pytest.approx(
        4 * made.structure.layout.n_cells * (made.span_m - 2e-4 * (segments - 1)), rel=1e-12
    )


@pytest.mark.parametrize("name", ["wing", "tapered", "cone tip", "cone elliptic 6"])
def test_glue_lies_on_the_film_and_leaves_the_crease_free(name: str) -> None:
    free = 0.5 * FREE_THICKNESSES * 1e-6 * SPEC.film.thickness_um
    for sheet in sheets_of(design(name), SPEC):
        film = Polygon(sheet.cut.corners).buffer(1e-9)
        bulge = float(np.abs(sheet.cut.bulge).max()) * sheet.width_m  # of arcs, which a polygon leaves out
        for zone in sheet.glue:
            assert film.buffer(bulge).contains(Polygon(zone.ring.corners))
            assert np.abs(zone.ring.corners[:, 1]).min() == pytest.approx(free)
            assert zone.ring.area_m2 > 0.0
        assert len(sheet.glue) + len(sheet.remarks) == 2
        covered = sum(zone.ring.area_m2 for zone in sheet.glue)
        assert covered < sheet.cut.area_m2 - 0.9 * free * sheet.length_m


def test_glue_zones_name_the_two_panels_of_the_crease() -> None:
    panels = {
        "open_c": {"c1.ac", "c1.cb"}, "open_d": {"c1.bd", "c1.da"}, "close_a": {"c1.ac", "c1.da"},
        "close_b": {"c1.cb", "c1.bd"},
    }  # fmt: skip
    sheets = {sheet.id: sheet for sheet in sheets_of(design("wing"), SPEC)}
    for crease, both in panels.items():
        sheet = sheets[f"c1.{crease}"]
        assert {zone.panel for zone in sheet.glue} | {remark.part for remark in sheet.remarks} == both
    # Seen from outside, span to the right: what comes first counter-clockwise is above; the other way from inside.
    assert sheets["c1.open_c"].glue[0].panel == "c1.ac"
    assert sheets["c1.close_a"].glue[0].panel == "c1.ac"


@pytest.mark.parametrize("name", ["wing", "tapered", "cone elliptic 6", "two inner vertices"])
def test_a_sheet_is_what_one_sees_from_the_side_to_which_its_crease_folds(name: str) -> None:
    skeleton = Skeleton(design(name))
    ids, centroid = skeleton.layout.panel_ids, skeleton.solids.centroid
    for sheet in sheets_of(design(name), SPEC):
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


def test_a_face_too_narrow_to_glue_to_is_told() -> None:
    remarks = [str(remark) for sheet in sheets_of(design("wing"), SPEC) for remark in sheet.remarks]
    assert len(remarks) == 1
    assert remarks[0].startswith(
        "c4.ac: glue of film c4.open_c left out; found 0.25 mm of face; limit: more than 1 mm"
    )


def test_free_length_grows_with_the_film() -> None:
    thick = PartsSpec(film=FilmSpec(thickness_um=200.0))
    for spec, free in ((SPEC, 1e-3), (thick, 2e-3)):
        zone = sheets_of(design("wing"), spec)[2].glue[0]
        assert zone.ring.corners[:, 1].min() == pytest.approx(free)


@pytest.mark.parametrize("name", ["wing", "tapered", "cone tip", "segments"])
def test_dxf_read_back_is_the_sheet_in_millimetres(name: str) -> None:
    for sheet in sheets_of(design(name), SPEC)[:6]:
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
    for sheet in sheets_of(design(name), SPEC)[:6]:
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
    for part in build_parts(design(name), SPEC, plain=True).parts:
        for strip in part.films:
            covered[strip.crease] = covered.get(strip.crease, 0.0) + strip.area_m2
    cut = {sheet.id: sheet.cut.area_m2 for sheet in sheets_of(design(name), SPEC)}
    # On a cone the parts tell widths along the facets' chords, the sheets along arcs about the apex.
    assert cut == pytest.approx(covered, rel=0.03 if name == "cone tip" else 1e-4)


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
