"""`ori-deploy doctor`: what is wrong with a bus, and what to do about it."""

from __future__ import annotations

import errno
import grp
import os
import stat
import sys
from collections import Counter
from pathlib import Path

import click

from ori_deploy.actuators.bus import BusClosed, BusError
from ori_deploy.actuators.dynamixel.adapter import GOOD_LATENCY_S, latency_advice, latency_timer_s
from ori_deploy.actuators.dynamixel.line import ServoLine
from ori_deploy.actuators.dynamixel.startup import ATTEMPTS
from ori_deploy.actuators.dynamixel.wiring import Wiring
from ori_deploy.actuators.resolve import resolve_rig
from ori_deploy.actuators.rig import STOW_POINT, Rig, load_rig
from ori_deploy.bench.board import BOOT_WAIT_S
from ori_deploy.bench.diagnosis import (
    Finding,
    ServoState,
    ask,
    examine,
    judge_answers,
    judge_loop,
    judge_presence,
    judge_rates,
    judge_servo,
    judge_turns,
    judge_wiring,
)
from ori_deploy.bench.servos import USUAL_BAUDS, Census, census
from ori_deploy.cli.bus_common import Place, columns, model_name, place, place_options, tell_json
from ori_deploy.cli.doctor_mcu import board_findings, unasked_board
from ori_deploy.cli.frame import EXIT_NOT_DONE, IN, example
from ori_deploy.errors import InputError, RigError
from ori_deploy.files import load_plan
from ori_deploy.motion import Plan

_PTS = "/dev/pts/"


@click.command(epilog=example("ori-deploy doctor --rig examples/rig_wing_dynamixel.toml"))
@place_options
@click.option("--plan", "plan_file", type=IN, help="Plan of the rig: names the cells of its [each_cell] template.")
@click.option("--mcu-port", help="Microcontroller of the rig.  [default: the rig's]")
@click.option("--all", "everything", is_flag=True, help="Also print what is in order.")
def doctor(
    port: str | None,
    baud: int | None,
    rig_file: Path | None,
    as_json: bool,
    plan_file: Path | None,
    mcu_port: str | None,
    everything: bool,
) -> None:
    """Check port, servos or microcontroller, and rig, and say what to do. Moves nothing and writes nothing.

    Ends with status 1 when there is a problem; warnings are none.
    """
    plan = None if plan_file is None else load_plan(plan_file)
    rig = None if rig_file is None else load_rig(rig_file)
    _require_purpose(port, mcu_port, rig)
    asked, findings = "", []
    if rig is None or rig.mcu is None or rig.dynamixel is not None:
        where = place(port, baud, rig_file)
        asked, findings = where.port, port_findings(where.port)
        if not _problems(findings):
            findings += _on_the_bus(where, plan) if rig is not None or baud is not None else _whoever_is_there(where)
    if rig is not None and rig.mcu is not None:
        board = mcu_port or (None if asked else port) or rig.mcu.port
        found = port_findings(board)
        findings += found if _problems(found) else found + board_findings(board, rig, plan)
        asked = asked or board
    verdicts = Counter(finding.verdict for finding in findings)
    if as_json:
        tell_json(
            {
                "port": asked,
                "rig": None if rig_file is None else str(rig_file),
                "findings": [_finding_json(finding) for finding in findings],
                "ok": verdicts["ok"],
                "warnings": verdicts["warning"],
                "problems": verdicts["problem"],
            }
        )
    else:
        _print(findings, everything=everything)
    if verdicts["problem"]:
        sys.exit(EXIT_NOT_DONE)


def _require_purpose(port: str | None, mcu_port: str | None, rig: Rig | None) -> None:
    """Refuse a device that nothing would be asked of."""
    if mcu_port is None:
        return
    if rig is None or rig.mcu is None:
        raise InputError(
            "--mcu-port: no microcontroller is looked for", value=mcu_port, limit="a rig with a table [mcu]",
            remedy="give --rig of such a rig; without a rig, --port alone is asked what it is",
            source=None if rig is None else rig.source,
        )  # fmt: skip
    if rig.dynamixel is None and port not in (None, mcu_port):
        raise InputError(
            "--port, --mcu-port: two devices for one board", value=f"{port}, {mcu_port}",
            limit="the rig has no servos of its own at --port", remedy="give one of them", source=rig.source,
        )  # fmt: skip


def _whoever_is_there(where: Place) -> list[Finding]:
    """Nobody said what the device is. A board that is awake says so at once, one in its bootloader after silence."""
    found = unasked_board(where.port, 0.0)
    if found:
        return found
    servos = _on_the_bus(where, None)
    nobody = any(finding.check == "servos answer" and finding.verdict == "problem" for finding in servos)
    return (unasked_board(where.port, BOOT_WAIT_S) if nobody else []) or servos


def _problems(findings: list[Finding]) -> bool:
    return any(finding.verdict == "problem" for finding in findings)


def _finding_json(finding: Finding) -> dict[str, str]:
    return {
        "check": finding.check,
        "about": finding.about,
        "status": finding.verdict,
        "value": finding.value,
        "limit": finding.limit,
        "remedy": finding.remedy,
    }


def _print(findings: list[Finding], *, everything: bool) -> None:
    """One line per check for what is in order, and one for everything that is wrong in the same way."""
    rows = []
    for check in dict.fromkeys(finding.check for finding in findings):
        ours = [finding for finding in findings if finding.check == check]
        good = [finding for finding in ours if finding.verdict == "ok"]
        if everything or len(good) == 1:
            rows += [("ok", check, one.about, one.value) for one in good]
        elif good:
            rows.append(("ok", check, f"{len(good)} of {len(ours)}", ", ".join(sorted({one.value for one in good}))))
        alike: dict[tuple[str, str], list[str]] = {}
        for one in ours:
            if one.verdict != "ok":
                alike.setdefault((one.verdict.upper(), _in_full(one)), []).append(one.about)
        rows += [(verdict, check, _together(about), text) for (verdict, text), about in alike.items()]
    click.echo(columns(("", "check", "of", "found"), rows))
    count = Counter(finding.verdict for finding in findings)
    click.echo(f"problems: {count['problem']}, warnings: {count['warning']}, in order: {count['ok']}")


def _together(about: list[str]) -> str:
    """ "servo 1", "servo 2" as "servo 1, 2"."""
    return ", ".join([about[0], *(name.removeprefix("servo ") for name in about[1:])])


def _in_full(finding: Finding) -> str:
    parts = (("", finding.value), ("limit: ", finding.limit), ("remedy: ", finding.remedy))
    return "; ".join(prefix + text for prefix, text in parts if text)


# -- the port ------------------------------------------------------------------------------------------


def port_findings(port: str) -> list[Finding]:
    """Everything about a port that can be known without sending anything."""
    path = Path(port)
    if not path.exists():
        return [
            Finding(
                "port", port, "problem", "no such device", "plugged in", "plug the adapter in, or correct the port"
            )
        ]
    mode = path.stat()
    if not stat.S_ISCHR(mode.st_mode):
        return [Finding("port", port, "problem", "not a device", "a serial port", "correct the port")]
    findings = [Finding("port", port, "ok", str(path.resolve()))]
    owner = _group(mode.st_gid)
    if not os.access(path, os.R_OK | os.W_OK):
        remedy = f"sudo usermod -aG {owner} $USER, then log in again"
        return [*findings, Finding("permission", port, "problem", "not allowed", f"group {owner}", remedy)]
    findings.append(Finding("permission", port, "ok", "root" if os.geteuid() == 0 else f"group {owner}"))
    holders = _holders(path.resolve())
    if holders:
        found = Finding("free", port, "problem", f"in use by {', '.join(holders)}", "nobody", "end that program")
        return [*findings, found]
    return [*findings, _latency(port)]


def _latency(port: str) -> Finding:
    latency = latency_timer_s(port)
    if latency is None:
        return Finding("latency timer", port, "ok", "has none, or the system does not tell")
    value, limit = f"{1e3 * latency:.0f} ms", f"{1e3 * GOOD_LATENCY_S:.0f} ms"
    advice = latency_advice(port)
    if advice is None:
        return Finding("latency timer", port, "ok", value, limit)
    return Finding("latency timer", port, "warning", value, limit, advice.partition("remedy: ")[2])


def _group(gid: int) -> str:
    try:
        return grp.getgrgid(gid).gr_name
    except KeyError:
        return str(gid)


def _holders(device: Path) -> list[str]:
    """Other processes that have a device open, as far as the system tells.

    The far end of a pseudo-terminal keeps this end open too, so there nobody can be told from it.
    """
    if str(device).startswith(_PTS):
        return []
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        if process.name != str(os.getpid()) and _has_open(process, device):
            found.append(f"{_name(process)} (process {process.name})")
    return found


def _has_open(process: Path, device: Path) -> bool:
    try:
        return any(Path(link).readlink() == device for link in (process / "fd").iterdir())
    except OSError as wrong:
        # Others' processes cannot be looked into, and any may end meanwhile; the lock on the port still tells.
        if wrong.errno in (errno.EACCES, errno.EPERM, errno.ENOENT, errno.ESRCH):
            return False
        raise


def _name(process: Path) -> str:
    try:
        return (process / "comm").read_text().strip()
    except OSError:
        return "a program"  # ended meanwhile


# -- the bus -------------------------------------------------------------------------------------------


def _on_the_bus(where: Place, plan: Plan | None) -> list[Finding]:
    """Everything that takes asking. With a rig, its servos are looked for at its rate."""
    wiring, findings = (None, []) if where.rig is None else _wiring(where.rig, plan)
    try:
        with where.opened() as line:
            line.port.check()
            findings.insert(0, Finding("free", where.port, "ok", "nobody else has it"))
            return findings + _ask_around(line, where, wiring)
    except BusClosed as wrong:
        value, _, remedy = str(wrong).partition("; remedy: ")
        return [*findings, Finding("free", where.port, "problem", value, "", remedy)]


def _ask_around(line: ServoLine, where: Place, wiring: Wiring | None) -> list[Finding]:
    found, baud = _find_everybody(line, where)
    line.port.setBaudRate(baud)
    expected = [] if wiring is None else [servo.id for servo in wiring.servos]
    here = _asked_again(line, next(one for one in found if one.baud == baud), expected)
    findings = [judge_presence(here, where.port), *judge_rates(found, baud)]
    asked = {pong.id for pong in here.pongs} | set(here.damaged)
    findings += judge_answers({servo_id: ask(line, servo_id) for servo_id in sorted(asked)})
    if wiring is not None:
        findings += judge_wiring(wiring, here.pongs)
    states = _examine(line, here, where.rig, findings)
    if wiring is not None and where.rig is not None:
        findings.append(judge_loop(wiring, states, where.rig.rate_hz, latency_timer_s(where.port)))
        healthy = [state.pong for state in states if state.level is not None]
        findings += judge_turns(line, wiring.hinges, healthy)
    return findings


def _find_everybody(line: ServoLine, where: Place) -> tuple[list[Census], int]:
    """A census at every usual rate, and the rate that counts: the rig's, or the one with most servos."""
    wanted = where.bauds[0] if len(where.bauds) == 1 else None
    bauds = dict.fromkeys((*where.bauds, *USUAL_BAUDS))
    found = [census(line, rate) for rate in bauds]
    return found, wanted or max(found, key=lambda one: len(one.pongs)).baud


def _asked_again(line: ServoLine, found: Census, expected: list[int]) -> Census:
    """A census with those who were only missed: a lost answer is no missing servo."""
    pongs = {pong.id: pong for pong in found.pongs}
    for servo_id in {*expected, *found.damaged} - pongs.keys():
        for _ in range(ATTEMPTS):
            pongs |= {pong.id: pong for pong in line.ping_all((servo_id,)) if servo_id not in pongs}
    damaged = tuple(servo_id for servo_id in found.damaged if servo_id not in pongs)
    return Census(found.baud, tuple(pongs[i] for i in sorted(pongs)), damaged)


def _examine(line: ServoLine, here: Census, rig: Rig | None, findings: list[Finding]) -> list[ServoState]:
    """Look at every servo in turn, and add what there is to say."""
    limits = None if rig is None else rig.controller
    watchdog = rig is not None and rig.dynamixel is not None and rig.dynamixel.watchdog_s > 0.0
    states = []
    for pong in here.pongs:
        if pong.model is None:
            findings.append(
                Finding(
                    "model",
                    f"servo {pong.id}",
                    "warning",
                    model_name(pong),
                    "an X-series servo",
                    "use DYNAMIXEL Wizard for it",
                )
            )
            continue
        try:
            state = examine(line, pong)
        except BusError as wrong:
            findings.append(Finding("registers", f"servo {pong.id}", "problem", str(wrong)))
            continue
        states.append(state)
        findings += judge_servo(
            state,
            watchdog=watchdog,
            lowest_v=None if limits is None else limits.min_voltage_v,
            hottest_c=None if limits is None else limits.max_temperature_c,
        )
    return states


def _wiring(rig: Rig, plan: Plan | None) -> tuple[Wiring | None, list[Finding]]:
    """The rig's servos, as far as they can be known without a plan: those of a template need one."""
    findings = []
    if plan is not None:
        cells, points = plan.cell_ids, plan.latch_points
    else:
        cells = tuple(hinge.cell for hinge in rig.hinge)
        points = tuple(latch.secures for latch in rig.latch if latch.secures != STOW_POINT)
        if rig.each_cell is not None or rig.each_latch_point is not None:
            findings.append(_without_plan(rig))
        if not cells:
            return None, findings
    try:
        wiring = resolve_rig(rig, cells, points).wiring
    except RigError as wrong:
        if wrong.thing.startswith("rate_hz"):  # told once more, by what is really there
            wrong.remedy = f"{wrong.remedy}; the servos were not compared with the rig"
        return None, [*findings, _of_error(rig, wrong)]
    return wiring, [*findings, Finding("rig", rig.source or "rig", "ok", f"{len(cells)} cells")]


def _without_plan(rig: Rig) -> Finding:
    return Finding("rig", rig.source or "rig", "ok", "what comes from its templates is known with --plan only")


def _of_error(rig: Rig, wrong: RigError) -> Finding:
    value = wrong.thing if wrong.value is None else f"{wrong.thing}: {wrong.value}"
    return Finding("rig", rig.source or "rig", "problem", value, wrong.limit or "", wrong.remedy or "")
