"""Turn one servo behind a microcontroller slowly, with every other hinge left as it is.

The goals go the way of a motion: on a grid of device time, queued ahead, and watched by the device for limits,
stalls and silence.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import BusTimeout, CommandRefused, CorruptReply
from ori_deploy.actuators.mcu.faults import fault_error, fault_name, refusal, state_name
from ori_deploy.actuators.mcu.grid import Grid
from ori_deploy.actuators.mcu.line import McuLine
from ori_deploy.actuators.mcu.stream import Stream
from ori_deploy.actuators.mcu.wiring import Hinge, McuWiring
from ori_deploy.bench.board import Board, clear_fault
from ori_deploy.clock import Clock
from ori_deploy.errors import begun
from ori_deploy.wire.mcu import HINGES, Brake, Disable, Enable, State, dialect

FloatArray = NDArray[np.float64]

PEAK = 1.875
"""Largest velocity of the way from 0 to 1 in unit time, and its largest acceleration."""
STEEPEST = 5.7735

SHORTEST_S = 0.2
SYNC_EXCHANGES = 20

MOVED_RAD = 0.05
"""A shaft that stands farther than that from where its way was told to begin is told of anew; about 3 degrees."""

SILENT_CYCLES = 5
REST_PATIENCE_S = 1.0

_MOVES = (dialect.ORI_STREAMING, dialect.ORI_BRAKING)


@dataclass(frozen=True, slots=True)
class Jog:
    """A way for one shaft.

    Attributes
    ----------
    index, hinge
        Which.
    start_rad, goal_rad
        Of its shaft.
    duration_s
        From rest to rest.
    others_on
        Names of the hinges that hold meanwhile.
    """

    index: int
    hinge: Hinge
    start_rad: float
    goal_rad: float
    duration_s: float
    others_on: tuple[str, ...]

    def at(self, time_s: float) -> tuple[float, float]:
        """Position and velocity: a smooth way that begins and ends without acceleration."""
        u = min(max(time_s / self.duration_s, 0.0), 1.0)
        way = self.goal_rad - self.start_rad
        place = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        return self.start_rad + way * place, way * 30.0 * u**2 * (1.0 - u) ** 2 / self.duration_s


@dataclass(frozen=True, slots=True)
class Jogged:
    """How it ended: where the shaft is measured, what it was told, whether it arrived, and whether it holds."""

    jog: Jog
    measured_rad: float | None
    told_rad: float
    arrived: bool
    holds: bool


def plan_jog(
    found: Board, wiring: McuWiring, name: str, rate_rad_s: float, *, by_rad: float | None, to_rad: float | None
) -> Jog:
    """Decide on a way; nothing is sent but questions. One of `by_rad` and `to_rad` is given.

    Raises
    ------
    CommandRefused
        No such hinge; a fault is latched, or something moves; it does not say where it is; the way leaves its
        range, or is faster than it may go.
    """
    names = [hinge.name for hinge in wiring.hinges]
    if name not in names:
        raise CommandRefused(
            f"there is no hinge {name!r} on this board; limit: one of {', '.join(names) or '(none)'}"
        )
    index = names.index(name)
    hinge = wiring.hinges[index]
    if not 0.0 < rate_rad_s <= hinge.max_velocity_rad_s:
        raise CommandRefused(
            f"rate of {name} would be {rate_rad_s:g} rad/s; limit: more than 0, to max_velocity_rad_s = "
            f"{hinge.max_velocity_rad_s:g} rad/s; remedy: --rate 0.2"
        )
    state = require_ready(found)
    start = _stands(state, index, hinge)
    goal = start + by_rad if by_rad is not None else float(to_rad or 0.0)
    for what, place in (("stands at", start), ("would go to", goal)):
        if not hinge.min_rad <= place <= hinge.max_rad:
            raise CommandRefused(
                f"{name} {what} {place:.4f} rad; limit: {hinge.min_rad:g} to {hinge.max_rad:g} rad; "
                "remedy: stay within its range, or turn it there by hand with the supply off"
            )
    way = abs(goal - start)
    duration = max(SHORTEST_S, PEAK * way / rate_rad_s, (STEEPEST * way / hinge.max_acceleration_rad_s2) ** 0.5)
    others = tuple(names[k] for k in range(len(names)) if k != index and state.outputs_on >> k & 1)
    return Jog(index, hinge, start, goal, duration, others)


def plan_again(found: Board, wiring: McuWiring, jog: Jog, rate_rad_s: float) -> Jog:
    """The way to the same goal from where the shaft is by now: it may have sunk a little since somebody was asked.

    Raises
    ------
    CommandRefused
        As `plan_jog`; or it was turned since, and the way would be another than the one that was told.
    """
    name = jog.hinge.name
    again = plan_jog(found, wiring, name, rate_rad_s, by_rad=None, to_rad=jog.goal_rad)
    if abs(again.start_rad - jog.start_rad) > MOVED_RAD:
        raise CommandRefused(
            f"{name} was turned since its way was told, from {jog.start_rad:.4f} to {again.start_rad:.4f} rad; "
            f"limit: {MOVED_RAD:g} rad; remedy: hold the structure still, and say again where to"
        )
    return again


def require_ready(found: Board) -> State:
    """The state of a board at rest without a fault.

    Raises
    ------
    CommandRefused
        It has latched a fault, or something moves.
    """
    state = found.state()
    wrong = fault_error(state, found.naming)
    if wrong is not None:
        raise CommandRefused(f"nothing moves: {wrong}")
    if state.state in _MOVES:
        raise CommandRefused(
            f"the microcontroller is {state_name(state.state)}; remedy: wait until nothing moves, end what moves it"
        )
    return state


def _stands(state: State, index: int, hinge: Hinge) -> float:
    if state.outputs_on >> index & 1:
        return 1e-6 * state.output_urad[index]
    if state.sensed >> index & 1:
        return 1e-6 * state.position_urad[index]
    if hinge.feedback is None:
        raise CommandRefused(
            f"{hinge.name} has no feedback wire, and would jump; remedy: turn it with a servo tester"
        )
    raise CommandRefused(
        f"{hinge.name} does not say where it is; remedy: check the servos' supply, and its feedback wire at "
        f"A{hinge.feedback}"
    )


def carry_out(
    found: Board,
    wiring: McuWiring,
    jog: Jog,
    rate_hz: float,
    clock: Clock,
    stop: Callable[[], bool],
    *,
    release: bool = False,
) -> Jogged:
    """Go the way; the hinge goes on where it stands if it is off, and no other hinge does.

    Parameters
    ----------
    rate_hz
        Of the goals.
    stop
        Looked at in every cycle: whether to brake at once.
    release
        Turn the hinge off at the end; it holds otherwise.

    Raises
    ------
    CommandRefused
        The device does not turn it on: nothing has moved. Or, not `refused`, it does not turn it off at the end.
    ActuatorFault
        The device stopped it.
    BusTimeout
        The device falls silent; it brakes by itself.
    """
    found.line.synchronise(SYNC_EXCHANGES)
    line = _Stretch(found, wiring, jog, rate_hz, clock)
    with begun():
        arrived = line.go(stop)
        state = line.rest()
        if not arrived and state.fault == dialect.ORI_FAULT_HOST_BRAKE:
            clear_fault(found)  # our own, and no news
        if release:
            what = f"{jog.hinge.name} stays on"
            ack = found.line.command(lambda token: Disable(token, 1 << jog.index), what)
            if ack.result != dialect.ORI_ACCEPTED:
                raise refusal(ack, what, jog.hinge.name, found.naming)
        state = found.state()
    measured = 1e-6 * state.position_urad[jog.index] if state.sensed >> jog.index & 1 else None
    return Jogged(jog, measured, line.told_rad, arrived, holds=bool(state.outputs_on >> jog.index & 1))


class _Stretch:
    """One stream of goals, for one hinge; the others' goals are where they are."""

    def __init__(self, found: Board, wiring: McuWiring, jog: Jog, rate_hz: float, clock: Clock) -> None:
        settings = wiring.settings
        self._found, self._jog, self._clock = found, jog, clock
        self._line: McuLine = found.line
        self._period_s = 1.0 / rate_hz
        self._grid = Grid(wiring.hinges, self._period_s, settings.lead_s, settings.min_lead_s)
        state = found.state()
        self._place = _still(state, wiring)
        self._place[jog.index] = jog.start_rad
        self._grid.stand(self._place)
        self._stream = Stream((state.stream + 1) % 256)
        self._silent = 0
        self._enable()

    @property
    def told_rad(self) -> float:
        """Where the hinge was told to be in the end."""
        return float(self._place[self._jog.index])

    def _enable(self) -> None:
        urad = [int(p) for p in np.rint(1e6 * self._place)]
        urad += [0] * (HINGES - len(urad))
        what, mask = f"{self._jog.hinge.name} stays off", 1 << self._jog.index
        ack = self._line.command(lambda token: Enable(urad, token, mask, self._stream.name), what)
        if ack.result != dialect.ORI_ACCEPTED:
            raise refusal(ack, what, self._found.naming.hinge(ack.index), self._found.naming)

    def go(self, stop: Callable[[], bool]) -> bool:
        """Queue goals until the last one, or until `stop`; whether it was the last one."""
        began = self._clock.now()
        cycle = 0
        while cycle * self._period_s < self._jog.duration_s:
            self._look()
            if stop():
                self._line.command(Brake, "braking")
                return False
            cycle += 1
            self._queue(*self._jog.at(cycle * self._period_s))
            self._clock.sleep_until(began + cycle * self._period_s)
        return True

    def _queue(self, position_rad: float, velocity_rad_s: float) -> None:
        self._place = self._place.copy()
        self._place[self._jog.index] = position_rad
        velocity = np.zeros(len(self._place))
        velocity[self._jog.index] = velocity_rad_s
        base = self._line.timebase
        for message in self._stream.append(
            self._grid.next(base.device_s(self._clock.now()), base.rate, self._place, velocity)
        ):
            self._line.send(message)

    def _look(self) -> State | None:
        """Ask how it goes, which is the sign of life; what was lost goes out again."""
        try:
            state = self._line.poll(dialect.ORI_POLL_STATE).state
        except (BusTimeout, CorruptReply):
            self._silent += 1
            if self._silent > SILENT_CYCLES:
                raise
            return None
        assert state is not None
        self._silent = 0
        if state.fault not in (dialect.ORI_FAULT_NONE, dialect.ORI_FAULT_HOST_BRAKE):
            wrong = fault_error(state, self._found.naming)
            assert wrong is not None
            raise wrong
        if state.stream == self._stream.name:
            self._stream.acknowledge(state.contiguous)
            for message in self._stream.again():
                self._line.send(message)
        return state

    def rest(self) -> State:
        """Wait until nothing is queued any more, or the device has braked."""
        base = self._line.timebase
        now = self._clock.now()
        last_s = base.host_s(self._grid.last.time_s, now) if np.isfinite(self._grid.last.time_s) else now
        while True:
            state = self._look()
            now = self._clock.now()
            if state is not None:
                if state.fault == dialect.ORI_FAULT_HOST_BRAKE and state.state not in _MOVES:
                    self._place[self._jog.index] = 1e-6 * state.output_urad[self._jog.index]
                    return state
                if state.state not in _MOVES and now >= last_s:
                    return state
            if now > last_s + REST_PATIENCE_S:
                raise BusTimeout(
                    f"{self._jog.hinge.name} does not come to rest"
                    + ("" if state is None else f": {state_name(state.state)}, fault {fault_name(state.fault)}")
                )
            self._clock.sleep_until(now + self._period_s)


def _still(state: State, wiring: McuWiring) -> FloatArray:
    """Where the others stay: what is on where it is told to be, what is off somewhere in its range."""
    n = len(wiring.hinges)
    lower = np.array([hinge.min_rad for hinge in wiring.hinges])
    upper = np.array([hinge.max_rad for hinge in wiring.hinges])
    on = np.array([bool(state.outputs_on >> k & 1) for k in range(n)])
    told = 1e-6 * np.array(state.output_urad[:n], dtype=np.float64)
    return np.where(on, told, 0.5 * (lower + upper))
