"""What the figure of a span being stowed shows."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from ori_deploy.motion import Mechanism, SpanFolding
from ori_deploy.view import draw_spanwise, to_png
from ori_deploy.view.spanwise import FRAMES, _back_to_front, span_frames
from tests.shapes import structure


@pytest.fixture(scope="module")
def folding() -> SpanFolding:
    return SpanFolding(Mechanism(structure("ellipse 4")), 0.9, 3)


def test_every_pose_has_its_faces_and_its_hinges(folding: SpanFolding) -> None:
    figure = draw_spanwise(folding)
    gids = {str(a.get_gid()) for a in figure.axes[0].get_children() if a.get_gid()}
    assert {f"span{k}" for k in range(len(FRAMES))} <= gids
    assert {f"span{k}-h{h}" for k in range(len(FRAMES)) for h in (1, 2)} <= gids
    shown = " ".join(t.get_text() for t in figure.axes[0].texts)
    assert "deployed" in shown
    assert "stowed" in shown
    assert to_png(figure, 40.0).startswith(b"\x89PNG")


def test_all_frames_are_at_one_scale_and_begin_at_their_corner(folding: SpanFolding) -> None:
    frames = span_frames(folding)
    for frame in frames:
        every = np.concatenate(frame.faces)
        assert every.min(axis=0) == pytest.approx(0.0, abs=1e-9)
        assert every.max(axis=0) == pytest.approx(frame.size)
        assert len(frame.faces) == len(frame.panel) == len(frame.light)
    straight, stowed = frames[2], frames[-1]
    assert straight.size[0] > 1.5 * stowed.size[0]


def test_what_is_seen_is_what_is_in_front() -> None:
    """Three slats over each other, given in every order: the one nearest to the eye comes last."""
    span, eye = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.3])

    def slat(y: float, left: float, right: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        return np.array([[right, y, 0.0], [left, y, 0.0], [left, y, 1.0], [right, y, 1.0]])

    # A long face behind whose middle is nearer than a short one in front is at its own place.
    slats = [slat(0.0, -1.0, 1.0), slat(0.5, -0.2, 0.1), slat(1.0, -0.1, 0.6)]
    for order in ([0, 1, 2], [2, 1, 0], [1, 2, 0]):
        found = _back_to_front([slats[k] for k in order], span, eye)
        assert [order[k] for k in found] == [0, 1, 2]


def test_the_silhouette_of_the_stowed_pose_is_that_of_its_box(folding: SpanFolding) -> None:
    stowed = span_frames(folding, ((0.0, 1.0),))[0]
    seen = shapely.union_all([shapely.Polygon(face) for face in stowed.faces])
    length, across = folding.length_m, np.array(folding.stack.bounds)
    width, tall = across[1] - across[0], 3.0 * folding.stack.thickness_m
    eye = np.abs(np.array([1.0, 0.62, -0.42]) / np.linalg.norm([1.0, 0.62, -0.42]))
    box = 1e6 * (eye @ np.array([tall * length, width * length, width * tall]))
    assert 0.75 * box < shapely.area(shapely.convex_hull(seen)) <= box * (1.0 + 1e-9)
