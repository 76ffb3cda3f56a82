"""Whether a servo restarted is known, whatever became of the packet that told it to."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from ori_deploy.actuators.bus import BusTimeout, CommandRefused
from ori_deploy.actuators.dynamixel.startup import mark_of, write
from ori_deploy.bench.restart import NotRestarted, Reset, reset_error
from ori_deploy.wire.dynamixel import Register
from sim_backends.dynamixel.packets import Instruction
from sim_backends.dynamixel.servo import ACCESS, Refusal
from sim_backends.dynamixel.spec import ServoSpec
from tests.bench.servos import Bench

REBOOT = 8
OVERLOAD = 0x20


def loses(n_reboots: int) -> Callable[[Instruction], bool]:
    """A wire on which so many instructions to restart are lost."""
    left = [n_reboots]

    def hears(instruction: Instruction) -> bool:
        if instruction.code != REBOOT or left[0] == 0:
            return True
        left[0] -= 1
        return False

    return hears


def holding(hears: Callable[[Instruction], bool], model: str = "XM430-W350", firmware: int = 48) -> Bench:
    return Bench(ServoSpec(id=1, model=model, firmware=firmware), hears=hears, slack_s=0.02)


def hold(bench: Bench) -> None:
    write(bench.line, 1, bench.servo().table.torque_enable, 1)


@pytest.mark.parametrize("lost", [0, 2])
def test_a_servo_is_told_to_restart_until_it_has(lost: int) -> None:
    with holding(loses(lost)) as bench:
        hold(bench)
        bench.servo().put(bench.servo().table.hardware_error_status, OVERLOAD)
        assert reset_error(bench.line, bench.pong(), bench.clock) == Reset(1, OVERLOAD)
        assert [instruction.code for instruction in bench.told].count(REBOOT) == lost + 1
        assert not bench.torque_on()
        assert bench.register("hardware_error_status") == 0


def test_a_servo_that_never_hears_of_it_is_not_said_to_have_restarted() -> None:
    with holding(loses(10**6)) as bench:
        bench.port.slack_s = 0.01  # each lost consent is waited for
        hold(bench)
        with pytest.raises(NotRestarted, match=r"servo 1 did not restart: .*its torque is off; .*remedy") as told:
            reset_error(bench.line, bench.pong(), bench.clock)
        assert not bench.torque_on()
        assert bench.line.read(1, mark_of(bench.servo().model)) == mark_of(bench.servo().model).default
    assert not told.value.refused


def test_a_servo_that_takes_torque_by_itself_is_let_go_of_again() -> None:
    with holding(loses(0)) as bench:
        reboot = bench.servo().reboot

        def with_torque(now: float) -> None:
            """As one whose startup_configuration is 1."""
            reboot(now)
            bench.servo().put(bench.servo().table.torque_enable, 1)
            bench.servo().put(bench.servo().table.hardware_error_status, OVERLOAD)

        bench.servo().reboot = with_torque  # type: ignore[method-assign]
        with pytest.raises(CommandRefused, match=r"let go of again; it reports overload again; .*address 60") as told:
            reset_error(bench.line, bench.pong(), bench.clock)
        assert not bench.torque_on()
    assert not told.value.refused


def test_a_servo_that_does_not_come_back_is_told_from_one_that_did_not_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ori_deploy.bench.restart.PATIENCE_S", 0.3)

    def gone(instruction: Instruction) -> bool:
        bench.bus.faults[0].mute |= instruction.code == REBOOT
        return True

    with holding(gone) as bench:
        bench.port.slack_s = 0.005
        with pytest.raises(BusTimeout, match=r"did not come back within 0\.3 s"):
            reset_error(bench.line, bench.pong(), bench.clock)


def test_one_that_heard_only_the_last_time_has_its_time_to_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ori_deploy.bench.restart.PATIENCE_S", 0.5)
    with holding(lambda i: i.code != REBOOT or bench.clock.now() > begin + 0.4) as bench:
        bench.port.slack_s = 0.01
        begin = bench.clock.now()
        assert reset_error(bench.line, bench.pong(), bench.clock) == Reset(1, 0)


def test_a_servo_that_keeps_nothing_by_which_to_tell_is_left_alone() -> None:
    with holding(loses(0)) as bench:
        pointer = bench.servo().table.indirect.pointer(bench.servo().table.indirect.count - 2)
        bench.servo().write = lambda *_: None  # type: ignore[method-assign]
        with pytest.raises(CommandRefused, match=rf"{pointer.name} reads {pointer.default} after 65") as told:
            reset_error(bench.line, bench.pong(), bench.clock)
        assert REBOOT not in {instruction.code for instruction in bench.told}
    assert told.value.refused


def test_a_servo_that_takes_no_pointer_while_it_holds_is_restarted_too() -> None:
    """As those whose indirect addresses are in their EEPROM."""
    with holding(loses(1)) as bench:
        hold(bench)
        servo = bench.servo()
        check = servo._check
        first = servo.table.indirect.pointer(0).address

        def locked(register: Register, value: int) -> None:
            check(register, value)
            if register.address >= first and servo.get(servo.table.torque_enable):
                raise Refusal(ACCESS)

        servo._check = locked  # type: ignore[method-assign]
        reset_error(bench.line, bench.pong(), bench.clock)
        assert not bench.torque_on()


@pytest.mark.parametrize("firmware", [45, 53])
def test_the_shorter_table_of_small_servos_has_room_for_the_witness(firmware: int) -> None:
    with holding(loses(1), "XL330-M288", firmware) as bench:
        hold(bench)
        reset_error(bench.line, bench.pong(), bench.clock)
        assert not bench.torque_on()


def test_a_servo_that_consents_to_no_write_is_restarted_all_the_same() -> None:
    with holding(loses(0)) as bench:
        hold(bench)
        bench.servo().put(bench.servo().table.status_return_level, 1)
        reset_error(bench.line, bench.pong(), bench.clock)
        assert not bench.torque_on()
