"""A flight log says what happened, survives a crash, and never leaves half a file under its name."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from ori_deploy.deploy.result import CycleRecord, FaultKind
from ori_deploy.deploy.states import State
from ori_deploy.errors import FileError
from ori_deploy.telemetry.log import FLUSH_EVERY_S
from ori_deploy.telemetry.read import Run, read_run
from ori_deploy.telemetry.schema import CHANNELS
from ori_deploy.telemetry.summary import summarise
from tests.deploy.synthetic import Bench, bench, synthetic_plan
from tests.telemetry.inline import InlineLog, logged


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


@pytest.mark.parametrize("n_cells", [4, 12])
def test_what_is_read_is_what_was_recorded(path: Path, n_cells: int) -> None:
    b, result = logged(path, n_cells=n_cells)
    run = read_run(path)
    assert run.complete
    assert run.results == (result,)
    assert run.faults == ()
    assert run.state == tuple(str(record.state) for record in b.records)
    assert run.stage == tuple(record.stage or "" for record in b.records)
    assert run.transitions == tuple(t for record in b.records for t in record.transitions)
    for name in ("rate", "rate_limit", "commanded_fold", "path_time_s", "lost_replies", "overruns"):
        expected = [getattr(record, name) for record in b.records]
        np.testing.assert_allclose(getattr(run, name), expected, atol=1e-6)
    for name in ("position_rad", "velocity_rad_s", "current_a", "valid"):
        expected = [getattr(record.readings, name) for record in b.records]
        np.testing.assert_allclose(getattr(run, name), expected, rtol=1e-6)
    np.testing.assert_allclose(run.fold, [record.folds for record in b.records], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(run.commanded_rad, [record.commanded_rad for record in b.records], rtol=1e-6)
    health = [record.health for record in b.records if record.health is not None]
    np.testing.assert_allclose(run.temperature_c, [h.temperature_c for h in health])
    np.testing.assert_allclose(run.voltage_v, [h.voltage_v for h in health])
    latches = [reading.id for record in b.records for reading in record.latches or ()]
    assert [reading.id for reading in run.latches] == latches


def test_what_was_lost_is_not_a_number(path: Path) -> None:
    logged(path)
    run = read_run(path)
    lost = ~run.valid
    assert lost.sum() == 2
    for array in (run.position_rad, run.velocity_rad_s, run.current_a, run.fold, run.age_s):
        np.testing.assert_array_equal(np.isnan(array), lost)


def test_log_names_plan_rig_and_version(path: Path) -> None:
    b, _ = logged(path)
    info = read_run(path).info
    assert info["plan_sha256"] == "ab" * 32
    assert info["design_sha256"] == b.plan.design_sha256
    assert info["hinge_ids"] == list(b.rig.hinge_ids)
    assert info["version"]
    assert info["seed"] == 3


def test_every_message_has_the_fields_of_its_schema(path: Path) -> None:
    logged(path, fault=True)
    seen = set()
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            assert schema.encoding == "jsonschema"
            assert channel.message_encoding == "json"
            properties = json.loads(schema.data)["properties"]
            assert json.loads(message.data).keys() == properties.keys() == CHANNELS[channel.topic].keys()
            seen.add(channel.topic)
    assert seen == set(CHANNELS) - {"/command", "/file", "/timing", "/versions"}


def test_messages_carry_the_time_of_their_cycle(path: Path) -> None:
    b, _ = logged(path)
    with path.open("rb") as stream:
        times = [message.log_time for _, _, message in make_reader(stream).iter_messages(["/cycle"])]
    np.testing.assert_allclose(np.array(times) * 1e-9, [record.time_s for record in b.records], atol=1e-8)


def test_fault_is_logged_once_with_its_reason(path: Path) -> None:
    _, result = logged(path, fault=True)
    run = read_run(path)
    assert run.faults == (result.fault,)
    assert run.faults[0].kind is FaultKind.HARDWARE_ERROR
    assert run.results == (result,)


def test_name_appears_only_when_the_log_is_whole(path: Path) -> None:
    b = bench()
    log = InlineLog(path, b.plan, b.rig)
    b.controller.add_observer(log)
    b.controller.deploy()
    b.controller.run()
    assert not path.exists()
    assert log.partial_path.exists()
    log.close()
    log.close()
    assert path.exists()
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("there", [False, True])
def test_a_link_stays_a_link_and_the_log_is_where_it_leads(tmp_path: Path, there: bool) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    link = tmp_path / "run.mcap"
    link.symlink_to(disk / "newest.mcap")
    if there:
        (disk / "newest.mcap").write_text("an older log")
    _, result = logged(link)
    assert result.succeeded
    assert link.is_symlink()
    assert len(read_run(disk / "newest.mcap").time_s) > 0
    kept = ["newest-1.mcap"] if there else []
    assert sorted(path.name for path in disk.iterdir()) == [*kept, "newest.mcap"]
    assert [path.name for path in tmp_path.iterdir() if path != disk] == ["run.mcap"]


@pytest.mark.parametrize("cut_bytes", [0, 1, 500, 5000])
def test_a_log_cut_off_by_a_crash_can_be_read_up_to_about_the_last_second(path: Path, cut_bytes: int) -> None:
    b = bench(synthetic_plan(4, duration_s=6.0))
    log = InlineLog(path, b.plan, b.rig)
    b.controller.add_observer(log)
    b.controller.deploy()
    b.controller.run()
    crashed = path.with_name("crashed.mcap")
    data = log.partial_path.read_bytes()
    crashed.write_bytes(data[: len(data) - cut_bytes])
    log.close()
    run = read_run(crashed)
    assert not run.complete
    missing_s = b.records[-1].time_s - run.time_s[-1]
    assert 0.0 <= missing_s < (1.0 if cut_bytes == 0 else 3.0)
    np.testing.assert_allclose(
        run.position_rad, [r.readings.position_rad for r in b.records[: len(run.time_s)]], rtol=1e-6
    )


def test_a_log_cut_off_anywhere_is_read_as_far_as_it_goes_or_refused(path: Path) -> None:
    b, _ = logged(path)
    data = path.read_bytes()
    cut = path.with_name("cut.mcap")
    lengths = []
    for length in range(0, len(data), 997):
        cut.write_bytes(data[:length])
        try:
            run = read_run(cut)
        except FileError:
            lengths.append(0)
        else:
            assert not run.complete
            lengths.append(len(run.time_s))
    assert lengths == sorted(lengths)
    assert lengths[0] == 0
    assert lengths[-1] == len(b.records)


def test_a_full_disk_is_reported_and_the_motion_finishes(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    b = bench()
    log = InlineLog(path, b.plan, b.rig)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(log._writer, "add_message", full)
    b.controller.add_observer(log)
    b.controller.deploy()
    result = b.controller.run()
    assert result.succeeded
    assert "No space left on device" in result.observer_errors[0]


class SmallDisk(io.FileIO):
    """A file on a disk with little room."""

    room = 12_000

    def write(self, data: Any) -> int:
        left = self.room - self.tell()
        if left <= 0:
            raise OSError(28, "No space left on device")
        return super().write(bytes(data)[:left]) or 0


def log_on_a_small_disk(path: Path, b: Bench, monkeypatch: pytest.MonkeyPatch) -> InlineLog:
    usual = Path.open

    def small(self: Path, mode: str = "r", *others: Any, **named: Any) -> Any:
        return io.BufferedWriter(SmallDisk(self, mode)) if mode == "wb" else usual(self, mode, *others, **named)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", small)
        return InlineLog(path, b.plan, b.rig)


def test_closing_on_a_full_disk_names_the_file_that_holds_the_rest(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    b = bench()
    log = log_on_a_small_disk(path, b, monkeypatch)
    b.controller.add_observer(log)
    b.controller.deploy()
    result = b.controller.run()
    assert result.succeeded
    assert "No space left on device" in result.observer_errors[0]
    monkeypatch.setattr(SmallDisk, "room", 10**9)  # room again does not make the log whole
    with pytest.raises(OSError, match="No space left"):
        log.write_result(result)
    with pytest.raises(OSError, match="No space left on device") as caught:
        log.close()
    assert caught.value.errno == 28
    assert str(log.partial_path) in str(caught.value)
    log.close()
    assert not path.exists()
    run = read_run(log.partial_path)
    assert not run.complete
    assert run.time_s[-1] - run.time_s[0] > 0.5


def test_disk_that_is_full_only_at_close_is_reported(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    b = bench()
    b.steps(3)
    log = log_on_a_small_disk(path, b, monkeypatch)
    log(b.records[-1])
    log._stream.flush()
    monkeypatch.setattr(SmallDisk, "room", 0)
    with pytest.raises(OSError, match=r"run\.mcap.*\.partial"):
        log.close()
    log.close()
    assert log.partial_path.exists()
    assert len(read_run(log.partial_path).time_s) == 1


def test_full_disk_does_not_hide_what_ended_the_run(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    b = bench()
    b.steps(3)

    def run() -> None:
        with log_on_a_small_disk(path, b, monkeypatch) as log:
            log(b.records[-1])
            monkeypatch.setattr(SmallDisk, "room", 0)
            raise KeyError("what ended the run")

    with pytest.raises(KeyError, match="what ended the run") as caught:
        run()
    assert any(".partial" in note for note in caught.value.__notes__)


@pytest.mark.parametrize("every", [1, 5, 50])
def test_a_crash_at_any_moment_and_rate_costs_half_a_second(path: Path, every: int) -> None:
    b = bench(synthetic_plan(1, duration_s=6.0))
    b.controller.deploy()
    b.controller.run()
    log = InlineLog(path, b.plan, b.rig)
    for k, record in enumerate(b.records[::every]):
        log(record)
        if k % 7 == 0 or every == 50:
            assert record.time_s - read_run(log.partial_path).time_s[-1] < FLUSH_EVERY_S + 1e-6
    log.close()
    assert len(read_run(path).time_s) == len(b.records[::every])


def test_a_result_is_safe_from_a_crash_at_once(path: Path) -> None:
    b = bench()
    log = InlineLog(path, b.plan, b.rig)
    b.controller.add_observer(log)
    b.controller.deploy()
    result = b.controller.run()
    log.write_result(result)
    assert read_run(log.partial_path).results == (result,)
    log.close()


def not_finite(record: CycleRecord, value: float) -> CycleRecord:
    """A record with `value` wherever there is a number of the first cell, and in many scalars."""

    def spoilt(array: Any) -> Any:
        copied = np.array(array, dtype=np.float64)
        copied[0] = value
        return copied

    readings, health = record.readings, record.health
    assert health is not None
    return replace(
        record,
        time_s=value,
        deadline_s=0.0,
        path_time_s=value,
        rate=value,
        rate_limit=value,
        commanded_fold=value,
        folds=spoilt(record.folds),
        commanded_rad=spoilt(record.commanded_rad),
        readings=replace(
            readings,
            position_rad=spoilt(readings.position_rad),
            velocity_rad_s=spoilt(readings.velocity_rad_s),
            current_a=spoilt(readings.current_a),
        ),
        health=replace(health, temperature_c=spoilt(health.temperature_c), voltage_v=spoilt(health.voltage_v)),
    )


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_null_in_every_message(path: Path, value: float) -> None:
    b = bench()
    b.controller.deploy()
    result = replace(b.controller.run(), worst_tracking_rad=value, duration_s=value)
    records = [record for record in b.records if record.health is not None]
    with InlineLog(path, b.plan, b.rig) as log:
        log(records[0])
        log(replace(not_finite(records[1], value), time_s=records[1].time_s))
        log(records[2])
        log.write_result(result)
    run = read_run(path)
    assert run.complete
    for name in ("path_time_s", "rate", "rate_limit", "commanded_fold"):
        np.testing.assert_array_equal(np.isnan(getattr(run, name)), [False, True, False])
    arrays = ("fold", "commanded_rad", "position_rad", "velocity_rad_s", "current_a", "temperature_c", "voltage_v")
    for name in arrays:
        assert np.isnan(getattr(run, name)[1, 0])
        assert np.isfinite(getattr(run, name)[1, 1:]).all()
    assert np.isnan([run.results[0].worst_tracking_rad, run.results[0].duration_s]).all()
    summarise(run)


def slow_worst_tracking(run: Run) -> list[float]:
    """Cycle by cycle: what is measured against the goal sent before."""
    worst = [0.0] * run.valid.shape[1]
    gear, zero = run.info["shaft_per_crease"], run.info["zero_rad"]
    for k in range(1, len(run.time_s)):
        for i in range(len(worst)):
            if run.valid[k, i]:
                measured = (run.position_rad[k, i] - zero[i]) / gear[i]
                wanted = (run.commanded_rad[k - 1, i] - zero[i]) / gear[i]
                worst[i] = max(worst[i], abs(measured - wanted))
    return worst


def test_summary_adds_up(path: Path) -> None:
    b, result = logged(path)
    run = read_run(path)
    summary = summarise(run)
    assert summary.complete
    assert summary.cycles == len(b.records)
    assert summary.duration_s == pytest.approx(b.records[-1].time_s - b.records[0].time_s, abs=1e-6)
    assert summary.lost_replies == 2
    assert summary.overruns == 0
    np.testing.assert_allclose([worst.error_rad for worst in summary.tracking], slow_worst_tracking(run))
    assert [worst.cell_id for worst in summary.tracking] == list(b.plan.cell_ids)
    assert summary.worst_tracking is not None
    assert summary.worst_tracking.error_rad == pytest.approx(result.worst_tracking_rad, rel=1e-4)
    assert summary.worst_tracking.hinge_id == result.worst_tracking_hinge
    assert set(summary.latch_confirmed_s) == set(b.rig.latch_ids)
    (secured,) = (t for t in run.transitions if t.target is State.DEPLOYED)
    at = secured.time_s - b.records[0].time_s
    assert all(time_s == pytest.approx(at, abs=0.03) for time_s in summary.latch_confirmed_s.values())
    assert summary.results == (result,)
    assert 20.0 < summary.hottest_c < 30.0
    assert 11.0 < summary.lowest_v < 12.0
    assert summary.largest_spread == pytest.approx(np.nanmax(np.ptp(run.fold, axis=1)), rel=1e-9)


def test_latch_that_was_never_confirmed_is_missing_from_the_summary(path: Path) -> None:
    b = bench()
    b.bus.latch_blind("latch_slit:P-T2")
    with InlineLog(path, b.plan, b.rig) as log:
        b.controller.add_observer(log)
        b.controller.deploy()
        log.write_result(b.controller.run())
    assert set(summarise(read_run(path)).latch_confirmed_s) == {"latch_cell:c1"}
