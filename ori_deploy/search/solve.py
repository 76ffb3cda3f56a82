"""From a wish to the best structure: many starts, each followed to its local optimum and built."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ori_deploy.design import ConeStructure, Embedding, Structure, build, build_cone, embed, embed_cone
from ori_deploy.errors import CellError, LayoutError
from ori_deploy.layout import Layout
from ori_deploy.profiles import Cone, Profile
from ori_deploy.profiles.profile import Reals
from ori_deploy.search.box import BoxProblem
from ori_deploy.search.problem import Problem
from ori_deploy.search.shortfall import PLACES, UNSPOKEN, no_structure
from ori_deploy.search.sqp import Local, minimise
from ori_deploy.search.stack import Stack
from ori_deploy.search.starts import start_for
from ori_deploy.search.wish import UnmetPinError, Wish

_ON_BOUND = 1e-6
"""Distance from a bound, radians or over the size, at which it counts as active."""

_FAR = 0.1
"""Part of an eta by which it is missed where it counts as far out of reach."""

_ASTRAY = 0.01
"""Violation, radians or over the size, beyond which a search has gone astray rather than missed narrowly."""

_ROUGHLY = 1e-4
_ROUGH_STEPS = 40
"""How far eta is brought before a wall is made thicker: more would be undone."""

_PIN_STEPS = 40
_PINNED = 1e-12


@dataclass(frozen=True)
class Solution:
    """A local optimum, built.

    Attributes
    ----------
    structure
        What was found.
    start
        Number of the start that led to it.
    active
        Bounds that hold it back, for people.
    iterations
        Models the local search solved.
    settled
        Whether the local search came to rest.
    """

    structure: Structure | ConeStructure
    start: int
    active: tuple[str, ...]
    iterations: int
    settled: bool

    @property
    def eta(self) -> float:
        return self.structure.eta

    @property
    def cylinder(self) -> Structure:
        """The structure of a search on a profile of the plane."""
        if not isinstance(self.structure, Structure):
            raise TypeError("a cone's solution has no plane structure")
        return self.structure


def solve(
    profile: Profile | Cone,
    layout: Layout,
    wall_m: float,
    wish: Wish | None = None,
    *,
    start: int | Embedding = 0,
    seed: int = 0,
    tolerance: float = 1e-9,
    most_iterations: int = 120,
) -> Solution:
    """The local optimum that one start leads to.

    Parameters
    ----------
    profile, layout, wall_m
        What on what, and the least wall offset, metres; on a cone radians, as all of its lengths.
    wish
        What to look for; the largest eta where left out.
    start
        Number of a start (`starts.start_for`), or an embedding to begin with; of a cone one on its base.
    seed
        Of what is drawn for numbered starts.
    tolerance, most_iterations
        Of the local search.

    Raises
    ------
    LayoutError
        A wish that no start can fulfil: unknown names, places off the outline, bounds beyond all sense.
    UnmetPinError
        Pins cannot be made to hold from this start; where from none, they contradict each other.
    CellError
        No structure near this start: says which condition fails, a `NoStructureError` by how much.
    """
    wish = wish or Wish()
    cone = profile if isinstance(profile, Cone) else None
    plane = profile.base if isinstance(profile, Cone) else profile
    wish.check(layout, profile)
    if wish.objective == "box_ratio":
        Stack(layout)  # refuses what does not fold flat before anything is searched
    begin = start if isinstance(start, Embedding) else start_for(plane, layout, wish, start, seed)
    number = -1 if isinstance(start, Embedding) else start
    name = "the places given" if number < 0 else f"start {number}"
    # Small matrices: threads of the linear algebra library only get into each other's way.
    # Trial steps may leave every structure behind; what is not a number there is refused by the search.
    with threadpool_limits(1, user_api="blas"), np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        placed = on_pins(begin, wish)
        if wish.objective == "wall":
            placed = _roomy(placed, wall_m, wish, cone)
        problem = Problem(placed, wall_m, wish, cone)
        found = minimise(problem, tolerance=tolerance, most_iterations=most_iterations)
        if wish.objective == "box_ratio" and found is not None and found.feasible:
            # The most material saved is where the smallest box is looked for: it cannot get any larger then.
            problem = BoxProblem(on_pins(problem.embedding(found.x), wish, of=problem), wall_m, wish)
            found = minimise(problem, tolerance=tolerance, most_iterations=most_iterations)
        if found is None or not found.feasible:
            raise no_structure(name, *_blamed(problem, found, tolerance, most_iterations))
        place = on_pins(problem.embedding(found.x), wish, of=problem)
        try:
            thick = float(found.x[problem.unknowns.wall]) * problem.size if wish.objective == "wall" else wall_m
            structure = finished(place, thick, cone)
        except LayoutError as wrong:  # vertices have wandered out of the profile or past each other
            raise CellError(
                f"{name}: {wrong.thing}", value=wrong.value, limit=wrong.limit, remedy=wrong.remedy
            ) from wrong
    return Solution(structure, number, active_bounds(problem, found.x, structure), found.iterations, found.settled)


def _blamed(
    problem: Problem, found: Local | None, tolerance: float, most_iterations: int
) -> tuple[Problem, Reals | None]:
    """The problem to tell a failure of, and where it ended.

    A thickest wall for an eta that is far out of reach misses many conditions alike: what tells is the
    largest eta without any wall.
    """
    wish = problem.wish
    values = None if found is None else problem.values(found.x)
    far = values is not None and (
        values.violation > _ASTRAY or values.inequality[-1] < -_FAR / wish.eta_at_least
    )  # fmt: skip
    if wish.objective == "wall" and far:
        thin = minimise(
            Problem(problem.start, 0.0, replace(wish, objective="eta"), problem.cone),
            tolerance=tolerance, most_iterations=most_iterations,
        )  # fmt: skip
        if thin is not None and thin.feasible and thin.values.objective > 1.0 / wish.eta_at_least:
            bare = Problem(problem.start, 0.0, wish, problem.cone)
            return bare, thin.x
    return problem, None if found is None else found.x


def _roomy(place: Embedding, wall_m: float, wish: Wish, cone: Cone | None) -> Embedding:
    """Places with much eta to spare at the wall given, from which a wall can grow; the same where there are none."""
    problem = Problem(place, wall_m, replace(wish, objective="eta"), cone)
    found = minimise(problem, tolerance=_ROUGHLY, most_iterations=_ROUGH_STEPS)
    if found is None or not found.feasible:
        return place
    return on_pins(problem.embedding(found.x), wish, of=problem)


def finished(place: Embedding, wall_m: float, cone: Cone | None = None) -> Structure | ConeStructure:
    """The structure at an embedding, with all the checks that a specification's goes through."""
    layout = place.layout
    outline = {v.id: float(place.s[i]) for i, v in enumerate(layout.vertices) if not v.inner}
    inner = {v.id: (float(place.z[i].real), float(place.z[i].imag)) for i, v in enumerate(layout.vertices) if v.inner}
    if cone is not None:
        return build_cone(embed_cone(cone, layout, outline, inner), wall_m)
    return build(embed(place.profile, layout, outline, inner), wall_m)


def on_pins(place: Embedding, wish: Wish, of: Problem | None = None) -> Embedding:
    """The nearest embedding on which all pins hold to `_PINNED`.

    Raises
    ------
    UnmetPinError
        They cannot from here: names those that do not.
    """
    if not wish.pins:
        return place
    problem = of or Problem(place, 0.0, wish)
    unknowns = problem.unknowns
    free = problem.free[: unknowns.count]
    x = unknowns.pack(place.s, place.z, 0.0)
    for _ in range(_PIN_STEPS):
        pins = problem.equations(x)
        value = np.array([p.value for p in pins])
        if not len(value) or np.abs(value).max() <= _PINNED:
            return problem.embedding(x)
        slope = np.array([p.slope for p in pins])[:, free]
        move = np.linalg.lstsq(slope, -value, rcond=1e-10)[0]
        x[free] += move * min(1.0, 0.2 / max(float(np.abs(move).max()), 1e-300))
    worst = int(np.argmax(np.abs(value)))
    # Where least squares comes to rest, what is left lies on the equations that contradict each other only.
    unmet = np.abs(value) > 1e-3 * np.abs(value).max()
    rivals = sorted({p.name for p, left in zip(pins, unmet, strict=True) if left and p.name != pins[worst].name})
    off_m = float(abs(value[worst])) * place.profile.size
    unmet_pin = UnmetPinError(
        f"pin {pins[worst].name}: cannot hold",
        value=f"{off_m:.3g} m off",
        limit="all pins hold at once" + (f", here with {', '.join(rivals)}" if rivals else ""),
        remedy="drop one of them, or place them where both can hold",
    )
    unmet_pin.off_m = off_m
    raise unmet_pin


def active_bounds(problem: Problem, x: Reals, structure: Structure | ConeStructure) -> tuple[str, ...]:
    """Bounds that the structure sits on."""
    values, names = problem.values(x), structure.layout.cell_ids
    found: list[str] = []
    if values is not None:
        for row, value in zip(problem.rows, values.inequality, strict=True):
            if row.kind == "eta" and value < _ON_BOUND:
                found.append(f"eta at least {problem.wish.eta_at_least:.6g}")
            elif row.kind not in UNSPOKEN and value < _ON_BOUND:
                found.append(f"{row.kind} of {names[row.cell]} at {PLACES[row.kind][row.corner]}")
        a, b = problem.order
        loop = [structure.layout.vertices[i].id for i in structure.layout.outline]
        for k in np.flatnonzero(a @ x + b < _ON_BOUND):
            found.append(f"distance of {loop[k]} and {loop[(k + 1) % len(loop)]}")
    if problem.wall_m > 0.0 and problem.wish.objective != "wall":
        found.append(f"wall {problem.wall_m:.4g} {problem.unit}")
    return tuple(found)
