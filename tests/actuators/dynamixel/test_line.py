"""Transactions against scripted answers: damaged, short, long, late, doubled, foreign."""

from __future__ import annotations

import random
import threading
import time
from pathlib import Path

import pytest
from dynamixel_sdk import Protocol2PacketHandler
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.actuators.bus import BusClosed, BusTimeout, CorruptReply
from ori_deploy.actuators.dynamixel.fast_reply import split_fast_reply
from ori_deploy.actuators.dynamixel.line import ServoRefused
from ori_deploy.actuators.dynamixel.port import BlockingPort
from ori_deploy.wire.dynamixel import model_named
from tests.actuators.dynamixel.scripted import ScriptedPort, crc16, status

TABLE = model_named("xm430").table
IDS = (1, 2, 3, 4)
DATA = {i: bytes(range(10 * i, 10 * i + 10)) for i in IDS}
HEADER_IN_DATA = b"\x01\xff\xff\xfd\xff\xff\xfd\x00\xff\xff"
"""Two headers in ten bytes: stuffed twice."""


def spoilt(packet: bytes, at: int, bit: int = 0) -> bytes:
    return packet[:at] + bytes((packet[at] ^ (1 << bit),)) + packet[at + 1 :]


def read_of(replies: bytes, *, fast: bool = False) -> tuple[dict[int, bytes], bool]:
    with ScriptedPort(lambda _: replies) as scripted:
        found = scripted.line.sync_read(126, 10, IDS, fast=fast)
    return {servo_id: reply.data for servo_id, reply in found.by_id.items()}, found.garbage


def test_instructions_are_the_published_bytes() -> None:
    """Packets printed in the e-manual, Protocol 2.0, section "Instruction Details"."""
    pong = status(1, bytes((0x06, 0x04, 0x26)))
    assert pong == bytes.fromhex("FFFFFD00010700550006042665 5D".replace(" ", ""))
    with ScriptedPort(lambda request: pong if request[7] == 1 else status(1, bytes((0xA6, 0, 0, 0)))) as scripted:
        found = scripted.line.ping(1)
        assert (found.model_number, found.firmware) == (1030, 38)
        assert scripted.line.read(1, TABLE.present_position) == 166
        scripted.line.sync_write(116, 4, {1: (150).to_bytes(4, "little"), 2: (170).to_bytes(4, "little")})
        scripted.line.sync_read(132, 4, (1, 2))
        sent = scripted.sent
    assert sent[0].hex() == "fffffd00010300" + "01194e"
    assert sent[1].hex() == "fffffd00010700" + "02840004001d15"
    assert sent[2].hex() == "fffffd00fe1100" + "8374000400" + "0196000000" + "02aa000000" + "8287"
    assert sent[3].hex() == "fffffd00fe0900" + "8284000400" + "0102" + "cefa"


def test_headers_in_what_is_sent_are_stuffed() -> None:
    """Goal -131073 is FF FF FD FF; the SDK would send it as it is."""
    with ScriptedPort(lambda request: status(1) if request[4] == 1 else b"") as scripted:
        scripted.line.write(1, TABLE.goal_position, -131073)
        scripted.line.sync_write(116, 4, {2: TABLE.goal_position.encode(-131073), 3: bytes(4)})
        scripted.line.read_block(1, 64, 0)
    for packet, servo_id, body in (
        (scripted.sent[0], 1, bytes((3, 116, 0)) + b"\xff\xff\xfd\xfd\xff"),
        (scripted.sent[1], 0xFE, bytes((0x83, 116, 0, 4, 0, 2)) + b"\xff\xff\xfd\xfd\xff" + bytes((3, 0, 0, 0, 0))),
    ):
        head = b"\xff\xff\xfd\x00" + bytes((servo_id,)) + (len(body) + 2).to_bytes(2, "little") + body
        assert packet == head + crc16(head).to_bytes(2, "little")


def test_writes_wait_for_consent_and_refusals_are_typed() -> None:
    with ScriptedPort(lambda request: status(1, error=0 if request[9] == 0 and request[10] == 0 else 4)) as scripted:
        scripted.line.write(1, TABLE.goal_position, 512)
    assert scripted.sent[0].hex() == "fffffd00010900" + "037400" + "00020000" + "ca89"
    with (
        ScriptedPort(lambda _: status(1, error=0x84)) as scripted,
        pytest.raises(ServoRefused, match="out of range") as refusal,
    ):
        scripted.line.write(1, TABLE.goal_position, 512)
    assert (refusal.value.servo_id, refusal.value.code) == (1, 4)


def test_alert_is_not_an_error() -> None:
    with ScriptedPort(lambda _: status(1, bytes(4), error=0x80)) as scripted:
        reply = scripted.line.read_block(1, 132, 4)
    assert reply.alert
    assert reply.data == bytes(4)


@pytest.mark.parametrize("reply", [status(1), status(1, bytes(3)), status(1, bytes(5))])
def test_a_reply_of_another_length_is_not_believed(reply: bytes) -> None:
    with ScriptedPort(lambda _: reply) as scripted, pytest.raises(CorruptReply):
        scripted.line.read(1, TABLE.present_position)


def test_silence_is_a_timeout_and_another_servo_s_answer_is_not_ours() -> None:
    with ScriptedPort(lambda _: b"") as scripted, pytest.raises(BusTimeout):
        scripted.line.read(1, TABLE.present_position)
    with ScriptedPort(lambda _: status(2, bytes(4)) + status(1, b"\x05\0\0\0")) as scripted:
        assert scripted.line.read(1, TABLE.present_position) == 5


def test_noise_before_an_answer_and_an_echo_do_no_harm() -> None:
    answer = status(1, b"\x07\0\0\0")
    with ScriptedPort(lambda request: request + b"\xff\xff\xfd\x00\x00\xff\xff" + answer) as scripted:
        assert scripted.line.read(1, TABLE.present_position) == 7


@given(victim=st.sampled_from(IDS), at=st.integers(0, 20), bit=st.integers(0, 7))
def test_one_flipped_bit_costs_one_reply(victim: int, at: int, bit: int) -> None:
    packets = [status(i, DATA[i]) for i in IDS]
    packets[victim - 1] = spoilt(packets[victim - 1], at, bit)
    found, garbage = read_of(b"".join(packets))
    assert found == {i: DATA[i] for i in IDS if i != victim}
    assert garbage


@pytest.mark.parametrize("cut", range(21))
def test_a_reply_cut_short_costs_one_reply(cut: int) -> None:
    packets = [status(i, DATA[i]) for i in IDS]
    packets[1] = packets[1][:cut]
    found, _ = read_of(b"".join(packets))
    assert found == {i: DATA[i] for i in IDS if i != 2}


def test_headers_inside_the_data_are_stuffed_and_unstuffed() -> None:
    packets = [status(i, HEADER_IN_DATA if i == 3 else DATA[i]) for i in IDS]
    assert len(packets[2]) == 11 + 10 + 2
    found, _ = read_of(b"".join(packets))
    assert found == {**DATA, 3: HEADER_IN_DATA}


def test_a_stuffed_last_reply_that_comes_in_two_parts_is_waited_for() -> None:
    packets = b"".join(status(i, HEADER_IN_DATA if i == 4 else DATA[i]) for i in IDS)
    first, rest = packets[:-1], packets[-1:]

    with ScriptedPort(lambda _: first, slack_s=0.2) as scripted:
        late = threading.Timer(0.03, lambda: scripted.say(rest))
        late.start()
        found = scripted.line.sync_read(126, 10, IDS)
        late.join()
    assert found.by_id[4].data == HEADER_IN_DATA


def test_late_answers_are_never_those_of_another_register() -> None:
    """Every answer comes after its time, and before the next question's."""
    slow = 0.02

    def answer(request: bytes) -> bytes:
        value = TABLE.status_return_level.address if request[8] == 68 else TABLE.led.address
        threading.Timer(slow, lambda: scripted.say(status(1, bytes((value,))))).start()
        return b""

    with ScriptedPort(answer, slack_s=0.005) as scripted:
        for _ in range(4):
            for register in (TABLE.status_return_level, TABLE.led):
                try:
                    assert scripted.line.read(1, register) == register.address
                except BusTimeout:
                    continue
        time.sleep(2 * slow)


def test_what_a_late_group_reply_leaves_behind_is_not_the_next_register() -> None:
    """A sync read comes after its time, in the middle of reads of single registers."""
    late = b"".join(status(i, DATA[i]) for i in IDS)
    values = {132: 3000, 52: 500, 48: 3500, 116: 111}

    def answer(request: bytes) -> bytes:
        if request[7] == 0x82:
            threading.Timer(0.012, lambda: scripted.say(late)).start()
            return b""
        return status(1, values[request[8]].to_bytes(4, "little"))

    with ScriptedPort(answer, slack_s=0.008) as scripted:
        scripted.line.sync_read(126, 10, IDS)
        for register in (TABLE.present_position, TABLE.min_position_limit, TABLE.max_position_limit):
            for _ in range(3):
                try:
                    assert scripted.line.read(1, register) == values[register.address]
                    break
                except (BusTimeout, CorruptReply):
                    continue


@pytest.mark.parametrize("fast", [False, True])
def test_a_refusal_in_a_group_reply_is_no_data(fast: bool) -> None:
    errors = {2: 7, 3: 0x80}
    plain = b"".join(status(i, DATA[i], errors.get(i, 0)) for i in IDS)
    with ScriptedPort(lambda _: fast_reply(DATA, 10, errors) if fast else plain) as scripted:
        found = scripted.line.sync_read(126, 10, IDS, fast=fast)
    assert {i: reply.alert for i, reply in found.by_id.items()} == {1: False, 3: True, 4: False}


def test_a_late_pong_of_one_servo_is_not_another_s() -> None:
    pong = bytes((0xFC, 0x03, 45))
    answers = [b"", status(1, pong) + status(2, pong)]
    with ScriptedPort(lambda _: answers.pop(0), slack_s=0.005) as scripted:
        assert not scripted.line.ping_all((1,))
        assert [found.id for found in scripted.line.ping_all((2,))] == [2]


def test_a_late_group_reply_is_not_believed_when_the_size_differs() -> None:
    old = b"".join(status(i, DATA[i]) for i in IDS)
    new = b"".join(status(i, DATA[i][::-1] + b"!") for i in IDS)
    answers = [b"", old + new]
    with ScriptedPort(lambda _: answers.pop(0), slack_s=0.005) as scripted:
        assert not scripted.line.sync_read(126, 10, IDS).by_id
        found = scripted.line.sync_read(126, 11, IDS)
    assert {i: reply.data for i, reply in found.by_id.items()} == {i: DATA[i][::-1] + b"!" for i in IDS}


def test_a_port_that_goes_away_is_closed() -> None:
    with ScriptedPort(lambda _: None) as scripted:
        with pytest.raises(BusClosed):
            scripted.line.read(1, TABLE.present_position)
        with pytest.raises(BusClosed):
            scripted.line.sync_write(116, 4, {1: bytes(4)})


def test_the_sdk_s_lock_does_not_outlive_an_exception() -> None:
    with ScriptedPort(lambda _: status(1, bytes(4))) as scripted:
        scripted.port.is_using = True
        assert scripted.line.read(1, TABLE.present_position) == 0


def test_opening_names_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(BusClosed, match="no such device"):
        BlockingPort(f"{tmp_path}/nothing", 1_000_000).open()
    with ScriptedPort(lambda _: b"") as scripted:
        second = BlockingPort(scripted.port.path, 1_000_000)
        with pytest.raises(BusClosed, match="this program has it already"):
            second.open()


def test_ping_all_finds_everybody_and_leaves_damaged_answers_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ori_deploy.actuators.dynamixel.line.PING_SLOT_S", 1e-4)
    pongs = [status(i, bytes((0xFC, 0x03, 45))) for i in (3, 7, 9)]
    with ScriptedPort(lambda _: pongs[0] + spoilt(pongs[1], 9) + pongs[2]) as scripted:
        found = scripted.line.ping_all()
    assert [(pong.id, pong.model_number, pong.firmware) for pong in found] == [(3, 1020, 45), (9, 1020, 45)]


# -- fast sync read ------------------------------------------------------------------------------------


def fast_reply(data: dict[int, bytes], size: int, errors: dict[int, int] | None = None) -> bytes:
    """As the e-manual describes it; each CRC is over everything before it."""
    length = 1 + len(data) * (size + 4)
    packet = b"\xff\xff\xfd\x00\xfe" + length.to_bytes(2, "little") + b"\x55"
    for servo_id, values in data.items():
        packet += bytes(((errors or {}).get(servo_id, 0), servo_id)) + values
        packet += crc16(packet).to_bytes(2, "little")
    return packet


def sdk_crc(start: int, data: bytes, length: int) -> int:
    crc: int = Protocol2PacketHandler().updateCRC(start, data, length)
    return crc


def test_fast_reply_is_read_whole_with_alerts_and_headers_in_its_data() -> None:
    data = {**DATA, 2: HEADER_IN_DATA}
    with ScriptedPort(lambda _: fast_reply(data, 10, {4: 0x80})) as scripted:
        found = scripted.line.sync_read(126, 10, IDS, fast=True)
    assert {i: reply.data for i, reply in found.by_id.items()} == data
    assert [i for i, reply in found.by_id.items() if reply.alert] == [4]
    assert scripted.sent[0][7] == 0x8A


@given(at=st.integers(0, 8 + 4 * 14 - 1), bit=st.integers(0, 7))
def test_one_flipped_bit_costs_one_block(at: int, bit: int) -> None:
    reply = spoilt(fast_reply(DATA, 10), at, bit)
    found = split_fast_reply(reply, 10, IDS, sdk_crc)
    victim = None if at < 8 else IDS[(at - 8) // 14]
    assert {i: data for i, (_, data) in found.items()} == {i: DATA[i] for i in IDS if i != victim}


@given(seed=st.integers(0, 10_000))
def test_noise_is_not_believed(seed: int) -> None:
    chance = random.Random(seed)
    reply = bytearray(fast_reply(DATA, 10))
    for at in range(8, len(reply)):
        reply[at] = chance.randrange(256)
    found = split_fast_reply(bytes(reply), 10, IDS, sdk_crc)
    assert len(found) <= 1  # two chances in 65,536 for each block


@pytest.mark.parametrize("length", [0, 5, 8, 20, 22, 36, 49])
def test_a_fast_reply_cut_short_keeps_what_came_and_asks_those_behind_the_silent_one(length: int) -> None:
    def answer(request: bytes) -> bytes:
        if request[7] == 0x8A:
            return fast_reply(DATA, 10)[:length]
        return b"".join(status(i, DATA[i]) for i in request[12:-2])

    with ScriptedPort(answer) as scripted:
        found = scripted.line.sync_read(126, 10, IDS, fast=True)
    silent = IDS[max(0, (length - 8) // 14)]
    assert {i: reply.data for i, reply in found.by_id.items()} == {i: DATA[i] for i in IDS if i != silent}
    assert [list(request[12:-2]) for request in scripted.sent[1:]] == (
        [list(range(silent + 1, 5))] if silent < 4 else []
    )
