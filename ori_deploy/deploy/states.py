"""The controller's states and what leads from one to another, as data.

A pair that is not in the table cannot happen: a command that is not allowed is refused with the list of
those that are, an internal event that is not is a bug. The controller looks its guards and actions up by the
names in the table, and `ori_deploy.deploy.diagram` draws it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum, auto
from types import MappingProxyType

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
    RECOVER = auto()
    HOLD = auto()
    RESUME = auto()
    STOP = auto()
    EMERGENCY_STOP = auto()
    CLEAR_FAULT = auto()

    CONCERN = auto()
    RECOVERED = auto()
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
    Event.RECOVER,
    Event.HOLD,
    Event.RESUME,
    Event.STOP,
    Event.EMERGENCY_STOP,
    Event.CLEAR_FAULT,
)


class Guard(StrEnum):
    """What has to be so before an event may lead anywhere; the controller knows how to find out."""

    AT_REST = "at rest"
    OTHER_WAY = "the other command is being carried out"
    NO_CONCERN = "no servo hot, no supply low"


class Action(StrEnum):
    """What is done on the way; the controller knows how."""

    OPEN_BUS = "open the bus"
    CLOSE_BUS = "let go of the bus"
    TORQUE_ON = "hold where measured"
    TORQUE_OFF = "go limp"
    BEGIN = "start from the measured place"
    FOLLOW = "follow the checked way"
    TURN = "turn round on the path"
    GO_ON = "go on with the stage"
    RELAX_MAGNETS = "let electromagnets go"
    PRESS = "latch the fault; rest in two cycles"
    CLEAR = "forget the fault"
    NEXT_STAGE = "next stage"


@dataclass(frozen=True, slots=True)
class Rule:
    """One row of the table.

    Attributes
    ----------
    source, event
        In this state, when this happens.
    targets
        Where it leads; the action chooses among several.
    guard
        What has to be so; None: nothing more.
    action
        What is done before the state changes; None: nothing.
    """

    source: State
    event: Event
    targets: tuple[State, ...]
    guard: Guard | None = None
    action: Action | None = None


_S, _E, _G, _A = State, Event, Guard, Action


def _rules() -> Iterable[Rule]:
    """A latched fault outlives the connection; clearing leads to where the actuators are."""
    yield Rule(_S.DISCONNECTED, _E.CONNECT, (_S.READY, _S.FAULT), action=_A.OPEN_BUS)
    yield Rule(_S.DISCONNECTED, _E.EMERGENCY_STOP, (_S.DISCONNECTED,))  # nothing is commanded, nothing to stop
    yield Rule(_S.READY, _E.ARM, (_S.ARMED,), action=_A.TORQUE_ON)
    for source in (_S.ARMED, _S.STOWED):
        yield Rule(source, _E.DEPLOY, (_S.LATCHING,), action=_A.BEGIN)
    for source in (_S.ARMED, _S.DEPLOYED):
        yield Rule(source, _E.STOW, (_S.LATCHING,), action=_A.BEGIN)
    yield Rule(_S.ARMED, _E.RECOVER, (_S.LATCHING,), action=_A.FOLLOW)
    yield Rule(_S.MOVING, _E.RECOVERED, (_S.ARMED,), action=_A.NEXT_STAGE)
    for source in (_S.MOVING, _S.LATCHING, _S.HOLD):
        for command in (_E.DEPLOY, _E.STOW):
            guard = _G.NO_CONCERN if source is _S.HOLD else _G.OTHER_WAY
            yield Rule(source, command, (_S.MOVING, _S.LATCHING), guard, _A.TURN)
        yield Rule(source, _E.STOP, (_S.STOPPING,), action=_A.RELAX_MAGNETS)
    for source in (_S.MOVING, _S.LATCHING):
        yield Rule(source, _E.HOLD, (_S.HOLD,))
        yield Rule(source, _E.CONCERN, (_S.HOLD,))
    yield Rule(_S.HOLD, _E.RESUME, (_S.MOVING, _S.LATCHING), _G.NO_CONCERN, _A.GO_ON)
    yield Rule(_S.LATCHING, _E.RELEASED, (_S.MOVING,), action=_A.NEXT_STAGE)
    yield Rule(_S.MOVING, _E.ARRIVED, (_S.LATCHING,), action=_A.NEXT_STAGE)
    yield Rule(_S.LATCHING, _E.DEPLOYMENT_SECURED, (_S.DEPLOYED,), action=_A.NEXT_STAGE)
    yield Rule(_S.LATCHING, _E.STOWAGE_SECURED, (_S.STOWED,), action=_A.NEXT_STAGE)
    yield Rule(_S.STOPPING, _E.AT_REST, (_S.ARMED,))
    for source in (_S.ARMED, _S.DEPLOYED, _S.STOWED):
        yield Rule(source, _E.DISARM, (_S.READY,), _G.AT_REST, _A.TORQUE_OFF)
    yield Rule(_S.FAULT, _E.DISARM, (_S.FAULT,), _G.AT_REST, _A.TORQUE_OFF)
    for source in (_S.READY, _S.ARMED, _S.DEPLOYED, _S.STOWED, _S.FAULT):
        yield Rule(source, _E.DISCONNECT, (_S.DISCONNECTED,), _G.AT_REST, _A.CLOSE_BUS)
    yield Rule(_S.FAULT, _E.CLEAR_FAULT, (_S.ARMED, _S.READY, _S.DISCONNECTED), _G.AT_REST, _A.CLEAR)
    for source in State:
        if source is not _S.DISCONNECTED:
            yield Rule(source, _E.EMERGENCY_STOP, (_S.FAULT,), action=_A.PRESS)
        if source not in (_S.DISCONNECTED, _S.FAULT):
            yield Rule(source, _E.FAULT, (_S.FAULT,))


RULES: Mapping[tuple[State, Event], Rule] = MappingProxyType({(rule.source, rule.event): rule for rule in _rules()})
"""The whole table."""

IN_MOTION = frozenset({State.MOVING, State.LATCHING, State.HOLD, State.STOPPING})
"""States in which a command is being carried out or held."""


class IllegalCommand(OriDeployError):
    """A command that the state does not allow.

    Attributes
    ----------
    state, command, allowed
        The state, the command, and the commands that would have been allowed.
    """

    refused = True

    def __init__(self, state: State, command: str, because: str | None = None) -> None:
        self.state = state
        self.command = command
        self.allowed = allowed_commands(state)
        reason = because or f"not allowed in state {state}"
        super().__init__(f"{command}: {reason}; allowed in {state}: {', '.join(self.allowed) or 'nothing'}")


def allowed_commands(state: State) -> tuple[Event, ...]:
    """Commands that the table allows in a state."""
    return tuple(command for command in COMMANDS if (state, command) in RULES)


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

    def require(self, command: Event) -> Rule:
        """The rule of a command. Raises `IllegalCommand` unless the table allows it now."""
        rule = RULES.get((self.state, command))
        if rule is None:
            raise IllegalCommand(self.state, command)
        return rule

    def fire(self, event: Event, now: float, target: State | None = None) -> None:
        """Go where the event leads; `target` chooses where it can lead to several states."""
        targets = RULES[self.state, event].targets
        chosen = targets[0] if target is None else target
        if chosen not in targets or (target is None and len(targets) > 1):
            raise ValueError(f"{event} leads from {self.state} to {targets}, not to {target}")
        self._new.append(Transition(now, self.state, event, chosen))
        self.state = chosen

    def take_transitions(self) -> tuple[Transition, ...]:
        """Changes since the last call."""
        new, self._new = tuple(self._new), []
        return new
