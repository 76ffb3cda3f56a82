"""A wish as a smooth problem: one vector of unknowns, what to minimise, what has to hold."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ori_deploy.design import Embedding
from ori_deploy.design.jet import Jet
from ori_deploy.profiles import Cone
from ori_deploy.profiles.profile import Reals
from ori_deploy.search.cone_measures import ConeMeasurer
from ori_deploy.search.measures import Measurer, Measures, Unknowns
from ori_deploy.search.wish import Equation, Wish
from ori_deploy.tolerance import TOLERANCE

_FACE = 1e-4
"""Least length of an inner face over the profile's size: shorter ones are voids about to cross themselves."""

_ANGLE = 2e-3
"""Least inner angle at a closing crease, and least turn at an opening one, radians."""

_PANEL = 1e-3
"""Least length of a panel over the size where none is asked for: with less, an inner vertex has run into the skin."""

_GAP = 1e-3
"""Least distance of vertices along the outline, over its length."""

_IN_HAND = 1e-8
"""Bounds a person asked for are kept with this much in hand (radians, or lengths over the size)."""

_KINK = 0.02
"""Turn of the outline, radians, that a vertex may cross: where the two camber lines of an airfoil meet, for one."""

_STEP = 3e-6
"""Difference of an unknown over which gradients are compared for second derivatives."""


@dataclass(frozen=True)
class Row:
    """One inequality `value >= 0`, for people: what it is and of which cell."""

    kind: str
    cell: int
    corner: int


@dataclass(frozen=True)
class Values:
    """A problem at one place.

    Attributes
    ----------
    objective, gradient
        The material over the cross-section, or what is to be small instead; (count,) its derivatives.
    inequality, inequality_slope
        (m,) values that must not be negative, (m, count) derivatives.
    equation, equation_slope
        (k,) values that must be 0, (k, count) derivatives.
    """

    objective: float
    gradient: Reals
    inequality: Reals
    inequality_slope: Reals
    equation: Reals
    equation_slope: Reals

    @property
    def violation(self) -> float:
        """How far the worst condition is from holding."""
        worst = max(float(-self.inequality.min(initial=0.0)), 0.0)
        return max(worst, float(np.abs(self.equation).max(initial=0.0)))


class Problem:
    """Minimise the material of a structure under a wish's conditions.

    Parameters
    ----------
    start
        The embedding to begin with; unknown places are those of its vertices.
    wall_m
        Least wall offset, metres; radians on a cone.
    wish
        What to look for.
    cone
        Measured on this cone instead, with `start` on its base: arcs take the place of lengths.
    """

    def __init__(self, start: Embedding, wall_m: float, wish: Wish, cone: Cone | None = None) -> None:
        self.start, self.wall_m, self.wish, self.cone = start, wall_m, wish, cone
        self.size = start.profile.size if cone is None else cone.size
        self.unknowns = Unknowns(start.profile, start.layout)
        self.measurer = Measurer(self.unknowns) if cone is None else ConeMeasurer(self.unknowns, cone)
        self._every = np.arange(start.layout.n_cells)
        self._guess: Reals | None = None
        self._unit = start.profile.area if cone is None else cone.solid_angle

    @property
    def unit(self) -> str:
        """What walls and lengths are told in."""
        return "m" if self.cone is None else "rad"

    # --- unknowns -----------------------------------------------------------------------------------

    @cached_property
    def first(self) -> Reals:
        """Unknowns of the start; every raise is what (3) asks there."""
        return self.with_raises(self.unknowns.pack(self._unrolled, self.start.z, self.wall_m / self.size))

    def with_raises(self, x: Reals) -> Reals:
        """`x` with the smallest raises that satisfy (3)."""
        x = x.copy()
        raises = slice(self.unknowns.n_places, self.unknowns.wall)
        x[raises] = 0.0
        measures = self.measures(x)
        if measures is not None:
            x[raises] = np.maximum(-measures.raised.value[:, 1], 0.0) / self.size
        return x

    @cached_property
    def _unrolled(self) -> Reals:
        """Parameters of outline vertices that grow round the outline."""
        loop, period = np.array(self.start.layout.outline), self.start.profile.period
        s = self.start.s.copy()
        s[loop[1:]] = s[loop[0]] + (s[loop[1:]] - s[loop[0]]) % period
        return s

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """(count,) unknowns that may move: a vertex in a corner of the outline stays there."""
        free = np.ones(self.unknowns.count, dtype=bool)
        free[self.unknowns.wall] = self.wish.objective == "wall"
        profile = self.start.profile
        before, after = profile.tangents(profile.corners)
        corner = profile.point(profile.corners[np.abs(np.angle(after / before)) > _KINK])
        for i in np.flatnonzero(~self.unknowns.inner):
            away = np.abs(corner - self.start.z[i])
            if away.min(initial=np.inf) <= TOLERANCE.vertex_gap * profile.size:
                free[self.unknowns.column[i, 0]] = False
        return free

    @cached_property
    def order(self) -> tuple[Reals, Reals]:
        """`A x + b >= 0` keeps outline vertices in their order, `_GAP` apart."""
        loop, count = np.array(self.start.layout.outline), self.unknowns.count
        a = np.zeros((len(loop), count))
        columns = self.unknowns.column[loop, 0]
        rows = np.arange(len(loop))
        a[rows, np.roll(columns, -1)] += 1.0
        a[rows, columns] -= 1.0
        b = np.full(len(loop), -_GAP * self.start.profile.period / self.unknowns.stride)
        b[-1] += self.start.profile.period / self.unknowns.stride
        return a, b

    # --- values -------------------------------------------------------------------------------------

    def measures(self, x: Reals) -> Measures | None:
        """Measures at `x`; None where a crease cannot be placed."""
        measures = self.measurer(self.unknowns.of_cells(x), self._every, self._guess)
        if measures is None or not np.isfinite(measures.material.slope).all():
            return None
        self._guess = measures.crease_at
        return measures

    def values(self, x: Reals) -> Values | None:
        """Objective and conditions at `x`; None where no structure can be built."""
        measures = self.measures(x)
        if measures is None or not (total := float(measures.material.value.sum())) > 0.0:
            return None
        amount, gradient = total / self._unit, np.zeros(self.unknowns.count + 1)
        slope = measures.material.reshape(self.unknowns.layout.n_cells, 4).sum(axis=1).slope
        np.add.at(gradient, self.unknowns.local, slope / self._unit)
        blocks = self._blocks(measures)
        value = np.concatenate([b.value.ravel() for b in blocks])
        columns = np.concatenate([np.repeat(self.unknowns.local, b.shape[1], axis=0) for b in blocks])
        dense = np.zeros((len(value), self.unknowns.count + 1))
        dense[np.arange(len(value))[:, None], columns] = np.concatenate(
            [b.slope.reshape(-1, b.slope.shape[-1]) for b in blocks]
        )
        if not (np.isfinite(value).all() and np.isfinite(dense).all()):
            return None
        pins = self.equations(x)
        objective, downhill = amount, gradient[:-1]
        if self.wish.objective == "wall":
            value = np.append(value, 1.0 / self.wish.eta_at_least - amount - _IN_HAND)
            dense = np.concatenate([dense, -gradient[None]])
            objective, downhill = 1.0 - x[self.unknowns.wall], -np.eye(self.unknowns.count)[self.unknowns.wall]
        return Values(
            objective,
            downhill,
            value,
            dense[:, :-1],
            np.array([e.value for e in pins]),
            np.array([e.slope for e in pins]).reshape(len(pins), self.unknowns.count),
        )

    def curvature(self, x: Reals, weight: Reals, pin_weight: Reals) -> Reals:
        """(count, count) second derivatives of the objective less weighted conditions.

        Every measure depends on one cell's own unknowns only: all cells are measured once more for
        each of them, slightly moved, and exact gradients compared.
        """
        n, local = self.unknowns.layout.n_cells, self.unknowns.local
        width = local.shape[1]
        own = np.repeat(self.unknowns.of_cells(x)[None], 2 * width, axis=0)
        slot = np.arange(width)
        own[slot, :, slot] += _STEP
        own[slot + width, :, slot] -= _STEP
        guess = None if self._guess is None else np.tile(self._guess, (2 * width, 1))
        measures = self.measurer(own.reshape(-1, width), np.tile(self._every, 2 * width), guess)
        hessian = np.zeros((self.unknowns.count + 1, self.unknowns.count + 1))
        if measures is not None:
            gradient = self._objective_pull(x, own.reshape(-1, width), measures, weight)
            first = 0
            for block in self._blocks(measures):
                share = weight[first : first + n * block.shape[1]].reshape(n, -1)
                first += share.size
                gradient = gradient - np.einsum("ik,ikm->im", np.tile(share, (2 * width, 1)), block.slope)
            ahead, behind = gradient.reshape(2, width, n, width)
            bend = ((ahead - behind) / (2.0 * _STEP)).transpose(1, 0, 2)
            np.add.at(hessian, (local[:, :, None], local[:, None, :]), 0.5 * (bend + bend.transpose(0, 2, 1)))
        # Beside a place that can be built there may be one that cannot: the model does without its bend.
        hessian = np.where(np.isfinite(hessian), hessian, 0.0)[:-1, :-1]
        self._add_pin_curvature(x, pin_weight, hessian)
        return hessian

    def _objective_pull(self, x: Reals, own: Reals, measures: Measures, weight: Reals) -> Reals:
        """(n, slots) derivatives by cells' `own` unknowns of the objective, and of conditions beyond `_blocks`."""
        del x, own
        # A thickest wall is looked for under a bound of the material, the last condition.
        share = weight[-1] if self.wish.objective == "wall" else 1.0
        return np.asarray(share * measures.material.reshape(-1, 4).sum(axis=1).slope / self._unit)

    def _add_pin_curvature(self, x: Reals, pin_weight: Reals, hessian: Reals) -> None:
        """Pins bend with the outline: each outline vertex by itself."""
        if not np.any(pin_weight):
            return
        columns = self.unknowns.column[~self.unknowns.inner, 0]
        moved = x.copy()
        moved[columns] += _STEP
        before = pin_weight @ np.array([e.slope for e in self.equations(x)])
        after = pin_weight @ np.array([e.slope for e in self.equations(moved)])
        hessian[columns, columns] -= (after - before)[columns] / _STEP

    @cached_property
    def rows(self) -> list[Row]:
        """What each inequality is, in order."""
        n = self.unknowns.layout.n_cells
        kinds = [("raise", 1), ("margin", 2), ("face", 4), ("closing angle", 2), ("opening angle", 2), ("panel", 4)]
        rows = [Row(kind, cell, k) for kind, width in kinds for cell in range(n) for k in range(width)]
        return [*rows, Row("eta", 0, 0)] if self.wish.objective == "wall" else rows

    def _blocks(self, measures: Measures) -> list[Jet]:
        """Conditions of all cells, (n, width) each, in the order of `rows` when n is the number of cells."""
        size = self.size
        margin, face, angle = (
            cast(Jet, measures.cells.dead_centre_margin),
            cast(Jet, measures.cells.face),
            cast(Jet, measures.cells.angle),
        )
        return [
            measures.raised[:, 1:] / size,  # at d; at c it is an unknown with a bound
            margin - (self.wish.margin_rad + _IN_HAND),
            face / size - _FACE,
            angle[:, 2:] - _ANGLE,
            np.pi - _ANGLE - angle[:, :2],
            (measures.length - max(self.wish.panel_m, _PANEL * size)) / size - _IN_HAND,
        ]

    def equations(self, x: Reals) -> list[Equation]:
        """The pins at `x`."""
        return self.wish.equations(self.unknowns, x, self.start.z)

    # --- back to a structure ------------------------------------------------------------------------

    def embedding(self, x: Reals) -> Embedding:
        """The embedding at `x`, not checked."""
        s, z, _ = self.unknowns.places(x)
        return Embedding(self.start.profile, self.start.layout, s % self.start.profile.period, z)
