"""`ori-deploy mcu monitor`: the microcontroller as it is, again and again."""

from __future__ import annotations

import json
import math
from contextlib import nullcontext

import click
from rich.live import Live
from rich.text import Text

from ori_deploy.actuators.bus import BusTimeout, CorruptReply
from ori_deploy.actuators.mcu.faults import fault_name, state_name
from ori_deploy.actuators.mcu.line import Reports
from ori_deploy.bench.board import Board
from ori_deploy.cli.bus_common import columns
from ori_deploy.cli.frame import console
from ori_deploy.cli.session import StopRequest
from ori_deploy.clock import MonotonicClock
from ori_deploy.wire.mcu import LatchState, State, dialect

_HINGES = ("hinge", "measured", "rad", "asked", "output")
_LATCHES = ("latch", "command", "sensor", "left", "")


def watch(found: Board, rate_hz: float, count: int | None, *, as_json: bool) -> None:
    """Poll and show until `count` is reached or a signal comes; what does not answer is shown as such."""
    clock = MonotonicClock()
    began = clock.now()
    shown = 0
    in_place = console.is_terminal and not as_json
    with StopRequest() as stop, Live(console=console, auto_refresh=False) if in_place else nullcontext() as live:
        while not stop.requested:
            time_s = clock.now() - began
            reports = _poll(found)
            if as_json:
                click.echo(json.dumps(_document(time_s, found, reports), allow_nan=False))
            elif live is not None:
                live.update(Text(_page(found, reports)), refresh=True)
            else:
                click.echo(_page(found, reports))
            shown += 1
            if shown == count:
                break
            clock.sleep_until(began + shown / rate_hz)


def _poll(found: Board) -> Reports | None:
    try:
        return found.line.poll(dialect.ORI_POLL_STATE | dialect.ORI_POLL_LATCHES)
    except (BusTimeout, CorruptReply):
        return None  # shown as no answer


def _document(time_s: float, found: Board, reports: Reports | None) -> dict[str, object]:
    answered: dict[str, object] = {"time_s": round(time_s, 4), "answered": reports is not None}
    if reports is None or reports.state is None or reports.latches is None:
        return answered
    state, latches = reports.state, reports.latches
    return {
        **answered,
        "state": state_name(state.state),
        "fault": fault_name(state.fault) if state.fault else None,
        "supply_v": 1e-3 * state.supply_mv,
        "queued": state.queued,
        "hinges": [
            {
                "index": k,
                "measured_rad": 1e-6 * state.position_urad[k] if state.sensed >> k & 1 else None,
                "asked_rad": 1e-6 * state.output_urad[k] if state.outputs_on >> k & 1 else None,
                "stalled": bool(state.stalled >> k & 1),
            }
            for k in range(found.info.hinges)
        ],
        "latches": [
            {
                "index": k,
                "engaged": bool(latches.commanded >> k & 1),
                "closed": bool(latches.closed >> k & 1) if latches.sensed >> k & 1 else None,
                "duty_left": 1e-3 * latches.duty_left_permille[k],
                "tripped": bool(latches.tripped >> k & 1),
            }
            for k in range(found.info.latches)
        ],
    }


def _page(found: Board, reports: Reports | None) -> str:
    if reports is None or reports.state is None or reports.latches is None:
        return f"{found.line.port.path}: no answer"
    state = reports.state
    fault = f", fault {fault_name(state.fault)}" if state.fault else ""
    head = f"{state_name(state.state)}{fault}; {state.queued} queued; supply {1e-3 * state.supply_mv:.2f} V"
    parts = [head, columns(_HINGES, [_hinge(state, k) for k in range(found.info.hinges)])]
    if found.info.latches:
        parts.append(columns(_LATCHES, [_latch(reports.latches, k) for k in range(found.info.latches)]))
    return "\n".join(parts)


def _hinge(state: State, k: int) -> tuple[str, ...]:
    measured, asked = 1e-6 * state.position_urad[k], 1e-6 * state.output_urad[k]
    sensed, on = state.sensed >> k & 1, state.outputs_on >> k & 1
    no_sense = "open wire" if state.silent >> k & 1 else "no feedback"
    return (
        str(k),
        f"{math.degrees(measured):+.2f} deg" if sensed else no_sense,
        f"{measured:+.4f}" if sensed else "-",
        f"{asked:+.4f}" if on else "-",
        "stalled" if state.stalled >> k & 1 else "on" if on else "off",
    )


def _latch(state: LatchState, k: int) -> tuple[str, ...]:
    sensed = state.sensed >> k & 1
    return (
        str(k),
        "engage" if state.commanded >> k & 1 else "release",
        ("closed" if state.closed >> k & 1 else "open") if sensed else "cannot tell",
        f"{0.1 * state.duty_left_permille[k]:.0f} %",
        "tripped" if state.tripped >> k & 1 else "driving" if state.driving >> k & 1 else "",
    )
