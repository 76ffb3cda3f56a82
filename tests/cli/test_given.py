"""The files of a session: none takes the place of another."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ori_deploy.cli import given, session
from ori_deploy.cli.given import refuse_shared
from ori_deploy.errors import FileError
from ori_deploy.files import digest
from ori_deploy.telemetry.read import read_recording
from tests.cli.inside import run
from tests.deploy.synthetic import synthetic_plan, synthetic_rig

EXAMPLES = Path(__file__).parents[2] / "examples"
RIG = EXAMPLES / "rig_mock.toml"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("given")
    assert run("design", EXAMPLES / "wing_naca2412.toml", "-o", "w.design.json", cwd=folder).returncode == 0
    assert run("plan", "w.design.json", "--rig", RIG, "-o", "w.plan.json", cwd=folder).returncode == 0
    return folder


@pytest.mark.parametrize("command", ["deploy", "stow", "recover", "serve"])
def test_a_log_that_is_the_journal_is_refused_before_anything_is_opened(
    made: Path, tmp_path: Path, command: str
) -> None:
    words: tuple[str | Path, ...] = (command, made / "w.plan.json", "--rig", RIG, "--log", "jj", "--journal", "./jj")
    if command == "recover":
        words += ("--design", made / "w.design.json")
    done = run(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("error: --log jj: would take the place of the journal")
    assert "remedy: choose another name for the log" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_log_that_is_the_design_is_refused_and_the_design_stays(made: Path) -> None:
    design = made / "w.design.json"
    before = design.read_bytes()
    done = run("recover", made / "w.plan.json", "--rig", RIG, "--design", design, "--log", design, cwd=made)
    assert done.returncode == 2
    assert "is a file that is read here" in done.stderr
    assert design.read_bytes() == before


@pytest.mark.parametrize("command", ["deploy", "stow", "serve"])
@pytest.mark.parametrize("written", ["--log", "--journal"])
def test_what_the_page_or_the_network_reads_is_displaced_by_nothing(
    made: Path, tmp_path: Path, command: str, written: str
) -> None:
    read = tmp_path / "read.toml"
    shutil.copy(EXAMPLES / "mavlink.toml" if command == "serve" else made / "w.design.json", read)
    before = read.read_bytes()
    option = "--mavlink" if command == "serve" else "--design"
    done = run(command, made / "w.plan.json", "--rig", RIG, option, read, written, read, cwd=tmp_path)
    assert done.returncode == 2
    assert f"{written} {read}: is a file that is read here" in done.stderr
    assert read.read_bytes() == before


def test_a_page_needs_a_plan_that_can_be_read_twice(tmp_path: Path) -> None:
    pipe = tmp_path / "plan"
    os.mkfifo(pipe)
    done = run("deploy", pipe, "--rig", RIG, "--view", cwd=tmp_path)
    assert done.returncode == 2
    assert "limit: a regular file" in done.stderr


@pytest.mark.parametrize("closed", ["<&-", ">&-", "<&- >&- 2>&-"])
def test_a_log_is_whole_whatever_of_the_three_streams_is_closed(made: Path, tmp_path: Path, closed: str) -> None:
    """Reproduced: the log took the number of standard input, which its writer has elsewhere, and was empty."""
    words = [
        sys.executable,
        "-m",
        "ori_deploy.cli",
        "deploy",
        "w.plan.json",
        "--rig",
        RIG,
        "--log",
        tmp_path / "x.mcap",
    ]
    line = f"{shlex.join(map(str, words))} {closed}"
    subprocess.run(["sh", "-c", line], cwd=made, check=True, capture_output=True)
    assert len(read_recording(tmp_path / "x.mcap").tape) > 1


def test_a_journal_that_is_the_plan_is_not_told_to_be_removed(made: Path) -> None:
    done = run("deploy", "w.plan.json", "--rig", RIG, "--journal", "w.plan.json", cwd=made)
    assert done.returncode == 2
    assert "--journal w.plan.json: is a file that is read here" in done.stderr
    assert "remove" not in done.stderr


@pytest.mark.parametrize(
    ("log", "journal"),
    [
        ("jj", "jj"),
        ("jj", "there/../jj"),
        ("link", "jj"),  # leads to jj, which is not there yet
        ("jj", "link"),
        ("hard", "both"),
        ("jj.mcap", "jj-1.mcap"),  # where an older log is kept
        ("jj", "jj.4711.partial"),
        (".jj.4711.partial", "jj"),
    ],
)
def test_names_that_are_or_become_one_file_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, log: str, journal: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there").mkdir()
    Path("link").symlink_to("jj")
    Path("both").touch()
    os.link("both", "hard")
    rig = synthetic_rig(synthetic_plan(4))
    with pytest.raises(FileError, match="would take the place of the journal") as caught:
        refuse_shared(Path(log), Path(journal), rig, None, Path("rig.toml"))
    assert caught.value.remedy is not None


@pytest.mark.parametrize("journal", ["other", "there/jj", "jj.partial", "jj-1", "x.jj.1.partial"])
def test_names_of_their_own_are_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, journal: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    rig = synthetic_rig(synthetic_plan(4))
    for log in (Path("jj.mcap"), Path("loop"), None):
        refuse_shared(log, Path(journal), rig, None, Path("rig.toml"))


@pytest.mark.parametrize("journal", [None, "j"])
def test_a_name_that_cannot_be_is_one_line(made: Path, tmp_path: Path, journal: str | None) -> None:
    """Reproduced: `Path.exists` raises for it, and that was a traceback."""
    words = ("deploy", made / "w.plan.json", "--rig", RIG, "--log", "l" * 300)
    done = run(*words, *(() if journal is None else ("--journal", journal)), cwd=tmp_path)
    assert done.returncode == 2
    assert "the log cannot be written" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_folder_that_may_not_be_looked_into_is_told(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked = os.stat

    def forbidden(path: Any, *given: Any, **named: Any) -> os.stat_result:
        if str(path).startswith(str(tmp_path / "locked")):
            raise PermissionError(13, "Permission denied", str(path))
        return looked(path, *given, **named)

    monkeypatch.setattr(os, "stat", forbidden)
    log, journal = tmp_path / "locked" / "run.mcap", tmp_path / "locked" / "j"
    done = run("deploy", made / "w.plan.json", "--rig", RIG, "--log", log, "--journal", journal, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("error: ")


def test_the_default_journal_counts_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(given, "default_path", lambda *_: tmp_path / "state" / "rig.journal.json")
    rig = synthetic_rig(synthetic_plan(4))
    with pytest.raises(FileError, match="would take the place"):
        refuse_shared(tmp_path / "state" / "rig.journal.json", None, rig, None, Path("rig.toml"))
    refuse_shared(tmp_path / "run.mcap", None, rig, None, Path("rig.toml"))


def test_a_rig_that_can_be_read_only_once_is_in_the_log_as_it_was(made: Path, tmp_path: Path) -> None:
    """As the shell's `--rig <(cat rig.toml)` has it."""
    read, write = os.pipe()
    os.write(write, RIG.read_bytes())
    os.close(write)
    try:
        done = run("deploy", made / "w.plan.json", "--rig", f"/dev/fd/{read}", "--log", "run.mcap", cwd=tmp_path)
    finally:
        os.close(read)
    assert done.returncode == 0, done.stderr
    recording = read_recording(tmp_path / "run.mcap")
    assert recording.files["rig.toml"] == RIG.read_text()
    assert recording.info["rig_sha256"] == digest(RIG)
    assert run("replay", "run.mcap", cwd=tmp_path).returncode == 0


def test_a_rig_that_is_edited_meanwhile_is_in_the_log_as_it_was_used(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_bytes(RIG.read_bytes())
    before = session.make_bus

    def edited(*words: Any) -> Any:
        rig.write_text("something else")
        return before(*words)

    monkeypatch.setattr(session, "make_bus", edited)
    assert run("deploy", made / "w.plan.json", "--rig", rig, "--log", "run.mcap", cwd=tmp_path).returncode == 0
    assert read_recording(tmp_path / "run.mcap").files["rig.toml"] == RIG.read_text()
