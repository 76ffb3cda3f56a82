"""Closed-form four-bar kinematics of a planar cell.

Names follow the crease order open_c, open_d, close_a, close_b. The links are
v1-c', c'-v3, v3-d', d'-v1 (lengths l1, l2, l3, l4). Inner angles are those between inner faces; the
links lean against the faces by constant angles, because the opening creases lie the wall offset
outside the faces (geometry: section 3, the dead centre).

With `x = θ/2` half the link angle at v1 and ε its value when flat, the link angle at v3 is

    sin²(θ_b / 2) = sin²(ε_b / 2) + (l1 l4 / l2 l3) (sin² x − sin²(ε_a / 2))

which is exact in the flat state by construction, because (3) holds there; a plain cosine rule loses
half the digits exactly where the motion is most delicate. The opening angles follow from the law of
tangents in the two triangles over the diagonal c'd', which stays regular when the diagonal's length
goes to zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.errors import MotionError
from ori_deploy.profiles.profile import Reals
from ori_deploy.tolerance import TOLERANCE

_BLOCK = 4096
"""Poses worked on at a time: a block's intermediates stay in the processor's cache."""


class BuiltCells(Protocol):
    """What a four-bar has to know of built cells, (n_cells, 4) each; see `FourBars`."""

    @property
    def link(self) -> Reals: ...
    @property
    def lean(self) -> Reals: ...
    @property
    def angle(self) -> Reals: ...


@dataclass(frozen=True)
class FourBars:
    """The four-bars of all cells.

    Attributes
    ----------
    link
        (n_cells, 4) lengths l1 to l4, metres.
    lean
        (n_cells, 4) angle at each face's closing crease between face and link: at v1 (c side), at v3
        (c side), at v3 (d side), at v1 (d side).
    deployed
        (n_cells, 4) inner angles when deployed.
    """

    link: Reals
    lean: Reals
    deployed: Reals

    @classmethod
    def of(cls, cells: BuiltCells) -> Self:
        """The four-bars of built cells."""
        return cls(cells.link, cells.lean, cells.angle)

    @property
    def n_cells(self) -> int:
        return len(self.link)

    @cached_property
    def _skews(self) -> tuple[Reals, Reals]:
        """l4 - l1 and l3 - l2, (n_cells,) each: (3) makes them equal and opposite without walls.

        Rounding must not choose a branch at the flat state.
        """
        l1, l2, l3, l4 = self.link.T
        tiny = TOLERANCE.flat_link * self.link.sum(axis=1)
        skew_a = np.where(np.abs(l4 - l1) <= tiny, 0.0, l4 - l1)
        skew_b = np.where(np.abs(l3 - l2) <= tiny, 0.0, l3 - l2)
        return skew_a, np.where((self.lean == 0.0).all(axis=1), -skew_a, skew_b)

    @cached_property
    def _constants(self) -> tuple[Reals, ...]:
        """Per cell, (n_cells, 1) each, for `angles`."""
        l1, l2, l3, l4 = self.link.T
        flat_a = self.lean[:, 0] + self.lean[:, 3]
        flat_b = self.lean[:, 1] + self.lean[:, 2]
        skew_a, skew_b = self._skews
        columns = (
            0.5 * self.deployed[:, 2],
            0.5 * flat_a,
            np.sin(0.5 * flat_a) ** 2,
            np.sin(0.5 * flat_b) ** 2,
            l1 * l4 / (l2 * l3),
            0.5 * flat_b,
            skew_a,
            l1 + l4,
            skew_b,
            l2 + l3,
            self.lean[:, 0] + self.lean[:, 1],
        )
        return tuple(c[:, None] for c in columns)

    def angles(self, fold: ArrayLike) -> Reals:
        """Inner angles at all creases.

        Parameters
        ----------
        fold
            (n_poses, n_cells) fold variable of each cell, 0 flat to 1 deployed; or (n_poses,) or a
            number, all cells in step.

        Returns
        -------
        (n_poses, n_cells, 4), radians, creases in the order of `CREASES`; the leading axis is left
        out for a number. The inner angle at v1 is `fold` times its deployed value (geometry: section 6).

        Raises
        ------
        MotionError
            A fold outside [0, 1].
        """
        wanted = np.asarray(fold, dtype=float)
        rows = np.atleast_1d(wanted)
        if rows.ndim == 1:
            rows = np.broadcast_to(rows[:, None], (len(rows), self.n_cells))
        check_fold(rows)
        out = np.empty((4, self.n_cells, len(rows)))
        for start in range(0, len(rows), _BLOCK):
            self._solve(rows[start : start + _BLOCK].T, out[:, :, start : start + _BLOCK])
        result = out.transpose(2, 1, 0)
        return result[0] if wanted.ndim == 0 else result

    def _solve(self, fold: Reals, out: Reals) -> None:
        """Angles of one block; `fold` is (n_cells, n), `out` (4, n_cells, n)."""
        half_a, lean_a, sin2_a, sin2_b, ratio, lean_b, skew_a, sum_a, skew_b, sum_b, lean_c = self._constants
        half = half_a * fold
        x = half + lean_a
        sin_x, cos_x = np.sin(x), np.cos(x)
        sin2_y = sin2_b + ratio * np.maximum(sin_x * sin_x - sin2_a, 0.0)
        sin_y = np.sqrt(np.minimum(sin2_y, 1.0))
        cos_y = np.sqrt(np.maximum(1.0 - sin2_y, 0.0))
        y = np.arcsin(sin_y)
        # Law of tangents in both triangles; the two arcs are added as complex numbers, one arctangent for both.
        re_a, im_a = sum_a * sin_x, skew_a * cos_x
        re_b, im_b = sum_b * sin_y, skew_b * cos_y
        swing = np.arctan2(im_a * re_b + re_a * im_b, re_a * re_b - im_a * im_b)
        out[2] = 2.0 * half
        np.multiply(y - lean_b, 2.0, out=out[3])
        np.maximum(out[3], 0.0, out=out[3])
        out[0] = np.pi - x - y + swing + lean_c
        out[1] = 2.0 * np.pi - out[0] - out[2] - out[3]

    def transmission(self, fold: ArrayLike, *, step: float = 1e-6) -> Reals:
        """Rate of every crease's angle per unit of fold, radians.

        Shaped like `angles`. Divide two of them for the transmission ratio between creases. One-sided
        at the ends of the motion.
        """
        at = np.asarray(fold, dtype=float)
        low, high = np.maximum(at - step, 0.0), np.minimum(at + step, 1.0)
        width = (high - low)[..., None] if at.ndim == 2 else (high - low)[..., None, None]
        return np.asarray((self.angles(high) - self.angles(low)) / width)


def check_fold(fold: Reals) -> None:
    """Refuse folds that are not in [0, 1]."""
    bad = ~((fold >= 0.0) & (fold <= 1.0))
    if bad.any():
        raise MotionError(
            "fold: outside the motion",
            value=float(fold[bad][0]),
            limit="0 (flat) <= fold <= 1 (deployed)",
            remedy="give a number from 0 to 1",
        )
