"""The controller's states and what leads from one to another, as data.

A pair that is not in the table cannot happen: a command that is not allowed is refused with the list of
those that are, an internal event that is not is a bug.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum, auto

from ori_deploy.errors import OriDeployError


class State(StrEnum):
    """What the controller is doing.

    DISCONNECTED: no link. READY: linked, not commanding; torque may be off. ARMED: holding its place,
    somewhere. MOVING: on the path. LATCHING: at an end of the path, working the latches. DEPLOYED: every
    latch confirmed. STOWED: measured at fold 0. HOLD: slowing to rest or at rest, on the operator's word.
    STOPPING: slowing to rest, the command given up. FAULT: slowing to rest or at rest, with a reason that
    must be cleared.
    """

    DISCONNECTED = auto()
    READY = auto()
    ARMED = auto()
    MOVING = auto()
    LATCHING = auto()
    DEPLOYED = auto()
    STOWED = auto()
    HOLD = auto()
    STOPPING = auto()
    FAULT = auto()


class Event(StrEnum):
    """What can happen. The first group are the operator's commands."""

    CONNECT = auto()
    DISCONNECT = auto()
    ARM = auto()
    DISARM = auto()
    DEPLOY = auto()
    STOW = auto()
    HOLD = auto()
    RESUME = auto()
    STOP = auto()
    CLEAR_FAULT = auto()

    RELEASED = auto()
    ARRIVED = auto()
    DEPLOYMENT_SECURED = auto()
    STOWAGE_SECURED = auto()
    AT_REST = auto()
    FAULT = auto()


COMMANDS: tuple[Event, ...] = (
    Event.CONNECT,
    Event.DISCONNECT,
    Event.ARM,
    Event.DISARM,
    Event.DEPLOY,
    Event.STOW,
    Event.HOLD,
    Event.RESUME,
    Event.STOP,
    Event.CLEAR_FAULT,
)

_S, _E = State, Event

TRANSITIONS: Mapping[tuple[State, Event], tuple[State, ...]] = {
    (_S.DISCONNECTED, _E.CONNECT): (_S.READY, _S.FAULT),  # a latched fault outlives the connection
    (_S.READY, _E.DISCONNECT): (_S.DISCONNECTED,),
    (_S.READY, _E.ARM): (_S.ARMED,),
    (_S.READY, _E.FAULT): (_S.FAULT,),
    (_S.ARMED, _E.DISCONNECT): (_S.DISCONNECTED,),
    (_S.ARMED, _E.DISARM): (_S.READY,),
    (_S.ARMED, _E.DEPLOY): (_S.LATCHING,),
    (_S.ARMED, _E.STOW): (_S.LATCHING,),
    (_S.ARMED, _E.FAULT): (_S.FAULT,),
    (_S.LATCHING, _E.RELEASED): (_S.MOVING,),
    (_S.LATCHING, _E.DEPLOYMENT_SECURED): (_S.DEPLOYED,),
    (_S.LATCHING, _E.STOWAGE_SECURED): (_S.STOWED,),
    (_S.LATCHING, _E.HOLD): (_S.HOLD,),
    (_S.LATCHING, _E.STOP): (_S.STOPPING,),
    (_S.LATCHING, _E.FAULT): (_S.FAULT,),
    (_S.MOVING, _E.ARRIVED): (_S.LATCHING,),
    (_S.MOVING, _E.HOLD): (_S.HOLD,),
    (_S.MOVING, _E.STOP): (_S.STOPPING,),
    (_S.MOVING, _E.FAULT): (_S.FAULT,),
    (_S.HOLD, _E.RESUME): (_S.MOVING, _S.LATCHING),  # whichever was held
    (_S.HOLD, _E.STOP): (_S.STOPPING,),
    (_S.HOLD, _E.FAULT): (_S.FAULT,),
    (_S.STOPPING, _E.AT_REST): (_S.ARMED,),
    (_S.STOPPING, _E.FAULT): (_S.FAULT,),
    (_S.DEPLOYED, _E.STOW): (_S.LATCHING,),
    (_S.DEPLOYED, _E.DISARM): (_S.READY,),
    (_S.DEPLOYED, _E.DISCONNECT): (_S.DISCONNECTED,),
    (_S.DEPLOYED, _E.FAULT): (_S.FAULT,),
    (_S.STOWED, _E.DEPLOY): (_S.LATCHING,),
    (_S.STOWED, _E.DISARM): (_S.READY,),
    (_S.STOWED, _E.DISCONNECT): (_S.DISCONNECTED,),
    (_S.STOWED, _E.FAULT): (_S.FAULT,),
    # Clearing leads to where the actuators are: all holding, some limp, or link gone.
    (_S.FAULT, _E.CLEAR_FAULT): (_S.ARMED, _S.READY, _S.DISCONNECTED),
    (_S.FAULT, _E.DISARM): (_S.FAULT,),
    (_S.FAULT, _E.DISCONNECT): (_S.DISCONNECTED,),
}

IN_MOTION = frozenset({State.MOVING, State.LATCHING, State.HOLD, State.STOPPING})
"""States in which a command is being carried out or held."""


class IllegalCommand(OriDeployError):
    """A command that the state does not allow.

    Attributes
    ----------
    state, command, allowed
        The state, the command, and the commands that would have been allowed.
    """

    def __init__(self, state: State, command: str, because: str | None = None) -> None:
        self.state = state
        self.command = command
        self.allowed = allowed_commands(state)
        reason = because or f"not allowed in state {state}"
        super().__init__(f"{command}: {reason}; allowed in {state}: {', '.join(self.allowed) or 'nothing'}")


def allowed_commands(state: State) -> tuple[Event, ...]:
    """Commands that the table allows in a state."""
    return tuple(command for command in COMMANDS if (state, command) in TRANSITIONS)


@dataclass(frozen=True, slots=True)
class Transition:
    """One change of state."""

    time_s: float
    source: State
    event: Event
    target: State


class Machine:
    """A state that changes only as the table says, and remembers how it did."""

    def __init__(self) -> None:
        self.state = State.DISCONNECTED
        self._new: list[Transition] = []

    def require(self, command: Event) -> None:
        """Raise `IllegalCommand` unless the table allows the command now."""
        if (self.state, command) not in TRANSITIONS:
            raise IllegalCommand(self.state, command)

    def fire(self, event: Event, now: float, target: State | None = None) -> None:
        """Go where the event leads; `target` chooses where it can lead to several states."""
        targets = TRANSITIONS[self.state, event]
        chosen = targets[0] if target is None else target
        if chosen not in targets or (target is None and len(targets) > 1):
            raise ValueError(f"{event} leads from {self.state} to {targets}, not to {target}")
        self._new.append(Transition(now, self.state, event, chosen))
        self.state = chosen

    def take_transitions(self) -> tuple[Transition, ...]:
        """Changes since the last call."""
        new, self._new = tuple(self._new), []
        return new
