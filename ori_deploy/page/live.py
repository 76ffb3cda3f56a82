"""The page of a running controller: asks how it is twenty times a second, and passes on what is asked.

Nothing here is part of the control loop. The page asks over the operator's socket, as any other terminal does; when
it is lost, what moves goes on, and what rests stays at rest.
"""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import viser

from ori_deploy.files import Design
from ori_deploy.motion import Plan
from ori_deploy.operate.messages import Answer, Status
from ori_deploy.page.channel import Channel
from ori_deploy.page.curves import Recent
from ori_deploy.page.judging import Verdict
from ori_deploy.page.line import LineLost, Lines
from ori_deploy.page.panel import TOUCH_M, Chart
from ori_deploy.page.viewer import Viewer
from ori_deploy.profiles.profile import Reals

ASK_S = 0.05
_CHARTS_EVERY, _STOP_LINE_EVERY = 10, 20
"""In askings: how often curves are drawn again, and the stop's line is seen to."""

_MM = 1e3
WAITING, ENDED = "waiting for the controller", "the controller has ended"


class Live:
    """Keeps a page true to its controller.

    Parameters
    ----------
    server, lines, channel
        Where it is shown, who is asked, whom the buttons are told of.
    design
        What moves.
    plan
        How; for how far cells may fall out of step.
    """

    def __init__(self, server: viser.ViserServer, lines: Lines, channel: Channel, design: Design, plan: Plan) -> None:
        self._server, self._lines, self._channel, self._plan = server, lines, channel, plan
        self._verdict: Verdict | None = None
        self._viewer = Viewer(server, design, self._judged)
        self._fold = np.zeros(len(plan.cell_ids))
        self._recent: dict[str, Recent] = {}
        self._charts: dict[str, Chart] = {}
        self._was_there = False
        self._ended = threading.Event()
        tabs = server.gui.add_tab_group()
        with tabs.add_tab("Now"):
            self._viewer.add_verdict()
        with tabs.add_tab("Section"):
            self._viewer.add_section()
        self._plots = tabs.add_tab("Plots")
        self._viewer.show(self._fold)

    @property
    def was_there(self) -> bool:
        """Whether the controller has answered at least once."""
        return self._was_there

    def run(self) -> None:
        """Ask again and again; until `end`."""
        count = 0
        due = time.monotonic()
        while not self._ended.is_set():
            self._ask(count)
            count += 1
            due = max(due + ASK_S, time.monotonic())
            self._ended.wait(max(due - time.monotonic(), 0.0))

    def end(self) -> None:
        """Ask no more."""
        self._ended.set()

    # --- one asking -------------------------------------------------------------------------------------

    def _ask(self, count: int) -> None:
        try:
            answer = self._lines.status()
        except LineLost:
            self._channel.tell(lost(self._was_there))
            self._ended.wait(0.3)
            return
        if answer.status is None:
            return
        self._was_there = True
        if count % _STOP_LINE_EVERY == 0:
            self._lines.keep_stop_open()
        self._show(answer.status)
        self._remember(answer.status, draw=count % _CHARTS_EVERY == 0)
        self._channel.tell(news(answer, answer.status, self._verdict, self._plan, self._fold))

    def _show(self, status: Status) -> None:
        self._fold = folds_of(status, self._fold)
        self._viewer.show(self._fold)
        self._viewer.shown.latch(
            {
                one.id: "unknown" if one.confirmed is None else "closed" if one.confirmed else "open"
                for one in status.latches
            }
        )

    def _judged(self, verdict: Verdict) -> None:
        self._verdict = verdict

    def _remember(self, status: Status, *, draw: bool) -> None:
        cells = self._plan.cell_ids
        degrees = np.degrees(self._viewer.mover.mechanism.four_bars.angles(self._fold[None, :]))[0, :, 2]
        rows = {
            "angle of crease close_a (°)": (cells, degrees.tolist()),
            "servo current (A)": (_numbered(status.current_a), status.current_a),
            "temperature (°C)": (_numbered(status.temperature_c), status.temperature_c),
        }
        for title, (names, values) in rows.items():
            if not values:
                continue
            recent = self._recent.setdefault(title, Recent(title, names, rows=round(60.0 / ASK_S)))
            recent.add(status.uptime_s, values)
            if draw and self._channel.browsers:
                self._draw(title, recent)

    def _draw(self, title: str, recent: Recent) -> None:
        curves = recent.curves
        if title in self._charts:
            self._charts[title].go_on(curves)
        elif len(curves.x) > 1:  # a chart that begins empty keeps showing what it began with
            with self._plots:
                self._charts[title] = Chart(self._server, curves)


def _numbered(values: tuple[float | None, ...]) -> tuple[str, ...]:
    return tuple(f"servo {k + 1}" for k in range(len(values)))


def folds_of(status: Status, before: Reals) -> Reals:
    """(n_cells,) what is measured; where it is not, what was before, or what is commanded while nothing was told."""
    told = status.folds if len(status.folds) == len(before) else ()
    if not told and status.fold is not None:
        return np.full(len(before), np.clip(status.fold, 0.0, 1.0))
    fold = before.copy()
    for k, value in enumerate(told):
        if value is not None:
            fold[k] = min(max(value, 0.0), 1.0)
    return fold


def lost(was_there: bool) -> dict[str, Any]:
    """What the bar says while nobody answers."""
    alarms = ["The controller does not answer: it has ended, or hangs. See its own terminal."] if was_there else []
    return {"link": ENDED if was_there else WAITING, "alarms": alarms}


def news(answer: Answer, status: Status, verdict: Verdict | None, plan: Plan, fold: Reals) -> dict[str, Any]:
    """What the bar shows."""
    closed = sum(one.confirmed is True for one in status.latches)
    facts = []
    if status.fold is not None:
        facts.append(f"{100.0 * status.fold:.1f} % open")
    if status.remaining_s is not None and not status.at_rest:
        facts.append(f"{status.remaining_s:.1f} s left")
    if verdict is not None and verdict.clearance_m is not None:
        touching = verdict.clearance_m < TOUCH_M
        facts.append("panels touch" if touching else f"clearance {_MM * verdict.clearance_m:.2f} mm")
    facts.append(f"out of step {np.ptp(fold):.3f}")
    if status.latches:
        facts.append(f"latches {closed}/{len(status.latches)}")
    return {
        "link": "ok",
        "state": str(status.state),
        "stage": status.stage,
        "at_rest": answer.at_rest,
        "fold": status.fold,
        "takes_orders": status.takes_orders,
        "facts": facts,
        "alarms": alarms_of(status, verdict, plan, fold),
    }


def alarms_of(status: Status, verdict: Verdict | None, plan: Plan, fold: Reals) -> list[str]:
    """What an operator must not overlook."""
    alarms = [] if status.fault is None else [f"Fault: {status.fault}"]
    if verdict is not None and verdict.collisions:
        worst = verdict.collisions[0]
        alarms.append(f"{worst.panels[0]} and {worst.panels[1]} reach {_MM * worst.depth_m:.2f} mm into each other")
    steps = plan.step_tolerance
    allowed = float(np.interp(fold.max(), steps.lead, steps.spread))
    if fold.max() < steps.seating_fold and np.ptp(fold) > allowed:
        alarms.append(f"Cells are out of step by {np.ptp(fold):.3f}; {allowed:.3f} is safe")
    return alarms
