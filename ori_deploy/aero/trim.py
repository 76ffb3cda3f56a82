"""Trim and stability by any method: what it takes to fly level, and how far behind the neutral point is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ori_deploy.aero.aircraft import Aircraft
from ori_deploy.aero.methods import Coefficients, Method
from ori_deploy.aero.polar import Polar, fitted
from ori_deploy.errors import InputError
from ori_deploy.profiles.profile import Reals

_STEP_RAD = np.radians(0.5)
_LARGEST_RAD = np.radians(25.0)
_FIRST_RAD = np.radians(4.0)
_CLOSE = 1e-5
_ROUNDS, _SLOPES_LAST = 20, 6
_SWEEPS, _NEAR_ENOUGH = 3, 0.03
SLOPE_STEP_RAD = np.radians(1.0)
"""To both sides of trim: what slopes are taken over."""


@dataclass(frozen=True)
class Trim:
    """Level flight.

    Attributes
    ----------
    alpha_rad, tail_rad
        Angle of attack of the fuselage, and incidence of the tail, trailing edge down positive.
    found
        Coefficients there; the moment is 0 where there is a tail.
    """

    alpha_rad: float
    tail_rad: float
    found: Coefficients


@dataclass(frozen=True)
class Stability:
    """About trim.

    Attributes
    ----------
    slope
        dC_L/dα, per radian.
    margin
        Static margin -dC_m/dC_L: the neutral point behind the centre of gravity, in mean aerodynamic chords.
    neutral_chord
        The neutral point behind the leading edge of the mean aerodynamic chord, in chords.
    """

    slope: float
    margin: float
    neutral_chord: float


@dataclass(frozen=True)
class Sweep:
    """A polar with the tail held at trim: (n,) angles, coefficients; and the parabola nearest to them."""

    alpha_rad: Reals
    lift: Reals
    drag: Reals
    polar: Polar
    misfit: float


def trimmed(craft: Aircraft, method: Method, lift: float) -> Trim:
    """Angle of attack and incidence of the tail at which C_L is `lift` and nothing turns the aircraft.

    Without a tail only C_L is met. Newton's method with differences, taken anew every six rounds only: the
    forces are nearly linear.

    Raises
    ------
    InputError
        There is no such trim within 25 degrees.
    """
    unknowns = 1 if craft.tail is None else 2
    at = np.array([_FIRST_RAD, 0.0])
    slopes = None
    for k in range(_ROUNDS):
        here = method.at(*at)
        off = np.array([here.lift - lift, here.moment])[:unknowns]
        if np.abs(off).max() < _CLOSE:
            return Trim(float(at[0]), float(at[1]), here)
        if slopes is None or k % _SLOPES_LAST == 0:
            slopes = _slopes(method, at, here)[:unknowns, :unknowns]
        at[:unknowns] -= np.linalg.solve(slopes, off)
        if np.abs(at).max() > _LARGEST_RAD:
            break
    raise InputError(
        f"aircraft: no trim by {method.name}",
        value=f"C_L {lift:.3g}, angle of attack {np.degrees(at[0]):.3g} deg, tail {np.degrees(at[1]):.3g} deg",
        limit=f"{np.degrees(_LARGEST_RAD):.0f} deg",
        remedy="fly faster, move the centre of gravity (mass.cg_chord), or give the tail more area or arm",
    )


def _slopes(method: Method, at: Reals, here: Coefficients) -> Reals:
    """(2, 2) change of lift and moment with angle of attack and incidence of the tail."""
    moved = [method.at(*(at + _STEP_RAD * direction)) for direction in np.eye(2)]
    return np.asarray(np.array([[m.lift - here.lift, m.moment - here.moment] for m in moved]).T / _STEP_RAD)


def stability(craft: Aircraft, method: Method, trim: Trim) -> Stability:
    """Slopes over a degree to both sides of trim."""
    up = method.at(trim.alpha_rad + SLOPE_STEP_RAD, trim.tail_rad)
    down = method.at(trim.alpha_rad - SLOPE_STEP_RAD, trim.tail_rad)
    slope = (up.lift - down.lift) / (2.0 * SLOPE_STEP_RAD)
    margin = -(up.moment - down.moment) / (up.lift - down.lift)
    return Stability(slope, margin, craft.cg_chord + margin)


def sweep(method: Method, trim: Trim, slope: float, lifts: tuple[float, float], count: int = 9) -> Sweep:
    """The polar between two lift coefficients, the tail held.

    Parameters
    ----------
    slope
        dC_L/dα, by which angles are chosen.
    lifts
        Least and largest C_L, about.
    """
    wanted = np.linspace(*lifts, count)
    alpha = trim.alpha_rad + (wanted - trim.found.lift) / slope
    for _ in range(_SWEEPS):
        found = [method.at(float(a), trim.tail_rad) for a in alpha]
        lift, drag = np.array([f.lift for f in found]), np.array([f.drag for f in found])
        if np.abs(lift - wanted).max() < _NEAR_ENOUGH or not (np.diff(lift) > 0.0).all():
            break
        alpha = np.interp(wanted, lift, alpha)
    return Sweep(alpha, lift, drag, *fitted(lift, drag))
