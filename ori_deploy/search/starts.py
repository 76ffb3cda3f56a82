"""Where a search begins: layouts laid onto profiles, evenly or by chance."""

from __future__ import annotations

import numpy as np

from ori_deploy.design import Embedding
from ori_deploy.layout import Layout
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.tolerance import TOLERANCE

_EVEN_STARTS = 2
"""Starts that are evenly spaced, turned against each other, before chance takes over."""


def start_embedding(profile: Profile, layout: Layout, start: int, seed: int = 0) -> Embedding:
    """A layout laid onto a profile; not checked, a search repairs it.

    Parameters
    ----------
    profile, layout
        What on what.
    start
        0, 1: evenly along the outline, half a step apart; beyond: shares and turn drawn at random.
    seed
        Of what is drawn.
    """
    loop = np.array(layout.outline)
    n = len(loop)
    generator = np.random.default_rng((seed, start))
    if start < _EVEN_STARTS:
        share, turn = np.full(n, 1.0 / n), 0.5 * start / n
    else:
        share = generator.dirichlet(np.full(n, 6.0))
        turn = float(generator.random())
    at = (turn + np.cumsum(share) - share) % 1.0
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
