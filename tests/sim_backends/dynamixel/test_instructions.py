"""Who answers what, when, and at which rate: instructions on a wire with several servos."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.dynamixel.servo import BOOT_S
from sim_backends.dynamixel.spec import ServoSpec
from tests.sim_backends.dynamixel.test_packets import fixed
from tests.sim_backends.dynamixel.wire import BROADCAST, CLEAR_TURNS, Host, Status, frame, slow_crc, statuses, word

PING, READ, WRITE, REG_WRITE, ACTION, RESET, REBOOT, CLEAR = 1, 2, 3, 4, 5, 6, 8, 0x10
SYNC_READ, SYNC_WRITE, FAST, BULK_READ, BULK_WRITE = 0x82, 0x83, 0x8A, 0x92, 0x93
ALONE, FAILED, UNKNOWN, BAD_CRC, RANGE = 0, 1, 2, 3, 4
LED, POSITION = 65, 132


def three(**spec: object) -> Host:
    """Servos 1, 2, 3 at 0.1, 0.2, 0.3 rad, without load."""
    return Host(*(ServoSpec(id=k, start_rad=0.1 * k, load_nm=0.0) for k in (1, 2, 3)), **spec)


def led(on: int) -> bytes:
    return word(LED) + bytes((on,))


# -- single instructions -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("level", "answered"), [(0, {PING}), (1, {PING, READ, SYNC_READ, FAST, BULK_READ}), (2, None)]
)
def test_the_status_return_level_decides_what_is_answered(level: int, answered: set[int] | None) -> None:
    host = three()
    host.write(1, "status_return_level", level)
    asked = {
        PING: (1, b""),
        READ: (1, word(POSITION) + word(4)),
        WRITE: (1, led(1)),
        REG_WRITE: (1, led(0)),
        ACTION: (1, b""),
        CLEAR: (1, CLEAR_TURNS),
        SYNC_READ: (BROADCAST, word(POSITION) + word(4) + b"\x01"),
        FAST: (BROADCAST, word(POSITION) + word(4) + b"\x01"),
        BULK_READ: (BROADCAST, b"\x01" + word(POSITION) + word(4)),
    }
    for code, (target, parameters) in asked.items():
        heard = host.say(frame(target, bytes((code,)) + parameters))
        assert bool(heard) == (answered is None or code in answered), code
    assert host.servo(1).get(host.servo(1).table.led) == 0  # what was not answered was done all the same


@pytest.mark.parametrize("level", [0, 1])
def test_refusals_are_as_silent_as_what_they_refuse(level: int) -> None:
    host = three()
    host.write(1, "status_return_level", level)
    assert host.do(1, WRITE, led(7)) == []
    refused = host.do(1, READ, word(660) + word(4))
    assert [one.error for one in refused] == [7] * level
    assert host.do(1, 0x77) == []


def test_nobody_answers_an_instruction_to_everyone_but_ping() -> None:
    host = three()
    assert [one.id for one in host.do(BROADCAST, PING)] == [1, 2, 3]
    assert host.do(BROADCAST, WRITE, led(1)) == []
    assert [host.read(k, "led") for k in (1, 2, 3)] == [1, 1, 1]
    assert host.do(BROADCAST, READ, word(LED) + word(1)) == []
    assert host.do(BROADCAST, REG_WRITE, led(0)) == host.do(BROADCAST, ACTION) == []
    assert [host.read(k, "led") for k in (1, 2, 3)] == [0, 0, 0]


def test_a_spoilt_instruction_is_complained_of_and_not_done() -> None:
    host = three()
    for target, complaints in ((2, [Status(2, BAD_CRC, b"")]), (BROADCAST, [])):
        raw = bytearray(frame(target, bytes((WRITE,)) + led(1)))
        raw[-1] ^= 0x40
        assert statuses(host.say(bytes(raw))) == complaints
    assert host.read(2, "led") == 0


@pytest.mark.parametrize(
    ("code", "parameters"), [(0x77, b""), (READ, b"\x84"), (WRITE, b"\x41\x00"), (CLEAR, b"\x02")]
)
def test_unknown_and_incomplete_instructions_are_an_instruction_error(code: int, parameters: bytes) -> None:
    assert three().do(1, code, parameters) == [Status(1, UNKNOWN, b"")]


def test_action_without_reg_write_is_an_instruction_error() -> None:
    host = three()
    assert host.do(1, ACTION) == [Status(1, UNKNOWN, b"")]
    host.do(1, REG_WRITE, led(1))
    assert [host.do(1, ACTION)[0].error for _ in range(2)] == [0, UNKNOWN]
    assert host.read(1, "led") == 1


def test_reg_write_keeps_the_last_and_refuses_what_write_would() -> None:
    host = three()
    host.do(1, REG_WRITE, led(1))
    host.do(1, REG_WRITE, word(104) + (77).to_bytes(4, "little"))
    assert host.do(1, REG_WRITE, led(9))[0].error == RANGE
    host.do(1, ACTION)
    assert (host.read(1, "led"), host.read(1, "goal_velocity")) == (0, 77)


def test_reg_write_through_indirect_data_writes_nothing_before_action() -> None:
    host = three()
    assert host.do(1, REG_WRITE, word(224) + b"\x2a")[0].error == 0  # points at itself
    assert host.do(1, READ, word(224) + word(1))[0].data == b"\0"
    host.do(1, ACTION)
    assert host.do(1, READ, word(224) + word(1))[0].data == b"\x2a"


# -- id, rate, reset, reboot -------------------------------------------------------------------------


def test_a_new_id_holds_once_the_answer_under_the_old_one_is_out() -> None:
    host = three()
    assert host.do(1, WRITE, b"\x07\x00\x09") == [Status(1, 0, b"")]
    assert host.do(1, PING) == []
    assert host.do(9, PING)[0].id == 9


def test_a_new_rate_holds_once_the_answer_at_the_old_one_is_out() -> None:
    host = three()
    assert host.do(1, WRITE, b"\x08\x00\x06") == [Status(1, 0, b"")]
    assert host.do(1, PING) == []
    assert [one.id for one in host.do(BROADCAST, PING)] == [2, 3]
    host.baud = 4_000_000
    assert [one.id for one in host.do(BROADCAST, PING)] == [1]


@pytest.mark.parametrize(("at", "value", "error"), [(7, 253, RANGE), (8, 8, RANGE)])
def test_a_bad_id_or_rate_is_refused_and_changes_nothing(at: int, value: int, error: int) -> None:
    host = three()
    assert host.do(1, WRITE, word(at) + bytes((value,)))[0].error == error
    assert host.do(1, PING)[0].error == 0


def test_a_servo_at_another_rate_hears_nothing() -> None:
    host = Host(ServoSpec(id=1), ServoSpec(id=2, baud=57_600))
    assert [one.id for one in host.do(BROADCAST, PING)] == [1]
    host.do(BROADCAST, WRITE, led(1))
    host.baud = 57_600
    assert [one.id for one in host.do(BROADCAST, PING)] == [2]
    assert host.read(2, "led") == 0
    host.baud = 38_400  # no rate of theirs: what a port is at before anybody sets one
    assert host.do(BROADCAST, PING) == []


@pytest.mark.parametrize(("option", "found_at"), [(0xFF, (1, 57_600)), (0x01, (5, 57_600)), (0x02, (5, 1_000_000))])
def test_factory_reset_keeps_what_its_option_says(option: int, found_at: tuple[int, int]) -> None:
    host = Host(ServoSpec(id=5, firmware=44), ServoSpec(id=6))
    host.write_all(5, homing_offset=99, return_delay_time=0, led=1)
    assert host.do(5, RESET, bytes((option,))) == [Status(5, 0, b"")]
    servo_id, host.baud = found_at
    (pong,) = [one for one in host.do(BROADCAST, PING) if one.id != 6]
    assert (pong.id, pong.data[2]) == (servo_id, 44)
    servo = host.servo(5)
    assert [servo.named(name) for name in ("homing_offset", "return_delay_time", "led")] == [0, 250, 0]


def test_nobody_resets_everyone_to_one_id() -> None:
    host = three()
    assert host.do(BROADCAST, RESET, b"\xff") == []
    assert [one.id for one in host.do(BROADCAST, PING)] == [1, 2, 3]
    assert host.do(1, RESET, b"\x03")[0].error == UNKNOWN


def test_a_rebooting_servo_is_deaf_for_its_boot_time_and_comes_up_as_new() -> None:
    host = three()
    host.write_all(1, torque_enable=1, led=1, profile_velocity=10, status_return_level=2)
    assert host.do(1, REBOOT) == [Status(1, 0, b"")]
    host.wait(0.9 * BOOT_S)
    assert [one.id for one in host.do(BROADCAST, PING)] == [2, 3]
    host.do(BROADCAST, WRITE, led(1))
    host.wait(0.2 * BOOT_S)
    assert [host.read(1, name) for name in ("torque_enable", "led", "profile_velocity")] == [0, 0, 0]


# -- several servos ----------------------------------------------------------------------------------


def test_sync_and_bulk_answers_come_in_the_order_asked() -> None:
    host = three()
    assert [one.id for one in host.sync_read(POSITION, 4, [3, 1, 2])] == [3, 1, 2]
    bulk = b"".join(bytes((k,)) + word(LED) + word(k) for k in (2, 3, 1))
    assert [(one.id, len(one.data)) for one in host.do(BROADCAST, BULK_READ, bulk)] == [(2, 2), (3, 3), (1, 1)]


@pytest.mark.parametrize(("followers", "heard"), [(True, [1, 3]), (False, [1])])
@pytest.mark.parametrize("code", [SYNC_READ, BULK_READ])
@pytest.mark.parametrize("why", ["absent", "mute", "booting"])
def test_after_a_silent_servo_its_followers_answer_as_the_spec_says(
    followers: bool, heard: list[int], code: int, why: str
) -> None:
    host = three(followers_answer=followers)
    ids = [1, 2, 3]
    if why == "absent":
        ids = [1, 99, 3]
    elif why == "mute":
        host.bus.faults[1].mute = True
    else:
        host.do(2, REBOOT)
    if code == SYNC_READ:
        parameters = word(LED) + word(1) + bytes(ids)
    else:
        parameters = b"".join(bytes((k,)) + word(LED) + word(1) for k in ids)
    assert [one.id for one in host.do(BROADCAST, code, parameters)] == heard


def test_one_refusal_in_a_group_write_leaves_the_others_alone() -> None:
    host = three()
    host.do(BROADCAST, SYNC_WRITE, word(LED) + word(1) + b"\x01\x01\x02\x07\x63\x01\x03\x01")
    assert [host.read(k, "led") for k in (1, 2, 3)] == [1, 0, 1]
    bulk = (
        b"\x01" + word(LED) + word(1) + b"\0" + b"\x02" + word(0) + word(2) + b"\1\1" + b"\x03" + word(LED) + word(1)
    )
    host.do(BROADCAST, BULK_WRITE, bulk + b"\0")
    assert [host.read(k, "led") for k in (1, 2, 3)] == [0, 0, 0]


def test_a_servo_that_cannot_be_read_says_so_in_its_turn() -> None:
    host = Host(ServoSpec(id=1), ServoSpec(id=2, model="xl330"))
    said = host.sync_read(300, 2, [1, 2])
    assert [(one.id, one.error, len(one.data)) for one in said] == [(1, 0, 2), (2, 7, 0)]


def test_duplicates_collide_unless_they_say_the_same() -> None:
    host = Host(ServoSpec(id=1, start_rad=0.5), ServoSpec(id=1, start_rad=-0.5), ServoSpec(id=2))
    assert host.do(1, PING)[0].id == 1
    heard = host.say(frame(1, bytes((READ,)) + word(POSITION) + word(4)))
    assert slow_crc(heard[:-2]).to_bytes(2, "little") != heard[-2:]
    spoilt = host.say(frame(BROADCAST, bytes((FAST,)) + word(POSITION) + word(4) + b"\x01"))
    assert slow_crc(spoilt[:-2]).to_bytes(2, "little") != spoilt[-2:]
    assert [one.id for one in host.sync_read(LED, 1, [1, 2])] == [1, 2]
    different = Host(ServoSpec(id=1, model="xl330"), ServoSpec(id=1, model="xm430"))
    with pytest.raises(AssertionError):
        statuses(different.say(frame(1, b"\x01")))


# -- fast sync read ----------------------------------------------------------------------------------


def fast(address: int, size: int, ids: bytes) -> bytes:
    return frame(BROADCAST, bytes((FAST,)) + word(address) + word(size) + ids)


def blocks(raw: bytes, size: int) -> list[Status]:
    """What a fast answer says, every block's CRC checked bit by bit over all before it."""
    assert raw[:5] == b"\xff\xff\xfd\x00\xfe"
    assert raw[7] == 0x55
    found, at = [], 8
    while at < len(raw):
        end = at + 2 + size
        assert slow_crc(raw[:end]).to_bytes(2, "little") == raw[end : end + 2]
        found.append(Status(raw[at + 1], raw[at], raw[at + 2 : end]))
        at = end + 2
    assert at == len(raw)
    return found


@fixed
@given(st.permutations([1, 2, 3]), st.integers(1, 40), st.integers(64, 140))
def test_a_fast_answer_says_what_single_reads_say(ids: list[int], size: int, address: int) -> None:
    host = three()
    raw = host.say(fast(address, size, bytes(ids)))
    assert int.from_bytes(raw[5:7], "little") == len(raw) - 7 == 1 + 3 * (size + 4)
    single = [host.do(k, READ, word(address) + word(size))[0] for k in ids]
    assert blocks(raw, size) == single


def test_a_fast_answer_is_not_stuffed() -> None:
    host = Host(ServoSpec(id=1))
    host.do(1, WRITE, word(224) + b"\xff\xff\xfd\x00")
    raw = host.say(fast(224, 4, b"\x01"))
    assert blocks(raw, 4)[0].data == b"\xff\xff\xfd\x00"
    assert len(raw) == 8 + 8


@pytest.mark.parametrize("why", ["firmware", "absent", "mute", "drop", "level"])
def test_a_fast_answer_ends_where_somebody_is_silent(why: str) -> None:
    host = Host(*(ServoSpec(id=k, firmware=44 if why == "firmware" and k == 2 else 45) for k in (1, 2, 3)))
    if why == "level":
        host.write(2, "status_return_level", 0)
    host.bus.faults[1].mute, host.bus.faults[1].drop = why == "mute", int(why == "drop")
    ids = bytes((1, 99 if why == "absent" else 2, 3))
    raw = host.say(fast(LED, 1, ids))
    assert [one.id for one in blocks(raw, 1)] == [1]
    assert int.from_bytes(raw[5:7], "little") == 1 + 3 * 5  # as if all had come
    assert host.say(fast(LED, 1, bytes((ids[1],)))) == b"" or why == "drop"


def test_a_corrupt_block_is_found_and_the_others_are_where_they_belong() -> None:
    host = three()
    good = host.say(fast(LED, 2, b"\x01\x02\x03"))
    host.bus.faults[1].corrupt = 1
    bad = host.say(fast(LED, 2, b"\x01\x02\x03"))
    assert [k for k in range(len(good)) if good[k] != bad[k]] == [8 + 6 + 2]
    assert slow_crc(bad[:18]).to_bytes(2, "little") != bad[18:20]
    assert host.say(fast(LED, 2, b"\x01\x02\x03")) == good


def test_a_refused_block_has_its_error_and_the_usual_length() -> None:
    host = Host(ServoSpec(id=1), ServoSpec(id=2, model="xl330"), ServoSpec(id=3))
    assert [(one.id, one.error) for one in blocks(host.say(fast(300, 2, b"\x01\x02\x03")), 2)] == [
        (1, 0),
        (2, 7),
        (3, 0),
    ]


# -- faults ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 3])
def test_faults_hit_as_many_answers_as_they_were_told(count: int) -> None:
    host = three()
    good = host.say(frame(2, b"\x01"))
    for name in ("drop", "corrupt", "truncate"):
        setattr(host.bus.faults[1], name, count)
        host.bus.faults[1].cut_bytes = 4
        assert host.say(frame(1, b"\x01")) != b""  # somebody else's answers go on
        heard = [host.say(frame(2, b"\x01")) for _ in range(count + 1)]
        assert heard[-1] == good
        bad = {"drop": b"", "truncate": good[:-4]}.get(name, heard[0])
        assert heard[:-1] == [bad] * count
        assert bad != good


def test_a_mute_servo_does_what_it_is_told() -> None:
    host = three()
    host.bus.faults[0].mute = True
    assert host.do(1, WRITE, led(1)) == []
    host.bus.faults[0].mute = False
    assert host.read(1, "led") == 1


def test_noise_comes_once_before_the_next_answer() -> None:
    host = three()
    good = host.say(frame(2, b"\x01"))
    host.bus.noise = b"\xff\xff\x12"
    assert host.say(frame(2, b"\x01")) == b"\xff\xff\x12" + good
    assert host.say(frame(2, b"\x01")) == good


# -- time on the wire --------------------------------------------------------------------------------


@fixed
@given(
    st.sampled_from((9_600, 1_000_000, 4_000_000)),
    st.integers(0, 254),
    st.floats(0.0, 1e-3),
    st.integers(1, 30),
)
def test_answers_take_their_bytes_and_every_servos_pause(
    baud: int, delay_units: int, turnaround_s: float, size: int
) -> None:
    host = three(baud=baud, turnaround_s=turnaround_s)
    for k in (1, 2, 3):
        host.write(k, "return_delay_time", delay_units)
    pause = turnaround_s + 2e-6 * delay_units
    (one,) = host.answers(frame(1, bytes((READ,)) + word(64) + word(size)))
    assert one.wire_s == pytest.approx(pause + 10 * len(one.data) / baud)
    (many,) = host.answers(frame(BROADCAST, bytes((SYNC_READ,)) + word(64) + word(size) + b"\x01\x02\x03"))
    assert many.wire_s == pytest.approx(3 * pause + 10 * len(many.data) / baud)
    (merged,) = host.answers(fast(64, size, b"\x01\x02\x03"))
    assert merged.wire_s == pytest.approx(pause + 10 * len(merged.data) / baud)
    (silent,) = host.answers(frame(BROADCAST, bytes((WRITE,)) + led(1)))
    assert (silent.data, silent.wire_s) == (b"", 0.0)


@pytest.mark.parametrize("raw", [frame(1, bytes((READ,)) + word(64) + word(2)), fast(64, 2, b"\x01\x02")])
def test_a_held_back_answer_takes_longer_by_that(raw: bytes) -> None:
    host = three()
    (usual,) = host.answers(raw)
    host.bus.faults[0].delay, host.bus.faults[0].delay_s = 1, 0.25
    (late,) = host.answers(raw)
    assert late.wire_s - usual.wire_s == pytest.approx(0.25)
    assert late.data == usual.data


def test_everyone_answers_a_ping_in_the_order_of_ids() -> None:
    host = Host(*(ServoSpec(id=k) for k in (3, 1, 2)))
    assert [one.id for one in host.do(BROADCAST, PING)] == [1, 2, 3]
