"""The bus as the control loop sees it: silence is a reading, every other failure a fault."""

from __future__ import annotations

from collections.abc import Callable

from ori_deploy.actuators.bus import (
    ActuatorBus,
    ActuatorFault,
    BusClosed,
    BusError,
    BusTimeout,
    CommandRefused,
    CorruptReply,
    HealthReadings,
    HingeReadings,
    LatchReading,
    LatchTripped,
)
from ori_deploy.deploy.latching import LatchWork
from ori_deploy.deploy.motion import FloatArray
from ori_deploy.deploy.result import Fault, FaultKind, StartRefused

_KINDS: tuple[tuple[type[BusError], FaultKind], ...] = (
    (BusClosed, FaultKind.BUS_CLOSED),
    (CommandRefused, FaultKind.COMMAND_REFUSED),
    (LatchTripped, FaultKind.LATCH_TRIPPED),
    (ActuatorFault, FaultKind.HARDWARE_ERROR),
    (BusError, FaultKind.BUS_ERROR),
)


class Link:
    """Calls a bus on the loop's behalf.

    Parameters
    ----------
    bus
        The bus.
    trip
        Receives every fault, at once.

    Attributes
    ----------
    lost
        The bus said that it is closed; nothing is asked of it until `connect`.
    """

    def __init__(self, bus: ActuatorBus, trip: Callable[[Fault], None]) -> None:
        self.bus = bus
        self.lost = False
        self._trip = trip

    def connect(self) -> None:
        """Open the bus. Raises what it raises."""
        self.bus.connect()
        self.lost = False

    def read_hinges(self, now: float) -> HingeReadings:
        """Readings, none of them valid when nobody answered."""
        if not self.lost:
            try:
                return self.bus.read_hinges()
            except (BusTimeout, CorruptReply):
                pass  # lost replies: whoever judges the readings counts them
            except BusError as error:
                self._fail(error, now)
        return HingeReadings.none(len(self.bus.hinge_ids))

    def read_health(self, now: float) -> HealthReadings | None:
        """Readings, or None when nobody answered."""
        if not self.lost:
            try:
                return self.bus.read_health()
            except (BusTimeout, CorruptReply):
                pass  # silence shows in the hinges' readings
            except BusError as error:
                self._fail(error, now)
        return None

    def read_latches(self, now: float) -> tuple[LatchReading, ...] | None:
        """Readings, or None when nobody answered."""
        if not self.lost:
            try:
                return self.bus.read_latches()
            except (BusTimeout, CorruptReply):
                pass  # not a confirmation: whoever waits for one runs into its timeout
            except BusError as error:
                self._fail(error, now)
        return None

    def command_hinges(self, goal: FloatArray, now: float) -> None:
        """Send goals."""
        if not self.lost:
            try:
                self.bus.command_hinges(goal)
            except BusError as error:
                self._fail(error, now)

    def command_latches(self, work: LatchWork, now: float) -> None:
        """Send a round of latch commands."""
        if not self.lost:
            try:
                work.command(self.bus)
            except BusError as error:
                self._fail(error, now)

    def fresh_readings(self, attempts: int) -> HingeReadings:
        """Readings in which every hinge answered.

        Raises
        ------
        StartRefused
            Not in that many attempts.
        BusError
            The bus failed otherwise.
        """
        missing = self.bus.hinge_ids
        for _ in range(attempts):
            try:
                readings = self.bus.read_hinges()
            except (BusTimeout, CorruptReply):
                continue  # nobody answered: all are missing
            if readings.valid.all():
                return readings
            missing = tuple(name for name, valid in zip(self.bus.hinge_ids, readings.valid, strict=True) if not valid)
        raise StartRefused(
            f"no valid position from {', '.join(missing)}",
            limit="a valid reading from every hinge before anything moves",
            remedy="check power and wiring",
        )

    def _fail(self, error: BusError, now: float) -> None:
        if isinstance(error, BusClosed):
            self.lost = True
        kind = next(kind for type_, kind in _KINDS if isinstance(error, type_))
        thing = error.actuator_id if isinstance(error, ActuatorFault) else "bus"
        self._trip(Fault(kind, thing, str(error), "see the message, then clear the fault", now))
