"""When goals are due: a grid of device time that the queue is kept filled along.

Goals come once per cycle of a loop that is now and then late. On the grid they are evenly spaced all the
same: a late cycle makes the queue shorter, not the motion uneven. The queue is filled up again by stretching
the spacing a little, at the velocities that go with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.mcu.records import device_acceleration, device_velocity
from ori_deploy.actuators.mcu.wiring import Hinge

FloatArray = NDArray[np.float64]

LONGEST_S = 1.0
"""Segment that a device accepts."""

LONGER = 1.1
"""Step by which a segment that is too steep is made longer."""

SHORTEST_S = 1.5e-3
"""Knots are at least 1 ms apart, and times are rounded."""

NOTICE_S = 0.15
"""How far ahead a motion begins at least: its first knots may be lost, and have to be sent again."""

SPARE_KNOTS = 6
"""Knots of a motion that may be queued beyond the lead, by a loop that was late and then catches up. What the
device has no room for it leaves, and gets again with the next reading."""

MOST_STRETCH, MOST_SQUEEZE = 0.01, 0.0025
SLOWLY = 0.001
"""Change of the stretch from knot to knot, so that it hardly accelerates anything."""


@dataclass(frozen=True, slots=True, eq=False)
class Knot:
    """A goal and its time.

    Attributes
    ----------
    time_s
        Device time.
    position_rad, velocity_rad_s
        (n_hinges,) shafts, by device time.
    """

    time_s: float
    position_rad: FloatArray
    velocity_rad_s: FloatArray

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves there, as the device sees it: in mrad/s."""
        return not np.rint(1e3 * self.velocity_rad_s).any()


class Grid:
    """Times of the knots of one stream.

    Parameters
    ----------
    hinges
        Whose limits count.
    period_s, lead_s, min_lead_s
        Of the loop, and as in the settings; host time.
    """

    def __init__(self, hinges: tuple[Hinge, ...], period_s: float, lead_s: float, min_lead_s: float) -> None:
        self._period, self._lead, self._min_lead = period_s, lead_s, min_lead_s
        self._most = lead_s + SPARE_KNOTS * period_s
        self._names = [hinge.name for hinge in hinges]
        self._velocity = np.array([hinge.max_velocity_rad_s for hinge in hinges])
        self._acceleration = np.array([hinge.max_acceleration_rad_s2 for hinge in hinges])
        self._device_velocity = np.array([device_velocity(v) for v in self._velocity])
        self._device_acceleration = np.array([device_acceleration(a) for a in self._acceleration])
        self._last = Knot(-np.inf, np.zeros(len(hinges)), np.zeros(len(hinges)))
        self._stretch = 0.0

    @property
    def last(self) -> Knot:
        """The last knot; its time is -inf before the first."""
        return self._last

    def stand(self, position_rad: FloatArray) -> None:
        """The hinges stand here, and nothing is queued."""
        self._last = Knot(-np.inf, np.array(position_rad), np.zeros(len(position_rad)))
        self._stretch = 0.0

    def has_room(self, now_s: float, rate: float, velocity_rad_s: FloatArray) -> bool:
        """Whether another goal can be queued now.

        Rest that follows rest is not queued beyond the lead, where it would only be in the way. Goals of a
        motion are all queued: without one of them the next would be too far away.
        """
        rests = self._last.at_rest and not velocity_rad_s.any()
        return self._last.time_s <= now_s + rate * (self._lead if rests else self._most)

    def next(
        self, now_s: float, rate: float, position_rad: FloatArray, velocity_rad_s: FloatArray
    ) -> tuple[Knot, ...]:
        """The knots that take the hinges to a goal; two when the motion begins from rest.

        Parameters
        ----------
        now_s
            Device time.
        rate
            Seconds of the device in a second of the host.
        position_rad, velocity_rad_s
            (n_hinges,) the goal; velocity by host time.

        Raises
        ------
        CommandRefused
            From rest, the goal is too far away for one step.
        """
        period = rate * self._period
        target = now_s + rate * self._lead
        last = self._last
        begins = last.at_rest and last.time_s + period < now_s + rate * self._min_lead
        if last.at_rest:
            self._stretch = 0.0
        else:
            self._steer(target - (last.time_s + period), period)
        velocity = velocity_rad_s / (rate * (1.0 + self._stretch))
        spacing = period * (1.0 + self._stretch)
        if last.at_rest:
            spacing = self._from_rest(position_rad - last.position_rad, velocity, spacing, target - last.time_s)
        knots: tuple[Knot, ...] = ()
        if begins:
            earliest = max(now_s + rate * NOTICE_S, last.time_s + SHORTEST_S)
            last = Knot(max(target - spacing, earliest), last.position_rad, last.velocity_rad_s)
            knots = (last,)
        self._last = Knot(last.time_s + spacing, np.array(position_rad, dtype=np.float64), velocity)
        return (*knots, self._last)

    def _steer(self, behind_s: float, period: float) -> None:
        """Stretch the spacing while the queue is too short, squeeze it while it is too long."""
        wanted = float(np.clip(MOST_STRETCH * behind_s / period, -MOST_SQUEEZE, MOST_STRETCH))
        self._stretch += float(np.clip(wanted - self._stretch, -SLOWLY, SLOWLY))

    def _from_rest(self, way: FloatArray, velocity: FloatArray, spacing: float, to_target: float) -> float:
        """Time from rest to a goal: the spacing, or longer where a lone goal is far away.

        Rest that follows rest may last as it likes, and so brings the queue to its length. On the grid the
        device's limits count, as for every knot; a step may take what its actuators can.
        """
        if not way.any() and not velocity.any():
            return float(np.clip(to_target, 0.5 * spacing, 2.0 * spacing))
        if _within(way, velocity, spacing, self._device_velocity, self._device_acceleration):
            return spacing
        while spacing <= LONGEST_S:
            if _within(way, velocity, spacing, self._velocity, self._acceleration):
                return spacing
            spacing *= LONGER
        k = int(np.argmax(np.abs(way) / self._velocity))
        raise CommandRefused(
            f"goal of {self._names[k]} is {abs(way[k]):.4g} rad from where it rests, too far for one step; "
            f"limit: what it can do within {LONGEST_S:g} s; remedy: command goals on the way there"
        )


def _within(
    way: FloatArray, velocity: FloatArray, duration: float, max_velocity: FloatArray, max_acceleration: FloatArray
) -> bool:
    """Whether cubic segments from rest keep their limits, judged as the device does.

    The velocity lies within the hull of its Bernstein coefficients 0, `middle`, `velocity`, halved once.
    """
    middle = 3.0 * way / duration - velocity
    steepest = 2.0 * np.maximum(np.abs(middle), np.abs(velocity - middle)) / duration
    fastest = np.max(
        [0.5 * np.abs(middle), 0.25 * np.abs(2.0 * middle + velocity), 0.5 * np.abs(middle + velocity)], axis=0
    )
    inside = (steepest <= max_acceleration) & (np.maximum(fastest, np.abs(velocity)) <= max_velocity)
    return bool(inside.all())
