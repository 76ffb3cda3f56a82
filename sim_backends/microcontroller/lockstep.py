"""A host in lockstep with the emulated chip: what it says and when is the same every time, to the cycle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ori_deploy.actuators.mcu.records import Record, config_hash
from ori_deploy.errors import OriDeployError
from ori_deploy.wire.mcu import (
    DEVICE,
    HOST,
    Ack,
    ConfigCommit,
    Enable,
    FrameReader,
    FrameWriter,
    Message,
    Poll,
    Setpoints,
    State,
    dialect,
)
from sim_backends.microcontroller.launcher import Microcontroller

FloatArray = NDArray[np.float64]

HINGES = 12
KNOT_S = 0.02
LEAD_KNOTS = 14
"""Knots that are kept queued: 280 ms."""

ANSWER_S = 0.5
"""Longest wait for an answer: a record of the configuration takes 0.16 s to be stored."""

STEP_S = 0.001

_M = TypeVar("_M", bound=Message)


class LockstepError(OriDeployError):
    """The chip did not answer, or refused."""


class LockstepHost:
    """Talks to a chip whose time stands still but for `run`.

    Parameters
    ----------
    board
        In lockstep, ready.
    """

    def __init__(self, board: Microcontroller) -> None:
        self._board = board
        self._writer, self._reader = FrameWriter(HOST), FrameReader(DEVICE)
        self._token = 0
        board.tap()

    def say(self, message: Message) -> None:
        """Send what is not answered."""
        self._board.feed(self._writer.encode(message))

    def ask(self, make: Callable[[int], Message], kind: type[_M]) -> _M:
        """Send, and let time pass until the answer is there.

        Raises
        ------
        LockstepError
            There is none.
        """
        self._token += 1
        self.say(make(self._token))
        for _ in range(round(ANSWER_S / STEP_S)):
            self._board.run(STEP_S)
            for message in self._reader.feed(self._board.tapped()):
                if isinstance(message, kind) and getattr(message, "token", None) == self._token:
                    return message
        raise LockstepError(f"no {kind.__name__} within {ANSWER_S:g} s")

    def command(self, make: Callable[[int], Message]) -> None:
        """Send a command, which has to be accepted."""
        answer = self.ask(make, Ack)
        if answer.result != dialect.ORI_ACCEPTED:
            raise LockstepError(f"refused with result {answer.result}, index {answer.index}, value {answer.value}")

    def state(self) -> State:
        """How the device is."""
        return self.ask(lambda token: Poll(token, dialect.ORI_POLL_STATE), State)

    def configure(self, records: Sequence[Record]) -> None:
        """Write a configuration."""
        for record in records:
            record.token = self._token + 1
            self.command(lambda _, record=record: record)  # type: ignore[misc]
            record.token = 0
        told = config_hash(records)
        self.command(lambda token: ConfigCommit(told, token))

    def enable(self, position_rad: FloatArray, stream: int = 1) -> None:
        """Turn all hinges on."""
        urad = _padded(1e6 * position_rad)
        self.command(lambda token: Enable(urad, token, (1 << len(position_rad)) - 1, stream))

    def follow(self, motion: Callable[[float], tuple[FloatArray, FloatArray]], knots: int, stream: int = 1) -> None:
        """Stream a motion from rest to rest.

        Parameters
        ----------
        motion
            Positions and velocities, each (n_hinges,), at a time since its beginning.
        knots
            Of 20 ms; the first and the last have to be at rest.
        """
        begin_us = self.state().time_us + round(1e6 * KNOT_S * LEAD_KNOTS)
        for number in range(knots):
            position, velocity = motion(number * KNOT_S)
            self.say(
                Setpoints(
                    [(begin_us + round(1e6 * number * KNOT_S)) % (1 << 32), 0],
                    _padded(1e6 * position) + [0] * HINGES,
                    _padded(1e3 * velocity) + [0] * HINGES,
                    number,
                    1,
                    stream,
                )
            )
            self.say(Poll(number, dialect.ORI_POLL_STATE))
            self._board.run(KNOT_S)
            self._board.tapped()
        for _ in range(2 * LEAD_KNOTS):  # a host that lives polls until all is at rest
            self.say(Poll(0, dialect.ORI_POLL_STATE))
            self._board.run(KNOT_S)
        self._board.tapped()


def _padded(values: FloatArray) -> list[int]:
    return [round(float(value)) for value in values] + [0] * (HINGES - len(values))
