"""Servos at whichever rate they have: what is meant for all is not for those of one rate only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ori_deploy.actuators.dynamixel.line import Pong, ServoLine
from ori_deploy.bench.servos import everybody, known_model, let_go, nobody, require_all_limp, set_rate
from ori_deploy.errors import begun


@dataclass(frozen=True, slots=True)
class Found:
    """Who is on a line.

    Attributes
    ----------
    by_baud
        Rates at which somebody answers, and who.
    unasked
        Rates that the adapter does not make: whoever is set to one of them was not asked.
    """

    by_baud: tuple[tuple[int, tuple[Pong, ...]], ...]
    unasked: tuple[int, ...]

    @property
    def pongs(self) -> tuple[Pong, ...]:
        """Everybody; one id may be there at two rates."""
        return tuple(pong for _, pongs in self.by_baud for pong in pongs)


def find_at_every_rate(line: ServoLine, bauds: Sequence[int]) -> Found:
    """Ask everybody at each of these rates.

    Raises
    ------
    BusClosed
        The port is gone.
    BusTimeout
        Nobody answers.
    CommandRefused
        An id answers with damage only, or a servo is of a model that is not known.
    """
    unasked = tuple(baud for baud in bauds if set_rate(line, baud) is not None)
    asked = [baud for baud in bauds if baud not in unasked]
    answers = [(baud, everybody(line, baud)) for baud in asked]
    found = Found(tuple((baud, pongs) for baud, pongs in answers if pongs), unasked)
    if not found.pongs:
        raise nobody(line, asked)
    for pong in found.pongs:
        known_model(pong)
    return found


def torque_off_at_every_rate(line: ServoLine, found: Found) -> None:
    """Let servos go limp, rate by rate. Raises as `torque_off`; servos at the other rates are limp all the same."""
    holding = []
    with begun():
        for baud, pongs in found.by_baud:
            line.port.setBaudRate(baud)
            holding += [f"{servo_id} (at {baud} baud)" for servo_id in let_go(line, pongs)]
        require_all_limp(holding)
