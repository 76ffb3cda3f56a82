"""What is written on top of a figure leaves the rest as it was."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.figure import Figure

from ori_deploy.design import Structure
from ori_deploy.view import draw_section, draw_strip, to_png, to_svg
from ori_deploy.view.heatmap import draw_heatmap
from ori_deploy.view.sheet import add_head


@pytest.mark.parametrize("draw", [draw_section, draw_strip])
def test_a_head_makes_the_page_taller_and_moves_nothing(draw: object, wing: Structure) -> None:
    assert callable(draw)
    figure = draw(wing)
    figure.text(0.5, 0.9, "there before")

    def inches() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        size = np.tile(figure.get_size_inches(), 2)
        return np.array([[*(np.array(axes.get_position(original=True).extents) * size)] for axes in figure.axes])

    before, height, at = inches(), figure.get_figheight(), figure.texts[-1].get_position()[1]
    add_head(figure, "a line above")
    assert figure.get_figheight() > height
    assert inches() == pytest.approx(before)
    assert figure.texts[-2].get_position()[1] * figure.get_figheight() == pytest.approx(at * height)
    assert figure.texts[-1].get_position()[1] * figure.get_figheight() > height
    assert '<g id="head">' in to_svg(figure)


def test_a_head_goes_over_a_figure_that_lays_itself_out() -> None:
    figure = draw_heatmap([0.0, 1.0], [0.0, 1.0], [[0.0, 1.0], [2.0, 3.0]], x_label="", y_label="", value_label="")
    add_head(figure, "a line above")
    assert '<g id="head">' in to_svg(figure)
    head = next(text for text in figure.texts if text.get_text() == "a line above")
    assert head.get_window_extent().y0 > figure.axes[0].get_window_extent().y1


@pytest.mark.parametrize("write", [to_svg, to_png])
def test_letters_that_the_font_lacks_are_spelt(write: Callable[[Figure], object]) -> None:
    figure = Figure()
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], label="伺服_c1 α−°")
    axes.legend()
    figure.text(0.1, 0.1, "two\nlines\x07")
    long = figure.text(0.1, 0.5, "伺" * 20)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write(figure)
    assert axes.get_legend().get_texts()[0].get_text() == r"\u4f3a\u670d_c1 α−°"
    assert figure.texts[0].get_text() == "two\nlines\\x07"
    assert long.get_text() == (r"\u4f3a" * 5)[:29] + "…"
