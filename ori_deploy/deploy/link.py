"""The bus as the control loop sees it: silence is a reading, every other failure a fault."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ori_deploy.actuators.bus import (
    ActuatorBus,
    ActuatorFault,
    ActuatorRestarted,
    BusClosed,
    BusError,
    BusTimeout,
    CommandRefused,
    CorruptReply,
    HealthReadings,
    HingeReadings,
    LatchReading,
    LatchTripped,
    WatchdogTripped,
    believable,
)
from ori_deploy.actuators.rig import Latch
from ori_deploy.clock import Clock
from ori_deploy.deploy.latching import LatchWork
from ori_deploy.deploy.motion import FloatArray
from ori_deploy.deploy.result import Fault, FaultKind, StartRefused

_KINDS: tuple[tuple[type[BusError], FaultKind], ...] = (
    (BusClosed, FaultKind.BUS_CLOSED),
    (CommandRefused, FaultKind.COMMAND_REFUSED),
    (LatchTripped, FaultKind.LATCH_TRIPPED),
    (ActuatorRestarted, FaultKind.RESTARTED),
    (WatchdogTripped, FaultKind.WATCHDOG),
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
    clock, max_age_s
        By which a reading is too old.

    Attributes
    ----------
    lost
        The bus said that it is closed; nothing is asked of it until `connect`.
    braked
        The bus was told to brake; no goals until `torque_on`.
    latches
        Readings of the latches, as they last were answered.
    """

    def __init__(self, bus: ActuatorBus, trip: Callable[[Fault], None], clock: Clock, max_age_s: float) -> None:
        self.bus = bus
        self.lost = False
        self.braked = False
        self._trip = trip
        self._clock = clock
        self._max_age_s = max_age_s
        self._effort: float | None = None  # that the bus was told; None: not known
        self.latches = tuple(LatchReading(name, False, None, valid=False, time_s=np.nan) for name in bus.latch_ids)

    def connect(self) -> None:
        """Open the bus. Raises what it raises."""
        self.bus.connect()
        self.lost, self._effort = False, None

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
        """Readings, none of them valid when nobody answered; None when the bus failed otherwise."""
        if not self.lost:
            try:
                return self.bus.read_health()
            except (BusTimeout, CorruptReply):
                return HealthReadings.none(len(self.bus.hinge_ids))  # whoever judges it counts them
            except BusError as error:
                self._fail(error, now)
        return None

    def read_latches(self, now: float) -> tuple[LatchReading, ...] | None:
        """Readings, none of them valid when nobody answered; None when the bus failed otherwise."""
        if not self.lost:
            try:
                self.latches = self.bus.read_latches()
                return self.latches
            except (BusTimeout, CorruptReply):  # whoever waits for a latch must see that it is silent
                return tuple(
                    replace(latch, confirmed=None, valid=False, time_s=np.nan, fault=None) for latch in self.latches
                )
            except BusError as error:
                self._fail(error, now)
        return None

    def command_hinges(self, goal: FloatArray, velocity: FloatArray, now: float) -> None:
        """Send goals, and how fast the shafts move there."""
        if not self.lost:
            try:
                self.bus.command_hinges(goal, velocity)
            except BusError as error:
                self._fail(error, now)

    def brake(self) -> float:
        """Have a bus that queues goals come to rest at once, along them; time until then, in s.

        It takes no more goals before `torque_on`. A bus that fails here is no further fault: it is told to brake
        because of one.
        """
        if self.lost or self.bus.delay_s == 0.0:
            return 0.0
        self.braked = True
        try:
            return self.bus.brake()
        except BusError as error:  # the device brakes by itself when it hears nothing more
            self.lost = isinstance(error, BusClosed)
            return self.bus.delay_s

    def limit_effort(self, part: float, now: float) -> None:
        """Let hinges use this part of their strength; the bus is told when that changes."""
        if not self.lost and part != self._effort:
            try:
                self.bus.limit_effort(part)
                self._effort = part
            except BusError as error:
                self._fail(error, now)

    def command_latches(self, work: LatchWork, now: float) -> None:
        """Send a round of latch commands."""
        if not self.lost:
            try:
                work.command(self.bus)
            except BusError as error:
                self._fail(error, now)

    def relax_magnets(self, latches: Sequence[Latch], now: float) -> None:
        """Take the current off electromagnets that nobody watches any more."""
        for latch in latches:
            if latch.kind == "electromagnet" and not self.lost:
                try:
                    self.bus.release(latch.id)
                except BusError as error:
                    self._fail(error, now)

    def torque_on(self, attempts: int) -> FloatArray:
        """Turn torque on where every hinge believably stands, and return the goals.

        Raises
        ------
        CommandRefused
            A hinge does not say where it is now; no torque went on.
        """
        try:
            readings = self.fresh_readings(attempts)
        except StartRefused as error:
            raise CommandRefused(f"torque stays off: {error}") from error
        goal = self.bus.enable_torque(readings)
        self.braked, self._effort = False, 1.0
        return goal

    def reset_actuators(self, attempts: int, holding: bool) -> FloatArray:
        """Clear the actuators' own errors.

        Returns
        -------
        (n_hinges,) goals: where those that held and still hold are measured now; NaN when one is limp.
        """
        self._effort = None  # a servo that restarts forgets it
        self.bus.reset_errors()
        if holding and self.bus.read_health().torque_on.all():
            return self.torque_on(attempts)
        return np.full(len(self.bus.hinge_ids), np.nan)

    def fresh_health(self, attempts: int) -> HealthReadings:
        """Health that every hinge told. Raises as `fresh_readings` does."""
        missing = self.bus.hinge_ids
        for _ in range(attempts):
            try:
                health = self.bus.read_health()
            except (BusTimeout, CorruptReply):
                continue  # nobody answered: all are missing
            if health.sound.all():
                return health
            missing = tuple(name for name, sound in zip(self.bus.hinge_ids, health.sound, strict=True) if not sound)
        raise StartRefused(
            f"no valid health from {', '.join(missing)}",
            limit="temperature and voltage of every hinge before anything moves",
            remedy="check power and wiring",
        )

    def fresh_readings(self, attempts: int) -> HingeReadings:
        """Readings in which every hinge believably says where it is now.

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
            known = believable(readings, self._clock.now(), self._max_age_s)
            if known.all():
                return readings
            missing = tuple(name for name, valid in zip(self.bus.hinge_ids, known, strict=True) if not valid)
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
        detail, _, remedy = str(error).removeprefix(f"{thing}: ").partition("; remedy: ")
        self._trip(Fault(kind, thing, detail, remedy or "see the message", now))
