"""The smallest folded stack as a smooth problem: two more unknowns, where the stack begins and ends.

The stack's box is its height times its length; the length is that from the lowest to the highest of
many ends, which has kinks wherever another one takes over. With the lowest and the highest place as
unknowns, and every end kept between them, what is left is smooth.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ori_deploy.design import Embedding
from ori_deploy.design.jet import Jet
from ori_deploy.profiles.profile import Reals
from ori_deploy.search.measures import Measurer, Measures
from ori_deploy.search.problem import Problem, Row, Values
from ori_deploy.search.stack import ENDS, Stack, ends
from ori_deploy.search.wish import Wish


class BoxProblem(Problem):
    """Minimise the folded stack's box over the cross-section's area under a wish's conditions.

    The last two unknowns are the stack's end and its beginning, over the profile's size. Along bulging
    skins panels may reach beyond the closing vertices that count here, and a slanting stack may fit a
    turned box that is smaller: `Mechanism.stack_box_m` has the last word.

    Raises
    ------
    LayoutError
        Slits with which the structure does not fold flat.
    """

    measurer: Measurer

    def __init__(self, start: Embedding, wall_m: float, wish: Wish) -> None:
        super().__init__(start, wall_m, wish)
        self.stack = Stack(start.layout)
        self._box_unit = self.size**2 / self._unit
        self._measured: Measures | None = None

    @cached_property
    def first(self) -> Reals:
        x = super().first
        measures = self.measures(x)
        if measures is None:
            return np.append(x, [1.0, 0.0])
        place = self.stack.places @ self._ends(x, measures).value.ravel()
        return np.append(x, [max(float(place.max()), 0.0), min(float(place.min()), 0.0)])

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        return np.append(super().free, [True, True])

    @cached_property
    def order(self) -> tuple[Reals, Reals]:
        a, b = super().order
        return np.pad(a, ((0, 0), (0, 2))), b

    @cached_property
    def rows(self) -> list[Row]:
        n = self.unknowns.layout.n_cells
        places = [Row("box", cell, k) for cell in range(n) for k in range(ENDS + 1)]
        return [*super().rows, *places, *places]

    def values(self, x: Reals) -> Values | None:
        base = super().values(x)
        if base is None or self._measured is None:
            return None
        thickness, lengths = self._measured.thickness / self.size, self._ends(x, self._measured)
        n, local, spread = self.unknowns.layout.n_cells, self.unknowns.local, self.unknowns.count + 1
        rise, slopes = np.zeros(spread), np.zeros((ENDS * n, spread))
        np.add.at(rise, local, thickness.sum(axis=1).slope)
        slopes[np.arange(ENDS * n)[:, None], np.repeat(local, ENDS, axis=0)] = lengths.reshape(ENDS * n).slope
        place = self.stack.places @ lengths.value.ravel()
        slope = np.pad((self.stack.places @ slopes)[:, :-1], ((0, 0), (0, 2)))
        end, begin = np.eye(len(x))[-2:]
        height, length = float(thickness.value.sum()), float(x[-2] - x[-1])
        return Values(
            self._box_unit * height * length,
            self._box_unit * (length * np.append(rise[:-1], [0.0, 0.0]) + height * (end - begin)),
            np.concatenate([base.inequality, x[-2] - place, place - x[-1]]),
            np.concatenate([np.pad(base.inequality_slope, ((0, 0), (0, 2))), end - slope, slope - begin]),
            base.equation,
            np.pad(base.equation_slope, ((0, 0), (0, 2))),
        )

    def curvature(self, x: Reals, weight: Reals, pin_weight: Reals) -> Reals:
        """As of any problem; and height and length change together."""
        hessian = np.pad(super().curvature(x, weight, pin_weight), (0, 2))
        if self._measured is not None:
            rise = np.zeros(self.unknowns.count + 1)
            np.add.at(rise, self.unknowns.local, (self._measured.thickness / self.size).sum(axis=1).slope)
            cross = self._box_unit * np.outer(rise[:-1], [1.0, -1.0])
            hessian[:-2, -2:] += cross
            hessian[-2:, :-2] += cross.T
        return hessian

    def _objective_pull(self, x: Reals, own: Reals, measures: Measures, weight: Reals) -> Reals:
        n = self.unknowns.layout.n_cells
        copies = len(own) // n
        over, under = weight[-2 * (ENDS + 1) * n :].reshape(2, -1)
        pull = np.tile(((over - under) @ self.stack.places).reshape(n, ENDS), (copies, 1))
        lengths = ends(measures, self.measurer.vertices(own, np.tile(self._every, copies))) / self.size
        higher = self._box_unit * (x[-2] - x[-1]) * (measures.thickness / self.size).sum(axis=1).slope
        return np.asarray(higher + np.einsum("ik,ikm->im", pull, lengths.slope))

    # --- the stack ----------------------------------------------------------------------------------

    def measures(self, x: Reals) -> Measures | None:
        self._measured = super().measures(x)
        return self._measured

    def _ends(self, x: Reals, measures: Measures) -> Jet:
        """(n_cells, 5) lengths along the folded cells, over the size."""
        vertices = self.measurer.vertices(self.unknowns.of_cells(x), self._every)
        return ends(measures, vertices) / self.size

    def box_m(self, x: Reals) -> tuple[float, float] | None:
        """Length and height of the stack at `x`, metres; None where it cannot be built."""
        measures = self.measures(x)
        if measures is None:
            return None
        place = self.stack.places @ self._ends(x, measures).value.ravel()
        return float(np.ptp(place)) * self.size, float(measures.thickness.value.sum())
