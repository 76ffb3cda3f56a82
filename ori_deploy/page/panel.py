"""Parts of the panel that every page has: what is the case at the pose shown, curves, a legend."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
import viser
import viser.uplot as uplot

from ori_deploy.page.content import CREASE_COLOURS, SLIT_COLOUR, Content, Rgb
from ori_deploy.page.curves import Curves
from ori_deploy.page.judging import Verdict
from ori_deploy.page.latches import NAMES
from ori_deploy.page.shown import LATCH_COLOURS
from ori_deploy.view.ink import FAINT, INK, SLIT

_MM = 1e3
_CHART_PX = 190
_FEW_NAMES = 8
"""Names in a legend; more would be longer than the chart."""

TOUCH_M = 5e-6
"""Nearer than this is told as touching: flat and deployed panels do by design."""

_BOX = f"font:13px/1.45 system-ui,sans-serif;color:{INK};padding:4px 14px"


def verdict_html(verdict: Verdict) -> str:
    """Interference with its depths, or how near panels are to each other."""
    if verdict.collisions:
        rows = "".join(
            f"<tr><td>{escape(a)}</td><td>{escape(b)}</td>"
            f'<td style="text-align:right">{_MM * one.depth_m:.2f} mm</td></tr>'
            for one in verdict.collisions
            for a, b in [one.panels]
        )
        if verdict.others:
            n = len(verdict.others)
            more = f"and {n} more pair{'s' if n > 1 else ''}, none deeper"
            rows += f'<tr><td colspan="3" style="color:{FAINT}">{more}</td></tr>'
        return (
            f'<div style="{_BOX}"><b style="color:{SLIT}">Panels reach into each other</b>'
            f'<table style="width:100%;border-collapse:collapse"><tr style="color:{FAINT};text-align:left">'
            f'<th>panel</th><th>in</th><th style="text-align:right">depth</th></tr>{rows}</table></div>'
        )
    if verdict.clearance_m is None:
        return f'<div style="{_BOX}">No interference of panels.</div>'
    a, b = verdict.clearance_panels
    if verdict.clearance_m < TOUCH_M:
        told = f"Panels lie against each other, as {escape(a)} and {escape(b)} do."
        return f'<div style="{_BOX}">No interference of panels. {told}</div>'
    return (
        f'<div style="{_BOX}">No interference of panels. Smallest clearance '
        f"<b>{_MM * verdict.clearance_m:.2f} mm</b>, {escape(a)} to {escape(b)}.</div>"
    )


def unmeasured_html() -> str:
    """In place of a verdict, where nobody knows the pose."""
    return f'<div style="{_BOX}"><b>Not measured.</b> What is drawn in grey may not be where it is.</div>'


def unjudged_html() -> str:
    """In place of a verdict, where there is none."""
    return f'<div style="{_BOX}">This pose could not be judged.</div>'


def span_html(verdict: Verdict, folded: float | None) -> str:
    """What is known of a span in segments, for which the cells' verdict does not speak."""
    if folded is None:
        return f'<div style="{_BOX}">Span: not measured, shown straight; its segments are not judged.</div>'
    if verdict.segments is not None:
        a, b = verdict.segments.segments
        told = f"Span segments {a + 1} and {b + 1} reach {_MM * verdict.segments.depth_m:.2f} mm into each other"
        return f'<div style="{_BOX}"><b style="color:{SLIT}">{told}</b></div>'
    if folded > 0.0:
        return f'<div style="{_BOX}">Span folded in step: its segments do not reach into each other.</div>'
    return ""


def put_html(handle: viser.GuiHtmlHandle, content: str) -> None:
    """Show it; nothing is sent where it is there already."""
    if handle.content != content:
        handle.content = content


def table_html(rows: Sequence[tuple[str, str]]) -> str:
    """Names and values."""
    told = "".join(
        f'<tr><td style="color:{FAINT};padding-right:12px;white-space:nowrap">{escape(name)}</td>'
        f'<td style="text-align:right">{escape(value)}</td></tr>'
        for name, value in rows
    )
    return f'<div style="{_BOX}"><table style="width:100%;border-collapse:collapse">{told}</table></div>'


def legend_html(content: Content) -> str:
    """What the colours mean."""
    bars: list[tuple[str, Rgb]] = [(f"{kind} crease", colour) for kind, colour in CREASE_COLOURS.items()]
    if content.slits:
        bars.append(("slit", SLIT_COLOUR))
    marks = [_mark(name, colour, "3px", "18px") for name, colour in bars]
    if content.latches:
        marks += [_mark(NAMES[state], colour, "9px", "9px") for state, colour in LATCH_COLOURS.items()]
    return f'<div style="{_BOX};display:flex;flex-wrap:wrap;gap:3px 14px">{"".join(marks)}</div>'


def _mark(name: str, colour: Rgb, height: str, width: str) -> str:
    paint = "rgb({},{},{})".format(*colour)
    round_ = "50%" if height == width else "1px"
    bar = f"display:inline-block;width:{width};height:{height};background:{paint};border-radius:{round_}"
    return f'<span style="display:inline-flex;align-items:center;gap:6px"><i style="{bar}"></i>{escape(name)}</span>'


class Chart:
    """One chart whose curves can be exchanged.

    Parameters
    ----------
    server, curves
        Where, and what at first.
    """

    def __init__(self, server: viser.ViserServer, curves: Curves) -> None:
        self._handle = server.gui.add_uplot(
            data_of(curves),
            _series(curves),
            title=curves.title,
            scales={"x": {"time": False}, "y": {"auto": True}},
            axes=({"label": curves.across, "labelSize": 16, "size": 34}, {"size": 44}),
            legend={"show": len(curves.names) <= _FEW_NAMES},
            height=_CHART_PX,
            padding=(8, 24, 0, 0),
        )

    def show(self, curves: Curves) -> None:
        """Other curves, or more of the same."""
        self._handle.title = curves.title
        self._handle.series = _series(curves)
        self._handle.data = data_of(curves)

    def go_on(self, curves: Curves) -> None:
        """More of the same: only numbers are sent."""
        self._handle.data = data_of(curves)


def data_of(curves: Curves) -> tuple[np.ndarray, ...]:
    """As a chart wants it."""
    return tuple(np.array(row, dtype=float) for row in (curves.x, *curves.y))  # in a piece each, as they are sent


def _series(curves: Curves) -> tuple[uplot.Series, ...]:
    lines = [
        uplot.Series(label=name, stroke=colour, width=1.6)
        for name, colour in zip(curves.names, curves.colours, strict=True)
    ]
    return (uplot.Series(label=curves.across), *lines)
