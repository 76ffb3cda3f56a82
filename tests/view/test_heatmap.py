"""What a heatmap shows."""

from __future__ import annotations

import numpy as np
import pytest

from ori_deploy.design.continuum import superellipse_table
from ori_deploy.view.heatmap import draw_heatmap
from ori_deploy.view.sheet import to_png, to_svg

LABELS = {"x_label": "exponent m", "y_label": "aspect", "value_label": "eta per cell"}


def test_every_value_is_shown_at_its_place_with_its_scale() -> None:
    x, y = np.linspace(2.0, 8.0, 13), np.linspace(0.1, 1.0, 7)
    value = superellipse_table(y, x)
    figure = draw_heatmap(x, y, value, **LABELS, title="Fig. 4d")
    axes, bar = figure.axes
    (mesh,) = (c for c in axes.collections if type(c).__name__ == "QuadMesh")
    assert np.asarray(mesh.get_array()).reshape(value.shape) == pytest.approx(value)
    assert axes.get_xlim() == pytest.approx((2.0, 8.0))
    assert axes.get_ylim() == pytest.approx((0.1, 1.0))
    assert (axes.get_xlabel(), axes.get_ylabel(), bar.get_ylabel()) == tuple(LABELS.values())
    assert mesh.get_clim() == pytest.approx((value.min(), value.max()))
    assert axes.texts  # contours with their values
    assert to_svg(figure) == to_svg(draw_heatmap(x, y, value, **LABELS, title="Fig. 4d"))
    assert to_png(figure).startswith(b"\x89PNG")


@pytest.mark.parametrize("value", [np.zeros((3, 2)), np.full((2, 3), np.nan), np.zeros(6)])
def test_values_that_do_not_fit_are_refused(value: np.ndarray) -> None:
    with pytest.raises(ValueError, match="value"):
        draw_heatmap([0.0, 1.0, 2.0], [0.0, 1.0], value, **LABELS)


@pytest.mark.parametrize("shape", [(61, 46), (13, 10), (5, 4)])
def test_no_name_of_a_contour_is_cut_by_the_frame(shape: tuple[int, int]) -> None:
    x, y = np.linspace(2.0, 8.0, shape[0]), np.linspace(0.1, 1.0, shape[1])
    figure = draw_heatmap(x, y, superellipse_table(y, x), **LABELS)
    to_png(figure)  # lays it out
    axes = figure.axes[0]
    frame = axes.get_window_extent()
    assert len(axes.texts) >= 5
    for name in axes.texts:
        box = name.get_window_extent()
        assert frame.x0 <= box.x0 < box.x1 <= frame.x1
        assert frame.y0 <= box.y0 < box.y1 <= frame.y1
