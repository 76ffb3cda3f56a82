"""What is uploaded is the design, and where it is put is where our kinematics put it."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from ori_deploy.files import load_design
from ori_deploy.motion import Interference
from ori_deploy.page.content import CREASE_COLOURS, Content, content_of, rgb
from ori_deploy.page.glb import painted
from ori_deploy.page.judging import Judge
from ori_deploy.page.placing import Mover
from ori_deploy.page.section import draw, section_of
from ori_deploy.view.ink import cell_colour

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
    data = painted(content.panels[0].solid, content.panels[0].colour)
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
