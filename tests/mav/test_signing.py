"""The key in its file, and timestamps over restarts."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.errors import FileError
from ori_deploy.mav.signing_key import AHEAD_TICKS, SAVE_S, KeptTimestamps, load_key, timestamps_beside
from ori_deploy.wire.signing import LATEST
from ori_deploy.wire.vehicle import Counts, Party, Reader, Signing, Writer, dialect

KEY = bytes(range(32))
NOON = 40_000_000_000_000
HEARTBEAT = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
STATION = Party(255, 190)

Make = Callable[[bytes], Path]


@pytest.fixture
def key_file(tmp_path: Path) -> Make:
    def make(content: bytes, mode: int = 0o600) -> Path:
        path = tmp_path / "mavlink.key"
        path.unlink(missing_ok=True)
        path.touch(mode=0o600)
        path.write_bytes(content)
        path.chmod(mode)
        return path

    return make


# -- the key -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "key"),
    [
        (KEY, KEY),
        (b"passphrase:" + b"x" * 21, hashlib.sha256(b"x" * 21).digest()),  # 32 bytes
        (KEY.hex().encode(), KEY),
        (KEY.hex().upper().encode() + b"\r\n", KEY),
        (b"passphrase:correct horse\n", hashlib.sha256(b"correct horse").digest()),
        ("passphrase:Flügel".encode(), hashlib.sha256("Flügel".encode()).digest()),
    ],
)
def test_a_key_is_read(key_file: Make, content: bytes, key: bytes) -> None:
    assert load_key(key_file(content)) == key


@pytest.mark.parametrize(
    "content",
    [
        b"",
        KEY[:-1],
        KEY + b"\n",
        KEY.hex().encode()[:-1],
        KEY.hex().encode() + b"00",
        b"g" * 64,
        b" ".join(b"%02x" % k for k in KEY),
        b"passphrase:",
        b"passphrase:one\ntwo\n",
        b"passphrase:" + b"x" * 5000,
    ],
)
def test_what_is_no_key_is_refused_and_not_shown(key_file: Make, content: bytes) -> None:
    with pytest.raises(
        FileError, match=r"holds no signing key; found \d+ bytes; limit: 32 raw bytes, .*; remedy:"
    ) as no:
        load_key(key_file(content))
    assert len(content) < 12 or content.decode("latin-1") not in str(no.value)


@given(st.binary(max_size=100).filter(lambda b: len(b) != 32))
def test_any_file_is_a_key_or_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.mktemp("key") / "key"
    path.touch(mode=0o600)
    path.write_bytes(content)
    with pytest.raises(FileError):
        load_key(path)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o620, 0o601, 0o666])
def test_a_key_that_others_can_read_is_refused(key_file: Callable[[bytes, int], Path], mode: int) -> None:
    path = key_file(KEY, mode)
    with pytest.raises(FileError, match=f"found mode {mode:o}; limit: mode 600 or 400; remedy: chmod 600 {path}"):
        load_key(path)


def test_a_key_that_only_its_owner_reads_will_do(key_file: Callable[[bytes, int], Path]) -> None:
    assert load_key(key_file(KEY, 0o400)) == KEY


def test_no_key_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be read; found No such file"):
        load_key(tmp_path / "none")
    with pytest.raises(FileError, match="not a file"):
        load_key(tmp_path)
    os.mkfifo(tmp_path / "pipe", 0o600)
    with pytest.raises(FileError, match="not a file"):
        load_key(tmp_path / "pipe")  # and does not wait for somebody to write
    with pytest.raises(FileError, match="not a file name"):
        load_key(Path("a\0b"))


# -- timestamps --------------------------------------------------------------------------------------------


class Clock:
    """Both clocks of a program, as a test wants them."""

    def __init__(self) -> None:
        self.ticks, self.now_s = NOON, 100.0

    def wall(self) -> int:
        return self.ticks

    def now(self) -> float:
        return self.now_s


def begun(path: Path, clock: Clock) -> tuple[Signing, KeptTimestamps]:
    signing = Signing(KEY, clock=clock.wall)
    return signing, KeptTimestamps(path, signing, clock.now)


def test_after_a_crash_timestamps_go_on_higher_though_the_clock_stepped_back(tmp_path: Path) -> None:
    clock, path = Clock(), tmp_path / "kept"
    signing, kept = begun(path, clock)
    kept.tick()
    clock.now_s += SAVE_S - 0.1
    clock.ticks += int(1e5 * (SAVE_S - 0.1))
    kept.tick()
    last = signing.next_timestamp()  # and now it is killed
    clock.ticks = 0
    signing, kept = begun(path, clock)
    assert signing.next_timestamp() > last
    assert signing.next_timestamp() < last + 2 * AHEAD_TICKS


def test_a_proper_end_does_not_run_ahead(tmp_path: Path) -> None:
    """Else a station that is started again and again would be far ahead of all clocks in the end."""
    clock, path = Clock(), tmp_path / "kept"
    for _ in range(5):
        signing, kept = begun(path, clock)
        with kept:
            kept.tick()
            last = signing.next_timestamp()
    assert last == NOON + 5 - 1


def test_a_recording_is_refused_after_a_restart(tmp_path: Path) -> None:
    clock, path = Clock(), tmp_path / "kept"
    recorded = Writer(STATION, Signing(KEY, clock=clock.wall)).pack(HEARTBEAT)
    signing, kept = begun(path, clock)
    with kept:
        assert list(Reader(signing).feed(recorded))
    signing, _ = begun(path, clock)
    reader = Reader(signing)
    assert not list(reader.feed(recorded))
    assert reader.counts == Counts(replayed=1)


def test_it_is_saved_every_so_often(tmp_path: Path) -> None:
    clock, path = Clock(), tmp_path / "kept"
    _, kept = begun(path, clock)
    assert not path.exists()
    kept.tick()
    first = path.stat().st_ino
    clock.now_s += SAVE_S / 2
    kept.tick()
    assert path.stat().st_ino == first
    clock.now_s += SAVE_S / 2
    kept.tick()
    assert path.stat().st_ino != first
    assert [one.name for one in tmp_path.iterdir()] == ["kept"]


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        "[" * 100_000,
        '{"schema": "another", "timestamp": 5, "streams": []}',
        '{"schema": "ori-deploy/mavlink-timestamps/1"}',
        '{"schema": "ori-deploy/mavlink-timestamps/1", "timestamp": -1, "streams": []}',
        '{"schema": "ori-deploy/mavlink-timestamps/1", "timestamp": 1e300, "streams": []}',
        '{"schema": "ori-deploy/mavlink-timestamps/1", "timestamp": 5, "streams": [[1, 2, 3]]}',
        '{"schema": "ori-deploy/mavlink-timestamps/1", "timestamp": 5, "streams": [[1, 2, 999, 3]]}',
        json.dumps({"schema": "ori-deploy/mavlink-timestamps/1", "timestamp": LATEST + 1, "streams": []}),
    ],
)
def test_a_spoilt_file_stops_nobody(tmp_path: Path, content: str, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "kept"
    path.write_text(content)
    signing, kept = begun(path, Clock())
    assert (signing.timestamp, signing.streams) == (0, {})
    assert "not kept over restarts" in caplog.text
    kept.tick()
    assert json.loads(path.read_text())["timestamp"] == NOON + AHEAD_TICKS


def test_a_place_that_cannot_be_written_is_told_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    clock = Clock()
    signing, kept = begun(tmp_path / "file" / "kept", clock)
    for _ in range(5):
        clock.now_s += SAVE_S
        kept.tick()
    assert caplog.text.count("not kept over restarts") == 1
    assert signing.next_timestamp() == NOON


def test_timestamps_lie_beside_their_key() -> None:
    assert timestamps_beside(Path("/etc/keys/wing.key")) == Path("/etc/keys/wing.key.timestamps")
