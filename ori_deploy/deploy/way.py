"""A checked way back onto the path, as shaft positions: straight lines between corners, at rest in each of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.path_variable import PathVariable, Ramp
from ori_deploy.motion.plan import Plan
from ori_deploy.motion.recovery import Recovery

FloatArray = NDArray[np.float64]

_SAMPLES = 65
"""Places on each leg at which the creases' rates are looked at."""

_SHORTEST_S = 0.2


class Way:
    """A move along a recovery's corners. Like the path it has one variable, whose rate can be brought to zero.

    Every leg lasts so long that every crease, driven or not, keeps its velocity and acceleration limits and
    every driven one the speed at which cells are brought into step.

    Parameters
    ----------
    recovery
        The corners.
    goal_rad
        (n_hinges,) where the shafts are told to be now; what they are off the first corner is taken out on
        the first leg.
    plan, rig
        Angles of every crease at every fold, and their limits.
    ramp
        How the variable is brought to its rate.

    Attributes
    ----------
    corners
        (m, n_cells) folds.
    """

    def __init__(self, recovery: Recovery, goal_rad: FloatArray, plan: Plan, rig: ResolvedRig, ramp: Ramp) -> None:
        self.corners = np.asarray(recovery.fold, dtype=np.float64)
        self._plan, self._rig = plan, rig
        self._off = goal_rad - self._shaft(self.corners[0])
        off = np.abs(self._off / rig.shaft_per_crease).max()
        lasts = [self._leg_s(a, b, off if k == 0 else 0.0, ramp) for k, (a, b) in enumerate(pairwise(self.corners))]
        self._begins = np.concatenate([[0.0], np.cumsum(lasts)])
        self.variable = PathVariable(0.0, 0.0, float(self._begins[-1]))

    @property
    def finished(self) -> bool:
        """Whether every shaft has been told to be at the last corner."""
        return self.variable.position >= float(self._begins[-1])

    def folds(self) -> FloatArray:
        """(n_cells,) folds that the cells are told to have now."""
        leg, _, eased = self._place()
        folds: FloatArray = self.corners[leg] + eased * (self.corners[leg + 1] - self.corners[leg])
        return folds

    def shaft(self) -> FloatArray:
        """(n_hinges,) shaft positions now."""
        leg, _, eased = self._place()
        off = self._off * (1.0 - eased) if leg == 0 else 0.0
        return self._shaft(self.folds()) + off

    def velocity(self) -> FloatArray:
        """(n_hinges,) how fast the shafts move, by difference along the variable."""
        here, step = self.variable.position, 1e-4
        rate = self.variable.rate
        before, after = max(here - step, 0.0), min(here + step, float(self._begins[-1]))
        try:
            self.variable.position = after
            ahead = self.shaft()
            self.variable.position = before
            behind = self.shaft()
        finally:
            self.variable.position = here
        return rate * (ahead - behind) / (after - before)

    def _place(self) -> tuple[int, float, float]:
        """Leg, part of its time that has passed, and of its way."""
        leg = int(np.searchsorted(self._begins, self.variable.position, side="right")) - 1
        leg = min(max(leg, 0), len(self._begins) - 2)
        u = (self.variable.position - self._begins[leg]) / (self._begins[leg + 1] - self._begins[leg])
        u = min(max(float(u), 0.0), 1.0)
        return leg, u, u * u * (3.0 - 2.0 * u)

    def _angles(self, folds: FloatArray) -> FloatArray:
        """(n_cells, 4) angles of all creases at the cells' own folds, (m, n_cells, 4) for (m, n_cells)."""
        plan = self._plan
        angles = np.empty((*folds.shape, 4))
        for c in range(len(plan.cell_ids)):
            for k in range(4):
                angles[..., c, k] = np.interp(folds[..., c], plan.fold, plan.crease_angles_rad[:, c, k])
        return angles

    def _shaft(self, folds: FloatArray) -> FloatArray:
        return self._rig.to_actuator(self._angles(folds))

    def _leg_s(self, begin: FloatArray, end: FloatArray, off_rad: float, ramp: Ramp) -> float:
        """How long a leg takes; an ease of duration T is 1.5 / T fast and 6 / T**2 accelerated, a ramp adds to it."""
        part = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
        angles = self._angles(begin + part * (end - begin))
        first = np.abs(np.gradient(angles, part[:, 0], axis=0)).max(axis=0) + off_rad
        second = np.abs(np.gradient(np.gradient(angles, part[:, 0], axis=0), part[:, 0], axis=0)).max(axis=0)
        velocity, acceleration = self._rig.crease_limits()
        velocity = np.minimum(velocity, self._rig.controller.align_velocity_rad_s)
        start = 1.5 * ramp.slew_per_s * first
        bent = 6.0 * first + 2.25 * second
        limited = np.isfinite(acceleration)
        start, bent, acceleration = start[limited], bent[limited], acceleration[limited]
        gentle = (start + np.sqrt(start * start + 4.0 * bent * acceleration)) / (2.0 * acceleration)
        return max(_SHORTEST_S, float((1.5 * first / velocity).max()), float(gentle.max(initial=0.0)))
