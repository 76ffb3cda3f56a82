"""How far the structure is from where it should be by now, also behind a bus that queues goals ahead."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.result import CycleRecord

FloatArray = NDArray[np.float64]

_SPARE_CYCLES = 4
"""Goals kept beyond those that are queued: the clocks of host and device differ a little."""


class DueGoals:
    """The largest distance between measured and due, over a session.

    Parameters
    ----------
    rig
        Whose hinges.
    delay_s
        How long after its command a goal is due.
    due_s
        When a goal that is sent now is due, where the bus knows better.

    Attributes
    ----------
    off_rad
        In the last cycle, at the driven crease that is off most; 0 where nothing could be compared.
    worst_rad, worst_hinge
        At the driven crease, and the actuator's id; 0 and None before anything was compared.
    """

    def __init__(self, rig: ResolvedRig, delay_s: float, due_s: Callable[[float], float] | None = None) -> None:
        self._rig, self._delay_s = rig, delay_s
        self._due_s = due_s or (lambda now: now + delay_s)
        queued = int(np.ceil(delay_s * rig.rate_hz))
        self._sent: deque[tuple[float, FloatArray]] = deque(maxlen=queued + _SPARE_CYCLES)
        self.off_rad = self.worst_rad = 0.0
        self.worst_hinge: str | None = None

    def note(self, record: CycleRecord) -> None:
        """Compare a cycle's readings with what was due, and remember what it sent."""
        self.off_rad = 0.0
        # After a fault a device may brake along goals that nobody sent: not comparable any more.
        if record.fault is None and np.isfinite(record.commanded_rad).all():
            self._compare(record)
            self._sent.append((self._due_s(record.time_s), record.commanded_rad))
        else:
            self._sent.clear()

    def _compare(self, record: CycleRecord) -> None:
        due = self._due(record.time_s)
        if due is None:
            return
        off = np.abs(self._rig.to_crease(record.readings.position_rad) - self._rig.to_crease(due))
        off[~np.isfinite(off)] = 0.0
        worst = int(np.argmax(off))
        self.off_rad = float(off[worst])
        if self.off_rad > self.worst_rad:
            self.worst_rad, self.worst_hinge = self.off_rad, self._rig.hinge_ids[worst]

    def _due(self, now: float) -> FloatArray | None:
        """The goal that is due now; None before the first is."""
        before: tuple[float, FloatArray] | None = None
        for due_s, goal in self._sent:
            if due_s > now:
                if before is None or self._delay_s == 0.0:
                    break
                part = (now - before[0]) / (due_s - before[0])
                between: FloatArray = before[1] + part * (goal - before[1])
                return between
            before = (due_s, goal)
        return None if before is None else before[1]
