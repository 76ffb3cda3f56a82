"""Bus, clock, journal and controller with a tape running: they do what they did, and it is taken down.

The controller is given bus, clock and journal as it always is, and cannot tell; whoever drives it is given the
controller. What it decides follows from what is on the tape and nothing else.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from time import perf_counter
from typing import Any, Protocol, TypeVar, cast

from ori_deploy.actuators.bus import ActuatorBus, FloatArray, HealthReadings, HingeReadings, LatchReading
from ori_deploy.clock import Clock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.journal import Journal
from ori_deploy.deploy.result import MotionResult
from ori_deploy.errors import OriDeployError
from ori_deploy.telemetry.boundary import ASKS, BoundaryBus, BoundaryJournal
from ori_deploy.telemetry.tape import Tape, plain

_T = TypeVar("_T")


PIECE_BYTES = 64 * 1024
"""So much of a tape at most waits for a cycle: somebody may look at a controller for hours that has no link."""


class TapedClock:
    """A clock whose readings are taken down."""

    def __init__(self, clock: Clock, tape: Tape) -> None:
        self._clock = clock
        self._tape = tape

    def now(self) -> float:
        value = self._clock.now()
        self._tape.now(value)
        return value

    def sleep_until(self, deadline: float) -> None:
        tape, begun = self._tape, perf_counter()
        try:
            self._clock.sleep_until(deadline)
        except BaseException as error:
            tape.raised("sleep_until", (deadline,), error)
            raise
        tape.slept(deadline)
        tape.woke = perf_counter()
        tape.wait_s = tape.woke - begun
        tape.read_s = tape.send_s = 0.0


class TapedBus(BoundaryBus):
    """A bus of which every call is taken down, with what came of it."""

    def __init__(self, bus: ActuatorBus, tape: Tape) -> None:
        super().__init__(bus.hinge_ids, bus.latch_ids)
        self._bus = bus
        self._tape = tape

    def read_hinges(self) -> HingeReadings:
        return self._read("read_hinges", self._bus.read_hinges, self._tape.read_hinges)

    def read_health(self) -> HealthReadings:
        return self._read("read_health", self._bus.read_health, self._tape.read_health)

    def read_latches(self) -> tuple[LatchReading, ...]:
        return self._read("read_latches", self._bus.read_latches, self._tape.read_latches)

    def command_hinges(self, position_rad: FloatArray, velocity_rad_s: FloatArray | None = None) -> None:
        begun = perf_counter()
        try:
            self._bus.command_hinges(position_rad, velocity_rad_s)
        except BaseException as error:
            self._tape.raised("command_hinges", (position_rad, velocity_rad_s), error)
            raise
        finally:
            self._tape.send_s += perf_counter() - begun
        self._tape.command_hinges(position_rad, velocity_rad_s)

    def due_s(self, now: float) -> float:
        value = self._bus.due_s(now)
        self._tape.due(now, value)
        return value

    def _read(self, name: str, read: Callable[[], _T], take_down: Callable[[_T], None]) -> _T:
        begun = perf_counter()
        try:
            readings = read()
        except BaseException as error:
            self._tape.raised(name, (), error)
            raise
        finally:
            self._tape.read_s += perf_counter() - begun
        take_down(readings)
        return readings

    def _call(self, name: str, *arguments: Any) -> Any:
        begun = perf_counter()
        try:
            return _taken_down(self._tape, self._bus, name, arguments)
        finally:
            if name in ASKS:
                self._tape.read_s += perf_counter() - begun
            else:
                self._tape.send_s += perf_counter() - begun


def _taken_down(tape: Tape, thing: object, name: str, arguments: tuple[Any, ...]) -> Any:
    """A call, or a property that is read, and what came of it."""
    try:
        found = getattr(thing, name)
        value = found(*arguments) if callable(found) else found
    except BaseException as error:
        tape.raised(name, arguments, error)
        raise
    tape.called(name, arguments, value)
    return value


def _taped_journal(journal: Journal | None, tape: Tape) -> Journal | None:
    tape.called("has_journal", (), journal is not None)
    if journal is None:
        return None
    return BoundaryJournal(lambda name, *arguments: _taken_down(tape, journal, name, arguments))


class Keeper(Protocol):
    """Who keeps the tape: the recorder."""

    @property
    def tape(self) -> Tape:
        """Where it is taken down."""

    def command(self, name: str, arguments: str, outcome: str, detail: str, state: str) -> None:
        """A command ended; its name is "" where that is nothing to tell of."""


UNTAPED = frozenset({"add_observer"})
"""What of a controller changes nothing that it decides."""


class _TapedController:
    """Passes everything on to a controller, and takes down what was asked of it."""

    def __init__(self, controller: Controller, recorder: Keeper) -> None:
        self._controller = controller
        self._recorder = recorder
        self._tape = recorder.tape

    def __enter__(self) -> _TapedController:
        return self

    def __exit__(self, *raised: object) -> None:
        self._command("close", (), {})

    def step(self) -> Any:
        self._tape.stepping()
        try:
            return self._controller.step()
        except BaseException as error:
            self._end("step", "", error)
            raise

    def __getattr__(self, name: str) -> Any:
        kind = getattr(type(self._controller), name)
        if name in UNTAPED:
            return getattr(self._controller, name)
        if callable(kind):
            return lambda *arguments, **named: self._command(name, arguments, named)
        at = len(self._tape.data)
        value = getattr(self._controller, name)
        if len(self._tape.data) > at:
            self._tape.looked(at, name)
        if len(self._tape.data) > PIECE_BYTES:  # without cycles nobody else hands it over
            self._recorder.command("", "", "", "", "")
        return value

    def _command(self, name: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
        given = {
            **{str(k): plain(item) for k, item in enumerate(arguments)},
            **{key: plain(item) for key, item in named.items()},
        }
        told = json.dumps(given)
        self._tape.begun(name, arguments, named)
        try:
            value = self._controller.__getattribute__(name)(*arguments, **named)
        except BaseException as error:
            self._end(name, told, error)
            raise
        self._end(name, told, None, value)
        return value

    def _end(self, name: str, arguments: str, error: BaseException | None, value: Any = None) -> None:
        state = str(self._controller.state)
        result = asdict(value) if isinstance(value, MotionResult) else None
        self._tape.ended(state, error, result)
        shown = "" if name in ("step", "result") else name
        outcome, detail = "done", ""
        if error is not None:
            outcome = "refused" if isinstance(error, OriDeployError) else "interrupted"
            detail = f"{type(error).__name__}: {error}"
        self._recorder.command(shown, arguments, outcome, detail, state)


Make = Callable[[ActuatorBus, Clock, Journal | None], Controller]


def taped(recorder: Keeper, make: Make, bus: ActuatorBus, clock: Clock, journal: Journal | None = None) -> Controller:
    """A controller that is recorded.

    Parameters
    ----------
    recorder
        Is an observer of the controller already.
    make
        Called with bus, clock and journal, returns the controller.
    """
    tape = recorder.tape
    controller = make(TapedBus(bus, tape), TapedClock(clock, tape), _taped_journal(journal, tape))
    return cast(Controller, _TapedController(controller, recorder))
