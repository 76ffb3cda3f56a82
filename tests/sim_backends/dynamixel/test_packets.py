"""The packets that the e-manual publishes, and the codec against slow ones."""

from __future__ import annotations

from math import pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_backends.dynamixel.packets import LONGEST, Listener, crc16, packet, status
from sim_backends.dynamixel.spec import ServoSpec
from tests.sim_backends.dynamixel.wire import BROADCAST, Host, frame, slow_crc, statuses, stuff

COUNT = 2.0 * pi / 4096.0
NOISY = st.lists(st.sampled_from((b"\xff", b"\xfd", b"\x00", b"\xff\xff\xfd", b"\x55", b"\x01")), max_size=60)
BODIES = st.one_of(st.binary(min_size=1, max_size=120), NOISY.map(lambda parts: b"\x03" + b"".join(parts)))
TARGETS = st.integers(0, 252) | st.just(BROADCAST)
fixed = settings(max_examples=30)
few = settings(max_examples=12)


def hexes(text: str) -> bytes:
    return bytes.fromhex(text)


OK_1 = hexes("FFFFFD00 01 0400 55 00 A10C")
PUBLISHED = {
    "ping": ("FFFFFD00 01 0300 01 194E", "FFFFFD00 01 0700 55 00 06 04 26 655D"),
    "ping everyone": (
        "FFFFFD00 FE 0300 01 3142",
        "FFFFFD00 01 0700 55 00 06 04 26 655D FFFFFD00 02 0700 55 00 06 04 26 6F6D",
    ),
    "read": ("FFFFFD00 01 0700 02 8400 0400 1D15", "FFFFFD00 01 0800 55 00 A6000000 8CC0"),
    "write": ("FFFFFD00 01 0900 03 7400 00020000 CA89", OK_1.hex()),
    "factory reset": ("FFFFFD00 01 0400 06 01 A1E6", OK_1.hex()),
    "reboot": ("FFFFFD00 01 0300 08 2F4E", OK_1.hex()),
    "clear": ("FFFFFD00 01 0800 10 01 44584C22 B1DC", OK_1.hex()),
    "sync read": (
        "FFFFFD00 FE 0900 82 8400 0400 01 02 CEFA",
        "FFFFFD00 01 0800 55 00 A6000000 8CC0 FFFFFD00 02 0800 55 00 1F080000 BABE",
    ),
    "sync write": ("FFFFFD00 FE 1100 83 7400 0400 01 96000000 02 AA000000 8287", ""),
    "bulk read": (
        "FFFFFD00 FE 0D00 92 01 9000 0200 02 9200 0100 1A05",
        "FFFFFD00 01 0600 55 00 7700 C369 FFFFFD00 02 0500 55 00 24 8BA9",
    ),
    "bulk write": ("FFFFFD00 FE 1000 93 01 2000 0200 A000 02 1F00 0100 50 B768", ""),
}


@pytest.fixture
def published() -> Host:
    """Two XM430-W210 as the e-manual's examples have them: at counts 166 and 2079, 11.9 V, 36 degrees."""
    servos = [
        ServoSpec(id=k, model="XM430-W210", firmware=38, start_rad=(count - 2048) * COUNT)
        for k, count in ((1, 166), (2, 2079))
    ]
    host = Host(*servos, supply_v=11.9, supply_ohm=0.0, ambient_c=36.0)
    for servo in host.bus.servos:
        servo.put(servo.table.goal_velocity, 0)
    return host


@pytest.mark.parametrize("name", [name for name in PUBLISHED if name != "clear"])
def test_published_instructions_get_the_published_answers(name: str, published: Host) -> None:
    said, answered = PUBLISHED[name]
    assert published.say(hexes(said)) == hexes(answered)


def test_the_published_clear_is_for_firmware_42_and_later(published: Host) -> None:
    said, answered = PUBLISHED["clear"]
    assert statuses(published.say(hexes(said)))[0].error == 2
    assert Host(ServoSpec(id=1, model="XM430-W210", firmware=42)).say(hexes(said)) == hexes(answered)


def test_published_writes_write_what_they_say(published: Host) -> None:
    published.say(hexes(PUBLISHED["write"][0]))
    assert published.read(1, "goal_position") == 512
    published.say(hexes(PUBLISHED["sync write"][0]))
    assert [published.read(k, "goal_position") for k in (1, 2)] == [150, 170]
    published.servo(1).put(published.servo(1).table.max_voltage_limit, 150)
    published.servo(2).put(published.servo(2).table.temperature_limit, 70)
    published.say(hexes(PUBLISHED["bulk write"][0]))
    assert published.read(1, "max_voltage_limit") == 160
    assert published.read(2, "temperature_limit") == 80


def test_the_published_reg_write_waits_for_the_published_action(published: Host) -> None:
    assert published.say(hexes("FFFFFD00 01 0900 04 6800 C8000000 AE8E")) == OK_1
    assert published.read(1, "registered_instruction") == 1
    assert published.read(1, "goal_velocity") == 0
    assert published.say(hexes("FFFFFD00 01 0300 05 02CE")) == OK_1
    assert published.read(1, "goal_velocity") == 200
    assert published.read(1, "registered_instruction") == 0


# -- codec -------------------------------------------------------------------------------------------


@fixed
@given(st.binary(max_size=300), st.integers(0, 300))
def test_the_crc_is_the_bitwise_one_and_can_be_carried_on(data: bytes, cut: int) -> None:
    assert crc16(data) == slow_crc(data)
    assert crc16(data[cut:], crc16(data[:cut])) == slow_crc(data)


@fixed
@given(TARGETS, BODIES)
def test_a_packet_is_framed_and_stuffed_as_the_protocol_says(target: int, body: bytes) -> None:
    assert packet(target, body) == frame(target, body)
    assert packet(target, body).count(b"\xff\xff\xfd\x00") == 1


@fixed
@given(TARGETS, BODIES.filter(lambda body: body[0] != 0x55))
def test_what_is_framed_is_found_again(target: int, body: bytes) -> None:
    raw = frame(target, body)
    (found,) = Listener().feed(raw)
    assert (found.target, found.code, found.parameters) == (target, body[0], body[1:])
    assert found.good
    assert found.size == len(raw) == 9 + len(stuff(body))


@fixed
@given(st.integers(0, 252), st.integers(0, 255), st.binary(max_size=60))
def test_status_packets_are_not_taken_for_instructions(servo_id: int, error: int, data: bytes) -> None:
    assert statuses(status(servo_id, error, data))[0].data == data
    assert list(Listener().feed(status(servo_id, error, data))) == []


@fixed
@given(
    st.lists(st.tuples(TARGETS, BODIES.filter(lambda body: body[0] != 0x55)), min_size=1, max_size=4),
    st.lists(st.integers(1, 20), min_size=1, max_size=30),
)
def test_packets_may_come_in_any_pieces(said: list[tuple[int, bytes]], pieces: list[int]) -> None:
    raw = b"".join(frame(target, body) for target, body in said)
    listener, found, at = Listener(), [], 0
    while at < len(raw):
        for size in pieces:
            found += listener.feed(raw[at : at + size])
            at += size
    assert [(one.target, one.code, one.parameters) for one in found] == [(t, b[0], b[1:]) for t, b in said]
    assert all(one.good for one in found)


@fixed
@given(st.binary(max_size=60), TARGETS, BODIES.filter(lambda body: body[0] != 0x55))
def test_garbage_before_a_packet_never_costs_it(garbage: bytes, target: int, body: bytes) -> None:
    hidden = b"\xff\xff\xfd\x00" in garbage + b"\xff\xff\xfd"
    if hidden:
        return
    found = list(Listener().feed(garbage + frame(target, body)))
    assert [(one.target, one.code, one.parameters) for one in found] == [(target, body[0], body[1:])]


@fixed
@given(BODIES.filter(lambda body: body[0] != 0x55), st.integers(0, 2**31))
def test_a_flipped_bit_is_noticed_and_the_next_packets_are_heard(body: bytes, where: int) -> None:
    raw = bytearray(frame(3, body))
    bit = where % (8 * len(raw))
    raw[bit // 8] ^= 1 << bit % 8
    following = frame(4, b"\x01")
    listener = Listener()
    found = list(listener.feed(bytes(raw)))
    # A spoilt length makes it wait for bytes that are not there: what was swallowed comes out again.
    for _ in range(LONGEST // len(following) + 1):
        found += listener.feed(following)
    assert not any(one.good and one.target != 4 for one in found)
    assert sum(one.good for one in found) >= LONGEST // len(following) - 1
