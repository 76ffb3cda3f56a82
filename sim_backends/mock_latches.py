"""Simulated latches: each closes only when the creases it secures are truly in place."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.rig import LatchModel

FloatArray = NDArray[np.float64]

PIN_ENTRY = 0.5
"""Part of a pin's travel before it meets its hole; beyond it, it holds."""

GRIP_RAD = 0.005
"""How much a closed latch lets the creases move."""


@dataclass
class SimulatedLatch:
    """One latch, told at every step where the creases truly are.

    Attributes
    ----------
    id, model
        Its name, and kind with limits.
    closed_rad
        (n_hinges,) output positions at which what it secures is closed.
    range_rad
        (n_hinges,) how far from there it takes hold; inf for hinges it does not depend on.
    secures
        What it holds, as the rig names it.
    commanded
        The last command it accepted.
    travel
        lock_pin: how far it is driven in, 0 to 1.
    on_s
        electromagnet: time energised that has not been cooled off.
    trip
        Why it shut itself off, or None.
    stuck
        The mechanism stays as it is, whatever it is told.
    blind
        The sensor cannot tell.
    """

    id: str
    model: LatchModel
    closed_rad: FloatArray
    range_rad: FloatArray
    secures: str
    commanded: bool = False
    travel: float = 0.0
    on_s: float = 0.0
    trip: str | None = None
    stuck: bool = False
    blind: bool = False
    _energised_and_closed: bool = field(default=False, init=False)
    _stuck_closed: bool = field(default=False, init=False)

    def start_closed(self) -> None:
        """Begin the simulation engaged and home."""
        self.commanded = True
        self.travel = 1.0
        self._energised_and_closed = True

    def aligned(self, output_rad: FloatArray) -> bool:
        """Whether everything it secures is inside its capture range."""
        return bool((np.abs(output_rad - self.closed_rad) <= self.range_rad).all())

    def closed(self, output_rad: FloatArray) -> bool:
        """Whether it is truly closed."""
        if self.stuck:
            return self._stuck_closed
        if self.model.kind == "magnet":
            return self.aligned(output_rad)
        if self.model.kind == "lock_pin":
            return self.travel >= 1.0
        return self._energised_and_closed

    @property
    def restrains(self) -> bool:
        """Whether it keeps the creases from leaving. A passive magnet lets itself be pulled apart."""
        if self.stuck:
            return self._stuck_closed
        if self.model.kind == "lock_pin":
            return self.travel > PIN_ENTRY
        return self.model.kind == "electromagnet" and self._energised_and_closed

    def get_stuck(self, output_rad: FloatArray) -> None:
        """Freeze the mechanism: what is closed stays closed and holds, what is open stays open."""
        self._stuck_closed = self.closed(output_rad)
        self.stuck = True

    def step(self, duration_s: float, output_rad: FloatArray) -> None:
        """Advance. Passive magnets have no state of their own."""
        if self.stuck or self.model.kind == "magnet":
            return
        if self.model.kind == "lock_pin":
            self._step_pin(duration_s, output_rad)
        else:
            self._step_electromagnet(duration_s, output_rad)

    def _step_pin(self, duration_s: float, output_rad: FloatArray) -> None:
        assert self.model.travel_s is not None  # the rig's validation saw to it
        stroke = duration_s / self.model.travel_s
        if not self.commanded:
            self.travel = max(0.0, self.travel - stroke)
        elif self.travel > PIN_ENTRY or self.travel + stroke <= PIN_ENTRY or self.aligned(output_rad):
            self.travel = min(1.0, self.travel + stroke)

    def _step_electromagnet(self, duration_s: float, output_rad: FloatArray) -> None:
        duty, limit = self.model.duty_cycle, self.model.max_on_s
        assert duty is not None
        assert limit is not None
        if self.commanded:
            self.on_s += duration_s * (1.0 - duty)
            if self.on_s >= limit * (1.0 - duty) and duty < 1.0:
                self.commanded = False
                self.trip = f"was on for more than {limit:g} s; cooling"
        else:
            self.on_s = max(0.0, self.on_s - duration_s * duty)
            if self.trip is not None and self.on_s == 0.0:
                self.trip = None
        self._energised_and_closed = self.commanded and (self._energised_and_closed or self.aligned(output_rad))
