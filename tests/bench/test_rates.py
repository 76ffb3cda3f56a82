"""No servo is set to a rate at which the adapter could not follow it."""

from __future__ import annotations

import pytest

from ori_deploy.actuators.bus import BusClosed, CommandRefused
from ori_deploy.actuators.dynamixel.line import ServoRefused
from ori_deploy.bench.servos import set_baud, set_id
from ori_deploy.wire.dynamixel import BAUD_CODES
from sim_backends.dynamixel.servo import ACCESS, Refusal
from sim_backends.dynamixel.spec import ServoSpec
from tests.bench.servos import Bench

NEW = 3_000_000


def refused_with_nothing_changed(bench: Bench, why: str) -> None:
    pongs = [bench.pong(1), bench.pong(2)]
    with pytest.raises(CommandRefused, match=rf"no servo was set to {NEW} baud.*{why}.*limit: .*remedy: ") as told:
        set_baud(bench.line, pongs, NEW)
    assert told.value.refused
    assert bench.port.getBaudRate() == 1_000_000
    assert [bench.register("baud_rate", i) for i in (1, 2)] == [3, 3]
    assert bench.pong(2).id == 2  # the port is where it was


def test_a_rate_that_the_adapter_refuses_is_set_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    with Bench(ServoSpec(id=1), ServoSpec(id=2)) as bench:
        set_rate = bench.port.setBaudRate

        def limited(baud: int) -> bool:
            set_rate(baud)
            if baud == NEW:
                raise BusClosed("the port cannot be set to it: Invalid argument")
            return True

        monkeypatch.setattr(bench.port, "setBaudRate", limited)
        refused_with_nothing_changed(bench, "Invalid argument")


def test_a_rate_that_the_adapter_quietly_makes_another_of_is_set_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    with Bench(ServoSpec(id=1), ServoSpec(id=2)) as bench:
        monkeypatch.setattr(bench.port, "made_baud", lambda: 9_600)
        refused_with_nothing_changed(bench, "the adapter makes 9600")


@pytest.mark.parametrize("baud", BAUD_CODES)
def test_the_rate_that_a_driver_makes_is_read(baud: int) -> None:
    with Bench(ServoSpec(id=1)) as bench:
        bench.port.setBaudRate(baud)
        assert bench.port.made_baud() == baud


def test_an_adapter_that_does_not_tell_is_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    with Bench(ServoSpec(id=1)) as bench:
        monkeypatch.setattr(bench.port, "made_baud", lambda: None)
        assert [pong.id for pong in set_baud(bench.line, [bench.pong()], NEW)] == [1]


def says_no(bench: Bench, servo_id: int) -> None:
    """Have a servo refuse every write."""

    def refuse(*_: object) -> None:
        raise Refusal(ACCESS)

    bench.servo(servo_id)._check = refuse  # type: ignore[method-assign]


def test_a_servo_that_says_no_leaves_all_as_it_was() -> None:
    with Bench(ServoSpec(id=1), ServoSpec(id=2)) as bench:
        says_no(bench, 1)
        pongs = [bench.pong(1), bench.pong(2)]
        for change in (lambda: set_baud(bench.line, pongs, NEW), lambda: set_id(bench.line, pongs[0], 7)):
            with pytest.raises(ServoRefused, match="servo 1: ") as told:
                change()
            assert told.value.refused
        assert [bench.register("baud_rate", i) for i in (1, 2)] == [3, 3]


def test_those_before_one_that_says_no_are_named() -> None:
    with Bench(ServoSpec(id=1), ServoSpec(id=2)) as bench:
        pongs = [bench.pong(1), bench.pong(2)]
        says_no(bench, 2)
        with pytest.raises(
            CommandRefused, match=r"servo 2: .*; servo 1 is at 3000000 baud already; remedy: "
        ) as told:
            set_baud(bench.line, pongs, NEW)
        assert not told.value.refused
