"""The recorder in a process of its own: its log is whole, and nothing that happens to it reaches the motion."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Statistics

from ori_deploy.clock import VirtualClock
from ori_deploy.telemetry import recorder as recorder_module
from ori_deploy.telemetry.read import read_recording, read_run
from ori_deploy.telemetry.replay import replay
from ori_deploy.telemetry.schema import CHANNELS, TAPE, TAPE_ENCODING
from ori_deploy.telemetry.taped import PIECE_BYTES
from tests.deploy.synthetic import synthetic_plan, synthetic_rig
from tests.telemetry.flights import Flight, recorded

ROOT = Path(__file__).parents[2]
PLAN = synthetic_plan(4)
RIG = synthetic_rig(PLAN)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def begin(f: Flight, steps: int = 50) -> None:
    f.controller.connect()
    f.controller.arm()
    f.controller.deploy()
    for _ in range(steps):
        f.controller.step()


def deploy(path: Path, *, overload: bool = False) -> Flight:
    with recorded(path, PLAN, RIG, VirtualClock(100.0)) as (f, recorder):
        begin(f)
        if overload:
            f.bus.overload("servo_c1")
        recorder.write_result(f.controller.run())
        f.controller.close()
    return f


def test_every_message_is_as_its_schema_says_and_an_indexed_reader_finds_all(path: Path) -> None:
    f = deploy(path, overload=True)
    seen: dict[str, int] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream)
        for schema, channel, message in reader.iter_messages():
            seen[channel.topic] = seen.get(channel.topic, 0) + 1
            if channel.topic == TAPE:
                assert (schema, channel.message_encoding) == (None, TAPE_ENCODING)
                continue
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            properties = json.loads(schema.data)["properties"]
            assert json.loads(message.data).keys() == properties.keys() == CHANNELS[channel.topic].keys()
        summary = reader.get_summary()
    assert seen.keys() == {*CHANNELS, TAPE}
    assert seen["/cycle"] == seen["/timing"] == len(f.records)
    assert summary is not None
    assert isinstance(summary.statistics, Statistics)
    assert summary.statistics.message_count == sum(seen.values())
    assert 100.0 <= 1e-9 * summary.statistics.message_start_time < 1e-9 * summary.statistics.message_end_time < 110.0


def test_what_is_read_is_what_was_recorded(path: Path) -> None:
    f = deploy(path)
    run = read_run(path)
    assert (run.complete, run.ending, run.dropped) == (True, "closed", 0)
    np.testing.assert_allclose(run.position_rad, [r.readings.position_rad for r in f.records], rtol=1e-6)
    np.testing.assert_allclose(run.timing["time_s"], run.time_s, atol=1e-6)
    for name in ("wait_s", "read_s", "send_s", "decide_s", "record_s"):
        assert (run.timing[name] >= 0.0).all()
    assert [c["command"] for c in run.commands] == ["connect", "arm", "deploy", "run", "close"]
    assert {c["outcome"] for c in run.commands} == {"done"}
    assert run.results[0].observer_errors == ()
    recording = read_recording(path)
    assert recording.files == {"note": "a plan\n"}
    assert replay(recording.tape, PLAN, RIG).same


def test_a_virtual_clock_waits_for_the_recorder_instead_of_losing_records(path: Path) -> None:
    with recorded(path, PLAN, RIG, VirtualClock(100.0), room_bytes=1) as (f, _):
        begin(f)
        assert f.controller.run().observer_errors == ()
    assert len(read_run(path).time_s) == len(f.records)


def test_a_recorder_that_is_too_far_behind_loses_records_and_says_so(path: Path) -> None:
    with recorded(path, PLAN, RIG, VirtualClock(100.0), waits=False, room_bytes=1) as (f, recorder):
        os.kill(recorder.pid, signal.SIGSTOP)
        begin(f)
        for _ in range(2000):  # more than any socket holds
            f.controller.step()
        result = f.controller.run()
        os.kill(recorder.pid, signal.SIGCONT)
        recorder.write_result(result)
        f.controller.close()
    assert result.succeeded
    (told,) = result.observer_errors
    assert "records dropped" in told
    run = read_run(path)
    assert run.complete
    assert run.dropped > 0
    assert len(run.time_s) + run.dropped >= len(f.records)
    assert run.results == (result,)
    recording = read_recording(path)
    done = replay(recording.tape, PLAN, RIG)
    assert done.differences == ()
    assert not done.same  # nobody knows what was dropped
    assert "missing after cycle" in done.gap
    assert done.cycles < len(f.records)


def test_the_recorder_is_deaf_to_what_ends_a_session(path: Path) -> None:
    with recorded(path, PLAN, RIG, VirtualClock(100.0)) as (f, recorder):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(recorder.pid, number)
        assert os.getpgid(recorder.pid) != os.getpgid(0)
        begin(f)
        assert f.controller.run().observer_errors == ()
    assert len(read_run(path).time_s) == len(f.records)


def test_killing_the_recorder_does_not_end_the_motion_and_is_reported(path: Path) -> None:
    with recorded(path, PLAN, RIG, VirtualClock(100.0)) as (f, recorder):
        begin(f, 120)
        os.kill(recorder.pid, signal.SIGKILL)
        result = f.controller.run()
        assert result.succeeded
        assert f"process {recorder.pid}" in result.observer_errors[0]
        recorder.write_result(result)
        with pytest.raises(OSError, match="killed by signal 9") as caught:
            recorder.close()
        assert str(recorder.partial_path) in str(caught.value)
        recorder.close()
    assert not path.exists()
    rest = read_run(recorder.partial_path)
    assert not rest.complete
    assert rest.time_s[-1] >= f.records[119].time_s - 0.6  # virtual: it may have been behind by a socket as well


def test_a_recorder_that_is_killed_between_commands_is_reported_in_the_result(path: Path) -> None:
    with recorded(path, PLAN, RIG, VirtualClock(100.0)) as (f, recorder):
        begin(f)
        while f.controller.under_way:
            f.controller.step()
        os.kill(recorder.pid, signal.SIGKILL)
        recorder._process.wait()
        f.controller.result()  # goes onto the tape, too
        assert "flight recorder: " in f.controller.result().observer_errors[0]


def test_without_its_recorder_a_loop_keeps_no_tape(path: Path) -> None:
    """A loop may hold a structure for hours after a disk was full."""
    with recorded(path, PLAN, RIG, VirtualClock(100.0)) as (f, recorder):
        begin(f)
        os.kill(recorder.pid, signal.SIGKILL)
        recorder._process.wait()
        assert f.controller.run().succeeded
        for _ in range(200):
            f.controller.step()
        assert len(recorder.tape.data) == 0
        with pytest.raises(OSError, match="killed by signal 9"):
            recorder.close()


def test_a_tape_is_handed_over_in_pieces_while_there_are_no_cycles(path: Path) -> None:
    with recorded(path, PLAN, RIG, VirtualClock(100.0)) as (f, recorder):
        begin(f)
        f.controller.run()
        f.controller.disarm()
        f.controller.disconnect()
        longest = 0
        for _ in range(PIECE_BYTES // 5):
            assert not f.controller.under_way
            longest = max(longest, len(recorder.tape.data))
        assert 0.9 * PIECE_BYTES < longest < 1.1 * PIECE_BYTES
        f.controller.close()
    assert replay(read_recording(path).tape, PLAN, RIG).same


@contextmanager
def room_for(size: int) -> Iterator[None]:
    """Files of processes that are started meanwhile cannot grow beyond this."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_does_not_end_the_motion_and_is_reported(path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with room_for(25_000):
        session = recorded(path, PLAN, RIG, VirtualClock(100.0))
        f, recorder = session.__enter__()
    assert resource.getrlimit(resource.RLIMIT_FSIZE) == before
    try:
        begin(f)
        result = f.controller.run()
        for _ in range(400):
            f.controller.step()
        f.controller.stow()
        result = f.controller.run()
        assert result.succeeded
        assert "File too large" in result.observer_errors[0]
        with pytest.raises(OSError, match="File too large") as caught:
            recorder.close()
        assert str(recorder.partial_path) in str(caught.value)
    finally:
        session.__exit__(None, None, None)
    assert not path.exists()
    rest = read_run(recorder.partial_path)
    assert not rest.complete
    assert 0 < len(rest.time_s) < len(f.records)


def test_a_recorder_that_does_not_come_up_is_an_error_before_anything_moves(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(OSError, match="ended before its time"), recorded(path, PLAN, RIG, VirtualClock(100.0)):
        pass
    assert list(path.parent.iterdir()) == []


def test_a_recorder_that_is_stuck_is_left_alone_and_told_of(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "STOP_S", 0.2)
    with recorded(path, PLAN, RIG, VirtualClock(100.0)) as (f, recorder):
        begin(f)
        os.kill(recorder.pid, signal.SIGSTOP)
        try:
            with pytest.raises(OSError, match="has not finished"):
                recorder.close()
        finally:
            os.kill(recorder.pid, signal.SIGCONT)
        recorder._process.wait(30)
    assert len(read_run(path).time_s) == len(f.records)  # it still did its work


LOOP = """
import sys
from pathlib import Path
from ori_deploy.clock import MonotonicClock
from ori_deploy.telemetry.taped import PIECE_BYTES
from tests.deploy.synthetic import synthetic_plan, synthetic_rig
from tests.telemetry.flights import recorded
plan = synthetic_plan(4, duration_s=20.0)
with recorded(Path(sys.argv[1]), plan, synthetic_rig(plan), MonotonicClock()) as (f, recorder):
    f.controller.connect()
    f.controller.arm()
    f.controller.deploy()
    while True:
        print(f.controller.step().time_s, recorder.pid, flush=True)
"""


@pytest.mark.slow
def test_killing_the_loop_leaves_a_log_that_is_whole_up_to_the_last_moment(path: Path) -> None:
    command = [sys.executable, "-c", LOOP, str(path)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as loop:
        assert loop.stdout is not None
        lines = [loop.stdout.readline() for _ in range(90)]
        loop.kill()
        lines += loop.stdout.readlines()
    last_s, pid = lines[-1].split() if lines[-1].endswith("\n") else lines[-2].split()
    # The recorder is nobody's child now; that it has ended shows in its name being the log's.
    ended = subprocess.run(["tail", "-s", "0.05", f"--pid={pid}", "-f", "/dev/null"], timeout=30, check=False)
    assert ended.returncode == 0
    run = read_run(path)
    assert float(last_s) - run.time_s[-1] < 0.1  # seconds of the run, not of this test
    assert not run.complete
    assert run.ending == "the process of the control loop ended without a word"
    assert list(path.parent.iterdir()) == [path]
    plan = synthetic_plan(4, duration_s=20.0)
    recording = read_recording(path)
    assert recording.cut_off
    done = replay(recording.tape, plan, synthetic_rig(plan))
    assert done.same
    assert done.cycles == len(run.time_s)


def test_behind_a_queue_what_is_measured_answers_to_the_goal_that_is_due(path: Path) -> None:
    """Reproduced: a perfect run behind a queue of 0.3 s was told as 0.3 s of motion off."""
    deploy(path)
    logged = read_run(path)
    assert logged.info["delay_s"] == 0.0
    assert np.nanmax(np.abs(logged.tracking_error_rad)) < 0.05
    delay_s, gear = 0.3, np.array(logged.info["shaft_per_crease"])
    late = np.stack(
        [np.interp(logged.time_s - delay_s, logged.time_s, one) for one in logged.commanded_rad.T], axis=1
    )
    queued = replace(logged, info={**logged.info, "delay_s": delay_s}, position_rad=late)
    known = np.isfinite(queued.tracking_error_rad)
    assert known.mean() > 0.8
    assert np.abs(queued.tracking_error_rad[known]).max() < 1e-9
    off = replace(queued, position_rad=late + 0.2 * gear)
    np.testing.assert_allclose(off.tracking_error_rad[known], 0.2, atol=1e-9)
    unaware = replace(logged, position_rad=late)  # what an old log would say of it
    assert np.nanmax(np.abs(unaware.tracking_error_rad)) > 0.1


def test_behind_a_queue_nothing_is_known_from_a_fault_until_new_goals_are_due(path: Path) -> None:
    deploy(path)
    logged = read_run(path)
    at = len(logged.time_s) // 2
    state = tuple("fault" if at <= k < at + 5 else one for k, one in enumerate(logged.state))
    error = replace(logged, info={**logged.info, "delay_s": 0.3}, state=state).tracking_error_rad
    after = logged.time_s - logged.time_s[at + 4]
    assert np.isnan(error[at:][after[at:] <= 0.3]).all()
    assert np.isfinite(error[after > 0.31]).all()
    assert np.isfinite(error[at - 1]).all()


def test_where_records_were_dropped_neighbours_are_not_compared(path: Path) -> None:
    deploy(path)
    logged = read_run(path)
    keep = np.ones(len(logged.time_s), dtype=bool)
    keep[100:150] = False
    rows = {name: getattr(logged, name)[keep] for name in ("time_s", "commanded_rad", "position_rad")}
    error = replace(logged, dropped=50, **rows).tracking_error_rad
    assert np.isnan(error[100]).all()
    assert np.isfinite(error[99]).all()
    assert np.isfinite(error[101]).all()
