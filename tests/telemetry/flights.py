"""Controllers on a tape: in this process, or with the recorder in its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.clock import Clock, VirtualClock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.journal import Journal
from ori_deploy.deploy.result import CycleRecord
from ori_deploy.motion.plan import Plan
from ori_deploy.telemetry.frames import plan_info
from ori_deploy.telemetry.recorder import Recorder
from ori_deploy.telemetry.tape import Tape
from ori_deploy.telemetry.taped import taped
from sim_backends.mock import MockBus
from tests.deploy.synthetic import synthetic_rig

VERSIONS: dict[str, Any] = {
    "ori_deploy": "0",
    "python": "3",
    "numpy": "2",
    "platform": "",
    "machine": "",
    "processors": 1,
    "affinity": [0],
    "scheduling": "",
    "clock": "virtual",
    "begun_utc": "",
}


@dataclass
class Pieces:
    """Keeps a tape in memory."""

    tape: Tape = field(default_factory=Tape)
    pieces: list[bytes] = field(default_factory=list)

    def __call__(self, record: CycleRecord) -> None:
        self.tape.decided(record)
        self.pieces.append(self.tape.take())

    def command(self, *words: str) -> None:
        del words
        self.pieces.append(self.tape.take())


@dataclass
class Flight:
    """A recorded controller with everything round it."""

    plan: Plan
    rig: ResolvedRig
    bus: MockBus
    controller: Controller
    records: list[CycleRecord]


def flight(
    keeper: Any, plan: Plan, rig: ResolvedRig, clock: Clock, start: str = "stowed", journal: Journal | None = None
) -> Flight:
    """A controller whose tape a keeper keeps, on a mock."""
    angles = plan.crease_angles_rad
    bus = MockBus.from_rig(rig, clock, angles[0], angles[-1], start="deployed" if start == "deployed" else "stowed")
    records: list[CycleRecord] = []
    controller = taped(
        keeper,
        lambda bus, clock, journal: Controller(plan, rig, bus, clock, [records.append, keeper], journal),
        bus,
        clock,
        journal,
    )
    return Flight(plan, rig, bus, controller, records)


def flown(
    plan: Plan,
    script: Callable[[Flight], object],
    start: str = "stowed",
    journal: Journal | None = None,
    **tables: Any,
) -> tuple[Flight, list[bytes]]:
    """What a script did to a recorded controller, and the tape of it."""
    keeper = Pieces()
    f = flight(keeper, plan, synthetic_rig(plan, **tables), VirtualClock(100.0), start, journal)
    script(f)
    return f, keeper.pieces


@contextmanager
def recorded(
    path: Path, plan: Plan, rig: ResolvedRig, clock: Clock, **words: Any
) -> Iterator[tuple[Flight, Recorder]]:
    """A controller with the recorder in its own process, as a session has it."""
    words = {"waits": isinstance(clock, VirtualClock), **words}
    recorder = Recorder(
        path, plan_info(plan, rig), clock, versions=lambda: VERSIONS, files={"note": b"a plan\n"}, **words
    )
    try:
        yield flight(recorder, plan, rig, clock), recorder
    finally:
        with suppress(OSError):  # whoever wants to know closes it before
            recorder.close()
        assert recorder._process.returncode is not None, "the recorder's process is still there"
