"""Logs that are damaged, foreign, old or too large: what is whole of them is read, and the rest is told."""

from __future__ import annotations

import io
import json
import random
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import Writer

from ori_deploy.errors import FileError
from ori_deploy.telemetry.read import read_recording, read_run
from ori_deploy.telemetry.summary import summarise
from tests.telemetry.inline import logged


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def test_flipped_bits_give_what_is_whole_or_a_file_error(path: Path) -> None:
    b, _ = logged(path, fault=True)
    data = path.read_bytes()
    spoilt = path.with_name("spoilt.mcap")
    rng = random.Random(7)
    refused = cut = 0
    times = np.array([record.time_s for record in b.records])
    for trial in range(300):
        flipped = bytearray(data)
        span = 4096 if trial % 2 else len(data)  # the begin of the file has the most to go wrong
        for _ in range(1 + trial % 3):
            flipped[rng.randrange(span)] ^= 1 << rng.randrange(8)
        spoilt.write_bytes(flipped)
        try:
            run = read_run(spoilt)
        except FileError:
            refused += 1
        else:
            summarise(run)
            cut += not run.complete
            rows = np.abs(times[:, None] - run.time_s).argmin(axis=0)
            expected = [b.records[row].readings.position_rad for row in rows]
            np.testing.assert_allclose(run.position_rad, expected, rtol=1e-6)
    assert refused > 0
    assert cut > 0


Messages = list[tuple[str, bytes]]


def messages_of(path: Path) -> Messages:
    with path.open("rb") as stream:
        found = make_reader(stream).iter_messages(log_time_order=False)
        return [(channel.topic, message.data) for _, channel, message in found]


def write_messages(path: Path, messages: Messages) -> None:
    """An intact MCAP file, whatever is in its messages."""
    writer = Writer(str(path))
    writer.start()
    topics = {topic for topic, _ in messages}
    channels = {topic: writer.register_channel(topic, "json", 0) for topic in sorted(topics)}
    for topic, data in messages:
        writer.add_message(channels[topic], log_time=0, data=data, publish_time=0)
    writer.finish()  # type: ignore[no-untyped-call]  # mcap is typed in part


@pytest.mark.parametrize(
    "junk", [b"", b"{", b"\xff\xfe", b"[]", b"null", b"[" * 100_000, b'{"index": ' + b"1" * 5000 + b"}"]
)
def test_message_that_cannot_be_decoded_is_left_out(path: Path, junk: bytes) -> None:
    b, _ = logged(path)
    messages = messages_of(path)
    messages.insert(20, ("/cycle", junk))
    write_messages(path, messages)
    run = read_run(path)
    assert not run.complete
    assert len(run.time_s) == len(b.records)


def test_an_older_log_is_read_as_it_is(path: Path) -> None:
    logged(path)
    messages = messages_of(path)
    at = next(i for i, (name, _) in enumerate(messages) if name == "/plan_info")
    info = json.loads(messages[at][1])
    assert info.pop("delay_s") == 0.0
    before = read_run(path)
    messages[at] = ("/plan_info", json.dumps(info).encode())
    write_messages(path, messages)
    np.testing.assert_array_equal(read_run(path).tracking_error_rad, before.tracking_error_rad)


@pytest.mark.parametrize(
    ("topic", "key", "value"),
    [
        ("/cycle", "position_rad", [1.0]),
        ("/cycle", "position_rad", "far"),
        ("/cycle", "time_s", {}),
        ("/cycle", "overruns", 10**40),
        ("/cycle", "state", "elsewhere"),
        ("/cycle", "state", []),
        ("/cycle", "valid", None),
        ("/cycle", "fold", ...),
        ("/plan_info", "hinge_ids", 3),
        ("/plan_info", "zero_rad", ["a", "b", "c", "d"]),
        ("/plan_info", "shaft_per_crease", ...),
        ("/plan_info", "delay_s", "late"),
        ("/plan_info", "rate_hz", ...),
        ("/plan_info", "schema", []),
        ("/health", "voltage_v", [12.0]),
        ("/state", "event", "magic"),
        ("/latch", "id", ...),
        ("/latch", "colour", "red"),
        ("/fault", "kind", ["x"]),
        ("/result", "fault", "all of it"),
        ("/result", "duration_s", [1]),
    ],
)
def test_message_that_makes_no_sense_is_a_file_error(path: Path, topic: str, key: str, value: object) -> None:
    logged(path, fault=True)
    messages = messages_of(path)
    at = next(i for i, (name, _) in enumerate(messages) if name == topic)
    document = json.loads(messages[at][1])
    if value is ...:
        document.pop(key, None)
    else:
        document[key] = value
    messages[at] = (topic, json.dumps(document).encode())
    write_messages(path, messages)
    with pytest.raises(FileError, match=r"run\.mcap.*remedy"):
        read_run(path)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "an empty file"),
        (b"hello", "a file of another kind"),
        (b"\x89MCAP0\r\n", "cut off before its first message"),
        (b"x" * 5000, "a file of another kind"),
    ],
)
def test_file_that_is_no_log_is_refused_by_name(path: Path, content: bytes, told: str) -> None:
    path.write_bytes(content)
    with pytest.raises(FileError, match=rf"run\.mcap.*not a flight log.*{told}"):
        read_run(path)


def test_missing_log_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.mcap.*cannot be read"):
        read_run(tmp_path / "none.mcap")


def middle_chunk(data: bytes) -> ChunkIndex:
    """Where the middle one is."""
    chunks = make_reader(io.BytesIO(data)).get_summary().chunk_indexes  # type: ignore[union-attr]
    return chunks[len(chunks) // 2]


@pytest.mark.parametrize("opcode", [0x86, 0x07, None])
def test_a_part_that_is_no_part_any_more_or_is_gone_is_missed(path: Path, opcode: int | None) -> None:
    """Reproduced: called whole and good, and goals were compared across the hole."""
    logged(path)
    whole = read_run(path)
    data = bytearray(path.read_bytes())
    middle = middle_chunk(data)
    begin = middle.chunk_start_offset
    if opcode is None:
        del data[begin : begin + middle.chunk_length]
    else:
        data[begin] = opcode
    path.write_bytes(data)
    run = read_run(path)
    assert not run.complete
    assert re.search(r"\d+ of its \d+ messages are missing", run.unread)
    assert np.nanmax(np.abs(run.tracking_error_rad)) <= np.nanmax(np.abs(whole.tracking_error_rad))


def test_one_bad_byte_costs_no_more_than_its_part(path: Path) -> None:
    """Reproduced: all that came behind it was thrown away, and the file was said to be cut off."""
    logged(path)
    whole = read_run(path)
    data = bytearray(path.read_bytes())
    middle = middle_chunk(data)
    data[middle.chunk_start_offset + middle.chunk_length // 2] ^= 0x10
    path.write_bytes(data)
    run = read_run(path)
    assert not run.complete
    assert re.fullmatch(r"1 of its parts is damaged, and \d+ of its \d+ messages are missing", run.unread)
    assert run.results == whole.results
    assert 0 < len(run.time_s) < len(whole.time_s)
    assert len(run.after_gap) == 1
    row = run.after_gap[0]
    assert np.isnan(run.tracking_error_rad[row]).all()
    assert np.nanmax(np.abs(run.tracking_error_rad)) <= np.nanmax(np.abs(whole.tracking_error_rad))


def test_what_follows_the_end_of_a_log_is_told(path: Path) -> None:
    logged(path)
    data = path.read_bytes()
    path.write_bytes(data + data)
    run = read_run(path)
    assert run.unread == f"{len(data)} bytes follow its end"
    assert not run.complete


def test_a_log_that_lost_its_head_is_called_damaged(path: Path) -> None:
    logged(path)
    messages = [(topic, data) for topic, data in messages_of(path) if topic != "/plan_info"]
    write_messages(path, [*messages, ("/cycle", b"{")])
    with pytest.raises(FileError, match=r"damaged: .* is lost; found 1 of its parts is damaged; .*undamaged copy"):
        read_run(path)


def test_a_log_of_another_version_is_sent_to_that_version(path: Path) -> None:
    logged(path)
    write_messages(path, rewritten(messages_of(path), "/plan_info", schema="ori-deploy/log/3"))
    with pytest.raises(FileError, match=r"ori-deploy/log/3; .*read it with the ori-deploy that wrote it"):
        read_run(path)


def test_too_little_memory_is_no_damage(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    logged(path)

    def full(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr("ori_deploy.telemetry.read.collect", full)
    for read in (read_run, read_recording):
        with pytest.raises(FileError, match=r"too little memory to read the log; found \d+ MB packed"):
            read(path)


PER_HINGE = ("hinge_ids", "cell_ids", "driven_creases", "zero_rad", "shaft_per_crease")


def rewritten(messages: Messages, topic: str, **changed: object) -> Messages:
    """With other values in all messages of a channel."""
    return [(t, json.dumps(json.loads(data) | changed).encode() if t == topic else data) for t, data in messages]


@pytest.mark.parametrize(
    ("topic", "changed"),
    [
        ("/plan_info", {"driven_creases": ["close_a"]}),
        ("/plan_info", {"hinge_ids": [1, 2, 3, 4]}),
        ("/plan_info", {"shaft_per_crease": [0.0, 1.0, 1.0, 1.0]}),
        ("/plan_info", {"zero_rad": [None, 0.0, 0.0, 0.0]}),
        ("/plan_info", {key: [] for key in PER_HINGE}),
        ("/cycle", {"time_s": None}),
        ("/cycle", {"stage": 1}),
        ("/result", {"command": []}),
    ],
)
def test_what_no_writer_would_have_written_is_called_damage(path: Path, topic: str, changed: dict[str, Any]) -> None:
    logged(path)
    write_messages(path, rewritten(messages_of(path), topic, **changed))
    with pytest.raises(FileError, match="the log is damaged"):
        read_run(path)


def test_a_clock_that_goes_back_is_called_damage(path: Path) -> None:
    logged(path)
    messages = messages_of(path)
    first, second = [k for k, (topic, _) in enumerate(messages) if topic == "/cycle"][:2]
    messages[first], messages[second] = messages[second], messages[first]
    write_messages(path, messages)
    with pytest.raises(FileError, match="order of their times"):
        read_run(path)
