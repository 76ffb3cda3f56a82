"""What is wrong with a microcontroller and what is wired to it, check by check."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from ori_deploy.actuators.bus import BusTimeout, CommandRefused, CorruptReply
from ori_deploy.actuators.mcu.configure import read_config
from ori_deploy.actuators.mcu.faults import WHOLE, fault_error, fault_name
from ori_deploy.actuators.mcu.readings import THERMISTOR_HIGH, THERMISTOR_LOW, temperature_c
from ori_deploy.actuators.mcu.records import POSITION_SLACK_RAD, config_hash, records
from ori_deploy.actuators.mcu.settings import McuSettings
from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.bench.board import Board, firmware_version, reset_cause
from ori_deploy.bench.diagnosis import Finding, Verdict
from ori_deploy.wire.mcu import ConfigHinge, LatchState, State, dialect

ASKS = 50
"""Polls by which the link is judged."""

MANY_LOST = 0.05
"""Part of the answers from which on a motion would not go through."""

ABOUT = "microcontroller"


@dataclass(frozen=True, slots=True)
class Limits:
    """What the rig allows: lowest supply that the controller accepts, hottest servo."""

    min_voltage_v: float
    max_temperature_c: float


def judge_board(found: Board, settings: McuSettings, wiring: McuWiring | None, limits: Limits) -> list[Finding]:
    """Everything about a board that answers; nothing is changed.

    Parameters
    ----------
    wiring
        What the rig wires to it; None when only a plan can tell. What has a wire is known from its own records.

    Raises
    ------
    BusTimeout, CorruptReply, BusClosed
        It does not answer any more.
    """
    reports = found.line.poll_patiently(dialect.ORI_POLL_STATE | dialect.ORI_POLL_LATCHES)
    state, latches = reports.state, reports.latches
    assert state is not None
    assert latches is not None
    findings = [_judge_presence(found), _judge_config(found, wiring), _judge_fault(found, state)]
    findings.append(judge_link(found, settings))
    if found.naming.device is None:
        return findings
    findings.append(_judge_supply(found, state, settings, limits))
    if found.info.hinges:
        findings.append(_judge_thermistor(state, settings, limits))
    findings += _judge_hinges(found, state)
    return findings + [_judge_latch(found, latches, k) for k in range(found.info.latches)]


def _judge_presence(found: Board) -> Finding:
    info = found.info
    value = f"{info.port}, firmware {firmware_version(info)}, start {info.boot} by {reset_cause(info)}"
    return Finding("board answers", found.line.port.path, "ok", value)


def _judge_config(found: Board, wiring: McuWiring | None) -> Finding:
    check, has = "configuration", f"{found.info.config_hash:08x}"
    if found.naming.device is None:
        return Finding(check, ABOUT, "problem", "none", "the rig's", "ori-deploy mcu config RIG --plan PLAN")
    if wiring is None:
        return Finding(check, ABOUT, "ok", f"{has}; whether it is the rig's is known with --plan only")
    wanted = f"{config_hash(records(wiring)):08x}"
    if has != wanted:
        remedy = "ori-deploy mcu config RIG --plan PLAN"
        return Finding(check, ABOUT, "problem", f"{has}, another rig's or plan's", f"{wanted}, the rig's", remedy)
    return Finding(check, ABOUT, "ok", f"{has}, the rig's")


def _judge_fault(found: Board, state: State) -> Finding:
    wrong = fault_error(state, found.naming)
    if wrong is None:
        return Finding("fault", ABOUT, "ok", "none is latched")
    text, _, remedy = str(wrong).removeprefix(f"{WHOLE}: ").partition("; remedy: ")
    value, _, limit = text.partition("; limit: ")
    return Finding("fault", ABOUT, "problem", f"{fault_name(state.fault)}: {value}", limit, remedy)


def judge_link(found: Board, settings: McuSettings) -> Finding:
    """How long answers take, and how many are lost or come too late for the loop."""
    took: list[float] = []
    for _ in range(ASKS):
        began = time.monotonic()
        try:
            found.line.poll(dialect.ORI_POLL_STATE)
        except (BusTimeout, CorruptReply):
            continue
        took.append(time.monotonic() - began)
    late = ASKS - sum(1 for one in took if one <= settings.reply_timeout_s)
    value = f"{late} of {ASKS} answers lost or late"
    if took:
        value = f"round trip {1e3 * float(np.median(took)):.1f} ms, longest {1e3 * max(took):.1f} ms; {value}"
    limit = f"reply_timeout_s = {settings.reply_timeout_s:g} s"
    verdict: Verdict = "ok" if late == 0 else "problem" if late > MANY_LOST * ASKS else "warning"
    remedy = "" if late == 0 else "check cable and ground, and what else loads the computer"
    return Finding("link", ABOUT, verdict, value, limit, remedy)


def _judge_supply(found: Board, state: State, settings: McuSettings, limits: Limits) -> Finding:
    volts = 1e-3 * state.supply_mv
    if not found.info.hinges and settings.min_supply_v == 0.0:
        return Finding("supply", ABOUT, "ok", f"{volts:.2f} V at A12; the board watches none")
    lowest = max(settings.min_supply_v, limits.min_voltage_v if found.info.hinges else 0.0)
    value, limit = f"{volts:.2f} V", f"{lowest:g} V or more"
    if volts < lowest:
        return Finding("supply", ABOUT, "problem", value, limit, "switch it on, check its fuse and supply_divider")
    return Finding("supply", ABOUT, "ok", value, limit)


def _judge_thermistor(state: State, settings: McuSettings, limits: Limits) -> Finding:
    count = state.temperature_count
    celsius = temperature_c(count, settings.thermistor)
    if not np.isfinite(celsius):
        what = "short circuit" if count < THERMISTOR_LOW else "missing, or an open wire"
        limit = f"{THERMISTOR_LOW} to {THERMISTOR_HIGH} counts"
        remedy = "check it and its resistor, or put 10 kohm in its place"
        return Finding("thermistor", "A13", "problem", f"{what}: {count} counts", limit, remedy)
    hot = celsius > limits.max_temperature_c
    return Finding(
        "thermistor", "A13", "problem" if hot else "ok", f"{celsius:.1f} °C", f"{limits.max_temperature_c:g} °C",
        "let the servos cool" if hot else "",
    )  # fmt: skip


def _judge_hinges(found: Board, state: State) -> list[Finding]:
    try:
        config = read_config(found.line)
    except (BusTimeout, CorruptReply, CommandRefused) as wrong:  # what was found until here is still so
        value, _, remedy = str(wrong).partition("; remedy: ")
        where = found.line.port.path
        return [Finding("configuration", where, "problem", value, "every record is told", remedy or "see the link")]
    hinges = [record for record in config if isinstance(record, ConfigHinge)]
    return [_judge_feedback(found, state, k, hinge) for k, hinge in enumerate(hinges)]


def _judge_feedback(found: Board, state: State, k: int, hinge: ConfigHinge) -> Finding:
    check, name = "feedback", found.naming.hinge(k)
    if not hinge.flags & dialect.ORI_HINGE_HAS_FEEDBACK:
        return Finding(check, name, "ok", "none: open_loop")
    where = f" at A{hinge.adc}"
    if state.sensed >> k & 1:
        rad = 1e-6 * state.position_urad[k]
        low, high = 1e-6 * hinge.min_urad + POSITION_SLACK_RAD, 1e-6 * hinge.max_urad - POSITION_SLACK_RAD
        if not low <= rad <= high:
            limit = f"{low:.4g} to {high:.4g} rad"
            return Finding(check, name, "warning", f"{rad:.4f} rad", limit, "bring it back by hand, or calibrate")
        return Finding(check, name, "ok", f"{rad:.4f} rad")
    if state.silent >> k & 1:
        remedy = "check its wire, and the servos' supply"
        return Finding(check, name, "problem", f"open wire{where}", "a reading", remedy)
    remedy = "check its wire and its calibration"
    return Finding(check, name, "problem", f"nothing that can be{where}", "feedback_low to feedback_high", remedy)


def _judge_latch(found: Board, latches: LatchState, k: int) -> Finding:
    check, name = "latch sensor", found.naming.latch(k)
    if latches.tripped >> k & 1:
        left = f"energised for too long; cooled by {0.1 * latches.duty_left_permille[k]:.0f} %"
        return Finding(check, name, "warning", left, "100 %", "let it cool")
    if latches.sensed >> k & 1:
        return Finding(check, name, "ok", "closed" if latches.closed >> k & 1 else "open")
    return Finding(check, name, "warning", "cannot tell", "a steady level", "check its wire; or it has no sensor")
