"""Flights by the command line: what is recorded is decided the same again, however the flight ended."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from ori_deploy.actuators.resolve import resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.cli import screen as screens
from ori_deploy.cli.screen import RemoteScreen
from ori_deploy.clock import VirtualClock
from ori_deploy.deploy.states import IllegalCommand
from ori_deploy.files import load_plan
from ori_deploy.telemetry.read import read_recording, read_run
from ori_deploy.telemetry.schema import TAPE
from ori_deploy.telemetry.tape import PIECE, entries
from ori_deploy.view.events import run_events
from tests.cli.inside import run
from tests.telemetry.flights import recorded

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
RIG = EXAMPLES / "rig_mock.toml"


def chain(folder: Path, example: str) -> Path:
    """Design and plan of an example."""
    assert run("design", EXAMPLES / f"{example}.toml", "-o", "x.design.json", cwd=folder).returncode == 0
    done = run("plan", "x.design.json", "--rig", RIG, "-o", "x.plan.json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "x.plan.json"


@pytest.fixture(scope="session")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return chain(tmp_path_factory.mktemp("flight"), "wing_naca2412")


@pytest.fixture(scope="session")
def log(plan: Path) -> Path:
    done = run("deploy", plan, "--rig", RIG, "--log", "run.mcap", cwd=plan.parent)
    assert done.returncode == 0, done.stderr
    return plan.parent / "run.mcap"


def replayed(log: Path, *words: str | Path, cwd: Path) -> tuple[int, dict[str, Any]]:
    done = run("replay", log, "--json", *words, cwd=cwd)
    assert done.stderr == ""
    return done.returncode, json.loads(done.stdout)


def rig_with(folder: Path, **controller: float) -> Path:
    keys = "\n".join(f"{key} = {value}" for key, value in controller.items())
    path = folder / "other.toml"
    path.write_text(f"{RIG.read_text()}\n[controller]\n{keys}\n")
    return path


@pytest.mark.slow
def test_a_log_replays_by_itself(log: Path, tmp_path: Path) -> None:
    status, told = replayed(log, cwd=tmp_path)
    assert (status, told["same"], told["differences"], told["ends_early"]) == (0, True, [], None)
    assert told["cycles"] == len(read_run(log).time_s)
    assert told["decisions"] > 0.9 * told["cycles"]
    done = run("replay", log, cwd=tmp_path)
    assert done.returncode == 0
    assert done.stdout == (
        f"{told['cycles']:,} cycles, {told['decisions']:,} decisions, {told['commands']} commands the same\n"
    )
    assert list(tmp_path.iterdir()) == []


def test_plan_and_rig_in_a_log_are_the_files_to_the_last_byte(log: Path, plan: Path) -> None:
    recording = read_recording(log)
    assert recording.files == {"plan.json": plan.read_text(), "rig.toml": RIG.read_text()}
    versions = recording.versions
    assert versions["numpy"] == np.__version__
    assert versions["python"].split(".")[0] == "3"
    assert versions["clock"] == "virtual"
    assert "priority" in versions["scheduling"]


def test_another_rig_shows_what_would_have_happened(log: Path, tmp_path: Path) -> None:
    run_ = read_run(log)
    worst = float(np.nanmax(np.abs(run_.tracking_error_rad)))
    other = rig_with(tmp_path, path_tolerance_rad=0.5 * worst, goal_tolerance_rad=0.5 * worst)
    status, told = replayed(log, "--rig", other, cwd=tmp_path)
    assert status == 1
    first = told["differences"][0]
    assert first["what"] == "fault"
    assert first["here"].startswith("path_tolerance of servo_c")
    assert first["logged"] == "none"
    done = run("replay", log, "--rig", other, cwd=tmp_path)
    assert done.returncode == 1
    assert f"then it decides otherwise, in cycle {first['cycle']}" in done.stdout
    assert "state: here fault; in the log moving" in done.stdout


def test_the_report_tells_what_it_ran_on_and_where_the_time_went(log: Path, tmp_path: Path) -> None:
    assert run("report", log, "-o", "r.html", cwd=tmp_path).returncode == 0
    page = (tmp_path / "r.html").read_text()
    for text in ("work of a cycle", "records dropped", "ran on", f"numpy {np.__version__}", "virtual clock"):
        assert text in page


def rewritten(log: Path, path: Path, change: Any) -> Path:
    """The log with every message as `change` makes it; None leaves it out."""
    writer = Writer(str(path))
    writer.start()
    with log.open("rb") as stream:
        rows = [(c.topic, c.message_encoding, m.log_time, m.data) for _, c, m in _messages(stream)]
    channels = {topic: writer.register_channel(topic, encoding, 0) for topic, encoding, _, _ in rows}
    for topic, _, time, data in rows:
        changed = change(topic, data)
        if changed is not None:
            writer.add_message(channels[topic], log_time=time, data=changed, publish_time=time)
    writer.finish()  # type: ignore[no-untyped-call]  # mcap is typed in part
    return path


def _messages(stream: Any) -> Any:
    return make_reader(stream).iter_messages(log_time_order=False)


def test_a_tampered_measurement_is_found_and_told_where(log: Path, tmp_path: Path) -> None:
    at, pieces = 300, 0

    def change(topic: str, data: bytes) -> bytes:
        nonlocal pieces
        if topic != TAPE:
            return data
        pieces += 1
        if pieces != at:
            return data
        readings = next(entry.value for entry in entries(data[PIECE.size :]) if entry.kind == "r")
        moved = readings.position_rad + np.array([0.0, 0.01, 0.0, 0.0])
        assert data.count(readings.position_rad.tobytes()) == 1
        return data.replace(readings.position_rad.tobytes(), moved.tobytes())

    spoilt = rewritten(log, tmp_path / "spoilt.mcap", change)
    status, told = replayed(spoilt, cwd=tmp_path)
    assert status == 1
    assert told["cycles"] in range(at - 6, at)
    assert {d["cycle"] for d in told["differences"]} == {told["cycles"]}
    assert "measured fold of c2" in {d["what"] for d in told["differences"]}


def test_an_old_log_is_told_to_hold_no_tape_and_is_still_reported_on(log: Path, tmp_path: Path) -> None:
    def change(topic: str, data: bytes) -> bytes | None:
        if topic in (TAPE, "/command", "/timing", "/versions", "/file", "/recorder"):
            return None
        return data.replace(b"ori-deploy/log/2", b"ori-deploy/log/1")

    old = rewritten(log, tmp_path / "old.mcap", change)
    done = run("replay", old, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "this log holds no tape; found ori-deploy/log/1" in done.stderr
    done = run("report", old, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Deployed with every latch confirmed" in (tmp_path / "old.html").read_text()


@pytest.mark.parametrize("words", [("--plan", "x.design.json"), ("--rig", "x.plan.json"), ("--rig", "none.toml")])
def test_bad_input_is_one_line(log: Path, words: tuple[str, str]) -> None:
    done = run("replay", log, *words, cwd=log.parent)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


def test_a_file_in_a_log_that_is_not_what_its_digest_says_is_refused(log: Path, tmp_path: Path) -> None:
    spoilt = rewritten(
        log,
        tmp_path / "s.mcap",
        lambda topic, data: data.replace(b"gear_ratio", b"gear_rati0") if topic == "/file" else data,
    )
    done = run("replay", spoilt, cwd=tmp_path)
    assert done.returncode == 2
    assert "rig.toml is not what its digest says" in done.stderr


def with_rig(log: Path, path: Path, text: str, *, ran_with: bool) -> Path:
    """The log with another rig in it, which the structure was moved with or not."""
    digest = hashlib.sha256(text.encode()).hexdigest()

    def change(topic: str, data: bytes) -> bytes:
        row = json.loads(data) if topic in ("/file", "/plan_info") else {}
        if topic == "/plan_info" and ran_with:
            return json.dumps({**row, "rig_sha256": digest}).encode()
        if row.get("name") == "rig.toml":
            return json.dumps({**row, "text": text, "sha256": digest}).encode()
        return data

    return rewritten(log, path, change)


def test_a_rig_in_a_log_that_is_none_is_named_as_what_it_is(log: Path, tmp_path: Path) -> None:
    spoilt = with_rig(log, tmp_path / "s.mcap", 'schema = "ori-deploy/rig/1"\nbackend = "moc"\n', ran_with=True)
    done = run("replay", spoilt, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {spoilt}: its rig.toml: ")


def test_a_rig_in_a_log_that_it_did_not_run_with_is_told_and_can_be_given(log: Path, tmp_path: Path) -> None:
    spoilt = with_rig(log, tmp_path / "s.mcap", "", ran_with=False)
    done = run("replay", spoilt, cwd=tmp_path)
    assert done.returncode == 2
    assert f"{spoilt}: its rig.toml is not the rig that moved the structure; found e3b0c44298fc" in done.stderr
    assert "remedy: give that one with --rig" in done.stderr
    status, told = replayed(spoilt, "--rig", RIG, cwd=tmp_path)
    assert (status, told["same"]) == (0, True)


def test_a_log_of_the_longest_name_replays_and_no_room_for_copies_is_needed(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_room(*_: Any, **__: Any) -> str:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(tempfile, "mkdtemp", no_room)
    path = tmp_path / f"{'l' * 250}.mcap"
    os.link(log, path)
    assert replayed(path, "--rig", rig_with(tmp_path, goal_tolerance_rad=1e-4), cwd=tmp_path)[0] == 1


def with_tape(log: Path, path: Path, change: Callable[[int, bytes], bytes | None]) -> Path:
    """The log with every piece of its tape, by number, as `change` makes it."""
    numbers = itertools.count()
    return rewritten(log, path, lambda topic, data: change(next(numbers), data) if topic == TAPE else data)


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        (0, "nothing was compared: 1 piece of the tape is missing before the first cycle"),
        (300, "the same; what follows was not compared: 1 piece of the tape is missing after cycle 29"),
    ],
)
def test_a_log_with_a_gap_is_not_called_the_same(log: Path, tmp_path: Path, missing: int, words: str) -> None:
    spoilt = with_tape(log, tmp_path / "s.mcap", lambda k, data: None if k == missing else data)
    status, told = replayed(spoilt, cwd=tmp_path)
    assert (status, told["same"], told["differences"]) == (1, None, [])
    assert "is missing" in told["ends_early"]
    done = run("replay", spoilt, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (1, "")
    assert words in done.stdout


def test_what_could_not_be_read_of_a_log_is_not_called_the_same(log: Path, tmp_path: Path) -> None:
    longer = tmp_path / "s.mcap"
    longer.write_bytes(log.read_bytes() * 2)
    status, told = replayed(longer, cwd=tmp_path)
    assert (status, told["same"]) == (1, None)
    assert "not all may have been compared: in the log, " in run("replay", longer, cwd=tmp_path).stdout


def test_a_damaged_tape_is_told_with_the_name_of_the_log(log: Path, tmp_path: Path) -> None:
    spoilt = with_tape(log, tmp_path / "s.mcap", lambda k, data: PIECE.pack(3) + data[8:] if k == 5 else data)
    done = run("replay", spoilt, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {spoilt}: the tape is damaged")
    assert "found piece 3 where piece 5 is due" in done.stderr


@contextlib.contextmanager
def moving(plan: Path, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A deployment in real time, on its way."""
    command = [sys.executable, "-m", "ori_deploy.cli", "deploy", str(plan), "--rig", str(RIG)]
    command += ["--log", "run.mcap", "--realtime"]
    with subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if "-> moving" in line:
                break
        yield process


def test_a_flight_that_was_interrupted_is_decided_the_same_again(plan: Path, tmp_path: Path) -> None:
    with moving(plan, tmp_path) as process:
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to everybody in the group
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    run_ = read_run(tmp_path / "run.mcap")
    assert (run_.complete, run_.dropped) == (True, 0)
    assert [c["command"] for c in run_.commands][-2:] == ["stop", "close"]
    status, told = replayed(tmp_path / "run.mcap", cwd=tmp_path)
    assert (status, told["cycles"]) == (0, len(run_.time_s))


def test_a_flight_that_was_killed_is_decided_the_same_up_to_there(plan: Path, tmp_path: Path) -> None:
    with moving(plan, tmp_path) as process:
        process.kill()
        process.communicate(timeout=60)  # until the recorder and the screen have let go of the output, too
    log = tmp_path / "run.mcap"
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]
    status, told = replayed(log, cwd=tmp_path)
    assert status == 0
    assert told["ends_early"] == "the log is cut off there"
    assert told["cycles"] == len(read_run(log).time_s) > 0
    assert run("report", log, cwd=tmp_path).returncode == 0
    assert "the process of the control loop ended without a word" in (tmp_path / "run.html").read_text()


def test_an_output_that_stands_still_does_not_hold_up_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(screens, "_STOP_S", 0.5)
    read, write = os.pipe()
    try:
        shown = RemoteScreen(write)
        for k in range(20_000):
            shown.show("moving", 0.5, float(k), 0.0, "")
            if k % 100 == 0:
                shown.line("x" * 1000)  # more than a pipe holds, and nobody reads
        shown.close()
        assert shown._process.returncode is not None
    finally:
        os.close(read)
        os.close(write)


@pytest.mark.slow
@pytest.mark.parametrize("example", ["ellipse_4", "wing_two_spars"])
@pytest.mark.parametrize("command", ["deploy", "stow"])
def test_every_example_is_decided_the_same_again(example: str, command: str, tmp_path: Path) -> None:
    made = chain(tmp_path, example)
    assert run(command, made, "--rig", RIG, "--log", "run.mcap", cwd=tmp_path).returncode == 0
    status, told = replayed(tmp_path / "run.mcap", cwd=tmp_path)
    assert (status, told["differences"]) == (0, [])


def test_a_folder_that_is_made_and_a_log_that_is_kept_are_told(plan: Path, tmp_path: Path) -> None:
    words = ("deploy", plan, "--rig", RIG, "--log", "new/run.mcap")
    first = run(*words, cwd=tmp_path)
    assert first.stderr == "note: made the folder new for the log\n"
    second = run(*words, cwd=tmp_path)
    assert second.stderr == "note: new/run.mcap is there already; it is kept as new/run-1.mcap\n"
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["run-1.mcap", "run.mcap"]


def test_what_was_refused_is_in_the_report(plan: Path, tmp_path: Path) -> None:
    made = load_plan(plan)
    rig = resolve_rig(load_rig(RIG), made.cell_ids, made.latch_points)
    with recorded(tmp_path / "run.mcap", made, rig, VirtualClock(100.0)) as (f, _):
        f.controller.connect()
        f.controller.arm()
        with pytest.raises(IllegalCommand):
            f.controller.resume()
        f.controller.limit_speed(0.5)
        f.controller.step()
    events = {(e.what, e.thing): e.detail for e in run_events(read_run(tmp_path / "run.mcap"))}
    assert events["command", "resume"].startswith("refused: IllegalCommand: resume: not allowed")
    assert events["command", "limit_speed"] == "done to 50 % of the plan's"
    assert ("command", "arm") not in events
