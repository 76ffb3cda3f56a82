"""One session of a controller: a plan, a rig, a bus, a log and somebody watching."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from types import FrameType
from typing import Literal

from ori_deploy.actuators.bus import ActuatorBus
from ori_deploy.actuators.resolve import ResolvedRig, resolve_rig
from ori_deploy.actuators.rig import load_rig
from ori_deploy.cli.live import Live
from ori_deploy.clock import Clock, MonotonicClock, VirtualClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import MotionResult
from ori_deploy.errors import FileError, RigError
from ori_deploy.files import digest, load_plan
from ori_deploy.motion import Plan
from ori_deploy.telemetry.log import LogWriter
from sim_backends.mock import MockBus

Command = Literal["deploy", "stow"]

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


def make_bus(rig: ResolvedRig, plan: Plan, clock: Clock, start: Literal["stowed", "deployed"]) -> ActuatorBus:
    """The bus a rig asks for. Simulated servos are found at `start`."""
    ends = plan.crease_angles_rad[[0, -1]]
    return MockBus.from_rig(rig, clock, ends[0], ends[1], start=start)


class Interrupted(KeyboardInterrupt):
    """SIGTERM: treated as Ctrl-C, so that every way out brings the structure to rest."""


@contextmanager
def _terminate_gently() -> Iterator[None]:
    def interrupt(number: int, frame: FrameType | None) -> None:
        del number, frame
        raise Interrupted

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def carry_out(
    plan_path: Path,
    rig_path: Path,
    commands: tuple[Command, ...],
    log_path: Path | None,
    *,
    realtime: bool,
) -> tuple[Plan, tuple[MotionResult, ...]]:
    """Connect, arm, and carry commands out until one does not succeed.

    Parameters
    ----------
    plan_path, rig_path
        Files.
    commands
        In order. Simulated servos start where the first one makes sense.
    log_path
        Where the flight log goes; None for none.
    realtime
        Pace to the wall instead of the virtual clock.

    Raises
    ------
    InputError
        Plan or rig cannot be used.
    BusError
        The bus cannot be opened.
    """
    plan = load_plan(plan_path)
    rig = rig_for(rig_path, plan)
    clock: Clock = MonotonicClock() if realtime else VirtualClock(time.monotonic())
    bus = make_bus(rig, plan, clock, "stowed" if commands[0] == "deploy" else "deployed")
    results: list[MotionResult] = []
    with _terminate_gently(), Live(plan, rig) as live, _log(log_path, plan, rig, digest(plan_path)) as log:
        observers = (live,) if log is None else (live, log)
        with Controller(plan, rig, bus, clock, observers) as controller:
            controller.connect()
            controller.arm()
            for command in commands:
                live.begin(command)
                getattr(controller, command)()
                results.append(controller.run())
                if log is not None and not results[-1].observer_errors:
                    log.write_result(results[-1])
                live.end(results[-1])
                if not results[-1].succeeded:
                    break
                if command != commands[-1]:
                    _dwell(controller, rig)
    return plan, tuple(results)


def _dwell(controller: Controller, rig: ResolvedRig) -> None:
    """Hold for a while, watched: a person should see the deployed state, and so should the log."""
    for _ in range(int(_DWELL_S * rig.rate_hz)):
        controller.step()


def _keep_older(path: Path) -> None:
    """A log is evidence: one of the same name is kept under a numbered one."""
    if path.exists():
        number = next(n for n in count(1) if not path.with_stem(f"{path.stem}-{n}").exists())
        path.replace(path.with_stem(f"{path.stem}-{number}"))


@contextmanager
def _log(path: Path | None, plan: Plan, rig: ResolvedRig, plan_sha256: str) -> Iterator[LogWriter | None]:
    if path is None:
        yield None
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _keep_older(path)
        writer = LogWriter(path, plan, rig, plan_sha256=plan_sha256)
    except OSError as wrong:
        raise FileError(
            f"{path}: the log cannot be written", value=wrong.strerror, remedy="check the folder"
        ) from wrong
    with writer:
        yield writer
