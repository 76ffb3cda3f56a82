"""Motion along the path, through one variable.

Everything that stops, slows or turns a motion does it here, through the rate of the path variable, so that
all cells stay in step whatever happens.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.path import PathTable
from ori_deploy.deploy.path_variable import PathVariable, Ramp
from ori_deploy.deploy.queued import Place
from ori_deploy.deploy.result import StartRefused
from ori_deploy.deploy.way import Way

FloatArray = NDArray[np.float64]


class Approach:
    """A short move from where every shaft stands to its place on the path, all arriving together.

    It starts and ends at rest (a cubic ease), and like the path it has one variable, whose rate can be
    brought to zero at any moment. Cells are less than the step tolerance apart when it begins, and no
    farther at any point of it.

    It lasts so long that every driven crease and its actuator keep their velocity and acceleration limits,
    the ramp of the variable included. Passive creases follow the driven ones and are not looked at here.

    Parameters
    ----------
    start_rad, target_rad
        (n_hinges,) shaft positions.
    rig
        Gives the gear ratios and `align_velocity_rad_s`.
    ramp
        How the variable is brought to its rate.
    """

    SHORTEST_S = 0.2

    def __init__(self, start_rad: FloatArray, target_rad: FloatArray, rig: ResolvedRig, ramp: Ramp) -> None:
        self._start = start_rad
        self._way = target_rad - start_rad
        way = np.abs(self._way / rig.shaft_per_crease)
        velocity, acceleration = (rig.driven(limit) for limit in rig.crease_limits())
        # With duration T the ease peaks at a speed of 1.5 way / T and an acceleration of 6 way / T**2; a ramp
        # of the variable adds slew * speed. So T solves acceleration T**2 = 1.5 slew way T + 6 way.
        start = 1.5 * ramp.slew_per_s * way
        slow = 1.5 * way / np.minimum(velocity, rig.controller.align_velocity_rad_s)
        gentle = (start + np.sqrt(start * start + 24.0 * way * acceleration)) / (2.0 * acceleration)
        self._duration_s = max(self.SHORTEST_S, float(slow.max()), float(gentle.max()))
        self.variable = PathVariable(0.0, 0.0, self._duration_s)

    @property
    def finished(self) -> bool:
        """Whether every shaft has been told to be on the path."""
        return self.variable.position >= self._duration_s

    def shaft(self) -> FloatArray:
        """(n_hinges,) shaft positions now."""
        u = self.variable.position / self._duration_s
        position: FloatArray = self._start + u * u * (3.0 - 2.0 * u) * self._way
        return position

    def velocity(self) -> FloatArray:
        """(n_hinges,) shaft velocities now."""
        u = self.variable.position / self._duration_s
        velocity: FloatArray = (6.0 * u * (1.0 - u) / self._duration_s * self.variable.rate) * self._way
        return velocity


def gentle_ramp(table: PathTable, rig: ResolvedRig) -> Ramp:
    """Ramp of the path rate for whatever is not a fault.

    As steep as `hold_ramp_s` asks, but never so steep that the change of rate alone takes more than the
    acceleration limit of any crease, driven or passive: `acceleration = crease_rate * slope`.

    That comes on top of the plan's own `rate**2 * acceleration`. The sum is bounded by twice the limit, not
    by the limit: a plan that brakes at its limit cannot be braked harder within it, and a stop goes first.
    """
    speed = table.peak_crease_rate_rad_s
    _, limits = rig.crease_limits()
    possible = np.divide(limits, speed, out=np.full_like(speed, np.inf), where=speed > 0.0)
    return Ramp.lasting(rig.controller.hold_ramp_s, float(possible.min()))


class Motion:
    """The goals of all hinges, from wherever they stand onto the path and along it.

    Attributes
    ----------
    goal
        (n_hinges,) shaft positions to command; NaN when the hinges are not told to hold.
    direction
        1 towards fold 1, -1 towards fold 0.
    gentle
        Ramp of the path rate for whatever is not a fault.
    """

    def __init__(self, table: PathTable, rig: ResolvedRig) -> None:
        self._table = table
        self._rig = rig
        self._period_s = 1.0 / rig.rate_hz
        self.gentle = gentle_ramp(table, rig)
        self._path = PathVariable(0.0, 0.0, table.duration_s)
        self._approach: Approach | Way | None = None
        self._placed = False
        self.goal = np.full(len(rig.hinges), np.nan)
        self.direction = 1.0

    def stand(self, goal: FloatArray) -> None:
        """Hold these positions, on the path or not."""
        self._approach, self._placed = None, False
        self.goal = goal

    def let_go(self) -> None:
        """Hold nothing."""
        self.stand(np.full_like(self.goal, np.nan))

    def go(self, place_s: float, direction: float) -> None:
        """From the present goals to the path at `place_s`, then along it.

        Raises `StartRefused` when the place is not a number.
        """
        if not (np.isfinite(place_s) and np.isfinite(self.goal).all()):
            raise StartRefused("the place on the path is not known", remedy="arm again, then look at the sensors")
        self._path = PathVariable(place_s, 0.0, self._table.duration_s)
        self._approach = Approach(self.goal, self._table.shaft_at(place_s), self._rig, self.gentle)
        self._placed = True
        self.direction = direction

    def follow(self, way: Way) -> None:
        """Along a checked way that brings cells into step; where on the path it ends is found out by measuring."""
        self._approach, self._placed = way, False
        self.direction = 1.0

    @property
    def placed(self) -> bool:
        """Whether the place on the path is known, and all cells belong there."""
        return self._placed

    @property
    def followed(self) -> bool:
        """Whether a way was followed to its end."""
        return not self._placed and self._approach is None

    @property
    def holding(self) -> bool:
        """Whether there are goals."""
        return not np.isnan(self.goal[0])

    @property
    def on_path(self) -> bool:
        """Whether the goals are the path's."""
        return self._placed and self._approach is None

    @property
    def rate(self) -> float:
        """Rate of the variable in use, with the sign of the direction."""
        return self._path.rate if self._approach is None else self.direction * self._approach.variable.rate

    @property
    def at_rest(self) -> bool:
        """Whether the rate is exactly zero."""
        return (self._path if self._approach is None else self._approach.variable).at_rest

    @property
    def arrived(self) -> bool:
        """Whether the goals are the end of the path in the direction of the motion, at rest."""
        return self.on_path and self._path.at_end(self.direction)

    @property
    def path_time_s(self) -> float:
        """Place on the path; NaN while it is not known."""
        return self._path.position if self._placed else np.nan

    @property
    def fold(self) -> float:
        """Fold at that place; NaN while it is not known."""
        return self._table.fold_at(self._path.position) if self._placed else np.nan

    @property
    def velocity(self) -> FloatArray:
        """(n_hinges,) how fast the shafts move at their goals."""
        if self._approach is not None:
            return self._approach.velocity()
        if self._placed and not self.at_rest:
            return self._path.rate * self._table.shaft_rate_at(self._path.position)
        return np.zeros_like(self.goal)

    def place(self) -> Place:
        """Where the goals are."""
        return Place(self.goal, self.fold, self.path_time_s, self.rate, self.on_path)

    def turn(self, direction: float) -> None:
        """From here on in that direction; what moves slows down, rests for a moment and comes back.

        Cells that are still being brought onto the path get there first.
        """
        self.direction = direction

    def advance(self, rate: float, ramp: Ramp | None = None) -> None:
        """One period on, the rate brought towards `rate` (0 to 1) in the direction of the motion.

        Without a ramp, on the gentle one.
        """
        ramp = ramp or self.gentle
        if self._approach is not None:
            self._approach.variable.advance(self._period_s, rate, ramp)
            self.goal = self._approach.shaft()
            if self._approach.finished:
                self._approach = None
        elif self._placed:
            self._path.advance(self._period_s, self.direction * rate, ramp)
            self.goal = self._table.shaft_at(self._path.position)

    def halt(self) -> None:
        """Rest at once: for when nothing can be commanded any more."""
        self._path.halt()
        if self._approach is not None:
            self._approach.variable.halt()
