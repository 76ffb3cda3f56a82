"""What commands ask before a scripted board moves or lets go, and what an answer means."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import Result

from ori_deploy.bench.board import Board
from ori_deploy.cli import mcu_motion
from tests.actuators.mcu.setups import electromagnet, wiring
from tests.bench.test_board_jog import Setup
from tests.cli.virtual import command, document, is_one_line


@pytest.fixture
def one(monkeypatch: pytest.MonkeyPatch) -> Setup:
    """A board with three hinges and an electromagnet, which the commands find."""
    setup = Setup(wiring(latches=(electromagnet("em"),)))

    @contextmanager
    def opened() -> Iterator[Board]:
        yield setup.board

    def found(*_: Any) -> SimpleNamespace:
        return SimpleNamespace(opened=opened)

    monkeypatch.setattr(mcu_motion, "looked_up", found)
    monkeypatch.setattr(mcu_motion, "place", found)
    monkeypatch.setattr(mcu_motion, "wiring_of", lambda *_: (setup.wiring, 50.0))
    monkeypatch.setattr(mcu_motion, "MonotonicClock", lambda: setup.clock)
    return setup


def jog(*words: object, **more: Any) -> Result:
    """A command that reads its files from a folder where any will do."""
    return command("mcu", "jog", __file__, "--plan", __file__, *words, **more)


@pytest.mark.parametrize(("turned_rad", "goes"), [(0.04, True), (-0.04, True), (0.06, False), (-1.5, False)])
def test_the_way_that_was_asked_about_is_the_way_that_is_gone(
    one: Setup, monkeypatch: pytest.MonkeyPatch, turned_rad: float, goes: bool
) -> None:
    def turned_meanwhile(*_: Any, **__: Any) -> None:
        one.device.measured[1] = round(1e6 * turned_rad)

    monkeypatch.setattr(mcu_motion, "confirm", turned_meanwhile)
    done = jog("b", "--by", 0.1)
    if goes:
        assert done.exit_code == 0, done.output
        assert one.device.asked[1] == 100_000
        return
    assert done.exit_code == 3
    is_one_line(done, "b was turned since its way was told", "limit: 0.05 rad", "remedy: ")
    assert one.device.outputs_on == 0
    assert not one.device.taken


@pytest.mark.parametrize("answer", ["n\n", ""])
def test_a_latch_that_holds_is_let_go_only_when_that_is_meant(one: Setup, answer: str) -> None:
    one.device.latches[0].engaged = True
    refused = command("mcu", "torque-off", "--latches", answer=answer)
    assert refused.exit_code == 3
    assert "What em holds together comes apart, unless somebody holds it. Let go?" in refused.stderr
    assert one.device.latches[0].engaged
    assert document(command("mcu", "torque-off", "--latches", "--json", answer="y\n"))["latches"] == ["em"]
    assert not one.device.latches[0].engaged


def test_hinges_and_latches_are_asked_about_together(one: Setup) -> None:
    one.go(one.plan(by=0.1))
    one.device.latches[0].engaged = True
    refused = command("mcu", "torque-off", "--latches", answer="n\n")
    assert refused.exit_code == 3
    assert "What b holds up falls, and what em holds together comes apart" in refused.stderr
    assert (one.device.outputs_on, one.device.latches[0].engaged) == (0b010, True)
    without = command("mcu", "torque-off", answer="y\n")
    assert without.exit_code == 0
    assert "em" not in without.stderr
    assert (one.device.outputs_on, one.device.latches[0].engaged) == (0, True)


def test_nothing_is_asked_where_nothing_holds(one: Setup) -> None:
    done = command("mcu", "torque-off", "--latches")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "no hinge was on" in done.stdout
    assert one.device.outputs_on == 0
