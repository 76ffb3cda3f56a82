"""Ellipses and superellipses (the shapes of the paper's Fig. 4)."""

from __future__ import annotations

import numpy as np

from ori_deploy.errors import ProfileError
from ori_deploy.profiles.profile import Points, Profile, Reals


class Superellipse(Profile):
    """`|x/a|^m + |y/b|^m = 1`; an ellipse for `m = 2`. Starts at (a, 0).

    The natural parameter is the paper's `theta` in `x = a sgn(cos) |cos|^(2/m)`, `y` likewise. Inside,
    exponents of 1 and more use the polar angle of (x/a, y/b) instead, in which the curve is smooth
    where `theta` is not; hollow ones (m < 1, cusps on the axes) use `theta`.

    Parameters
    ----------
    a_m, b_m
        Half axes along x and y, metres, > 0.
    exponent
        `m` > 0.
    """

    def __init__(self, a_m: float, b_m: float, exponent: float = 2.0, *, resolution: int = 512) -> None:
        for name, value in (("a_m", a_m), ("b_m", b_m), ("exponent", exponent)):
            if not (np.isfinite(value) and value > 0.0):
                raise ProfileError(
                    f"profile: {name} must be a positive number",
                    value=value,
                    limit=f"{name} > 0",
                    remedy="give a length in metres" if name.endswith("_m") else "2 is an ellipse",
                )
        self.a_m, self.b_m, self.exponent = float(a_m), float(b_m), float(exponent)
        breaks = [0.0] if exponent == 2.0 else [0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi]
        super().__init__(2.0 * np.pi, breaks, resolution)

    @property
    def kind(self) -> str:
        return "ellipse" if self.exponent == 2.0 else "superellipse"

    def describe(self) -> dict[str, object]:
        described: dict[str, object] = {"kind": self.kind, "a_m": self.a_m, "b_m": self.b_m}
        return described if self.exponent == 2.0 else {**described, "exponent": self.exponent}

    def at_natural(self, angle: float) -> float:
        if self.exponent == 2.0 or self.exponent < 1.0:
            return float(angle % (2.0 * np.pi))
        u, w = np.cos(angle), np.sin(angle)
        power = 2.0 / self.exponent
        polar = np.arctan2(np.sign(w) * abs(w) ** power, np.sign(u) * abs(u) ** power)
        return float(polar % (2.0 * np.pi))

    def _evaluate(self, s: Reals, order: int) -> tuple[Points, ...]:
        u, w = np.cos(s), np.sin(s)
        if self.exponent == 2.0:
            f: Points = self.a_m * u + 1j * self.b_m * w
            df: Points = -self.a_m * w + 1j * self.b_m * u
            return (f, df, -f)[: order + 1]
        return self._hollow(u, w, order) if self.exponent < 1.0 else self._polar(u, w, order)

    def _polar(self, u: Reals, w: Reals, order: int) -> tuple[Points, ...]:
        """Radius `S^(-1/m)` over the unit direction, `S = |u|^m + |w|^m`; product rule for the rest."""
        m = self.exponent
        au, aw = np.maximum(np.abs(u), 1e-30), np.maximum(np.abs(w), 1e-30)
        e: Points = self.a_m * u + 1j * self.b_m * w
        total = au**m + aw**m
        radius = total ** (-1.0 / m)
        f: Points = radius * e
        if order == 0:
            return (f,)
        de = -self.a_m * w + 1j * self.b_m * u
        slope = m * (np.sign(w) * aw ** (m - 1.0) * u - np.sign(u) * au ** (m - 1.0) * w)
        d_radius = -radius * slope / (m * total)
        df: Points = d_radius * e + radius * de
        if order == 1:
            return f, df
        bend = m * ((m - 1.0) * (au ** (m - 2.0) * w**2 + aw ** (m - 2.0) * u**2) - total)
        dd_radius = -(d_radius * slope + radius * bend - radius * slope**2 / total) / (m * total)
        return f, df, dd_radius * e + 2.0 * d_radius * de - f

    def _hollow(self, u: Reals, w: Reals, order: int) -> tuple[Points, ...]:
        p = 2.0 / self.exponent
        au, aw = np.abs(u), np.abs(w)
        f: Points = self.a_m * np.sign(u) * au**p + 1j * self.b_m * np.sign(w) * aw**p
        dx, dy = -self.a_m * au ** (p - 1.0) * w, self.b_m * aw ** (p - 1.0) * u
        df = np.asarray(p * (dx + 1j * dy), dtype=np.complex128)
        ddx = self.a_m * np.sign(u) * ((p - 1.0) * au ** (p - 2.0) * w**2 - au**p)
        ddy = self.b_m * np.sign(w) * ((p - 1.0) * aw ** (p - 2.0) * u**2 - aw**p)
        ddf = np.asarray(p * (ddx + 1j * ddy), dtype=np.complex128)
        return (f, df, ddf)[: order + 1]
