"""The device's clock as the host sees it: what is certain about it, and how certain.

Every exchange says that the device's clock showed a certain time at some moment between question and answer.
Two exchanges bound the clock's rate, all of them together bound what it shows; slow exchanges bound less, and
so drop out by themselves. The estimate is the middle of what is possible, the error half its width.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import CommandRefused

FloatArray = NDArray[np.float64]

WORST_RATE = 0.01
"""No clock is that far off: a ceramic resonator has 0.005."""

WANDER = 20e-6
"""How much a clock's rate may change while exchanges are remembered."""

RESOLUTION_S = 8e-6
"""Of the device's clock, and of the stamps."""

MEMORY = 64
"""Exchanges that are remembered."""

MAX_ERROR_S = 0.01
"""With a larger error goals would be due at nobody knows what time."""


class Timebase:
    """Turns host time into device time, and back."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=MEMORY)
        self.forget()

    def forget(self) -> None:
        """Know nothing: the device restarted, or another one is there."""
        self._samples.clear()
        self._anchor_s = 0.0
        self._rate_low, self._rate_high = 1.0 - WORST_RATE, 1.0 + WORST_RATE
        self._low_s, self._high_s = -np.inf, np.inf

    @property
    def rate(self) -> float:
        """Seconds of the device in a second of the host."""
        return 0.5 * (self._rate_low + self._rate_high)

    @property
    def rate_error(self) -> float:
        """How far off the rate may be."""
        return 0.5 * (self._rate_high - self._rate_low)

    def add(self, sent_s: float, received_s: float, device_s: float) -> None:
        """Take in an exchange.

        Parameters
        ----------
        sent_s, received_s
            Host time of question and answer.
        device_s
            What the device's clock showed in between.
        """
        if not received_s >= sent_s:
            raise ValueError(f"an answer at {received_s} s to a question at {sent_s} s")
        self._samples.append((sent_s, received_s, device_s))
        # What contradicts the newest is of another clock: one that restarted, or that runs otherwise now.
        while not self._solve():
            self._samples.popleft()

    def device_s(self, host_s: float) -> float:
        """What the device's clock shows at a host time.

        Raises
        ------
        CommandRefused
            Nobody knows well enough.
        """
        self._require(host_s)
        return self._middle_s + self.rate * (host_s - self._anchor_s)

    def host_s(self, device_s: float, now_s: float) -> float:
        """Host time at which the device's clock shows `device_s`; not long before or after `now_s`.

        Raises as `device_s` does at `now_s`.
        """
        return now_s + (device_s - self.device_s(now_s)) / self.rate

    def error_s(self, host_s: float) -> float:
        """How far off `device_s` may be at a host time; inf when nothing is known."""
        return 0.5 * (self._high_s - self._low_s) + self.rate_error * abs(host_s - self._anchor_s)

    def good_at(self, host_s: float) -> bool:
        """Whether the clock is known well enough at a host time."""
        return self.error_s(host_s) <= MAX_ERROR_S

    @property
    def _middle_s(self) -> float:
        return 0.5 * (self._low_s + self._high_s)

    def _require(self, host_s: float) -> None:
        error = self.error_s(host_s)
        if not error <= MAX_ERROR_S:
            raise CommandRefused(
                f"the microcontroller's clock is known to {1e3 * error:.3g} ms only; "
                f"limit: {1e3 * MAX_ERROR_S:g} ms; remedy: check the cable, then connect again"
            )

    def _solve(self) -> bool:
        """Bounds from all exchanges; False when no clock can have shown all of it."""
        sent, received, shown = np.array(self._samples).T
        low, high = _rate_bounds(sent, received, shown)
        if low > high:
            return False
        middle = 0.5 * (sent + received)
        age = middle[-1] - middle
        half = 0.5 * high * (received - sent) + RESOLUTION_S
        later = np.maximum(age, 0.0)
        earlier = np.minimum(age, 0.0)  # questions answered out of order
        least = float((shown - half + low * later + high * earlier).max())
        most = float((shown + half + high * later + low * earlier).min())
        if least > most:
            return False
        self._anchor_s = float(middle[-1])
        self._rate_low, self._rate_high, self._low_s, self._high_s = low, high, least, most
        return True


def _rate_bounds(sent: FloatArray, received: FloatArray, shown: FloatArray) -> tuple[float, float]:
    """Slowest and fastest that a clock can have run that showed all this."""
    gained = shown[None, :] - shown[:, None]
    longest = received[None, :] - sent[:, None]
    shortest = sent[None, :] - received[:, None]
    apart = shortest > 0.0  # the second question after the first answer
    if not apart.any():
        return 1.0 - WORST_RATE, 1.0 + WORST_RATE
    slack = 2.0 * RESOLUTION_S
    slowest = float(((gained[apart] - slack) / longest[apart]).max()) - WANDER
    fastest = float(((gained[apart] + slack) / shortest[apart]).min()) + WANDER
    return max(slowest, 1.0 - WORST_RATE), min(fastest, 1.0 + WORST_RATE)
