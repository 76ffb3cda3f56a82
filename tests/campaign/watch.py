"""What truly moves, looked at while the controller sleeps, and how late the machine itself was meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ori_deploy.clock import Clock

FloatArray = NDArray[np.float64]

LOOK_S = 0.005
"""Between two looks."""

LEAST_S = 0.003
"""Of sleep that has to be left for a look: it must not make the loop late itself."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """One look.

    Attributes
    ----------
    time_s
        On the controller's clock.
    shaft_rad
        (n_hinges,) where the shafts truly are; None when nobody wants to know.
    late_s
        For how long this process and the simulation have been kept waiting since `Watch.begin`.
    """

    time_s: float
    shaft_rad: FloatArray | None
    late_s: float


@dataclass
class Watch:
    """The controller's clock. From `begin` on it looks now and then, while it sleeps, how late the machine is.

    Parameters
    ----------
    clock
        The real one, or a virtual one.
    shafts
        (n_hinges,) where they truly are.
    simulation
        Process of the simulation; None for a virtual clock, on which nobody is late.

    Attributes
    ----------
    seeing
        Whether it looks at the shafts as well, which costs the simulation some time.
    """

    clock: Clock
    shafts: Callable[[], FloatArray]
    simulation: Callable[[], int] | None = None
    looks: list[Look] = field(default_factory=list)
    seeing: bool = False
    _watching: bool = False
    _overslept_s: float = 0.0
    _waited_s: tuple[float, float] = (0.0, 0.0)

    def now(self) -> float:
        """Seconds on a monotonic scale."""
        return self.clock.now()

    def begin(self) -> None:
        """Look now, and from now on."""
        self.looks, self._overslept_s = [], 0.0
        self._waited_s = self._waits()
        self._watching = True
        self.look()

    def look(self) -> None:
        """Look now."""
        self.looks.append(Look(self.clock.now(), self.shafts() if self.seeing else None, self._late_s()))

    def sleep_until(self, deadline: float) -> None:
        """As the clock does it, with looks in between."""
        if not self._watching:
            self.clock.sleep_until(deadline)
            return
        while (now := self.clock.now()) < deadline:
            if deadline - now > LEAST_S and now - self.looks[-1].time_s > 0.5 * LOOK_S:
                self.look()
            until = min(deadline, self.clock.now() + LOOK_S)
            self.clock.sleep_until(until)
            self._overslept_s += max(0.0, self.clock.now() - until)

    def late_s(self, begin_s: float, end_s: float) -> float:
        """For how long the machine had something else to do between two moments."""
        before = [look.late_s for look in self.looks if look.time_s <= begin_s]
        after = [look.late_s for look in self.looks if look.time_s >= end_s]
        return (after[0] if after else self.looks[-1].late_s) - (before[-1] if before else 0.0)

    def held_up_s(self, window_s: float) -> float:
        """For how long the machine had something else to do within such a time, at its worst."""
        times = np.array([look.time_s for look in self.looks])
        late = np.array([look.late_s for look in self.looks])
        ends = np.minimum(np.searchsorted(times, times + window_s), len(times) - 1)
        return float((late[ends] - late).max(initial=0.0))

    def still_from(self, away_rad: FloatArray) -> tuple[float, float]:
        """When the shafts were first seen where they stay, and how long before that somebody had looked.

        Parameters
        ----------
        away_rad
            (n_hinges,) as near to where it stays counts as being there.
        """
        seen = [(look.time_s, look.shaft_rad) for look in self.looks if look.shaft_rad is not None]
        last = seen[-1][1]
        moving = [k for k, (_, shaft) in enumerate(seen) if (np.abs(shaft - last) > away_rad).any()]
        if not moving:
            return seen[0][0], 0.0
        before, there = seen[moving[-1]][0], seen[min(moving[-1] + 1, len(seen) - 1)][0]
        return there, there - before

    def _late_s(self) -> float:
        """What was overslept shows in the time of waiting, too, as far as it was no fault of the timer."""
        own, other = (now - then for now, then in zip(self._waits(), self._waited_s, strict=True))
        return max(self._overslept_s, own) + other

    def _waits(self) -> tuple[float, float]:
        """How long this thread, and the simulation, ever were ready to run and had no processor."""
        if self.simulation is None:
            return 0.0, 0.0
        return _waited_s("self", threading.get_native_id()), _waited_s(self.simulation())


def _waited_s(process: int | str, thread: int | None = None) -> float:
    """As Linux counts it; 0 where nobody does."""
    tasks = Path(f"/proc/{process}/task")
    total_ns = 0
    for task in [tasks / str(thread)] if thread is not None else sorted(tasks.glob("*")):
        try:
            total_ns += int((task / "schedstat").read_text().split()[1])
        except (OSError, IndexError, ValueError):
            continue  # the thread has ended, or this system does not count
    return 1e-9 * total_ns
