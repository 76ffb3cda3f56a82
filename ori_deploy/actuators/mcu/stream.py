"""Knots on their way into the device's queue: numbered, and sent again until the device has them in order.

The line keeps the order of messages. What the device does not have when it answers a poll, although it was
sent before that poll, is lost, and goes out again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ori_deploy.actuators.mcu.grid import Knot
from ori_deploy.wire.mcu import HINGES, Setpoints

NUMBERS = 1 << 16
TIMES = 1 << 32
IN_ONE = 2
"""Knots in a message."""


@dataclass(frozen=True, slots=True)
class _Numbered:
    number: int
    time_us: int
    position_urad: tuple[int, ...]
    velocity_mrad_s: tuple[int, ...]


class Stream:
    """The knots of one stream.

    Parameters
    ----------
    name
        As given to the device.
    first
        Number of its next knot; 0 but for a stream that was taken over.
    """

    def __init__(self, name: int, first: int = 0) -> None:
        self.name = name
        self._next = first
        self._waiting: deque[_Numbered] = deque()

    @property
    def unacknowledged(self) -> int:
        """Knots that the device has not said it has."""
        return len(self._waiting)

    def append(self, knots: Sequence[Knot]) -> tuple[Setpoints, ...]:
        """Number knots, and return the messages to send: each carries the one before as well, if there is room.

        A single lost message thus loses nothing.
        """
        fresh = [self._numbered(knot) for knot in knots]
        before = [self._waiting[-1]] if self._waiting and len(fresh) < IN_ONE else []
        self._waiting.extend(fresh)
        return self._messages(before + fresh)

    @property
    def oldest_due_s(self) -> float:
        """Device time at which the first knot is due that the device has not said it has; inf without any."""
        return 1e-6 * self._waiting[0].time_us if self._waiting else np.inf

    def acknowledge(self, contiguous: int) -> None:
        """The device has all knots before this number. A number that is none of those sent says nothing."""
        behind = (self._next - contiguous) % NUMBERS
        while len(self._waiting) > behind:
            self._waiting.popleft()

    def again(self) -> tuple[Setpoints, ...]:
        """Messages with everything that is not acknowledged."""
        return self._messages(list(self._waiting))

    def _numbered(self, knot: Knot) -> _Numbered:
        made = _Numbered(
            self._next,
            round(1e6 * knot.time_s),
            tuple(int(p) for p in np.rint(1e6 * knot.position_rad)),
            tuple(int(v) for v in np.rint(1e3 * knot.velocity_rad_s)),
        )
        self._next = (self._next + 1) % NUMBERS
        return made

    def _messages(self, knots: list[_Numbered]) -> tuple[Setpoints, ...]:
        return tuple(self._message(knots[i : i + IN_ONE]) for i in range(0, len(knots), IN_ONE))

    def _message(self, knots: list[_Numbered]) -> Setpoints:
        times, positions, velocities = [0] * IN_ONE, [0] * IN_ONE * HINGES, [0] * IN_ONE * HINGES
        for j, knot in enumerate(knots):
            n = len(knot.position_urad)
            times[j] = knot.time_us % TIMES
            positions[HINGES * j : HINGES * j + n] = knot.position_urad
            velocities[HINGES * j : HINGES * j + n] = knot.velocity_mrad_s
        return Setpoints(times, positions, velocities, knots[0].number, len(knots), self.name)
