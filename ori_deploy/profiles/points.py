"""Outlines given by points: airfoil `.dat` files, traced shapes, polygons."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.errors import ProfileError
from ori_deploy.profiles.naca import chord_crossing
from ori_deploy.profiles.piecewise import PiecewisePolynomial
from ori_deploy.profiles.profile import Points, Profile, Reals, Side, first_self_crossing
from ori_deploy.tolerance import TOLERANCE


class PointOutline(Profile):
    """A closed outline through points: a polygon, or a smooth spline broken only at corners.

    Parameters
    ----------
    points
        (n, 2) coordinates in chords, counter-clockwise, n >= 3; a repeated last point is dropped.
        Airfoils start at the trailing edge and run over the upper side first; their nose is the
        point nearest (0, 0), as in every airfoil file.
    chord_m
        Metres per unit of `points`, > 0.
    smooth
        A cubic spline between corners (turns above `Tolerance.corner_rad`), or straight sides.
    """

    def __init__(
        self, points: ArrayLike, chord_m: float = 1.0, *, smooth: bool = True, resolution: int = 512
    ) -> None:
        if not (np.isfinite(chord_m) and chord_m > 0.0):
            raise ProfileError(
                "profile: chord_m must be a positive number",
                value=chord_m,
                limit="chord_m > 0",
                remedy="give metres",
            )
        z = _clean(points)
        self.chord_m, self.smooth = float(chord_m), bool(smooth)
        self._given = z
        self._check_given(z)
        z = z * self.chord_m
        knots = np.append(0.0, np.cumsum(np.abs(np.diff(np.append(z, z[0])))))
        coefficients = _spline(z, knots) if smooth else _polygon(z, knots)
        self._curve = PiecewisePolynomial(knots, coefficients[::-1].T)
        self._nose = float(knots[int(np.argmin(np.abs(z)))])
        super().__init__(knots[-1], knots[:-1], resolution)

    @staticmethod
    def _check_given(z: Points) -> None:
        crossing = first_self_crossing(z)
        if crossing is not None:
            i, j = crossing
            raise ProfileError(
                f"profile: the outline crosses itself: the side after point {i + 1} and the side after point {j + 1}",
                value=f"({z[i].real:.6g}, {z[i].imag:.6g}) and ({z[j].real:.6g}, {z[j].imag:.6g})",
                limit="a simple closed curve",
                remedy="put the points in order round the shape",
            )

    @property
    def kind(self) -> str:
        return "points"

    def describe(self) -> dict[str, object]:
        points = [[float(p.real), float(p.imag)] for p in self._given]
        return {"kind": "points", "chord_m": self.chord_m, "smooth": self.smooth, "points": points}

    def at_chord(self, x_chord: float, side: Side) -> float:
        for end, at in ((self._nose, 0.0), (0.0, 1.0)):
            if x_chord == at and abs(self.point(end).real - at * self.chord_m) <= 1e-3 * self.chord_m:
                return end
        return chord_crossing(self, x_chord, side, self._nose)

    def _evaluate(self, s: Reals, order: int) -> tuple[Points, ...]:
        return self._curve.evaluate(s, order)


def _clean(points: ArrayLike) -> Points:
    array = np.asarray(points, dtype=float)
    if array.ndim != 2 or array.shape[1:] != (2,) or len(array) < 3:
        raise ProfileError(
            "profile: too few points",
            value=f"{len(array)} points of two numbers" if array.ndim == 2 else f"shape {array.shape}",
            limit="at least 3, two numbers each",
            remedy="one point per line, x and y",
        )
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise ProfileError(
            f"profile: point {bad[0] + 1} is not a finite number",
            value=array[bad[0]].tolist(),
            limit="finite coordinates",
            remedy="mend or remove the point",
        )
    z = array[:, 0] + 1j * array[:, 1]
    # Of two equal points the later one goes: the outline starts where the file does.
    keep = np.abs(np.roll(z, -1) - z) > 1e-12 * float(np.ptp(array, axis=0).max())
    z = z[keep]
    if len(z) < 3:
        raise ProfileError(
            "profile: fewer than 3 different points", value=len(z), limit="n >= 3", remedy="add points"
        )
    return z


def _polygon(z: Points, knots: Reals) -> Points:
    slope = np.diff(np.append(z, z[0])) / np.diff(knots)
    zero = np.zeros_like(slope)
    return np.stack([zero, zero, slope, z])


def _spline(z: Points, knots: Reals) -> Points:
    """Cubic coefficients (4, n) of a spline that is C2 except at corners."""
    from scipy.interpolate import CubicSpline  # loaded by those who need it only: it takes 0.3 s

    edge = np.diff(np.append(z, z[0]))
    turn = np.abs(np.angle(edge / np.roll(edge, 1)))
    # Sparse samples of a smooth curve turn by much everywhere, a corner by much more than its neighbours.
    corners = np.flatnonzero((turn > TOLERANCE.corner_rad) & (turn > 2.0 * np.median(turn)))
    closed = np.append(z, z[0])
    if len(corners) == 0:
        return np.asarray(CubicSpline(knots, closed, bc_type="periodic").c)
    n = len(z)
    coefficients = np.empty((4, n), dtype=complex)
    for start, stop in zip(corners, np.append(corners[1:], corners[0] + n), strict=True):
        index = np.arange(start, stop + 1)
        local = knots[index % n] + np.where(index >= n, knots[-1], 0.0)
        local[-1] = knots[stop] if stop <= n else knots[stop - n] + knots[-1]
        values = z[index % n]
        if len(index) == 2:
            piece = np.stack([0.0, 0.0, (values[1] - values[0]) / (local[1] - local[0]), values[0]])[:, None]
        else:
            piece = CubicSpline(local, values, bc_type="not-a-knot" if len(index) > 3 else "natural").c
        coefficients[:, index[:-1] % n] = piece
    return coefficients


def parse_dat(text: str, source: str = "dat file") -> Reals:
    """Points of an airfoil coordinate file, (n, 2) in chords, in Selig order.

    Both layouts in use are read: Selig (one loop from the trailing edge over the upper side) and
    Lednicer (point counts, then the upper and the lower side, each from the nose back).

    Raises
    ------
    ProfileError
        A line that is not two numbers, with its line number.
    """
    rows: list[tuple[float, float]] = []
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), start=1):
        words = line.replace(",", " ").split("#")[0].split()
        if not words or (not rows and not _starts_like_a_number(words[0])):
            continue  # blank, or a name line before the first point
        try:
            x, y = (float(w) for w in words)
        except ValueError:
            raise ProfileError(
                f"{source}, line {number}: not two numbers",
                value=repr(line.strip()),
                limit="x y",
                remedy="mend the line",
            ) from None
        rows.append((x, y))
    if rows and min(rows[0]) > 1.5 and all(float(n).is_integer() for n in rows[0]):
        return _lednicer(rows, source)
    return np.array(rows, dtype=float).reshape(-1, 2)


def _starts_like_a_number(word: str) -> bool:
    return word[0] in "0123456789.+-"


def _lednicer(rows: list[tuple[float, float]], source: str) -> Reals:
    """One loop from two sides that each run from the nose back; the first row has their point counts."""
    upper, lower = (int(n) for n in rows[0])
    if upper + lower != len(rows) - 1:
        raise ProfileError(
            f"{source}: the point counts of its first row do not fit",
            value=f"{upper} and {lower}",
            limit=f"{len(rows) - 1} points follow",
            remedy="mend the counts, or remove the row",
        )
    body = np.array(rows[1:])
    return np.concatenate([body[:upper][::-1], body[upper:]])
