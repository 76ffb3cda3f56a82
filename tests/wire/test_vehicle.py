"""The vehicle's network: frames in streams of bytes that are not all frames, and signatures."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v10 import common as theirs_1
from pymavlink.dialects.v20 import ardupilotmega as theirs

from ori_deploy.wire.signing import FIRST_HEARD_TICKS, LATEST, MOST_STREAMS, Signing, Verdict, ticks_now
from ori_deploy.wire.vehicle import Counts, Message, Party, Reader, Writer, dialect, text_of

US, STATION = Party(1, 140), Party(255, 190)
KEY, OTHER_KEY = bytes(range(32)), bytes(32)
NOON = 40_000_000_000_000
"""A timestamp, some day in 2027."""

HEARTBEAT = dialect.MAVLink_heartbeat_message(
    dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 5, dialect.MAV_STATE_ACTIVE, 3
)
DEPLOY = dialect.MAVLink_command_long_message(1, 140, dialect.ORI_CMD_DEPLOY, 0, 0, 21196, 0, 0, 0, 0, 0)
PARAMETER = dialect.MAVLink_param_set_message(1, 140, b"ORI_SPEED", 0.5, dialect.MAV_PARAM_TYPE_REAL32)
MESSAGES = (HEARTBEAT, DEPLOY, PARAMETER)


def signing(key: bytes = KEY, *, at: int = NOON, accept_unsigned: bool = False, link_id: int = 0) -> Signing:
    return Signing(key, link_id, accept_unsigned, clock=lambda: at)


def frames(
    messages: Iterable[Message] = MESSAGES, signed: Signing | None = None, party: Party = STATION
) -> list[bytes]:
    writer = Writer(party, signed)
    return [writer.pack(message) for message in messages]


def kinds(messages: Iterable[Message]) -> list[str]:
    return [message.get_type() for message in messages]


ALL = kinds(MESSAGES)


def theirs_signing(key: bytes = KEY, at: int = NOON, link_id: int = 7) -> theirs.MAVLink:
    codec = theirs.MAVLink(None, 255, 190)
    codec.signing.secret_key, codec.signing.sign_outgoing = key, True
    codec.signing.timestamp, codec.signing.link_id = at, link_id
    return codec


# -- streams -----------------------------------------------------------------------------------------------


def test_what_is_written_is_read() -> None:
    reader = Reader()
    heartbeat, deploy, parameter = reader.feed(b"".join(frames()))
    assert (heartbeat.custom_mode, heartbeat.get_srcSystem(), heartbeat.get_srcComponent()) == (5, 255, 190)
    assert (deploy.command, deploy.param2) == (dialect.ORI_CMD_DEPLOY, 21196)
    assert text_of(parameter.param_id) == "ORI_SPEED"
    assert [m.get_seq() for m in (heartbeat, deploy, parameter)] == [0, 1, 2]
    assert reader.counts == Counts(frames=3)


def test_our_own_messages_are_read() -> None:
    creases = dialect.MAVLink_ori_creases_message(7, [0.5] * 16, 16, 18, 2)
    (found,) = Reader().feed(Writer(US).pack(creases))
    assert (found.angle, found.first, found.total, found.count) == ([0.5] * 16, 16, 18, 2)


@given(cut=st.lists(st.integers(0, 400), max_size=8), signed=st.booleans())
def test_pieces_make_no_difference(cut: list[int], signed: bool) -> None:
    key = signing() if signed else None
    foreign = theirs.MAVLink_ahrs_message(0, 0, 0, 0, 0, 0, 0).pack(theirs.MAVLink(None, 1, 1))
    made = frames((*MESSAGES, HEARTBEAT), key)
    data = made[0] + b"\xfd\x09noise" + made[1] + foreign + made[2] + made[3]
    ends = sorted({min(c, len(data)) for c in cut} | {len(data)})
    whole, reader = Reader(signing() if signed else None), Reader(signing() if signed else None)
    wanted = kinds(whole.feed(data))
    found, at = [], 0
    for end in ends:
        found += kinds(reader.feed(data[at:end]))
        at = end
    assert found == wanted == [*ALL, "HEARTBEAT"]
    assert reader.counts == whole.counts
    assert whole.counts.unknown == 1


@given(data=st.binary(max_size=600), signed=st.booleans(), step=st.sampled_from([b"", b"\xfd", b"\xfe"]))
def test_bytes_never_raise(data: bytes, signed: bool, step: bytes) -> None:
    reader = Reader(signing() if signed else None)
    list(reader.feed(step + data))
    header = bytes((0xFD, 33, signed, 0, 0, 255, 190)) + DEPLOY.id.to_bytes(3, "little")
    list(reader.feed(header + data))
    assert reader.waiting <= 2 * 280


@given(noise=st.lists(st.binary(max_size=60), min_size=4, max_size=4))
def test_noise_between_frames_loses_none(noise: list[bytes]) -> None:
    """Behind a whole frame noise that begins like an unknown message is taken for one, if a frame follows it."""
    made = frames()
    junk = [b"-" + one for one in noise]
    reader = Reader()
    found = kinds(reader.feed(junk[0] + b"".join(a + b for a, b in zip(made, junk[1:], strict=True))))
    found += kinds(reader.feed(bytes(600)))  # what a beginning in the noise waits for
    assert found == ALL
    assert reader.counts.frames == 3


@given(at=st.integers(0, 200), bit=st.integers(0, 7), signed=st.booleans())
def test_a_flipped_bit_is_no_message(at: int, bit: int, signed: bool) -> None:
    (good,) = frames((DEPLOY,), signing() if signed else None)
    spoilt = bytearray(good)
    spoilt[at % len(spoilt)] ^= 1 << bit
    reader = Reader(signing() if signed else None)
    assert not list(reader.feed(bytes(spoilt) + bytes(300)))


def test_messages_not_asked_for_come_later() -> None:
    reader = Reader()
    first = next(reader.feed(b"".join(frames())))
    assert first.get_type() == "HEARTBEAT"
    assert kinds(reader.feed(b"")) == ALL[1:]


def test_a_message_longer_than_known_is_believed() -> None:
    """A newer dialect has put a field at its end."""
    short = frames((HEARTBEAT,))[0]
    payload = short[10:-2] + b"\x2a\x2b"
    body = bytes((len(payload),)) + short[2:10] + payload
    crc = dialect.x25crc(body + bytes((HEARTBEAT.crc_extra,))).crc
    (found,) = Reader().feed(b"\xfd" + body + crc.to_bytes(2, "little"))
    assert found.custom_mode == 5


def test_what_an_unknown_message_holds_is_no_message() -> None:
    inner = frames((DEPLOY,))[0]
    payload = bytes(8) + inner
    unknown = bytes((0xFD, len(payload), 0, 0, 0, 9, 9, 0xFF, 0xFF, 0x7F)) + payload + b"\0\0"
    reader = Reader()
    before, after = frames((HEARTBEAT,)), frames((PARAMETER,))
    assert kinds(reader.feed(b"".join((*before, unknown, *after)))) == ["HEARTBEAT", "PARAM_SET"]
    assert reader.counts == Counts(frames=2, unknown=1)


def test_a_flag_invented_later_is_refused() -> None:
    frame = bytearray(frames((HEARTBEAT,))[0])
    frame[2] = 2
    frame[-2:] = dialect.x25crc(bytes(frame[1:-2]) + bytes((HEARTBEAT.crc_extra,))).crc.to_bytes(2, "little")
    assert not list(Reader().feed(bytes(frame)))


def test_mavlink_1_is_believed_unless_there_is_a_key() -> None:
    old = theirs_1.MAVLink_heartbeat_message(6, 8, 0, 5, 4, 3).pack(theirs_1.MAVLink(None, 254, 1))
    assert old[0] == 0xFE
    (found,) = Reader().feed(old)
    assert (found.get_srcSystem(), found.custom_mode) == (254, 5)
    for allowed in (False, True):
        reader = Reader(signing(accept_unsigned=allowed))
        assert not list(reader.feed(old))
        assert reader.counts == Counts(unsigned=1)


def test_the_switch_that_ignores_checksums_is_off() -> None:
    code = (
        "from ori_deploy.wire.vehicle import *\n"
        "m = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)\n"
        "f = bytearray(Writer(Party(1, 1)).pack(m)); f[-1] ^= 1\n"
        "print(len(list(Reader().feed(bytes(f) + bytes(300)))))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "MAV_IGNORE_CRC": "1"}, capture_output=True, text=True
    )
    assert done.stdout == "0\n", done.stderr


@pytest.mark.parametrize(
    ("field", "text"),
    [
        ("ORI_SPEED", "ORI_SPEED"),
        (b"ORI_SPEED\0junk", "ORI_SPEED"),
        (b"\xff\n\x1b[31m", "???[31m"),
        ("\ufffd\u2603", "??"),
        (b"", ""),
        (bytearray(b"ab"), "ab"),
    ],
)
def test_text_of_a_field_is_printable(field: str | bytes | bytearray, text: str) -> None:
    assert text_of(field) == text


# -- signatures --------------------------------------------------------------------------------------------


def test_what_is_signed_is_believed_by_us_and_by_others() -> None:
    data = b"".join(frames((HEARTBEAT, PARAMETER), signing(link_id=9)))
    reader = Reader(signing())
    assert kinds(reader.feed(data)) == ["HEARTBEAT", "PARAM_SET"]
    assert reader.counts == Counts(frames=2)
    other = theirs_signing()
    found = other.parse_buffer(data)
    assert [(m.get_type(), m.get_signed(), m.get_link_id()) for m in found or ()] == [
        ("HEARTBEAT", True, 9),
        ("PARAM_SET", True, 9),
    ]


def test_what_others_sign_is_believed() -> None:
    other = theirs_signing()
    data = b""
    for seq in range(3):
        other.seq = seq
        data += theirs.MAVLink_param_request_list_message(1, 140).pack(other)
    reader, key = Reader(), signing()
    assert len(list(reader.feed(data))) == 3  # without a key, signatures are not looked at
    reader = Reader(key)
    assert len(list(reader.feed(data))) == 3
    assert key.streams == {(255, 190, 7): NOON + 2}


def test_a_wrong_key_is_dropped_and_counted() -> None:
    for key in (signing(), signing(accept_unsigned=True)):
        reader = Reader(key)
        assert not list(reader.feed(b"".join(frames(signed=signing(OTHER_KEY)))))
        assert reader.counts == Counts(bad_signature=3)
        assert not key.streams
        assert key.timestamp == 0


@given(at=st.integers(1, 13), bit=st.integers(0, 7))
def test_a_signature_with_a_flipped_bit_is_dropped_and_counted(at: int, bit: int) -> None:
    (good,) = frames((DEPLOY,), signing())
    spoilt = bytearray(good)
    spoilt[-at] ^= 1 << bit
    reader = Reader(signing())
    assert not list(reader.feed(bytes(spoilt)))
    assert reader.counts == Counts(bad_signature=1)
    assert kinds(reader.feed(good)) == ["COMMAND_LONG"]


def test_unsigned_is_dropped_and_counted_unless_it_was_allowed() -> None:
    reader = Reader(signing())
    assert not list(reader.feed(b"".join(frames())))
    assert reader.counts == Counts(unsigned=3)
    assert kinds(Reader(signing(accept_unsigned=True)).feed(b"".join(frames()))) == ALL


def test_a_recording_is_refused_from_whatever_peer() -> None:
    key, data = signing(), b"".join(frames(signed=signing()))
    assert kinds(Reader(key).feed(data)) == ALL
    elsewhere = Reader(key)
    assert not list(elsewhere.feed(data))
    assert elsewhere.counts == Counts(replayed=3)


def test_an_old_recording_of_a_party_never_heard_is_refused() -> None:
    late, edge = signing(at=NOON - FIRST_HEARD_TICKS - 1), signing(at=NOON - FIRST_HEARD_TICKS)
    assert not list(Reader(signing()).feed(frames((HEARTBEAT,), late)[0]))
    assert kinds(Reader(signing()).feed(frames((HEARTBEAT,), edge)[0])) == ["HEARTBEAT"]


def test_a_forged_timestamp_makes_nobody_be_refused() -> None:
    key = signing()
    reader = Reader(key)
    list(reader.feed(frames((HEARTBEAT,), signing())[0]))
    forged = bytearray(frames((HEARTBEAT,), signing())[0])
    forged[-12:-6] = b"\xff" * 6
    assert not list(reader.feed(bytes(forged)))
    assert kinds(reader.feed(frames((DEPLOY,), signing(at=NOON + 1))[0])) == ["COMMAND_LONG"]


def test_parties_and_links_have_streams_of_their_own() -> None:
    key = signing()
    reader = Reader(key)
    for party, link_id in ((STATION, 0), (US, 0), (STATION, 1)):
        (frame,) = frames((HEARTBEAT,), signing(link_id=link_id), party)
        assert kinds(reader.feed(frame)) == ["HEARTBEAT"]
    assert len(key.streams) == 3


def test_timestamps_rise_whatever_the_clock_does() -> None:
    clock = iter([NOON, NOON, NOON - 5_000_000, 0, NOON + 10])
    key = Signing(KEY, clock=lambda: next(clock))
    assert [key.next_timestamp() - NOON for _ in range(5)] == [0, 1, 2, 3, 10]


def test_a_timestamp_heard_is_gone_on_from() -> None:
    """So that whose clock is behind is believed by whom it hears."""
    key = signing(at=NOON - 10**9)
    assert list(Reader(key).feed(frames((HEARTBEAT,), signing())[0]))
    assert key.next_timestamp() > NOON


def test_the_last_timestamp_there_is_does_not_overflow() -> None:
    key = signing(at=LATEST)
    writer = Writer(US, key)
    assert len({writer.pack(HEARTBEAT)[-12:-6] for _ in range(3)}) == 1


def test_streams_are_bounded() -> None:
    key = signing()
    for k in range(MOST_STREAMS + 10):
        (frame,) = frames((HEARTBEAT,), signing(at=NOON + k), Party(1 + k % 250, k // 250))
        assert key.judge(frame, 1 + k % 250, k // 250) is Verdict.GOOD
    assert len(key.streams) == MOST_STREAMS
    assert min(key.streams.values()) == NOON + 10


def test_a_key_has_32_bytes_and_is_not_shown() -> None:
    with pytest.raises(ValueError, match="32 bytes"):
        Signing(b"short")
    assert "key" not in repr(signing())


def test_the_clock_counts_from_2015() -> None:
    assert ticks_now() > 10 * 365 * 86400 * 100_000


# -- fuzz --------------------------------------------------------------------------------------------------


def fuzzed(count: int, seed: int) -> tuple[int, Counts]:
    """Feed spoilt, cut, doubled and foreign frames, signed with the right key; what was believed must be whole."""
    rng = random.Random(seed)
    writer, reader = Writer(STATION, signing()), Reader(signing())
    stranger = Writer(STATION, signing(OTHER_KEY))
    sent: set[bytes] = set()
    heard = 0
    for _ in range(count):
        message = rng.choice(MESSAGES)
        good = writer.pack(message)
        frame = bytearray(good if rng.random() < 0.8 else stranger.pack(message))
        sent.add(good[-12:-6])
        for _ in range(rng.randrange(3)):
            frame[rng.randrange(len(frame))] = rng.randrange(256)
        if rng.random() < 0.1:
            del frame[rng.randrange(len(frame)) :]
        if rng.random() < 0.1:
            frame = frame * 2
        for found in reader.feed(bytes(frame)):
            heard += 1
            sent.remove(bytes(found.get_msgbuf()[-12:-6]))  # each at most once, and as it was sent
    return heard, reader.counts


def test_fuzzed_frames_are_never_believed_nor_raise() -> None:
    heard, counts = fuzzed(10_000, 1)
    assert heard == counts.frames > 1000
    assert min(counts.bad_checksum, counts.bad_signature, counts.skipped, counts.replayed) > 0


@pytest.mark.slow
def test_a_hundred_thousand_fuzzed_frames() -> None:
    heard, counts = fuzzed(100_000, 2)
    assert heard == counts.frames > 10_000


def test_all_messages_of_the_dialect_are_read_whatever_they_hold() -> None:
    rng = random.Random(3)
    reader = Reader()
    for kind in dialect.mavlink_map.values():
        for size in (0, 1, kind.unpacker.size, 255, *(rng.randrange(256) for _ in range(6))):
            payload = rng.randbytes(size)
            body = bytes((len(payload), 0, 0, 0, 1, 140)) + kind.id.to_bytes(3, "little") + payload
            crc = dialect.x25crc(body + bytes((kind.crc_extra,))).crc
            found = kinds(reader.feed(b"\xfd" + body + crc.to_bytes(2, "little")))
            assert found == [kind.msgname]
