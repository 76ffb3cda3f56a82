"""Running a controller on a tape: the same measurements in, what it decides held against what was decided then."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import CycleRecord, MotionResult
from ori_deploy.errors import FileError
from ori_deploy.motion.plan import Plan
from ori_deploy.telemetry.deck import Deck, Difference, Over, same
from ori_deploy.telemetry.tape import Decided, Entry, plain_error

_TELLING = ("fault", "state", "stage", "result", "error", "transitions", "goal", "call")
"""Kinds of differences, the most telling first; others come after them."""

_RESULT_DETAILS = frozenset({"observer_errors", "fault"})


@dataclass(frozen=True)
class Replay:
    """What came out.

    Attributes
    ----------
    cycles, decisions, commands
        How many were the same: cycles with all that the controller made of them, calls that command something,
        and words of the operator.
    differences
        Of the first cycle that is different, the most telling one first; empty when all is the same.
    gap
        Why the tape does not go on where records are missing, or "".
    """

    cycles: int
    decisions: int
    commands: int
    differences: tuple[Difference, ...]
    gap: str

    @property
    def nothing(self) -> bool:
        """Whether the tape gave nothing to compare: it cannot speak for the controller then."""
        return not (self.cycles or self.commands or self.differences)

    @property
    def same(self) -> bool:
        """Whether everything that was recorded was decided the same: what is missing may have been otherwise."""
        return not (self.differences or self.gap or self.nothing)


def replay(pieces: Iterable[bytes], plan: Plan, rig: ResolvedRig) -> Replay:
    """Make a controller for plan and rig, and run it on a tape until the end or the first difference.

    Parameters
    ----------
    pieces
        Of the tape, in order.
    plan, rig
        Those of the log, or others: what would have been decided with them, as far as the measurements go.

    Raises
    ------
    InputError
        Plan and rig do not fit each other, or the tape is damaged.
    """
    return _Player(pieces, plan, rig).play()


class _Player:
    def __init__(self, pieces: Iterable[bytes], plan: Plan, rig: ResolvedRig) -> None:
        self._deck = Deck(pieces, rig.hinge_ids, rig.latch_ids)
        self._plan, self._rig = plan, rig
        self._fault: dict[str, Any] | None = None  # as the log has it
        self._cycles = self._commands = 0

    def play(self) -> Replay:
        deck = self._deck
        try:
            journal = deck.journal if deck.call("has_journal", ()) else None
            controller = Controller(self._plan, self._rig, deck.bus, deck.clock, [self._judge], journal)
            while deck.peek() is not None and not deck.differences:
                self._next(controller, deck.take())
        except Over:
            pass
        if deck.damage is not None:
            raise deck.damage
        found = sorted(
            deck.differences, key=lambda d: _TELLING.index(d.what) if d.what in _TELLING else len(_TELLING)
        )
        return Replay(self._cycles, deck.decisions, self._commands, tuple(found), deck.gap)

    def _next(self, controller: Controller, entry: Entry) -> None:
        """Do what was done next to the controller."""
        if entry.kind == "p":
            getattr(controller, _public(entry.name))
        elif entry.kind == "s":
            self._command(controller, Entry("c", "step", (), {}))
        elif entry.kind == "c":
            self._command(controller, entry)
        elif entry.kind == "e" and entry.error is not None:
            pass  # interrupted after the cycle was decided
        else:
            self._deck.differs("call", "nothing more", entry.name)

    def _command(self, controller: Controller, entry: Entry) -> None:
        error: BaseException | None = None
        value: Any = None
        try:
            method = getattr(controller, _public(entry.name))
            value = method(*entry.arguments, **entry.value)
        except (Over, FileError):
            raise
        except BaseException as raised:
            if type(raised) is KeyboardInterrupt:
                raise  # somebody's who watches
            error = raised
        self._judge_end(entry.name, str(controller.state), error, value)

    def _judge_end(self, name: str, state: str, error: BaseException | None, value: Any) -> None:
        deck = self._deck
        if name == "step" and error is None:
            return
        end = deck.rest_of_cycle("e") if deck.differences else deck.peek()
        if end is None:
            raise Over
        if end.kind != "e":
            deck.differs("call", f"{name} is over", end.name)
            return
        deck.take()
        here = None if error is None else plain_error(error)
        if (here is None) != (end.error is None) or (here and end.error and here["type"] != end.error["type"]):
            deck.differs("error", _error(here), _error(end.error))
        if end.name != state:
            deck.differs("state", state, end.name)
        if isinstance(value, MotionResult) and isinstance(end.value, dict):
            self._judge_result(asdict(value), end.value)
        self._commands += not deck.differences

    def _judge_result(self, here: dict[str, Any], logged: dict[str, Any]) -> None:
        for key in here.keys() & logged.keys() - _RESULT_DETAILS:
            if not same(here[key], logged[key]):
                self._deck.differs("result", f"{key} {here[key]}", f"{logged[key]}")

    def _judge(self, record: CycleRecord) -> None:
        """Hold a cycle against the one of the log: the observer of the controller."""
        deck = self._deck
        entry = deck.rest_of_cycle("fx") if deck.differences else deck.peek()
        if entry is None:
            raise Over
        if entry.kind not in "fx":
            deck.differs("call", "the cycle is over", entry.name)
            entry = deck.rest_of_cycle("fx")
            if entry is None:
                raise Over
        logged_transitions: list[Any] = []
        if entry.kind == "f":
            deck.take()
            self._fault, logged_transitions = entry.value["fault"], entry.value["transitions"]
            entry = deck.peek()
        if entry is None or entry.kind != "x":
            raise Over
        deck.take()
        self._compare(record, entry.value, logged_transitions)
        if deck.differences:
            raise Over
        self._cycles += 1

    def _compare(self, record: CycleRecord, logged: Decided, transitions: list[Any]) -> None:
        deck = self._deck
        if deck.first_s != deck.first_s:  # not a number: this is the first cycle
            deck.first_s = logged.time_s
        deck.cycle = logged.index
        fault = None if record.fault is None else asdict(record.fault)
        pairs: list[tuple[str, Any, Any]] = [
            ("fault", _fault(fault), _fault(self._fault)),
            ("state", str(record.state), logged.state),
            ("stage", str(record.stage or ""), logged.stage),
            ("transitions", _way([asdict(change) for change in record.transitions]), _way(transitions)),
            ("place on the path", record.path_time_s, logged.path_time_s),
            ("rate", record.rate, logged.rate),
            ("rate limit", record.rate_limit, logged.rate_limit),
            ("commanded fold", record.commanded_fold, logged.commanded_fold),
            ("cycle", record.index, logged.index),
        ]
        for what, here, there in pairs:
            if not same(here, there):
                deck.differs(what, _shown(here), _shown(there))
        for cell, here, there in zip(self._rig.cell_ids, record.folds, logged.folds, strict=False):
            if not same(float(here), float(there)):
                deck.differs(f"measured fold of {cell}", f"{here:.9g}", f"{there:.9g}")
        deck.cycle = logged.index + (0 if deck.differences else 1)


def _public(name: str) -> str:
    """A name that may be looked up: a log may be somebody else's."""
    if name.startswith("_") or not hasattr(Controller, name):
        raise FileError(
            "the tape asks the controller for what it does not have",
            value=name,
            limit="commands of this version",
            remedy="replay it with the version that the log names",
        )
    return name


def _fault(fault: dict[str, Any] | None) -> str:
    return "none" if fault is None else f"{fault['kind']} of {fault['thing']}"


def _way(changes: list[Any]) -> str:
    return ", ".join(f"{c['source']} -> {c['target']}" for c in changes) or "none"


def _error(error: dict[str, str] | None) -> str:
    return "no error" if error is None else f"{error['type']}: {error['text']}"


def _shown(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(value) or "none"
