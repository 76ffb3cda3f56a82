"""What the drawing of an unrolled strip shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Polygon

from ori_deploy.files import build_from_file
from ori_deploy.view.development import draw_development
from ori_deploy.view.sheet import to_svg

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("name", ["antenna_helix", "antenna_conical_spiral"])
def test_every_piece_and_every_line_is_drawn_true_to_scale(name: str) -> None:
    spec, structure = build_from_file(EXAMPLES / f"{name}.toml")
    cut = spec.structure
    assert spec.strip is not None
    strip = spec.strip.lay(structure, cut.r_min_m, cut.r_min_m + cut.span_m)
    figure = draw_development(strip, structure)
    (axes,) = figure.axes
    drawn = [p for p in axes.patches if isinstance(p, Polygon)]
    ids = structure.layout.panel_ids
    assert sorted(str(p.get_gid()) for p in drawn) == sorted(f"piece-{ids[p.panel]}-{p.turn}" for p in strip.pieces)
    areas = []
    for patch in drawn:
        x, y = patch.get_xy()[:-1].T
        areas.append(abs(0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum()) * 1e-6)
    assert sum(areas) == pytest.approx(strip.area_m2, rel=1e-3)
    lines = [str(line.get_gid()) for line in axes.lines]
    assert len(lines) == len(set(lines)) == len(strip.pieces) - 1
    for kind in ("fold", "part", "rigid"):
        crossings = sum(len(strip.crossings(j)) for j in strip.joints if j.kind == kind)
        assert sum(line.startswith(f"{kind}-") for line in lines) == crossings
    width, height = figure.get_size_inches() * [axes.get_position().width, axes.get_position().height]
    assert width / np.diff(axes.get_xlim())[0] == pytest.approx(height / np.diff(axes.get_ylim())[0], rel=1e-6)
    corners = np.concatenate([p.get_xy() for p in drawn])
    for limits, along in ((axes.get_xlim(), corners[:, 0]), (axes.get_ylim(), corners[:, 1])):
        assert limits[0] < along.min() < along.max() < limits[1]
    assert to_svg(figure) == to_svg(draw_development(strip, structure))
