"""One variable for all cells, and how gently its rate changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from ruckig import ControlInterface, InputParameter, Result, Ruckig, Trajectory

JERK_PART = 0.25
"""Part of a ramp in which its slope builds up, and again in which it fades."""


@dataclass(frozen=True, slots=True)
class Ramp:
    """How steeply a rate may change.

    Attributes
    ----------
    slew_per_s
        Largest slope, 1/s.
    jerk_per_s2
        Largest change of the slope, 1/s²; infinite for a slope that is there at once.
    """

    slew_per_s: float
    jerk_per_s2: float

    @classmethod
    def lasting(cls, duration_s: float, steepest_per_s: float = float("inf")) -> Self:
        """From full rate to rest in `duration_s`, or longer where the slope is limited."""
        slew = min(1.0 / ((1.0 - JERK_PART) * duration_s), steepest_per_s)
        return cls(slew, slew / (JERK_PART * duration_s))

    @classmethod
    def within_cycles(cls, cycles: int, period_s: float) -> Self:
        """From full rate to rest in so many cycles, as an emergency wants it."""
        return cls(1.0 / (cycles * period_s), float("inf"))

    @property
    def build_up_s(self) -> float:
        """How long the slope takes to build up."""
        return self.slew_per_s / self.jerk_per_s2

    @property
    def longest_s(self) -> float:
        """From full rate, while it still grows, to rest: the slope has to turn round first."""
        return 1.0 / self.slew_per_s + 3.0 * self.build_up_s


class PathVariable:
    """A position with a rate in [-1, 1] that changes with bounded slope and jerk.

    Parameters
    ----------
    position, lower, upper
        Where it stands and the ends at which it stops.
    """

    def __init__(self, position: float, lower: float, upper: float) -> None:
        self.position = position
        self.rate = 0.0
        self._slope = 0.0
        self._lower = lower
        self._upper = upper
        self._solver = Ruckig(1)
        self._ask = InputParameter(1)
        self._ask.control_interface = ControlInterface.Velocity
        self._ask.target_acceleration = [0.0]
        self._answer = Trajectory(1)

    @property
    def at_rest(self) -> bool:
        """Whether the rate is exactly zero, and stays so."""
        return self.rate == 0.0 and self._slope == 0.0

    def advance(self, duration_s: float, target_rate: float, ramp: Ramp) -> None:
        """Move on, bringing the rate as near to the target as the ramp allows; rest at an end."""
        ask = self._ask
        ask.current_position, ask.current_velocity = [self.position], [self.rate]
        ask.current_acceleration, ask.target_velocity = [self._slope], [target_rate]
        ask.max_acceleration, ask.max_jerk = [ramp.slew_per_s], [ramp.jerk_per_s2]
        result = self._solver.calculate(ask, self._answer)
        if result not in (Result.Working, Result.Finished):
            raise ArithmeticError(f"no ramp from rate {self.rate!r}, slope {self._slope!r} to rate {target_rate!r}")
        (self.position,), (self.rate,), (self._slope,) = self._answer.at_time(duration_s)
        if self._answer.duration <= duration_s + 1e-9:  # rounding must not leave a crumb for one more cycle
            self.rate, self._slope = target_rate, 0.0  # exactly
        self.rate = min(max(self.rate, -1.0), 1.0)
        if not self._lower < self.position < self._upper:
            outward = self.rate > 0.0 if self.position >= self._upper else self.rate < 0.0
            self.position = min(max(self.position, self._lower), self._upper)
            if outward:  # the plan itself comes to rest at its ends
                self.halt()

    def at_end(self, direction: float) -> bool:
        """Whether it rests at the upper (direction above 0) or lower end."""
        return self.at_rest and self.position == (self._upper if direction > 0.0 else self._lower)

    def halt(self) -> None:
        """Rest at once: for when nothing can be commanded any more."""
        self.rate = self._slope = 0.0
