"""One session of a controller: a plan, a rig, a bus, a log and somebody watching."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Literal, Self

import numpy as np

from ori_deploy import realtime
from ori_deploy.actuators.bus import ActuatorBus, CommandRefused
from ori_deploy.actuators.hardware import hardware_bus
from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.cli.flight import controller_for, flight_recorder
from ori_deploy.cli.frame import nothing_moved, warn
from ori_deploy.cli.given import held, named, refuse_shared
from ori_deploy.cli.journal import journal
from ori_deploy.cli.live import Live
from ori_deploy.cli.operating import Operator, operated
from ori_deploy.cli.recover import recovering
from ori_deploy.cli.starting import answer_interrupt
from ori_deploy.clock import Clock, MonotonicClock, VirtualClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import MotionResult
from ori_deploy.deploy.span import require_unfolded
from ori_deploy.deploy.states import State
from ori_deploy.errors import InputError, RigError
from ori_deploy.files import load_plan
from ori_deploy.motion import Plan
from ori_deploy.operate.desk import Session
from sim_backends.mock import MockBus

Command = Literal["deploy", "stow", "recover"]
Place = Literal["stowed", "deployed"]

SAME_WISH_S = 2.0
"""Signals that follow the first one within that time ask for nothing more: it is being done."""

_DWELL_S = 1.0
"""Pause between two commands of one session."""


def rig_for(path: Path, plan: Plan) -> ResolvedRig:
    """A rig file fitted to a plan.

    Raises
    ------
    RigError
        It does not fit, or its rate is not the plan's.
    """
    rig = resolve_rig(load_rig(path), plan.cell_ids, plan.latch_points)
    if rig.rate_hz != plan.rate_hz:
        raise RigError(
            "rate_hz: not the rate the plan was made for",
            value=rig.rate_hz,
            limit=f"{plan.rate_hz:g} Hz",
            remedy="plan again with this rig",
            source=str(path),
        )
    return rig


def make_bus(
    rig: ResolvedRig,
    plan: Plan,
    clock: Clock,
    start: Place,
    port: str | None,
    stands: Place | None,
    mcu_port: str | None = None,
) -> ActuatorBus:
    """The bus a rig asks for. Simulated servos of the mock are found at `start`.

    Raises
    ------
    InputError
        An option is given for a backend that does not have it.
    """
    ends = plan.crease_angles_rad[[0, -1]]
    if mcu_port is not None and (rig.backend != "dynamixel" or rig.mcu is None):
        raise InputError(
            "--mcu-port: goes with hinges on servos and latches on a microcontroller",
            value=mcu_port,
            remedy="leave it out; --port is that of the hinges",
        )
    if rig.backend != "mock":
        return hardware_bus(rig, clock, ends[0], ends[1], port=port, mcu_port=mcu_port)
    for option, value in (("--port", port), ("--stands", stands)):
        if value is not None:
            raise InputError(
                f'{option}: does not go with backend = "{rig.backend}"',
                value=value,
                remedy='leave it out, or use a rig with backend = "dynamixel" or "mcu"',
            )
    return MockBus.from_rig(rig, clock, ends[0], ends[1], start=start)


def vouch_for(bus: ActuatorBus, rig: ResolvedRig, plan: Plan, stands: Place | None) -> None:
    """Pass on somebody's word for where the structure stands, where the bus needs one.

    Raises
    ------
    CommandRefused
        It is measured elsewhere, or nobody knows where some of it stands.
    """
    if stands is None:
        lost = bus.unvouched()
        if lost:
            raise CommandRefused(
                f"torque stays off: nobody knows where {', '.join(lost)} stand, which have no feedback or restarted; "
                "remedy: look at the structure, and say --stands stowed or --stands deployed"
            )
        return
    shaft = rig.to_actuator(plan.crease_angles_rad[0 if stands == "stowed" else -1])
    bus.vouch(shaft, rig.controller.start_tolerance_rad * np.abs(rig.shaft_per_crease))


class StoppedBy(StrEnum):
    """Who asked that a session comes to rest and ends."""

    SIGNAL = "a signal"
    OPERATOR = "an operator at another terminal"


class StopRequest:
    """What SIGINT, SIGTERM and SIGHUP ask for: the structure comes to rest along its path.

    The first signal only sets `requested`, which is looked at once per cycle: an exception out of nowhere
    could leave a bus transaction half done. One that comes soon after it is the same wish, by nervous fingers or
    a wrapper that signals its whole group; a later one raises KeyboardInterrupt. So does, at the begin, one that
    came while the command was being prepared and was lost there (`Heeding`): nothing moves after it.
    """

    SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def __init__(self) -> None:
        self.requested = False
        self._first_s = 0.0
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        # Whoever began this with `nohup` has said that a hangup is to mean nothing.
        heeded = [n for n in self.SIGNALS if n != signal.SIGHUP or signal.getsignal(n) is not signal.SIG_IGN]
        self._before = {number: signal.signal(number, self._note) for number in heeded}
        try:
            answer_interrupt()
        except KeyboardInterrupt:
            self._restore()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        now = time.monotonic()
        if not self.requested:
            self.requested, self._first_s = True, now
        elif now - self._first_s > SAME_WISH_S:
            raise KeyboardInterrupt


@dataclass(frozen=True, kw_only=True)
class Options:
    """How a session is carried out.

    Attributes
    ----------
    log
        Where the flight log goes; None for none.
    realtime
        Pace to the wall instead of the virtual clock; hardware always is.
    span_unfolded
        Whether somebody says that a span in segments is unfolded; without it, its cells are not opened.
    port, mcu_port
        Of the bus, and of a microcontroller that has latches alone, instead of those in the rig.
    stands
        Somebody's word for where the structure stands, for servos that forgot their turns or never knew.
    journal
        Where word is left before each stage; None for the default.
    trust_measured
        Whether somebody says that the structure stands as measured, whatever the journal says.
    speed
        Part of the plan's speed to go no faster than.
    design
        Design file, to look for a way back into step with.
    also_read
        Files that are read beside plan, rig and design: nothing is written in their place.
    """

    log: Path | None = None
    realtime: bool = False
    span_unfolded: bool = False
    port: str | None = None
    mcu_port: str | None = None
    stands: Place | None = None
    journal: Path | None = None
    trust_measured: bool = False
    speed: float = 1.0
    design: Path | None = None
    also_read: tuple[Path, ...] = ()


def carry_out(
    plan_path: Path, rig_path: Path, commands: tuple[Command, ...], options: Options
) -> tuple[Plan, tuple[MotionResult, ...], StoppedBy | None]:
    """Connect, arm, and carry commands out until one does not succeed or somebody stops it.

    In real time, other terminals can command it (`ori_deploy.operate`).

    Parameters
    ----------
    plan_path, rig_path
        Files.
    commands
        In order. Simulated servos start where the first one makes sense.

    Returns
    -------
    The plan, a result per command that was begun, and who asked to stop, if anybody did. No result, and nobody who
    asked: the structure stood locked where the only command would have brought it, and nothing was done.

    Raises
    ------
    InputError
        Plan or rig cannot be used.
    BusError
        The bus cannot be opened.
    """
    o = options
    plan_file, rig_file = held(plan_path), held(rig_path)
    plan = load_plan(plan_file)
    if "deploy" in commands:
        require_unfolded(plan, o.span_unfolded)  # before anything is armed
    rig = rig_for(rig_file, plan)
    refuse_shared(o.log, o.journal, rig, o.port, rig_path, plan_path, *named((o.design, *o.also_read)))
    real = o.realtime or rig.backend != "mock"
    clock: Clock = MonotonicClock() if real else VirtualClock(time.monotonic())
    bus = make_bus(
        rig, plan, clock, "stowed" if commands[0] == "deploy" else "deployed", o.port, o.stands, o.mcu_port
    )
    session = Session(plan_path.absolute(), rig_path.absolute(), o.log and o.log.absolute())
    results: list[MotionResult] = []
    with (
        StopRequest() as stop,
        Live(rig, real=real) as live,
        flight_recorder(o.log, plan_file, rig_file, plan, rig, clock) as recorder,
        journal(o.journal, rig_path, rig, o.port, clock) as left_word,
        recovering(o.design, plan) if "recover" in commands else nullcontext(_no_way) as recover,
        controller_for(plan, rig, bus, clock, (live,), recorder, left_word) as controller,
        punctual(real),
    ):
        with nothing_moved():
            controller.connect()
            tell_advice(bus)
            if o.trust_measured:
                controller.trust_measured()
            controller.limit_speed(o.speed)
            if not stop.requested:
                vouch_for(bus, rig, plan, o.stands)
                if len(commands) == 1 and _is_done(controller, commands[0]):
                    return plan, (), None
                controller.arm()
        with operated(controller, plan, rig, bus, clock, session) if real else nullcontext() as operator:
            for command in commands:
                if stop.requested:
                    break
                live.begin(command)
                with nothing_moved() if not results else nullcontext():
                    _give(controller, command, o, lambda: recover(controller, partial(_asked, stop, operator), live))
                results.append(run_command(controller, stop, operator))
                if recorder is not None:
                    recorder.write_result(results[-1])
                live.end(results[-1])
                if not results[-1].succeeded:
                    break
                if command != commands[-1]:
                    _dwell(controller, rig, operator)
    return plan, tuple(results), _stopped_by(stop, operator)


def _is_done(controller: Controller, command: Command) -> bool:
    """Whether the structure stands locked where a command would bring it; nothing has to move then."""
    return command != "recover" and controller.already(command)


def _give(controller: Controller, command: Command, options: Options, recover: Callable[[], None]) -> None:
    """Give a command; what is carried out of it, later cycles do."""
    if command == "deploy":
        controller.deploy(span_unfolded=options.span_unfolded)
    elif command == "stow":
        controller.stow()
    else:
        recover()


def _no_way(controller: Controller, stopping: Callable[[], bool], live: Live) -> None:
    """Nobody asked for a way back into step."""


@contextmanager
def punctual(real: bool) -> Iterator[None]:
    """Ask for real-time priority for as long as the loop runs, where time is real; say so where it is refused."""
    if not real:
        yield
        return
    granted = realtime.ask()
    if granted.refused:
        warn(str(granted))
    try:
        yield
    finally:
        realtime.give_back()


def _stopped_by(stop: StopRequest, operator: Operator | None) -> StoppedBy | None:
    if operator is not None and operator.stopped_by is not None:
        return StoppedBy.OPERATOR
    return StoppedBy.SIGNAL if stop.requested else None


def lost_observers(result: MotionResult) -> tuple[str, ...]:
    """Who did not see a motion to its end, a line for each: a recorder, a journal."""
    return tuple(f"the motion went on without an observer: {problem}" for problem in result.observer_errors)


def tell_advice(bus: ActuatorBus) -> None:
    """What works on the bus and could work better."""
    for text in bus.advice:
        warn(text)


def _asked(stop: StopRequest, operator: Operator | None) -> bool:
    """Serve other terminals while no command is under way yet; whether a signal has come."""
    if operator is not None:
        operator.poll()
    return stop.requested


def run_command(controller: Controller, stop: StopRequest, operator: Operator | None = None) -> MotionResult:
    """Step until the command has ended; a signal stops it along the path, and so may an operator.

    A command that is held has not ended while an operator can still resume it: hinges go on being told to hold.
    """
    while controller.under_way or (operator is not None and operator.keeps_waiting):
        # In every other state the controller is coming to rest by itself, and a stop would be out of place.
        if stop.requested and controller.state in (State.MOVING, State.LATCHING, State.HOLD):
            controller.stop()
        if operator is not None:
            operator.poll()
        controller.step()
    return controller.result()


def _dwell(controller: Controller, rig: ResolvedRig, operator: Operator | None) -> None:
    """Hold for a while, watched: a person should see the deployed state, and so should the log."""
    for _ in range(int(_DWELL_S * rig.rate_hz)):
        if operator is not None:
            operator.poll()
        controller.step()
