"""`ori-deploy export` writes everything that is asked for, or nothing; what is wrong is one line."""

from __future__ import annotations

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from ori_deploy.cli.staging import Staging
from ori_deploy.errors import FileError
from ori_deploy.files import Design, build_from_file, save_design
from tests.cli.inside import run

EXAMPLES = Path(__file__).parents[2] / "examples"
RIG = EXAMPLES / "rig_mock.toml"
PANELS = [f"c{k}.{edge}" for k in range(1, 5) for edge in ("ac", "cb", "bd", "da")]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the design of an ellipse 200 mm across, of four cells."""
    spec, structure = build_from_file(EXAMPLES / "ellipse_4.toml")
    save_design(Design("tube", spec.structure.span_m, structure), tmp_path / "tube.design.json")
    return tmp_path


def export(folder: Path, *words: str | Path, status: int = 0) -> subprocess.CompletedProcess[str]:
    done = run("export", "tube.design.json", *words, cwd=folder)
    assert done.returncode == status, done.stdout + done.stderr
    if status == 2:
        assert len(done.stderr.splitlines()) == 1
        assert done.stderr.startswith("error: ")
    return done


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_films_and_models_at_once(folder: Path) -> None:
    told = export(
        folder, "--svg", "films", "--dxf", "cuts", "--fold", "tube.fold", "--frames", "3", "--urdf", "tube.urdf",
        "--mjcf", "tube.xml", "--rig", RIG,
    ).stdout  # fmt: skip
    assert "16 films, mm" in told
    assert names(folder) == ["cuts", "films", "tube.design.json", "tube.fold", "tube.urdf", "tube.xml", "tube_meshes"]
    creases = [f"c{k}.{crease}" for k in range(1, 5) for crease in ("close_a", "close_b", "open_c", "open_d")]
    assert names(folder / "films") == [f"{crease}.svg" for crease in creases]
    assert names(folder / "cuts") == [f"{crease}.dxf" for crease in creases]
    assert names(folder / "tube_meshes") == sorted(f"{panel}.stl" for panel in PANELS)
    assert len(json.loads((folder / "tube.fold").read_text())["file_frames"]) == 2
    model = ET.parse(folder / "tube.xml").getroot()
    actuators = [each.attrib for each in model.iter("position")]
    assert [(each["name"], each["joint"]) for each in actuators] == [
        (f"servo_c{k}", f"c{k}.close_a") for k in range(1, 5)
    ]
    assert {each["forcerange"] for each in actuators} == {"-8 8"}
    umask = (folder / "tube.fold").stat().st_mode & 0o066
    assert (folder / "films").stat().st_mode & 0o066 == umask


@pytest.mark.slow
def test_parts_with_and_without_pockets(folder: Path) -> None:
    export(folder, "--stl", "stl", "--3mf", "tube.3mf", "--rig", RIG, "--bom", "bill.json")
    export(folder, "--stl", "plain", "--plain")
    assert names(folder / "stl") == names(folder / "plain") == sorted(f"{panel}.stl" for panel in PANELS)
    assert (folder / "tube.3mf").read_bytes()[:2] == b"PK"
    bill = json.loads((folder / "bill.json").read_text())
    assert bill["mass_kg"] == pytest.approx(sum(item["mass_kg"] for item in bill["items"]))
    assert "panels" in export(folder, "--bom", "-").stdout
    bed = folder / "parts.toml"
    bed.write_text('schema = "ori-deploy/parts/1"\n[print]\nbed_mm = [50.0, 50.0, 50.0]\n')
    assert "bed wrong" in export(folder, "--check", "--parts", "parts.toml", status=1).stdout


def test_nothing_appears_where_one_output_cannot_be_made(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "tube.fold").write_text("older")
    monkeypatch.setitem(sys.modules, "build123d", None)
    told = export(folder, "--fold", "tube.fold", "--svg", "films", "--step", "tube.step", "--plain", status=2).stderr
    assert "pip install -e '.[cad]'" in told
    assert names(folder) == ["tube.design.json", "tube.fold"]
    assert (folder / "tube.fold").read_text() == "older"


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("manifold3d", ("--stl", "stl")),
        ("manifold3d", ("--urdf", "t.urdf")),
        ("manifold3d", ("--svg", "s")),
        ("ezdxf", ("--dxf", "d")),
    ],
)
def test_a_missing_extra_is_named(
    module: str, words: tuple[str, str], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    told = export(folder, *words, status=2).stderr
    assert f"{module} is not installed" in told
    assert "pip install -e '.[export]'" in told
    assert names(folder) == ["tube.design.json"]


def test_what_needs_no_extra_does_without(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("manifold3d", "trimesh", "lxml", "ezdxf", "build123d"):
        monkeypatch.setitem(sys.modules, module, None)
    export(folder, "--fold", "tube.fold")


def test_a_folder_of_others_is_left_alone_and_one_of_ours_made_anew(folder: Path) -> None:
    export(folder, "--svg", "films")
    (folder / "films" / "c1.open_c.svg").write_text("older")
    export(folder, "--svg", "films")
    assert "<svg" in (folder / "films" / "c1.open_c.svg").read_text()
    (folder / "films" / "notes.txt").write_text("mine")
    told = export(folder, "--svg", "films", "--fold", "tube.fold", status=2).stderr
    assert "notes.txt" in told
    assert (folder / "films" / "notes.txt").read_text() == "mine"
    assert names(folder) == ["films", "tube.design.json"]


def test_folders_made_on_the_way_are_gone_where_an_output_cannot_be_made(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "build123d", None)
    (folder / "there").mkdir()
    export(folder, "--fold", "there/new/x.fold", "--svg", "nd/a/b", "--step", "nd/c.step", status=2)
    assert names(folder) == ["there", "tube.design.json"]
    assert names(folder / "there") == []
    export(folder, "--fold", "there/new/x.fold", "--svg", "nd/a/b")
    assert names(folder / "nd" / "a" / "b")
    assert names(folder / "there" / "new") == ["x.fold"]


def test_films_are_told_of_without_their_parts_and_once_with_them(folder: Path) -> None:
    alone = export(folder, "--svg", "films").stderr.splitlines()
    assert alone
    assert all(": film c" in line for line in alone)
    (folder / "parts.toml").write_text('schema = "ori-deploy/parts/1"\n[text]\nheight_mm = 80.0\n')
    both = export(folder, "--svg", "films", "--bom", "-", "--parts", "parts.toml").stderr.splitlines()
    assert set(alone) < set(both)
    assert len(set(both)) == len(both)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((), "nothing is asked for"),
        (("--svg", "films", "--frames", "5"), "--frames: goes with --fold"),
        (("--svg", "films", "--plain"), "--plain: goes with parts"),
        (("--fold", "one", "--mjcf", "one"), "two outputs of one name"),
        (("--dxf", "one", "--svg", "one"), "two outputs of one name"),
        (("--fold", "tube.design.json"), "is an input"),
        (("--fold", "f", "--parts", "tube.design.json"), "this looks like a design or a plan"),
        (("--fold", "f", "--parts", "no.toml"), "no.toml"),
        (("--fold", "/proc/nowhere/f"), "cannot be written"),
        (("--svg", "/proc/nowhere/f"), "cannot be written"),
        (("--stl", "."), "the current folder cannot be made anew"),
        (("--svg", ".."), "the current folder cannot be made anew"),
        (("--svg", "outd", "--fold", "outd/x.fold"), "outd/x.fold: lies in another output; found outd; limit"),
        (("--svg", "out/d", "--stl", "out", "--plain"), "out/d: lies in another output; found out; limit"),
        (("--svg", "outd", "--bom", "outd/bill.json"), "outd/bill.json: lies in another output"),
        (("--urdf", "t.urdf", "--svg", "t_meshes"), "two outputs of one name"),
    ],
)
def test_words_that_cannot_be_used_are_refused_and_nothing_is_written(
    words: tuple[str, ...], told: str, folder: Path
) -> None:
    assert told in export(folder, *words, status=2).stderr
    assert names(folder) == ["tube.design.json"]


def test_a_parts_file_is_refused_by_key(folder: Path) -> None:
    (folder / "parts.toml").write_text('schema = "ori-deploy/parts/1"\n[film]\nthickness_mm = 0.1\n')
    told = export(folder, "--svg", "films", "--parts", "parts.toml", status=2).stderr
    assert "film.thickness_mm" in told
    assert "parts.toml" in told


def test_films_that_cannot_be_glued_are_told_and_made(folder: Path) -> None:
    (folder / "parts.toml").write_text(
        'schema = "ori-deploy/parts/1"\n[film]\nthickness_um = 1000.0\nglue_mm = 5.0\n'
    )
    told = export(folder, "--svg", "films", "--parts", "parts.toml").stderr
    assert told.startswith("warning: c1.")
    assert "limit: more than 10 mm" in told
    assert "remedy: a thinner film, a larger film.glue_mm" in told
    assert len(names(folder / "films")) == 16


def test_outputs_move_back_where_one_cannot_be_moved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_text("older")
    moved = Path.rename

    def full(here: Path, there: Path) -> Path:
        if there.name == "b":
            raise OSError(28, "No space left on device")
        return moved(here, there)

    def write() -> None:
        with Staging() as staging:
            for name in ("a", "b"):
                staging.file(tmp_path / name).write_text("newer")
            monkeypatch.setattr(Path, "rename", full)

    with pytest.raises(FileError, match="No space left"):
        write()
    assert (tmp_path / "a").read_text() == "older"
    assert names(tmp_path) == ["a"]
