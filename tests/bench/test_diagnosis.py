"""Judgements of the doctor, from counts and readings alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.actuators.dynamixel.line import Pong
from ori_deploy.actuators.dynamixel.startup import MARK_ADDRESS, mark_of, write
from ori_deploy.actuators.dynamixel.wiring import HingeServo
from ori_deploy.bench.diagnosis import (
    ASKS,
    Answers,
    Finding,
    ServoState,
    ask,
    judge_answers,
    judge_presence,
    judge_rates,
    judge_servo,
    judge_turns,
)
from ori_deploy.bench.servos import Census
from ori_deploy.wire.dynamixel import OperatingMode, model_named
from sim_backends.dynamixel.spec import ServoSpec
from tests.actuators.dynamixel.scripted import ScriptedPort, status
from tests.bench.servos import Bench

GOOD = Answers(ASKS, 0, 0)
PONG = Pong(1, 1020, 48, alert=False)
WELL = ServoState(PONG, 2, 0.0, 0, 12.0, 9.5, 16.0, 30.0, 80.0)


def verdicts(findings: list[Finding], check: str) -> dict[str, str]:
    return {finding.about: finding.verdict for finding in findings if finding.check == check}


@given(st.integers(0, ASKS // 4))
def test_damage_now_and_then_is_no_second_servo(damaged: int) -> None:
    findings = judge_answers({1: GOOD, 2: Answers(ASKS - damaged, damaged, 0), 3: GOOD})
    assert verdicts(findings, "one servo per id") == {"bus": "ok"}
    assert verdicts(findings, "answers are whole") == ({"servo 2": "warning"} if damaged else {})


@given(st.integers(ASKS // 2, ASKS))
def test_damage_again_and_again_at_one_id_is_a_second_servo(damaged: int) -> None:
    findings = judge_answers({1: GOOD, 2: Answers(ASKS - damaged, damaged, 0), 3: GOOD})
    assert verdicts(findings, "one servo per id") == {"servo 2": "problem"}


def test_damage_at_every_id_is_the_line() -> None:
    findings = judge_answers({i: Answers(2, ASKS - 2, 0) for i in (1, 2, 3)})
    assert [(finding.check, finding.about, finding.verdict) for finding in findings] == [
        ("answers are whole", "bus", "problem")
    ]


def test_damage_at_the_only_servo_is_either_and_both_remedies_are_named() -> None:
    (found,) = judge_answers({5: Answers(2, ASKS - 2, 0)})
    assert (found.about, found.verdict) == ("servo 5", "problem")
    assert "two servos of this id, or a bad line" in found.value
    assert "others" not in found.value
    assert "termination" in found.remedy
    assert "ori-deploy bus set-id 5 NEW" in found.remedy


def test_silence_is_told_by_how_much_of_it_there_is() -> None:
    findings = judge_answers({1: GOOD, 2: Answers(ASKS - 3, 0, 3), 3: Answers(0, 0, ASKS)})
    assert verdicts(findings, "answers are whole") == {"servo 2": "warning", "servo 3": "problem"}
    assert verdicts(findings, "one servo per id") == {"bus": "ok"}


@pytest.mark.parametrize(
    ("answer", "counted"),
    [
        (status(1, bytes(27)), GOOD),
        (status(1, bytes(27))[:-1] + b"\x00", Answers(0, ASKS, 0)),
        (b"", Answers(0, 0, ASKS)),
        (status(1, bytes(27)) + status(1, bytes(26) + b"\x01"), Answers(0, ASKS, 0)),
        (status(1, b"", error=7), GOOD),
    ],
    ids=["good", "damaged", "silent", "twice", "refused"],
)
def test_answers_are_counted_one_by_one(answer: bytes, counted: Answers) -> None:
    """Two servos with one id and different delays do not even collide: the second answer is heard."""
    with ScriptedPort(lambda _: answer, slack_s=0.2 if answer else 0.01) as scripted:
        assert ask(scripted.line, 1) == counted
        assert {request[7] for request in scripted.sent} == {2}  # reads, nothing else


def test_a_servo_that_is_well_has_nothing_to_tell() -> None:
    assert {finding.verdict for finding in judge_servo(WELL, watchdog=True, lowest_v=10.5, hottest_c=70.0)} == {"ok"}


@pytest.mark.parametrize(
    ("state", "check", "verdict", "says"),
    [
        (replace(WELL, level=1), "status return level", "warning", "1"),
        (replace(WELL, level=None), "status return level", "problem", "no reads"),
        (replace(WELL, return_delay_s=5e-4), "return delay", "warning", "500 us"),
        (replace(WELL, error_bits=0x24), "hardware error", "problem", "overheating, overload"),
        (replace(WELL, voltage_v=9.4), "supply", "problem", "9.4 V"),
        (replace(WELL, voltage_v=10.4), "supply", "problem", "10.4 V"),
        (replace(WELL, voltage_v=16.1), "supply", "problem", "16.1 V"),
        (replace(WELL, temperature_c=70.0), "temperature", "problem", "70 °C"),
        (replace(WELL, temperature_c=60.0), "temperature", "warning", "60 °C"),
        (replace(WELL, pong=replace(PONG, firmware=37)), "firmware", "problem", "37"),
        (replace(WELL, pong=replace(PONG, firmware=44)), "firmware", "warning", "fast sync read"),
    ],
)
def test_every_fault_of_a_servo_is_told_with_limit_and_remedy(
    state: ServoState, check: str, verdict: str, says: str
) -> None:
    findings = judge_servo(state, watchdog=True, lowest_v=10.5, hottest_c=70.0)
    (found,) = [finding for finding in findings if finding.check == check]
    assert found.verdict == verdict
    assert says in found.value
    assert found.limit
    assert found.remedy
    assert all(finding.verdict == "ok" for finding in findings if finding is not found)


def test_without_a_rig_the_servos_own_limits_count() -> None:
    cold = replace(WELL, voltage_v=9.6, temperature_c=69.0)
    assert {finding.verdict for finding in judge_servo(cold, watchdog=False)} == {"ok"}
    old = replace(WELL, pong=replace(PONG, firmware=37))
    assert verdicts(judge_servo(old, watchdog=False), "firmware") == {"servo 1": "warning"}


def test_who_is_at_which_rate() -> None:
    here, there, nobody = Census(1_000_000, (PONG,), ()), Census(57_600, (), (7,)), Census(2_000_000, (), ())
    assert judge_presence(here, "port").verdict == "ok"
    assert judge_presence(nobody, "port").verdict == "problem"
    assert [finding.verdict for finding in judge_rates([here, nobody], 1_000_000)] == ["ok"]
    (other,) = judge_rates([here, there, nobody], 1_000_000)
    assert (other.about, other.verdict) == ("servo 7", "problem")
    assert "set-baud 7 1000000 --baud 57600" in other.remedy


@pytest.mark.parametrize("firmware", [52, 53])
def test_whose_turns_are_vouched_for_is_read_where_the_firmware_keeps_it(firmware: int) -> None:
    small = model_named("XL330-M288")  # as a rig has it, which does not know of firmware
    servos = [HingeServo(f"s{i}", i, small, OperatingMode.EXTENDED_POSITION, -9_000, 9_000) for i in (1, 2, 3)]
    with Bench(*(ServoSpec(id=i, model=small.name, firmware=firmware) for i in (1, 2))) as bench:
        write(bench.line, 2, mark_of(small.at_firmware(firmware)), MARK_ADDRESS)
        found = judge_turns(bench.line, servos, [bench.pong(1), bench.pong(2)])
    assert verdicts(found, "turns") == {"s1 (id 1)": "warning", "s2 (id 2)": "ok"}


def test_that_every_range_is_one_turn_is_said_of_all_servos() -> None:
    wide = HingeServo("s1", 1, model_named("xm430"), OperatingMode.EXTENDED_POSITION, -9_000, 9_000)
    with Bench(ServoSpec(id=1)) as bench:
        assert judge_turns(bench.line, [wide], []) == []
        assert verdicts(judge_turns(bench.line, [replace(wide, min_count=0, max_count=9)], []), "turns") == {
            "bus": "ok"
        }
