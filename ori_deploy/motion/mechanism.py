"""A structure that moves: four-bars chained by bonds, in the plane of a cylinder's cross-section."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Generic

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.design import Structure
from ori_deploy.design.cone import ConeStructure
from ori_deploy.design.packaging import smallest_box
from ori_deploy.layout import Layout
from ori_deploy.motion.contact import Contact
from ori_deploy.motion.fourbar import FourBars
from ori_deploy.motion.plane_contact import PlaneContact
from ori_deploy.motion.poses import Poses, PosesT
from ori_deploy.profiles.profile import Reals
from ori_deploy.tolerance import Tolerance

AnyStructure = Structure | ConeStructure

NEXT_CREASE = (0, 3, 1, 2)
"""Crease (order of CREASES) between a cell's panel k and k + 1: c, b, d, a."""

BEFORE_CREASE = tuple(NEXT_CREASE[k - 1] for k in range(4))
"""Crease on which a cell's panel k begins, counter-clockwise; it ends on `NEXT_CREASE[k]`."""


class Linkage(ABC, Generic[PosesT]):
    """What moves, whatever surface its panels move on. Lengths in metres; on a cone at its outer radius.

    Attributes
    ----------
    structure
        What moves.
    """

    structure: AnyStructure

    @property
    def layout(self) -> Layout:
        """Cells, panels and bonds."""
        return self.structure.layout

    @property
    @abstractmethod
    def size_m(self) -> float:
        """The profile's size: what relative tolerances refer to."""

    @property
    @abstractmethod
    def four_bars(self) -> FourBars:
        """The four-bars of all cells."""

    @abstractmethod
    def poses(self, fold: ArrayLike) -> PosesT:
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

    @abstractmethod
    def contact(self, tolerance: Tolerance) -> Contact[PosesT]:
        """The panels as shapes that may touch."""

    @abstractmethod
    def steps_m(self, poses: PosesT) -> Reals:
        """(n_poses - 1,) how far the panel that moves furthest moves from one pose to the next, about."""

    @property
    def n_cells(self) -> int:
        return self.layout.n_cells

    @cached_property
    def shared_crease(self) -> NDArray[np.bool_]:
        """(n_panels, n_panels) whether two panels' rigid bodies meet at a crease: they only turn about it."""
        bodies = self.layout.bodies
        n = len(bodies)
        first = np.arange(n)
        second = 4 * (first // 4) + (first + 1) % 4
        joined = np.zeros((n, n), dtype=bool)
        joined[bodies[first], bodies[second]] = joined[bodies[second], bodies[first]] = True
        return joined[bodies[:, None], bodies[None, :]]


@dataclass(frozen=True)
class Mechanism(Linkage[Poses]):
    """A structure on a generalized cylinder that moves.

    Attributes
    ----------
    structure
        What moves.
    """

    structure: Structure

    @property
    def size_m(self) -> float:
        return self.structure.profile.size

    @cached_property
    def four_bars(self) -> FourBars:
        return FourBars.of(self.structure.cells)

    def poses(self, fold: ArrayLike) -> Poses:
        angles = self.four_bars.angles(np.atleast_1d(np.asarray(fold, dtype=float)))
        swing = np.exp(-1j * (angles - self.four_bars.deployed)).T  # (4, n_cells, n_poses)
        crease = self.structure.cells.crease
        n = len(angles)
        turn = np.empty((self.layout.n_panels, n), dtype=complex)
        shift = np.empty_like(turn)
        turn[0], shift[0] = 1.0, 0.0
        for cell, entry, bonded in self.layout.folding_order:
            if bonded >= 0:
                turn[entry], shift[entry] = turn[bonded], shift[bonded]
            for step in range(3):
                k = (entry + step) % 4
                here, there = 4 * cell + k, 4 * cell + (k + 1) % 4
                pivot, rotation = crease[cell, NEXT_CREASE[k]], swing[NEXT_CREASE[k], cell]
                turn[there] = turn[here] * rotation
                shift[there] = shift[here] + turn[here] * pivot * (1.0 - rotation)
        return Poses(turn, shift)

    def contact(self, tolerance: Tolerance) -> PlaneContact:
        return PlaneContact(self.structure, tolerance)

    def steps_m(self, poses: Poses) -> Reals:
        middle = self.structure.embedding.z.mean()
        moved = np.abs(np.diff(poses.turn * middle + poses.shift, axis=1))
        return np.asarray((moved + np.abs(np.diff(poses.turn, axis=1)) * self.size_m).max(axis=0))

    @cached_property
    def stack_box_m(self) -> tuple[float, float]:
        """Sides (longer, shorter) of the smallest rectangle round the folded stack, metres."""
        flat = self.poses(0.0)
        outlines = self.structure.panel_outlines()
        return smallest_box(np.concatenate([flat.turn[p, 0] * o + flat.shift[p, 0] for p, o in enumerate(outlines)]))
