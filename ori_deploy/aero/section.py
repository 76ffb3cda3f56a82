"""An airfoil section in the flow, by NeuralFoil: a network trained on XFoil's viscous solutions.

NeuralFoil sees a section as a class-shape (CST) curve with eight weights a side: what is finer than such a curve
can be, a step at a crease for one, it does not see. `Section.unseen` says how much that is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from ori_deploy.aero.need import aerosandbox, neuralfoil
from ori_deploy.errors import InputError
from ori_deploy.profiles import Profile, xy
from ori_deploy.profiles.profile import Points, Reals

MODEL = "xlarge"
"""Size of the network; larger ones move C_l by 0.01."""
SWEEP_RAD = np.radians(np.arange(-8.0, 18.01, 0.5))
"""Angles at which a section's polar is tabulated."""
_FINE = 1e-5
"""Sagitta of a section's polygon, in chords."""
_POINTS = 120


@dataclass(frozen=True)
class Forces:
    """Coefficients of a section at angles of attack; arrays alike. Moment about a quarter of the chord, nose up.

    Attributes
    ----------
    confidence
        NeuralFoil's own, 0 to 1.
    """

    alpha_rad: Reals
    lift: Reals
    drag: Reals
    moment: Reals
    confidence: Reals


@dataclass(frozen=True)
class EdgeSpeed:
    """Speed just outside the boundary layer over that of the flow, along the section from its upper trailing edge.

    Attributes
    ----------
    x
        (n,) place along the chord, in chords.
    upper
        (n,) whether on the upper side.
    speed
        (n,) positive towards the trailing edge below, and so from there backwards: it changes sign where the flow
        divides.
    """

    x: Reals
    upper: Any
    speed: Reals


@dataclass(frozen=True)
class Section:
    """A section of chord 1.

    Attributes
    ----------
    name
        For people.
    points
        (n,) outline in chords, from the trailing edge over the upper side to the nose and back below.
    """

    name: str
    points: Points

    @classmethod
    def of_profile(cls, profile: Profile, name: str) -> Section:
        """The section of an airfoil profile.

        Raises
        ------
        InputError
            The profile has no chord: it is no airfoil.
        """
        chord = chord_m(profile)
        return cls(name, profile.sample(0.0, profile.period, _FINE * chord) / chord)

    @cached_property
    def airfoil(self) -> Any:
        """As AeroSandbox has it: points spaced the same way on all sections, for fits depend on where they are."""
        return aerosandbox().Airfoil(name=self.name, coordinates=xy(_spaced(self.points)))

    @cached_property
    def _fit(self) -> tuple[Any, float]:
        """The class-shape curve, and how far the chord had to be turned for it, radians."""
        asb = aerosandbox()
        made = self.airfoil.normalize(return_dict=True)
        curve = made["airfoil"].to_kulfan_airfoil(n_weights_per_side=8, normalize_coordinates=False)
        assert isinstance(curve, asb.KulfanAirfoil)
        return curve, float(np.radians(made["rotation_angle"]))

    @cached_property
    def unseen(self) -> float:
        """Largest distance of the outline from the curve that NeuralFoil sees, in chords."""
        curve, _ = self._fit
        normal = self.airfoil.normalize()
        seen = shapely.LineString(np.asarray(curve.coordinates))
        return float(shapely.distance(seen, shapely.points(np.asarray(normal.coordinates))).max())

    def _run(self, alpha_rad: ArrayLike, reynolds: ArrayLike, n_crit: float) -> dict[str, Reals]:
        curve, turned = self._fit
        found: dict[str, Reals] = neuralfoil().get_aero_from_kulfan_parameters(
            curve.kulfan_parameters,
            alpha=np.degrees(np.atleast_1d(alpha_rad)) + np.degrees(turned),
            Re=reynolds,
            n_crit=n_crit,
            model_size=MODEL,
        )
        return found

    def forces(self, alpha_rad: ArrayLike, reynolds: float, n_crit: float = 9.0) -> Forces:
        """Coefficients at angles of attack.

        Parameters
        ----------
        alpha_rad
            (n,) to the chord, or a number.
        """
        alpha = np.atleast_1d(np.asarray(alpha_rad, dtype=float))
        found = self._run(alpha, reynolds, n_crit)
        return Forces(alpha, found["CL"], found["CD"], found["CM"], found["analysis_confidence"])

    def edge_speed(self, alpha_rad: float, reynolds: float, n_crit: float = 9.0) -> EdgeSpeed:
        """Speeds at NeuralFoil's stations."""
        found = self._run(alpha_rad, reynolds, n_crit)
        x = np.asarray(neuralfoil().bl_x_points)
        above, below = (
            np.array([float(found[f"{side}_bl_ue/vinf_{k}"][0]) for k in range(len(x))])
            for side in ("upper", "lower")
        )
        # NeuralFoil counts speeds above as positive and below as negative where they run to the trailing edge.
        return EdgeSpeed(
            np.concatenate([x[::-1], x]),
            np.arange(2 * len(x)) < len(x),
            -np.concatenate([above[::-1], below]),
        )


@dataclass(frozen=True)
class SectionPolar:
    """A section's coefficients over angle of attack at one Reynolds number, up to its largest lift.

    Attributes
    ----------
    forces
        Tabulated, lift rising throughout.
    reynolds
        Reynolds number.
    """

    forces: Forces
    reynolds: float

    @classmethod
    def of(cls, section: Section, reynolds: float, n_crit: float) -> SectionPolar:
        """Tabulate from the least to the largest lift within `SWEEP_RAD`."""
        found = section.forces(SWEEP_RAD, reynolds, n_crit)
        middle = int(np.argmin(np.abs(SWEEP_RAD)))
        # The stretch round zero angle in which lift rises: beyond it the section has stalled.
        rising = np.diff(found.lift) > 0.0
        last = middle + int(np.argmin(np.append(rising[middle:], False)))
        first = middle - int(np.argmin(np.append(rising[:middle][::-1], False)))
        keep = slice(first, last + 1)
        return cls(
            Forces(
                found.alpha_rad[keep], found.lift[keep], found.drag[keep], found.moment[keep], found.confidence[keep]
            ),
            reynolds,
        )

    @property
    def largest_lift(self) -> float:
        """C_l at which lift stops rising."""
        return float(self.forces.lift[-1])

    def drag(self, lift: ArrayLike) -> Reals:
        """C_d at C_l, elementwise; that of the ends beyond them."""
        return np.asarray(np.interp(np.asarray(lift, dtype=float), self.forces.lift, self.forces.drag))

    def alpha_rad(self, lift: float) -> float:
        """Angle of attack at C_l.

        Raises
        ------
        InputError
            The section does not have so much lift.
        """
        low, high = float(self.forces.lift[0]), self.largest_lift
        if not low <= lift <= high:
            raise InputError(
                "aircraft: the section stalls",
                value=f"C_l {lift:.3g} at Re {self.reynolds:.3g}",
                limit=f"{low:.3g} <= C_l <= {high:.3g}",
                remedy="fly faster, with more wing or less mass, or choose a section with more camber",
            )
        return float(np.interp(lift, self.forces.lift, self.forces.alpha_rad))


def _spaced(points: Points) -> Points:
    """The outline by `_POINTS` a side, dense at nose and trailing edge; the nose is farthest from that edge."""
    nose = int(np.abs(points - 0.5 * (points[0] + points[-1])).argmax())
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, _POINTS))
    sides = []
    for side in (points[: nose + 1], points[nose:]):
        along = np.append(0.0, np.cumsum(np.abs(np.diff(side))))
        at = share * along[-1]
        sides.append(np.interp(at, along, side.real) + 1j * np.interp(at, along, side.imag))
    return np.concatenate([sides[0], sides[1][1:]])


def chord_m(profile: Profile) -> float:
    """The chord of an airfoil profile.

    Raises
    ------
    InputError
        It is no airfoil.
    """
    chord = getattr(profile, "chord_m", None)
    if chord is None:
        raise InputError(
            "wing: its section is no airfoil",
            value=f'kind = "{profile.kind}"',
            limit="naca or points",
            remedy="give a design whose profile has a chord",
        )
    return float(chord)
