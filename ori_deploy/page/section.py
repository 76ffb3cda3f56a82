"""The cross-section at the fold that is shown, with its dimensions, as a drawing for the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ori_deploy.page.content import Content, Panel
from ori_deploy.page.placing import Places
from ori_deploy.profiles.profile import Reals
from ori_deploy.view.ink import FAINT, INK, SLIT

_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM = 360.0, 46.0, 8.0, 8.0, 34.0
_TALLEST = 260.0
_MM = 1e3


@dataclass(frozen=True)
class Section:
    """The outer end of every panel on the plane of x and y.

    Attributes
    ----------
    outlines
        (n, 2) metres, one per panel.
    """

    outlines: tuple[Reals, ...]

    @property
    def low(self) -> Reals:
        """(2,) lower left corner of the box round them."""
        return np.asarray(np.min([outline.min(axis=0) for outline in self.outlines], axis=0))

    @property
    def size(self) -> Reals:
        """(2,) width and height of that box."""
        return np.asarray(np.max([outline.max(axis=0) for outline in self.outlines], axis=0) - self.low)


def section_of(content: Content, places: Places, number: Sequence[int]) -> Section:
    """The cross-section at a pose.

    Parameters
    ----------
    places
        Of all panels.
    number
        Of each panel of the content among them.
    """
    matrices = places.matrices()
    return Section(tuple(_moved(p, matrices[k]) for p, k in zip(content.panels, number, strict=True)))


def _moved(panel: Panel, matrix: Reals) -> Reals:
    outer = np.split(panel.solid.vertices, 2)[1]
    return np.asarray((outer @ matrix[:3, :3].T + matrix[:3, 3])[:, :2])


def draw(content: Content, section: Section, red: frozenset[str]) -> str:
    """An SVG to scale, the box round it measured in millimetres."""
    low, size = section.low, section.size
    scale = min((_WIDTH - _LEFT - _RIGHT) / size[0], _TALLEST / size[1])
    wide, tall = size * scale
    height = tall + _TOP + _BOTTOM

    def at(point: Reals) -> str:
        x, y = (point - low) * scale
        return f"{_LEFT + x:.1f},{_TOP + tall - y:.1f}"

    shapes = []
    for panel, outline in zip(content.panels, section.outlines, strict=True):
        fill = SLIT if panel.id in red else "#{:02x}{:02x}{:02x}".format(*panel.colour)
        rim = "#{:02x}{:02x}{:02x}".format(*panel.rim_colour)
        points = " ".join(at(p) for p in outline)
        shapes.append(f'<polygon points="{points}" fill="{fill}" stroke="{rim}" stroke-width="0.5"/>')
    foot, left = _TOP + tall + 12.0, _LEFT - 12.0
    lines = (
        _dimension(_LEFT, foot, _LEFT + wide, foot, f"{_MM * size[0]:.1f} mm", upright=False),
        _dimension(left, _TOP, left, _TOP + tall, f"{_MM * size[1]:.1f} mm", upright=True),
    )
    return (
        f'<svg viewBox="0 0 {_WIDTH:.0f} {height:.0f}" width="100%" role="img" aria-label="cross-section" '
        f'style="display:block;max-height:{_TALLEST + 60:.0f}px">{"".join(shapes)}{"".join(lines)}</svg>'
    )


def _dimension(x0: float, y0: float, x1: float, y1: float, told: str, *, upright: bool) -> str:
    """A line with a stroke across either end, and how long it is."""
    across = (4.0, 0.0) if upright else (0.0, 4.0)
    strokes = [(x0, y0, x1, y1)]
    strokes += [(x - across[0], y - across[1], x + across[0], y + across[1]) for x, y in ((x0, y0), (x1, y1))]
    drawn = "".join(f'<path d="M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" stroke="{FAINT}"/>' for a, b, c, d in strokes)
    x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    turn = f' transform="rotate(-90 {x - 10:.1f} {y:.1f})"' if upright else ""
    place = f'x="{x - 10:.1f}" y="{y:.1f}"' if upright else f'x="{x:.1f}" y="{y + 15:.1f}"'
    style = f'font-size="11" font-family="sans-serif" text-anchor="middle" fill="{INK}"'
    return f"{drawn}<text {place} {style}{turn}>{told}</text>"
