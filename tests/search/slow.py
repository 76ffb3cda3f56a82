"""A second, slow, independent optimiser: knows only `build`, and tries places by chance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import differential_evolution, minimize

from ori_deploy.design import Embedding, Structure, build, embed
from ori_deploy.errors import InputError
from ori_deploy.layout import Layout
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Reals
from ori_deploy.search import Wish

_NONE = 10.0
"""What a place costs where nothing can be built: more than the material of any structure."""


def laid(profile: Profile, layout: Layout, x: Reals) -> Embedding:
    """Inner places (x, y over the size), then outline parameters over the period, in the order of vertices."""
    inner = [v.id for v in layout.vertices if v.inner]
    outline = [v.id for v in layout.vertices if not v.inner]
    places = x[: 2 * len(inner)].reshape(-1, 2) * profile.size
    return embed(
        profile,
        layout,
        dict(zip(outline, x[2 * len(inner) :] * profile.period, strict=True)),
        {name: (float(p[0]), float(p[1])) for name, p in zip(inner, places, strict=True)},
    )


def unlaid(place: Embedding) -> Reals:
    """The numbers `laid` takes."""
    inner = np.array([v.inner for v in place.layout.vertices])
    z = place.z[inner] / place.profile.size
    return np.concatenate([np.stack([z.real, z.imag], axis=1).ravel(), place.s[~inner] / place.profile.period])


def cost(profile: Profile, layout: Layout, wall_m: float, wish: Wish) -> Callable[[Reals], float]:
    """Material over area, plus a penalty where a bound is not kept."""

    def of(x: Reals) -> float:
        try:
            structure = build(laid(profile, layout, x), wall_m)
        except InputError:
            return _NONE
        return 1.0 / structure.eta + 10.0 * broken(structure, wish)

    return of


def broken(structure: Structure, wish: Wish) -> float:
    """How far the dead-centre margin falls short, radians."""
    return max(wish.margin_rad - float(structure.cells.dead_centre_margin.min()), 0.0)


def polished(place: Embedding, wall_m: float, wish: Wish, tries: int, step: float, still: Reals) -> float:
    """The best eta that a simplex search finds about a place; `still` marks unknowns that stay."""
    of = cost(place.profile, place.layout, wall_m, wish)
    x0 = unlaid(place)
    moves = np.flatnonzero(~still.astype(bool))

    def part(y: Reals) -> float:
        x = x0.copy()
        x[moves] = y
        return of(x)

    simplex = np.tile(x0[moves], (len(moves) + 1, 1))
    simplex[1:] += step * np.random.default_rng(3).normal(size=(len(moves), len(moves)))
    found = minimize(part, x0[moves], method="Nelder-Mead", options={"maxfev": tries, "initial_simplex": simplex})
    return 1.0 / float(found.fun)


def evolved(
    profile: Profile, layout: Layout, wall_m: float, wish: Wish, first: Reals, fixed: dict[int, float], rounds: int
) -> float:
    """The best eta of an evolution over everything: turns and steps along the outline, and the inner vertex."""
    of = cost(profile, layout, wall_m, wish)
    n = len(layout.outline)
    loop = np.array(layout.outline) - 1  # the inner vertex of a ring comes first

    def unfold(y: Reals) -> Reals:
        share = np.cumsum(y[2 : 2 + n] / y[2 : 2 + n].sum())
        x = np.empty(2 + n)
        x[:2] = y[:2]
        x[2 + loop] = (y[2 + n] + share) % 1.0
        for k, s in fixed.items():
            x[2:] = (x[2:] - x[k] + s) % 1.0
        return x

    low = np.array([-0.5, -0.3, *np.full(n, 0.2), 0.0])
    high = np.array([0.5, 0.3, *np.full(n, 1.8), 1.0])
    low[:2], high[:2] = first[:2] - 0.3, first[:2] + 0.3
    found = differential_evolution(
        lambda y: of(unfold(y)), list(zip(low, high, strict=True)), maxiter=rounds, seed=1, polish=False, tol=1e-10
    )
    again = minimize(
        lambda y: of(unfold(y)), found.x, method="Nelder-Mead",
        options={"maxfev": 40 * rounds, "xatol": 1e-9, "fatol": 1e-11, "adaptive": True},
    )  # fmt: skip
    return 1.0 / float(min(found.fun, again.fun))
