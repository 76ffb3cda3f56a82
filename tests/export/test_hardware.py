"""Bought things in printed parts: horns, magnets, piano hinges as bodies of their own, against finished parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from itertools import pairwise
from typing import Any

import manifold3d
import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from ori_deploy.errors import InputError
from ori_deploy.export.hub_room import distances
from ori_deploy.export.kernel import closed, punch
from ori_deploy.export.parts import Part, Parts, _blanks, build_parts
from ori_deploy.export.parts_spec import PartsSpec, SpanHingeSpec
from ori_deploy.export.print_check import walls
from ori_deploy.export.skeleton import Skeleton
from ori_deploy.export.workpiece import Cut, Pocket, take_together
from ori_deploy.files import Design
from ori_deploy.motion import CREASES, NEXT_CREASE, Mechanism, SpanFolding
from ori_deploy.profiles.sphere import Vectors
from tests.export.solid_checks import assert_sound, design, driven_everywhere, parts, some_slow

MM3 = 1e-9

SMALL: dict[str, Any] = {
    "horn": {"hub_diameter_mm": 8.0, "screw_circle_mm": 6.0, "screws": 4, "screw_diameter_mm": 1.0}
}
"""A horn that several neighbours can have at once."""


@cache
def small(name: str) -> Parts:
    d = design(name)
    return build_parts(d, PartsSpec.model_validate(SMALL), driven=driven_everywhere(d))


def made_for(name: str, horn: str) -> Parts:
    return parts(name) if horn == "default" else small(name)


@cache
def bodies(made_name: str, horn: str) -> tuple[tuple[Part, Any], ...]:
    return tuple((part, closed(part.points, part.triangles)) for part in made_for(made_name, horn).parts)


def cylinder(base: Vectors, axis: Vectors, radius: float, length: float) -> Any:
    """From a base along an axis; by manifold's own cylinder, its corners on the circle."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    right = np.cross(other, axis)
    right /= np.linalg.norm(right)
    frame = np.column_stack([right, np.cross(axis, right), axis, base])
    return manifold3d.Manifold.cylinder(length, radius, radius, 96).transform(frame)


def hubs(made: Parts) -> Iterator[tuple[str, int, Vectors, Vectors]]:
    """Of every mounted horn: its crease, the panel it turns with, where its floor is and which way it stands out."""
    skeleton = Skeleton(made.design)
    for name in made.mounted:
        cell, crease = name.split(".")
        number, index = skeleton.layout.cell_ids.index(cell), CREASES.index(crease)
        near, far = skeleton.crease_ends[number, index]
        outward = (far - near) / np.linalg.norm(far - near)
        end = far
        if isinstance(skeleton.linkage, Mechanism):
            outward, end = -outward, near
        deep = 1e-3 * (made.spec.horn.thickness_mm + made.spec.horn.clearance_mm)
        panel = 4 * number + (NEXT_CREASE.index(index) + 1) % 4
        yield name, panel, end - deep * outward, outward


def met(
    made: Parts, solids: tuple[tuple[Part, Any], ...], radius_m: float, thick_m: float, folds: Any
) -> dict[tuple[str, str], float]:
    """Volumes, cubic millimetres, that hubs share with parts at some fold, by crease and part."""
    poses = Skeleton(made.design).poses(folds)
    found: dict[tuple[str, str], float] = {}
    for name, panel, floor, outward in hubs(made):
        hub = cylinder(floor + 1e-6 * outward, outward, radius_m, thick_m)
        for part, solid in solids:
            for pose in poses:
                seen = np.linalg.inv(pose[part.panel]) @ pose[panel]
                volume = float((hub.transform(seen[:3]) ^ solid).volume()) / MM3
                if volume > 1e-3:
                    found[name, part.id] = max(volume, found.get((name, part.id), 0.0))
    return found


@pytest.mark.parametrize(
    ("name", "horn"),
    [
        ("helix", "default"),
        *(
            pytest.param(n, "default", marks=pytest.mark.slow)
            for n in ("wing", "segments", "two inner vertices", "tapered", "spiral", "cone tip")
        ),
        *(pytest.param(n, "small", marks=pytest.mark.slow) for n in ("helix", "cone elliptic 6")),
    ],
)
def test_horns_meet_no_part_at_any_fold(name: str, horn: str) -> None:
    """At folds drawn at random, not those that way was cut for."""
    made = made_for(name, horn)
    assert made.mounted
    folds = np.concatenate([[0.0, 1.0], np.random.default_rng(3).uniform(0.0, 1.0, 14)])
    spec = made.spec.horn
    size = 0.5e-3 * spec.hub_diameter_mm, 1e-3 * spec.thickness_mm
    assert met(made, bodies(name, horn), *size, folds) == {}
    # The same look finds a hub that is as much too large as its recess allows, and a little more.
    large = size[0] + 1e-3 * spec.clearance_mm + 2e-4
    assert met(made, bodies(name, horn), large, size[1], folds[:2])


@pytest.mark.parametrize("name", some_slow(["helix"], ["ellipse 6 without wall", "spiral"]))
def test_horns_that_are_mounted_keep_away_from_each_other(name: str) -> None:
    made = parts(name)
    skeleton = Skeleton(made.design)
    poses = skeleton.poses(np.linspace(0.0, 1.0, 33))
    places = {}
    for crease, panel, floor, _ in hubs(made):
        places[crease] = np.einsum("fij,j->fi", poses[:, panel], [*floor, 1.0])[:, :3]
    told = {r.thing for r in made.remarks if r.thing.startswith("horn") and r.left_out}
    for cell in made.driven:
        assert (f"{cell}.close_a" in places) != (f"horn {cell}.close_a" in told), "mounted, or told"
    keys = list(places)
    for i, one in enumerate(keys):
        for other in keys[:i]:
            assert np.linalg.norm(places[one] - places[other], axis=1).min() > 1e-3 * made.spec.horn.hub_diameter_mm
    if name == "helix":
        assert keys == ["c1.close_a"]
        line = next(str(r) for r in made.remarks if r.thing == "horn c2.close_a")
        assert "found 8.05 mm from horn c1.close_a" in line
        assert "limit: 20.40 mm: horn.hub_diameter_mm" in line


def test_servos_whose_bodies_could_meet_are_told() -> None:
    d = design("helix")
    mounted = {}
    for reach in (0.0, 7.5):
        spec = PartsSpec.model_validate(SMALL | {"servo": {"reach_mm": reach}})
        made = build_parts(d, spec, driven=driven_everywhere(d))
        mounted[reach] = made.mounted
        told = [r for r in made.remarks if r.thing.startswith("horn")]
        assert len(told) == 6 - len(made.mounted)
        assert all(f"{max(8.4, 2.0 * reach):.2f} mm" in r.limit for r in told)
    # Creases 8.05, 13.95 and 16.11 mm apart: every second one, and opposite ones.
    assert mounted == {0.0: ("c1.close_a", "c3.close_a", "c5.close_a"), 7.5: ("c1.close_a", "c4.close_a")}


def test_distances_of_outlines_are_shapelys() -> None:
    rng = np.random.default_rng(8)
    seen = 0
    for _ in range(200):
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 7))
        star = rng.uniform(0.2, 1.0, 7)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        star += rng.uniform(-1.5, 1.5, 2)
        polygon = shapely.Polygon(star)
        if not polygon.is_valid:
            continue
        wanted = polygon.distance(shapely.Point(0.0, 0.0))
        seen += wanted == 0.0
        assert distances(star[None])[0] == pytest.approx(wanted, abs=1e-12)
    assert 5 < seen < 195


def test_horns_sit_about_the_driven_crease_at_the_end_of_the_span() -> None:
    d = design("helix")
    made = build_parts(d, driven={"c2": "close_a"})
    assert made.mounted == ("c2.close_a",)
    assert_sound(made)
    crease = d.structure.cells.crease[1, 2]
    spec = made.spec.horn
    at_rest = {part.id for part in made.parts for p in part.pockets if p.name == "horn c2.close_a"}
    assert at_rest == {"c2.da", "c2.ac", "c1.da", "c3.ac"}, "both panels at the crease and those bonded to them"
    for part in made.parts:
        screws = [p for p in part.pockets if p.kind == "screw"]
        assert bool(screws) == (part.id == "c2.ac"), "on the panel that follows"
        for screw in screws:
            away = complex(screw.at[0], screw.at[1]) - crease
            assert abs(away) == pytest.approx(0.5e-3 * spec.screw_circle_mm, rel=1e-9)
            assert screw.at[2] == pytest.approx(1e-3 * (spec.thickness_mm + spec.clearance_mm), rel=1e-9)
            assert screw.volume_m3 == pytest.approx(np.pi * 0.8e-3**2 * 6e-3, rel=1e-6)


@settings(max_examples=4)
@example(screws=7)
@example(screws=16)
@given(screws=st.integers(1, 24))
def test_screws_are_where_the_horns_holes_are(screws: int) -> None:
    """Whichever are drilled stand whole steps of the horn's circle apart: read from a section of the solid."""
    horn = {"screws": screws, "hub_diameter_mm": 100.0, "screw_circle_mm": 90.0, "depth_mm": 2.0}
    d = design("one cell")
    made = build_parts(d, PartsSpec.model_validate({"horn": horn}), driven={"c1": "close_a"})
    part = next(part for part in made.parts if part.id == "c1.ac")
    z = 1e-3 * (made.spec.horn.thickness_mm + made.spec.horn.clearance_mm + 1.0)
    rings = [shapely.Polygon(ring[:, :2]) for ring in part.mesh().section([0.0, 0.0, 1.0], [0.0, 0.0, z]).discrete]
    hole = 0.25 * np.pi * (1e-3 * made.spec.horn.screw_diameter_mm) ** 2
    centres = [ring.centroid for ring in rings if 0.9 * hole < ring.area < 1.1 * hole]
    assert len(centres) == sum(pocket.kind == "screw" for pocket in part.pockets)
    assert len(centres) >= max(1, screws // 3)
    away = np.array([complex(centre.x, centre.y) for centre in centres]) - d.structure.cells.crease[0, 2]
    np.testing.assert_allclose(np.abs(away), 45e-3, rtol=1e-6)
    steps = np.angle(away / away[0]) * screws / (2.0 * np.pi)
    np.testing.assert_allclose(steps, np.round(steps), rtol=0.0, atol=1e-5)
    assert len({int(step) % screws for step in np.round(steps)}) == len(centres)


@pytest.mark.slow
def test_a_horn_without_a_panel_is_told() -> None:
    from ori_deploy.design import build
    from tests import shapes

    flat = Design("flat", 0.3, build(shapes.two_inner_vertices().embedding, 0.0))
    layout = flat.structure.layout
    missing = {r.part for r in build_parts(flat, plain=True).remarks}
    told = {}
    for crease in CREASES:
        made = build_parts(flat, driven=driven_everywhere(flat, crease))
        told[crease] = [r for r in made.remarks if r.thing.startswith("horn") and "no panel" in r.value]
        k = NEXT_CREASE.index(CREASES.index(crease))
        for cell in range(layout.n_cells):
            pair = {layout.panel_ids[4 * cell + j % 4] for j in (k, k + 1)}
            name = f"horn {layout.cell_ids[cell]}.{crease}"
            assert bool(pair & missing) == any(r.thing == name for r in told[crease])
    assert any(told.values())


@pytest.mark.parametrize("name", some_slow(["one cell"], ["cone elliptic 6", "two inner vertices"]))
def test_bolts_of_a_servo_are_drilled_where_they_fit_and_told_where_not(name: str) -> None:
    d = design(name)
    pattern = [[8.0, 0.0], [-8.0, 0.0], [0.0, 14.0]]
    spec = PartsSpec.model_validate(SMALL | {"servo": {"bolts_mm": pattern}})
    made = build_parts(d, spec, driven=driven_everywhere(d))
    assert_sound(made)
    skeleton = Skeleton(d)
    seen = 0
    for name_, panel, _, outward in hubs(made):
        before = panel // 4 * 4 + (panel % 4 - 1) % 4
        part = next(p for p in made.parts if p.panel == before)
        bolts = [p for p in part.pockets if p.kind == "bolt" and name_ in p.name]
        told = [r for r in made.remarks if r.thing.startswith(f"servo {name_}")]
        assert len(bolts) == 3 or told[0].thing.startswith(f"servo {name_}: {3 - len(bolts)} of 3")
        cell, crease = name_.split(".")
        ends = skeleton.crease_ends[skeleton.layout.cell_ids.index(cell), CREASES.index(crease)]
        end = ends[0 if isinstance(skeleton.linkage, Mechanism) else 1]
        for bolt in bolts:
            seen += 1
            x, y = pattern[int(bolt.name.split()[1]) - 1]
            assert np.linalg.norm(bolt.at - end) == pytest.approx(1e-3 * np.hypot(x, y), rel=1e-6)
            assert (bolt.at - end) @ outward == pytest.approx(0.0, abs=1e-9)
            assert bolt.volume_m3 == pytest.approx(np.pi * 1e-3**2 * 8e-3, rel=0.15), "an end may be a sphere"
    assert seen


# --- magnets ------------------------------------------------------------------------------------------


def magnets(made: Parts) -> Iterator[tuple[Part, Pocket]]:
    for part in made.parts:
        for pocket in part.pockets:
            if pocket.kind == "magnet":
                yield part, pocket


MAGNETS = some_slow(["wing", "helix"], ["tapered", "cone elliptic 6", "two inner vertices", "segments"])


@pytest.mark.parametrize("name", MAGNETS)
def test_magnets_meet_no_part_and_end_below_the_finished_face(name: str) -> None:
    made = parts(name)
    spec = made.spec.magnet
    seen = 0
    for part, pocket in magnets(made):
        magnet = cylinder(pocket.floor[0], -pocket.into, 0.5e-3 * spec.diameter_mm, 1e-3 * spec.depth_mm)
        for other, solid in bodies(name, "default"):
            assert float((magnet ^ solid).volume()) < 1e-4 * MM3, f"{pocket.name} in {other.id}"
        # The finished face, from the mesh: of all triangles parallel to the floor those that stand out furthest.
        normal, _ = part.faces
        middle = part.points[part.triangles].mean(axis=1)
        height = (middle - pocket.floor[0]) @ -pocket.into
        level = float(height[normal @ -pocket.into > 1.0 - 1e-9].max())
        assert level - 1e-3 * spec.depth_mm == pytest.approx(1e-3 * spec.axial_mm, abs=1e-7)
        seen += 1
    assert seen > 3


def left_under(part: Part, floor: Vectors, into: Vectors) -> float:
    """What a section of the finished mesh, through a floor, leaves under it: trimesh cuts, shapely measures."""
    other = np.eye(3)[int(np.argmin(np.abs(into)))]
    across = np.cross(into, other)
    across /= np.linalg.norm(across)
    up = np.cross(across, into)
    # A little off the corner that several places of a ring share.
    section = part.mesh().section(plane_normal=up, plane_origin=floor + 1e-7 * up)
    frame = np.eye(4)
    frame[:3, :3] = np.stack([across, into, up])
    frame[:3, 3] = -frame[:3, :3] @ floor
    flat, _ = section.to_2D(to_2D=frame)
    way = shapely.LineString([(0.0, 1e-7), (0.0, 1.0)])
    solid = shapely.Polygon()
    for ring in sorted(flat.polygons_closed, key=lambda ring: -ring.area):  # what lies inside a ring is a hole
        solid = solid.symmetric_difference(ring)
    shared = solid.intersection(way)
    inside = [(piece.bounds[1], piece.length) for piece in getattr(shared, "geoms", [shared]) if piece.length > 0.0]
    start, length = min(inside)
    assert start < 1e-6
    return float(length)


@pytest.mark.parametrize("name", some_slow(["wing"], ["tapered", "cone elliptic 6", "segments"]))
def test_the_wall_is_left_under_pockets_of_finished_parts(name: str) -> None:
    made = parts(name)
    seen = 0
    for part in made.parts:
        for pocket in part.pockets:
            if pocket.kind in ("magnet", "mark", "screw"):
                for floor in pocket.floor[:: 4 if pocket.kind == "magnet" else 1]:
                    left = left_under(part, floor, pocket.into)
                    assert 1e3 * left > made.spec.print.wall_mm - 1e-3, f"{part.id} {pocket.name}"
                    seen += 1
    assert seen > 10


@pytest.mark.parametrize("spacing", [pytest.param(100.0, marks=pytest.mark.slow), 140.0])
def test_faces_that_meet_when_the_span_is_folded_attract(spacing: float) -> None:
    """And deployed ones, with an even and an odd number of magnets on a segment."""
    d = design("segments")
    made = build_parts(d, PartsSpec.model_validate({"magnet": {"spacing_mm": spacing}}))
    count = {len([p for p in part.pockets if p.kind == "magnet"]) for part in made.parts} - {0}
    assert count == ({4} if spacing == 100.0 else {3})
    folding = SpanFolding(Mechanism(d.structure), d.span_m, d.span_segments)  # type: ignore[arg-type]
    stowed = folding.poses(np.zeros(1), np.full((1, d.span_segments - 1), np.pi))[0]
    deployed = np.tile(np.eye(4), (d.span_segments, d.structure.layout.n_panels, 1, 1))
    for poses, pairs_wanted in ((stowed, 2 * max(count)), (deployed, 3 * max(count))):
        found = []
        for part, pocket in magnets(made):
            pose = poses[part.segment, part.panel]
            found.append((pose[:3, :3] @ pocket.at + pose[:3, 3], pose[:3, :3] @ pocket.into, pocket.name[-1]))
        pairs = 0
        for i, (at, into, sign) in enumerate(found):
            for there, onto, other in found[:i]:
                if np.linalg.norm(at - there) < 1e-6:
                    pairs += 1
                    assert into @ onto == pytest.approx(-1.0), "face to face"
                    assert {sign, other} == {"+", "−"}
        assert pairs == pairs_wanted


@pytest.mark.slow
def test_magnets_keep_off_the_film_where_a_slit_s_face_carries_it() -> None:
    """Two panels of this design have no skin: the opening crease's film lies on their backs."""
    made = parts("two inner vertices")
    spec = made.spec
    skeleton = Skeleton(made.design)
    seen = 0
    for part, pocket in magnets(made):
        if part.id not in ("c5.cb", "c5.da"):
            continue
        opening = CREASES[part.panel % 4 // 2]
        film = next(p for p in part.pockets if p.name == f"film c5.{opening}")
        assert film.volume_m3 > 0.0
        start, stop = skeleton.crease_ends[4, CREASES.index(opening)]
        along = (stop - start) / np.linalg.norm(stop - start)
        off = pocket.at - start
        away = float(np.linalg.norm(off - (off @ along) * along))
        assert away > 1e-3 * (spec.film.glue_mm + 0.5 * spec.magnet.pocket_mm), part.id
        seen += 1
    assert seen


# --- piano hinges -------------------------------------------------------------------------------------


def leaves(leaf: Pocket, along: Vectors, spec: SpanHingeSpec) -> Iterator[Any]:
    """Both leaves of a hinge as boxes, let into the face, up to the knuckles."""
    size = (
        leaf.length_m - 2e-6,
        1e-3 * spec.leaf_width_mm - 1e-3 * spec.pin_diameter_mm,
        1e-3 * spec.leaf_thickness_mm,
    )
    for up in (np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])):
        right = along if np.cross(along, up) @ leaf.into > 0.0 else -along
        start = leaf.at - 0.5 * size[0] * right + 0.5e-3 * spec.pin_diameter_mm * up
        yield manifold3d.Manifold.cube(size).transform(np.column_stack([right, up, leaf.into, start]))


@pytest.mark.slow
def test_piano_hinges_meet_no_part_when_deployed_or_while_cells_fold() -> None:
    made = parts("segments")
    d, spec = made.design, made.spec.span_hinge
    folding = SpanFolding(Mechanism(d.structure), d.span_m, d.span_segments)  # type: ignore[arg-type]
    poses = Skeleton(d).poses(np.concatenate([[1.0, 0.999, 0.99, 0.97], np.linspace(0.0, 0.9, 12)]))
    ids = d.structure.layout.panel_ids
    solids = bodies("segments", "default")
    seen = 0
    for hinge in folding.hinges:
        panel = ids.index(hinge.panel)
        leaf = next(p for part in made.parts for p in part.pockets if p.name == f"leaf of {hinge.id}")
        along = np.diff(hinge.line_m, axis=0)[0] / np.linalg.norm(np.diff(hinge.line_m, axis=0))
        start = leaf.at - 0.5 * leaf.length_m * along
        assert abs(start[2] - hinge.line_m[0, 2]) < 1e-12
        pin = cylinder(start + 1e-6 * along, along, 0.5e-3 * spec.pin_diameter_mm, leaf.length_m - 2e-6)
        thicker = cylinder(start + 1e-6 * along, along, 0.5e-3 * spec.pin_diameter_mm + 4e-4, leaf.length_m - 2e-6)
        found = 0.0
        for box in leaves(leaf, along, spec):
            for part, solid in solids:
                assert float((box ^ solid).volume()) < 1e-3 * MM3, f"leaf of {hinge.id} in {part.id}"
        for part, solid in solids:
            for pose in poses:
                seen_by = (np.linalg.inv(pose[part.panel]) @ pose[panel])[:3]
                assert float((pin.transform(seen_by) ^ solid).volume()) < 1e-3 * MM3, f"{hinge.id} in {part.id}"
                if part.panel != panel:
                    found = max(found, float((thicker.transform(seen_by) ^ solid).volume()))
            seen += 1
        assert found > 1.0 * MM3, "thicker knuckles would be seen to meet the facing panel"
    assert seen == 2 * len(solids)


# --- values that contradict each other, and cuts that fail ---------------------------------------------


@pytest.mark.parametrize(
    ("tables", "keys"),
    [
        ({"magnet": {"spacing_mm": 0.01}}, ("magnet.spacing_mm (0.01 mm)", "magnet.diameter_mm", "print.wall_mm")),
        ({"magnet": {"spacing_mm": 4.0}}, ("magnet.spacing_mm", "8.8 mm")),
        ({"magnet": {"spacing_mm": 6.0}}, ("magnet.spacing_mm", "magnet.mark_mm")),
        ({"horn": {"screw_circle_mm": 24.0}}, ("horn.screw_circle_mm", "horn.hub_diameter_mm (20 mm)")),
        ({"horn": {"screws": 24}}, ("horn.screws = 24", "horn.screw_circle_mm", "print.wall_mm")),
        ({"clearance": {"slit_mm": 1.5}}, ("clearance.slit_mm (1.5 mm)", "magnet.depth_mm (1 mm)")),
        ({"span_hinge": {"leaf_thickness_mm": 1.0}}, ("span_hinge.leaf_thickness_mm", "span_hinge.pin_diameter_mm")),
    ],
)
def test_values_that_contradict_each_other_are_refused_by_both_names(
    tables: Mapping[str, Any], keys: tuple[str, ...]
) -> None:
    with pytest.raises(ValidationError) as refused:
        PartsSpec.model_validate(tables)
    for key in keys:
        assert key in str(refused.value)


@pytest.mark.slow
def test_magnets_at_the_least_spacing_keep_their_walls() -> None:
    spec = PartsSpec.model_validate({"magnet": {"spacing_mm": 8.8}})
    made = build_parts(design("helix"), spec)
    half = {"magnet": 0.5e-3 * spec.magnet.pocket_mm, "mark": 0.5e-3 * spec.magnet.mark_mm}
    rows = [
        row
        for part in made.parts
        if (row := sorted((float(p.at[2]), half[p.kind]) for p in part.pockets if p.kind in half))
    ]
    assert len(rows) == 2
    for row in rows:
        assert len(row) > 80, "some forty magnets and their marks"
        gaps = [b - rb - a - ra for (a, ra), (b, rb) in pairwise(row)]
        assert 1e3 * min(gaps) > 0.999 * spec.print.wall_mm


def test_a_clearance_larger_than_the_panel_is_an_error() -> None:
    with pytest.raises(InputError, match=r"clearance inner face: larger than the panel; found .* %.*\[clearance\]"):
        build_parts(design("helix"), PartsSpec.model_validate({"clearance": {"inner_mm": 50.0}}))


def test_cuts_are_made_together_or_not_at_all_and_nothing_to_cut_is_told() -> None:
    pieces, _ = _blanks(design("helix"), PartsSpec())
    one, other = pieces[0, 0], pieces[1, 0]

    def hole(piece: Any, depth: float, name: str) -> Cut:
        plane = piece.plane("inner", False)
        at = plane.point(0.1, 0.01)
        right, up = plane.along, np.cross(plane.outward, plane.along)
        square = 1e-3 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return Cut(punch([square], at, right, up, depth, 1e-3), "magnet", name, at)

    assert take_together([(one, hole(one, 1e-3, "first")), (other, hole(other, 1e-3, "second"))])
    assert [p.name for p in (*one.pockets, *other.pockets)] == ["first", "second"]
    before = one.body.volume(), other.body.volume()
    # Deeper in the one, but nothing left to take from the other.
    assert not take_together([(one, hole(one, 2e-3, "deeper")), (other, hole(other, 1e-3, "again"))])
    assert (one.body.volume(), other.body.volume()) == before
    assert [p.name for p in (*one.pockets, *other.pockets)] == ["first", "second"]
    assert [str(r) for r in other.remarks] == [
        f"{other.id}: again left out; found nothing left to cut there; limit: some of the panel; "
        "remedy: smaller pockets, or clearances"
    ]


@pytest.mark.slow
def test_the_print_check_looks_under_every_pocket_of_a_cone() -> None:
    """Its spheres are thousands of planes: floors are not found by the size of their triangles."""
    made = build_parts(design("cone elliptic 6"), PartsSpec.model_validate({"print": {"wall_mm": 0.3}}))
    magnets = [(part, [pocket for pocket in part.pockets if pocket.kind == "magnet"]) for part in made.parts]
    with_some = [(part, pockets) for part, pockets in magnets if pockets]
    assert sum(len(pockets) for _, pockets in with_some) > 5
    for part, pockets in with_some:
        at, thick = walls(part)
        for pocket in pockets:
            for floor in pocket.floor:
                here = np.flatnonzero(np.linalg.norm(at - floor, axis=1) < 1e-9)
                assert len(here), f"{part.id} {pocket.name}"
                assert thick[here[0]] == pytest.approx(left_under(part, floor, pocket.into), abs=2e-6)
