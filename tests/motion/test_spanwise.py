"""A span in segments: hinges, poses in space, interference between segments, timing."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ori_deploy.design import Structure, build
from ori_deploy.errors import MotionError
from ori_deploy.motion import Mechanism, SpanFolding, plan_span, span_limits
from ori_deploy.motion.spanwise import MOST_SEGMENTS, ORDERS, order_of_hinges
from ori_deploy.motion.spanwise_contact import SegmentChain
from ori_deploy.motion.spanwise_plan import half_turn
from ori_deploy.profiles import PointOutline
from tests.shapes import CATALOGUE, laid_out, structure

Reals = NDArray[np.float64]

WITH_SLITS = [name for name in CATALOGUE if name not in ("one cell", "two cells")]


@cache
def folding(name: str = "wing", segments: int = 3, span_m: float = 5.0) -> SpanFolding:
    return SpanFolding(Mechanism(structure(name)), span_m, segments)


# --- the stack and its hinges -------------------------------------------------------------------------


@pytest.mark.parametrize("name", WITH_SLITS)
@pytest.mark.parametrize("segments", [2, 3, 4])
def test_every_layout_with_a_slit_folds_to_a_part_of_its_span(name: str, segments: int) -> None:
    cut = folding(name, segments)
    thickness = cut.stack.thickness_m
    bounds = np.array(cut.stack.bounds)
    assert cut.stowed_box_m[2] == pytest.approx(5.0 / segments)
    across = sorted([bounds[1] - bounds[0], segments * thickness])
    assert np.prod(cut.stowed_box_m[:2]) <= np.prod(across) * (1.0 + 1e-12)
    assert sorted(cut.stowed_box_m[:2]) == pytest.approx(across, rel=1e-6)  # as a plate: no turned box is smaller
    layout = cut.mechanism.layout
    for hinge in cut.hinges:
        assert layout.is_slit[layout.panel_ids.index(hinge.panel)]
    assert len({hinge.side for hinge in cut.hinges[:2]}) == min(2, segments - 1)


@pytest.mark.parametrize("name", ["wing", "ellipse 7 off centre", "two inner vertices", "peanut 8"])
def test_hinges_lie_on_the_outermost_planes_and_nothing_reaches_over_them(name: str) -> None:
    cut = folding(name)
    flat = cut.mechanism.poses(0.0).matrices()[0]
    size = cut.mechanism.size_m
    points = np.concatenate(
        [
            np.column_stack([o.real, o.imag]) @ flat[p, :2, :2].T + flat[p, :2, 2]
            for p, o in enumerate(structure(name).panel_outlines(1e-7 * size))
        ]
    )
    for hinge, outward in zip(cut.hinges, (1.0, -1.0), strict=True):
        normal = outward * np.array([-hinge.axis[1], hinge.axis[0]])
        above = (points - hinge.point[:2]) @ normal
        assert above.max() == pytest.approx(0.0, abs=1e-9 * size)
        assert hinge.point[2] == pytest.approx(5.0 / 3.0 * (1 if hinge.id == "h1" else 2))


def test_the_line_on_the_panel_is_the_hinge_once_the_cells_are_flat() -> None:
    cut = folding()
    flat = cut.poses([0.0], [[0.0, 0.0]])[0]
    for k, hinge in enumerate(cut.hinges):
        panel = cut.mechanism.layout.panel_ids.index(hinge.panel)
        for segment in (k, k + 1):
            ends = hinge.line_m @ flat[segment, panel, :3, :3].T + flat[segment, panel, :3, 3]
            assert ends.mean(axis=0) == pytest.approx(hinge.point, abs=1e-12)
            assert np.diff(ends, axis=0)[0] == pytest.approx(hinge.length_m * hinge.axis, abs=1e-9)


@pytest.mark.parametrize("name", ["one cell", "two cells"])
@pytest.mark.parametrize("segments", [2, 3])
def test_a_stack_that_ends_in_bulges_is_refused_with_the_panel(name: str, segments: int) -> None:
    with pytest.raises(MotionError, match=r"face of the folded stack is not flat, panel c\d\.\w+ bulges") as refused:
        _ = folding(name, segments).hinges
    assert refused.value.remedy is not None


def flat_sided_cell() -> Structure:
    """One cell whose panels have straight sides for an outline: no slit, and still flat outermost faces."""
    outline = np.array([[0.0, -0.4], [1.0, 0.0], [0.0, 0.4], [-1.0, 0.0]])
    p = PointOutline(outline, 1.0, smooth=False)
    corner = {k: p.at_arc(k / 4) for k in range(4)}
    places = {"C1": corner[1], "O1": corner[2], "C2": corner[3], "O2": corner[0]}
    return build(laid_out(p, [("C1", "O1", "C2", "O2")], places, {}, []), 0.02)


def test_faces_are_found_by_geometry_not_by_name() -> None:
    cut = SpanFolding(Mechanism(flat_sided_cell()), 3.0, 3)
    assert [hinge.side for hinge in cut.hinges] == ["upper", "lower"]
    assert cut.hinges[0].length_m == pytest.approx(np.hypot(1.0, 0.4), rel=1e-6)
    assert cut.stack.thickness_m == pytest.approx(0.04)


@pytest.mark.parametrize("segments", [0, -1, MOST_SEGMENTS + 1])
def test_a_number_of_segments_that_is_none_is_refused(segments: int) -> None:
    with pytest.raises(MotionError, match="span_segments"):
        SpanFolding(Mechanism(structure("wing")), 1.0, segments)


def test_one_segment_is_the_stack_itself() -> None:
    cut = folding("wing", 1)
    assert cut.hinges == ()
    assert cut.stowed_box_m == pytest.approx((*cut.mechanism.stack_box_m, 5.0), rel=1e-6)
    assert plan_span(cut, 1.0, 1.0, 100.0) is None


# --- poses --------------------------------------------------------------------------------------------


def turned_about(point: Reals, axis: Reals, angle: float) -> Reals:
    """Rodrigues' formula as a 4x4 matrix: shares nothing with the product code."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    out = np.eye(4)
    out[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    out[:3, 3] = point - out[:3, :3] @ point
    return out


@pytest.mark.parametrize(("name", "segments"), [("wing", 3), ("ellipse 7 off centre", 5), ("two inner vertices", 2)])
@settings(max_examples=10)
@given(data=st.data())
def test_segments_turn_about_their_hinges(name: str, segments: int, data: st.DataObject) -> None:
    cut = folding(name, segments)
    angles = data.draw(st.lists(st.floats(0.0, np.pi), min_size=segments - 1, max_size=segments - 1))
    found = cut.segment_matrices([angles])[0]
    want = np.eye(4)
    for k, hinge in enumerate(cut.hinges):
        # About the axis a positive turn takes +y to +z: the free end, at +z, has to go up at an upper hinge.
        want = want @ turned_about(hinge.point, hinge.axis, -angles[k] if hinge.side == "upper" else angles[k])
        assert found[k + 1] == pytest.approx(want, abs=1e-9)


def test_the_whole_sequence_runs_from_the_deployed_shape_to_the_stowed_box() -> None:
    cut = folding()
    fold, angles = cut.stow_sequence(5, 7)
    poses = cut.poses(fold, angles)
    assert poses.shape == (11, 3, 16, 4, 4)
    assert poses[0] == pytest.approx(np.broadcast_to(np.eye(4), (3, 16, 4, 4)))
    stowed = []
    for k in range(3):
        for p, o in enumerate(structure("wing").panel_outlines()):
            for z in (k * cut.length_m, (k + 1) * cut.length_m):
                corners = np.column_stack([o.real, o.imag, np.full(len(o), z)])
                stowed.append(corners @ poses[-1, k, p, :3, :3].T + poses[-1, k, p, :3, 3])
    axis = cut.stack.axis
    frame = np.array([[axis.real, axis.imag, 0.0], [-axis.imag, axis.real, 0.0], [0.0, 0.0, 1.0]])
    assert np.ptp(np.concatenate(stowed) @ frame.T, axis=0) == pytest.approx(cut.stowed_box_m, rel=1e-5)
    steps = np.abs(np.diff(cut.poses(*cut.stow_sequence(200, 200)), axis=0)).max()
    assert steps < 0.2  # nothing jumps between the two parts


def test_cells_may_not_be_open_while_the_span_is_folded() -> None:
    with pytest.raises(MotionError, match="cells are open while the span is folded"):
        folding().poses([0.0, 0.1], [[1.0, 1.0], [0.0, 0.1]])
    with pytest.raises(MotionError, match="hinge angle"):
        folding().poses([0.0], [[0.0, 3.2]])
    with pytest.raises(MotionError, match="shape"):
        folding().poses([0.0], [[0.0]])
    with pytest.raises(MotionError, match="not as many"):
        folding().poses([0.0, 0.0], [[0.0, 0.0]])


# --- interference ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", WITH_SLITS)
def test_in_step_segments_stay_between_parallel_planes(name: str) -> None:
    """The proof in the module's words, on the panels themselves."""
    cut = folding(name, 5)
    size = cut.mechanism.size_m
    for a in np.linspace(0.0, np.pi, 7):
        poses = cut.poses([0.0], np.full((1, 4), a))[0]
        segments = cut.segment_matrices(np.full((1, 4), a))[0]
        hinge = np.array([segments[k, :3, :3] @ h.point + segments[k, :3, 3] for k, h in enumerate(cut.hinges)])
        axis = cut.stack.axis
        up = 1.0 if cut.hinges[0].side == "upper" else -1.0
        normal = up * np.sin(0.5 * a) * np.array([-axis.imag, axis.real, 0.0]) + np.cos(0.5 * a) * np.eye(3)[2]
        planes = np.concatenate([[-np.inf], hinge @ normal, [np.inf]])
        for k in range(5):
            for p, o in enumerate(structure(name).panel_outlines()):
                corners = np.column_stack([np.tile(o.real, 2), np.tile(o.imag, 2), np.repeat([k, k + 1.0], len(o))])
                corners[:, 2] *= cut.length_m
                along = (corners @ poses[k, p, :3, :3].T + poses[k, p, :3, 3]) @ normal
                assert along.min() >= planes[k] - 1e-9 * size
                assert along.max() <= planes[k + 1] + 1e-9 * size


@pytest.mark.parametrize("name", WITH_SLITS)
def test_in_step_and_one_by_one_are_free(name: str) -> None:
    cut = folding(name, 4)
    for order in ORDERS:
        angles = order_of_hinges(order, 3, 21)
        assert angles[0] == pytest.approx(0.0)
        assert angles[-1] == pytest.approx(np.pi)
        assert cut.chain.first_collision(angles) is None
    assert cut.chain.deepest_m(order_of_hinges("in_step", 3)) <= cut.chain.allowed_m


def plate(signs: tuple[int, ...], *, length: float = 1.0, thickness: float = 0.1) -> SegmentChain:
    """Rectangular segments, hinges wherever wanted."""
    high = np.array([thickness, 0.5 * thickness])
    y = np.where(np.array(signs) > 0, thickness, 0.0)
    return SegmentChain(np.zeros(2), high, length, y, np.array(signs, dtype=float), 1e-3)


def rectangles(chain: SegmentChain, angles: Reals, row: int) -> list[shapely.Geometry]:
    """The segments at one bin of x, by turning polygons about hinges one after another."""
    length, n = chain.length_m, chain.n_segments
    shapes = [shapely.box(k * length, chain.low[row], (k + 1) * length, chain.high[row]) for k in range(n)]
    for k in reversed(range(n - 1)):
        pivot = np.array([(k + 1) * length, chain.hinge_y[k]])
        c, s = np.cos(angles[k]), chain.hinge_sign[k] * np.sin(angles[k])
        turn = np.array([[c, -s], [s, c]])
        for j in range(k + 1, n):
            shapes[j] = shapely.transform(shapes[j], lambda w, r=turn, p=pivot: (w - p) @ r.T + p)
    return shapes


@settings(max_examples=60)
@given(
    signs=st.lists(st.sampled_from([1, -1]), min_size=2, max_size=4),
    parts=st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4),
)
def test_segments_meet_as_polygons_do(signs: list[int], parts: list[float]) -> None:
    chain = plate(tuple(signs))
    angles = np.pi * np.array(parts[: len(signs)])
    d = chain.allowed_m
    for number, (i, j) in enumerate(chain.pairs.T):

        def meet(depth: float, i: int = int(i), j: int = int(j)) -> bool:
            for row in range(2):
                a, b = (rectangles(chain, angles, row)[k] for k in (i, j))
                small = [shapely.buffer(shape, -depth, join_style="mitre") for shape in (a, b)]
                if shapely.intersects(a, small[1]) or shapely.intersects(small[0], b):
                    return True
            return False

        found = chain.hits(angles[None], np.zeros(1, np.intp), np.array([number]))[0]
        if meet(1.01 * d):
            assert found
        if not meet(0.99 * d):
            assert not found


@pytest.mark.parametrize(
    ("start", "stop"), [((0.49, 0.89), (0.93, 0.36)), ((0.98, 0.5), (0.56, 0.86)), ((0.88, 0.51), (0.34, 0.99))]
)
def test_a_collision_between_two_free_poses_is_found(start: tuple[float, float], stop: tuple[float, float]) -> None:
    chain = plate((1, 1))
    path = np.pi * np.array([start, stop])
    assert chain.first_collision(path, between=False) is None
    found = chain.first_collision(path)
    assert found is not None
    assert found.segments == (0, 2)
    first, last = (rectangles(chain, np.array(found.angles_rad), 0)[k] for k in (0, 2))
    assert shapely.area(shapely.intersection(first, last)) > 0.0
    assert found.depth_m > chain.allowed_m


@settings(max_examples=25)
@given(
    signs=st.lists(st.sampled_from([1, -1]), min_size=2, max_size=4),
    ends=st.lists(st.floats(0.0, 1.0), min_size=8, max_size=8),
)
def test_what_is_certified_between_poses_is_free_at_many_poses(signs: list[int], ends: list[float]) -> None:
    chain, n = plate(tuple(signs)), len(signs)
    path = np.pi * np.array(ends).reshape(2, 4)[:, :n]
    fine = path[0] + np.linspace(0.0, 1.0, 301)[:, None] * (path[1] - path[0])
    if chain.first_collision(path) is None:
        assert chain.first_collision(fine, between=False) is None


def sampled_depth(cut: SpanFolding, angles: Reals, rng: np.random.Generator) -> float:
    """Depth of the deepest of many points of one segment's panels in another's panels; brute force in space."""
    segments = cut.segment_matrices(angles[None])[0]
    flat = cut.mechanism.poses(0.0)
    outlines = [
        flat.turn[p, 0] * o + flat.shift[p, 0] for p, o in enumerate(cut.mechanism.structure.panel_outlines())
    ]
    panels = [shapely.Polygon(np.column_stack([o.real, o.imag])) for o in outlines]
    corners = np.concatenate([np.column_stack([o.real, o.imag]) for o in outlines])
    weights = rng.dirichlet([0.3] * 3, size=(len(panels), 40))
    inside = []
    for panel, weight in zip(panels, weights, strict=True):
        triangles = np.array([t.exterior.coords[:3] for t in shapely.delaunay_triangles(panel).geoms])
        spots = np.einsum("ij,ijk->ik", weight, triangles[rng.integers(len(triangles), size=40)])
        inside.append(spots[shapely.contains_xy(panel, spots)])
    spots = np.concatenate([*inside, corners])
    z = cut.length_m * np.concatenate([[0.0, 1.0], rng.uniform(0.0, 1.0, 8)])
    points = np.array([[x, y, w] for x, y in spots for w in z])
    deepest = 0.0
    for i in range(cut.segments):
        for j in range(cut.segments):
            if i == j:
                continue
            placed = points + np.array([0.0, 0.0, i * cut.length_m])
            seen = np.linalg.inv(segments[j]) @ segments[i]
            placed = placed @ seen[:3, :3].T + seen[:3, 3]
            from_ends = np.minimum(placed[:, 2] - j * cut.length_m, (j + 1) * cut.length_m - placed[:, 2])
            near = placed[from_ends > 1e-3 * cut.chain.allowed_m]
            ends = from_ends[from_ends > 1e-3 * cut.chain.allowed_m]
            for panel in panels:
                held = shapely.contains_xy(panel, near[:, :2])
                if held.any():
                    rim = shapely.distance(panel.exterior, shapely.points(near[held, :2]))
                    deepest = max(deepest, float(np.minimum(rim, ends[held]).max()))
    return deepest


@pytest.mark.parametrize("name", ["wing", "two inner vertices"])
def test_brute_force_in_space_finds_nothing_in_step_and_a_wrong_hinge_at_once(name: str) -> None:
    rng = np.random.default_rng(5)
    cut = folding(name, 3, 2.0)
    for a in (0.4, 0.5 * np.pi, 2.6, np.pi):
        assert sampled_depth(cut, np.full(2, a), rng) <= cut.chain.allowed_m
    wrong = SpanFolding(cut.mechanism, 2.0, 3)
    vars(wrong)["faces"] = (cut.faces[0], cut.faces[0])  # both hinges on one face: segment 3 meets segment 1
    rolled = np.full(2, np.pi)
    assert sampled_depth(wrong, rolled, rng) > cut.chain.allowed_m
    assert wrong.chain.first_collision(order_of_hinges("in_step", 2)) is not None
    with pytest.raises(MotionError, match="span segments 1 and 3 reach into each other"):
        plan_span(wrong, 1.0, 1.0, 100.0)


@settings(max_examples=8)
@given(parts=st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3))
def test_brute_force_in_space_finds_no_more_than_the_check(parts: list[float]) -> None:
    cut = folding("ellipse 4", 4, 0.5)
    angles = np.pi * np.array(parts)
    if sampled_depth(cut, angles, np.random.default_rng(1)) > 2.0 * cut.chain.allowed_m:
        assert cut.chain.first_collision(angles[None], between=False) is not None


# --- timing -----------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(
    velocity=st.floats(0.05, 50.0),
    acceleration=st.floats(0.05, 500.0),
    rate_hz=st.sampled_from([20.0, 100.0, 333.0]),
)
def test_a_hinge_goes_from_folded_to_straight_within_its_limits(
    velocity: float, acceleration: float, rate_hz: float
) -> None:
    time, angle = half_turn(velocity, acceleration, rate_hz)
    assert angle[0] == np.pi
    assert angle[-1] == 0.0
    assert np.diff(time) == pytest.approx(1.0 / rate_hz)
    rate = np.diff(angle) * rate_hz
    assert (rate <= 1e-9).all()
    assert np.abs(rate).max() <= velocity * (1.0 + 1e-9)
    change = np.diff(np.concatenate([[0.0], rate, [0.0]])) * rate_hz
    assert np.abs(change).max() <= acceleration * (1.0 + 1e-6) + 1e-6
    top = min(velocity, np.sqrt(np.pi * acceleration))
    quickest = np.pi / top + top / acceleration
    assert quickest - 1e-9 <= time[-1] <= max(quickest + 1.0 / rate_hz, 2.0 / rate_hz) + 1e-9


@pytest.mark.parametrize(("velocity", "acceleration", "rate_hz"), [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1e-7, 1, 100)])
def test_limits_that_give_no_motion_are_refused(velocity: float, acceleration: float, rate_hz: float) -> None:
    with pytest.raises(MotionError, match="span hinges"):
        half_turn(velocity, acceleration, rate_hz)


def test_the_slowest_crease_sets_the_limits_of_the_hinges() -> None:
    assert span_limits(np.array([[np.inf, 2.0], [1.5, np.inf]]), np.array([3.0, np.inf])) == (1.5, 3.0)
    with pytest.raises(MotionError, match="limits"):
        span_limits(np.full(2, np.inf), np.ones(2))


def test_the_stage_holds_what_was_checked() -> None:
    stage = plan_span(folding(), 1.0, 2.0, 50.0)
    assert stage is not None
    assert stage.hinge_ids == ("h1", "h2")
    assert stage.free_orders == ORDERS
    assert stage.angles_rad.shape == (len(stage.time_s), 2)
    assert (stage.angles_rad[:, 0] == stage.angles_rad[:, 1]).all()
    assert stage.deepest_penetration_m <= stage.allowed_penetration_m
