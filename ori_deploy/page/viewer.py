"""A structure on a page: shown at a pose, judged there, its section drawn."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from ori_deploy.files import Design
from ori_deploy.page.content import Content, content_of
from ori_deploy.page.judging import Judge, Verdict
from ori_deploy.page.newest import Newest
from ori_deploy.page.panel import (
    legend_html,
    put_html,
    span_html,
    table_html,
    unjudged_html,
    unmeasured_html,
    verdict_html,
)
from ori_deploy.page.placing import Mover
from ori_deploy.page.section import draw, section_of, sized
from ori_deploy.page.shown import Shown
from ori_deploy.profiles.profile import Reals

_MM = 1e3
_JUDGED_EVERY_S = 0.15
"""A person reads no faster, and what is told must not slow what moves."""

_PORTRAIT = 0.8
"""Width over height of a view below which the panel lies over its lower half."""

_EYE = np.array([-0.55, 0.5, 1.0])
"""Direction from the structure to the eye at first: from before and above, along the span."""
_DISTANCE = 0.72
"""Of the eye, in diagonals of the box round the motion."""


class Viewer:
    """What all pages share.

    Parameters
    ----------
    server
        Where.
    design
        What.
    on_verdict
        Called with every judgement, from the thread that judges; with None where there is none any more.
    """

    def __init__(
        self, server: viser.ViserServer, design: Design, on_verdict: Callable[[Verdict | None], None] | None = None
    ) -> None:
        self.server, self.design = server, design
        self.content = content_of(design)
        self.mover = Mover(design)
        self.shown = Shown(server, self.content, self.mover)
        self._judge = Judge(self.mover.mechanism, self.mover.span)
        self._on_verdict = on_verdict
        self._numbers = [design.structure.layout.panel_ids.index(panel.id) for panel in self.content.panels]
        self._verdict: viser.GuiHtmlHandle | None = None
        self._section: viser.GuiHtmlHandle | None = None
        self._sized: viser.GuiHtmlHandle | None = None
        self._judging: Newest[tuple[Reals, float | None] | None] = Newest(self._judged, _JUDGED_EVERY_S)
        self._look()

    def _look(self) -> None:
        """Put each browser's eye where the whole motion is in view, from a little above and off the span's end."""
        eye, middle = eye_of(self.mover, self.content)
        camera = self.server.initial_camera
        camera.look_at, camera.position, camera.up = tuple(middle), tuple(eye), (0.0, 1.0, 0.0)

        @self.server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            if client.camera.aspect < _PORTRAIT:
                down = middle - np.array([0.0, 0.45 * float(np.linalg.norm(eye - middle)), 0.0])
                client.camera.position = tuple(down + 1.85 * (eye - middle))
                client.camera.look_at = tuple(down)

    # --- what is in the panel ---------------------------------------------------------------------------

    def add_verdict(self) -> None:
        """Interference and clearance, and the legend, here in the panel."""
        self._verdict = self.server.gui.add_html("")
        self.server.gui.add_html(legend_html(self.content))

    def add_section(self) -> None:
        """The cross-section with its dimensions, here in the panel."""
        self._section = self.server.gui.add_html("")
        self._sized = self.server.gui.add_html("")
        self.server.gui.add_html(table_html(dimensions(self.design)))

    # --- poses ------------------------------------------------------------------------------------------

    def show(self, fold: Reals, span_folded: float | None = None, *, measured: bool = True) -> None:
        """Show a pose; what there is to say about it follows as fast as it can be found out.

        Parameters
        ----------
        fold
            (n_cells,).
        span_folded
            From 0, straight, to 1; None where nobody knows: it is shown straight, and the page says so.
        measured
            Whether it is where this says.
        """
        self.shown.pose(fold, span_folded or 0.0)
        if measured:
            self._judging.give((np.array(fold), span_folded))
        else:
            self.lose()

    def lose(self) -> None:
        """Nobody knows any more where it is: what is shown stays, in grey, and nothing is said about it."""
        self._judging.give(None)  # by way of the judging: a verdict that is being made must not come after it

    def _judged(self, pose: tuple[Reals, float | None] | None) -> None:
        if pose is None:
            self.shown.grey()
            self._say_nothing(unmeasured_html())
            return
        try:
            self._say(*pose)
        except Exception:
            self._say_nothing(unjudged_html())  # what was said before is of another pose
            self.shown.redden(frozenset())
            raise

    def _say_nothing(self, why: str) -> None:
        """In place of a verdict."""
        if self._on_verdict is not None:
            self._on_verdict(None)
        for handle, content in ((self._verdict, why), (self._section, why), (self._sized, "")):
            if handle is not None:
                put_html(handle, content)

    def _say(self, fold: Reals, span_folded: float | None) -> None:
        verdict = self._judge.judge(fold, span_folded or 0.0)
        if self._on_verdict is not None:
            self._on_verdict(verdict)
        self.shown.redden(verdict.red)
        if self._verdict is not None:
            cut = self.design.span_segments > 1
            put_html(self._verdict, verdict_html(verdict) + (span_html(verdict, span_folded) if cut else ""))
        if self._section is not None and self._sized is not None:
            section = section_of(self.content, self.mover.panels(fold), self._numbers)
            put_html(self._section, f'<div style="padding:6px 10px">{draw(self.content, section, verdict.red)}</div>')
            put_html(self._sized, table_html(sized(self.content, section)))


def dimensions(design: Design) -> list[tuple[str, str]]:
    """What a design measures, deployed and stowed."""
    structure, data = design.structure, design.entries.packaging()
    outline = np.concatenate([o.ravel() for o in design.structure.panel_outlines()]) if design.r_min_m == 0 else None
    rows = [("cells, panels", f"{structure.layout.n_cells}, {structure.layout.n_panels}")]
    if outline is not None and np.iscomplexobj(outline):
        size = _MM * np.array([np.ptp(outline.real), np.ptp(outline.imag)])
        rows.append(("deployed section", f"{size[0]:.1f} × {size[1]:.1f} mm"))
    lengths = design.entries.lengths()
    rows.append(("wall", f"{_MM * float(lengths['wall_m']):.2f} mm"))
    pieces = f" in {design.span_segments} segments" if design.span_segments > 1 else ""
    rows.append(("span", f"{_MM * design.span_m:.0f} mm{pieces}"))
    box = " × ".join(f"{_MM * side:.1f}" for side in data["stack_box_m"])
    rows.append(("stowed, round the stack", f"{box} mm"))
    rows.append(("eta, area over material", f"{data['eta']:.3f}"))
    return rows


def eye_of(mover: Mover, content: Content) -> tuple[Reals, Reals]:
    """Where the eye is at first, and the place that it looks at: the middle of all that the motion passes through."""
    solids = [panel.solid.vertices for panel in content.panels]
    numbers = [mover.mechanism.layout.panel_ids.index(panel.id) for panel in content.panels]
    seen: list[Reals] = []
    for fold in (0.0, 0.5, 1.0):
        matrices = mover.panels(np.full(mover.mechanism.n_cells, fold)).matrices()[numbers]
        seen += [corners @ m[:3, :3].T + m[:3, 3] for corners, m in zip(solids, matrices, strict=True)]
    points = np.concatenate(seen)
    low = points.min(axis=0)
    high = points.max(axis=0) + np.array([0.0, 0.0, (content.segments - 1) * content.segment_m])
    middle = 0.5 * (low + high)
    away = _EYE / np.linalg.norm(_EYE)
    return middle + _DISTANCE * float(np.linalg.norm(high - low)) * away, middle
