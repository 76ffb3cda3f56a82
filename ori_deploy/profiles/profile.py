"""What every target shape can be asked.

A point of the plane is one complex number inside this room and the rooms that compute with it: a
rotation is a product, a dot product `Re(conj(a) b)`, a cross product `Im(conj(a) b)`. Public
results for people and files are (…, 2) arrays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.errors import ProfileError

Reals = NDArray[np.float64]
Points = NDArray[np.complex128]
Side = Literal["upper", "lower"]

_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(10)
_GAUSS_NODES = 0.5 * (_GAUSS_NODES + 1.0)
_GAUSS_WEIGHTS = 0.5 * _GAUSS_WEIGHTS

_HALVINGS = 24
_LOOKED_AT = np.arange(1, 12) / 12.0
_MIDDLE = 5


def xy(points: Points) -> Reals:
    """(…,) complex points as a (…, 2) array."""
    return np.stack([points.real, points.imag], axis=-1)


class Profile(ABC):
    """A simple closed counter-clockwise curve `f(s)`, periodic in its parameter `s`.

    The curve is smooth between `breaks`. A table of samples seeds every query; the answers
    themselves are refined on the curve, so they do not depend on the table's resolution.

    Parameters
    ----------
    period
        Length of the parameter's range; `f(s + period) = f(s)`.
    breaks
        Increasing parameters in [0, period), the first 0, where a derivative may jump.
    resolution
        Least number of table samples over the whole outline.
    """

    def __init__(self, period: float, breaks: ArrayLike, resolution: int) -> None:
        self.period = float(period)
        self.breaks = np.asarray(breaks, dtype=float)
        ends = np.append(self.breaks, self.period)
        counts = np.maximum(np.ceil(resolution * np.diff(ends) / self.period), 2).astype(int)
        table = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(ends, ends[1:], counts, strict=False)]
        self.table_s: Reals = np.concatenate(table)
        self.table_f: Points = self._evaluate(self.table_s, 0)[0]
        if not np.isfinite(self.table_f).all():
            raise ProfileError("profile: a point of the outline is not a finite number", limit="finite coordinates")
        self._check_shape()
        # On a convex outline heights have one maximum: a coarse seed is as safe as a fine one.
        stride = max(1, len(self.table_s) // 128) if self.is_convex else 1
        keep = np.union1d(np.arange(0, len(self.table_s), stride), np.flatnonzero(np.isin(self.table_s, self.breaks)))
        self._s2 = np.concatenate([self.table_s[keep], self.table_s[keep] + self.period])
        self._xy2 = np.ascontiguousarray(xy(np.tile(self.table_f[keep], 2)).T)
        gap = np.diff(self.table_s[keep], append=self.period)
        self._gap2 = np.concatenate([gap[-1:], gap, gap])

    # --- what a shape defines -------------------------------------------------------------------

    @property
    @abstractmethod
    def kind(self) -> str:
        """Name of the family in a specification."""

    @abstractmethod
    def describe(self) -> dict[str, object]:
        """Plain data that makes this profile again (`profiles.from_description`); lengths in metres."""

    @abstractmethod
    def _evaluate(self, s: Reals, order: int) -> tuple[Points, ...]:
        """`f` and its first `order` (0 to 2) derivatives at `s` in [0, period]; right-hand ones at breaks."""

    # --- evaluation -----------------------------------------------------------------------------

    def evaluate(self, s: ArrayLike, order: int = 0) -> tuple[Points, ...]:
        """`f` and its first `order` derivatives with respect to `s`.

        Parameters
        ----------
        s
            Any shape; any real number (periodic).
        order
            0, 1 or 2.

        Returns
        -------
        tuple of complex arrays shaped like `s`, one per derivative from the 0th.
        """
        return self._evaluate(np.asarray(s, dtype=float) % self.period, order)

    def point(self, s: ArrayLike) -> Points:
        """`f(s)` as complex numbers, shaped like `s`."""
        return self.evaluate(s)[0]

    def tangents(self, s: ArrayLike) -> tuple[Points, Points]:
        """Unit tangents just before and just after each `s`: they differ at a corner."""
        step = 1e-7 * self.period
        around = np.asarray(s, dtype=float) + np.array([-step, step]).reshape((2,) + (1,) * np.ndim(s))
        along = self.evaluate(around, 1)[1]
        before, after = along / np.abs(along)
        return before, after

    # --- integrals along the outline --------------------------------------------------------------

    def _density(self, s: Reals) -> tuple[Reals, Reals]:
        f, df = self._evaluate(s, 1)
        return np.abs(df), 0.5 * (np.conj(f) * df).imag

    @cached_property
    def _cumulative(self) -> tuple[Reals, Reals]:
        """Length and swept area from s = 0 to each table sample and to the end; (n + 1,) each."""
        ends = np.append(self.table_s, self.period)
        width = np.diff(ends)
        length, area = self._density(self.table_s[:, None] + width[:, None] * _GAUSS_NODES)
        return (
            np.append(0.0, np.cumsum(width * (length @ _GAUSS_WEIGHTS))),
            np.append(0.0, np.cumsum(width * (area @ _GAUSS_WEIGHTS))),
        )

    def _primitive(self, s: ArrayLike) -> tuple[Reals, Reals]:
        """Length and swept area from 0 to `s`, continued beyond one turn."""
        s = np.asarray(s, dtype=float)
        turns = np.floor(s / self.period)
        local = s - turns * self.period
        index = np.clip(np.searchsorted(self.table_s, local, side="right") - 1, 0, len(self.table_s) - 1)
        start = self.table_s[index]
        width = local - start
        length, area = self._density(start[..., None] + width[..., None] * _GAUSS_NODES)
        total_length, total_area = self._cumulative
        return (
            total_length[index] + width * (length @ _GAUSS_WEIGHTS) + turns * total_length[-1],
            total_area[index] + width * (area @ _GAUSS_WEIGHTS) + turns * total_area[-1],
        )

    def swept_area(self, s: ArrayLike) -> Reals:
        """½∫(x dy − y dx) from 0 to `s`, square metres: the arc's share in an area by Green's theorem."""
        return self._primitive(s)[1]

    def arc_length(self, s: ArrayLike) -> Reals:
        """Length of the outline from 0 to `s`, metres."""
        return self._primitive(s)[0]

    @property
    def perimeter(self) -> float:
        """Length of the outline, metres."""
        return float(self._cumulative[0][-1])

    @property
    def area(self) -> float:
        """Area inside the outline, square metres."""
        return float(self._cumulative[1][-1])

    @cached_property
    def size(self) -> float:
        """Larger extent along x or y, metres: what relative tolerances refer to."""
        f = self.table_f
        return float(max(np.ptp(f.real), np.ptp(f.imag)))

    @cached_property
    def is_convex(self) -> bool:
        """Whether the outline turns left everywhere (to rounding)."""
        closed = np.append(self.table_f, self.table_f[:2])
        edge = np.diff(closed)
        turn = (np.conj(edge[:-1]) * edge[1:]).imag
        return bool((turn >= -1e-12 * self.size**2).all())

    # --- places on the outline --------------------------------------------------------------------

    def at_arc(self, fraction: float) -> float:
        """Parameter at a fraction of the outline's length from its start, counter-clockwise."""
        if not 0.0 <= fraction <= 1.0:
            raise ProfileError(
                "arc: not a fraction of the outline's length",
                value=fraction,
                limit="0 <= arc < 1",
                remedy="divide the distance along the outline by the perimeter",
            )
        target = fraction * self.perimeter
        lengths = self._cumulative[0]
        s = float(np.interp(target, lengths, np.append(self.table_s, self.period)))
        for _ in range(4):
            speed = float(abs(self.evaluate(s, 1)[1]))
            if speed == 0.0:
                break
            s -= (float(self.arc_length(s)) - target) / speed
        return s % self.period

    def at_natural(self, angle: float) -> float:
        """Parameter at natural angle `angle`, radians: here `2 pi` times the fraction of the length."""
        return self.at_arc((angle / (2.0 * np.pi)) % 1.0)

    def at_chord(self, x_chord: float, side: Side) -> float:
        """Parameter at `x / chord` on the upper or lower side; airfoils only."""
        del side
        raise ProfileError(
            f"x_chord: a {self.kind} profile has no upper and lower side",
            value=x_chord,
            limit="naca and points profiles only",
            remedy="use arc, or angle_rad on ellipses and superellipses",
        )

    # --- extremes and samples -----------------------------------------------------------------------

    def extreme(self, start: Reals, stop: Reals, origin: Points, direction: Points) -> tuple[Reals, Points]:
        """Largest `Re(conj(direction) (f(s) - origin))` over `start <= s <= stop`, many at once.

        Parameters
        ----------
        start, stop
            (n,) parameters, `start <= stop <= start + period`.
        origin, direction
            (n,) points and unit vectors.

        Returns
        -------
        (n,) largest values and the points where they are taken.
        """
        shift = np.floor(start / self.period) * self.period
        lo, hi = start - shift, stop - shift
        height = direction.view(np.float64).reshape(-1, 2) @ self._xy2
        height[(self._s2 < lo[:, None]) | (self._s2 > hi[:, None])] = -np.inf
        best = height.argmax(axis=1)
        s = self._s2[best]
        # Where no sample lies inside, the arc is shorter than the table's step.
        s = np.where((s < lo) | (s > hi), 0.5 * (lo + hi), s)
        left, right = s - self._gap2[best], s + self._gap2[best + 1]
        part = hi - lo < self.period * (1.0 - 1e-12)
        left, right = np.where(part, np.maximum(lo, left), left), np.where(part, np.minimum(hi, right), right)
        conj = np.conj(direction)
        f, df = self.evaluate(np.array((lo, hi, left, right)), 1)
        slope = (conj * df[2:]).real
        points = np.array([*f, self._summit(s, left, right, conj, (slope[0] > 0.0) & (slope[1] < 0.0))])
        value = (conj * (points - origin)).real
        pick = value.argmax(axis=0)
        columns = np.arange(len(best))
        return value[pick, columns], points[pick, columns]

    def _summit(self, s: Reals, left: Reals, right: Reals, conj: Points, busy: NDArray[np.bool_]) -> Points:
        """Where heights are largest inside brackets: Newton's method, halving where it does not pay.

        Brackets that are not `busy` have their maximum at an end and keep their seed.
        """
        good_enough = 1e-15 * self.size
        previous = np.full(len(s), np.inf)
        for _ in range(60):
            f, df, ddf = self.evaluate(s, 2)
            slope, bend = (conj * df).real, (conj * ddf).real
            rising = slope > 0.0
            left, right = np.where(rising, s, left), np.where(rising, right, s)
            steep = np.abs(slope)
            # In a bracket round a maximum, slope times width bounds what the height can still gain.
            busy = busy & (steep * (right - left) > good_enough)
            if not busy.any():
                break
            bend[bend >= 0.0] = -np.inf
            new = s - slope / bend
            pays = (new > left) & (new < right) & (steep <= 0.5 * previous)
            s = np.where(busy, np.where(pays, new, 0.5 * (left + right)), s)
            previous = np.where(pays, steep, np.inf)
        return f

    @cached_property
    def _bend(self) -> tuple[Reals, Reals]:
        """Cumulative ∫ sqrt(|curvature|) dl at the table's samples: what equal sagittas divide equally."""
        ends = np.append(self.table_s, self.period)
        width = np.diff(ends)
        _, df, ddf = self._evaluate(self.table_s[:, None] + width[:, None] * _GAUSS_NODES, 2)
        speed = np.maximum(np.abs(df), 1e-300)
        density = np.sqrt(np.abs((np.conj(df) * ddf).imag) / speed)
        return ends, np.append(0.0, np.cumsum(width * (density @ _GAUSS_WEIGHTS)))

    @cached_property
    def corners(self) -> Reals:
        """Parameters where the outline turns by more than a thousandth of a degree at once."""
        before, after = self.tangents(self.breaks)
        return self.breaks[np.abs(np.angle(after / before)) > 2e-5]

    def sample(self, start: float, stop: float, sagitta: float) -> Points:
        """Points along `start <= s <= stop`, both ends and every corner included.

        Parameters
        ----------
        start, stop
            `start <= stop`.
        sagitta
            Largest distance between the outline and the polygon through the points, metres.
        """
        ends, bend = self._bend
        corners = [c + k * self.period for k in (-1, 0, 1) for c in self.corners]
        inside = sorted(c for c in corners if start < c < stop)
        nodes = np.array([start, *inside, stop])
        turns = np.floor(nodes / self.period)
        measure = np.interp(nodes - turns * self.period, ends, bend) + turns * bend[-1]
        pieces = []
        for a, b in pairwise(measure):
            # Equal shares of the integral give sagittas of (share)^2 / 8; a tenth in hand.
            count = max(1, int(np.ceil((b - a) / np.sqrt(7.2 * sagitta))))
            pieces.append(np.linspace(a, b, count, endpoint=False))
        wanted = np.concatenate(pieces)
        laps = np.floor(wanted / bend[-1]) if bend[-1] > 0.0 else np.zeros_like(wanted)
        s = np.interp(wanted - laps * bend[-1], bend, ends) + laps * self.period
        # Nodes are exact: a straight stretch has no bend to find them by.
        starts = np.cumsum([0, *(len(piece) for piece in pieces)])
        s = np.append(s, stop)
        s[starts] = nodes
        points = self.point(s)
        for _ in range(_HALVINGS):
            # Unbounded or wildly changing curvature escapes quadrature: look, and halve what stands off too far.
            between = self.point(s[:-1] + _LOOKED_AT[:, None] * np.diff(s))
            chord = np.diff(points)
            along = np.conj(chord / np.maximum(np.abs(chord), 1e-300)) * (between - points[:-1])
            # From the side itself, not its line: where the outline doubles back it lies beyond an end.
            beyond = along.real - np.clip(along.real, 0.0, np.abs(chord))
            far = np.flatnonzero(np.hypot(beyond, along.imag).max(axis=0) > sagitta)
            if not len(far):
                return points
            s = np.insert(s, far + 1, 0.5 * (s[far] + s[far + 1]))
            points = np.insert(points, far + 1, between[_MIDDLE, far])
        raise ProfileError(
            f"profile: too finely folded to be sampled near ({points[far[0]].real:.6g}, {points[far[0]].imag:.6g}) m",
            value=f"still more than {sagitta:.3g} m off after {_HALVINGS} halvings",
            limit="a curve that is smooth at this scale",
            remedy="make the outline less sharply folded there",
        )

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether each complex point lies inside the sampled outline (even-odd rule)."""
        z = np.asarray(points, dtype=complex)[..., None]
        a = self.table_f
        b = np.roll(a, -1)
        crosses = (a.imag > z.imag) != (b.imag > z.imag)
        rise = np.where(b.imag == a.imag, 1.0, b.imag - a.imag)
        at_x = a.real + (z.imag - a.imag) * (b.real - a.real) / rise
        return np.asarray((crosses & (z.real < at_x)).sum(axis=-1) % 2 == 1)

    # --- validity -------------------------------------------------------------------------------------

    def _check_shape(self) -> None:
        """Refuse an outline that runs clockwise or crosses itself."""
        a = self.table_f
        signed = 0.5 * float((np.conj(a) * np.roll(a, -1)).imag.sum())
        crossing = first_self_crossing(a)
        if crossing is not None:
            i, j = crossing
            raise ProfileError(
                f"profile: the outline crosses itself near ({a[i].real:.6g}, {a[i].imag:.6g}) m",
                value=f"stretches at s = {self.table_s[i]:.6g} and s = {self.table_s[j]:.6g}",
                limit="a simple closed curve",
                remedy="remove the loop, or smooth = false where a spline overshoots between sparse points",
            )
        if signed <= 0.0:
            raise ProfileError(
                "profile: the outline runs clockwise",
                value=f"signed area {signed:.6g} m2",
                limit="counter-clockwise, area > 0",
                remedy="reverse the order of the points",
            )


def first_self_crossing(points: Points) -> tuple[int, int] | None:
    """Indices of the first two sides of a closed polygon that cross or touch, or None.

    Neighbouring sides share a vertex and do not count unless they run back over each other.
    """
    a, b = points, np.roll(points, -1)
    n = len(a)
    x_lo, x_hi = np.minimum(a.real, b.real), np.maximum(a.real, b.real)
    y_lo, y_hi = np.minimum(a.imag, b.imag), np.maximum(a.imag, b.imag)
    for i in range(n - 1):
        j = np.arange(i + 1, n)
        near = (x_lo[j] <= x_hi[i]) & (x_hi[j] >= x_lo[i]) & (y_lo[j] <= y_hi[i]) & (y_hi[j] >= y_lo[i])
        j = j[near]
        neighbour = (j == i + 1) | ((i == 0) & (j == n - 1))
        d = b[i] - a[i]
        c, e = (np.conj(d) * (a[j] - a[i])).imag, (np.conj(d) * (b[j] - a[i])).imag
        dj = b[j] - a[j]
        g, h = (np.conj(dj) * (a[i] - a[j])).imag, (np.conj(dj) * (b[i] - a[j])).imag
        crosses = ~neighbour & (c * e <= 0.0) & (g * h <= 0.0) & ~((c == 0.0) & (e == 0.0) & (g == 0.0) & (h == 0.0))
        back = neighbour & (np.abs((np.conj(d) * dj).imag) == 0.0) & ((np.conj(d) * dj).real < 0.0)
        hit = np.flatnonzero(crosses | back)
        if len(hit):
            return i, int(j[hit[0]])
    return None
