"""What is wrong with a bus: every check says what it found, the limit, and what to do.

Only pings and reads go out: nothing moves, nothing is written.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from ori_deploy.actuators.bus import BusTimeout, CorruptReply
from ori_deploy.actuators.dynamixel.line import Pong, ServoLine, ServoRefused
from ori_deploy.actuators.dynamixel.startup import fast_read_known, name_of, read
from ori_deploy.actuators.dynamixel.throughput import cycle_time, planned_times
from ori_deploy.actuators.dynamixel.turns import unvouched
from ori_deploy.actuators.dynamixel.wiring import HingeServo, PinServo, Wiring
from ori_deploy.bench.meaning import error_words
from ori_deploy.bench.servos import Census
from ori_deploy.wire.dynamixel.models import FAST_SYNC_READ_FIRMWARE, WATCHDOG_FIRMWARE
from ori_deploy.wire.dynamixel.registers import RETURN_DELAY_UNIT_S, VOLTAGE_UNIT_V

Verdict = Literal["ok", "warning", "problem"]

ASKS = 16
"""Reads of each servo by which its answers are judged."""

DAMAGED = 0.3
"""Part of the answers at one id from which on damage is no accident."""

NEARLY_HOT_C = 10.0
_PROBE_ADDRESS, _PROBE_SIZE = 120, 27
"""Clock to temperature: two servos never say the same here."""

_SECOND_ANSWER_S = 2e-3


@dataclass(frozen=True, slots=True)
class Finding:
    """One check.

    Attributes
    ----------
    check, about
        What was checked, of which port or servo.
    verdict
        How bad it is.
    value, limit, remedy
        What was found, what it has to be, what to do; "" where that goes without saying.
    """

    check: str
    about: str
    verdict: Verdict
    value: str
    limit: str = ""
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class Answers:
    """How often a servo answered well, with damage or twice, and not at all."""

    good: int
    damaged: int
    silent: int

    @property
    def damaged_part(self) -> float:
        """Part of all questions."""
        return self.damaged / max(1, self.good + self.damaged + self.silent)


@dataclass(frozen=True, slots=True)
class ServoState:
    """What a servo says of itself; volts, degrees Celsius, seconds.

    Attributes
    ----------
    pong
        Who it is.
    level
        Status return level; None when it answers pings only.
    """

    pong: Pong
    level: int | None
    return_delay_s: float = 0.0
    error_bits: int = 0
    voltage_v: float = math.nan
    lowest_v: float = math.nan
    highest_v: float = math.nan
    temperature_c: float = math.nan
    hottest_c: float = math.nan


def ask(line: ServoLine, servo_id: int) -> Answers:
    """Ask one servo many times, and count. Raises `BusClosed` only."""
    good = damaged = silent = 0
    for _ in range(ASKS):
        try:
            line.read_block(servo_id, _PROBE_ADDRESS, _PROBE_SIZE)
        except BusTimeout:
            silent += 1
        except CorruptReply:
            damaged += 1
        except ServoRefused:
            good += 1
        else:
            twice = line.port.goes_on(_SECOND_ANSWER_S)
            good, damaged = good + (not twice), damaged + twice
    return Answers(good, damaged, silent)


def examine(line: ServoLine, pong: Pong) -> ServoState:
    """Read what is judged of one servo of a known model.

    Raises
    ------
    BusError
        Its answers are no good.
    """
    if pong.model is None:
        raise ValueError("only servos of known models can be examined")
    table = pong.model.table
    try:
        level = read(line, pong.id, table.status_return_level)
    except BusTimeout:
        return ServoState(pong, None)
    return ServoState(
        pong,
        level,
        return_delay_s=read(line, pong.id, table.return_delay_time) * RETURN_DELAY_UNIT_S,
        error_bits=read(line, pong.id, table.hardware_error_status),
        voltage_v=read(line, pong.id, table.present_input_voltage) * VOLTAGE_UNIT_V,
        lowest_v=read(line, pong.id, table.min_voltage_limit) * VOLTAGE_UNIT_V,
        highest_v=read(line, pong.id, table.max_voltage_limit) * VOLTAGE_UNIT_V,
        temperature_c=float(read(line, pong.id, table.present_temperature)),
        hottest_c=float(read(line, pong.id, table.temperature_limit)),
    )


# -- who is there --------------------------------------------------------------------------------------


def judge_presence(found: Census, port: str) -> Finding:
    """Whether anybody answers."""
    ids = ", ".join(str(pong.id) for pong in found.pongs)
    if found.pongs:
        return Finding("servos answer", port, "ok", f"ids {ids} at {found.baud} baud")
    return Finding(
        "servos answer", port, "problem", f"nobody at {found.baud} baud", "at least one servo",
        "check power, wiring and baud rate",
    )  # fmt: skip


def judge_rates(found: Sequence[Census], baud: int) -> list[Finding]:
    """Whether everybody is at one rate."""
    others = [census for census in found if census.baud != baud and census.anybody]
    if not others:
        tried = ", ".join(str(census.baud) for census in found)
        return [Finding("one baud rate", "bus", "ok", f"nobody at other rates; tried {tried}")]
    findings = []
    for census in others:
        ids = [*(pong.id for pong in census.pongs), *census.damaged]
        which = f"{ids[0]} {baud}" if len(ids) == 1 else f"all {baud}"
        findings.append(
            Finding(
                "one baud rate", f"servo {', '.join(map(str, ids))}", "problem", f"{census.baud} baud",
                f"{baud} baud, as the others", f"ori-deploy bus set-baud {which} --baud {census.baud}",
            )
        )  # fmt: skip
    return findings


LINE_REMEDY = "check ground, termination and length of the cable, and that no other adapter is on it"


def _either(servo_id: int, counted: Answers) -> Finding:
    return Finding(
        "one servo per id", f"servo {servo_id}", "problem",
        f"{counted.damaged} of {ASKS} answers damaged or double: two servos of this id, or a bad line; "
        "with no other id on the bus they look alike",
        "whole answers, from one servo",
        f"{LINE_REMEDY}; and leave one servo plugged in: if its answers are whole then, "
        f"ori-deploy bus set-id {servo_id} NEW before the other comes back",
    )  # fmt: skip


def judge_answers(answers: Mapping[int, Answers]) -> list[Finding]:
    """Which ids two servos share, and whether the line itself is bad.

    An id whose answers are damaged again and again while others' are not belongs to two servos; where most
    are damaged it is the line. With one id alone nobody can tell which.
    """
    bad = [servo_id for servo_id, counted in answers.items() if counted.damaged_part >= DAMAGED]
    if bad and len(answers) == 1:
        return [_either(bad[0], answers[bad[0]])]
    if bad and len(bad) == len(answers):
        worst = max(counted.damaged_part for counted in answers.values())
        return [
            Finding(
                "answers are whole", "bus", "problem", f"up to {100.0 * worst:.0f} % damaged, at every id", "none",
                LINE_REMEDY,
            )
        ]  # fmt: skip
    findings = [
        Finding(
            "one servo per id", f"servo {servo_id}", "problem",
            f"{answers[servo_id].damaged} of {ASKS} answers damaged or double, others' are fine",
            "no two with one id",
            f"take one of them off the bus, then ori-deploy bus set-id {servo_id} NEW",
        )
        for servo_id in bad
    ]  # fmt: skip
    if not bad:
        findings.append(Finding("one servo per id", "bus", "ok", "no id answers damaged or double"))
    weak = {i: c for i, c in answers.items() if i not in bad and c.good < ASKS}
    for servo_id, counted in weak.items():
        findings.append(
            Finding(
                "answers are whole", f"servo {servo_id}", "problem" if counted.good == 0 else "warning",
                f"{counted.silent} of {ASKS} lost, {counted.damaged} damaged", "none", "check its cable and plugs",
            )
        )  # fmt: skip
    return findings


def judge_wiring(wiring: Wiring, pongs: Sequence[Pong]) -> list[Finding]:
    """Whether the servos are those of the rig."""
    there = {pong.id: pong for pong in pongs}
    findings = [_judge_servo_of_rig(servo, there.get(servo.id)) for servo in wiring.servos]
    known = {servo.id for servo in wiring.servos}
    for pong in pongs:
        if pong.id not in known:
            findings.append(
                Finding(
                    "servos are the rig's", f"servo {pong.id}", "warning", "not in the rig",
                    f"ids {', '.join(str(i) for i in sorted(known))}",
                    "add it to the rig, or take it off the bus",
                )
            )  # fmt: skip
    return findings


def _judge_servo_of_rig(servo: HingeServo | PinServo, pong: Pong | None) -> Finding:
    name, check = f"{name_of(servo)} (id {servo.id})", "servos are the rig's"
    if pong is None:
        return Finding(
            check, name, "problem", "does not answer", f"{servo.model.name} at id {servo.id}",
            "check its cable and power; correct its id in the rig, or ori-deploy bus set-id",
        )  # fmt: skip
    if pong.model_number != servo.model.number:
        found = pong.model.name if pong.model else f"model number {pong.model_number}"
        return Finding(check, name, "problem", found, servo.model.name, "correct model in the rig, or the wiring")
    return Finding(check, name, "ok", servo.model.name)


# -- one servo -----------------------------------------------------------------------------------------


def judge_servo(
    state: ServoState, *, watchdog: bool, lowest_v: float | None = None, hottest_c: float | None = None
) -> list[Finding]:
    """Everything about one servo.

    Parameters
    ----------
    watchdog
        Whether a rig wants the bus watchdog.
    lowest_v, hottest_c
        `min_voltage_v` and `max_temperature_c` of a rig.
    """
    findings = [_judge_level(state), _judge_firmware(state, watchdog=watchdog)]
    if state.level is None:
        return findings
    findings += [_judge_delay(state), _judge_error(state)]
    findings.append(_judge_voltage(state, lowest_v or 0.0))
    findings.append(_judge_temperature(state, hottest_c if hottest_c is not None else math.inf))
    return findings


def _about(state: ServoState) -> str:
    return f"servo {state.pong.id}"


def _judge_level(state: ServoState) -> Finding:
    check = "status return level"
    if state.level == 2:
        return Finding(check, _about(state), "ok", "2")
    if state.level is None:
        return Finding(
            check, _about(state), "problem", "answers pings, but no reads", "2",
            "switch its supply off and on, which sets it to 2",
        )  # fmt: skip
    return Finding(
        check, _about(state), "warning", str(state.level), "2",
        "deploy and stow set it; or switch its supply off and on",
    )  # fmt: skip


def _judge_firmware(state: ServoState, *, watchdog: bool) -> Finding:
    check, found = "firmware", state.pong.firmware
    if found < WATCHDOG_FIRMWARE:
        return Finding(
            check, _about(state), "problem" if watchdog else "warning", f"{found}, without bus watchdog",
            f"{WATCHDOG_FIRMWARE} or newer",
            "update it with DYNAMIXEL Wizard" + (", or set watchdog_s = 0 in the rig" if watchdog else ""),
        )  # fmt: skip
    fast = FAST_SYNC_READ_FIRMWARE if state.pong.model is None else state.pong.model.fast_sync_read_firmware
    if found < fast:
        return Finding(
            check, _about(state), "warning", f"{found}, without fast sync read",
            f"{fast} or newer", "update it with DYNAMIXEL Wizard, for a faster loop",
        )  # fmt: skip
    return Finding(check, _about(state), "ok", str(found))


def _judge_delay(state: ServoState) -> Finding:
    found = f"{1e6 * state.return_delay_s:.0f} us"
    if state.return_delay_s > 0.0:
        return Finding(
            "return delay", _about(state), "warning", found, "0 us", "deploy and stow set it, while torque is off"
        )
    return Finding("return delay", _about(state), "ok", found)


def _judge_error(state: ServoState) -> Finding:
    words = error_words(state.error_bits)
    if state.error_bits:
        return Finding(
            "hardware error", _about(state), "problem", words, "none",
            f"remove the cause, then ori-deploy bus reset-error {state.pong.id}",
        )  # fmt: skip
    return Finding("hardware error", _about(state), "ok", words)


def _judge_voltage(state: ServoState, lowest_v: float) -> Finding:
    low = max(state.lowest_v, lowest_v)
    found, limit = f"{state.voltage_v:.1f} V", f"{low:.1f} to {state.highest_v:.1f} V"
    if low <= state.voltage_v <= state.highest_v:
        return Finding("supply", _about(state), "ok", found, limit)
    why = " (min_voltage_v of the rig)" if state.voltage_v >= state.lowest_v and lowest_v > state.lowest_v else ""
    return Finding("supply", _about(state), "problem", found, limit + why, "check supply, cable and plugs")


def _judge_temperature(state: ServoState, hottest_c: float) -> Finding:
    limit_c = min(state.hottest_c, hottest_c)
    found, limit = f"{state.temperature_c:.0f} °C", f"{limit_c:.0f} °C"
    if state.temperature_c >= limit_c:
        return Finding("temperature", _about(state), "problem", found, limit, "let it cool, lighten its load")
    verdict: Verdict = "warning" if state.temperature_c >= limit_c - NEARLY_HOT_C else "ok"
    return Finding("temperature", _about(state), verdict, found, limit, "let it cool" if verdict == "warning" else "")


# -- all together --------------------------------------------------------------------------------------


def judge_loop(wiring: Wiring, states: Sequence[ServoState], rate_hz: float, usb_latency_s: float | None) -> Finding:
    """Whether the control loop can go round at the rig's rate on the bus as it is.

    Parameters
    ----------
    usb_latency_s
        As the adapter has it; None for what the rig states.
    """
    fast = wiring.settings.fast_sync_read and fast_read_known([state.pong for state in states])
    # The return delay is set to 0 when a controller connects, so it does not count.
    cycle = cycle_time(wiring, planned_times(wiring, usb_latency_s=usb_latency_s), fast=fast)
    kind = "fast sync read" if fast else "sync read"
    value = f"{cycle.rate_hz:.0f} Hz with {kind} at {wiring.settings.baud} baud"
    if cycle.rate_hz >= rate_hz:
        return Finding("loop rate", "bus", "ok", value, f"rate_hz = {rate_hz:g}")
    return Finding(
        "loop rate", "bus", "problem", value, f"rate_hz = {rate_hz:g}",
        "set the latency timer to 1 ms, raise the baud rate, update firmware, or lower rate_hz",
    )  # fmt: skip


def judge_turns(line: ServoLine, servos: Sequence[HingeServo], pongs: Sequence[Pong]) -> list[Finding]:
    """Whether servos of more than one turn know which one they are in.

    Parameters
    ----------
    servos
        Of the rig.
    pongs
        Those that can be asked; their firmware decides where it is written.

    Raises
    ------
    BusError
        As `startup.read`.
    """
    wide = [servo for servo in servos if not servo.one_turn]
    if not wide:
        return [Finding("turns", "bus", "ok", "every range lies within one turn")]
    models = {pong.id: pong.model for pong in pongs}
    there = [replace(servo, model=model) for servo in wide if (model := models.get(servo.id)) is not None]
    lost = unvouched(line, there)
    return [
        Finding(
            "turns", f"{servo.name} (id {servo.id})", "warning", "restarted: may be whole turns from where it says",
            "vouched for", "say where the structure stands: ori-deploy deploy ... --stands stowed",
        )
        if servo in lost
        else Finding("turns", f"{servo.name} (id {servo.id})", "ok", "vouched for")
        for servo in there
    ]  # fmt: skip
