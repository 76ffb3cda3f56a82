"""Talk with the device: polls, commands that are repeated until they are answered, and its clock.

Every question has a token and only the answer that carries it is believed; whatever else comes in meanwhile
is put where it belongs. A command that is repeated keeps its token, by which the device knows that it is the
same one and does not carry it out twice.
"""

from __future__ import annotations

import logging
import secrets
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from ori_deploy.actuators.bus import BusTimeout, CorruptReply
from ori_deploy.actuators.mcu.port import SerialPort
from ori_deploy.actuators.mcu.timebase import Timebase
from ori_deploy.clock import Clock
from ori_deploy.wire.mcu import (
    DEVICE,
    HOST,
    Ack,
    Event,
    FrameReader,
    FrameWriter,
    Info,
    LatchState,
    Message,
    Poll,
    State,
    StatusText,
    Timesync,
    dialect,
)

log = logging.getLogger(__name__)

ATTEMPTS = 4
"""Times that a command is sent before the device counts as silent."""

KNOCKS = 2
"""Times that a poll is sent within its timeout."""

SYNC_PERIOD_S = 0.2
"""How often the device's clock is asked for, along with a poll."""

OPEN_QUESTIONS = 16
"""Questions for the clock whose answers are still believed."""

EVENTS = 64
TOKENS = 1 << 16

_M = TypeVar("_M", bound=Message)


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that the device said by itself.

    Attributes
    ----------
    time_s
        When the host heard it.
    text
        In words.
    """

    time_s: float
    text: str


@dataclass(frozen=True, slots=True)
class Reports:
    """Answers to one poll; None for what was not asked for.

    Attributes
    ----------
    sent_s, received_s
        Host time of the question and of the last answer: what they tell is of some moment in between.
    """

    sent_s: float
    received_s: float
    state: State | None
    latches: LatchState | None
    info: Info | None


class McuLine:
    """One device on one port.

    Parameters
    ----------
    port
        Open while anything is asked.
    clock
        Stamps what comes and goes; real time.
    reply_timeout_s
        How long an answer may take.

    Attributes
    ----------
    timebase
        The device's clock.
    reader
        Counts what could not be believed.
    events
        The last things that the device said by itself.
    """

    def __init__(self, port: SerialPort, clock: Clock, reply_timeout_s: float) -> None:
        self.port = port
        self.timebase = Timebase()
        self.reader = FrameReader(DEVICE)
        self.events: deque[Notice] = deque(maxlen=EVENTS)
        self._writer = FrameWriter(HOST)
        self._clock = clock
        self._timeout = reply_timeout_s
        self._token = secrets.randbelow(TOKENS)  # not the one that another program used last
        self._asked: deque[int] = deque(maxlen=OPEN_QUESTIONS)
        self._next_sync_s = 0.0

    def begin(self) -> None:
        """Forget whatever came over an earlier connection."""
        self.reader = FrameReader(DEVICE)
        self.timebase.forget()
        self._asked.clear()
        self._next_sync_s = 0.0

    def send(self, message: Message) -> None:
        """Send what nobody answers."""
        self.port.write(self._writer.encode(message))

    def poll(self, what: int) -> Reports:
        """Ask for reports, and wait for one timeout.

        Raises
        ------
        BusTimeout
            Not all of them came in time.
        CorruptReply
            Nor did anything else that could be believed.
        BusClosed
            The port is gone.
        """
        token = self._next_token()
        wanted: dict[type[Message], Message | None] = {
            kind: None
            for bit, kind in (
                (dialect.ORI_POLL_STATE, State),
                (dialect.ORI_POLL_LATCHES, LatchState),
                (dialect.ORI_POLL_INFO, Info),
            )
            if what & bit
        }

        def take(message: Message) -> bool:
            if type(message) in wanted and getattr(message, "token", None) == token:
                wanted[type(message)] = message
            return all(wanted.values())

        now = self._clock.now()
        if now >= self._next_sync_s:  # before the poll, so that its answer is in when the poll's is
            self._ask_clock(now)
        sent = self._clock.now()
        noise = self._noise
        for _ in range(KNOCKS):  # again halfway: it may be lost, and is the sign of life that the device waits for
            self.send(Poll(token, what))
            if self._receive(take, self._timeout / KNOCKS):
                break
        else:
            self._raise_silence("poll", noise)
        return Reports(
            sent,
            self._clock.now(),
            _only(State, wanted.get(State)),
            _only(LatchState, wanted.get(LatchState)),
            _only(Info, wanted.get(Info)),
        )

    def poll_patiently(self, what: int, attempts: int = ATTEMPTS) -> Reports:
        """Ask for reports until they come. Raises as `poll` does when they never do."""
        for _ in range(attempts - 1):
            try:
                return self.poll(what)
            except (BusTimeout, CorruptReply) as lost:
                log.debug("asked again: %s", lost)
        return self.poll(what)

    def command(self, make: Callable[[int], Message], what: str, timeout_s: float | None = None) -> Ack:
        """Send a command until it is answered.

        Parameters
        ----------
        make
            The command with a token.
        what
            It, in words.
        timeout_s
            For one attempt, where the device needs longer than usual.

        Returns
        -------
        The answer; whether the device consents is for the caller to see.

        Raises
        ------
        BusTimeout, CorruptReply
            No answer; whether the command was carried out is not known.
        BusClosed
            The port is gone.
        """
        answer = self.ask(make, (Ack,), what, timeout_s)
        assert isinstance(answer, Ack)
        return answer

    def ask(
        self,
        make: Callable[[int], Message],
        kinds: tuple[type[Message], ...],
        what: str,
        timeout_s: float | None = None,
    ) -> Message:
        """Send a question until an answer of one of some kinds comes. Raises as `command` does."""
        token = self._next_token()
        message = make(token)
        found: list[Message] = []

        def take(answer: Message) -> bool:
            if isinstance(answer, kinds) and getattr(answer, "token", None) == token:
                found.append(answer)
            return bool(found)

        noise = self._noise
        for _ in range(ATTEMPTS):
            self.send(message)
            if self._receive(take, self._timeout if timeout_s is None else timeout_s):
                return found[0]
        self._raise_silence(what, noise)
        raise AssertionError("unreachable")

    def synchronise(self, exchanges: int) -> None:
        """Ask for the device's clock several times, one after the other. Those that are lost are left out."""
        for _ in range(exchanges):
            now = self._clock.now()
            stamp = self._ask_clock(now)
            self._receive(lambda _, stamp=stamp: stamp not in self._asked, self._timeout)  # type: ignore[misc]

    def listen(self, timeout_s: float) -> bool:
        """Send nothing, and tell whether the device says anything by itself."""
        return self._receive(lambda _: True, timeout_s)

    def take_waiting(self) -> None:
        """Take in what has arrived, without waiting."""
        self._receive(lambda _: False, 0.0)

    @property
    def _noise(self) -> int:
        return self.reader.skipped + self.reader.spoilt

    def _next_token(self) -> int:
        self._token = (self._token + 1) % TOKENS
        return self._token

    def _ask_clock(self, now: float) -> int:
        self._next_sync_s = now + SYNC_PERIOD_S
        stamp = round(1e9 * self._clock.now())
        self._asked.append(stamp)
        self.send(Timesync(0, stamp))
        return stamp

    def _receive(self, take: Callable[[Message], bool], timeout_s: float) -> bool:
        """Take messages in until `take` has what it wants; False when the time is over first."""
        deadline = self._clock.now() + timeout_s
        enough = False
        while True:
            left = deadline - self._clock.now()
            messages = self.reader.feed(self.port.read(max(left, 0.0)))
            if not messages and left <= 0.0:
                messages = self.reader.give_up()
            now = self._clock.now()
            for message in messages:
                self._put_away(message, now)
                enough = take(message) or enough
            if enough or left <= 0.0:
                return enough

    def _put_away(self, message: Message, now: float) -> None:
        if isinstance(message, Timesync):
            if message.ts1 in self._asked and message.tc1 > 0:
                self._asked.remove(message.ts1)
                self.timebase.add(1e-9 * message.ts1, max(now, 1e-9 * message.ts1), 1e-9 * message.tc1)
        elif isinstance(message, Event):
            self._note(now, event_text(message), logging.INFO)
        elif isinstance(message, StatusText):
            serious = message.severity <= dialect.MAV_SEVERITY_WARNING
            self._note(now, message.text, logging.WARNING if serious else logging.INFO)

    def _note(self, now: float, text: str, level: int) -> None:
        self.events.append(Notice(now, text))
        log.log(level, "%s: %s", self.port.path, text)

    def _raise_silence(self, what: str, noise: int) -> None:
        if self._noise > noise:
            raise CorruptReply(f"{what}: no answer could be believed; remedy: check the cable and the baud rate")
        raise BusTimeout(
            f"{what}: the microcontroller does not answer; remedy: check its supply, cable and baud rate"
        )


def event_text(event: Event) -> str:
    """An event in words."""
    kinds = dialect.enums["ORI_EVENT_CODE"]
    name = kinds[event.code].name.removeprefix("ORI_EVENT_").lower() if event.code in kinds else f"code {event.code}"
    return f"event {event.number} at {1e-6 * event.time_us:.3f} s: {name}, index {event.index}, value {event.value}"


def _only(kind: type[_M], message: Message | None) -> _M | None:
    return message if isinstance(message, kind) else None
