"""What is uploaded is the design, and where it is put is where our kinematics put it."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import viser

from ori_deploy.files import build_from_file, load_design
from ori_deploy.motion import Interference, SpanFolding, mechanism_of
from ori_deploy.page.content import CREASE_COLOURS, Content, content_of, rgb, seen_along
from ori_deploy.page.glb import body, painted, rods
from ori_deploy.page.judging import Judge, Verdict
from ori_deploy.page.panel import span_html, verdict_html
from ori_deploy.page.placing import Mover
from ori_deploy.page.section import draw, section_of, sized
from ori_deploy.page.shown import Shown
from ori_deploy.profiles import Superellipse
from ori_deploy.profiles.cone import Cone
from ori_deploy.view.ink import cell_colour
from tests.page.conftest import EXAMPLES

NAMES = ("wing", "span", "cone")


def shown(folder: Path, name: str) -> tuple[Content, Mover]:
    design = load_design(folder / f"{name}.design.json")
    return content_of(design), Mover(design)


@pytest.mark.parametrize("name", NAMES)
def test_every_panel_crease_slit_and_latch_is_there_once(made: Path, name: str) -> None:
    content, mover = shown(made, name)
    layout = mover.mechanism.layout
    assert [panel.id for panel in content.panels] == list(layout.panel_ids)
    assert len({crease.id for crease in content.creases}) == 4 * layout.n_cells
    assert len(content.slits) == 2 * len(layout.slits)
    assert [latch.id for latch in content.latches] == list(layout.latch_points)
    assert set(content.bodies) == set(layout.bodies.tolist())
    for panel in content.panels:
        assert panel.colour == rgb(cell_colour(panel.cell, layout.n_cells))
    for crease in content.creases:
        assert crease.colour == CREASE_COLOURS["opening" if ".open" in crease.id else "closing"]


@pytest.mark.parametrize("name", NAMES)
def test_bodies_are_closed_face_outwards_and_hold_the_material(made: Path, name: str) -> None:
    content, mover = shown(made, name)
    design = mover.design
    for panel in content.panels:
        edges = panel.solid.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        there = {(int(a), int(b)) for a, b in edges}
        assert len(there) == len(edges)
        assert there == {(b, a) for a, b in there}
        assert panel.solid.volume_m3 > 0.0
    cubes = (design.r_max_m**3 - design.r_min_m**3) / 3.0
    length, near = (cubes, 0.05) if name == "cone" else (content.segment_m, 0.02)
    held = sum(panel.solid.volume_m3 for panel in content.panels)
    # Facets cut a little off the curved skin, and off the spheres that a cone ends in.
    assert held == pytest.approx(design.structure.panel_areas.sum() * length, rel=near)


@pytest.mark.parametrize("name", NAMES)
def test_poses_are_those_of_the_kinematics_each_cell_with_its_own_fold(made: Path, name: str) -> None:
    _, mover = shown(made, name)
    fold = np.random.default_rng(3).random(mover.mechanism.n_cells)
    for row in (fold, np.zeros_like(fold), np.ones_like(fold)):
        ours = mover.panels(row).matrices()
        theirs = mover.mechanism.poses(row[None, :]).matrices()[0]
        k = theirs.shape[-1] - 1
        assert np.abs(ours[:, :k, :k] - theirs[:, :k, :k]).max() < 1e-9
        assert np.abs(ours[:, :k, 3] - theirs[:, :k, k]).max() < 1e-9


def test_bonded_panels_move_as_one_body(made: Path) -> None:
    content, mover = shown(made, "wing")
    matrices = mover.panels(np.array([0.1, 0.9, 0.4, 0.6])).matrices()
    numbers = {name: k for k, name in enumerate(mover.mechanism.layout.panel_ids)}
    for panel in content.panels:
        assert np.abs(matrices[numbers[panel.id]] - matrices[panel.body]).max() < 1e-12


@pytest.mark.parametrize("folded", [0.0, 0.3, 1.0])
def test_segments_are_where_the_span_folding_puts_them(made: Path, folded: float) -> None:
    _, mover = shown(made, "span")
    assert mover.span is not None
    theirs = mover.span.segment_matrices(np.full((1, 2), np.pi * folded))[0]
    ours = mover.segments(folded).matrices()
    first = np.array([0.01, 0.02, 0.03, 1.0])
    for k in range(3):
        there = theirs[k] @ (first + np.array([0.0, 0.0, k * mover.span.length_m, 0.0]))
        assert np.abs(ours[k] @ first - there).max() < 1e-9


def test_creases_stay_on_both_panels_that_they_join(made: Path) -> None:
    """A crease is carried by one panel; the next one has it at the same place."""
    content, mover = shown(made, "wing")
    matrices = mover.panels(np.full(4, 0.37)).matrices()
    for number, crease in enumerate(content.creases):
        cell = number // 4
        ends = np.concatenate([crease.segments.reshape(-1, 3), np.ones((2, 1))], axis=1)
        places = [ends @ matrices[4 * cell + k].T for k in range(4)]
        carried = ends @ matrices[crease.body].T
        near = sorted(float(np.abs(place - carried).max()) for place in places)
        assert near[1] < 1e-9


def test_a_body_is_valid_gltf_of_triangles(made: Path) -> None:
    content, _ = shown(made, "wing")
    data = body([painted(content.panels[0].solid, content.panels[0].colour)])
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    document = json.loads(data[20 : 20 + size])
    assert kind == b"JSON"
    assert size % 4 == 0
    assert document["accessors"][0]["count"] == 3 * len(content.panels[0].solid.faces)
    assert document["buffers"][0]["byteLength"] == len(data) - 28 - size


def test_cells_out_of_step_are_judged_as_the_interference_check_does(made: Path) -> None:
    _, mover = shown(made, "wing")
    judge = Judge(mover.mechanism)
    assert not judge.judge(np.full(4, 0.5)).collisions
    fold = np.array([1.0, 0.0, 1.0, 0.0])
    verdict = judge.judge(fold)
    first = Interference(mover.mechanism).first_collision(fold[None, :], between=False)
    assert first is not None
    assert verdict.collisions[0].panels == first.panels
    assert verdict.collisions[0].depth_m == pytest.approx(first.depth_m)
    assert set(first.panels) <= verdict.red


def test_clearance_is_the_one_that_the_motion_check_finds(made: Path) -> None:
    _, mover = shown(made, "wing")
    theirs = Interference(mover.mechanism).clearance(np.array([0.5]))
    ours = Judge(mover.mechanism).judge(np.full(4, 0.5))
    assert ours.clearance_m == pytest.approx(theirs.distance_m)
    assert ours.clearance_panels == theirs.panels


def test_the_section_is_drawn_to_scale_with_its_dimensions(made: Path) -> None:
    content, mover = shown(made, "wing")
    section = section_of(content, mover.panels(np.ones(4)), range(16))
    drawn = draw(content, section, frozenset({"c1.ac"}))
    assert drawn.count("<polygon") == 16
    assert "250.0 mm" in drawn
    assert drawn.count('fill="#d4002a"') == 1


def test_all_that_reach_into_each_other_are_red_and_the_deepest_are_told() -> None:
    structure = build_from_file(EXAMPLES / "wing_naca0024_6.toml")[1]
    mechanism = mechanism_of(structure, 1.0)
    interference, ids = Interference(mechanism), mechanism.layout.panel_ids
    fold = np.ones(mechanism.n_cells)
    fold[[1, 3]] = 0.0
    pairs = interference.touching(fold)
    found = [interference.depth_m(fold, int(pair)) for pair in pairs]
    depths = sorted(found, reverse=True)
    assert sorted(found[:6]) != sorted(depths[:6])  # the first ones are not the deepest
    verdict = Judge(mechanism).judge(fold)
    assert len(pairs) > 6  # or nothing would be left out
    assert [one.depth_m for one in verdict.collisions] == pytest.approx(depths[:6])
    assert verdict.red == {ids[panel] for panel in interference.pairs[:, pairs].ravel()}
    assert len(verdict.others) == len(pairs) - 6
    assert f"and {len(pairs) - 6} more pairs" in verdict_html(verdict)


def test_none_is_left_out_among_pairs_that_are_all_as_deep() -> None:
    """Bisection alone would never part them."""
    structure = build_from_file(EXAMPLES / "wing_naca0024_6.toml")[1]
    interference = Interference(mechanism_of(structure, 1.0))
    fold = np.ones(6)
    fold[3] = 0.0
    pairs = np.repeat(interference.touching(fold)[:1], 5)
    deepest, rest = interference.deepest(fold, pairs, 2)
    assert (len(deepest), len(rest)) == (2, 3)


def test_a_folded_span_is_judged_too_and_one_that_nobody_measured_is_told(made: Path) -> None:
    _, mover = shown(made, "span")
    assert mover.span is not None
    stowed = np.zeros(4)
    for folded in (0.2, 0.7, 1.0):
        assert Judge(mover.mechanism, mover.span).judge(stowed, folded).segments is None
    # Hinges within the stack instead of on its faces: now segments fold into each other.
    wrong = SpanFolding(mover.span.mechanism, mover.span.span_m, mover.span.segments)
    vars(wrong)["chain"] = replace(mover.span.chain, hinge_y=np.zeros(2))
    verdict = Judge(mover.mechanism, wrong).judge(stowed, 0.9)
    assert verdict.segments is not None
    assert verdict.segments.depth_m > 1e-3
    assert f"{1e3 * verdict.segments.depth_m:.2f} mm" in span_html(verdict, 0.9)
    fine = Verdict((), None, ("", ""))
    assert "not measured" in span_html(fine, None)
    assert "do not reach" in span_html(fine, 0.5)
    assert span_html(fine, 0.0) == ""


def test_a_cone_s_outer_end_is_told_with_its_depth(made: Path) -> None:
    content, mover = shown(made, "cone")
    places = mover.panels(np.full(6, 0.5))
    numbers = [mover.mechanism.layout.panel_ids.index(panel.id) for panel in content.panels]
    section = section_of(content, places, numbers)
    matrices = places.matrices()
    ends = np.concatenate(
        [
            np.split(panel.solid.vertices, 2)[1] @ matrices[k, :3, :3].T + matrices[k, :3, 3]
            for panel, k in zip(content.panels, numbers, strict=True)
        ]
    )
    assert section.size == pytest.approx(np.ptp(ends, axis=0))  # this one's axis is z
    assert section.size[2] > 0.2
    told = " × ".join(f"{1e3 * side:.1f}" for side in section.size)
    assert sized(content, section)[0] == ("outer end here", f"{told} mm")
    assert "outer end, seen along the axis" in draw(content, section, frozenset())


def test_a_cone_is_seen_along_its_own_axis() -> None:
    leaning = Cone(Superellipse(0.2, 0.2), (-1.0, 0.0, 0.0), 1.0)
    seen = seen_along(leaning)
    assert seen @ seen.T == pytest.approx(np.eye(3))
    assert np.linalg.det(seen) == pytest.approx(1.0)
    assert seen[2] == pytest.approx([np.sqrt(0.5), 0.0, np.sqrt(0.5)], abs=0.02)
    below = Cone(Superellipse(0.2, 0.2), (0.0, 0.0, 0.0), -1.0)
    assert seen_along(below)[2] == pytest.approx([0.0, 0.0, -1.0])


def test_rods_are_closed_and_face_outwards() -> None:
    ends = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]], [[1.0, 0.0, 0.0], [1.0, 3.0, 0.0]]])
    points, colours = rods(ends, (255, 0, 0), 0.1)
    a, b, c = points.reshape(-1, 3, 3).transpose(1, 0, 2)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert volume == pytest.approx(0.02 * (2.0 + 3.0))
    assert colours == pytest.approx(np.tile([1.0, 0.0, 0.0], (len(points), 1)))


@pytest.mark.parametrize("name", ["wing", "span"])
def test_moving_sends_poses_and_nothing_else(made: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    content, mover = shown(made, name)
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        there = Shown(server, content, mover)
        there.pose(np.ones(4))
        sent: list[str] = []
        buffer = server._websock_server.get_message_buffer()
        monkeypatch.setattr(buffer, "push", lambda message: sent.append(type(message).__name__))
        there.pose(np.full(4, 0.3))
        there.pose(np.zeros(4), 1.0 if name == "span" else 0.0)
        assert set(sent) == {"SetOrientationMessage", "SetPositionMessage"}
        sent.clear()
        there.redden(frozenset({"c1.ac"}))
        there.redden(frozenset())
        first = list(sent)
        sent.clear()
        there.redden(frozenset({"c1.ac"}))
        assert sum("Glb" in one for one in first) == content.segments
        assert not any("Glb" in one for one in sent)  # a red body is uploaded once
        assert sent
    finally:
        server.stop()
