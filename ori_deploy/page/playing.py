"""Pages of a design, a plan or a flight log: sliders, stages, play."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import viser

from ori_deploy.motion import Plan
from ori_deploy.page.curves import ALL_CELLS, crease_curves, flown_curves
from ori_deploy.page.panel import Chart, table_html
from ori_deploy.page.sources import Source
from ori_deploy.page.timeline import Timeline, flown, planned, preview
from ori_deploy.page.viewer import Viewer

FRAME_S = 1.0 / 30.0
_SLIDER_EVERY = 3
"""Frames between two updates of the time slider while it plays."""


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
        self._fold = np.ones(len(self._cell_ids))
        self._span = 0.0
        self._time = self._timeline.duration_s
        self._playing = threading.Event()
        self._gui = server.gui
        self._add_controls()
        self._show()
        threading.Thread(target=self._play, daemon=True).start()

    # --- controls ---------------------------------------------------------------------------------------

    def _add_controls(self) -> None:
        gui = self._gui
        tabs = gui.add_tab_group()
        with tabs.add_tab("Fold"):
            self._add_time()
            if self._source.run is None:
                self._add_fold()
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
            "Time (s)", 0.0, max(self._timeline.duration_s, 0.01), 0.01, self._time, visible=timed
        )
        self._stage = gui.add_text("Stage", self._timeline.stage[-1], disabled=True, visible=timed)

        @self._time_slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:  # a person, not the player
                self._pause()
                self._go_to(self._time_slider.value)

        stages = self._timeline.stages
        if timed and len(stages) > 1:
            told = {f"{stage.name} {stage.begin_s:.1f} s": stage.begin_s for stage in stages[:24]}
            jump = gui.add_dropdown("Go to", tuple(told))

            @jump.on_update
            def _(event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
                if event.client is not None:
                    self._pause()
                    self._go_to(told[jump.value])
                    self._follow()

        if self._source.plan is not None:
            gui.add_html(table_html(plan_rows(self._source.plan)))

    def _add_fold(self) -> None:
        gui = self._gui
        self._moves = gui.add_dropdown("Moves", (ALL_CELLS, *self._cell_ids), initial_value=ALL_CELLS)
        self._fold_slider = gui.add_slider("Fold", 0.0, 1.0, 0.001, 1.0)

        @self._moves.on_update
        def _(event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
            if event.client is not None and self._moves.value != ALL_CELLS:
                _put(self._fold_slider, float(self._fold[self._cell_ids.index(self._moves.value)]))

        @self._fold_slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:
                self._pause()
                self._set_fold(self._fold_slider.value)

        self._span_slider = gui.add_slider(
            "Span folded", 0.0, 1.0, 0.01, 0.0, visible=self._source.design.span_segments > 1
        )

        @self._span_slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:
                self._pause()
                self._set_span(self._span_slider.value)

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

    def _set_fold(self, fold: float) -> None:
        """One cell or all; cells open only where the span is straight."""
        if self._moves.value == ALL_CELLS:
            self._fold[:] = fold
        else:
            self._fold[self._cell_ids.index(self._moves.value)] = fold
        if self._fold.max() > 0.0:
            self._straighten(0.0)
        self._show()

    def _set_span(self, folded: float) -> None:
        """Only the flat stack folds across its span."""
        if folded > 0.0:
            self._fold[:] = 0.0
            _put(self._fold_slider, 0.0)
        self._straighten(folded)
        self._show()

    def _straighten(self, folded: float) -> None:
        self._span = folded
        _put(self._span_slider, folded)

    def _go_to(self, time_s: float) -> None:
        pose = self._timeline.at(time_s)
        self._time, self._fold, self._span = time_s, pose.fold.copy(), pose.span_folded
        _put(self._stage, pose.stage)
        self._show()

    def _show(self) -> None:
        self._viewer.show(self._fold, self._span)

    def _toggle(self) -> None:
        if self._playing.is_set():
            self._pause()
            return
        if self._time >= self._timeline.duration_s:
            self._time = 0.0
        self._play_button.label = "Pause"
        self._playing.set()

    def _pause(self) -> None:
        if self._playing.is_set():
            self._playing.clear()
            self._play_button.label = "Play"
            self._follow()

    def _follow(self) -> None:
        """Sliders show what is shown."""
        _put(self._time_slider, round(self._time, 2))
        if self._source.run is None:
            _put(self._fold_slider, round(float(self._fold[0]), 3))
            _put(self._span_slider, round(self._span, 2))

    def _play(self) -> None:
        """Frame after frame while it plays, dropping those that are late."""
        while True:
            self._playing.wait()
            begin, at, frame = time.monotonic(), self._time, 0
            while self._playing.is_set():
                now = at + time.monotonic() - begin
                self._go_to(min(now, self._timeline.duration_s))
                if now >= self._timeline.duration_s:
                    self._pause()
                    break
                frame += 1
                if frame % _SLIDER_EVERY == 0:
                    self._follow()
                due = begin + frame * FRAME_S
                time.sleep(max(due - time.monotonic(), 0.001))


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
