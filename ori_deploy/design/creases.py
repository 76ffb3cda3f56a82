"""Opening creases: the paper's equations (1) and (2), for every kind of corner.

At each opening vertex two panels of a cell meet. "Before" is the one that arrives there
counter-clockwise, "after" the one that leaves. Each is straight (on an inner edge) or curved (on the
outline). The crease is the point of the outline where both have the same rim thickness.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from ori_deploy.design.crease_search import first_brackets, newton
from ori_deploy.design.embedding import Embedding
from ori_deploy.errors import CellError
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.tolerance import TOLERANCE

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Corners:
    """All opening corners of an embedding, two per cell (c, d), flattened to (2 n_cells,).

    Attributes
    ----------
    s_w, w
        The opening vertex.
    q_before, q_after
        Closing vertices at the far ends of the two panels.
    s_before, s_after
        Their parameters unrolled so that `s_before < s_w < s_after`; used only where curved.
    curved_before, curved_after
        Which panels lie on the outline.
    """

    s_w: Reals
    w: Points
    q_before: Points
    q_after: Points
    s_before: Reals
    s_after: Reals
    curved_before: Flags
    curved_after: Flags

    @cached_property
    def curved_index(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Corners whose panel before, and whose panel after, is curved."""
        return np.flatnonzero(self.curved_before), np.flatnonzero(self.curved_after)

    @cached_property
    def curved_q(self) -> Points:
        """Far ends of the curved panels: those before, then those after."""
        i, j = self.curved_index
        return np.concatenate([self.q_before[i], self.q_after[j]])

    @cached_property
    def curved_sign(self) -> Reals:
        """-1 for each curved panel before, 1 for each after."""
        i, j = self.curved_index
        return np.concatenate([np.full(len(i), -1.0), np.full(len(j), 1.0)])


@dataclass(frozen=True)
class OpeningCreases:
    """Creases q'2, q'4 of every cell, two per cell (c, d), flattened to (2 n_cells,).

    Attributes
    ----------
    s, z
        Parameter and place. `s` is unrolled beside the corner's `s_w`.
    rim
        Rim thickness h, metres.
    dip
        Depth to which a hollow outline sinks below the chord of a curved panel, metres.
    """

    s: Reals
    z: Points
    rim: Reals
    dip: Reals


def corners_of(e: Embedding) -> Corners:
    """The opening corners of an embedding."""
    q = e.layout.corners
    w, before, after = q[:, [1, 3]].ravel(), q[:, [0, 2]].ravel(), q[:, [2, 0]].ravel()
    s_w = e.s[w]
    period = e.profile.period
    return Corners(
        s_w=s_w,
        w=e.z[w],
        q_before=e.z[before],
        q_after=e.z[after],
        s_before=s_w - (s_w - e.s[before]) % period,
        s_after=s_w + (e.s[after] - s_w) % period,
        curved_before=e.curved[:, [0, 2]].ravel(),
        curved_after=e.curved[:, [1, 3]].ravel(),
    )


def _straight_rim(corner: Corners, f: Points, df: Points) -> tuple[Reals, Reals, Reals, Reals]:
    """Distance of `f` from the two inner edges' lines, inwards positive, and its derivatives."""
    edge_before, edge_after = corner.w - corner.q_before, corner.q_after - corner.w
    before, after = np.conj(edge_before / np.abs(edge_before)), np.conj(edge_after / np.abs(edge_after))
    out = f - corner.w
    return (before * out).imag, (before * df).imag, (after * out).imag, (after * df).imag


def _curved_rim(
    profile: Profile, q: Points, sign: Reals, start: Reals, stop: Reals, f: Points, df: Points
) -> tuple[Reals, Reals]:
    """Largest outward distance of the outline from the chord f-q, and its derivative in `f`'s parameter.

    `sign` is 1 where `q` comes after, -1 where it comes before. The derivative follows from the
    envelope theorem: the place of the maximum may be held fixed.
    """
    chord = sign * (q - f)
    length = np.abs(chord)
    length[length == 0.0] = np.inf
    u = chord / length
    height, where = profile.extreme(start, stop, q, -1j * u)
    turn = (np.conj(u) * df).imag * -sign / length
    return height, (np.conj(u) * (where - q)).real * turn


def rim_thicknesses(profile: Profile, corner: Corners, s: Reals) -> tuple[Reals, Reals, Reals, Reals]:
    """Rim thickness of both panels of each corner for a crease at `s`.

    Returns
    -------
    before, after, and their derivatives in `s`; (n,) each, metres.
    """
    f, df = profile.evaluate(s, 1)
    before, d_before, after, d_after = _straight_rim(corner, f, df)
    i, j = corner.curved_index
    k = np.concatenate([i, j])
    if len(k):
        start = np.concatenate([corner.s_before[i], s[j]])
        stop = np.concatenate([s[i], corner.s_after[j]])
        height, slope = _curved_rim(profile, corner.curved_q, corner.curved_sign, start, stop, f[k], df[k])
        before[i], after[j] = height[: len(i)], height[len(i) :]
        d_before[i], d_after[j] = slope[: len(i)], slope[len(i) :]
    return before, after, d_before, d_after


def opening_creases(e: Embedding, corner: Corners) -> OpeningCreases:
    """Solve (1) and (2) at every corner: rim thickness before = rim thickness after.

    Raises
    ------
    CellError
        No root: the corner at the opening vertex is not convex.
    """
    profile = e.profile
    s, before, after = crease_roots(profile, corner)
    lost = np.flatnonzero(~(np.abs(before - after) <= 100.0 * TOLERANCE.root * profile.size))
    if len(lost):
        k = int(lost[0])
        _refuse(
            e,
            k,
            "no place on the outline gives its two panels the same rim thickness",
            f"difference {float(abs(before[k] - after[k])):.3g} m",
            "equal rim thicknesses (1), (2)",
        )
    rim = np.maximum(0.5 * (before + after), 0.0)
    z = profile.point(s)
    if profile.is_convex:
        return OpeningCreases(s, z, rim, np.zeros_like(rim))
    _check_overhang(e, corner, s, rim)
    return OpeningCreases(s, z, rim, _dips(profile, corner, s, z))


def crease_roots(profile: Profile, corner: Corners, guess: Reals | None = None) -> tuple[Reals, Reals, Reals]:
    """Where the outline gives both panels of each corner the same rim thickness.

    The difference is at most 0 at the lower end of the bracket and at least 0 at the upper one. Of
    several roots the one nearest the opening vertex is taken, or the one a guess leads to.

    Parameters
    ----------
    profile, corner
        The embedding's.
    guess
        (2 n_cells,) parameters near the roots, where they are known.

    Returns
    -------
    s and the rim thicknesses before and after at it; (2 n_cells,) each. They differ where there is no root.
    """
    lo = np.where(corner.curved_before, corner.s_before, corner.s_w)
    hi = np.where(corner.curved_after, corner.s_after, corner.s_w)
    rims = partial(rim_thicknesses, profile, corner)
    floor, close = 4.0 * np.finfo(float).eps * profile.period, 0.02 * TOLERANCE.root * profile.size
    if guess is not None:
        return newton(rims, lo, hi, np.clip(guess, lo, hi), floor, close)
    before, after, d_before, d_after = rims(corner.s_w)
    at_w, slope = before - after, d_before - d_after
    at_w[np.abs(at_w) <= TOLERANCE.root * profile.size] = 0.0
    forward = at_w < 0.0
    lo, hi = np.where(forward, corner.s_w, lo), np.where(forward, hi, corner.s_w)
    settled = at_w == 0.0
    lo[settled] = hi[settled] = corner.s_w[settled]
    if not profile.is_convex:
        lo, hi = first_brackets(rims, lo, hi, forward)
    start = corner.s_w - at_w / np.where(slope > 0.0, slope, 1.0)
    start = np.where((start >= lo) & (start <= hi) & (slope > 0.0), start, 0.5 * (lo + hi))
    return newton(rims, lo, hi, start, floor, close)


def _curved_spans(
    corner: Corners, s: Reals, z: Points
) -> list[tuple[NDArray[np.intp], Reals, Reals, Points, Points]]:
    """(corner numbers, start, stop, chord's far end, outward normal) of the curved panels, before and after."""
    spans = []
    for flags, q, s_q, sign in (
        (corner.curved_before, corner.q_before, corner.s_before, -1.0),
        (corner.curved_after, corner.q_after, corner.s_after, 1.0),
    ):
        k = np.flatnonzero(flags)
        chord = sign * (q[k] - z[k])
        start, stop = (s[k], s_q[k]) if sign > 0.0 else (s_q[k], s[k])
        spans.append((k, start, stop, q[k], -1j * chord / np.abs(chord)))
    return spans


def _dips(profile: Profile, corner: Corners, s: Reals, z: Points) -> Reals:
    dip = np.zeros(len(s))
    for k, start, stop, q, normal in _curved_spans(corner, s, z):
        if len(k):
            dip[k] = np.maximum(dip[k], profile.extreme(start, stop, q, -normal)[0])
    return dip


def _check_overhang(e: Embedding, corner: Corners, s: Reals, rim: Reals) -> None:
    """A straight panel's piece of outline from the opening vertex to the crease keeps within its rim."""
    slack = 100.0 * TOLERANCE.root * e.profile.size
    for flags, edge, start, stop in (
        (~corner.curved_before, corner.w - corner.q_before, corner.s_w, s),
        (~corner.curved_after, corner.q_after - corner.w, s, corner.s_w),
    ):
        k = np.flatnonzero(flags & (stop > start))
        if not len(k):
            continue
        inward = 1j * edge[k] / np.abs(edge[k])
        over = e.profile.extreme(start[k], stop[k], corner.w[k], inward)[0] - rim[k]
        under = e.profile.extreme(start[k], stop[k], corner.w[k], -inward)[0]
        worst = np.maximum(over, under)
        if (worst > slack).any():
            j = int(np.argmax(worst))
            _refuse(
                e,
                int(k[j]),
                "the outline beside the inner edge is thicker than the panel's rim",
                f"{float(worst[j]):.3g} m more",
                "at most the rim thickness, and inside the cell",
            )


def _refuse(e: Embedding, corner: int, what: str, value: str, limit: str) -> None:
    cell, which = divmod(corner, 2)
    vertex = e.layout.vertices[e.layout.corners[cell, 1 + 2 * which]].id
    raise CellError(
        f"cell {e.layout.cell_ids[cell]}, opening vertex {vertex}: {what}",
        value=value,
        limit=limit,
        remedy=f"move {vertex} or its neighbours so that the cell's corner there is convex",
    )
