"""Timing: how fast the path may be travelled under every crease's limits (toppra)."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from ori_deploy.errors import MotionError
from ori_deploy.motion.fourbar import FourBars
from ori_deploy.motion.plan import CREASES
from ori_deploy.profiles.profile import Reals

_NODES = 401

_NO_LIMIT = 1e3
"""Times the largest limit there is: stands in for no limit, which the solver cannot take."""

_MOST_SAMPLES = 1_000_000


def _nodes() -> Reals:
    """Folds at which the path is sampled: dense near the flat state, where thin walls make angles turn fast."""
    even = np.linspace(0.0, 1.0, _NODES)
    return 0.5 * even + 0.5 * even**3


def _range(limits: Reals) -> str:
    finite = limits[np.isfinite(limits)]
    return f"{finite.min():.3g} to {finite.max():.3g}"


def check_limits(limits: Reals, what: str, cell_ids: tuple[str, ...]) -> None:
    """Refuse crease limits that are not positive numbers (infinity: unlimited)."""
    bad = np.argwhere(~(limits > 0.0))
    if len(bad):
        cell, k = bad[0]
        raise MotionError(
            f"{what} limit of crease {CREASES[k]} of cell {cell_ids[cell]}: not a positive number",
            value=float(limits[cell, k]),
            limit="> 0 (inf for none)",
            remedy="mend the rig file",
        )


def time_path(
    four_bars: FourBars, velocity: Reals, acceleration: Reals, rate_hz: float
) -> tuple[Reals, Reals, Reals]:
    """Time-optimal fold(t) from 0 to 1 with every crease within its limits, at rest at both ends.

    Parameters
    ----------
    four_bars
        Kinematics.
    velocity, acceleration
        (n_cells, 4) limits of every crease's angle, rad/s and rad/s2; inf where there is none.
    rate_hz
        Sampling rate.

    Returns
    -------
    time (n,), fold (n,), fold rate (n,): sampled at the rate; the last sample is at rest at fold 1.

    Raises
    ------
    MotionError
        No crease has a limit, or toppra finds no timing.
    """
    limited = np.isfinite(velocity) | np.isfinite(acceleration)
    if not (np.isfinite(velocity).any() and np.isfinite(acceleration).any()):
        raise MotionError(
            "limits: no crease has a velocity limit, or none an acceleration limit",
            limit="at least one of each",
            remedy="mend the rig",
        )
    nodes = _nodes()
    speed = _path_speed(nodes, four_bars.angles(nodes)[:, limited], velocity[limited], acceleration[limited])
    if speed is None or not np.isfinite(speed).all():
        raise MotionError(
            "timing: no motion satisfies the limits",
            value=f"{_range(velocity)} rad/s, {_range(acceleration)} rad/s2",
            limit="limits of all creases within a few powers of ten of each other",
            remedy="mend the smallest or the largest",
        )
    return _sample(four_bars, nodes, speed, limited, velocity[limited], acceleration[limited], rate_hz)


def _path_speed(nodes: Reals, angles: Reals, top_v: Reals, top_a: Reals) -> Reals | None:
    """Largest fold rate at every node, at rest at both ends; None where toppra finds none."""
    # Imported here: it brings a plotting library along, half a second that no other command needs.
    import toppra
    from toppra import algorithm, constraint

    logging.getLogger("toppra").setLevel(logging.WARNING)
    top_v = np.where(np.isfinite(top_v), top_v, _NO_LIMIT * top_v[np.isfinite(top_v)].max())
    top_a = np.where(np.isfinite(top_a), top_a, _NO_LIMIT * top_a[np.isfinite(top_a)].max())
    # In units of time in which the fastest crease does one radian: the solver has no sense of other scales.
    unit = float(top_v.max())
    top_v, top_a = top_v / unit, top_a / unit**2
    constraints = [
        constraint.JointVelocityConstraint(np.stack([-top_v, top_v], axis=1)),
        constraint.JointAccelerationConstraint(
            np.stack([-top_a, top_a], axis=1), discretization_scheme=constraint.DiscretizationType.Interpolation
        ),
    ]
    path = toppra.SplineInterpolator(nodes, angles)
    solver = algorithm.TOPPRA(constraints, path, gridpoints=nodes, solver_wrapper="seidel")
    _, speed, _ = solver.compute_parameterization(0.0, 0.0)
    return None if speed is None else np.asarray(speed * unit, dtype=np.float64)


def _sample(
    four_bars: FourBars,
    nodes: Reals,
    speed: Reals,
    limited: NDArray[np.bool_],
    top_v: Reals,
    top_a: Reals,
    rate_hz: float,
) -> tuple[Reals, Reals, Reals]:
    """Sample the speed profile uniformly in time; stretch time by what sampling shows above the limits."""
    spans = 2.0 * np.diff(nodes) / (speed[:-1] + speed[1:])
    at_node = np.append(0.0, np.cumsum(spans))
    stretch = 1.0
    for _ in range(8):
        duration = at_node[-1] * stretch
        if not duration * rate_hz <= _MOST_SAMPLES:
            raise MotionError(
                "timing: the motion takes too long to be sampled",
                value=f"{duration:.3g} s at {rate_hz:g} Hz",
                limit=f"{_MOST_SAMPLES} samples",
                remedy="raise the crease limits or lower rate_hz",
            )
        count = max(int(np.ceil(duration * rate_hz)), 2)
        # The rate stays as asked and the end falls on a sample: time is stretched by less than one period.
        stretch = count / rate_hz / at_node[-1]
        time = np.arange(count + 1) / rate_hz
        path_time = np.minimum(time / stretch, at_node[-1])
        k = np.clip(np.searchsorted(at_node, path_time, side="right") - 1, 0, len(spans) - 1)
        into = path_time - at_node[k]
        gain = (speed[k + 1] - speed[k]) / spans[k]
        fold = nodes[k] + speed[k] * into + 0.5 * gain * into * into
        fold[0], fold[-1] = 0.0, 1.0
        rate = (speed[k] + gain * into) / stretch
        angles = four_bars.angles(np.clip(fold, 0.0, 1.0))[:, limited]
        first = np.diff(angles, axis=0) * rate_hz
        second = np.diff(first, axis=0) * rate_hz
        over = max(float((np.abs(first) / top_v).max()), float(np.sqrt((np.abs(second) / top_a).max())))
        if over <= 1.0 + 1e-9:
            return time, np.clip(fold, 0.0, 1.0), rate
        stretch *= over * 1.002
    raise MotionError(
        "timing: sampling at this rate cannot follow the limits",
        value=f"{over:.3g} times the limit at {rate_hz:g} Hz",
        limit="1",
        remedy="raise rate_hz or the limits",
    )
