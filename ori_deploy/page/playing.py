"""Pages of a design, a plan or a flight log: sliders, stages, play."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from ori_deploy.motion import Plan
from ori_deploy.page.curves import ALL_CELLS, crease_curves, flown_curves
from ori_deploy.page.latches import NAMES
from ori_deploy.page.panel import Chart, put_html, table_html
from ori_deploy.page.sources import Source
from ori_deploy.page.timeline import Timeline, flown, planned, preview
from ori_deploy.page.viewer import Viewer

FRAME_S = 1.0 / 40.0
"""A little more often than the 30 times a second that are meant to be seen: some come late, or two to a frame."""
_SLIDER_EVERY = 6
"""Frames between two updates of the time slider while it plays."""

_MOST_STAGES = 100
"""Stages that can be gone to from a list; it says how many more there are."""

BY_HAND = "by hand"
"""What is told for a stage where a slider has made a pose that comes at no time."""


class Player:
    """The panel of such a page, and what its controls do.

    Parameters
    ----------
    server
        Where.
    source
        What.
    """

    def __init__(self, server: viser.ViserServer, source: Source) -> None:
        self._server, self._source = server, source
        self._viewer = Viewer(server, source.design)
        design = source.design
        self._cell_ids = design.structure.layout.cell_ids
        self._timeline = timeline_of(source)
        self._goals = goals(self._timeline)
        self._latches: viser.GuiHtmlHandle | None = None
        self._jump: viser.GuiDropdownHandle[str] | None = None
        self._fold = np.ones(len(self._cell_ids))
        self._span: float | None = None if source.run is not None else 0.0
        self._time = self._timeline.duration_s
        self._playing = threading.Event()
        # One pose at a time: hands that move sliders, and what plays, are threads of their own.
        self._turn = threading.RLock()
        self._began = time.monotonic(), self._time
        self._gui = server.gui
        self._add_controls()
        self._go_to(self._time)
        self._follow()
        threading.Thread(target=self._play, daemon=True).start()

    # --- controls ---------------------------------------------------------------------------------------

    def _add_controls(self) -> None:
        gui = self._gui
        tabs = gui.add_tab_group()
        with tabs.add_tab("Fold"):
            self._add_time()
            if self._source.run is None:
                self._add_fold()
            if self._source.run is not None:
                self._latches = gui.add_html("")
            self._viewer.add_verdict()
        with tabs.add_tab("Section"):
            self._viewer.add_section()
        with tabs.add_tab("Plots"):
            self._add_plots()

    def _add_time(self) -> None:
        gui, timed = self._gui, self._source.plan is not None or self._source.run is not None
        self._play_button = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        self._play_button.on_click(lambda _: self._toggle())
        self._time_slider = gui.add_slider(
            "Time (s)", 0.0, max(round(self._time, 2), 0.01), 0.01, round(self._time, 2), visible=timed
        )
        self._stage = gui.add_text("Stage", self._timeline.stage[-1], disabled=True, visible=timed)

        @self._time_slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:  # a person, not the player
                self._by_hand(lambda: self._go_to(self._time_slider.value))

        if timed and len(self._goals) > 1:
            self._jump = gui.add_dropdown("Go to", tuple(self._goals))

            @self._jump.on_update
            def _(event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
                if event.client is not None:
                    self._by_hand(lambda: self._go_to(self._goals[event.target.value]))

        if self._source.plan is not None:
            gui.add_html(table_html(plan_rows(self._source.plan)))

    def _add_fold(self) -> None:
        gui = self._gui
        self._moves = gui.add_dropdown("Moves", (ALL_CELLS, *self._cell_ids), initial_value=ALL_CELLS)
        self._fold_slider = gui.add_slider("Fold", 0.0, 1.0, 0.001, 1.0)

        @self._moves.on_update
        def _(event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
            if event.client is not None:
                with self._turn:
                    self._follow()

        @self._fold_slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:
                self._by_hand(lambda: self._set_fold(self._fold_slider.value))

        self._span_slider = gui.add_slider(
            "Span folded", 0.0, 1.0, 0.01, 0.0, visible=self._source.design.span_segments > 1
        )

        @self._span_slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:
                self._by_hand(lambda: self._set_span(self._span_slider.value))

    def _add_plots(self) -> None:
        gui, mechanism = self._gui, self._viewer.mover.mechanism
        over_fold = self._source.plan is None and self._source.run is None

        def curves(cell: str) -> None:
            chart.show(crease_curves(mechanism, self._timeline, cell, over_fold=over_fold))

        which = gui.add_dropdown("Creases of", (ALL_CELLS, *self._cell_ids), initial_value=self._cell_ids[0])
        chart = Chart(self._server, crease_curves(mechanism, self._timeline, self._cell_ids[0], over_fold=over_fold))
        which.on_update(lambda _: curves(which.value))
        if self._source.run is not None:
            for more in flown_curves(self._source.run):
                Chart(self._server, more)

    # --- what they do -----------------------------------------------------------------------------------

    def _by_hand(self, change: Callable[[], None]) -> None:
        """Somebody moves a slider: what plays ends, and all the others follow."""
        with self._turn:
            self._pause()
            change()
            self._follow()

    def _set_fold(self, fold: float) -> None:
        """One cell or all; cells open only where the span is straight."""
        if self._moves.value == ALL_CELLS:
            self._fold[:] = fold
        else:
            self._fold[self._cell_ids.index(self._moves.value)] = fold
        if self._fold.max() > 0.0:
            self._span = 0.0
        self._show_by_hand()

    def _set_span(self, folded: float) -> None:
        """Only the flat stack folds across its span."""
        if folded > 0.0:
            self._fold[:] = 0.0
        self._span = folded
        self._show_by_hand()

    def _show_by_hand(self) -> None:
        """At the time at which this comes, where it does."""
        time_s = self._timeline.when(self._fold, self._span or 0.0)
        if time_s is not None:
            self._time = time_s
        _put(self._stage, BY_HAND if time_s is None else self._timeline.at(time_s).stage)
        self._show()

    def _go_to(self, time_s: float) -> None:
        pose = self._timeline.at(time_s)
        self._time, self._fold, self._span = time_s, pose.fold.copy(), pose.span_folded
        _put(self._stage, pose.stage)
        self._viewer.shown.latch(pose.latches)
        if self._latches is not None:
            put_html(self._latches, table_html([(point, NAMES[state]) for point, state in pose.latches.items()]))
        self._show()

    def _show(self) -> None:
        self._viewer.show(self._fold, self._span)

    def _toggle(self) -> None:
        with self._turn:
            if self._playing.is_set():
                self._pause()
                return
            if self._time >= self._timeline.duration_s:
                self._time = 0.0
            self._play_button.label = "Pause"
            self._began = time.monotonic(), self._time
            self._playing.set()

    def _pause(self) -> None:
        if self._playing.is_set():
            self._playing.clear()
            self._play_button.label = "Play"
            self._follow()

    def _follow(self) -> None:
        """Sliders show what is shown; that of all cells, the first one's fold."""
        _put(self._time_slider, round(self._time, 2))
        if self._jump is not None:
            _put(self._jump, max((begin, name) for name, begin in self._goals.items() if begin <= self._time)[1])
        if self._source.run is None:
            one = self._moves.value
            cell = 0 if one == ALL_CELLS else self._cell_ids.index(one)
            _put(self._fold_slider, round(float(self._fold[cell]), 3))
            _put(self._span_slider, round(self._span or 0.0, 2))

    def _play(self) -> None:
        """Frame after frame while it plays, dropping those that are late."""
        while True:
            self._playing.wait()
            due, frame = time.monotonic(), 0
            while self._frame(follow=frame % _SLIDER_EVERY == 0):
                frame += 1
                due = max(due + FRAME_S, time.monotonic() - FRAME_S)
                time.sleep(max(due - time.monotonic(), 0.001))

    def _frame(self, *, follow: bool) -> bool:
        """Show what is due, unless somebody has just ended it; whether there is more."""
        with self._turn:
            if not self._playing.is_set():
                return False
            begin, at = self._began
            now = at + time.monotonic() - begin
            self._go_to(min(now, self._timeline.duration_s))
            if now >= self._timeline.duration_s:
                self._pause()
            elif follow:
                self._follow()
            return self._playing.is_set()


def goals(timeline: Timeline) -> dict[str, float]:
    """When stages begin, by what they are called; the last one says how many are not told."""
    stages = timeline.stages
    made = {f"{k}. {one.name} {one.begin_s:.1f} s": one.begin_s for k, one in enumerate(stages[:_MOST_STAGES], 1)}
    if len(stages) > _MOST_STAGES:
        first = stages[_MOST_STAGES]
        made[f"{len(stages) - _MOST_STAGES} more, from {first.begin_s:.1f} s: by the time slider"] = first.begin_s
    return made


def _put(handle: Any, value: object) -> None:
    """Show a value in a control; nothing is sent where it is there already."""
    if handle.value != value:
        handle.value = value


def plan_rows(plan: Plan) -> list[tuple[str, str]]:
    """All stages of deploying with their times; latches take what they take."""
    told = {"open": f"{plan.duration_s:.2f} s", "latch": "until every latch confirms", "unlock": "first"}
    if plan.span is not None:
        told["span_unfold"] = f"{plan.span.duration_s:.2f} s, by hand"
    return [(f"{k}. {name.replace('_', ' ')}", told[name]) for k, name in enumerate(plan.deploy_stages, 1)]


def timeline_of(source: Source) -> Timeline:
    """When what is where."""
    layout = source.design.structure.layout
    if source.run is not None:
        return flown(source.run, layout.cell_ids)
    if source.plan is not None:
        return planned(source.plan)
    return preview(layout.n_cells, source.design.span_segments)
