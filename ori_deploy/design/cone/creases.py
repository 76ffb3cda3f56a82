"""Opening creases of a cone's cells: the paper's equations (4) and (5), for every kind of corner.

As in the plane (`design.creases`) a crease is the place on the outline where its two panels have the
same rim thickness. Here a thickness is an angle seen from the crease: that by which a great circle
has to be tilted, about the points 90 degrees from the crease, from the panel's inner face to its rim.
Folded, both panels of a crease share these points and their inner face, so equal angles are the same
great circle: the curved panel just touches the bond plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from ori_deploy.design.cone.embedding import ConeEmbedding
from ori_deploy.design.crease_search import first_brackets, newton
from ori_deploy.errors import CellError
from ori_deploy.profiles.cone import Cone
from ori_deploy.profiles.profile import Reals
from ori_deploy.profiles.sphere import Vectors, cross, dot, length, unit
from ori_deploy.tolerance import TOLERANCE

Flags = NDArray[np.bool_]
_ROUNDING = 1e-15
"""A few roundings of a unit vector's coordinates, radians: they do not shrink with the cone."""


@dataclass(frozen=True)
class ConeCorners:
    """All opening corners of an embedding, two per cell (c, d), flattened to (2 n_cells,).

    "Before" is the panel that arrives at the opening vertex counter-clockwise, "after" the one that leaves.

    Attributes
    ----------
    s_w, w
        The opening vertex: parameter and unit vector.
    q_before, q_after
        Closing vertices at the far ends of the two panels, unit vectors.
    s_before, s_after
        Their parameters unrolled so that `s_before < s_w < s_after`; used only where curved.
    curved_before, curved_after
        Which panels lie on the outline.
    """

    s_w: Reals
    w: Vectors
    q_before: Vectors
    q_after: Vectors
    s_before: Reals
    s_after: Reals
    curved_before: Flags
    curved_after: Flags


@dataclass(frozen=True)
class ConeCreases:
    """Opening creases of every cell, two per cell (c, d), flattened to (2 n_cells,).

    Attributes
    ----------
    s, u
        Parameter and unit vector. `s` is unrolled beside the corner's `s_w`.
    rim
        Rim thickness h, radians.
    dip
        Angle to which a hollow outline sinks below the chord of a curved panel, radians.
    """

    s: Reals
    u: Vectors
    rim: Reals
    dip: Reals


def negligible(cone: Cone) -> float:
    """Angle that counts as none on a cone, radians: the plane's relative one, but not less than rounding."""
    return max(TOLERANCE.root * cone.size, _ROUNDING)


def corners_of(e: ConeEmbedding) -> ConeCorners:
    """The opening corners of an embedding."""
    q = e.layout.corners
    w, before, after = q[:, [1, 3]].ravel(), q[:, [0, 2]].ravel(), q[:, [2, 0]].ravel()
    s_w, period = e.s[w], e.profile.period
    return ConeCorners(
        s_w=s_w,
        w=e.u[w],
        q_before=e.u[before],
        q_after=e.u[after],
        s_before=s_w - (s_w - e.s[before]) % period,
        s_after=s_w + (e.s[after] - s_w) % period,
        curved_before=e.curved[:, [0, 2]].ravel(),
        curved_after=e.curved[:, [1, 3]].ravel(),
    )


def face_poles(corner: ConeCorners, c: Vectors) -> tuple[Vectors, Vectors]:
    """Poles, at right angles to the crease `c` and towards the void, of the inner faces before and after.

    A curved panel's inner face is its chord. A straight one's is the great circle through the crease
    whose pole there is the way from the bond plane.
    """
    bond_before, bond_after = cross(corner.q_before, corner.w), cross(corner.w, corner.q_after)
    before = np.where(corner.curved_before[:, None], cross(corner.q_before, c), _square_to(c, bond_before))
    after = np.where(corner.curved_after[:, None], cross(c, corner.q_after), _square_to(c, bond_after))
    return unit(before), unit(after)


def _square_to(c: Vectors, n: Vectors) -> Vectors:
    """What remains of `n` at right angles to the unit vector `c`."""
    return n - dot(n, c)[..., None] * c


def _straight_rim(q: Vectors, w: Vectors, g: Vectors, dg: Vectors) -> tuple[Reals, Reals]:
    """Arc from `g` to the bond plane, which runs from `q` to `w` with the cell on its left, and its derivative."""
    normal = unit(cross(q, w))
    sine = dot(normal, g)
    cosine = np.sqrt(np.maximum(1.0 - sine * sine, 1e-300))
    return np.arctan2(sine, cosine), dot(normal, dg) / cosine


def _curved_rim(
    cone: Cone, q: Vectors, sign: float, start: Reals, stop: Reals, c: Vectors, dc: Vectors
) -> tuple[Reals, Reals]:
    """Largest angle, seen from the crease `c`, of the outline over the chord c-q, and its derivative.

    `sign` is 1 where `q` comes after, -1 where it comes before. The derivative follows from the envelope
    theorem: the place of the maximum may be held fixed.
    """
    chord = -sign * cross(c, q)
    size = length(chord)
    size = np.where(size > 0.0, size, np.inf)[:, None]
    out = chord / size
    height, where = cone.steepest(start, stop, c, out)
    moved = -sign * cross(dc, q) / size
    moved = moved - dot(moved, out)[:, None] * out
    over, along = dot(out, where), dot(c, where)
    turn = (along * dot(moved, where) - over * dot(dc, where)) / (over * over + along * along)
    return height, turn


def rim_thicknesses(cone: Cone, corner: ConeCorners, s: Reals) -> tuple[Reals, Reals, Reals, Reals]:
    """Rim thickness of both panels of each corner for a crease at `s`.

    Returns
    -------
    before, after, and their derivatives in `s`; (n,) each, radians.
    """
    g, dg = cone.evaluate(s, 1)
    before, d_before = _straight_rim(corner.q_before, corner.w, g, dg)
    after, d_after = _straight_rim(corner.w, corner.q_after, g, dg)
    for flags, rim, slope, q, sign in (
        (corner.curved_before, before, d_before, corner.q_before, -1.0),
        (corner.curved_after, after, d_after, corner.q_after, 1.0),
    ):
        k = np.flatnonzero(flags)
        if len(k):
            start, stop = (corner.s_before[k], s[k]) if sign < 0.0 else (s[k], corner.s_after[k])
            rim[k], slope[k] = _curved_rim(cone, q[k], sign, start, stop, g[k], dg[k])
    return before, after, d_before, d_after


def opening_creases(e: ConeEmbedding, corner: ConeCorners) -> ConeCreases:
    """Solve (4) and (5) at every corner: rim thickness before = rim thickness after.

    Raises
    ------
    CellError
        No root: the corner at the opening vertex is not convex, or a panel is a quarter circle long.
    """
    cone = e.profile
    s, before, after = crease_roots(cone, corner)
    lost = np.flatnonzero(~(np.abs(before - after) <= 100.0 * negligible(cone)))
    if len(lost):
        k = int(lost[0])
        _refuse(
            e,
            k,
            "no place on the outline gives its two panels the same rim thickness",
            f"difference {float(abs(before[k] - after[k])):.3g} rad",
            "equal rim thicknesses (4), (5)",
        )
    u = cone.point(s)
    _refuse_long(e, corner, u)
    rim = np.maximum(0.5 * (before + after), 0.0)
    if cone.is_convex:
        return ConeCreases(s, u, rim, np.zeros_like(rim))
    _check_overhang(e, corner, s, u, rim)
    return ConeCreases(s, u, rim, _dips(cone, corner, s, u))


def crease_roots(cone: Cone, corner: ConeCorners, guess: Reals | None = None) -> tuple[Reals, Reals, Reals]:
    """Where the outline gives both panels of each corner the same rim thickness.

    The difference is at most 0 at the lower end of the bracket and at least 0 at the upper one. Of
    several roots the one nearest the opening vertex is taken, or the one a guess leads to.

    Parameters
    ----------
    cone, corner
        The embedding's.
    guess
        (2 n_cells,) parameters near the roots, where they are known.

    Returns
    -------
    s and the rim thicknesses before and after at it; (2 n_cells,) each. They differ where there is no root.
    """
    small = negligible(cone)
    lo = np.where(corner.curved_before, corner.s_before, corner.s_w)
    hi = np.where(corner.curved_after, corner.s_after, corner.s_w)
    rims = partial(rim_thicknesses, cone, corner)
    floor, close = 4.0 * np.finfo(float).eps * cone.period, 0.02 * small
    if guess is not None:
        return newton(rims, lo, hi, np.clip(guess, lo, hi), floor, close)
    before, after, _, _ = rims(corner.s_w)
    at_w = before - after
    at_w[np.abs(at_w) <= small] = 0.0
    forward = at_w < 0.0
    lo, hi = np.where(forward, corner.s_w, lo), np.where(forward, hi, corner.s_w)
    settled = at_w == 0.0
    lo[settled] = hi[settled] = corner.s_w[settled]
    if not cone.is_convex:
        lo, hi = first_brackets(rims, lo, hi, forward)
    return newton(rims, lo, hi, 0.5 * (lo + hi), floor, close)


def _dips(cone: Cone, corner: ConeCorners, s: Reals, u: Vectors) -> Reals:
    dip = np.zeros(len(s))
    for flags, pole, start, stop in (
        (corner.curved_before, face_poles(corner, u)[0], corner.s_before, s),
        (corner.curved_after, face_poles(corner, u)[1], s, corner.s_after),
    ):
        k = np.flatnonzero(flags)
        if len(k):
            dip[k] = np.maximum(dip[k], cone.steepest(start[k], stop[k], u[k], pole[k])[0])
    return dip


def _refuse_long(e: ConeEmbedding, corner: ConeCorners, u: Vectors) -> None:
    """Great circles a thickness apart meet 90 degrees from the crease: a panel has to end before."""
    along = np.stack([dot(corner.q_before, u), dot(corner.q_after, u)], axis=1)
    long = np.argwhere(~(along > TOLERANCE.dead_centre_rad))
    if len(long):
        k, side = (int(i) for i in long[0])
        _refuse(
            e,
            k,
            f"its panel {'before' if side == 0 else 'after'} is too long for a cone",
            f"{np.degrees(np.arccos(np.clip(along[k, side], -1.0, 1.0))):.4g} deg seen from the apex",
            "less than 90 deg from crease to closing vertex",
            "make the cone narrower or its cells smaller: great circles a thickness apart meet after 90 deg",
        )


def _check_overhang(e: ConeEmbedding, corner: ConeCorners, s: Reals, u: Vectors, rim: Reals) -> None:
    """A straight panel's piece of outline from the opening vertex to the crease keeps within its rim."""
    slack = 100.0 * negligible(e.profile)
    poles = face_poles(corner, u)
    bonds = unit(cross(corner.q_before, corner.w)), unit(cross(corner.w, corner.q_after))
    for flags, pole, bond, start, stop in (
        (~corner.curved_before, poles[0], bonds[0], corner.s_w, s),
        (~corner.curved_after, poles[1], bonds[1], s, corner.s_w),
    ):
        k = np.flatnonzero(flags & (stop > start))
        if not len(k):
            continue
        over = e.profile.extreme(start[k], stop[k], pole[k])[0]
        under = e.profile.extreme(start[k], stop[k], -bond[k])[0]
        worst = np.maximum(over, under)
        if (worst > slack).any():
            j = int(np.argmax(worst))
            _refuse(
                e,
                int(k[j]),
                "the outline beside the inner edge is thicker than the panel's rim",
                f"{float(worst[j]):.3g} rad more than {float(rim[k[j]]):.3g} rad",
                "at most the rim thickness, and inside the cell",
            )


def _refuse(e: ConeEmbedding, corner: int, what: str, value: str, limit: str, remedy: str = "") -> NoReturn:
    cell, which = divmod(corner, 2)
    vertex = e.layout.vertices[e.layout.corners[cell, 1 + 2 * which]].id
    raise CellError(
        f"cell {e.layout.cell_ids[cell]}, opening vertex {vertex}: {what}",
        value=value,
        limit=limit,
        remedy=remedy or f"move {vertex} or its neighbours so that the cell's corner there is convex",
    )
