"""What is meant for all servos reaches all of them, or the others are named."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from ori_deploy.actuators.bus import BusClosed, BusTimeout, CommandRefused
from ori_deploy.actuators.dynamixel import line
from ori_deploy.bench.every_rate import find_at_every_rate, torque_off_at_every_rate
from ori_deploy.bench.servos import USUAL_BAUDS, find_all
from sim_backends.dynamixel.spec import ServoSpec
from tests.actuators.dynamixel.scripted import ScriptedPort
from tests.bench.servos import Bench
from tests.bench.test_bench import BROADCAST, pong


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody waits here for the slots of 253 servos."""
    monkeypatch.setattr(line, "PING_SLOT_S", 0.0)


def lossy(*broadcasts: Iterable[int]) -> ScriptedPort:
    """A line on which so many get through, broadcast by broadcast."""
    heard = iter(broadcasts)

    def answer(request: bytes) -> bytes:
        return b"".join(map(pong, next(heard, ()))) if request[4] == BROADCAST else b""

    return ScriptedPort(answer, slack_s=0.02)


@pytest.mark.parametrize("heard", [((1,), (1, 2), (1,)), ((1,), (), (2,)), ((), (2,), (1,))])
def test_an_answer_that_is_lost_in_one_broadcast_is_heard_in_another(heard: tuple[tuple[int, ...], ...]) -> None:
    with lossy(*heard) as scripted:
        assert [one.id for one in find_all(scripted.line, (1_000_000,))] == [1, 2]


def test_silence_is_asked_twice_before_the_next_rate() -> None:
    with lossy() as scripted:
        with pytest.raises(BusTimeout, match="limit: tried 57600, 1000000 baud"):
            find_all(scripted.line, (57_600, 1_000_000))
        assert len(scripted.sent) == 4


def two_rates() -> Bench:
    """Both hold."""
    bench = Bench(ServoSpec(id=1, baud=57_600), ServoSpec(id=1), ServoSpec(id=2), slack_s=0.05)
    for servo in bench.bus.servos:
        servo.write(servo.table.torque_enable.address, b"\1")
    return bench


def test_servos_at_every_rate_go_limp() -> None:
    with two_rates() as bench:
        found = find_at_every_rate(bench.line, USUAL_BAUDS)
        assert [(baud, [one.id for one in pongs]) for baud, pongs in found.by_baud] == [
            (57_600, [1]), (1_000_000, [1, 2]),
        ]  # fmt: skip
        assert bench.bus.motors.torque_on.all()
        torque_off_at_every_rate(bench.line, found)
        assert not bench.bus.motors.torque_on.any()


def test_who_does_not_confirm_is_named_and_the_others_are_limp() -> None:
    with two_rates() as bench:
        found = find_at_every_rate(bench.line, USUAL_BAUDS)
        bench.bus.faults[0].mute = True
        with pytest.raises(CommandRefused, match=r"servo 1 \(at 57600 baud\) does not confirm.*remedy: ") as told:
            torque_off_at_every_rate(bench.line, found)
        assert not told.value.refused
        assert not bench.bus.motors.torque_on[1:].any()


@pytest.mark.parametrize("quietly", [False, True])
def test_a_rate_that_the_adapter_does_not_make_is_told(monkeypatch: pytest.MonkeyPatch, quietly: bool) -> None:
    with two_rates() as bench:
        set_rate, made = bench.port.setBaudRate, bench.port.made_baud

        def limited(baud: int) -> bool:
            if baud == USUAL_BAUDS[-1] and not quietly:
                raise BusClosed("the port cannot be set to it")
            return set_rate(baud)

        monkeypatch.setattr(bench.port, "setBaudRate", limited)
        monkeypatch.setattr(bench.port, "made_baud", lambda: min(made() or 0, 3_000_000))
        found = find_at_every_rate(bench.line, USUAL_BAUDS)
        assert found.unasked == (4_000_000,)
        assert len(found.pongs) == 3
