"""What the doctor says of a board, from a scripted one."""

from __future__ import annotations

from typing import Any

import pytest

from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.bench.board_diagnosis import Limits, judge_board
from ori_deploy.bench.diagnosis import Finding
from ori_deploy.wire.mcu import dialect
from tests.actuators.mcu.scripted import unharmed
from tests.actuators.mcu.setups import SERVO, wiring
from tests.bench.test_board_jog import Setup

LIMITS = Limits(4.5, 70.0)
BLIND = {"actuator": "b", "output": 5, "open_loop": True, **SERVO}


def feedback(one: Setup, known: McuWiring | None) -> dict[str, Finding]:
    found = judge_board(one.board, one.wiring.settings, known, LIMITS)
    return {finding.about: finding for finding in found if finding.check == "feedback"}


@pytest.mark.parametrize("with_plan", [False, True])
def test_a_hinge_that_has_no_wire_lacks_none_whether_a_plan_says_so_or_not(with_plan: bool) -> None:
    one = Setup(wiring(hinge=[BLIND]), silent=0b101)
    found = feedback(one, one.wiring if with_plan else None)
    assert [found[name].verdict for name in "abc"] == ["problem", "ok", "problem"]
    assert found["b"].value == "none: open_loop"
    assert found["c"].value.startswith("open wire at A")


@pytest.mark.parametrize("urad", [2_000_500, 2_100_000])
def test_a_shaft_beyond_its_range_is_a_warning_without_a_plan(urad: int) -> None:
    one = Setup()
    one.device.measured[1] = urad
    found = feedback(one, None)
    assert {name: finding.verdict for name, finding in found.items()} == {"a": "ok", "b": "warning", "c": "ok"}
    assert found["b"].limit == "-2 to 2 rad"


def test_what_was_found_stays_found_where_a_record_does_not_come() -> None:
    def loses_a_request(message: Any, frame: bytes) -> list[tuple[float, bytes]]:
        asks = message.get_type() == "ORI_CONFIG_READ" and message.record == dialect.ORI_RECORD_HINGE
        return [] if asks and message.index == 1 else unharmed(message, frame)

    one = Setup(to_device=loses_a_request)
    found = {finding.check: finding for finding in judge_board(one.board, one.wiring.settings, None, LIMITS)}
    assert found["configuration"].verdict == "problem"
    assert {"board answers", "fault", "link", "supply", "thermistor"} <= found.keys()
