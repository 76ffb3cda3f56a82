"""What is said over an operator's socket: one JSON document per line, both ways."""

from __future__ import annotations

from dataclasses import MISSING, fields
from enum import StrEnum, auto
from json import dumps

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from ori_deploy.deploy.states import State

MAX_REQUEST_BYTES = 512
"""Of a request with its newline; the longest that a client of ours sends has a quarter of it."""

LONGEST_WAIT_S = 1.0
"""An order that may lead to a motion and waited longer than that is not carried out any more: who gave it has been
told, or has concluded, that nothing came of it. Stops wait for as long as they have to."""
_CLOCKS_S = 0.1
"""No order was asked for that far in the future by a clock that is ours."""


class BadRequest(ValueError):
    """A line that is no request; the message says why."""


class Do(StrEnum):
    """What can be asked of a running controller."""

    STATUS = auto()
    PAUSE = auto()
    RESUME = auto()
    STOP = auto()
    ESTOP = auto()
    DEPLOY = auto()
    STOW = auto()
    CLEAR_FAULT = auto()
    ARM = auto()
    SPAN_UNFOLDED = auto()


MAY_MOVE = frozenset({Do.ARM, Do.DEPLOY, Do.STOW, Do.RESUME, Do.CLEAR_FAULT, Do.SPAN_UNFOLDED})
"""What begins a motion, or lets one begin."""


class Code(StrEnum):
    """Why something was not done, for programs.

    NOT_NOW: not in this state. REFUSED: the controller does not know its place, or is not fit to move. FAULT: a
    fault is latched. ONE_COMMAND: the session was started for one command. SPAN_WORD: somebody's word is wanted that
    the span is unfolded. TOO_LATE: it waited too long, or nobody waits for the answer any more. The rest are an
    interlock's.
    """

    NOT_NOW = auto()
    REFUSED = auto()
    FAULT = auto()
    ONE_COMMAND = auto()
    SPAN_WORD = auto()
    TOO_LATE = auto()
    AIRBORNE = auto()
    LANDED_UNKNOWN = auto()
    ARMED = auto()
    ARMING_UNKNOWN = auto()
    FORCE_NOT_ALLOWED = auto()


_STRICT = ConfigDict(extra="forbid")


@dataclass(frozen=True, slots=True, config=_STRICT)
class Request:
    """One thing that is asked.

    Attributes
    ----------
    do
        What.
    wait
        Whether a second answer is wanted, once the structure is at rest.
    force
        Whether an interlock is to be overridden, where that is allowed at all.
    asked_s
        When, on CLOCK_MONOTONIC, which is one for all programs of a machine; None where that is not told. An order
        in `MAY_MOVE` is not carried out when it is older than `LONGEST_WAIT_S`.
    span_unfolded
        With a deployment: somebody's word, for this one alone, that a span in segments is unfolded.
    keep
        Whether the connection is wanted for a stop: it is the last to be dropped, and is told how the session ended.
    """

    do: Do
    wait: bool = False
    force: bool = False
    asked_s: float | None = None
    span_unfolded: bool = False
    keep: bool = False


STOW_POINT = "stow"
"""As a rig calls what a lock of the stowed state secures."""


@dataclass(frozen=True, slots=True)
class LatchStatus:
    """A latch as it was read last.

    Attributes
    ----------
    id
        As in the rig.
    engaged
        Whether it is told to be closed.
    confirmed
        Whether its sensor says so; None where it cannot tell.
    secures
        The latch point of the design that it is on, or "stow"; None from older versions.
    """

    id: str
    engaged: bool
    confirmed: bool | None
    secures: str | None = None


@dataclass(frozen=True, slots=True)
class Status:
    """A running controller and what it is doing.

    Attributes
    ----------
    pid, plan, rig, log, ports
        The program, its files (None: no log), and the serial devices that it holds; none with the mock.
    uptime_s
        Since the controller was connected.
    state, stage, command
        As in a cycle record; `command` is what the stage belongs to. None where there is none.
    at_rest
        Whether nothing moves and nothing is being worked on.
    fold, rate
        Commanded fold, 0 to 1, and the path rate as a part of full speed; None while the place is not known.
    progress_percent
        Part of the path's time that lies behind, in the direction of the command.
    remaining_s
        Of the path, at full speed; latches, pauses and slower going come on top.
    fault
        The latched fault with its remedy, or None.
    worst_tracking_rad, worst_tracking_hinge
        Largest distance so far between a driven crease and the goal that was due, and whose it was.
    lost_replies, overruns, cycles
        Totals of the session.
    latches
        As read last.
    takes_orders
        Whether it can be asked to arm, deploy and stow, instead of being started for one command.
    folds, current_a, temperature_c
        Measured fold of every cell; current and temperature of every actuator as read last. None where not known;
        empty before the first reading, without a link, and from older versions.
    concern
        What pauses the motion and becomes a fault if it lasts, as a hot servo does; None where there is nothing.
    """

    pid: int
    plan: str
    rig: str
    log: str | None
    ports: tuple[str, ...]
    uptime_s: float
    state: State
    stage: str | None
    command: str | None
    at_rest: bool
    fold: float | None
    rate: float | None
    progress_percent: float | None
    remaining_s: float | None
    fault: str | None
    worst_tracking_rad: float
    worst_tracking_hinge: str | None
    lost_replies: int
    overruns: int
    cycles: int
    latches: tuple[LatchStatus, ...]
    takes_orders: bool = False
    folds: tuple[float | None, ...] = ()
    current_a: tuple[float | None, ...] = ()
    temperature_c: tuple[float | None, ...] = ()
    concern: str | None = None

    @property
    def secured(self) -> tuple[int, int]:
        """How many of the latches that secure the deployed state are confirmed, and how many there are."""
        those = [one.confirmed is True for one in self.latches if one.secures != STOW_POINT]
        return sum(those), len(those)


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a request.

    Attributes
    ----------
    took
        Whether it was taken; a command that was taken has been given, not carried out to its end.
    state, at_rest
        Of the controller, after it. None only where the line was no request.
    why
        Why it was not taken, or why there was nothing to do; else None.
    allowed
        What would be allowed in this state; empty where it was taken.
    fault
        The latched fault with its remedy, or None.
    status
        Where that was asked.
    code
        Why it was not taken, for programs; None where it was, or where the line was no request.
    last
        Whether this answers nothing, but tells a connection that was kept how the session ended.
    """

    took: bool
    state: State | None = None
    at_rest: bool = False
    why: str | None = None
    allowed: tuple[Do, ...] = ()
    fault: str | None = None
    status: Status | None = None
    code: Code | None = None
    last: bool = False


_REQUESTS = TypeAdapter(Request)
_ANSWERS = TypeAdapter(Answer)


def parse_request(line: bytes) -> Request:
    """The request in a line, with or without its newline. Raises `BadRequest`, and nothing else."""
    try:
        return _REQUESTS.validate_json(line.strip(), strict=True)
    except ValidationError as wrong:
        first = wrong.errors(include_url=False, include_context=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "line"
        raise BadRequest(f"{where}: {first['msg']}"[:200]) from None


def request_line(request: Request) -> bytes:
    """A request as it is sent: what is as usual is left out, so that older versions take it, too."""
    told = {"do": request.do}
    for one in fields(request):
        value = getattr(request, one.name)
        if one.default is not MISSING and value != one.default:
            told[one.name] = value
    return dumps(told).encode() + b"\n"


def too_late(request: Request, now: float) -> bool:
    """Whether it is an order that may lead to a motion, and is too old for that, or of another clock."""
    if request.do not in MAY_MOVE or request.asked_s is None:
        return False
    return not -_CLOCKS_S <= now - request.asked_s <= LONGEST_WAIT_S


def parse_answer(line: bytes) -> Answer:
    """The answer in a line. Raises `ValueError` when it is none of this version's."""
    return _ANSWERS.validate_json(line)


def answer_line(answer: Answer) -> bytes:
    """An answer as it is sent."""
    return _ANSWERS.dump_json(answer) + b"\n"
