"""The part of `ori-deploy doctor` that is about a microcontroller."""

from __future__ import annotations

from ori_deploy.actuators.bus import BusError
from ori_deploy.actuators.mcu.wiring import McuWiring
from ori_deploy.actuators.resolve import resolve_rig
from ori_deploy.actuators.rig import Rig
from ori_deploy.bench.board import board, fault_words, firmware_version
from ori_deploy.bench.board_diagnosis import Limits, judge_board
from ori_deploy.bench.diagnosis import Finding
from ori_deploy.cli.mcu_common import BAUD, named_wiring, place, with_board
from ori_deploy.clock import MonotonicClock
from ori_deploy.errors import RigError
from ori_deploy.motion import Plan


def board_findings(port: str, rig: Rig, plan: Plan | None) -> list[Finding]:
    """Everything about the board of a rig that takes asking."""
    settings = with_board(rig)
    wiring, findings = _wiring(rig, plan)
    limits = Limits(rig.controller.min_voltage_v, rig.controller.max_temperature_c)
    try:
        with place(port, settings, wiring).opened() as found:
            known = wiring if plan is not None else None
            return findings + judge_board(found, settings, known, limits)
    except BusError as wrong:
        value, _, remedy = str(wrong).partition("; remedy: ")
        return [*findings, Finding("board answers", port, "problem", value, "", remedy)]


def unasked_board(port: str, boot_wait_s: float) -> list[Finding]:
    """What a board at a port says without a rig; nothing where none answers, after silence for so long."""
    try:
        with board(port, BAUD, MonotonicClock(), boot_wait_s) as found:
            told = (
                f"microcontroller ({found.info.port}), firmware {firmware_version(found.info)}, no Dynamixel servos"
            )
            fault = fault_words(found.state(), found.naming)
    except BusError:
        return []
    value, _, remedy = fault.partition("; remedy: ")
    judged = Finding("fault", port, "ok", "none") if fault == "none" else Finding(
        "fault", port, "problem", value, "", remedy
    )  # fmt: skip
    return [Finding("device", port, "ok", f"{told}; with --rig it is looked at in full"), judged]


def _wiring(rig: Rig, plan: Plan | None) -> tuple[McuWiring | None, list[Finding]]:
    if plan is None:
        return named_wiring(rig), []
    try:
        return resolve_rig(rig, plan.cell_ids, plan.latch_points).mcu, []
    except RigError as wrong:
        value = wrong.thing if wrong.value is None else f"{wrong.thing}: {wrong.value}"
        finding = Finding("rig", rig.source or "rig", "problem", value, wrong.limit or "", wrong.remedy or "")
        return None, [finding]
