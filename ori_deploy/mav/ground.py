"""The ground's side: command a structure on a vehicle's network, and see how it is.

>>> with GroundStation("udpout:127.0.0.1:14560") as station:
...     print(station.deploy(progress=print))
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from types import TracebackType
from typing import Self

from ori_deploy.errors import OriDeployError
from ori_deploy.mav.commands import FORCE
from ori_deploy.mav.links import Heard, Links, parse_link
from ori_deploy.mav.signing_key import load_key
from ori_deploy.wire.vehicle import Party, Signing, dialect, text_of

GROUND = Party(255, dialect.MAV_COMP_ID_MISSIONPLANNER)
BEAT_S = 1.0
ANSWER_S = 1.0
ATTEMPTS = 5
"""How often a command is sent that is not answered, and how long each time is waited for."""
PROGRESS_S = 5.0
"""Silence in the middle of a motion after which the command is repeated, to hear how far it is or how it ended."""
FIND_S = 5.0
WAIT_S = 0.1
REFUSED = "refused"
"""Reason of a controller that refused: a failure in MAVLink's words, and nothing was begun."""


class State(IntEnum):
    """ORI_STRUCTURE_STATE."""

    DISCONNECTED = dialect.ORI_STRUCTURE_DISCONNECTED
    READY = dialect.ORI_STRUCTURE_READY
    ARMED = dialect.ORI_STRUCTURE_ARMED
    MOVING = dialect.ORI_STRUCTURE_MOVING
    LATCHING = dialect.ORI_STRUCTURE_LATCHING
    DEPLOYED = dialect.ORI_STRUCTURE_DEPLOYED
    STOWED = dialect.ORI_STRUCTURE_STOWED
    HOLD = dialect.ORI_STRUCTURE_HOLD
    STOPPING = dialect.ORI_STRUCTURE_STOPPING
    FAULT = dialect.ORI_STRUCTURE_FAULT


class Result(IntEnum):
    """MAV_RESULT, as far as it comes from this component."""

    ACCEPTED = dialect.MAV_RESULT_ACCEPTED
    TEMPORARILY_REJECTED = dialect.MAV_RESULT_TEMPORARILY_REJECTED
    DENIED = dialect.MAV_RESULT_DENIED
    UNSUPPORTED = dialect.MAV_RESULT_UNSUPPORTED
    FAILED = dialect.MAV_RESULT_FAILED
    IN_PROGRESS = dialect.MAV_RESULT_IN_PROGRESS
    CANCELLED = dialect.MAV_RESULT_CANCELLED


_STATES, _RESULTS = frozenset(State), frozenset(Result)


class NoAnswer(OriDeployError):
    """The structure is not on the network, or does not answer."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a command ended.

    Attributes
    ----------
    result, reason
        MAV_RESULT, and ORI_REASON in words ("none" where there is nothing to say).
    """

    result: Result
    reason: str

    @property
    def accepted(self) -> bool:
        """Whether it was carried out to its end."""
        return self.result is Result.ACCEPTED

    @property
    def refused(self) -> bool:
        """Whether nothing was begun."""
        told_so = self.result in (Result.TEMPORARILY_REJECTED, Result.DENIED, Result.UNSUPPORTED)
        return told_so or (self.result is Result.FAILED and self.reason == REFUSED)

    def __str__(self) -> str:
        said = self.result.name.lower().replace("_", " ")
        return said if self.reason == "none" else f"{said}: {self.reason}"


@dataclass(frozen=True, slots=True)
class Structure:
    """How the structure is.

    Attributes
    ----------
    state, stage, fault
        What it is doing; the last two empty where there is none.
    fold, fold_lowest, fold_highest
        Commanded fold, and the lowest and highest measured; NaN where not known.
    progress
        Percent of the command, or None.
    remaining_s
        At full speed; NaN where there is none.
    locked, at_rest, may_fold, may_deploy, forced
        As ORI_STRUCTURE_FLAGS.
    creases, latches, latches_confirmed
        How many.
    worst_tracking_rad
        Largest distance of a driven crease from its goal so far.
    """

    state: State
    stage: str
    fault: str
    fold: float
    fold_lowest: float
    fold_highest: float
    progress: int | None
    remaining_s: float
    locked: bool
    at_rest: bool
    may_fold: bool
    may_deploy: bool
    forced: bool
    creases: int
    latches: int
    latches_confirmed: int
    worst_tracking_rad: float


@dataclass(frozen=True, slots=True)
class Text:
    """What the structure says in words; `severity` is MAV_SEVERITY, 0 the worst."""

    severity: int
    text: str


class GroundStation:
    """A ground station for one structure; for `with`.

    Parameters
    ----------
    link
        `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcpin:HOST:PORT`, `tcp:HOST:PORT` or `serial:DEVICE:BAUD`.
    party
        Who the station is.
    vehicle, component
        System id of the vehicle, component id of the structure.
    key_file
        Key to sign with; None for no signing.
    beyond_loopback
        Whether to listen to other machines.

    Raises
    ------
    InputError
        The link or the key cannot be used.
    """

    def __init__(
        self,
        link: str,
        *,
        party: Party = GROUND,
        vehicle: int = 1,
        component: int = dialect.MAV_COMP_ID_SERVO1,
        key_file: Path | None = None,
        beyond_loopback: bool = False,
    ) -> None:
        self.link = link
        self._them = vehicle, component
        self._links = Links(
            [parse_link(link, beyond_loopback)], party, None if key_file is None else Signing(load_key(key_file))
        )
        self._party = party
        self._beat_due = -math.inf
        self._text = bytearray()

    def __enter__(self) -> Self:
        self._links.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._links.__exit__(kind, error, trace)

    # -- commands --------------------------------------------------------------------------------------

    def deploy(
        self, *, force: bool = False, progress: Callable[[int], None] | None = None, timeout_s: float = 300.0
    ) -> Verdict:
        """Deploy and lock it, and wait for the end.

        Parameters
        ----------
        force
            Past the interlock, where the component allows that.
        progress
            Called with percent.
        timeout_s
            How long to wait in all.

        Raises
        ------
        NoAnswer
            It is not there, or falls silent.
        """
        return self._command(dialect.ORI_CMD_DEPLOY, force, progress, timeout_s)

    def fold(
        self, *, force: bool = False, progress: Callable[[int], None] | None = None, timeout_s: float = 300.0
    ) -> Verdict:
        """Unlock and fold it, as `deploy`; refused unless the vehicle is on the ground and disarmed."""
        return self._command(dialect.ORI_CMD_FOLD, force, progress, timeout_s)

    def stop(self, *, timeout_s: float = 30.0) -> Verdict:
        """Bring it to rest along its path, and wait until it is."""
        return self._command(dialect.ORI_CMD_STOP, False, None, timeout_s)

    def clear_fault(self, *, timeout_s: float = 30.0) -> Verdict:
        """Forget its fault; nothing moves."""
        return self._command(dialect.ORI_CMD_CLEAR_FAULT, False, None, timeout_s)

    # -- how it is -------------------------------------------------------------------------------------

    def status(self, *, timeout_s: float = FIND_S) -> Structure:
        """How it is now. Raises `NoAnswer`."""
        for told in self.monitor(timeout_s=timeout_s):
            if isinstance(told, Structure):
                return told
        raise self._absent(timeout_s)

    def monitor(self, *, timeout_s: float = math.inf) -> Iterator[Structure | Text]:
        """What it tells, as it comes, for so long."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            for heard in self._hear():
                told = self._told(heard)
                if told is not None:
                    yield told

    # -- parameters --------------------------------------------------------------------------------------

    def parameters(self, *, timeout_s: float = FIND_S) -> dict[str, float]:
        """All of them. Raises `NoAnswer` when not all have come in time."""
        values: dict[int, tuple[str, float]] = {}
        for _ in self._attempts(dialect.MAVLink_param_request_list_message(*self._them), timeout_s):
            for heard in self._hear():
                message = heard.message
                if isinstance(message, dialect.MAVLink_param_value_message) and message.param_index < 65535:
                    values[message.param_index] = text_of(message.param_id), float(message.param_value)
                    if len(values) == message.param_count:
                        return {name: value for _, (name, value) in sorted(values.items())}
        raise self._absent(timeout_s)

    def set_parameter(self, name: str, value: float, *, timeout_s: float = FIND_S) -> float:
        """Set one; the value that holds then, which is the old one where the new one was refused."""
        message = dialect.MAVLink_param_set_message(
            *self._them, name.encode()[:16], value, dialect.MAV_PARAM_TYPE_REAL32
        )
        for _ in self._attempts(message, timeout_s):
            for heard in self._hear():
                told = heard.message
                if isinstance(told, dialect.MAVLink_param_error_message) and text_of(told.param_id) == name:
                    if told.error == dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST:
                        raise NoAnswer(f"{name}: the structure has no such parameter")
                elif isinstance(told, dialect.MAVLink_param_value_message) and text_of(told.param_id) == name:
                    return float(told.param_value)
        raise self._absent(timeout_s)

    # -- inside ------------------------------------------------------------------------------------------

    def _command(
        self, command: int, force: bool, progress: Callable[[int], None] | None, timeout_s: float
    ) -> Verdict:
        """MAVLink's command protocol: repeated until it is answered, followed until it has ended."""
        deadline = time.monotonic() + timeout_s
        self._find(deadline)
        sent, due = 0, -math.inf
        begun = False
        while time.monotonic() < deadline:
            if time.monotonic() >= due:
                if sent == ATTEMPTS:
                    break
                self._links.send(self._command_long(command, force, sent), None)
                sent, due = sent + 1, time.monotonic() + ANSWER_S
            for answer in self._acknowledged(command):
                if answer.result not in _RESULTS:
                    raise NoAnswer(f"{self._name()} answered with MAV_RESULT {answer.result}: not the structure")
                if answer.result != dialect.MAV_RESULT_IN_PROGRESS:
                    return Verdict(Result(answer.result), reason_name(answer.result_param2))
                begun, sent, due = True, 1, time.monotonic() + PROGRESS_S
                if progress is not None and answer.progress <= 100:
                    progress(answer.progress)
        what = "fell silent before it ended" if begun else "did not answer"
        raise NoAnswer(f"{self._name()} on {self.link} {what}; remedy: see what it does with `ori-deploy gcs status`")

    def _command_long(self, command: int, force: bool, confirmation: int) -> dialect.MAVLink_message:
        return dialect.MAVLink_command_long_message(
            *self._them, command, confirmation, 0.0, FORCE if force else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        )

    def _acknowledged(self, command: int) -> Iterator[dialect.MAVLink_command_ack_message]:
        us = self._party.system, self._party.component
        for heard in self._hear():
            message = heard.message
            if (
                isinstance(message, dialect.MAVLink_command_ack_message)
                and message.command == command
                and (message.target_system, message.target_component) == us
            ):
                yield message

    def _find(self, deadline: float) -> None:
        """Wait until it is heard: nothing is sent into the dark."""
        until = min(deadline, time.monotonic() + FIND_S)
        while time.monotonic() < until:
            if self._hear():
                return
        raise self._absent(FIND_S)

    def _attempts(self, message: dialect.MAVLink_message, timeout_s: float) -> Iterator[None]:
        """Send a message again and again; the caller looks for the answer in between."""
        deadline = time.monotonic() + timeout_s
        self._find(deadline)
        due = -math.inf
        while time.monotonic() < deadline:
            if time.monotonic() >= due:
                self._links.send(message, None)
                due = time.monotonic() + ANSWER_S
            yield

    def _hear(self) -> list[Heard]:
        """What the structure said within a moment, and our own sign of life when it is due."""
        if time.monotonic() >= self._beat_due:
            self._beat_due = time.monotonic() + BEAT_S
            self._links.send(_heartbeat(), None)
        heard = self._links.receive(WAIT_S)
        return [one for one in heard if (one.system, one.component) == self._them]

    def _told(self, heard: Heard) -> Structure | Text | None:
        message = heard.message
        if isinstance(message, dialect.MAVLink_ori_structure_message):
            return structure_of(message) if message.state in _STATES else None  # of another version
        if isinstance(message, dialect.MAVLink_statustext_message):
            return self._worded(message)
        return None

    def _worded(self, message: dialect.MAVLink_statustext_message) -> Text | None:
        """A text, once its last part has come."""
        if message.chunk_seq == 0:
            self._text.clear()
        text = text_of(message.text)
        self._text += text.encode()
        if message.id != 0 and len(text) == 50:
            return None
        whole = self._text.decode()
        self._text.clear()
        return Text(message.severity, whole)

    def _absent(self, waited_s: float) -> NoAnswer:
        return NoAnswer(
            f"{self._name()} is not heard on {self.link}; waited: {waited_s:g} s; remedy: start `ori-deploy serve` "
            "with the other end of that link"
        )

    def _name(self) -> str:
        return f"system {self._them[0]} component {self._them[1]}"


def reason_name(reason: int) -> str:
    """ORI_REASON in words."""
    entry = dialect.enums["ORI_REASON"].get(reason)
    return f"reason {reason}" if entry is None else entry.name.removeprefix("ORI_REASON_").lower().replace("_", " ")


def structure_of(message: dialect.MAVLink_ori_structure_message) -> Structure:
    """ORI_STRUCTURE as a value."""
    flags = message.flags
    return Structure(
        state=State(message.state),
        stage=text_of(message.stage),
        fault=text_of(message.fault),
        fold=message.fold,
        fold_lowest=message.fold_lowest,
        fold_highest=message.fold_highest,
        progress=None if message.progress > 100 else message.progress,
        remaining_s=message.remaining_s,
        locked=bool(flags & dialect.ORI_STRUCTURE_LOCKED),
        at_rest=bool(flags & dialect.ORI_STRUCTURE_AT_REST),
        may_fold=bool(flags & dialect.ORI_STRUCTURE_MAY_FOLD),
        may_deploy=bool(flags & dialect.ORI_STRUCTURE_MAY_DEPLOY),
        forced=bool(flags & dialect.ORI_STRUCTURE_FORCED),
        creases=message.creases,
        latches=message.latches,
        latches_confirmed=message.latches_confirmed,
        worst_tracking_rad=message.worst_tracking,
    )


def _heartbeat() -> dialect.MAVLink_message:
    return dialect.MAVLink_heartbeat_message(
        type=dialect.MAV_TYPE_GCS,
        autopilot=dialect.MAV_AUTOPILOT_INVALID,
        base_mode=0,
        custom_mode=0,
        system_status=dialect.MAV_STATE_ACTIVE,
        mavlink_version=3,
    )
