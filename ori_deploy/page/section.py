"""The cross-section, or a cone's outer end, at the fold that is shown, with its dimensions, as a drawing."""

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
    """The outer end of every panel, seen along the axis: across a cylinder that is its cross-section.

    Attributes
    ----------
    outlines
        (n, 3) metres, one per panel: to the right, up, and towards the eye.
    whole
        (3,) the same three extents of all that there is of the panels, not of their outer ends alone.
    """

    outlines: tuple[Reals, ...]
    whole: Reals

    @property
    def low(self) -> Reals:
        """(3,) lower left corner, farthest from the eye, of the box round the outer ends."""
        return np.asarray(np.min([outline.min(axis=0) for outline in self.outlines], axis=0))

    @property
    def size(self) -> Reals:
        """(3,) width, height and depth of that box; a cylinder's end is flat and has no depth."""
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
    solids = [_moved(content, p, matrices[k]) for p, k in zip(content.panels, number, strict=True)]
    corners = np.concatenate(solids)
    return Section(tuple(np.split(solid, 2)[1] for solid in solids), np.ptp(corners, axis=0))


def _moved(content: Content, panel: Panel, matrix: Reals) -> Reals:
    """(n, 3) all corners of a panel, as they are seen along the axis."""
    return np.asarray((panel.solid.vertices @ matrix[:3, :3].T + matrix[:3, 3]) @ content.seen.T)


def sized(content: Content, section: Section) -> list[tuple[str, str]]:
    """What it measures, for the panel."""
    if not content.cone:
        wide, tall, _ = _MM * section.size
        which = "section here" if content.segments == 1 else "one segment here"
        return [(which, f"{wide:.1f} × {tall:.1f} mm")]
    boxes = {"outer end here": section.size, "all of it here": section.whole}
    return [(name, " × ".join(f"{_MM * side:.1f}" for side in box) + " mm") for name, box in boxes.items()] + [
        ("", "across × across × along the axis")
    ]


def draw(content: Content, section: Section, red: frozenset[str]) -> str:
    """An SVG to scale, the box round it measured in millimetres."""
    low, size = section.low[:2], section.size[:2]
    scale = min((_WIDTH - _LEFT - _RIGHT) / size[0], _TALLEST / size[1])
    wide, tall = size * scale
    height = tall + _TOP + _BOTTOM

    def at(point: Reals) -> str:
        x, y = (point[:2] - low) * scale
        return f"{_LEFT + x:.1f},{_TOP + tall - y:.1f}"

    shapes = []
    farthest_first = sorted(
        zip(content.panels, section.outlines, strict=True), key=lambda one: float(one[1][:, 2].mean())
    )
    for panel, outline in farthest_first:
        fill = SLIT if panel.id in red else "#{:02x}{:02x}{:02x}".format(*panel.colour)
        rim = "#{:02x}{:02x}{:02x}".format(*panel.rim_colour)
        points = " ".join(at(p) for p in outline)
        shapes.append(f'<polygon points="{points}" fill="{fill}" stroke="{rim}" stroke-width="0.5"/>')
    told = "outer end, seen along the axis" if content.cone else "cross-section"
    foot, left = _TOP + tall + 12.0, _LEFT - 12.0
    lines = (
        _dimension(_LEFT, foot, _LEFT + wide, foot, f"{_MM * size[0]:.1f} mm", upright=False),
        _dimension(left, _TOP, left, _TOP + tall, f"{_MM * size[1]:.1f} mm", upright=True),
    )
    return (
        f'<svg viewBox="0 0 {_WIDTH:.0f} {height:.0f}" width="100%" role="img" aria-label="{told}" '
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
