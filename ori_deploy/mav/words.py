"""What the control loop and the process that speaks MAVLink say to each other.

Both are of this program, on this machine and on one monotonic clock. A word travels as a tuple: its name, then
its fields.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from ori_deploy.telemetry.channel import Item

ALIVE_EVERY_S = 0.5

# -- from the process to the loop --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Ask:
    """Something that a ground station wants done.

    Attributes
    ----------
    token
        Comes back with what became of it.
    do
        As the operator's desk names it.
    who
        For the log, and for people.
    force
        Whether the interlock is to be overridden.
    asked_s
        When it was asked: what is old is not carried out any more.
    """

    token: int
    do: str
    who: str
    force: bool
    asked_s: float


@dataclass(frozen=True, slots=True)
class Vehicle:
    """What the autopilot said last of itself, and when; None for what it never said.

    Attributes
    ----------
    armed, armed_s
        Whether its motors may turn.
    landed, landed_s
        MAV_LANDED_STATE.
    """

    armed: bool | None = None
    armed_s: float | None = None
    landed: int | None = None
    landed_s: float | None = None


@dataclass(frozen=True, slots=True)
class Hold:
    """Bring what is going on to rest, and keep it; `reason` is an ORI_REASON."""

    reason: int


@dataclass(frozen=True, slots=True)
class Tune:
    """Parameters that the loop has to know: part of the plan's speed, index of the rule for deploying, and how a
    lost link is taken when this process dies."""

    speed: float
    deploy_when: int
    hold_on_loss: bool


@dataclass(frozen=True, slots=True)
class Ready:
    """The links are open."""


@dataclass(frozen=True, slots=True)
class Alive:
    """Nothing hangs there."""


@dataclass(frozen=True, slots=True)
class Failed:
    """They cannot be opened."""

    text: str


# -- from the loop to the process --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Snapshot:
    """How the structure is.

    Attributes
    ----------
    time_s
        When, on the monotonic clock.
    beat
        Whether a heartbeat is due.
    state
        Index into ORI_STRUCTURE_STATE.
    stage, fault, fault_text
        Empty where there is none; `fault` is its kind.
    token
        Of the order that is being carried out or held; 0 for none.
    held_for
        ORI_REASON for which it was held, 0 for none or an operator's own word.
    at_rest, forced, may_fold, may_deploy
        As in ORI_STRUCTURE_FLAGS.
    fold, rate, remaining_s, progress, worst_tracking_rad
        As in ORI_STRUCTURE; NaN where there is none.
    folds, creases_rad
        Of every cell, and inner angles of the driven creases; NaN where not measured.
    commanded, confirmed, sensed
        Of every latch.
    """

    time_s: float
    beat: bool
    state: int
    stage: str
    fault: str
    fault_text: str
    token: int
    held_for: int
    at_rest: bool
    forced: bool
    may_fold: bool
    may_deploy: bool
    fold: float
    rate: float
    remaining_s: float
    progress: float
    worst_tracking_rad: float
    folds: tuple[float, ...]
    creases_rad: tuple[float, ...]
    commanded: tuple[bool, ...]
    confirmed: tuple[bool, ...]
    sensed: tuple[bool, ...]


@dataclass(frozen=True, slots=True)
class Attending:
    """The loop has begun with an `Ask`: its answer comes, however long connecting, arming or restarting takes."""

    token: int


@dataclass(frozen=True, slots=True)
class Answered:
    """What became of an `Ask`: begun, or not and why (an ORI_REASON and words)."""

    token: int
    took: bool
    reason: int
    why: str


@dataclass(frozen=True, slots=True)
class Ended:
    """How the order of that token ended: an `Outcome`, and its fault in words."""

    token: int
    outcome: str
    text: str


Word = Ask | Vehicle | Hold | Tune | Ready | Alive | Failed | Snapshot | Attending | Answered | Ended

_KINDS: dict[str, type[Word]] = {
    kind.__name__: kind
    for kind in (Ask, Vehicle, Hold, Tune, Ready, Alive, Failed, Snapshot, Attending, Answered, Ended)
}
_W = TypeVar("_W")


def item_of(word: Word) -> Item:
    """A word as it travels."""
    return (type(word).__name__, *(getattr(word, name) for name in word.__dataclass_fields__))


def word_of(item: Item) -> Word | None:
    """The word that came; None for what is the channel's own business."""
    kind = _KINDS.get(item[0])
    return None if kind is None else kind(*item[1:])
