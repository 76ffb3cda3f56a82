"""What a command is about: its stages, which of them is being carried out, and since when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.actuators.rig import Latch
from ori_deploy.deploy.latching import LatchWork
from ori_deploy.deploy.states import Event, State
from ori_deploy.motion.plan import DEPLOY_STAGES, STOW_STAGES, StageName

RECOVER_STAGES: tuple[StageName, ...] = ("free", "recover")

STAGES: Mapping[Event, tuple[StageName, ...]] = MappingProxyType(
    {Event.DEPLOY: DEPLOY_STAGES, Event.STOW: STOW_STAGES, Event.RECOVER: RECOVER_STAGES}
)

_TURNED: Mapping[StageName, StageName] = MappingProxyType(
    {
        "unlock": "unlatch",
        "open": "close",
        "latch": "unlatch",
        "unlatch": "unlock",
        "close": "open",
        "lock": "unlock",
    }
)
"""Where the other command takes over from each stage: nothing moves before every latch of both ends is open."""

_MOVES = frozenset({"open", "close", "recover"})
_CLOSES = frozenset({"latch", "lock"})

_ENDINGS: Mapping[StageName, Event] = MappingProxyType(
    {"latch": Event.DEPLOYMENT_SECURED, "lock": Event.STOWAGE_SECURED}
)


@dataclass(frozen=True, slots=True)
class Counts:
    """What had happened so far when a command was given."""

    time_s: float
    cycles: int
    overruns: int
    lost_replies: int


class Errand:
    """A command that is being carried out, or none.

    Attributes
    ----------
    command
        DEPLOY, STOW, RECOVER, or None when nothing was commanded since arming.
    stage
        Which stage of it; None when there is none left, or nothing to do.
    started_s
        When the stage began, or was resumed.
    work
        The round of latch commands of this stage, once it was sent.
    since
        Counts when the command was given.
    """

    def __init__(self) -> None:
        self.command: Event | None = None
        self.stage: StageName | None = None
        self.started_s = 0.0
        self.work: LatchWork | None = None
        self.since = Counts(0.0, 0, 0, 0)

    def begin(self, command: Event, now: float, since: Counts) -> None:
        """Take on a command from its first stage."""
        self.command, self.stage, self.since = command, STAGES[command][0], since
        self.restart_clock(now)

    def turn(self, command: Event, now: float, since: Counts) -> None:
        """Give the present command up for the other one, from the stage that takes over."""
        taken_over = None if self.stage is None else _TURNED.get(self.stage)
        if taken_over is None:
            raise ValueError(f"{command} cannot take over from stage {self.stage}")
        self.command, self.stage, self.since = command, taken_over, since
        self.restart_clock(now)

    def drop(self) -> None:
        """There is no command any more."""
        self.command = self.stage = None

    def next_stage(self, now: float) -> None:
        """Go on to the stage that follows; None after the last."""
        if self.command is not None and self.stage is not None:
            stages = STAGES[self.command]
            following = stages[stages.index(self.stage) + 1 :]
            self.stage = following[0] if following else None
        self.restart_clock(now)

    def restart_clock(self, now: float) -> None:
        """Latches get their full time from now, and are commanded anew."""
        self.work, self.started_s = None, now

    @property
    def direction(self) -> float:
        """1 towards fold 1, -1 towards fold 0."""
        return -1.0 if self.command is Event.STOW else 1.0

    def folds(self, fold: float) -> tuple[float, float]:
        """Folds between which this stage goes, from where the motion is: the journal's range."""
        if self.stage in ("open", "close"):
            return fold, 1.0 if self.stage == "open" else 0.0
        return fold, fold

    @property
    def recovering(self) -> bool:
        """Whether cells are being brought into step."""
        return self.stage in RECOVER_STAGES

    @property
    def closing(self) -> bool:
        """Whether latches are being closed."""
        return self.stage in _CLOSES

    @property
    def state(self) -> State:
        """The state in which this stage is carried out."""
        return State.MOVING if self.stage in _MOVES else State.LATCHING

    @property
    def ending(self) -> Event:
        """What it means that the latches of this stage are done."""
        return _ENDINGS.get(self.stage, Event.RELEASED) if self.stage is not None else Event.RELEASED

    def latches(self, rig: ResolvedRig) -> tuple[tuple[Latch, ...], tuple[Latch, ...]]:
        """Latches to work on in this stage, and those of the other end that have to be open."""
        here, others = rig.latches, rig.stow_locks
        if self.stage == "free":
            return here + others, ()
        if self.stage in ("unlock", "lock"):
            here, others = others, here
        return here, () if self.closing else others
