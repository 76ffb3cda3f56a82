"""One servo under torque for a while: watched all the time, and put back as it was whatever happens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

from ori_deploy.actuators.bus import ActuatorFault, BusError, CommandRefused
from ori_deploy.actuators.dynamixel.line import Pong, ServoLine, ServoRefused
from ori_deploy.actuators.dynamixel.startup import MARK_ADDRESS, mark_of, read, write
from ori_deploy.actuators.dynamixel.wiring import RAD_PER_COUNT
from ori_deploy.bench.meaning import error_words
from ori_deploy.bench.servos import Snapshot, known_model, snapshot
from ori_deploy.clock import Clock
from ori_deploy.errors import OriDeployError
from ori_deploy.wire.dynamixel import OperatingMode, Register
from ori_deploy.wire.dynamixel.models import WATCHDOG_FIRMWARE
from ori_deploy.wire.dynamixel.registers import CENTRE_COUNT, WATCHDOG_UNIT_S

WATCHDOG_S = 1.0
"""A servo that hears nothing for so long stops; slow motions do not go far in it."""

CYCLE_S = 0.03
"""Time between two looks at a servo that moves."""


class NotRestored(BusError):
    """A servo could not be put back as it was found; the message says what is different."""


class NotReached(BusError):
    """A servo did not get to where it was sent. It stands where it stopped."""


class Guarded:
    """A context in which one servo is moved.

    On the way out the watchdog is off, the torque as it was found, and every register that was set holds what
    it held before. After an exception the servo is stopped where it is first. Nobody's word for its turns is given
    back: whoever changes its mode makes it forget them. An interrupt on the way out waits for its end.

    Parameters
    ----------
    line
        With the port at the servo's rate.
    pong
        The servo.
    clock
        Real time.
    keep_holding
        Leave torque on at the end, unless an exception ends it.
    forgets
        Called as soon as it is about to forget turns that somebody had vouched for, whatever becomes of it then.

    Attributes
    ----------
    held_before
        Whether torque was on when it was found.
    has_watchdog
        Whether its firmware has one.
    """

    def __init__(
        self,
        line: ServoLine,
        pong: Pong,
        clock: Clock,
        *,
        keep_holding: bool = False,
        forgets: Callable[[], None] = lambda: None,
    ) -> None:
        self.line, self.clock, self.id = line, clock, pong.id
        self.model = known_model(pong)
        self.table = self.model.table
        self.has_watchdog = pong.firmware >= WATCHDOG_FIRMWARE
        self._pong, self._keep_holding, self._forgets = pong, keep_holding, forgets
        self.held_before = self._holding = self._begun = False
        self._interrupted = False
        self._goals: tuple[int, int] | None = None  # least and most; locked while torque is on, so read once
        self._found: dict[Register, int] = {}

    def __enter__(self) -> Self:
        self.held_before = self._holding = bool(self.read(self.table.torque_enable))
        if self._holding:
            self._goals = self._goal_limits()
        self._clear_trip()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        wrong: list[str] = []
        if self._begun and isinstance(error, OriDeployError):
            error.refused = False  # whatever refused it, it has been on its way, or counts other turns now
        if error is not None and self._holding:
            self._try(self.stop, "it may still move", wrong)
        holds = self.held_before or (self._keep_holding and error is None)
        if not holds and self._holding:
            self._try(self._let_go, "torque may be on", wrong)
        if self.has_watchdog:
            self._try(lambda: self.write(self.table.bus_watchdog, 0), "its watchdog may be armed", wrong)
        # EEPROM first: changing the operating mode resets part of the RAM.
        for register, value in sorted(self._found.items(), key=lambda item: not item[0].eeprom):
            self._try(lambda r=register, v=value: self._put(r, v), f"{register.name} was {value}", wrong)  # type: ignore[misc]
        if wrong:
            before = f"{error}; and " if isinstance(error, Exception) else ""
            raise NotRestored(
                f"{before}servo {self.id} could not be put back: {', '.join(wrong)}; "
                "remedy: see to its power and wiring, then set these"
            ) from error
        if self._interrupted:
            raise KeyboardInterrupt

    # -- registers -----------------------------------------------------------------------------------

    def read(self, register: Register) -> int:
        """Value of a register. Raises as `startup.read`."""
        return read(self.line, self.id, register)

    def write(self, register: Register, value: int) -> None:
        """Write a register for good. Raises as `startup.write`."""
        write(self.line, self.id, register, value)

    def remember(self, registers: Sequence[Register | None]) -> None:
        """Note what registers hold now: it is what they will hold in the end."""
        for register in registers:
            if register is not None and register not in self._found:
                self._found[register] = self.read(register)

    def set(self, register: Register, value: int) -> None:
        """Let a register hold a value for the time being.

        Raises
        ------
        CommandRefused
            It does not keep it.
        """
        self.remember((register,))
        self._put(register, value)

    # -- motion --------------------------------------------------------------------------------------

    def hold(self) -> int:
        """Torque on where it stands, watchdog armed; return that position in counts.

        Raises
        ------
        CommandRefused
            It does not take its own position for a goal, or takes no torque. It is limp then.
        """
        here = self.read(self.table.present_position)
        if not self._holding:
            require_no_error(self.line, self._pong)
            self._goals = self._goal_limits()
            self.write(self.table.goal_position, here)
            kept = self.read(self.table.goal_position)
            if kept != here:
                raise CommandRefused(
                    f"servo {self.id}: torque stays off: its goal is {kept} where it stands at {here}; "
                    "remedy: turn it to within its limits by hand"
                )
            self._holding = True  # from now on it is let go of at the end, however the write ends
            self.write(self.table.torque_enable, 1)
            if not self.read(self.table.torque_enable):
                require_no_error(self.line, self._pong)
                raise CommandRefused(f"servo {self.id} takes no torque; remedy: check its supply")
        if self.has_watchdog:
            self.write(self.table.bus_watchdog, round(WATCHDOG_S / WATCHDOG_UNIT_S))
        return here

    def aim(self, count: int) -> None:
        """Send it to a position, in counts. Raises as `startup.write`, or `NotReached` as `look`."""
        self._begun = True
        try:
            self.write(self.table.goal_position, count)
        except ServoRefused:
            self._require_no_trip()  # which refuses every goal
            raise

    def stop(self) -> None:
        """Make where it is its goal, or the nearest goal that it takes."""
        if not self._clear_trip():
            self.write(self.table.goal_position, self._stands())

    def look(self) -> Snapshot:
        """How it is doing, one cycle after the last look.

        Raises
        ------
        ActuatorFault
            It reports a hardware error, or has lost its torque.
        NotReached
            Its watchdog has stopped it.
        BusTimeout
            It does not answer believably.
        """
        self.clock.sleep_until(self.clock.now() + CYCLE_S)
        seen = snapshot(self.line, self._pong)
        if seen.error_bits:
            raise ActuatorFault(
                f"servo {self.id}",
                f"reports {error_words(seen.error_bits)}; remedy: remove the cause, then ori-deploy bus "
                f"reset-error {self.id}",
            )
        if self._holding and not seen.torque_on:
            raise ActuatorFault(f"servo {self.id}", "lost its torque; remedy: check its supply")
        self._require_no_trip()
        return seen

    def _require_no_trip(self) -> None:
        if self._holding and self.has_watchdog and self.read(self.table.bus_watchdog) < 0:
            raise NotReached(
                f"servo {self.id} stopped: it heard nothing from this program; limit: {WATCHDOG_S:g} s; "
                "remedy: see what kept this computer busy, or the line, then try again"
            )

    # -- inside --------------------------------------------------------------------------------------

    def _clear_trip(self) -> bool:
        """Wake a servo that its watchdog has stopped, to stay where it is; until then it takes no goals."""
        if not self.has_watchdog or self.read(self.table.bus_watchdog) >= 0:
            return False
        stands = self._stands()
        self.write(self.table.bus_watchdog, 0)
        if self._holding:  # a limp one gets its goal when it takes hold
            self.write(self.table.goal_position, stands)
        return True

    def _stands(self) -> int:
        """Where it is; a shaft may stand a little beyond the limits of goals."""
        here = self.read(self.table.present_position)
        return here if self._goals is None else min(max(here, self._goals[0]), self._goals[1])

    def _goal_limits(self) -> tuple[int, int] | None:
        """Least and most goal; None in a mode in which they bound nothing."""
        if self.read(self.table.operating_mode) != OperatingMode.POSITION:
            return None
        return self.read(self.table.min_position_limit), self.read(self.table.max_position_limit)

    def _put(self, register: Register, value: int) -> None:
        if self.read(register) == value:
            return
        if register in (self.table.operating_mode, self.table.drive_mode):
            self._take_back_word()
        self.write(register, value)
        kept = self.read(register)
        if kept != value:
            raise CommandRefused(f"servo {self.id}: {register.name} reads {kept} after {value} was written")

    def _take_back_word(self) -> None:
        """A change of mode or sense may forget the turns that somebody vouched for."""
        mark = mark_of(self.model)
        self._begun = True
        if self.read(mark) == MARK_ADDRESS:
            self._forgets()
        self.write(mark, mark.default)

    def _let_go(self) -> None:
        self.write(self.table.torque_enable, 0)
        self._holding = False

    def _try(self, what: Callable[[], None], otherwise: str, wrong: list[str]) -> None:
        """Go on with the rest when one step fails, and remember it; one that is interrupted is done again."""
        try:
            try:
                what()
            except KeyboardInterrupt:
                self._interrupted = True
                what()
        except (BusError, KeyboardInterrupt):
            wrong.append(otherwise)


def require_no_error(line: ServoLine, pong: Pong) -> None:
    """Make sure that a servo would take torque.

    Raises
    ------
    CommandRefused
        It reports a hardware error.
    """
    bits = read(line, pong.id, known_model(pong).table.hardware_error_status)
    if bits:
        raise CommandRefused(
            f"servo {pong.id} takes no torque, reports {error_words(bits)}; "
            f"remedy: remove the cause, then ori-deploy bus reset-error {pong.id}"
        )


def count_of(position_rad: float) -> int:
    """Shaft position in counts."""
    return CENTRE_COUNT + round(position_rad / RAD_PER_COUNT)
