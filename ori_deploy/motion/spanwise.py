"""Spanwise folding: the flat stack cut across the span and folded zig-zag on piano hinges.

A flat stack is a plate (geometry: section 6). Cut into N segments across the span, and hinged to each
other on its two faces by turns, it folds to a length of span / N and a thickness of N stacks. Only the
flat stack can do so: the span unfolds before the cells open, and folds after they have closed.

In step, all hinges at the same angle `a`, this is free of interference for every N: the planes through
the hinges that are perpendicular to the direction `a / 2` are parallel to each other, and each segment
stays between the two of its own hinges, for it lies below the one hinge's face and above the other's.

Coordinates in space: `x` and `y` are those of the deployed cross-section, `z` runs along the span from
0 to `span_m`. The first panel of the first segment stays where it is when deployed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.design.packaging import smallest_box
from ori_deploy.errors import MotionError
from ori_deploy.motion.fourbar import check_fold
from ori_deploy.motion.mechanism import Mechanism
from ori_deploy.motion.spanwise_contact import SegmentChain
from ori_deploy.motion.spanwise_stack import SIGN, FlatStack, Side, StackFace
from ori_deploy.profiles.profile import Reals
from ori_deploy.tolerance import TOLERANCE, Tolerance

MOST_SEGMENTS = 20
"""More are a roll, not a stack; and the check of every pair in every order takes its time."""

Order = Literal["in_step", "from_first", "from_last"]
"""In which order hinges fold: all at once, or one after another beginning at one end."""

ORDERS: tuple[Order, ...] = get_args(Order)

_BINS = 96
"""Bins of `x` for the check between segments: finer ones only take longer, coarser ones judge more strictly."""


@dataclass(frozen=True)
class SpanHinge:
    """A piano hinge between two segments; points are (x, y, z) in metres.

    Attributes
    ----------
    id
        "h1", "h2", … along the span.
    side
        The face of the flat stack it sits on.
    panel
        Id of the panel that carries it, in both segments.
    point, axis
        (3,) the middle of its line, and the line's unit direction, with the stack flat and the span unfolded.
    length_m
        Length of the flat face it can use.
    line_m
        (2, 3) ends of the line on the panel in the deployed structure.
    """

    id: str
    side: Side
    panel: str
    point: Reals
    axis: Reals
    length_m: float
    line_m: Reals


@dataclass(frozen=True)
class SpanFolding:
    """A structure cut into span segments.

    Attributes
    ----------
    mechanism
        The cells' motion, the same in every segment.
    span_m
        Length along the generalized cylinder's axis.
    segments
        How many; 1 for an uncut span.
    tolerance
        `penetration` and what `FlatStack` uses count here.

    Raises
    ------
    MotionError
        Not a number of segments, or not a span.
    """

    mechanism: Mechanism
    span_m: float
    segments: int
    tolerance: Tolerance = TOLERANCE

    def __post_init__(self) -> None:
        if not 1 <= self.segments <= MOST_SEGMENTS:
            raise MotionError(
                "span_segments: not a number of segments",
                value=self.segments,
                limit=f"1 to {MOST_SEGMENTS}",
                remedy="1 for a span in one piece",
            )
        if not (np.isfinite(self.span_m) and self.span_m > 0.0):
            raise MotionError("span_m: not a length", value=self.span_m, limit="> 0", remedy="give metres")

    @property
    def length_m(self) -> float:
        """Length of a segment."""
        return self.span_m / self.segments

    @cached_property
    def stack(self) -> FlatStack:
        return FlatStack(self.mechanism, self.tolerance)

    @cached_property
    def faces(self) -> tuple[StackFace, ...]:
        """(n_segments - 1) faces that carry the hinges, by turns upper and lower.

        A single hinge takes whichever face is flat for longer.

        Raises
        ------
        MotionError
            A face that is needed is not flat.
        """
        if self.segments == 1:
            return ()
        if self.segments == 2:
            found, refused = [], []
            for side in SIGN:
                try:
                    found.append(self.stack.face(side))
                except MotionError as wrong:
                    refused.append(wrong)
            if not found:
                raise refused[0]
            # The first of two alike: rounding must not choose between them.
            return (max(found, key=lambda face: float(f"{face.length_m:.9e}")),)
        both = self.stack.face("upper"), self.stack.face("lower")
        return tuple(both[k % 2] for k in range(self.segments - 1))

    @cached_property
    def hinges(self) -> tuple[SpanHinge, ...]:
        """All piano hinges, along the span."""
        axis = self.stack.axis
        ids = self.mechanism.structure.layout.panel_ids
        hinges = []
        for k, face in enumerate(self.faces):
            z = (k + 1) * self.length_m
            middle = complex(face.ends.mean()) * axis
            on_panel = self.stack.to_panel(face.panel, face.ends)
            hinges.append(
                SpanHinge(
                    id=f"h{k + 1}",
                    side=face.side,
                    panel=ids[face.panel],
                    point=np.array([middle.real, middle.imag, z]),
                    axis=np.array([axis.real, axis.imag, 0.0]),
                    length_m=face.length_m,
                    line_m=np.array([[w.real, w.imag, z] for w in on_panel]),
                )
            )
        return tuple(hinges)

    @cached_property
    def chain(self) -> SegmentChain:
        """The segments as the check between them sees them."""
        low, high = self.stack.extents(_BINS)
        return SegmentChain(
            low,
            high,
            self.length_m,
            np.array([face.ends[0].imag for face in self.faces]),
            np.array([SIGN[face.side] for face in self.faces]),
            self.tolerance.penetration * self.mechanism.structure.profile.size,
        )

    # --- poses ---------------------------------------------------------------------------------------

    def segment_matrices(self, angles: ArrayLike) -> Reals:
        """Rigid motions of whole segments, cells flat.

        Parameters
        ----------
        angles
            (n_poses, n_segments - 1) hinge angles, radians: 0 unfolded, pi folded.

        Returns
        -------
        (n_poses, n_segments, 4, 4).
        """
        rows = self._angles(angles)
        turn, shift = (a.T for a in self.chain.placed(rows))
        local = np.zeros((*turn.shape, 4, 4))  # in the stack's frame: x along the faces, y through it, z
        local[..., 0, 0] = local[..., 3, 3] = 1.0
        local[..., 1, 1] = local[..., 2, 2] = turn.real
        local[..., 1, 2], local[..., 2, 1] = turn.imag, -turn.imag
        local[..., 1, 3], local[..., 2, 3] = shift.imag, shift.real
        axis = self.stack.axis
        frame = np.eye(4)
        frame[:2, :2] = [[axis.real, -axis.imag], [axis.imag, axis.real]]
        return np.asarray(frame @ local @ frame.T)

    def poses(self, fold: ArrayLike, angles: ArrayLike) -> Reals:
        """Poses of every panel of every segment.

        Parameters
        ----------
        fold
            (n_poses,) all cells of all segments in step, or (n_poses, n_cells).
        angles
            (n_poses, n_segments - 1) hinge angles, radians; all 0 wherever a cell is not flat.

        Returns
        -------
        (n_poses, n_segments, n_panels, 4, 4) homogeneous transforms of the deployed structure.

        Raises
        ------
        MotionError
            A fold or an angle outside its range, or a folded span with cells that are not flat: the
            hinges sit on panels that turn as the cells open.
        """
        rows = self._angles(angles)
        folds = np.asarray(fold, dtype=float)
        check_fold(folds)
        opened = folds if folds.ndim == 1 else folds.max(axis=1)
        if len(opened) != len(rows):
            raise MotionError(
                "poses: not as many folds as rows of hinge angles", value=len(opened), limit=str(len(rows))
            )
        bad = np.flatnonzero((opened > 0.0) & (rows > 0.0).any(axis=1))
        if len(bad):
            raise MotionError(
                "poses: cells are open while the span is folded",
                value=f"fold {opened[bad[0]]:.4g} at hinge angle {rows[bad[0]].max():.4g} rad",
                limit="hinge angles 0 wherever a fold is not 0",
                remedy="unfold the span first, fold it last",
            )
        flat = self.mechanism.poses(folds).matrices()
        panel = np.zeros((*flat.shape[:2], 4, 4))
        panel[..., :2, :2], panel[..., :2, 3] = flat[..., :2, :2], flat[..., :2, 2]
        panel[..., 2, 2] = panel[..., 3, 3] = 1.0
        return np.asarray(self.segment_matrices(rows)[:, :, None] @ panel[:, None])

    def stow_sequence(self, cell_poses: int = 31, span_poses: int = 31) -> tuple[Reals, Reals]:
        """The whole way from deployed to stowed, everything in step: cells first, then the span.

        Returns
        -------
        fold (n,), angles (n, n_segments - 1), for `poses`; n is the sum of both less 1.
        """
        fold = np.concatenate([np.linspace(1.0, 0.0, cell_poses), np.zeros(span_poses - 1)])
        angle = np.concatenate([np.zeros(cell_poses), np.linspace(0.0, np.pi, span_poses)[1:]])
        return fold, np.repeat(angle[:, None], self.segments - 1, axis=1)

    def _angles(self, angles: ArrayLike) -> Reals:
        rows = np.asarray(angles, dtype=float)
        if rows.ndim != 2 or rows.shape[1] != self.segments - 1:
            raise MotionError("hinge angles: wrong shape", value=rows.shape, limit=f"(n_poses, {self.segments - 1})")
        bad = ~((rows >= 0.0) & (rows <= np.pi))
        if bad.any():
            raise MotionError(
                "hinge angle: outside the motion",
                value=float(rows[bad][0]),
                limit="0 (unfolded) to pi (folded)",
                remedy="give radians",
            )
        return rows

    # --- stowed --------------------------------------------------------------------------------------

    @cached_property
    def stowed_box_m(self) -> tuple[float, float, float]:
        """Smallest box round the stowed structure: across (longer), across (shorter), along the span."""
        _, shift = self.chain.placed(np.full((1, self.segments - 1), np.pi))
        turned = [(-1.0) ** k for k in range(self.segments)]
        across = [
            o.real + 1j * (turn * o.imag + shift[k, 0].imag)
            for k, turn in enumerate(turned)
            for o in self.stack.outlines
        ]
        longer, shorter = smallest_box(np.concatenate(across))
        return longer, shorter, self.length_m

    @property
    def stowed_box_ratio(self) -> float:
        """Volume of the deployed shape over that of the stowed box."""
        return float(self.mechanism.structure.profile.area * self.span_m / np.prod(self.stowed_box_m))


def order_of_hinges(order: Order, hinges: int, poses_each: int = 61) -> Reals:
    """(n, hinges) angles from unfolded to folded in an order."""
    ramp = np.linspace(0.0, np.pi, poses_each)
    if order == "in_step":
        return np.repeat(ramp[:, None], hinges, axis=1)
    steps = np.concatenate([k * np.pi + ramp for k in range(hinges)])[:, None]
    angles = np.clip(steps - np.pi * np.arange(hinges), 0.0, np.pi)
    return angles if order == "from_first" else np.ascontiguousarray(angles[:, ::-1])
