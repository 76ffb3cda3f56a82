"""STL, 3MF and STEP files: closed bodies, named, in millimetres, on plates where nothing overlaps."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh
from shapely import MultiPoint

from ori_deploy.errors import InputError
from ori_deploy.export import kernel
from ori_deploy.export.mesh_files import write_3mf, write_stl
from ori_deploy.export.parts import build_parts
from ori_deploy.export.parts_spec import PartsSpec
from ori_deploy.export.plates import lay_out
from ori_deploy.export.step_file import plane_faces, write_step
from tests.export.solid_checks import design, parts, some_slow

NAMES = some_slow(["wing"], ["tapered", "cone tip", "two inner vertices"])


@pytest.mark.parametrize("name", NAMES)
def test_stl_files_hold_one_closed_part_each_in_millimetres(name: str, tmp_path: Path) -> None:
    made = parts(name)
    written = write_stl(made, tmp_path)
    assert [path.name for path in written] == [f"{part.id}.stl" for part in made.parts]
    for part, path in zip(made.parts, written, strict=True):
        mesh = trimesh.load_mesh(path, process=False)
        mesh.merge_vertices()
        assert mesh.is_watertight, part.id
        assert mesh.is_winding_consistent
        assert mesh.body_count == 1
        assert 1e-9 * mesh.volume == pytest.approx(part.volume_m3, rel=1e-4)
        assert np.allclose(1e-3 * mesh.bounds, [part.points.min(axis=0), part.points.max(axis=0)], atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_a_3mf_file_comes_back_closed_and_named(name: str, tmp_path: Path) -> None:
    made = parts(name)
    placed = write_3mf(made, tmp_path / "parts.3mf")
    scene = trimesh.load_scene(tmp_path / "parts.3mf", process=False)
    assert scene.units == "millimeter"
    assert sorted(scene.geometry) == sorted(part.id for part in made.parts)
    for item in placed:
        mesh = scene.geometry[item.part.id]
        assert mesh.is_watertight
        assert 1e-9 * mesh.volume == pytest.approx(item.part.volume_m3, rel=1e-4)
    boxes = [mesh.bounds for mesh in scene.dump()]
    assert min(box[0, 2] for box in boxes) == pytest.approx(0.0, abs=1e-3), "on the bed"
    assert max(abs(box[0, 2]) for box in boxes) < 1e-3
    for i, a in enumerate(boxes):
        for b in boxes[:i]:
            apart = (a[0, :2] > b[1, :2] - 1e-3) | (b[0, :2] > a[1, :2] - 1e-3)
            assert apart.any(), "two parts in one place"


def test_the_same_parts_give_the_same_3mf(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_3mf(parts("wing", plain=True), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_plates_hold_what_fits_with_room_between_and_the_rest_alone() -> None:
    made = build_parts(
        design("helix"), PartsSpec.model_validate({"print": {"bed_mm": [410.0, 300.0, 50.0]}}), plain=True
    )
    placed = lay_out(made)
    assert {item.part.id for item in placed} == {part.id for part in made.parts}
    assert all(item.fits for item in placed)
    assert 1 < placed[-1].plate + 1 < len(placed), "several on a plate, on several plates"
    hulls: dict[int, list[MultiPoint]] = {}
    for item in placed:
        at = item.part.points @ item.matrix[:3, :3].T + item.matrix[:3, 3]
        assert np.linalg.det(item.matrix[:3, :3]) == pytest.approx(1.0), "turned, not mirrored"
        assert at.min() > -1e-9
        assert (at.max(axis=0) <= np.array([0.41, 0.3, 0.05]) + 1e-9).all()
        hull = MultiPoint(at[:, :2]).convex_hull
        assert all(hull.distance(other) > 4.9e-3 for other in hulls.get(item.plate, []))
        hulls.setdefault(item.plate, []).append(hull)
    small = lay_out(build_parts(design("helix"), plain=True))
    assert not any(item.fits for item in small)
    assert len({item.plate for item in small}) == len(small)


@pytest.mark.parametrize("name", some_slow(["wing"], ["cone tip"]))
def test_plane_faces_cover_the_surface(name: str) -> None:
    for part in parts(name).parts[:4]:
        loops = plane_faces(part.points, part.triangles)
        assert len(loops) < len(part.triangles)
        edges = [edge for face in loops for loop in face for edge in zip(loop, np.roll(loop, -1), strict=True)]
        assert sorted(edges) == sorted((b, a) for a, b in edges), "every edge once from either side"


@pytest.mark.slow
def test_step_files_hold_every_part_as_a_valid_solid(tmp_path: Path) -> None:
    cad = pytest.importorskip("build123d", reason="NOT TESTED: STEP needs the extra `cad`, 675 MB: build123d")
    made = parts("wing")
    write_step(made, tmp_path / "parts.step")
    solids = cad.import_step(str(tmp_path / "parts.step")).solids()
    assert len(solids) == len(made.parts)
    for part, solid in zip(made.parts, solids, strict=True):
        assert 1e-9 * solid.volume == pytest.approx(part.volume_m3, rel=1e-6)


@pytest.mark.skipif(find_spec("build123d") is not None, reason="the extra `cad` is installed")
def test_step_without_its_extra_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"build123d is not installed; .*extra `cad`; remedy: pip install") as wrong:
        write_step(parts("wing", plain=True), tmp_path / "parts.step")
    assert "\n" not in str(wrong.value)
    assert not list(tmp_path.iterdir())


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "manifold3d", None)
    with pytest.raises(InputError, match=r"manifold3d is not installed; .*limit: the extra `export`"):
        kernel.need("manifold3d", "export")


@pytest.mark.slow
def test_the_room_is_imported_without_its_extra() -> None:
    code = "import sys; import ori_deploy.export.mesh_files, ori_deploy.export.step_file, ori_deploy.export.bill; "
    code += "print([m for m in ('trimesh', 'manifold3d', 'build123d', 'lxml') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
