"""What bench commands conclude from answers that are odd: scripted, byte by byte."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.actuators.bus import BusTimeout, CommandRefused, CorruptReply
from ori_deploy.actuators.dynamixel.line import Pong
from ori_deploy.bench.meaning import error_words, meaning
from ori_deploy.bench.servos import census, find, find_all, known_model, registers, set_id, torque_off
from ori_deploy.wire.dynamixel import MODELS, model_named
from sim_backends.dynamixel.servo import ACCESS, Refusal
from sim_backends.dynamixel.spec import ServoSpec
from tests.actuators.dynamixel.scripted import ScriptedPort, status
from tests.bench.servos import Bench

XM = model_named("xm430")
PING, READ, WRITE, SYNC_WRITE, BROADCAST = 1, 2, 3, 0x83, 0xFE
XM_PONG = bytes((0xFC, 0x03, 48))


def pong(servo_id: int) -> bytes:
    return status(servo_id, XM_PONG)


def damaged(packet: bytes) -> bytes:
    return packet[:-1] + bytes((packet[-1] ^ 1,))


@pytest.mark.slow
def test_damage_in_a_broadcast_is_tracked_down_to_an_id() -> None:
    def answer(request: bytes) -> bytes:
        if request[4] == BROADCAST:
            return pong(1) + damaged(pong(3))
        return {1: pong(1), 3: damaged(pong(3))}.get(request[4], b"")

    with ScriptedPort(answer, slack_s=0.01) as scripted:
        found = census(scripted.line, 1_000_000)
        assert [one.id for one in found.pongs] == [1]
        assert found.damaged == (3,)
        with pytest.raises(CommandRefused, match="id 3 answers with damage"):
            find_all(scripted.line, (1_000_000,))


@pytest.mark.slow
def test_a_servo_that_a_broadcast_missed_is_found_by_asking_it() -> None:
    def answer(request: bytes) -> bytes:
        return damaged(pong(2)) if request[4] == BROADCAST else pong(2) if request[4] == 2 else b""

    with ScriptedPort(answer, slack_s=0.01) as scripted:
        found = census(scripted.line, 1_000_000)
    assert [one.id for one in found.pongs] == [2]
    assert not found.damaged


def test_a_clean_broadcast_is_believed_at_once() -> None:
    with ScriptedPort(lambda _: pong(1) + pong(9)) as scripted:
        assert [one.id for one in census(scripted.line, 1_000_000).pongs] == [1, 9]
        assert len(scripted.sent) == 1


def test_finding_tells_silence_from_damage() -> None:
    with ScriptedPort(lambda _: b"", slack_s=0.01) as silent, pytest.raises(BusTimeout, match="57600, 1000000"):
        find(silent.line, 1, (57_600, 1_000_000))
    with ScriptedPort(lambda _: damaged(pong(1)), slack_s=0.01) as noisy, pytest.raises(CorruptReply):
        find(noisy.line, 1, (1_000_000,))


def test_an_id_that_was_not_taken_is_not_called_changed() -> None:
    """The servo consents and stays: it still answers at its old id."""

    def answer(request: bytes) -> bytes:
        if request[4] != 1:
            return b""
        return {PING: pong(1), READ: status(1, b"\x00"), WRITE: status(1)}[request[7]]

    with (
        ScriptedPort(answer, slack_s=0.005) as scripted,
        pytest.raises(CommandRefused, match="servo 1 did not take id 5") as told,
    ):
        set_id(scripted.line, Pong(1, XM.number, 48, alert=False), 5)
    assert not told.value.refused  # something was written, whatever became of it


def test_torque_off_goes_to_all_at_once_and_names_those_who_do_not_confirm() -> None:
    def answer(request: bytes) -> bytes:
        if request[4] == 2:
            return {READ: status(2, b"\x01"), WRITE: status(2)}[request[7]]
        return {READ: status(1, b"\x00"), WRITE: status(1)}.get(request[7], b"") if request[4] == 1 else b""

    pongs = [Pong(i, XM.number, 48, alert=False) for i in (1, 2, 3)]
    with ScriptedPort(answer, slack_s=0.01) as scripted:
        with pytest.raises(CommandRefused, match="servo 2, 3 does not confirm"):
            torque_off(scripted.line, pongs)
        first = scripted.sent[0]
    assert (first[4], first[7]) == (BROADCAST, SYNC_WRITE)
    assert first[8:-2] == bytes((64, 0, 1, 0, 1, 0, 2, 0, 3, 0))


def test_registers_that_a_firmware_does_not_have_are_left_out() -> None:
    table = XM.table
    lacking = (table.startup_configuration, table.backup_ready)
    with Bench(ServoSpec(id=1, firmware=40)) as bench:
        read = bench.servo().read

        def old(address: int, size: int) -> bytes:
            if address in {register.address for register in lacking}:
                raise Refusal(ACCESS)
            return read(address, size)

        bench.servo().read = old  # type: ignore[method-assign]
        found = [one.register for one in registers(bench.line, bench.pong(), everything=True)]
    assert found == [register for register in table if register not in lacking]


def test_a_model_that_is_not_known_is_left_alone() -> None:
    with pytest.raises(CommandRefused, match="model number 12345"):
        known_model(Pong(1, 12_345, 48, alert=False))


@pytest.mark.parametrize(
    ("name", "value", "si", "unit"),
    [
        ("present_position", 2048 + 1024, 1.5707963, "rad"),
        ("homing_offset", -1024, -1.5707963, "rad"),
        ("present_velocity", 100, 22.9 * 0.10471976, "rad_s"),
        ("profile_acceleration", 1, 214.577 * 0.10471976 / 60.0, "rad_s2"),
        ("present_current", -100, -0.269, "a"),
        ("present_input_voltage", 121, 12.1, "v"),
        ("goal_pwm", 885, 1.0, "fraction"),
        ("return_delay_time", 250, 500e-6, "s"),
        ("bus_watchdog", 4, 0.08, "s"),
    ],
)
def test_registers_mean_what_the_manual_says(name: str, value: int, si: float, unit: str) -> None:
    said = meaning(XM, XM.table.named(name), value)
    assert said.si == pytest.approx(si)
    assert said.unit == unit


def test_a_watchdog_that_tripped_is_no_time() -> None:
    said = meaning(XM, XM.table.bus_watchdog, -1)
    assert (said.si, said.unit) == (None, None)
    assert said.words.startswith("tripped")


def test_a_time_based_profile_is_milliseconds() -> None:
    said = meaning(XM, XM.table.profile_velocity, 1500, time_based=True)
    assert (said.si, said.unit) == (1.5, "s")


@given(st.sampled_from(MODELS), st.data())
def test_every_register_of_every_model_means_something_or_is_plain(model: object, data: st.DataObject) -> None:
    assert hasattr(model, "table")
    for register in model.table:
        value = data.draw(st.integers(0, 256 ** min(register.size, 2) // 2 - 1))
        said = meaning(model, register, value)  # type: ignore[arg-type]
        assert (said.si is None) == (said.unit is None)
        assert not (said.words and said.unit)


def test_errors_have_names() -> None:
    assert error_words(0) == "none"
    assert error_words(0x25) == "input voltage, overheating, overload"
    assert error_words(0x40) == "unknown (0x40)"
