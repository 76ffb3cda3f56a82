"""Panels as closed bodies: exactly the design's material, where the design has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, reject, settings
from hypothesis import strategies as st
from shapely import Polygon, points

from ori_deploy.design import ConeStructure, build
from ori_deploy.errors import CellError
from ori_deploy.export.lettering import _letters
from ori_deploy.export.parts import Part, build_parts
from ori_deploy.export.parts_spec import PartsSpec
from ori_deploy.export.workpiece import Pocket
from ori_deploy.files import Design, build_from_file
from ori_deploy.profiles import Superellipse
from ori_deploy.profiles.sphere import Vectors
from tests import shapes
from tests.export.solid_checks import assert_sound, design, driven_everywhere, material_m3, parts, some_slow

EXAMPLES = sorted(
    path
    for path in (Path(__file__).parents[2] / "examples").glob("*.toml")
    if "ori-deploy/spec/1" in path.read_text()
)


@pytest.mark.parametrize(
    "name",
    some_slow(
        ["wing", "tapered", "24 cells"],
        ["ellipse 6 without wall", "two inner vertices", "one cell", "cone elliptic 6", "cone tip", "segments"],
    ),
)
def test_plain_bodies_add_up_to_the_designs_material(name: str) -> None:
    made = parts(name, plain=True)
    assert abs(made.volume_m3 / material_m3(design(name)) - 1.0) < 1e-9
    assert_sound(made)
    assert not any(part.pockets for part in made.parts)


@pytest.mark.parametrize("name", ["wing", "ellipse 6 without wall", "two inner vertices", "one cell"])
def test_every_prism_is_its_panels_polygon_times_the_span(name: str) -> None:
    """Against the design's own polygons, sampled far finer than the skin is."""
    d = design(name)
    for part in parts(name, plain=True).parts:
        outline = d.structure.panel_outline(part.panel, 1e-9 * d.structure.profile.size)
        area = Polygon(np.column_stack([outline.real, outline.imag])).area
        assert abs(part.volume_m3 / (area * d.span_m) - 1.0) < 1e-6


@pytest.mark.parametrize("name", ["wing", "one cell", "24 cells"])
def test_the_skin_stays_within_the_chord_tolerance(name: str) -> None:
    d, spec = design(name), PartsSpec()
    for part in parts(name, plain=True).parts:
        outline = d.structure.panel_outline(part.panel, 1e-8 * d.structure.profile.size)
        true = Polygon(np.column_stack([outline.real, outline.imag]))
        off = true.exterior.distance(points(part.points[:, 0], part.points[:, 1]))
        assert off.max() <= 1e-3 * spec.print.chord_mm
        assert part.points[:, 2].min() == 0.0
        assert part.points[:, 2].max() == pytest.approx(d.span_m, rel=1e-12)


@pytest.mark.parametrize("name", some_slow(["tapered"], ["cone elliptic 6", "spiral"]))
def test_tapered_bodies_end_in_the_designs_spheres_and_keep_to_its_rays(name: str) -> None:
    d = design(name)
    assert isinstance(d.structure, ConeStructure)
    profile, chord = d.structure.profile, 1e-3 * PartsSpec().print.chord_mm
    for part in parts(name, plain=True).parts:
        away = part.points - profile.apex
        radius = np.linalg.norm(away, axis=1)
        assert radius.min() >= d.r_min_m - chord
        assert radius.max() <= d.r_max_m + chord
        rays = away / radius[:, None]
        corners = profile.to_user(d.structure.panel_outline(part.panel, 1e-6 * profile.size))
        widest = [np.arccos((a @ corners.T).min()) for a in (rays, corners)]
        assert widest[0] <= widest[1] + chord / d.r_max_m
        wanted = d.structure.panel_areas[part.panel] * (d.r_max_m**3 - d.r_min_m**3) / 3.0
        assert abs(part.volume_m3 / wanted - 1.0) < 1e-9


def test_an_apex_is_a_point_and_the_body_still_closed() -> None:
    d = design("cone tip")
    assert d.r_min_m == 0.0
    for part in parts("cone tip", plain=True).parts:
        assert np.linalg.norm(part.points - d.structure.profile.apex, axis=1).min() == 0.0  # type: ignore[union-attr]


def test_segments_fill_the_span_and_say_which_they_are() -> None:
    made = parts("segments", plain=True)
    n = design("segments").span_segments
    assert [part.id for part in made.parts[: n + 1]] == ["c1.ac.s1", "c1.ac.s2", "c1.ac.s3", "c1.cb.s1"]
    ends = np.array([[part.points[:, 2].min(), part.points[:, 2].max()] for part in made.parts[:n]])
    assert np.allclose(ends[1:, 0], ends[:-1, 1], atol=1e-12)


def test_a_panel_without_material_is_told() -> None:
    flat = Design("flat", 0.3, build(shapes.two_inner_vertices().embedding, 0.0))
    made = build_parts(flat)
    assert_sound(made)
    missing = set(flat.structure.layout.panel_ids) - {part.id for part in made.parts}
    assert missing == {remark.part for remark in made.remarks if remark.thing == "panel"}
    assert missing


EXPLORE = settings(
    suppress_health_check=[HealthCheck.too_slow],
    # Every try takes a second: shrinking would take minutes, and sizes drawn are as good as smaller ones.
    phases=[Phase.explicit, Phase.generate],
)
KINDS = ["wing", "ellipse 6 without wall", "one cell", "cone elliptic 6", "cone tip", "tapered", "helix"]


@pytest.mark.slow
@settings(EXPLORE, max_examples=5)
@given(data=st.data())
def test_whatever_is_cut_leaves_one_closed_body_and_its_volume_is_told(data: st.DataObject) -> None:
    d = design(data.draw(st.sampled_from(KINDS)))
    spec = PartsSpec.model_validate(drawn_spec(data))
    crease = data.draw(st.sampled_from(["open_c", "open_d", "close_a", "close_b"]))
    assert_sound(build_parts(d, spec, driven=driven_everywhere(d, crease)))


def drawn_spec(data: st.DataObject) -> dict[str, dict[str, float]]:
    """Sizes from sensible to silly, that do not contradict each other."""

    def mm(low: float, high: float) -> float:
        return data.draw(st.floats(low, high))

    hub, screw, wall = mm(3.0, 40.0), mm(0.5, 1.6), mm(0.1, 2.0)
    return {
        "print": {"wall_mm": wall, "chord_mm": mm(0.01, 0.2)},
        "film": {"thickness_um": mm(10.0, 800.0), "glue_mm": mm(0.5, 30.0)},
        "clearance": {
            "joint_mm": mm(0.0, 0.3),
            "slit_mm": mm(0.0, 0.3),
            "inner_mm": mm(0.0, 0.3),
            "bond_mm": mm(0.0, 0.3),
        },
        "magnet": {"diameter_mm": mm(1.0, 20.0), "depth_mm": mm(0.4, 10.0), "spacing_mm": mm(60.0, 500.0)},
        "horn": {
            "hub_diameter_mm": hub,
            "screw_circle_mm": mm(0.2, 1.0) * (hub - screw),
            "screw_diameter_mm": screw,
            "screws": 1,
            "thickness_mm": mm(0.5, 5.0),
            "clearance_mm": mm(0.0, 1.0),
        },
        "text": {"height_mm": mm(1.0, 20.0), "depth_mm": mm(0.1, 1.0)},
    }


@pytest.mark.slow
@settings(EXPLORE, max_examples=5)
@given(data=st.data())
def test_whatever_is_cut_from_whatever_shape(data: st.DataObject) -> None:
    n = data.draw(st.integers(3, 12))
    aspect, centre = data.draw(st.floats(0.5, 1.0)), data.draw(st.floats(-0.1, 0.1))
    wall = data.draw(st.sampled_from([0.0, 1e-3, 5e-3]))
    e = shapes.ring_on(Superellipse(0.15, 0.15 * aspect), n, phase=0.2, centre=(0.15 * centre, 0.0))
    try:
        structure = build(e, wall)
    except CellError:
        reject()
    d = Design("drawn", data.draw(st.floats(0.05, 0.6)), structure)
    made = build_parts(d, PartsSpec.model_validate(drawn_spec(data)), driven=driven_everywhere(d))
    assert_sound(made)
    assert abs(build_parts(d, plain=True).volume_m3 / material_m3(d) - 1.0) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=[path.stem for path in EXAMPLES])
def test_every_example_exports(path: Path) -> None:
    spec, structure = build_from_file(path)
    cut = spec.structure
    d = Design(path.stem, cut.span_m, structure, span_segments=cut.span_segments, r_min_m=cut.r_min_m)
    coarse = PartsSpec.model_validate({"print": {"chord_mm": 0.05}})
    plain = build_parts(d, coarse, plain=True)
    assert abs(plain.volume_m3 / material_m3(d) - 1.0) < 1e-9
    made = build_parts(d, coarse, driven=driven_everywhere(d))
    assert_sound(made)


@pytest.mark.parametrize("name", some_slow(["tapered"], ["wing", "cone elliptic 6"]))
def test_letters_read_the_right_way_round(name: str) -> None:
    """Also where a cone's frame is a mirror image: its apex lies above its base."""
    part = next(part for part in build_parts(design(name)).parts if part.id == "c1.ac")
    pocket = next(pocket for pocket in part.pockets if pocket.kind == "text")
    outward = part.rests[0]
    floor = letters_floor(part, pocket, outward)
    axis = np.linalg.svd(floor - floor.mean(axis=0))[2][0]
    glyphs = np.concatenate(_letters(part.id)[0])

    def misfit(right: Vectors, up: Vectors) -> float:
        seen = np.column_stack([floor @ right, floor @ up]) / 5e-3
        return float(np.linalg.norm(seen[:, None] - glyphs, axis=2).min(axis=1).max())

    up = np.cross(outward, axis)
    assert min(misfit(axis, up), misfit(-axis, -up)) < 0.1
    assert min(misfit(axis, -up), misfit(-axis, up)) > 0.1


def letters_floor(part: Part, pocket: Pocket, outward: Vectors) -> Vectors:
    """(n, 3) corners of the letters' floors, seen from their middle."""
    normal, _ = part.faces
    middle = part.points[part.triangles].mean(axis=1) - pocket.at
    deep = (normal @ outward > 1.0 - 1e-9) & (middle @ outward < -3e-4) & (middle @ outward > -5e-4)
    near = deep & (np.linalg.norm(middle, axis=1) < 0.02)
    return np.asarray(part.points[np.unique(part.triangles[near])] - pocket.at)
