"""A FOLD file is the structure: rigid faces between true creases, folded as far as the creases are."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ori_deploy.errors import FileError, InputError
from ori_deploy.export.fold import fold_data, write_fold
from ori_deploy.export.skeleton import Skeleton
from tests.export.designs import NAMES, design


def frames_of(data: dict[str, Any]) -> list[dict[str, Any]]:
    """All frames, with what they inherit."""
    key = {name: value for name, value in data.items() if name != "file_frames"}
    return [key, *({**key, **frame} for frame in data["file_frames"])]


def dihedral_deg(frame: dict[str, Any], edge: int) -> float:
    """By how much the two faces at an edge are folded, from nothing but the coordinates: valleys positive."""
    a, b = frame["edges_vertices"][edge]
    points = np.array(frame["vertices_coords"])
    normals = {}
    for ring in frame["faces_vertices"]:
        for k, corner in enumerate(ring):
            after = ring[(k + 1) % len(ring)]
            if {corner, after} == {a, b}:
                others = [points[v] for v in ring if v not in (a, b)]
                along = points[after] - points[corner]
                normal = np.cross(along, others[0] - points[corner])
                normals[(corner, after)] = normal / np.linalg.norm(normal)
    along = points[b] - points[a]
    first, second = normals[(a, b)], normals[(b, a)]
    sine = np.cross(first, second) @ along / np.linalg.norm(along)
    # The face that has the edge as a -> b lies left of it: turning up into a valley turns its normal to the right.
    return float(np.degrees(np.arctan2(-sine, first @ second)))


@pytest.mark.parametrize("name", NAMES)
def test_edges_keep_their_lengths_in_all_frames(name: str) -> None:
    data = fold_data(design(name), 7)
    ends = np.array(data["edges_vertices"])
    lengths = [
        np.linalg.norm(np.diff(np.array(f["vertices_coords"])[ends], axis=1)[:, 0], axis=-1) for f in frames_of(data)
    ]
    np.testing.assert_allclose(lengths, np.broadcast_to(lengths[0], (7, len(ends))), rtol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_fold_angles_are_those_of_the_coordinates_and_change_as_the_creases_do(name: str) -> None:
    made = design(name)
    data = fold_data(made, 6)
    frames = frames_of(data)
    creases = [k for k, a in enumerate(data["edges_assignment"]) if a == "V"]
    deployed = Skeleton(made).linkage.four_bars.deployed.ravel()
    for frame in frames:
        told = np.array(frame["edges_foldAngle"])
        # Where two faces lie on each other a rounding may turn 180 into -180.
        seen = np.array([dihedral_deg(frame, k) for k in creases]) % 360.0
        np.testing.assert_allclose((told[creases] - seen + 180.0) % 360.0, 180.0, atol=2e-6)
        assert told.min() >= 0.0
        assert told.max() <= 180.0
        fold = frame["ori_deploy:fold"]
        inner = np.degrees(Skeleton(made).linkage.four_bars.angles(np.array([fold]))[0].ravel())
        np.testing.assert_allclose(np.array(frame["ori_deploy:edges_innerAngle"])[creases], inner, atol=1e-9)
        closed = told[creases] - np.array(frames[0]["edges_foldAngle"])[creases]
        np.testing.assert_allclose(closed, np.degrees(deployed) - inner, atol=1e-9)


@pytest.mark.parametrize("name", ["circle 6 without wall", "cone circular 6 without wall"])
def test_without_wall_fold_angles_are_the_inner_angles_themselves(name: str) -> None:
    for frame in frames_of(fold_data(design(name), 5)):
        creases = [k for k, a in enumerate(frame["edges_assignment"]) if a == "V"]
        inner = np.array(frame["ori_deploy:edges_innerAngle"])[creases]
        np.testing.assert_allclose(180.0 - np.array(frame["edges_foldAngle"])[creases], inner, atol=1e-7)


@pytest.mark.parametrize("name", NAMES)
def test_every_edge_has_one_face_or_two_that_run_along_it_both_ways(name: str) -> None:
    data = fold_data(design(name), 2)
    sides = Counter((ring[k - 1], ring[k]) for ring in data["faces_vertices"] for k in range(len(ring)))
    assert max(sides.values()) == 1
    edges = {frozenset(edge) for edge in data["edges_vertices"]}
    assert {frozenset(side) for side in sides} == edges
    assert len(edges) == len(data["edges_vertices"])
    for edge, assignment in zip(data["edges_vertices"], data["edges_assignment"], strict=True):
        a, b = edge
        assert sides[(a, b)] + sides[(b, a)] == (2 if assignment == "V" else 1)
    for key in ("edges_assignment", "edges_foldAngle", "ori_deploy:edges_crease"):
        assert len(data[key]) == len(edges)


@pytest.mark.parametrize("name", ["wing", "two inner vertices", "tapered"])
def test_faces_of_one_body_move_as_one(name: str) -> None:
    data = fold_data(design(name), 4)
    frames = [np.array(f["vertices_coords"]) for f in frames_of(data)]
    bodies = np.array(data["ori_deploy:faces_body"])
    assert len(data["ori_deploy:bonds"]) == design(name).structure.layout.n_cells - 1
    for first, second in data["ori_deploy:bonds"]:
        assert bodies[first] == bodies[second]
        corners = data["faces_vertices"][first] + data["faces_vertices"][second]
        apart = [np.linalg.norm(at[corners][:, None] - at[corners], axis=-1) for at in frames]
        np.testing.assert_allclose(apart, np.broadcast_to(apart[0], np.shape(apart)), atol=1e-9)


def test_frames_inherit_and_metadata_say_what_it_is(tmp_path: Path) -> None:
    path = tmp_path / "wing.fold"
    write_fold(design("wing"), path)
    data = json.loads(path.read_text())
    assert (data["file_spec"], data["frame_unit"], data["file_title"]) == (1.2, "m", "wing")
    assert len(data["file_frames"]) == 20
    assert all(frame["frame_inherit"] and frame["frame_parent"] == 0 for frame in data["file_frames"])
    assert data["frame_title"] == "fold 1, deployed"
    assert data["file_frames"][-1]["frame_title"] == "fold 0, flat"
    for key in ("edges_vertices", "edges_assignment", "edges_foldAngle", "faces_vertices"):
        assert data[key]
    names = [name for name in data["ori_deploy:edges_crease"] if name]
    assert names[:4] == ["c1.open_c", "c1.open_d", "c1.close_a", "c1.close_b"]


def test_one_frame_is_no_motion(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="2 or more"):
        fold_data(design("wing"), 1)
    with pytest.raises(FileError):
        write_fold(design("wing"), tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_readers_of_others_read_it_and_find_nothing_wrong(tmp_path: Path) -> None:
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        pytest.skip("NOT CHECKED with readers of others: install the Debian packages nodejs and npm")
    words = [npm, "install", "--prefix", str(tmp_path), "--no-audit", "--no-fund", "fold@0.12.0", "rabbit-ear@0.9.32"]
    got = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    if got.returncode != 0:
        pytest.skip(f"NOT CHECKED with readers of others: npm install failed: {got.stderr.strip()[-200:]}")
    files = []
    for k, name in enumerate(NAMES):
        files.append(tmp_path / f"{k}.fold")
        write_fold(design(name), files[-1], 5)
    script = Path(__file__).with_name("read_fold.js")
    told = subprocess.run(
        [node, str(script), str(tmp_path), *map(str, files)], capture_output=True, text=True, timeout=60, check=False
    )
    assert told.returncode == 0, told.stderr
    for path, frames in zip(files, json.loads(told.stdout), strict=True):
        data = json.loads(path.read_text())
        assert len(frames) == 5
        for seen in frames:
            _agrees(data, seen)


def _agrees(data: dict[str, Any], seen: dict[str, Any]) -> None:
    """What the readers found in a frame is what was written."""
    assert seen["summary"] == "valid"
    assert seen["references"] == [True, True, True]
    corners = len(data["vertices_coords"])
    assert seen["counts"] == [corners, len(data["edges_vertices"]), len(data["faces_vertices"])]
    assert seen["duplicates"] == 0
    assert seen["assigned"] == {a: data["edges_assignment"].count(a) for a in "BV"}
    assert seen["edgesFaces"] == [2 if a == "V" else 1 for a in data["edges_assignment"]]
    for ring, edges in zip(data["faces_vertices"], seen["facesEdges"], strict=True):
        sides = [{ring[k - 1], ring[k]} for k in range(len(ring))]
        assert len(edges) == len(sides)
        assert all(set(data["edges_vertices"][e]) in sides for e in edges)
