"""Closing or opening a set of latches, with patience that ends."""

from __future__ import annotations

from collections.abc import Sequence

from ori_deploy.actuators.bus import ActuatorBus, LatchReading
from ori_deploy.actuators.rig import Latch
from ori_deploy.deploy.monitor import describe
from ori_deploy.deploy.result import Fault, FaultKind

Latches = tuple[LatchReading, ...]


class LatchWork:
    """One round of commanding latches and waiting for their sensors.

    Closing is done when every sensor says closed. Opening is done when every sensor says open, but for
    passive magnets: those open when the motion that follows pulls them apart.

    Parameters
    ----------
    latches
        What to work on.
    engage
        Close or open.
    now
        Start of the wait.
    others
        Latches of the other end of the path, to be opened as well: nothing may move while one of them says
        that it is closed, though one that cannot tell is not waited for.
    """

    def __init__(self, latches: Sequence[Latch], engage: bool, now: float, others: Sequence[Latch] = ()) -> None:
        self._latches = tuple(latches)
        self._others = tuple(others)
        self._engage = engage
        self._started = now

    def command(self, bus: ActuatorBus) -> None:
        """Send the commands. Raises what the bus raises."""
        for latch in self._latches:
            if self._engage:
                bus.engage(latch.id)
            else:
                bus.release(latch.id)
        for latch in self._others:
            bus.release(latch.id)

    def pending(self, readings: Sequence[LatchReading]) -> tuple[Latch, ...]:
        """Latches that are not yet known to be as they should."""
        by_id = {reading.id: reading for reading in readings}
        undone = (latch for latch in self._latches if not self._done(latch, by_id[latch.id]))
        in_the_way = (latch for latch in self._others if not _harmless(latch, by_id[latch.id]))
        return (*undone, *in_the_way)

    def judge(self, readings: Sequence[LatchReading], now: float) -> Fault | None:
        """Fault of a latch that shut itself off, or has taken too long."""
        by_id = {reading.id: reading for reading in readings}
        for latch in self.pending(readings):
            reading = by_id[latch.id]
            if reading.fault is not None:
                return Fault(FaultKind.LATCH_TRIPPED, latch.id, reading.fault, "wait", now)
            if now - self._started > latch.timeout_s:
                wanted = "closed" if self._engage else "open"
                return Fault(
                    FaultKind.LATCH_TIMEOUT,
                    latch.id,
                    f"not {wanted} after {now - self._started:.2f} s, it is {describe(reading)}; "
                    f"limit: timeout_s = {latch.timeout_s:g}",
                    f"look at the latch on {latch.secures}",
                    now,
                )
        return None

    def _done(self, latch: Latch, reading: LatchReading) -> bool:
        if self._engage:
            return reading.valid and reading.confirmed is True
        return latch.kind == "magnet" or (reading.valid and reading.confirmed is False)


def _harmless(latch: Latch, reading: LatchReading) -> bool:
    return latch.kind == "magnet" or (reading.valid and reading.confirmed is not True)
