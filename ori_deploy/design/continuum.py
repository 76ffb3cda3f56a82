"""How much packaging one more cell buys: the continuum limit, the paper's equations (7) and (8).

For one inner vertex, no wall and very many cells, a cell that spans the polar angle dθ at radius r
holds `r |κ| (r² + 2 r'²) dθ² / 16` of material. The best division gives every cell the same material,
and eta then grows by `eta_per_cell` with every cell.

In any parameter s of the outline, with p the place seen from the inner vertex, the root of that material is

    sqrt((|p|² |f'|² + (p·f')²) (f' × f'') / (|p| |f'|³)) / 4 ds,

so nothing has to be solved for r(θ), and a curvature that vanishes or grows without bound at a break
stays where the quadrature expects it: at the end of a piece.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.errors import ProfileError
from ori_deploy.profiles import Profile
from ori_deploy.profiles.profile import Points, Reals
from ori_deploy.profiles.quadrature import OutlineIntegral, integrate

_CORNER_RAD = 2e-5
"""Turn at once, radians, above which an outline has a corner: a thousandth of a degree, as in `Profile.corners`."""
_HOLLOW_RAD = 1e-6
"""Turn of all hollow stretches together below which an outline counts as convex: a spline's rounding."""
_ON_OUTLINE = 1e-9
"""Distance from the outline, over its size, at which the inner vertex lies on it: r vanishes there."""


@dataclass(frozen=True)
class ContinuumLimit:
    """Equation (8) for one profile and one place of the inner vertex. Make one with `continuum_limit`.

    Attributes
    ----------
    profile
        The outline.
    center
        Place of the inner vertex, complex, metres.
    area
        Inside the outline, square metres.
    root_material
        What (8) integrates, from the outline's start round to it: n cells at their best hold
        `integral² / n` of material.
    """

    profile: Profile
    center: complex
    area: float
    root_material: OutlineIntegral

    @property
    def integral(self) -> float:
        """The integral of (8), metres."""
        return self.root_material.total.real

    @property
    def eta_per_cell(self) -> float:
        """Packaging ratio that every further cell adds."""
        return self.area / self.integral**2

    def best_openings(self, n: int, start: float = 0.0) -> Reals:
        """(n,) parameters of opening vertices between which every cell holds the same material: the best division.

        Parameters
        ----------
        n
            Cells, at least 1.
        start
            Share of one cell, in [0, 1), by which all vertices are moved on from the outline's start.
        """
        return self.root_material.parameters((np.arange(n) + start) / n * self.integral)

    def best_closings(self, openings: Reals) -> Reals:
        """(n,) parameters of closing vertices, each after its opening vertex, for which no wall offset is raised.

        From the inner vertex to a closing vertex both sides of a cell unfold to the same length, which is
        (3) to leading order; (8) takes this for granted.

        Parameters
        ----------
        openings
            (n,) increasing, within one period.
        """
        lo, hi = openings, np.append(openings[1:], openings[0] + self.profile.period)
        before, after = self.profile.point(lo), self.profile.point(hi)
        lead = np.abs(before - self.center) - np.abs(after - self.center)
        for _ in range(60):
            s = 0.5 * (lo + hi)
            f = self.profile.point(s)
            short = lead + np.abs(f - before) < np.abs(f - after)
            lo, hi = np.where(short, s, lo), np.where(short, hi, s)
        return np.asarray(0.5 * (lo + hi))

    def finite_eta(self, angles: ArrayLike) -> float:
        """Equation (7): the packaging ratio of finitely many cells, to leading order in their width.

        Parameters
        ----------
        angles
            (n,) polar angles of the opening vertices about the inner vertex, radians, increasing, within one
            turn. A cell's radius and curvature are those at the middle of its angle.

        Raises
        ------
        ProfileError
            Angles that are not numbers or not in order.
        """
        edges = np.atleast_1d(np.asarray(angles, dtype=float))
        width = np.diff(edges, append=edges[:1] + 2.0 * np.pi)
        if edges.ndim != 1 or not (width > 0.0).all():
            raise ProfileError(
                "angles: not increasing within one turn",
                value=np.array2string(edges, precision=4, threshold=8),
                limit="each larger than the one before, the last less than a turn beyond the first",
                remedy="sort them",
            )
        s = self.at_polar_angle(edges + 0.5 * width)
        f, df = self.profile.evaluate(s, 1)
        place = f - self.center
        parameter_per_angle = np.abs(place) ** 2 / (np.conj(place) * df).imag
        root = _root_material(self.profile, s, self.center) * parameter_per_angle * width
        return self.area / float((root**2).sum())

    def at_polar_angle(self, angles: ArrayLike) -> Reals:
        """Parameters of the places seen from the inner vertex under polar angles (radians), shaped like them."""
        wanted = np.asarray(angles, dtype=float)
        table = np.append(self.profile.table_s, self.profile.period)
        seen = np.unwrap(np.angle(np.append(self.profile.table_f, self.profile.table_f[0]) - self.center))
        turns = np.floor((wanted - seen[0]) / (2.0 * np.pi))
        local = wanted - 2.0 * np.pi * turns
        k = np.clip(np.searchsorted(seen, local, side="right") - 1, 0, len(table) - 2)
        lo, hi = table[k], table[k + 1]
        ray = np.exp(1j * local)
        for _ in range(60):
            s = 0.5 * (lo + hi)
            behind = (np.conj(ray) * (self.profile.point(s) - self.center)).imag < 0.0
            lo, hi = np.where(behind, s, lo), np.where(behind, hi, s)
        return np.asarray(0.5 * (lo + hi) + turns * self.profile.period)


def continuum_limit(profile: Profile, center: complex | None = None) -> ContinuumLimit:
    """Equation (8): the slope of the best packaging ratio against the number of cells.

    Parameters
    ----------
    profile
        Convex and smooth.
    center
        The inner vertex, complex, metres; the centroid when left out.

    Returns
    -------
    The limit; its `eta_per_cell` is good to 1e-9, relative; to 1e-7 where all curvature is in the corners or, with
    superellipses of m < 1.2, without bound there: the rounding of derivatives and parameters.

    Raises
    ------
    ProfileError
        The outline has corners or hollows, or the inner vertex is not inside it: (8) does not hold.
    """
    _check_outline(profile)
    area = integrate(profile, lambda s: _moments(profile, s)[0]).total.real
    inner = centroid(profile) if center is None else complex(center)
    _check_inside(profile, inner, chosen=center is not None)
    return ContinuumLimit(profile, inner, area, integrate(profile, lambda s: _root_material(profile, s, inner)))


def centroid(profile: Profile) -> complex:
    """Centroid of the area inside the outline, complex, metres."""
    area = integrate(profile, lambda s: _moments(profile, s)[0]).total
    return integrate(profile, lambda s: _moments(profile, s)[1]).total / area


def _moments(profile: Profile, s: Reals) -> tuple[Reals, Points]:
    """Area and first moment swept per parameter, seen from the origin (Green's theorem)."""
    f, df = profile.evaluate(s, 1)
    swept = 0.5 * (np.conj(f) * df).imag
    return swept, f * swept / 1.5


def _root_material(profile: Profile, s: Reals, center: complex) -> Reals:
    """Root of the material of a narrow cell, per parameter; shaped like `s`, metres per unit of `s`."""
    f, df, ddf = profile.evaluate(s, 2)
    place = f - center
    speed, radius = np.abs(df), np.abs(place)
    bend = np.maximum((np.conj(df) * ddf).imag, 0.0)  # rounding on flats
    along = (np.conj(place) * df).real
    return np.asarray(0.25 * np.sqrt(((radius * speed) ** 2 + along**2) * bend / (radius * speed**3)))


# --- where the equation holds ------------------------------------------------------------------------


def _check_outline(profile: Profile) -> None:
    """Refuse corners and hollows, all in one message: mending one of them alone would not help."""
    found = [text for text in (_corner(profile), _hollow(profile)) if text]
    if found:
        straight = " (between straight sides no bound exists at all)" if _all_straight(profile) else ""
        raise ProfileError(
            f"profile: the continuum limit, equation (8), does not hold for this {profile.kind} outline",
            value=" and ".join(found),
            limit=f"a smooth convex outline{straight}",
            remedy="an ellipse, a superellipse with exponent > 1, or smooth points without hollows",
        )


def _corner(profile: Profile) -> str | None:
    """The sharpest corner, in words.

    Curvature may grow without bound where the outline is still smooth (superellipses with 1 < m < 2): there
    the turn shrinks with the distance it is taken over, at a corner it stays.
    """
    at, period = profile.breaks, profile.period
    turns = []
    for step in (1e-9, 1e-12):
        around = at + step * period * np.array([[-1.0], [1.0]])
        along = profile.evaluate(around, 1)[1]
        with np.errstate(invalid="ignore"):
            turns.append(np.abs(np.angle(along[1] / along[0])))
    wide, narrow = turns
    sharp = ~((narrow <= _CORNER_RAD) | (narrow <= 0.7 * wide))
    if not sharp.any():
        return None
    k = int(np.argmax(np.where(sharp, np.nan_to_num(narrow, nan=np.pi), 0.0)))
    turn = np.degrees(narrow[k]) if np.isfinite(narrow[k]) else 180.0
    return f"a corner of {turn:.3g} deg at {_place(profile, complex(profile.point(at[k])))}"


def _hollow(profile: Profile) -> str | None:
    """The hollowest place, in words."""
    ends = np.append(profile.table_s, profile.period)
    s = (ends[:-1, None] + np.diff(ends)[:, None] * np.array([0.1, 0.3, 0.5, 0.7, 0.9])).ravel()
    share = np.repeat(np.diff(ends) / 5.0, 5)
    f, df, ddf = profile.evaluate(s, 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        turn = np.nan_to_num((np.conj(df) * ddf).imag / np.abs(df) ** 2, nan=0.0, posinf=0.0, neginf=0.0) * share
    if turn.min() >= 0.0 or -turn[turn < 0.0].sum() <= _HOLLOW_RAD:
        return None
    k = int(np.argmin(turn))
    return f"a hollow at {_place(profile, complex(f[k]))}"


def _place(profile: Profile, z: complex) -> str:
    x, y = (0.0 if abs(c) < 1e-12 * profile.size else c for c in (z.real, z.imag))
    return f"({x:.6g}, {y:.6g}) m"


def _all_straight(profile: Profile) -> bool:
    middle = profile.table_s + 0.5 * np.diff(profile.table_s, append=profile.period)
    _, df, ddf = profile.evaluate(middle, 2)
    return bool((np.abs((np.conj(df) * ddf).imag) <= 1e-12 * np.abs(df) ** 3 / profile.size).all())


def _check_inside(profile: Profile, center: complex, *, chosen: bool) -> None:
    """A convex outline is star-shaped from every place inside it, and from no other."""
    tangent = np.diff(profile.table_f, append=profile.table_f[0])
    away = float((np.conj(tangent / np.abs(tangent)) * (center - profile.table_f)).imag.min())
    if away > _ON_OUTLINE * profile.size:
        return
    if away > 0.0 or not chosen:  # inside, and all but on the outline
        flat = "use an outline that is less slender"
        raise ProfileError(
            f"{'center' if chosen else 'centroid'}: too near the outline to tell apart",
            value=f"{max(away, 0.0):.3g} m from it",
            limit=f"more than {_ON_OUTLINE:g} of the outline's size, {_ON_OUTLINE * profile.size:.3g} m",
            remedy=f"move it inwards, or {flat}" if chosen else flat,
        )
    raise ProfileError(
        "center: the outline is not star-shaped from there",
        value=_place(profile, center),
        limit="inside the outline",
        remedy="move it inside, or leave it out for the centroid",
    )


# --- superellipses -----------------------------------------------------------------------------------


def superellipse_table(aspects: ArrayLike, exponents: ArrayLike) -> Reals:
    """`eta_per_cell` of superellipses about their centres, all at once: the data of the paper's Fig. 4d.

    In the paper's parameter, `x = cos^p, y = γ sin^p` with `p = 2/m`, every factor that vanishes or grows
    without bound at the axes cancels; what is left of (8) is

        sqrt(γ p (2 - p) (r² w² + e²) / (r w³)) / 4,   w² = sin^(4-2p) + γ² cos^(4-2p),
        e = γ² sin^p cos^(2-p) - cos^p sin^(2-p).

    Parameters
    ----------
    aspects
        (n,) γ > 0, height over width.
    exponents
        (k,) m > 1.

    Returns
    -------
    (n, k) array.

    Raises
    ------
    ProfileError
        An aspect or an exponent out of range.
    """
    aspect = np.atleast_1d(np.asarray(aspects, dtype=float))
    exponent = np.atleast_1d(np.asarray(exponents, dtype=float))
    for name, given, least in (("aspects", aspect, 0.0), ("exponents", exponent, 1.0)):
        if not (np.isfinite(given) & (given > least)).all():
            raise ProfileError(
                f"{name}: not those of smooth convex superellipses",
                value=np.array2string(given, precision=4, threshold=8),
                limit=f"> {least:g}",
                remedy="mend them",
            )
    from scipy.special import gammaln  # loaded by those who need it only: it takes 0.1 s

    gamma, m = aspect[:, None], exponent[None, :]
    p = (2.0 / m)[..., None]
    angle, weight = _tanh_sinh(0.25 * np.pi)
    # Each eighth runs from an axis to the diagonal, so that the distance from the axis is exact.
    one, b = np.ones_like(gamma)[..., None], gamma[..., None]
    eighths = _eighth(one, b, p, angle) + _eighth(b, one, p, angle)
    area = 4.0 * gamma * np.exp(2.0 * gammaln(1.0 + 1.0 / m) - gammaln(1.0 + 2.0 / m))
    return np.asarray(area / (4.0 * (eighths @ weight)) ** 2)


def _eighth(a: Reals, b: Reals, p: Reals, angle: Reals) -> Reals:
    sin, cos = np.sin(angle), np.cos(angle)
    radius = np.hypot(a * cos**p, b * sin**p)
    w = np.hypot(a * sin ** (2.0 - p), b * cos ** (2.0 - p))
    e = b * b * sin**p * cos ** (2.0 - p) - a * a * cos**p * sin ** (2.0 - p)
    return np.asarray(0.25 * np.sqrt(a * b * p * (2.0 - p) * ((radius * w) ** 2 + e * e) / (radius * w**3)))


def _tanh_sinh(stop: float) -> tuple[Reals, Reals]:
    """(161,) nodes in (0, stop) and weights of double-exponential quadrature: powers at the ends do it no harm."""
    t = np.linspace(-5.5, 5.5, 161)
    u = 0.5 * np.pi * np.sinh(t)
    node = stop / (1.0 + np.exp(-2.0 * u))
    weight = stop * 0.25 * np.pi * np.cosh(t) / np.cosh(u) ** 2 * (t[1] - t[0])
    return node, weight
