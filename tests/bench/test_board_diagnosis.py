"""What the doctor says of a board, from a scripted one."""

from __future__ import annotations

import pytest

from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.bench.board_diagnosis import Limits, judge_board
from ori_deploy.bench.diagnosis import Finding
from tests.actuators.mcu.setups import SERVO, wiring
from tests.bench.test_board_jog import Setup

BLIND = {"actuator": "b", "output": 5, "open_loop": True, **SERVO}


def feedback(one: Setup, known: McuWiring | None) -> dict[str, Finding]:
    found = judge_board(one.board, one.wiring.settings, known, Limits(4.5, 70.0))
    return {finding.about: finding for finding in found if finding.check == "feedback"}


@pytest.mark.parametrize("with_plan", [False, True])
def test_a_hinge_that_has_no_wire_lacks_none_whether_a_plan_says_so_or_not(with_plan: bool) -> None:
    one = Setup(wiring(hinge=[BLIND]), silent=0b101)
    found = feedback(one, one.wiring if with_plan else None)
    assert [found[name].verdict for name in "abc"] == ["problem", "ok", "problem"]
    assert found["b"].value == "none: open_loop"
    assert found["c"].value.startswith("open wire at A")


def test_a_shaft_beyond_its_range_is_a_warning_without_a_plan() -> None:
    one = Setup()
    one.device.measured[1] = 2_100_000
    found = feedback(one, None)
    assert {name: finding.verdict for name, finding in found.items()} == {"a": "ok", "b": "warning", "c": "ok"}
    assert found["b"].limit == "-2.001 to 2.001 rad"
