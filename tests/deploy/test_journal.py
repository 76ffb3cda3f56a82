"""The journal: on the disk before anything moves, whole or not at all, and believed only when the pose agrees."""

from __future__ import annotations

import json
import math
import os
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.journal import Entry, JournalFile, read_journal, write_entry
from ori_deploy.deploy.result import StartRefused
from ori_deploy.deploy.states import State
from ori_deploy.errors import FileError
from tests.deploy.synthetic import Bench, bench, synthetic_plan

ENTRY = Entry("deploy", "open", "moving", 0.25, 1.0, "d", "r", "2026-01-01 00:00:00")


class SlowJournal:
    """A disk that takes its time: as many looks as it is told."""

    def __init__(self, looks: int, failure: str | None = None, last: Entry | None = None) -> None:
        self.last, self.failure = last, failure
        self.posted: list[Entry] = []
        self._looks, self._left = looks, 0

    def post(self, entry: Entry) -> None:
        self.posted.append(entry)
        self._left = self._looks

    def settled(self) -> bool:
        self._left -= 1
        return self._left < 0


def journalled(journal: object, **given: object) -> Bench:
    b = bench(armed=False, **given)  # type: ignore[arg-type]
    b.controller = Controller(b.plan, b.rig, b.bus, b.clock, [b.records.append], journal)  # type: ignore[arg-type]
    b.controller.connect()
    b.controller.arm()
    return b


# -- the file


def test_what_is_written_is_what_is_read(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    assert read_journal(path) is None
    write_entry(path, ENTRY)
    assert read_journal(path) == ENTRY
    assert list(tmp_path.iterdir()) == [path]


def test_a_write_that_fails_leaves_the_entry_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "journal"
    write_entry(path, ENTRY)
    monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(OSError, match="No space"):
        write_entry(path, Entry("stow", "close", "moving", 1.0, 0.0))
    monkeypatch.undo()
    assert read_journal(path) == ENTRY
    assert list(tmp_path.iterdir()) == [path]


@given(st.one_of(st.binary(max_size=200), st.sampled_from([b"{}", b"[]", b"null", b'{"schema": "x"}'])))
def test_anything_else_is_refused_in_words(content: bytes) -> None:
    path = Path(f"/tmp/journal-test-{os.getpid()}")
    try:
        path.write_bytes(content)
        with pytest.raises(FileError, match="journal"):
            read_journal(path)
    finally:
        path.unlink()


@pytest.mark.parametrize(("key", "value"), [("from_fold", "x"), ("to_fold", None), ("command", 3), ("more", 1)])
def test_a_wrong_value_is_refused(tmp_path: Path, key: str, value: object) -> None:
    path = tmp_path / "journal"
    write_entry(path, ENTRY)
    path.write_text(json.dumps({**json.loads(path.read_text()), key: value}))
    with pytest.raises(FileError, match="not a journal"):
        read_journal(path)


def test_a_folder_that_is_not_there_is_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be written"):
        JournalFile(tmp_path / "none" / "journal")


def test_the_thread_writes_the_last_entry_and_ends(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    with JournalFile(path) as journal:
        for fold in np.linspace(0.0, 1.0, 20):
            journal.post(Entry("deploy", "open", "moving", float(fold), 1.0))
    found = read_journal(path)
    assert found is not None
    assert found.from_fold == 1.0
    assert journal.settled()
    journal.close()


# -- the controller


def test_every_stage_is_on_the_disk_before_it_begins() -> None:
    journal = SlowJournal(looks=30)
    b = journalled(journal)
    b.controller.deploy()
    assert b.controller.run().succeeded
    b.controller.stow()
    assert b.controller.run().succeeded
    told = [(e.command, e.stage, e.state) for e in journal.posted]
    assert told == [
        ("deploy", "unlock", "latching"),
        ("deploy", "open", "moving"),
        ("deploy", "latch", "latching"),
        ("deploy", "", "deployed"),
        ("stow", "unlatch", "latching"),
        ("stow", "close", "moving"),
        ("stow", "lock", "latching"),
        ("stow", "", "stowed"),
    ]
    opening = [r for r in b.records if r.stage == "open"]
    resting = next(k for k, r in enumerate(opening) if r.rate != 0.0)
    assert resting >= 30  # looks that found the disk busy


def test_the_entry_always_covers_where_the_cells_are() -> None:
    journal = SlowJournal(looks=0)
    b = journalled(journal, start_fold=0.3)
    b.controller.deploy()
    for k in range(2000):
        if not b.controller.under_way:
            break
        record = b.controller.step()
        low, high = journal.posted[-1].folds
        assert low - 0.01 <= record.commanded_fold <= high + 0.01
        if k == 80:
            b.controller.stow()
    assert b.controller.state is State.STOWED


def test_a_disk_that_fails_is_told_and_strands_nothing() -> None:
    b = journalled(SlowJournal(looks=3, failure="/x: No space left on device"))
    b.controller.deploy()
    result = b.controller.run()
    assert result.succeeded
    assert any("No space left" in error for error in result.observer_errors)


def test_a_disk_that_never_answers_is_told_and_strands_nothing() -> None:
    b = journalled(SlowJournal(looks=10**9))
    b.controller.deploy()
    result = b.controller.run()
    assert result.succeeded
    assert any("no answer from the disk for 3 s" in error for error in result.observer_errors)


def test_after_a_stop_the_entry_is_where_it_stopped_and_nowhere_else() -> None:
    journal = SlowJournal(looks=0)
    b = journalled(journal)
    b.controller.deploy()
    b.step_until_fold(0.5)
    b.controller.stop()
    b.controller.run()
    entry = journal.posted[-1]
    assert (entry.state, entry.stage) == ("armed", "")
    assert entry.from_fold == entry.to_fold == pytest.approx(b.records[-1].commanded_fold)


def test_turning_round_before_the_path_is_reached_keeps_the_entry_true() -> None:
    journal = SlowJournal(looks=0)
    b = journalled(journal, start_fold=0.5)
    b.controller.deploy()
    while b.controller.step().state is not State.MOVING:
        pass
    b.controller.stow()
    low, high = journal.posted[-1].folds
    assert low <= 0.45
    assert high >= 0.49
    assert b.controller.run().succeeded


def test_the_thread_answers_whatever_goes_wrong(tmp_path: Path) -> None:
    with JournalFile(tmp_path / "journal") as journal:
        journal.post(Entry("deploy", "open", "moving", math.nan, 1.0))
        while not journal.settled():
            time.sleep(0.001)
        assert journal.failure is not None
        journal.post(ENTRY)
    assert journal.failure is None
    assert read_journal(tmp_path / "journal") == ENTRY


@pytest.mark.parametrize(
    ("entry", "fold", "agrees"),
    [
        (Entry("stow", "", "stowed", 0.0, 0.0), 0.0, True),
        (Entry("stow", "", "stowed", 0.0, 0.0), 0.3, False),
        (Entry("deploy", "open", "moving", 0.0, 1.0), 0.3, True),
        (Entry("deploy", "open", "moving", 0.5, 1.0), 0.3, False),
        (Entry("stow", "close", "moving", 0.5, 0.0), 0.3, True),
        (Entry("deploy", "", "deployed", 1.0, 1.0), 0.98, True),
        (Entry("deploy", "", "deployed", 1.0, 1.0), 0.8, False),
        (Entry("stow", "", "stowed", 0.0, 0.0, design_sha256="f" * 64), 0.0, False),
    ],
)
def test_a_motion_starts_only_where_journal_and_pose_agree(entry: Entry, fold: float, agrees: bool) -> None:
    b = journalled(SlowJournal(looks=0, last=entry), start_fold=fold)
    if not agrees:
        with pytest.raises(StartRefused, match=r"journal.*--trust-measured"):
            b.controller.deploy()
        assert b.controller.state is State.ARMED
        b.controller.trust_measured()
    b.controller.deploy()
    assert b.controller.run().succeeded


def test_the_journal_counts_for_the_first_command_only() -> None:
    b = journalled(SlowJournal(looks=0, last=Entry("stow", "", "stowed", 0.0, 0.0)), plan=synthetic_plan(3))
    b.controller.deploy()
    assert b.controller.run().succeeded
    b.controller.stow()
    assert b.controller.run().succeeded
