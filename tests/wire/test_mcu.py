"""Frames in streams of bytes that are not all frames."""

from __future__ import annotations

import os
import subprocess
import sys

from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.wire import mcu
from ori_deploy.wire.generated import ori_deploy as d

ACK = mcu.Ack(-5, 77, d.ORI_REFUSED_POSITION, 3)
STATE = mcu.State(
    2**40, list(range(12)), [-k for k in range(12)], 5, 6, 7000, 500, 4095, 15, 0, 0, 3, 2, d.ORI_STREAMING, 0, 255
)


def frames(*messages: mcu.Message, sender: mcu.Party = mcu.DEVICE) -> list[bytes]:
    writer = mcu.FrameWriter(sender)
    return [writer.encode(message) for message in messages]


def tokens(messages: list[mcu.Message]) -> list[int]:
    return [getattr(message, "token", -1) for message in messages]


def test_what_is_written_is_read() -> None:
    reader = mcu.FrameReader(mcu.DEVICE)
    (ack, state) = reader.feed(b"".join(frames(ACK, STATE)))
    assert isinstance(ack, mcu.Ack)
    assert isinstance(state, mcu.State)
    assert (ack.value, ack.token, ack.result, ack.index) == (-5, 77, d.ORI_REFUSED_POSITION, 3)
    assert state.time_us == 2**40
    assert state.position_urad == list(range(12))
    assert state.output_urad == [-k for k in range(12)]
    assert (reader.frames, reader.skipped, reader.spoilt, reader.missing) == (2, 0, 0, 0)


def test_the_generated_parser_reads_it_too() -> None:
    parser = d.MAVLink(None)
    (message,) = parser.parse_buffer(frames(STATE)[0]) or []
    assert message.time_us == 2**40


@given(cut=st.lists(st.integers(0, 400), max_size=6))
def test_pieces_make_no_difference(cut: list[int]) -> None:
    data = b"".join(frames(ACK, STATE, ACK))
    ends = sorted({min(c, len(data)) for c in cut} | {len(data)})
    reader, found, at = mcu.FrameReader(mcu.DEVICE), [], 0
    for end in ends:
        found += reader.feed(data[at:end])
        at = end
    assert tokens(found) == [77, 5, 77]


@given(noise=st.lists(st.binary(max_size=60), min_size=4, max_size=4))
def test_noise_between_frames_loses_none(noise: list[bytes]) -> None:
    made = frames(ACK, STATE, ACK)
    data = noise[0] + b"".join(frame + junk for frame, junk in zip(made, noise[1:], strict=True))
    reader = mcu.FrameReader(mcu.DEVICE)
    found = reader.feed(data)
    for _ in range(len(data)):
        found += reader.give_up()
    assert tokens(found) == [77, 5, 77]


@given(st.binary(max_size=600))
def test_bytes_never_raise(data: bytes) -> None:
    reader = mcu.FrameReader(mcu.DEVICE)
    reader.feed(data)
    reader.give_up()
    header = bytes((0xFD, 4, 0, 0, 0, 1, 1)) + mcu.Ack.id.to_bytes(3, "little")
    reader.feed(header + data)


@given(at=st.integers(0, 200), bit=st.integers(0, 7))
def test_a_flipped_bit_is_no_message(at: int, bit: int) -> None:
    (frame,) = frames(STATE)
    at %= len(frame)
    spoilt = bytearray(frame)
    spoilt[at] ^= 1 << bit
    reader = mcu.FrameReader(mcu.DEVICE)
    assert reader.feed(bytes(spoilt)) == []
    assert reader.give_up() == []


def test_a_frame_cut_short_costs_only_itself() -> None:
    state, ack = frames(STATE, ACK)
    reader = mcu.FrameReader(mcu.DEVICE)
    assert reader.feed(state[:-30] + ack) == []
    assert tokens(reader.give_up()) == [77]
    assert reader.spoilt == 1
    assert reader.skipped == len(state) - 30


def test_others_are_not_listened_to() -> None:
    reader = mcu.FrameReader(mcu.DEVICE)
    for party in (mcu.HOST, mcu.Party(1, 2), mcu.Party(2, 1)):
        assert reader.feed(frames(ACK, sender=party)[0]) == []
    assert reader.frames == 0


def test_old_signed_and_longer_frames_are_none() -> None:
    reader = mcu.FrameReader(mcu.DEVICE)
    codec = d.MAVLink(None, 1, 1)
    assert reader.feed(mcu.Heartbeat(18, 8, 0, 2, 3, 3).pack(codec, force_mavlink1=True)) == []
    codec.signing.sign_outgoing, codec.signing.secret_key = True, bytes(32)
    assert reader.feed(ACK.pack(codec)) == []
    for size, flags in ((9, b"\0\0"), (8, b"\0\1"), (8, b"\2\0")):
        assert reader.feed(handmade(size, flags)) == []
    assert tokens(reader.feed(handmade(8, b"\0\0"))) == [0x0605]


def handmade(size: int, flags: bytes) -> bytes:
    """An ORI_ACK with a payload of some size: 1, 2, 3 and so on."""
    head = bytes((size,)) + flags + bytes((0, 1, 1)) + mcu.Ack.id.to_bytes(3, "little")
    body = head + bytes(range(1, size + 1))
    crc = d.x25crc(body + bytes((mcu.Ack.crc_extra,))).crc
    return b"\xfd" + body + crc.to_bytes(2, "little")


def test_messages_of_no_interest_are_none() -> None:
    reader = mcu.FrameReader(mcu.DEVICE)
    unknown = bytes((1, 0, 0, 0, 1, 1)) + (4242).to_bytes(3, "little") + b"\x01"
    assert reader.feed(b"\xfd" + unknown + b"\0\0") == []
    assert set(mcu.MESSAGES) == set(d.mavlink_map)


def test_gaps_in_the_numbering_are_counted() -> None:
    made = frames(*[ACK] * 300)
    reader = mcu.FrameReader(mcu.DEVICE)
    reader.feed(b"".join(made[:10] + made[13:]))
    assert reader.missing == 3


def test_the_environment_cannot_switch_checksums_off() -> None:
    script = (
        "from ori_deploy.wire import mcu\n"
        "w, r = mcu.FrameWriter(mcu.DEVICE), mcu.FrameReader(mcu.DEVICE)\n"
        "f = bytearray(w.encode(mcu.Ack(1, 2, 3, 4)))\n"
        "f[-1] ^= 1\n"
        "assert r.feed(bytes(f)) == [] and r.spoilt == 1\n"
    )
    subprocess.run([sys.executable, "-c", script], env={**os.environ, "MAV_IGNORE_CRC": "1"}, check=True)


def test_full_payloads_keep_their_zeros() -> None:
    assert mcu.full_payload(mcu.Disable(0, 0)) == bytes(4)
    assert mcu.full_payload(mcu.Disable(1, 2)) == b"\1\0\2\0"
