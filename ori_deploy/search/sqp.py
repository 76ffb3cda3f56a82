"""Sequential quadratic programming in a trust region, with exact curvature.

At every place the problem is modelled by a quadratic with linear conditions; one elastic variable,
paid for by a penalty, lets all conditions miss by the same amount, so that a model always has a
solution and an infeasible start is repaired on the way. A step is taken when the penalised objective
falls as the model says; otherwise the region shrinks. Places where no structure can be built refuse a
step in the same way. (Nocedal and Wright, Numerical Optimization, section 18.5, with the largest
violation in place of their sum.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import piqp
from numpy.typing import NDArray

from ori_deploy.profiles.profile import Reals
from ori_deploy.search.problem import Problem, Values

_FIRST_REGION = 0.3
"""First trust region, over the mean distance of neighbours along the outline."""
_SMALLEST_REGION = 1e-9
_PENALTY = 300.0
"""First penalty, over the objective: no structure that breaks its conditions by a few thousandths may pay."""
_LARGEST_PENALTY = 1e6
_FEASIBLE = 1e-9
_NEARLY = 1e-3
"""Violation below which the last place is mended instead of given up."""

_FLATTEST = 1e-7
"""Least curvature of a model, over its greatest: keeps steps along flat valleys finite."""

_STILL = 1e-6
"""Curvature that keeps a repair from moving what need not move."""

_REPAIRS = 60

_CORRECTIONS = 3
_WORTH = 0.7
"""Part of a promised fall at which a step is good enough to be taken uncorrected, and the region grows."""

_HOLDS = 1e-8
"""Weight of a condition, over the penalty, above which it counts as held with equality."""


@dataclass(frozen=True)
class Step:
    """A model's solution: where to go, what it leaves unmet, and what conditions cost there."""

    move: Reals
    slack: float
    weight: Reals
    pin_weight: Reals
    bound_weight: Reals


@dataclass(frozen=True)
class Local:
    """Where a local search ended.

    Attributes
    ----------
    x, values
        The best place that meets every condition, or the last one where none did.
    iterations
        Models solved.
    settled
        Whether nothing better is near, to the tolerance.
    """

    x: Reals
    values: Values
    iterations: int
    settled: bool

    @property
    def feasible(self) -> bool:
        return self.values.violation <= 10.0 * _FEASIBLE


def minimise(
    problem: Problem,
    *,
    tolerance: float = 1e-9,
    most_iterations: int = 200,
    watch: Callable[[Reals, Values], None] | None = None,
) -> Local | None:
    """A local minimum near the problem's start.

    Parameters
    ----------
    problem
        What to minimise.
    tolerance
        Fall of the objective, over its value, that a model must promise to go on.
    most_iterations
        Models solved before giving up.
    watch
        Called at every place taken.

    Returns
    -------
    None where no structure can be built at the start.
    """
    x = problem.first
    here = problem.values(x)
    if here is None:
        return None
    x, here = _repaired(problem, x, here)
    largest = problem.start.profile.perimeter / problem.start.profile.size / len(problem.start.layout.outline)
    region, penalty = _FIRST_REGION * largest, _PENALTY * here.objective
    weight, pin_weight = np.zeros(len(here.inequality)), np.zeros(len(here.equation))
    unmoved = np.zeros((0, len(x)))
    hessian: Reals | None = None
    settled = False
    spent = 0
    while spent < most_iterations:
        spent += 1
        if hessian is None:
            hessian = _convex(
                problem.curvature(x, weight, pin_weight),
                np.concatenate([here.inequality_slope[weight > _HOLDS * penalty], here.equation_slope, unmoved]),
                problem.free,
            )
        step, penalty = _step(problem, x, here, hessian, region, penalty)
        promised = _promise(here, hessian, step, penalty)
        if promised <= tolerance * here.objective and here.violation <= _FEASIBLE:
            settled = True
            break
        new, there = _tried(problem, x, here, hessian, step, region, penalty)
        gained = -np.inf if there is None else _merit(here, penalty) - _merit(there, penalty)
        if there is None or gained < 0.05 * promised:
            region = 0.3 * min(region, float(np.abs(step.move).max()))
            if region < _SMALLEST_REGION:
                settled = here.violation <= _FEASIBLE
                break
            continue
        if gained > _WORTH * promised and np.abs(step.move).max() > 0.8 * region:
            region = min(2.5 * region, largest)
        x, here, hessian = new, there, None
        weight, pin_weight = step.weight, step.pin_weight
        if here.violation <= _FEASIBLE:  # a penalty that a repair has raised would forbid any bend from here on
            penalty = min(
                penalty, max(_PENALTY * here.objective, 3.0 * float(weight.sum() + np.abs(pin_weight).sum()))
            )
        unmoved = np.eye(len(x))[step.bound_weight > _HOLDS * penalty]
        if watch is not None:
            watch(x, here)
    if _FEASIBLE < here.violation <= _NEARLY:
        x, here = _repaired(problem, x, here)
    return Local(x, here, spent, settled)


def _repaired(problem: Problem, x: Reals, here: Values) -> tuple[Reals, Values]:
    """A place near `x` that meets the conditions, or the nearest to that: steps that only reduce the violation."""
    still = _STILL * np.eye(len(x))
    region = problem.start.profile.perimeter / problem.start.profile.size / len(problem.start.layout.outline)
    for _ in range(_REPAIRS):
        if here.violation <= _FEASIBLE:
            break
        aim = replace(here, gradient=np.zeros(len(x)))
        step = _solve(problem, x, aim, still, region, 1.0)
        there = problem.values(x + step.move)
        if there is None or there.violation > here.violation - 0.1 * (here.violation - step.slack):
            region = 0.3 * min(region, float(np.abs(step.move).max()))
            if region < _SMALLEST_REGION:
                break
            continue
        x, here = x + step.move, there
    return x, here


def _merit(values: Values, penalty: float) -> float:
    return values.objective + penalty * values.violation


def _promise(here: Values, hessian: Reals, step: Step, penalty: float) -> float:
    d = step.move
    fall = -float(here.gradient @ d + 0.5 * d @ hessian @ d)
    return fall + penalty * (here.violation - step.slack)


def _convex(hessian: Reals, held: Reals, free: NDArray[np.bool_]) -> Reals:
    """A convex quadratic that agrees with the given one along the conditions that hold with equality.

    Curvature across them is added first: it costs steps along them nothing, and mends most of what
    is not convex. What then still is not, is made flat.
    """
    out = np.zeros_like(hessian)
    part = np.ix_(free, free)
    inside, across = hessian[part], held[:, free]
    across = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    stiff = 10.0 * float(np.abs(inside).max(initial=0.0))
    whole = inside + stiff * across.T @ across
    least = _FLATTEST * max(stiff, 1e-12)
    try:
        np.linalg.cholesky(whole - least * np.eye(len(whole)))
    except np.linalg.LinAlgError:  # not convex
        value, vector = np.linalg.eigh(whole)
        whole = (vector * np.maximum(value, least)) @ vector.T
    out[part] = whole
    return out


def _tried(
    problem: Problem, x: Reals, here: Values, hessian: Reals, step: Step, region: float, penalty: float
) -> tuple[Reals, Values | None]:
    """Where a step leads; corrected for the bend of the conditions while that spoils it.

    One correction is not enough: what it leaves is of third order, but weighed with the penalty.
    """
    wanted = _merit(here, penalty) - _WORTH * _promise(here, hessian, step, penalty)
    new = x + step.move
    there = problem.values(new)
    if there is None or there.violation <= here.violation:
        return new, there
    move, at = step.move, there
    for _ in range(_CORRECTIONS):
        if _merit(there, penalty) <= wanted:
            break
        bent = replace(
            here,
            inequality=at.inequality - here.inequality_slope @ move,
            equation=at.equation - here.equation_slope @ move,
        )
        move = _solve(problem, x, bent, hessian, region, penalty).move
        corrected = problem.values(x + move)
        if corrected is None or _merit(corrected, penalty) >= _merit(there, penalty):
            break
        new, there, at = x + move, corrected, corrected
    return new, there


def _step(
    problem: Problem, x: Reals, here: Values, hessian: Reals, region: float, penalty: float
) -> tuple[Step, float]:
    """The model's step, with a penalty high enough that conditions are met where the region lets them."""
    while True:
        step = _solve(problem, x, here, hessian, region, penalty)
        missed = step.slack > max(0.5 * here.violation, _FEASIBLE)
        top = _LARGEST_PENALTY * max(here.objective, 1e-12)
        if not missed or penalty >= top:
            return step, penalty
        higher = _solve(problem, x, here, hessian, region, 10.0 * penalty)
        if higher.slack > 0.9 * step.slack:
            return step, penalty
        penalty *= 10.0


def _solve(problem: Problem, x: Reals, here: Values, hessian: Reals, region: float, penalty: float) -> Step:
    """Solve the model: least objective within the region, all conditions missed by one slack at most."""
    free = np.flatnonzero(problem.free)
    n = len(free)
    a, b = problem.order
    # Conditions that no step within the region can reach are left out.
    reach = here.inequality - region * np.abs(here.inequality_slope[:, free]).sum(axis=1)
    near = np.flatnonzero(reach < 0.0)
    rows = here.inequality_slope[np.ix_(near, free)]
    g = np.concatenate(
        [
            np.column_stack([-rows, -np.ones(len(near))]),
            np.column_stack([here.equation_slope[:, free], -np.ones(len(here.equation))]),
            np.column_stack([-here.equation_slope[:, free], -np.ones(len(here.equation))]),
            np.column_stack([-a[:, free], np.zeros(len(b))]),
        ]
    )
    h = np.concatenate([here.inequality[near], -here.equation, here.equation, a @ x + b])
    p = np.zeros((n + 1, n + 1))
    p[:n, :n] = hessian[np.ix_(free, free)]
    low, high = np.full(n + 1, -region), np.full(n + 1, region)
    raises = np.flatnonzero((free >= problem.unknowns.n_places) & (free <= problem.unknowns.wall))
    low[raises] = np.maximum(-region, -x[free[raises]])
    low[n], high[n] = 0.0, np.inf
    solver = piqp.DenseSolver()
    solver.settings.verbose = False
    solver.settings.eps_abs = 1e-11
    solver.settings.eps_rel = 1e-11
    solver.setup(p, np.append(here.gradient[free], penalty), None, None, g, None, h, low, high)
    solver.solve()
    found = solver.result
    move = np.zeros(len(x))
    move[free] = found.x[:n]
    weight = np.zeros(len(here.inequality))
    weight[near] = found.z_u[: len(near)]
    k = len(here.equation)
    over, under = found.z_u[len(near) : len(near) + k], found.z_u[len(near) + k : len(near) + 2 * k]
    bound_weight = np.zeros(len(x))
    bound_weight[free[raises]] = np.where(low[raises] > -region, found.z_bl[raises], 0.0)
    return Step(move, max(float(found.x[n]), 0.0), weight, under - over, bound_weight)
