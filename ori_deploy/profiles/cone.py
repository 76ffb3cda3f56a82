"""Generalized cones: the rays from an apex through a plane curve.

Seen from the apex a cone is a closed curve `g(s)` of unit vectors. Central projection onto the
base's plane (gnomonic) makes arcs of great circles straight, so what is true of straight lines only -
inside, crossing, convex, the order of vertices - is asked of the base curve; lengths, angles and
areas are those of the unit sphere.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ori_deploy.errors import ProfileError
from ori_deploy.profiles.profile import Points, Profile, Reals, Side
from ori_deploy.profiles.sphere import Vectors, arc, dot, unit
from ori_deploy.profiles.superellipse import Superellipse

WIDEST_RAD = 1.5
"""Largest angle between two directions of a cone and their middle: at a right angle, pi/2, it is flat and
no ray leaves on one side."""

_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(10)
_GAUSS_NODES = 0.5 * (_GAUSS_NODES + 1.0)
_GAUSS_WEIGHTS = 0.5 * _GAUSS_WEIGHTS


class Cone:
    """A generalized cone over a plane profile.

    Directions are given in a frame whose origin is the apex and whose axes are the user's, but that z
    points from the apex towards the base's plane: `apex + frame @ (r g)` are the user's coordinates.
    So the base keeps its orientation, and counter-clockwise is what it is in the base's plane. Where the
    apex lies above the base the frame is a mirror image (determinant -1).

    Parameters
    ----------
    base
        The curve, in its own plane and metres.
    apex_m
        (x, y, z) of the apex; x and y are the base's.
    plane_z_m
        Height z of the base's plane.

    Raises
    ------
    ProfileError
        Apex in the base's plane, or so near to it that the cone is wider than `WIDEST_RAD` to all sides.
    """

    kind = "cone"

    def __init__(self, base: Profile, apex_m: ArrayLike, plane_z_m: float = 0.0) -> None:
        apex = np.asarray(apex_m, dtype=float)
        if apex.shape != (3,) or not np.isfinite(apex).all() or not np.isfinite(plane_z_m):
            raise ProfileError(
                "profile: apex_m is not a point",
                value=apex.tolist(),
                limit="three finite numbers",
                remedy="give x, y, z in metres",
            )
        self.base, self.apex, self.plane_z_m = base, apex, float(plane_z_m)
        height = self.plane_z_m - float(apex[2])
        self._foot, self._height = complex(apex[0], apex[1]), abs(height)
        self.frame: Reals = np.diag([1.0, 1.0, 1.0 if height > 0.0 else -1.0])
        self.period, self.breaks = base.period, base.breaks
        self._refuse_flat()

    @classmethod
    def of_half_angle(cls, half_angle_rad: float, aspect: float = 1.0) -> Cone:
        """The cone over (tan(half) cos s, aspect tan(half) sin s, 1), its apex in the origin.

        Raises
        ------
        ProfileError
            Half-angle or aspect out of range.
        """
        for name, value in (("half_angle_rad", half_angle_rad), ("aspect", aspect)):
            if not (np.isfinite(value) and value > 0.0):
                raise ProfileError(f"profile: {name} must be a positive number", value=value, limit=f"{name} > 0")
        widest = (
            float(np.arctan(max(1.0, aspect) * np.tan(half_angle_rad))) if half_angle_rad < 0.5 * np.pi else np.pi
        )
        if widest > WIDEST_RAD:
            raise ProfileError(
                "profile: the cone is too wide: its rays do not leave on one side",
                value=f"half-angle {half_angle_rad:.6g} rad, aspect {aspect:.6g}",
                limit=f"at most {WIDEST_RAD} rad from the axis to every ray",
                remedy="make half_angle_rad smaller" + (" or aspect smaller" if aspect > 1.0 else ""),
            )
        extent = float(np.tan(half_angle_rad))
        return cls(Superellipse(extent, aspect * extent), (0.0, 0.0, 0.0), 1.0)

    def describe(self) -> dict[str, object]:
        """Plain data that makes this cone again, see `profiles.cone_from_description`."""
        return {
            "kind": self.kind,
            "base": self.base.describe(),
            "apex_m": self.apex.tolist(),
            "plane_z_m": self.plane_z_m,
        }

    # --- directions -----------------------------------------------------------------------------------

    def evaluate(self, s: ArrayLike, order: int = 0) -> tuple[Vectors, ...]:
        """`g` and its first `order` (0 to 2) derivatives with respect to `s`; each shaped (*s.shape, 3)."""
        f, *rest = self.base.evaluate(s, order)
        p = self.lift(f)
        rho = np.sqrt(dot(p, p))[..., None]
        g = p / rho
        if order == 0:
            return (g,)
        dp = _flat(rest[0])
        slope = dot(g, dp)[..., None]
        dg = (dp - g * slope) / rho
        if order == 1:
            return g, dg
        ddp = _flat(rest[1])
        bend = (dot(dp, dp) + dot(p, ddp))[..., None] / rho - slope * slope / rho
        return g, dg, (ddp - 2.0 * dg * slope - g * bend) / rho

    def point(self, s: ArrayLike) -> Vectors:
        """`g(s)`, (*s.shape, 3)."""
        return self.evaluate(s)[0]

    def towards(self, points: ArrayLike) -> Vectors:
        """Unit vectors through points of the base's plane (complex, metres)."""
        return unit(self.lift(np.asarray(points, dtype=complex)))

    def onto_base(self, directions: Vectors) -> Points:
        """Where directions meet the base's plane: complex, metres; the inverse of `towards`."""
        scale = self._height / directions[..., 2]
        return np.asarray(self._foot + scale * (directions[..., 0] + 1j * directions[..., 1]))

    def to_user(self, directions: Vectors) -> Vectors:
        """Unit vectors from the apex along the user's axes."""
        return np.asarray(directions @ self.frame.T)

    def from_user(self, directions: Vectors) -> Vectors:
        """The inverse of `to_user`."""
        return np.asarray(directions @ self.frame)

    def lift(self, f: Points) -> Vectors:
        """Points of the base's plane seen from the apex, in the cone's frame, metres; derivatives may run through."""
        out = f - self._foot
        return np.stack([out.real, out.imag, np.full(out.shape, self._height)], axis=-1)

    # --- integrals along the curve ----------------------------------------------------------------------

    def _density(self, s: Reals) -> tuple[Reals, Reals]:
        f, df = self.base.evaluate(s, 1)
        z, dz = (f - self._foot) / self._height, df / self._height
        rho2 = 1.0 + (np.conj(z) * z).real
        rho = np.sqrt(rho2)
        turned = (np.conj(z) * dz).imag
        along = (np.conj(z) * dz).real
        speed = np.sqrt(np.maximum((np.conj(dz) * dz).real * rho2 - along**2, 0.0)) / rho2
        return speed, turned / (rho * (rho + 1.0))

    @cached_property
    def _cumulative(self) -> tuple[Reals, Reals]:
        """Arc and swept solid angle from s = 0 to each table sample and to the end; (n + 1,) each."""
        ends = np.append(self.base.table_s, self.period)
        width = np.diff(ends)
        # From the left of the period's end, where the base may have a break.
        speed, swept = self._density(ends[:-1, None] + width[:, None] * _GAUSS_NODES)
        return (
            np.append(0.0, np.cumsum(width * (speed @ _GAUSS_WEIGHTS))),
            np.append(0.0, np.cumsum(width * (swept @ _GAUSS_WEIGHTS))),
        )

    def _primitive(self, s: ArrayLike) -> tuple[Reals, Reals]:
        s = np.asarray(s, dtype=float)
        table = self.base.table_s
        turns = np.floor(s / self.period)
        local = s - turns * self.period
        index = np.clip(np.searchsorted(table, local, side="right") - 1, 0, len(table) - 1)
        start = table[index]
        width = local - start
        speed, swept = self._density(start[..., None] + width[..., None] * _GAUSS_NODES)
        total_arc, total_swept = self._cumulative
        return (
            np.asarray(total_arc[index] + width * (speed @ _GAUSS_WEIGHTS) + turns * total_arc[-1]),
            np.asarray(total_swept[index] + width * (swept @ _GAUSS_WEIGHTS) + turns * total_swept[-1]),
        )

    def swept(self, s: ArrayLike) -> Reals:
        """Solid angle swept by the arc from the frame's z axis to `g`, from 0 to `s`, steradians."""
        return self._primitive(s)[1]

    def arc_length(self, s: ArrayLike) -> Reals:
        """Length of `g` on the unit sphere from 0 to `s`, radians."""
        return self._primitive(s)[0]

    @property
    def perimeter(self) -> float:
        """Length of `g` on the unit sphere, radians: the angle of the cone's surface when unrolled."""
        return float(self._cumulative[0][-1])

    @property
    def solid_angle(self) -> float:
        """Solid angle inside the cone, steradians."""
        return float(self._cumulative[1][-1])

    @property
    def area(self) -> float:
        """The cross-section's area on the unit sphere: `solid_angle`."""
        return self.solid_angle

    @cached_property
    def size(self) -> float:
        """Largest angle between two rays, radians: what relative tolerances refer to."""
        g = self.table_g
        far = np.unravel_index(int((g @ g.T).argmin()), (len(g), len(g)))
        return float(arc(g[far[0]], g[far[1]]))

    @cached_property
    def table_g(self) -> Vectors:
        """(n, 3) samples of the curve at `base.table_s`."""
        return self.towards(self.base.table_f)

    @cached_property
    def axis(self) -> Vectors:
        """(3,) middle of the cone: direction of the sum of its rays."""
        g = self.table_g
        step = np.linalg.norm(np.roll(g, -1, axis=0) - g, axis=1)
        return unit(((step + np.roll(step, 1))[:, None] * g).sum(axis=0))

    @property
    def is_right_handed(self) -> bool:
        """Whether the frame is; a mirror image, where the apex lies above the base, is not."""
        return bool(self.frame[2, 2] > 0.0)

    @property
    def is_convex(self) -> bool:
        """Whether the curve turns left everywhere; the same on the sphere and in the base's plane."""
        return self.base.is_convex

    # --- places ---------------------------------------------------------------------------------------------

    def at_arc(self, fraction: float) -> float:
        """Parameter at a fraction of the base curve's length."""
        return self.base.at_arc(fraction)

    def at_natural(self, angle: float) -> float:
        """Parameter at the base's natural angle."""
        return self.base.at_natural(angle)

    def at_chord(self, x_chord: float, side: Side) -> float:
        """Parameter at `x / chord` of the base; airfoils only."""
        return self.base.at_chord(x_chord, side)

    def contains(self, directions: ArrayLike) -> NDArray[np.bool_]:
        """(...,) whether each unit vector (..., 3) points into the cone."""
        u = np.asarray(directions, dtype=float)
        ahead = u[..., 2] > 0.0
        safe = np.where(ahead[..., None], u, np.array([0.0, 0.0, 1.0]))
        return np.asarray(ahead & self.base.contains(self.onto_base(safe)))

    def sample(self, start: float, stop: float, sagitta_rad: float) -> Vectors:
        """Unit vectors along `start <= s <= stop`, both ends and every corner included.

        Parameters
        ----------
        sagitta_rad
            Largest arc between the curve and the great-circle arcs from point to point.
        """
        # Seen from the apex a deviation in the base's plane shrinks by at least its distance.
        nearest = float(np.sqrt(np.min(np.abs(self.base.table_f - self._foot) ** 2) + self._height**2))
        return self.towards(self.base.sample(start, stop, sagitta_rad * nearest))

    # --- extremes -------------------------------------------------------------------------------------------

    def extreme(self, start: Reals, stop: Reals, normal: Vectors) -> tuple[Reals, Vectors]:
        """Largest `normal·g(s)` over `start <= s <= stop`, many at once.

        Parameters
        ----------
        start, stop
            (n,) parameters, `start <= stop <= start + period`.
        normal
            (n, 3).

        Returns
        -------
        (n,) largest values and the (n, 3) directions where they are taken.
        """
        shift = np.floor(start / self.period) * self.period
        lo, hi = start - shift, stop - shift
        table_s = np.concatenate([self.base.table_s, self.base.table_s + self.period])
        height = normal @ np.tile(self.table_g, (2, 1)).T
        height[(table_s < lo[:, None]) | (table_s > hi[:, None])] = -np.inf
        best = height.argmax(axis=1)
        s = table_s[best]
        s = np.where((s < lo) | (s > hi), 0.5 * (lo + hi), s)
        gap = np.diff(self.base.table_s, append=self.period).max()
        left, right = s - gap, s + gap
        part = hi - lo < self.period * (1.0 - 1e-12)
        left, right = np.where(part, np.maximum(lo, left), left), np.where(part, np.minimum(hi, right), right)
        for _ in range(60):
            _, dg, ddg = self.evaluate(s, 2)
            slope, bend = dot(normal, dg), dot(normal, ddg)
            left, right = np.where(slope > 0.0, s, left), np.where(slope > 0.0, right, s)
            # In a bracket round a maximum, slope times width bounds what the height can still gain.
            if (np.abs(slope) * (right - left) <= 1e-16).all():
                break
            step = s - slope / np.where(bend < 0.0, bend, -np.inf)
            s = np.where((step > left) & (step < right) & (bend < 0.0), step, 0.5 * (left + right))
        g = self.point(np.stack([lo, hi, s]))
        value = dot(normal, g)
        pick = value.argmax(axis=0)
        columns = np.arange(len(s))
        return value[pick, columns], g[pick, columns]

    def steepest(self, start: Reals, stop: Reals, crease: Vectors, normal: Vectors) -> tuple[Reals, Vectors]:
        """Largest angle, seen from a crease, to which the curve leaves a great circle through it.

        The angle of a point p is `atan2(normal·p, crease·p)`: great circles of one angle all cross, 90
        degrees from the crease, in one pair of points, and the one of angle 0 has the pole `normal`.
        The tangent of the angle is a quotient of two heights over lines of the base's plane, and so is found
        by Dinkelbach's method from the plane's extremes (Management Science 13 (1967) 492).

        Parameters
        ----------
        start, stop
            (n,) parameters, `start <= stop <= start + period`.
        crease, normal
            (n, 3) unit vectors, at right angles.

        Returns
        -------
        (n,) angles, pi/2 where the curve reaches 90 degrees away from the crease, and the (n, 3) directions
        where they are taken.
        """
        tangent = np.zeros(len(start))
        origin = np.full(len(start), self._foot)
        g = crease
        lost = np.zeros(len(start), dtype=bool)
        for _ in range(40):
            mix = normal - tangent[:, None] * crease
            flat = np.asarray(mix[:, 0] + 1j * mix[:, 1], dtype=np.complex128)
            size = np.abs(flat)
            direction = flat / np.where(size > 0.0, size, 1.0)
            _, where = self.base.extreme(start, stop, origin, direction)
            g = self.towards(where)
            over, along = dot(normal, g), dot(crease, g)
            lost = lost | (along <= 1e-9)
            new = np.where(lost, 0.0, over / np.where(lost, 1.0, along))
            moved = np.abs(new - tangent) > 4e-16 * (1.0 + np.abs(new))
            better = new > tangent
            tangent = new
            if not (moved & better & ~lost).any():
                break
        return np.where(lost, 0.5 * np.pi, np.arctan(tangent)), g

    # --- validity -------------------------------------------------------------------------------------------

    def _refuse_flat(self) -> None:
        if self._height > 0.0:
            widest = float(arc(self.table_g, self.axis).max())
            if widest <= WIDEST_RAD + 1e-9:
                return
            value = f"{self._height:.6g} m from it, rays up to {widest:.4g} rad from their middle"
        else:
            value = f"z = {self.apex[2]:.6g} m"
        inside = bool(self.base.contains(self._foot))
        where = "inside the profile" if inside else "in the plane of the profile"
        raise ProfileError(
            f"profile: the apex lies {where}: its rays do not leave on one side",
            value=value,
            limit=f"off the plane z = {self.plane_z_m:.6g} m, and no ray more than {WIDEST_RAD} rad from the middle",
            remedy="move apex_m away from the base's plane: its z is the taper's length",
        )


def _flat(z: Points) -> Vectors:
    """Derivatives in the base's plane as vectors."""
    return np.stack([z.real, z.imag, np.zeros(z.shape)], axis=-1)
