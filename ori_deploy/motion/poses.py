"""Where every panel is at a given fold: rigid motions of the deployed cross-section."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.design import Structure
from ori_deploy.design.packaging import smallest_box
from ori_deploy.motion.fourbar import FourBars
from ori_deploy.profiles.profile import Points, Reals

_NEXT_CREASE = (0, 3, 1, 2)
"""Crease (order of CREASES) between a cell's panel k and k + 1: c, b, d, a."""


@dataclass(frozen=True)
class Poses:
    """Rigid motions `z -> turn * z + shift` of all panels.

    Attributes
    ----------
    turn, shift
        (n_panels, n_poses) unit complex numbers and metres. The first panel of cell c1 stays where it
        is in the deployed cross-section.
    """

    turn: Points
    shift: Points

    def matrices(self) -> Reals:
        """(n_poses, n_panels, 3, 3) homogeneous transforms."""
        turn, shift = self.turn.T, self.shift.T
        out = np.zeros((*turn.shape, 3, 3))
        out[..., 0, 0] = out[..., 1, 1] = turn.real
        out[..., 1, 0], out[..., 0, 1] = turn.imag, -turn.imag
        out[..., 0, 2], out[..., 1, 2] = shift.real, shift.imag
        out[..., 2, 2] = 1.0
        return out


@dataclass(frozen=True)
class Mechanism:
    """A structure that moves: four-bars chained by bonds.

    Attributes
    ----------
    structure
        What moves.
    """

    structure: Structure

    @cached_property
    def four_bars(self) -> FourBars:
        return FourBars.of(self.structure.cells)

    @property
    def n_cells(self) -> int:
        return self.structure.layout.n_cells

    def poses(self, fold: ArrayLike) -> Poses:
        """Poses of all panels.

        Parameters
        ----------
        fold
            (n_poses, n_cells), every cell its own fold variable; or (n_poses,) or a number, all in step.

        Raises
        ------
        MotionError
            A fold outside [0, 1].
        """
        angles = self.four_bars.angles(np.atleast_1d(np.asarray(fold, dtype=float)))
        swing = np.exp(-1j * (angles - self.four_bars.deployed)).T  # (4, n_cells, n_poses)
        crease = self.structure.cells.crease
        n = len(angles)
        turn = np.empty((self.structure.layout.n_panels, n), dtype=complex)
        shift = np.empty_like(turn)
        turn[0], shift[0] = 1.0, 0.0
        for cell, entry, bonded in self.structure.layout.folding_order:
            if bonded >= 0:
                turn[entry], shift[entry] = turn[bonded], shift[bonded]
            for step in range(3):
                k = (entry + step) % 4
                here, there = 4 * cell + k, 4 * cell + (k + 1) % 4
                pivot, rotation = crease[cell, _NEXT_CREASE[k]], swing[_NEXT_CREASE[k], cell]
                turn[there] = turn[here] * rotation
                shift[there] = shift[here] + turn[here] * pivot * (1.0 - rotation)
        return Poses(turn, shift)

    @cached_property
    def stack_box_m(self) -> tuple[float, float]:
        """Sides (longer, shorter) of the smallest rectangle round the folded stack, metres."""
        flat = self.poses(0.0)
        outlines = self.structure.panel_outlines()
        return smallest_box(np.concatenate([flat.turn[p, 0] * o + flat.shift[p, 0] for p, o in enumerate(outlines)]))

    @cached_property
    def shared_crease(self) -> NDArray[np.bool_]:
        """(n_panels, n_panels) whether two panels' rigid bodies meet at a crease: they only turn about it."""
        bodies = self.structure.layout.bodies
        n = len(bodies)
        first = np.arange(n)
        second = 4 * (first // 4) + (first + 1) % 4
        joined = np.zeros((n, n), dtype=bool)
        joined[bodies[first], bodies[second]] = joined[bodies[second], bodies[first]] = True
        return joined[bodies[:, None], bodies[None, :]]
