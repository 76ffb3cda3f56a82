"""Where a search begins: layouts laid onto profiles, evenly or by chance."""

from __future__ import annotations

import numpy as np

from ori_deploy.design import Embedding
from ori_deploy.layout import Layout
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.search.measures import Unknowns
from ori_deploy.search.wish import Wish
from ori_deploy.tolerance import TOLERANCE

_TURNS = 48
"""Turns of a start round the outline that are compared."""

_AS_GOOD = 0.05
"""Distance from holding, over the size, by which a turn may be worse than the best and still be begun from."""

_EVEN_STARTS = 2
"""Starts that are evenly spaced, turned against each other, before chance takes over."""


def start_for(profile: Profile, layout: Layout, wish: Wish, start: int, seed: int = 0) -> Embedding:
    """A numbered start, turned round the outline to where its pins are nearest to holding.

    Pins can ask for places that a local search cannot turn to: a spar whose ends both begin on the upper
    skin. Where several turns suit them equally well, starts take these by turns.
    """
    begin = start_embedding(profile, layout, start, seed)
    if not wish.pins:
        return begin
    unknowns = Unknowns(profile, layout)
    places = [start_embedding(profile, layout, start, seed, k / _TURNS) for k in range(_TURNS)]
    off = np.array([_off(unknowns, wish, place) for place in places])
    valleys = np.flatnonzero((off <= np.roll(off, 1)) & (off < np.roll(off, -1)))
    if not len(valleys):
        return begin
    ranked = valleys[np.argsort(off[valleys], kind="stable")]
    suited = ranked[off[ranked] <= off[ranked[0]] + _AS_GOOD]
    return places[int(suited[start % len(suited)])]


def _off(unknowns: Unknowns, wish: Wish, place: Embedding) -> float:
    """How far pins are from holding, over the size."""
    x = unknowns.pack(place.s, place.z, 0.0)
    return float(np.linalg.norm([e.value for e in wish.equations(unknowns, x, place.z)]))


def start_embedding(profile: Profile, layout: Layout, start: int, seed: int = 0, turned: float = 0.0) -> Embedding:
    """A layout laid onto a profile; not checked, a search repairs it.

    Parameters
    ----------
    profile, layout
        What on what.
    start
        0, 1: evenly along the outline, half a step apart; beyond: shares and turn drawn at random.
    seed
        Of what is drawn.
    turned
        By which share of the outline's natural parameter it is turned further.
    """
    loop = np.array(layout.outline)
    n = len(loop)
    generator = np.random.default_rng((seed, start))
    if start < _EVEN_STARTS:
        share, turn = np.full(n, 1.0 / n), 0.5 * start / n
    else:
        share = generator.dirichlet(np.full(n, 6.0))
        turn = float(generator.random())
    at = (turn + turned + np.cumsum(share) - share) % 1.0
    s = np.full(len(layout.vertices), np.nan)
    s[loop] = [_at(profile, float(a)) for a in at]
    s = _with_corners(profile, layout, s)
    return with_inner_vertices(profile, layout, s)


def _at(profile: Profile, share: float) -> float:
    """Parameter at a share of the outline's natural parameter: evenly spread angles on an ellipse."""
    return profile.at_natural(2.0 * np.pi * share)


def _with_corners(profile: Profile, layout: Layout, s: Reals) -> Reals:
    """The nearest closing vertex moved into every sharp corner: no panel can be bent round one."""
    s = s.copy()
    loop = np.array(layout.outline)
    closing = np.array([layout.vertices[i].role == "closing" for i in loop])
    taken: set[int] = set()
    for corner in _sharp(profile):
        away = (s[loop] - corner + 0.5 * profile.period) % profile.period - 0.5 * profile.period
        candidates = [k for k in np.flatnonzero(closing) if k not in taken]
        if not candidates:
            break
        k = int(min(candidates, key=lambda i: float(abs(away[i]))))
        taken.add(k)
        # Turn all of them so that this one arrives, when it is the first; later ones move alone.
        if len(taken) == 1:
            s[loop] -= away[k]
        s[loop[k]] = corner
    return _in_order(profile, loop, s)


def _sharp(profile: Profile) -> Reals:
    """Parameters of corners that turn by more than `Tolerance.corner_rad`, outwards."""
    before, after = profile.tangents(profile.corners)
    turn = np.angle(after / before)
    return profile.corners[turn > TOLERANCE.corner_rad]


def _in_order(profile: Profile, loop: Reals, s: Reals) -> Reals:
    """Vertices that a moved one has passed are spread evenly between their neighbours again."""
    period = profile.period
    order = loop.astype(int)
    ahead = np.diff(s[order], append=s[order[0]]) % period
    if np.isclose(ahead.sum(), period, rtol=1e-6) and ahead.min() > 1e-3 * period:
        return s
    spread = s.copy()
    spread[order] = (s[order[0]] + np.arange(len(order)) * period / len(order)) % period
    return spread


def with_inner_vertices(profile: Profile, layout: Layout, s: Reals) -> Embedding:
    """The embedding with every inner vertex at the mean of its neighbours (Tutte)."""
    n = len(layout.vertices)
    inner = np.array([v.inner for v in layout.vertices])
    z: Points = np.zeros(n, dtype=complex)
    z[~inner] = profile.point(s[~inner])
    if inner.any():
        adjacent = np.zeros((n, n), dtype=bool)
        tail, head = layout.corners.ravel(), np.roll(layout.corners, -1, axis=1).ravel()
        adjacent[tail, head] = adjacent[head, tail] = True
        degree = adjacent.sum(axis=1)
        left = np.diag(degree[inner].astype(float)) - adjacent[np.ix_(inner, inner)]
        z[inner] = np.linalg.solve(left, adjacent[np.ix_(inner, ~inner)] @ z[~inner])
    return Embedding(profile, layout, s % profile.period, z)
