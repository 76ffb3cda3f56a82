"""What a run leaves behind: faults, cycle records, results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum, auto
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.bus import HealthReadings, HingeReadings, LatchReading
from ori_deploy.deploy.states import State, Transition
from ori_deploy.errors import InputError
from ori_deploy.motion.plan import StageName

FloatArray = NDArray[np.float64]


class StartRefused(InputError):
    """The controller does not know where the structure is, or it is off its path; nothing moved."""

    refused = True


class FaultKind(StrEnum):
    """Why a motion was stopped."""

    PATH_TOLERANCE = auto()
    GOAL_TOLERANCE = auto()
    OUT_OF_STEP = auto()
    LOST_REPLIES = auto()
    OVER_TEMPERATURE = auto()
    LOW_VOLTAGE = auto()
    HARDWARE_ERROR = auto()
    TORQUE_LOST = auto()
    RESTARTED = auto()
    WATCHDOG = auto()
    LATCH_TIMEOUT = auto()
    LATCH_TRIPPED = auto()
    LATCH_LOST = auto()
    LATCH_SENSOR = auto()
    SEATING_EARLY = auto()
    SEATING_LATE = auto()
    SEATING_UNEVEN = auto()
    COMMAND_REFUSED = auto()
    BUS_CLOSED = auto()
    BUS_ERROR = auto()
    OVERRUN = auto()
    EMERGENCY_STOP = auto()
    INTERRUPTED = auto()


@dataclass(frozen=True, slots=True)
class Fault:
    """A latched reason to stand still.

    Attributes
    ----------
    kind
        For programs.
    thing
        What it is about: an actuator, a cell or a latch, by name.
    detail
        Value and limit, for people.
    remedy
        What to do before `clear_fault`; once latched it ends with the command that leads on.
    time_s
        When it was found.
    """

    kind: FaultKind
    thing: str
    detail: str
    remedy: str
    time_s: float

    def __str__(self) -> str:
        return f"{self.kind}: {self.thing}: {self.detail}; remedy: {self.remedy}"


@dataclass(frozen=True, slots=True, eq=False)
class CycleRecord:
    """Everything about one cycle of the control loop.

    Attributes
    ----------
    index
        Number of the cycle since the controller was made.
    time_s, deadline_s
        When it began and when it should have.
    state, stage
        At the end of the cycle; `stage` is None when nothing is being carried out.
    path_time_s, rate, rate_limit
        Path variable, its rate, and the largest rate that the cells' being out of step leaves it.
    commanded_fold
        Fold at the path variable, in [0, 1]; NaN while the place on the path is unknown.
    commanded_rad
        (n_hinges,) shaft goals last sent; NaN before the first.
    readings
        Of this cycle; not valid where replies were lost.
    folds
        (n_cells,) measured fold of every cell; NaN where not valid.
    health, latches
        Read in this cycle, or None.
    lost_replies, overruns
        Totals since the controller was made.
    transitions
        Changes of state since the previous record.
    fault
        The latched fault, or None.
    """

    index: int
    time_s: float
    deadline_s: float
    state: State
    stage: StageName | None
    path_time_s: float
    rate: float
    rate_limit: float
    commanded_fold: float
    commanded_rad: FloatArray
    readings: HingeReadings
    folds: FloatArray
    health: HealthReadings | None
    latches: tuple[LatchReading, ...] | None
    lost_replies: int
    overruns: int
    transitions: tuple[Transition, ...]
    fault: Fault | None


class Outcome(StrEnum):
    """How a command ended.

    SUCCEEDED: deployed with every latch confirmed, or stowed and measured so, or the cells back in step. HELD: at
    rest on the operator's word or to let a servo cool, can be resumed. STOPPED: at rest, given up on the operator's
    word. EMERGENCY_STOPPED: at rest, the button was pressed. PATH_TOLERANCE: a crease strayed from the path, or
    cells from each other. GOAL_TOLERANCE: a crease did not reach the end of the path. SEATING: the slits closed
    too early, too late or unevenly. ABORTED: at rest because of any other fault.
    """

    SUCCEEDED = auto()
    HELD = auto()
    STOPPED = auto()
    EMERGENCY_STOPPED = auto()
    PATH_TOLERANCE = auto()
    GOAL_TOLERANCE = auto()
    SEATING = auto()
    ABORTED = auto()

    @classmethod
    def _missing_(cls, value: object) -> Outcome | None:
        """Logs written before outcomes told faults apart say "fault"."""
        return cls.ABORTED if value == "fault" else None


@dataclass(frozen=True, slots=True)
class MotionResult:
    """How a command ended.

    Attributes
    ----------
    command
        "deploy", "stow" or "recover".
    outcome
        How it ended; with a fault, which sort.
    state
        State of the controller at the end.
    fault
        The latched fault, or None.
    duration_s, cycles, overruns, lost_replies
        Since the command was given.
    worst_tracking_rad, worst_tracking_hinge
        Largest distance between commanded and measured, at the driven crease, and the actuator's id.
    observer_errors
        What went wrong in observers, such as a full disk; the motion went on without them.
    """

    command: str
    outcome: Outcome
    state: State
    fault: Fault | None
    duration_s: float
    cycles: int
    overruns: int
    lost_replies: int
    worst_tracking_rad: float
    worst_tracking_hinge: str
    observer_errors: tuple[str, ...]

    @property
    def succeeded(self) -> bool:
        """Whether the structure is where the command wanted it, secured and measured."""
        return self.outcome is Outcome.SUCCEEDED


ENDED: Mapping[State, Outcome] = MappingProxyType(
    {
        State.DEPLOYED: Outcome.SUCCEEDED,
        State.STOWED: Outcome.SUCCEEDED,
        State.HOLD: Outcome.HELD,
        State.ARMED: Outcome.STOPPED,
        State.FAULT: Outcome.ABORTED,
    }
)
"""States in which a command has ended, and what that means unless a fault says more."""

_BY_FAULT: Mapping[FaultKind, Outcome] = MappingProxyType(
    {
        FaultKind.PATH_TOLERANCE: Outcome.PATH_TOLERANCE,
        FaultKind.OUT_OF_STEP: Outcome.PATH_TOLERANCE,
        FaultKind.GOAL_TOLERANCE: Outcome.GOAL_TOLERANCE,
        FaultKind.SEATING_EARLY: Outcome.SEATING,
        FaultKind.SEATING_LATE: Outcome.SEATING,
        FaultKind.SEATING_UNEVEN: Outcome.SEATING,
        FaultKind.EMERGENCY_STOP: Outcome.EMERGENCY_STOPPED,
    }
)


def outcome(state: State, fault: Fault | None, *, done: bool) -> Outcome:
    """How a command ended that ended in this state, one of `ENDED`, with this fault, all its stages done or not."""
    if state is State.FAULT and fault is not None:
        return _BY_FAULT.get(fault.kind, Outcome.ABORTED)
    if state is State.ARMED and done:
        return Outcome.SUCCEEDED  # cells are in step again
    return ENDED[state]
