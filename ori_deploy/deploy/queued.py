"""What the bus was told, and what of it is due by now: a bus may queue goals ahead."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where a motion is at one moment.

    Attributes
    ----------
    goal_rad
        (n_hinges,) shaft positions.
    fold, path_time_s
        Place on the path; NaN where it is not known.
    rate
        Of the variable in use, with the sign of the direction.
    on_path
        Whether the goals are the path's.
    """

    goal_rad: FloatArray
    fold: float
    path_time_s: float
    rate: float
    on_path: bool


class Queued:
    """Places that were sent and are not all due yet.

    Parameters
    ----------
    queues
        Whether places are due later than they are sent.
    """

    def __init__(self, queues: bool) -> None:
        self._queues = queues
        self._places: deque[tuple[float, Place]] = deque()
        self._moving_until = -np.inf

    def restart(self, place: Place, now: float) -> None:
        """Begin from rest at a place that is due now."""
        self._places = deque([(now, place)])
        self._moving_until = -np.inf

    def note(self, place: Place, due_s: float) -> None:
        """A place was sent that is due then."""
        self._places.append((due_s, place))
        if self._queues and place.rate != 0.0:
            self._moving_until = due_s

    def cut(self, now: float, stop_s: float) -> None:
        """Nothing of what is to come will be carried out; everything rests in `stop_s`."""
        self._moving_until = now + stop_s

    def due(self, now: float) -> Place:
        """What should be carried out now, interpolated between places."""
        places = self._places
        while len(places) > 1 and places[1][0] <= now:
            places.popleft()
        begin, first = places[0]
        if len(places) == 1 or now <= begin:
            return first
        end, second = places[1]
        part = (now - begin) / (end - begin)
        return Place(
            goal_rad=first.goal_rad + part * (second.goal_rad - first.goal_rad),
            fold=first.fold + part * (second.fold - first.fold),
            path_time_s=first.path_time_s + part * (second.path_time_s - first.path_time_s),
            rate=first.rate + part * (second.rate - first.rate),
            on_path=first.on_path and second.on_path,
        )

    def at_rest(self, now: float) -> bool:
        """Whether nothing that was sent still moves or will."""
        return now >= self._moving_until
