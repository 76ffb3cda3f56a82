"""Bands on developable surfaces: between two helices on a cylinder, between two spirals on a cone.

A place is (arc, height) as in `design.strip`, which lays bands onto structures.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ori_deploy.profiles.profile import Points, Reals


class Band(Protocol):
    """A band on a developable surface, between two rulings."""

    @property
    def kind(self) -> str:
        """Name in a specification."""

    @property
    def first(self) -> float:
        """Arc at which it begins."""

    @property
    def last(self) -> float:
        """Arc at which it ends."""

    @property
    def turn_arc(self) -> float:
        """Arc of one turn."""

    @property
    def length_m(self) -> float:
        """Length of its middle line."""

    def edges(self, arc: ArrayLike) -> tuple[Reals, Reals]:
        """Heights of its two edges on the rulings at `arc`, lower first."""

    def area_m2(self, start: float, stop: float) -> float:
        """Area between two rulings."""

    def unrolled(self, arc: ArrayLike, height: ArrayLike) -> Points:
        """Places on the flat sheet, seen from outside, metres."""

    def stations(self, start: float, stop: float, sagitta_m: float) -> Reals:
        """Arcs from `start` to `stop` between which both edges are straight on the flat sheet to `sagitta_m`."""


@dataclass(frozen=True)
class HelixBand:
    """A band between two helices on a cylinder.

    Attributes
    ----------
    turn_arc
        Perimeter of the outline, metres.
    pitch_m
        Rise per turn counter-clockwise; negative for a left-handed helix.
    width_m
        Of the band, across its middle line.
    turns
        From end to end, need not be whole.
    start_m
        Height of the middle line where the band begins.
    first
        Arc at which it begins.
    """

    turn_arc: float
    pitch_m: float
    width_m: float
    turns: float
    start_m: float
    first: float = 0.0
    kind = "helix"

    @property
    def last(self) -> float:
        return self.first + self.turns * self.turn_arc

    @property
    def pitch_angle_rad(self) -> float:
        """Angle between the middle line and the cross-section."""
        return float(np.arctan2(self.pitch_m, self.turn_arc))

    @property
    def height_m(self) -> float:
        """Length of the band on one ruling."""
        return float(self.width_m / np.cos(self.pitch_angle_rad))

    @property
    def length_m(self) -> float:
        return float(self.turns * np.hypot(self.turn_arc, self.pitch_m))

    def edges(self, arc: ArrayLike) -> tuple[Reals, Reals]:
        middle = self.start_m + self.pitch_m * (np.asarray(arc, dtype=float) - self.first) / self.turn_arc
        return middle - 0.5 * self.height_m, middle + 0.5 * self.height_m

    def area_m2(self, start: float, stop: float) -> float:
        return self.height_m * (stop - start)

    def unrolled(self, arc: ArrayLike, height: ArrayLike) -> Points:
        """The middle line lies along the real axis and begins at 0."""
        along = np.asarray(arc) - self.first + 1j * (np.asarray(height) - self.start_m)
        return np.asarray(along * np.exp(-1j * self.pitch_angle_rad))

    def stations(self, start: float, stop: float, sagitta_m: float) -> Reals:
        del sagitta_m  # straight as it is
        return np.array([start, stop])


@dataclass(frozen=True)
class SpiralBand:
    """A band between two equiangular spirals on a cone.

    Attributes
    ----------
    turn_arc
        Perimeter of the curve on the unit sphere, radians.
    growth
        Radius after one turn counter-clockwise over radius before; below 1 the band winds towards the apex.
    width_turns
        How far, in turns, one edge is turned about the axis against the other; the band is wider further out.
    turns
        From end to end, need not be whole.
    start_m
        Radius of the middle line where the band begins.
    first
        Arc at which it begins.
    handed
        1 where arcs run to the right seen from outside with the apex below, -1 where to the left.
    """

    turn_arc: float
    growth: float
    width_turns: float
    turns: float
    start_m: float
    first: float = 0.0
    handed: float = 1.0
    kind = "spiral"

    @property
    def last(self) -> float:
        return self.first + self.turns * self.turn_arc

    @property
    def rate(self) -> float:
        """k of `radius = start exp(k arc)`, per radian of arc."""
        return float(np.log(self.growth) / self.turn_arc)

    @property
    def ruling_angle_rad(self) -> float:
        """Angle between the band's edges and every ruling."""
        return float(np.arctan2(1.0, abs(self.rate)))

    @property
    def _half(self) -> float:
        """Logarithm of an edge's radius over the middle line's."""
        return abs(0.5 * self.width_turns * float(np.log(self.growth)))

    @property
    def length_m(self) -> float:
        rate = abs(self.rate)
        stretch = float(np.expm1(self.turns * np.log(self.growth)) / self.rate)
        return stretch * self.start_m * float(np.hypot(1.0, rate))

    def middle(self, arc: ArrayLike) -> Reals:
        """Radius of the middle line."""
        return np.asarray(self.start_m * np.exp(self.rate * (np.asarray(arc, dtype=float) - self.first)))

    def edges(self, arc: ArrayLike) -> tuple[Reals, Reals]:
        middle = self.middle(arc)
        return middle * np.exp(-self._half), middle * np.exp(self._half)

    def area_m2(self, start: float, stop: float) -> float:
        a = float(self.middle(start))
        # Half the difference of the squared edges, integrated over the arc; b * b - a * a by its exponent.
        grown = float(np.expm1(2.0 * self.rate * (stop - start)))
        return float(np.sinh(2.0 * self._half) * a * a * grown / (2.0 * self.rate))

    def unrolled(self, arc: ArrayLike, height: ArrayLike) -> Points:
        """The apex lies at 0, the ruling where the band begins along the imaginary axis."""
        turn = np.exp(-1j * self.handed * (np.asarray(arc) - self.first))
        return np.asarray(1j * np.asarray(height) * turn)

    def stations(self, start: float, stop: float, sagitta_m: float) -> Reals:
        # An arc d of the outer edge, of speed r sqrt(1 + k^2) and curvature 1 over that, has sagitta speed d^2 / 8.
        outer = float(np.max(self.edges(np.array([start, stop]))[1])) * np.hypot(1.0, self.rate)
        count = int(np.ceil((stop - start) / np.sqrt(8.0 * sagitta_m / outer)))
        return np.linspace(start, stop, max(count, 1) + 1)
