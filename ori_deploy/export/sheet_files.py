"""Sheets of film as DXF and SVG, true to size: millimetres, what is cut, folded and glued in layers of their own."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from ori_deploy.export.kernel import need
from ori_deploy.export.sheets import Ring, Sheet
from ori_deploy.profiles.profile import Reals

CUT, FOLD, GLUE, LABEL = "CUT", "FOLD", "GLUE", "LABEL"
LAYERS = {CUT: 1, FOLD: 5, GLUE: 3, LABEL: 7}
"""Layers, and their colours by number: red, blue, green, black."""

MM = 1e3

_COLOURS = {CUT: "#d00000", FOLD: "#0040d0", GLUE: "#20a040", LABEL: "#000000"}
_MARGIN_MM = 5.0
_TEXT_MM = 3.0


def dxf_bytes(sheet: Sheet) -> bytes:
    """A DXF file (R2000).

    Raises
    ------
    InputError
        The extra `export` is not installed.
    """
    ezdxf: Any = need("ezdxf", "export")
    drawing = ezdxf.new("R2000", setup=["linetypes"])
    drawing.units = ezdxf.units.MM
    for name, colour in LAYERS.items():
        drawing.layers.add(name, color=colour, linetype="DASHED" if name == FOLD else "CONTINUOUS")
    space = drawing.modelspace()
    for layer, ring in ((CUT, sheet.cut), *((GLUE, zone.ring) for zone in sheet.glue)):
        corners = np.column_stack([MM * ring.corners, ring.bulge])
        space.add_lwpolyline(corners.tolist(), format="xyb", close=True, dxfattribs={"layer": layer})
    start, stop = (MM * sheet.fold).tolist()
    space.add_line(start, stop, dxfattribs={"layer": FOLD})
    for text, place, height in _labels(sheet):
        made = space.add_text(text, height=height, dxfattribs={"layer": LABEL})
        made.set_placement(place, align=ezdxf.enums.TextEntityAlignment.MIDDLE_CENTER)
    out = io.StringIO()
    drawing.write(out)
    return out.getvalue().encode(drawing.output_encoding)


def svg_text(sheet: Sheet) -> str:
    """An SVG file; its own unit is the millimetre."""
    points = np.vstack([MM * _drawn(sheet.cut), MM * sheet.fold])
    low, high = points.min(axis=0) - _MARGIN_MM, points.max(axis=0) + _MARGIN_MM
    width, height = high - low
    x, y = low[0], -high[1]
    fold = " ".join(
        f'{k}="{_n(v)}"' for k, v in zip(("x1", "y1", "x2", "y2"), _down(sheet.fold).ravel(), strict=True)
    )
    groups = {
        GLUE: [f'<path d="{_path(zone.ring)}"/>' for zone in sheet.glue],
        FOLD: [f"<line {fold}/>"],
        CUT: [f'<path d="{_path(sheet.cut)}"/>'],
        LABEL: [
            f'<text x="{_n(px)}" y="{_n(-py)}" font-size="{_n(size)}">{escape(text)}</text>'
            for text, (px, py), size in _labels(sheet)
        ],
    }
    body = "\n".join(
        f'<g id="{name.lower()}" {_STYLES[name]}>\n' + "\n".join(f"  {each}" for each in made) + "\n</g>"
        for name, made in groups.items()
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_n(width)}mm" height="{_n(height)}mm" '
        f'viewBox="{_n(x)} {_n(y)} {_n(width)} {_n(height)}">\n'
        f"<title>{escape(sheet.id)}</title>\n{body}\n</svg>\n"
    )


_LINE = 'fill="none" stroke-width="0.1" stroke='
_STYLES = {
    CUT: _LINE + quoteattr(_COLOURS[CUT]),
    FOLD: _LINE + quoteattr(_COLOURS[FOLD]) + ' stroke-dasharray="2 1"',
    GLUE: f'fill="{_COLOURS[GLUE]}" fill-opacity="0.15" stroke-width="0.1" stroke="{_COLOURS[GLUE]}"',
    LABEL: f'fill="{_COLOURS[LABEL]}" font-family="sans-serif" text-anchor="middle" dominant-baseline="central"',
}


def _labels(sheet: Sheet) -> Iterator[tuple[str, tuple[float, float], float]]:
    """Text, its middle and its height, millimetres: in every glue zone its panel, in the first the crease, too."""
    for k, zone in enumerate(sheet.glue):
        words = f"{sheet.id}, glue to {zone.panel}" if k == 0 else f"glue to {zone.panel}"
        drawn = MM * _drawn(zone.ring)
        length = float(np.ptp(drawn[:, 0]))
        x = float(drawn[:, 0].min()) + (0.5 if len(zone.ring.corners) == 4 else 0.7) * length  # triangles taper
        low, high = _across(drawn, x)
        height = min(_TEXT_MM, 0.6 * (high - low), length / len(words))
        yield words, (x, 0.5 * (low + high)), height


def _across(drawn: Reals, x: float) -> tuple[float, float]:
    """Where a vertical line enters and leaves a polygon."""
    a, b = drawn, np.roll(drawn, -1, axis=0)
    crossing = (a[:, 0] - x) * (b[:, 0] - x) < 0.0
    a, b = a[crossing], b[crossing]
    y = a[:, 1] + (x - a[:, 0]) / (b[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    return float(y.min()), float(y.max())


def _drawn(ring: Ring, pieces: int = 32) -> Reals:
    """(n, 2) corners of a polygon along a ring, arcs in pieces; metres."""
    drawn = []
    for p, q, bulge in zip(ring.corners, np.roll(ring.corners, -1, axis=0), ring.bulge, strict=True):
        if bulge == 0.0:
            drawn.append(p[None])
            continue
        middle, half = 0.5 * (p + q), 0.5 * (q - p)
        left = np.array([-half[1], half[0]])
        centre = middle + left * (1.0 - bulge**2) / (2.0 * bulge)
        turn = 4.0 * np.arctan(bulge) * np.linspace(0.0, 1.0, pieces, endpoint=False)[:, None]
        spoke = p - centre
        drawn.append(centre + np.cos(turn) * spoke + np.sin(turn) * np.array([-spoke[1], spoke[0]]))
    return np.concatenate(drawn)


def _path(ring: Ring) -> str:
    """A ring as an SVG path, its arcs as arcs."""
    corners = _down(ring.corners)
    words = [f"M {_n(corners[0, 0])} {_n(corners[0, 1])}"]
    for end, chord, bulge in zip(
        np.roll(corners, -1, axis=0), np.roll(corners, -1, axis=0) - corners, ring.bulge, strict=True
    ):
        radius = _n(np.hypot(*chord) * (1.0 + bulge**2) / (4.0 * abs(bulge))) if bulge else ""
        # Seen with y downwards what bends to the left sweeps against the clock: flag 0.
        arc = f"A {radius} {radius} 0 {int(abs(bulge) > 1.0)} {int(bulge < 0.0)}"
        words.append(f"{arc if bulge else 'L'} {_n(end[0])} {_n(end[1])}")
    return " ".join([*words, "Z"])


def _down(points: Reals) -> Reals:
    """Metres as SVG has them: millimetres, y downwards."""
    return points * [MM, -MM]


def _n(value: float) -> str:
    return f"{float(value):.6g}"
