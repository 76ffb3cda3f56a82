"""What is said over an operator's socket: one JSON document per line, both ways."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum, auto
from json import dumps

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from ori_deploy.deploy.states import State

MAX_REQUEST_BYTES = 512
"""Of a request with its newline; the longest that a client of ours sends has a tenth of it."""


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


class Code(StrEnum):
    """Why something was not done, for programs.

    NOT_NOW: not in this state. REFUSED: the controller does not know its place, or is not fit to move. FAULT: a
    fault is latched. ONE_COMMAND: the session was started for one command. The rest are an interlock's.
    """

    NOT_NOW = auto()
    REFUSED = auto()
    FAULT = auto()
    ONE_COMMAND = auto()
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
    """

    do: Do
    wait: bool = False
    force: bool = False


@dataclass(frozen=True, slots=True)
class LatchStatus:
    """A latch as it was read last; `confirmed` is None where its sensor cannot tell."""

    id: str
    engaged: bool
    confirmed: bool | None


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
        empty before the first reading, and from older versions.
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
    """

    took: bool
    state: State | None = None
    at_rest: bool = False
    why: str | None = None
    allowed: tuple[Do, ...] = ()
    fault: str | None = None
    status: Status | None = None
    code: Code | None = None


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
    """A request as it is sent."""
    return dumps(asdict(request)).encode() + b"\n"


def parse_answer(line: bytes) -> Answer:
    """The answer in a line. Raises `ValueError` when it is none of this version's."""
    return _ANSWERS.validate_json(line)


def answer_line(answer: Answer) -> bytes:
    """An answer as it is sent."""
    return _ANSWERS.dump_json(answer) + b"\n"
