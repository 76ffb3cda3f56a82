"""The page of a running controller: asks how it is twenty times a second, and passes on what is asked.

Nothing here is part of the control loop. The page asks over the operator's socket, as any other terminal does; when
it is lost, what moves goes on, and what rests stays at rest.
"""

from __future__ import annotations

import time

import numpy as np
import viser

from ori_deploy.files import Design
from ori_deploy.motion import Plan
from ori_deploy.operate.messages import Status
from ori_deploy.page.channel import Channel
from ori_deploy.page.curves import Recent
from ori_deploy.page.judging import Verdict
from ori_deploy.page.line import LineLost, Lines
from ori_deploy.page.panel import Chart
from ori_deploy.page.telling import Seen, Watch, latch_states, lost, news, readings
from ori_deploy.page.viewer import Viewer

ASK_S = 0.05
_CHARTS_EVERY, _STOP_LINE_EVERY = 10, 20
"""In askings: how often curves are drawn again, and the stop's line is seen to."""
_ENDED_S = 0.3
"""Until somebody is asked again who is not there; one who is silent has been waited for already."""


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
        self._watch = Watch(plan.cell_ids)
        self._recent: dict[str, Recent] = {}
        self._charts: dict[str, Chart] = {}
        self._was_there = False
        tabs = server.gui.add_tab_group()
        with tabs.add_tab("Now"):
            self._viewer.add_verdict()
        with tabs.add_tab("Section"):
            self._viewer.add_section()
        self._plots = tabs.add_tab("Plots")
        self._viewer.show(np.zeros(len(plan.cell_ids)), measured=False)

    def run(self) -> None:
        """Ask again and again, for as long as the page lives."""
        count = 0
        due = time.monotonic()
        while True:
            self._ask(count)
            count += 1
            due = max(due + ASK_S, time.monotonic())
            time.sleep(max(due - time.monotonic(), 0.0))

    # --- one asking -------------------------------------------------------------------------------------

    def _ask(self, count: int) -> None:
        try:
            answer = self._lines.status()
        except LineLost as wrong:
            if wrong.last is None:  # with a last word it stays as it was at the end
                self._lose()
            self._channel.tell(lost(wrong, self._was_there))
            if wrong.ended or wrong.shut:
                time.sleep(_ENDED_S)
            return
        status = answer.status
        if status is None:
            return
        self._was_there = True
        if count % _STOP_LINE_EVERY == 0:
            self._lines.keep_stop_open()
        seen = self._watch.note(status)
        self._viewer.show(seen.fold, measured=seen.measured)
        # Without readings of hinges nobody knows how old what the latches said is.
        self._viewer.shown.latch(latch_states(status) if seen.measured else {})
        if not seen.measured:
            self._verdict = None
        self._remember(status, seen, draw=count % _CHARTS_EVERY == 0)
        self._channel.tell(news(answer, status, self._verdict, self._plan, seen))

    def _lose(self) -> None:
        """Nothing that was told before is how things are now."""
        self._watch.forget()
        self._viewer.lose()
        self._viewer.shown.latch({})
        self._verdict = None
        for recent in self._recent.values():
            recent.gap()

    def _judged(self, verdict: Verdict | None) -> None:
        self._verdict = verdict

    def _remember(self, status: Status, seen: Seen, *, draw: bool) -> None:
        cells = self._plan.cell_ids
        degrees = np.degrees(self._viewer.mover.mechanism.four_bars.angles(seen.fold[None, :]))[0, :, 2]
        degrees[np.isnan(readings(status, len(cells)))] = np.nan
        rows = {
            "angle of crease close_a (°)": (cells, degrees.tolist()),
            "servo current (A)": (_numbered(status.current_a), status.current_a),
            "temperature (°C)": (_numbered(status.temperature_c), status.temperature_c),
        }
        for title, (names, values) in rows.items():
            if not values:
                if title in self._recent:
                    self._recent[title].gap()
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
