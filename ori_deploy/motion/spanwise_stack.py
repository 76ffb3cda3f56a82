"""The flat stack as one thick plate: its frame, its thickness and the flat faces that piano hinges sit on.

When all cells are flat, every inner face is parallel to every other, so the stack has one direction
`x` along the panels and one, `y`, through its thickness. By construction each slab lies between two
planes of that direction (geometry: section 3), and where a slab's outermost panel is the straight one
of a slit, that panel's face lies in the outermost plane and is flat.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from ori_deploy.errors import MotionError
from ori_deploy.motion.mechanism import Mechanism
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.tolerance import TOLERANCE, Tolerance

Side = Literal["upper", "lower"]

SIGN: dict[Side, float] = {"upper": 1.0, "lower": -1.0}


@dataclass(frozen=True)
class StackFace:
    """A flat strip on an outermost plane of the flat stack.

    Attributes
    ----------
    side
        Which plane: `upper` is the one with the larger `y`.
    panel
        Number of the panel it belongs to.
    ends
        (2,) ends of the strip in the stack's frame, `x` rising.
    """

    side: Side
    panel: int
    ends: Points

    @property
    def length_m(self) -> float:
        return float(self.ends[1].real - self.ends[0].real)


@dataclass(frozen=True)
class FlatStack:
    """The cross-section of the flat stack. Points are complex numbers `x + iy` in the stack's frame, metres.

    Attributes
    ----------
    mechanism
        What was folded flat.
    tolerance
        `penetration`, `hinge_flat` and `hinge_length` count here.
    """

    mechanism: Mechanism
    tolerance: Tolerance = TOLERANCE

    @cached_property
    def _flat(self) -> tuple[Points, Points]:
        """(n_panels,) turn and shift of every panel at fold 0."""
        poses = self.mechanism.poses(0.0)
        return poses.turn[:, 0], poses.shift[:, 0]

    @cached_property
    def axis(self) -> complex:
        """Unit direction of `x` in the plane in which `Mechanism.poses` places the panels.

        Raises
        ------
        MotionError
            The inner faces are not parallel at fold 0: this structure has no flat stack.
        """
        along = self.mechanism.structure.cells.direction.ravel() * self._flat[0]
        off = np.abs((along * np.conj(along[0])).imag)
        worst = int(np.argmax(off))
        if not off[worst] <= self.tolerance.hinge_flat:
            raise MotionError(
                f"span: panel {self.mechanism.structure.layout.panel_ids[worst]} is not parallel to the others "
                "in the folded stack",
                value=f"{float(off[worst]):.3g} rad",
                limit=f"{self.tolerance.hinge_flat:.0e} rad",
                remedy="span_segments = 1",
            )
        return complex(along[0] / abs(along[0]))

    @cached_property
    def outlines(self) -> tuple[Points, ...]:
        """Panel polygons in the flat stack."""
        structure = self.mechanism.structure
        turn, shift = self._flat
        drawn = structure.panel_outlines(0.1 * self.tolerance.hinge_flat * structure.profile.size)
        return tuple((turn[p] * o + shift[p]) * np.conj(self.axis) for p, o in enumerate(drawn))

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """x_min, x_max, y_min, y_max of the stack, metres."""
        points = np.concatenate(self.outlines)
        return (
            float(points.real.min()),
            float(points.real.max()),
            float(points.imag.min()),
            float(points.imag.max()),
        )

    @property
    def thickness_m(self) -> float:
        """Distance of the two outermost planes."""
        return self.bounds[3] - self.bounds[2]

    def to_panel(self, panel: int, points: Points) -> Points:
        """Points of the stack's frame as places on a panel of the deployed cross-section."""
        turn, shift = self._flat
        return np.asarray(np.conj(turn[panel]) * (points * self.axis - shift[panel]))

    def face(self, side: Side) -> StackFace:
        """The longest flat strip on an outermost plane.

        Raises
        ------
        MotionError
            The plane only touches bulges: there is nothing to screw a piano hinge to.
        """
        size = self.mechanism.structure.profile.size
        least = self.tolerance.hinge_length * (self.bounds[1] - self.bounds[0])
        strips = [(p, _strip(o * SIGN[side], self.tolerance.hinge_flat * size)) for p, o in enumerate(self.outlines)]
        outermost = self.bounds[3] if side == "upper" else -self.bounds[2]
        near = [
            (p, ends)
            for p, ends in strips
            if ends is not None and outermost - ends[0].imag <= 0.5 * self.tolerance.penetration * size
        ]
        panel, ends = max(near, key=lambda found: abs(found[1][1] - found[1][0]), default=(-1, np.zeros(2, complex)))
        if abs(ends[1] - ends[0]) < least:
            raise MotionError(
                f"span: the {side} face of the folded stack is not flat, {self._highest(side)} bulges there",
                value=f"{1e3 * abs(ends[1] - ends[0]):.3g} mm of flat face",
                limit=f"{1e3 * least:.3g} mm for a piano hinge, a {self.tolerance.hinge_length:g} part of the width",
                remedy="a layout whose slits end the stack (one inner vertex does), or span_segments = 1",
            )
        placed = np.asarray(ends * SIGN[side], dtype=complex)
        return StackFace(side, panel, placed[np.argsort(placed.real)])

    def _highest(self, side: Side) -> str:
        top = [float((o.imag * SIGN[side]).max(initial=-np.inf)) for o in self.outlines]
        return f"panel {self.mechanism.structure.layout.panel_ids[int(np.argmax(top))]}"

    def extents(self, bins: int) -> tuple[Reals, Reals]:
        """Lowest and highest `y` over equal bins of `x`: (bins,) each; an empty bin is (inf, -inf).

        Hollows inside the stack are filled: for other segments only its outside counts.
        """
        left, right, _, _ = self.bounds
        edges = np.linspace(left, right, bins + 1)
        a = np.concatenate(self.outlines)
        b = np.concatenate([np.roll(o, -1) for o in self.outlines])
        a, b = np.where(a.real <= b.real, a, b), np.where(a.real <= b.real, b, a)
        slope = (b.imag - a.imag) / np.where(b.real > a.real, b.real - a.real, 1.0)
        low, high = np.full(bins, np.inf), np.full(bins, -np.inf)
        for k in range(bins):
            inside = np.flatnonzero((a.real <= edges[k + 1]) & (b.real >= edges[k]))
            at = [np.clip(x, a.real[inside], b.real[inside]) for x in (edges[k], edges[k + 1])]
            y = np.concatenate([a.imag[inside] + slope[inside] * (x - a.real[inside]) for x in at])
            upright = inside[a.real[inside] == b.real[inside]]
            y = np.concatenate([y, b.imag[upright]])
            if len(y):
                low[k], high[k] = y.min(), y.max()
        return low, high


def _strip(outline: Points, flat_m: float) -> Points | None:
    """(2,) ends of the longest piece of a polygon's highest side that keeps within `flat_m` of one height."""
    if len(outline) < 3:
        return None  # a panel without material
    height = outline.imag
    on = height >= height.max() - flat_m
    side = on & np.roll(on, -1)
    if side.all() or not side.any():
        return None
    start = int(np.argmin(side))  # begin on a side that is off, so that no run passes the seam
    order = (start + np.arange(len(side))) % len(side)
    runs = np.split(order, np.flatnonzero(np.diff(side[order].astype(int))) + 1)
    ends = [(outline[run[0]], outline[(run[-1] + 1) % len(side)]) for run in runs if side[run[0]]]
    return np.array(max(ends, key=lambda pair: abs(pair[1] - pair[0])))
