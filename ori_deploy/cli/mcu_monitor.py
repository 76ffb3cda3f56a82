"""`ori-deploy mcu monitor`: the microcontroller as it is, again and again."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass

import click
from rich.live import Live
from rich.text import Text

from ori_deploy.actuators.bus import BusTimeout, CorruptReply
from ori_deploy.actuators.mcu.faults import fault_name, state_name
from ori_deploy.actuators.mcu.line import Reports
from ori_deploy.actuators.mcu.readings import temperature_c
from ori_deploy.actuators.mcu.records import Record
from ori_deploy.actuators.mcu.settings import Thermistor
from ori_deploy.bench.board import Board
from ori_deploy.cli.bus_common import columns
from ori_deploy.cli.frame import console
from ori_deploy.cli.session import StopRequest
from ori_deploy.clock import MonotonicClock
from ori_deploy.wire.mcu import ConfigHinge, LatchState, State, dialect

_HINGES = ("hinge", "measured", "rad", "count", "asked", "output")
_LATCHES = ("latch", "command", "sensor", "left", "")


@dataclass(frozen=True, slots=True)
class Shown:
    """What is watched, and what is known of it.

    Attributes
    ----------
    board
        The device.
    config
        Its configuration; none when it has none.
    thermistor
        The rig's, if there is a rig.
    """

    board: Board
    config: Sequence[Record]
    thermistor: Thermistor | None

    def count(self, state: State, k: int) -> int | None:
        """What the converter read at a hinge's feedback wire, computed back from the position."""
        if not state.sensed >> k & 1:
            return None
        records = [record for record in self.config if isinstance(record, ConfigHinge)]
        record = records[k]
        return round(1e3 * (state.position_urad[k] - record.feedback_zero_urad) / record.feedback_slope_nrad)

    def supply_v(self, state: State) -> float | None:
        """Of the servos; None where nobody knows the divider."""
        return 1e-3 * state.supply_mv if self.config else None

    def celsius(self, state: State) -> float | None:
        """Of the servos; None without a rig or a thermistor."""
        if self.thermistor is None:
            return None
        found = temperature_c(state.temperature_count, self.thermistor)
        return found if math.isfinite(found) else None

    @staticmethod
    def estop(state: State) -> bool | None:
        """Whether the emergency stop is latched; None where another fault hides it."""
        if state.fault == dialect.ORI_FAULT_ESTOP:
            return True
        return None if state.fault or state.state == dialect.ORI_UNCONFIGURED else False


def watch(shown: Shown, rate_hz: float, count: int | None, *, as_json: bool) -> None:
    """Poll and show until `count` is reached or a signal comes; what does not answer is shown as such."""
    clock = MonotonicClock()
    began = clock.now()
    times = 0
    in_place = console.is_terminal and not as_json
    with StopRequest() as stop, Live(console=console, auto_refresh=False) if in_place else nullcontext() as live:
        while not stop.requested:
            time_s = clock.now() - began
            reports = _poll(shown.board)
            if as_json:
                click.echo(json.dumps(_document(time_s, shown, reports), allow_nan=False))
            elif live is not None:
                live.update(Text(_page(shown, reports)), refresh=True)
            else:
                click.echo(_page(shown, reports))
            times += 1
            if times == count:
                break
            clock.sleep_until(began + times / rate_hz)


def _poll(found: Board) -> Reports | None:
    try:
        return found.line.poll(dialect.ORI_POLL_STATE | dialect.ORI_POLL_LATCHES)
    except (BusTimeout, CorruptReply):
        return None  # shown as no answer


def _document(time_s: float, shown: Shown, reports: Reports | None) -> dict[str, object]:
    answered: dict[str, object] = {"time_s": round(time_s, 4), "answered": reports is not None}
    if reports is None or reports.state is None or reports.latches is None:
        return answered
    state, latches, naming = reports.state, reports.latches, shown.board.naming
    return {
        **answered,
        "state": state_name(state.state),
        "fault": fault_name(state.fault) if state.fault else None,
        "estop": shown.estop(state),
        "supply_v": shown.supply_v(state),
        "temperature_c": shown.celsius(state),
        "temperature_count": state.temperature_count,
        "queued": state.queued,
        "hinges": [
            {
                "index": k,
                "name": naming.hinge(k),
                "measured_rad": 1e-6 * state.position_urad[k] if state.sensed >> k & 1 else None,
                "count": shown.count(state, k),
                "asked_rad": 1e-6 * state.output_urad[k] if state.outputs_on >> k & 1 else None,
                "stalled": bool(state.stalled >> k & 1),
            }
            for k in range(shown.board.info.hinges)
        ],
        "latches": [
            {
                "index": k,
                "name": naming.latch(k),
                "engaged": bool(latches.commanded >> k & 1),
                "closed": bool(latches.closed >> k & 1) if latches.sensed >> k & 1 else None,
                "duty_left": 1e-3 * latches.duty_left_permille[k],
                "tripped": bool(latches.tripped >> k & 1),
            }
            for k in range(shown.board.info.latches)
        ],
    }


def _page(shown: Shown, reports: Reports | None) -> str:
    found = shown.board
    if reports is None or reports.state is None or reports.latches is None:
        return f"{found.line.port.path}: no answer"
    state = reports.state
    parts = [_head(shown, state), columns(_HINGES, [_hinge(shown, state, k) for k in range(found.info.hinges)])]
    if found.info.latches:
        rows = [_latch(found.naming.latch(k), reports.latches, k) for k in range(found.info.latches)]
        parts.append(columns(_LATCHES, rows))
    return "\n".join(parts)


def _head(shown: Shown, state: State) -> str:
    fault = f", fault {fault_name(state.fault)}" if state.fault else ""
    supply_v, celsius = shown.supply_v(state), shown.celsius(state)
    supply = "not configured" if supply_v is None else f"{supply_v:.2f} V"
    heat = f"thermistor {state.temperature_count} counts" if celsius is None else f"{celsius:.1f} °C"
    estop = {True: "latched", False: "free", None: "not known"}[shown.estop(state)]
    return f"{state_name(state.state)}{fault}; {state.queued} queued; supply {supply}; {heat}; e-stop {estop}"


def _hinge(shown: Shown, state: State, k: int) -> tuple[str, ...]:
    measured, asked = 1e-6 * state.position_urad[k], 1e-6 * state.output_urad[k]
    sensed, on = state.sensed >> k & 1, state.outputs_on >> k & 1
    no_sense = "open wire" if state.silent >> k & 1 else "no feedback"
    count = shown.count(state, k)
    return (
        shown.board.naming.hinge(k),
        f"{math.degrees(measured):+.2f} deg" if sensed else no_sense,
        f"{measured:+.4f}" if sensed else "-",
        "-" if count is None else str(count),
        f"{asked:+.4f}" if on else "-",
        "stalled" if state.stalled >> k & 1 else "on" if on else "off",
    )


def _latch(name: str, state: LatchState, k: int) -> tuple[str, ...]:
    sensed = state.sensed >> k & 1
    return (
        name,
        "engage" if state.commanded >> k & 1 else "release",
        ("closed" if state.closed >> k & 1 else "open") if sensed else "cannot tell",
        f"{0.1 * state.duty_left_permille[k]:.0f} %",
        "tripped" if state.tripped >> k & 1 else "driving" if state.driving >> k & 1 else "",
    )
