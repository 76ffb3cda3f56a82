"""Commands from ground stations: what each one wants, and what it is answered until the end.

MAVLink's command protocol, and what a structure needs on top of it. A command that is repeated while it is being
carried out is told how far it is; one that is repeated after its end, with a confirmation above 0 or at once, gets
the answer that it may not have heard. Two stations may want the same thing, and are both answered.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType

from ori_deploy.mav.links import Heard, Peer
from ori_deploy.mav.words import Answered, Ask, Attending, Ended, Snapshot, Word
from ori_deploy.wire.vehicle import dialect

FORCE = 21196.0
"""Of the second parameter: the number by which stations force arming, which nobody sends by mistake."""

LOOP_SILENT_S = 1.0
"""A control loop that has told nothing for so long is asked for nothing."""
ANSWER_S = 2.0
"""And one that has not begun with it by then never will: it takes nothing that old, but a STOP."""
LONGEST_ANSWER_S = 60.0
"""It answers by then what it has begun with: a link is opened, boards start, every servo is armed in its turn."""
SAME_ANSWER_S = 0.2
"""For so long after a refusal the same wish is refused without asking the loop: a flood does not reach it."""
PROGRESS_S = 0.5
SENT_AGAIN_S = 2.0
"""For so long stations send a command again that nobody answers, MAVSDK always with confirmation 0. What was begun
and then stopped or held is not begun again by that: a STOP is the last word."""
REMEMBERED = 64
REMEMBERED_S = 10.0
"""Answers that are kept for whoever did not hear them, and for how long: stations repeat within seconds."""


CommandMessage = dialect.MAVLink_command_long_message | dialect.MAVLink_command_int_message


class Work(StrEnum):
    """What can be wanted; by the names of the operator's desk."""

    DEPLOY = "deploy"
    FOLD = "stow"
    STOP = "stop"
    CLEAR_FAULT = "clear_fault"


COMMANDS: Mapping[int, Work] = MappingProxyType(
    {
        dialect.ORI_CMD_DEPLOY: Work.DEPLOY,
        dialect.ORI_CMD_FOLD: Work.FOLD,
        dialect.ORI_CMD_STOP: Work.STOP,
        dialect.ORI_CMD_CLEAR_FAULT: Work.CLEAR_FAULT,
    }
)
ALIAS = dialect.MAV_CMD_USER_1
ALIASED: Mapping[float, Work] = MappingProxyType(
    {1.0: Work.DEPLOY, 2.0: Work.FOLD, 3.0: Work.STOP, 4.0: Work.CLEAR_FAULT}
)
"""First parameter of MAV_CMD_USER_1, for stations that do not know our dialect."""

_WAIT = frozenset(
    {
        dialect.ORI_REASON_BUSY,
        dialect.ORI_REASON_AIRBORNE,
        dialect.ORI_REASON_LANDED_UNKNOWN,
        dialect.ORI_REASON_ARMED,
        dialect.ORI_REASON_ARMING_UNKNOWN,
        dialect.ORI_REASON_LOOP_SILENT,
    }
)
"""Refusals that may be over later."""
_NEVER = frozenset(
    {dialect.ORI_REASON_NOT_LISTED, dialect.ORI_REASON_PARAMETER, dialect.ORI_REASON_FORCE_NOT_ALLOWED}
)

_ENDS: Mapping[Work, int] = MappingProxyType(
    {Work.DEPLOY: dialect.ORI_STRUCTURE_DEPLOYED, Work.FOLD: dialect.ORI_STRUCTURE_STOWED}
)


@dataclass(frozen=True, slots=True)
class Asker:
    """Who gave a command, and which: answers go back by that name. `work` tells uses of the alias apart."""

    system: int
    component: int
    command: int
    work: Work | None

    def __str__(self) -> str:
        return f"system {self.system} component {self.component}"


@dataclass(frozen=True, slots=True)
class Verdict:
    """A MAV_RESULT and its ORI_REASON."""

    result: int
    reason: int = 0


@dataclass(slots=True)
class Job:
    """What is being carried out.

    Attributes
    ----------
    work, token, force
        What, by which name, and whether past the interlock.
    askers, since_s
        Who is to be answered, and where; and when each of them wanted it first.
    begun_s
        When it was asked for.
    attended, taken
        Whether the loop said that it is at it, and that it began.
    cancelled_s
        When its taking back was passed on last.
    told
        Percent that was told last, and when.
    """

    work: Work
    token: int
    force: bool
    begun_s: float
    askers: dict[Asker, Peer] = field(default_factory=dict)
    since_s: dict[Asker, float] = field(default_factory=dict)
    attended: bool = False
    taken: bool = False
    cancelled_s: float = -math.inf
    told: tuple[int, float] = (-1, -math.inf)


@dataclass(frozen=True, slots=True)
class _Told:
    """A last answer, when it was given, and until when the same command counts as sent again."""

    verdict: Verdict
    said_s: float
    again_until_s: float


class Commands:
    """Answers commands; what they want is asked of the control loop.

    Parameters
    ----------
    commanders
        System ids that may command.
    send
        Sends a message to a peer.
    ask
        Passes a word to the loop.
    tell
        Tells everybody in words, with a MAV_SEVERITY.
    first_token
        The loop may remember tokens of a process before this one.
    """

    def __init__(
        self,
        commanders: frozenset[int],
        send: Callable[[dialect.MAVLink_message, Peer], None],
        ask: Callable[[Word], None],
        tell: Callable[[int, str], None],
        first_token: int = 0,
    ) -> None:
        self._commanders = commanders
        self._send, self._ask, self._tell = send, ask, tell
        self._jobs: dict[Work, Job] = {}
        self._adrift: Job | None = None  # a motion that was given up here, and may be going on
        self._answers: OrderedDict[Asker, _Told] = OrderedDict()
        self._refusals: dict[tuple[Work, bool], tuple[Verdict, float]] = {}
        self._tokens = first_token
        self._snapshot: Snapshot | None = None
        self.refused = 0

    # -- what comes in -----------------------------------------------------------------------------------

    @property
    def motion(self) -> Job | None:
        """The deployment or the folding that is being carried out."""
        return self._jobs.get(Work.DEPLOY) or self._jobs.get(Work.FOLD)

    def heard(self, heard: Heard, message: CommandMessage, now: float) -> None:
        """A command of ours, addressed to us."""
        wish = _wish(message)
        asker = Asker(heard.system, heard.component, message.command, None if wish is None else wish[0])
        if heard.system not in self._commanders:
            self._deny(asker, heard.peer, dialect.ORI_REASON_NOT_LISTED)
        elif wish is None:
            self._deny(asker, heard.peer, dialect.ORI_REASON_PARAMETER)
        else:
            again = getattr(message, "confirmation", 0) > 0
            self._want(*wish, asker, heard.peer, again=again, now=now)

    def cancelled(self, heard: Heard, command: int, now: float) -> None:
        """A COMMAND_CANCEL: what it names is taken back; its askers hear of it when the structure is at rest."""
        if heard.system not in self._commanders:
            self.refused += 1
            return
        for job in tuple(self._jobs.values()):
            if job.work in (Work.DEPLOY, Work.FOLD) and any(asker.command == command for asker in job.askers):
                if now - job.cancelled_s > SAME_ANSWER_S:  # again, if the first time the loop could not
                    job.cancelled_s = now
                    self._ask(Ask(self._token(), str(Work.STOP), f"system {heard.system}", False, now))
                return
        for asker in reversed(self._answers):
            if (asker.system, asker.component, asker.command) == (heard.system, heard.component, command):
                self._repeat(asker, heard.peer, now)
                return

    # -- what the loop says --------------------------------------------------------------------------------

    def snapshot(self, snapshot: Snapshot, now: float) -> None:
        """How the structure is: progress, a stop that has come to rest, a motion that is held for a reason."""
        self._snapshot = snapshot
        stop = self._jobs.get(Work.STOP)
        if stop is not None and stop.taken and snapshot.at_rest:
            self._end(stop, Verdict(dialect.MAV_RESULT_ACCEPTED), now)
        held = _held(snapshot) and snapshot.at_rest
        if not held:
            self._take_up(snapshot.token)
        motion = self.motion
        if motion is None or snapshot.token != motion.token:
            return
        if held:
            self._let_go(motion, snapshot.held_for or dialect.ORI_REASON_HELD, now)
        else:
            self._progress(motion, now)

    def attending(self, attending: Attending) -> None:
        """The loop has begun with something that was asked."""
        for job in self._jobs.values():
            job.attended = job.attended or job.token == attending.token

    def answered(self, answered: Answered, now: float) -> None:
        """What became of something that was asked."""
        if answered.took and self._take_up(answered.token):
            # Whoever wanted it was told that nothing came of it.
            self._ask(Ask(self._token(), str(Work.STOP), "nobody who waits for it", False, now))
        job = next((job for job in self._jobs.values() if job.token == answered.token), None)
        if job is None:
            return
        if answered.took:
            job.taken = True
            if job.force:
                self._tell(dialect.MAV_SEVERITY_WARNING, f"{next(iter(job.askers))} FORCES {job.work.name.lower()}")
            if job.work is Work.CLEAR_FAULT:
                self._end(job, Verdict(dialect.MAV_RESULT_ACCEPTED), now)
            else:
                self._progress(job, now, always=True)
        elif job.work is Work.STOP:
            job.taken = True  # there is nothing to stop, or it is coming to rest already: accepted at rest
        else:
            self._tell(dialect.MAV_SEVERITY_WARNING, f"{job.work.name.lower()} refused: {answered.why}")
            verdict = refusal(answered.reason)
            self._refusals[job.work, job.force] = verdict, now
            self._end(job, verdict, now)

    def ended(self, ended: Ended, now: float) -> None:
        """How an order ended."""
        if self._adrift is not None and self._adrift.token == ended.token:
            self._adrift = None
        motion = self.motion
        if motion is None or motion.token != ended.token:
            return
        self._end(motion, _verdict(ended.outcome), now)

    def tick(self, now: float) -> None:
        """Give up on a loop that does not answer; say that it is at it while it is."""
        for job in tuple(self._jobs.values()):
            patience_s = LONGEST_ANSWER_S if job.attended else ANSWER_S
            if self._silent(now) if job.taken else now - job.begun_s > patience_s:
                self._let_go(job, dialect.ORI_REASON_LOOP_SILENT, now)
            elif job.attended and not job.taken and now - job.begun_s > PROGRESS_S:
                self._progress(job, now)

    # -- inside --------------------------------------------------------------------------------------------

    def _want(self, work: Work, force: bool, asker: Asker, peer: Peer, *, again: bool, now: float) -> None:
        job = self._jobs.get(work)
        if job is not None:
            job.askers[asker] = peer
            job.since_s.setdefault(asker, now)
            self._acknowledge(asker, peer, dialect.MAV_RESULT_IN_PROGRESS, self._percent(job), 0)
            return
        if (again or self._sent_again(asker, now)) and self._remembered(asker, now) is not None:
            self._repeat(asker, peer, now)
            return
        at_once = self._at_once(work, now) or self._refused_just_now(work, force, now)
        if at_once is not None:
            self._final(asker, peer, at_once, now)
            return
        job = Job(work, self._token(), force, now, {asker: peer}, {asker: now})
        self._jobs[work] = job
        self._ask(Ask(job.token, str(work), str(asker), force, now))

    def _deny(self, asker: Asker, peer: Peer, reason: int) -> None:
        """Refuse for good; not remembered, so that strangers cannot push out what others have not heard."""
        self.refused += 1
        self._acknowledge(asker, peer, dialect.MAV_RESULT_DENIED, 255, reason)

    def _at_once(self, work: Work, now: float) -> Verdict | None:
        """The answer where nothing has to be asked of the loop."""
        snapshot = self._snapshot
        if snapshot is None or self._silent(now):  # a STOP waits for the loop: it is done whenever that comes
            return None if work is Work.STOP else refusal(dialect.ORI_REASON_LOOP_SILENT)
        if work in _ENDS and self.motion is not None:
            return refusal(dialect.ORI_REASON_BUSY)
        if _ENDS.get(work) == snapshot.state:
            return Verdict(dialect.MAV_RESULT_ACCEPTED)
        if work is Work.STOP and snapshot.at_rest and self.motion is None and not _held(snapshot):
            return Verdict(dialect.MAV_RESULT_ACCEPTED, dialect.ORI_REASON_NOTHING_TO_DO)
        if work is Work.CLEAR_FAULT and not snapshot.fault:
            return Verdict(dialect.MAV_RESULT_ACCEPTED, dialect.ORI_REASON_NOTHING_TO_DO)
        return None

    def _refused_just_now(self, work: Work, force: bool, now: float) -> Verdict | None:
        verdict, said_s = self._refusals.get((work, force), (None, -math.inf))
        return verdict if now - said_s <= SAME_ANSWER_S else None

    def _silent(self, now: float) -> bool:
        return self._snapshot is None or now - self._snapshot.time_s > LOOP_SILENT_S

    def _token(self) -> int:
        self._tokens += 1
        return self._tokens

    def _percent(self, job: Job) -> int:
        snapshot = self._snapshot
        if snapshot is None or snapshot.token != job.token or not math.isfinite(snapshot.progress):
            return 255 if job.work in (Work.STOP, Work.CLEAR_FAULT) else 0
        return min(max(int(snapshot.progress), 0), 99)  # 100 is for ACCEPTED: latches come after the motion

    def _progress(self, job: Job, now: float, *, always: bool = False) -> None:
        percent, (before, told_s) = self._percent(job), job.told
        if always or now - told_s >= (PROGRESS_S if percent != before else 2.0 * PROGRESS_S):
            job.told = percent, now
            for asker, peer in job.askers.items():
                self._acknowledge(asker, peer, dialect.MAV_RESULT_IN_PROGRESS, percent, 0)

    def _let_go(self, job: Job, reason: int, now: float) -> None:
        """Tell of a failure of what is not over for the loop, or may not be."""
        self._end(job, Verdict(dialect.MAV_RESULT_FAILED, reason), now)
        if job.work in _ENDS:
            self._adrift = job

    def _take_up(self, token: int) -> bool:
        """Watch over a motion again that was given up, if that is its token: it goes on."""
        job = self._adrift
        if job is None or job.token != token or self.motion is not None:
            return False
        self._jobs[job.work], self._adrift = job, None
        return True

    def _end(self, job: Job, verdict: Verdict, now: float) -> None:
        del self._jobs[job.work]
        given_up = job.taken and verdict.result != dialect.MAV_RESULT_ACCEPTED
        for asker, peer in job.askers.items():
            again_until_s = job.since_s[asker] + SENT_AGAIN_S if given_up else -math.inf
            self._final(asker, peer, verdict, now, again_until_s)

    def _final(
        self, asker: Asker, peer: Peer, verdict: Verdict, now: float, again_until_s: float = -math.inf
    ) -> None:
        self._answers[asker] = _Told(verdict, now, again_until_s)
        self._answers.move_to_end(asker)
        while len(self._answers) > REMEMBERED:
            self._answers.popitem(last=False)
        self._say(asker, peer, verdict)

    def _remembered(self, asker: Asker, now: float) -> Verdict | None:
        """The last answer, while it is what a repeated command asks for."""
        told = self._answers.get(asker)
        if told is None or now - told.said_s > REMEMBERED_S:
            return None
        # Repeated because of a new one that was lost? Then the older one's answer may not be true any more.
        if told.verdict.result == dialect.MAV_RESULT_ACCEPTED:
            return told.verdict if self._still(asker, now) else None
        return None if asker.work is Work.STOP else told.verdict  # a STOP that failed is tried, however often

    def _sent_again(self, asker: Asker, now: float) -> bool:
        """Whether it is the sending again of a command that was begun and given up since."""
        told = self._answers.get(asker)
        return told is not None and now < told.again_until_s

    def _still(self, asker: Asker, now: float) -> bool:
        """Whether what a command that was accepted brought about is so: it would be accepted at once."""
        at_once = None if asker.work is None else self._at_once(asker.work, now)
        return at_once is not None and at_once.result == dialect.MAV_RESULT_ACCEPTED

    def _repeat(self, asker: Asker, peer: Peer, now: float) -> None:
        verdict = self._remembered(asker, now)
        if verdict is not None:
            self._say(asker, peer, verdict)

    def _say(self, asker: Asker, peer: Peer, verdict: Verdict) -> None:
        percent = 100 if verdict.result == dialect.MAV_RESULT_ACCEPTED else 255
        self._acknowledge(asker, peer, verdict.result, percent, verdict.reason)

    def _acknowledge(self, asker: Asker, peer: Peer, result: int, percent: int, reason: int) -> None:
        self._send(acknowledgement(asker.command, result, percent, reason, asker.system, asker.component), peer)


def acknowledgement(
    command: int, result: int, percent: int, reason: int, system: int, component: int
) -> dialect.MAVLink_command_ack_message:
    """A COMMAND_ACK to a system and component."""
    return dialect.MAVLink_command_ack_message(
        command=command,
        result=result,
        progress=percent,
        result_param2=reason,
        target_system=system,
        target_component=component,
    )


def refusal(reason: int) -> Verdict:
    """How a refusal for that reason is answered: whether trying again later can help, never, or perhaps."""
    if reason in _WAIT:
        return Verdict(dialect.MAV_RESULT_TEMPORARILY_REJECTED, reason)
    return Verdict(dialect.MAV_RESULT_DENIED if reason in _NEVER else dialect.MAV_RESULT_FAILED, reason)


def _verdict(outcome: str) -> Verdict:
    if outcome == "succeeded":
        return Verdict(dialect.MAV_RESULT_ACCEPTED)
    if outcome == "stopped":
        return Verdict(dialect.MAV_RESULT_CANCELLED, dialect.ORI_REASON_STOPPED)
    return Verdict(dialect.MAV_RESULT_FAILED, dialect.ORI_REASON_FAULT)


def _held(snapshot: Snapshot) -> bool:
    return snapshot.state == dialect.ORI_STRUCTURE_HOLD


def _wish(message: CommandMessage) -> tuple[Work, bool] | None:
    """What a command wants, and whether by force; None where a parameter is not one that it takes."""
    first, second = _number(message.param1), _number(message.param2)
    work = COMMANDS.get(message.command)
    if message.command == ALIAS:
        work = ALIASED.get(first)
    elif first != 0.0:
        return None
    if work is None or second not in (0.0, FORCE):
        return None
    force = second == FORCE
    return None if force and work not in (Work.DEPLOY, Work.FOLD) else (work, force)


def _number(parameter: float) -> float:
    """A parameter that is not used may be sent as NaN."""
    return 0.0 if math.isnan(parameter) else parameter
