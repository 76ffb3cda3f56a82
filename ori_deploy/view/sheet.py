"""Figures as SVG and PNG: the same bytes for the same figure, on every run."""

from __future__ import annotations

import io
import re
from typing import Any

from markupsafe import Markup, escape
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.text import Text

from ori_deploy.view.ink import house_style

_COMMENT = re.compile(r"<!--.*?-->\s*", re.DOTALL)
_ID = re.compile(r'(?<= id=")|(?<=href="#)|(?<=url\(#)')
_NAMESPACE = re.compile(r'\s+xmlns(?::\w+)?="[^"]*"')  # HTML knows what an svg element is
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)


_HEAD: dict[str, Any] = {"fontsize": 9.5, "fontweight": "bold"}
_HEAD_IN = 0.32
"""Height of the line that `add_head` puts on top."""


def add_head(figure: Figure, text: str) -> None:
    """Put a line on top of a figure: the page grows by it, and all that is drawn keeps its size."""
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _HEAD_IN)
    with house_style():
        if figure.get_layout_engine() is not None:
            figure.suptitle(text, x=0.02, ha="left", gid="head", **_HEAD)
            return
        share = height / (height + _HEAD_IN)
        for axes in figure.axes:
            x, y, wide, tall = axes.get_position(original=True).bounds
            axes.set_position((x, y * share, wide, tall * share))
        for words in figure.texts:
            words.set_y(words.get_position()[1] * share)
        figure.text(0.02, 0.5 * (1.0 + share), text, va="center", gid="head", **_HEAD)


_SPELT = 30
"""Characters that spelling may make a text long: what was drawn round it left room for as many."""


def _spell(figure: Figure) -> None:
    """Write out by its number what the font has no letter for: names come from files, and an empty box is none."""
    for text in figure.findobj(Text):
        font, words = get_font(findfont(text.get_fontproperties())), text.get_text()
        spelt = "".join(c if c == "\n" or font.get_char_index(ord(c)) else ascii(c)[1:-1] for c in words)
        if spelt != words:
            most = max(len(words), _SPELT)
            text.set_text(spelt if len(spelt) <= most else spelt[: most - 1] + "…")


def to_svg(figure: Figure) -> str:
    """A whole SVG document."""
    out = io.StringIO()
    _spell(figure)
    with house_style():
        FigureCanvasSVG(figure).print_figure(out, format="svg", metadata={"Date": None, "Creator": None})
    return _COMMENT.sub("", out.getvalue())


def to_inline_svg(figure: Figure, prefix: str, label: str) -> Markup:
    """An `<svg>` element for a page that may hold several.

    Parameters
    ----------
    prefix
        Put before every id, so that those of two figures on one page differ.
    label
        What the figure shows, for those who can't see it.
    """
    element = to_svg(figure)
    element = _METADATA.sub("", element[element.index("<svg") :])
    element = _NAMESPACE.sub("", _ID.sub(f"{prefix}-", element))
    width = figure.get_figwidth() * 96.0
    head = f'<svg role="img" aria-label="{escape(label)}" style="max-width:{1.25 * width:.0f}px" '
    return Markup(element.replace("<svg ", head, 1))  # our own drawing: matplotlib escapes what it writes


def to_png(figure: Figure, dpi: float = 160.0) -> bytes:
    """A whole PNG file.

    Parameters
    ----------
    dpi
        Dots per inch; figures are about 9.5 inches wide.
    """
    out = io.BytesIO()
    _spell(figure)
    with house_style():
        FigureCanvasAgg(figure).print_figure(out, format="png", dpi=dpi, metadata={"Software": None})
    return out.getvalue()
