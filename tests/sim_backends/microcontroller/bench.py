"""What these tests share: cores of their own on the ports, and a chip in lockstep that does what it is told."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from sim_backends.microcontroller.build import Port, firmware, missing_tools
from sim_backends.microcontroller.launcher import Microcontroller
from sim_backends.microcontroller.spec import WorldSpec

CORES = Path(__file__).parent / "cores"
FRAME = 320_000
"""Cycles."""


def need(port: Port) -> None:
    """Skip where a port cannot be built."""
    missing = missing_tools(port)
    if missing:
        pytest.skip(f"NOT TESTED, the port {port} needs: apt-get install {' '.join(missing)}")


class Probe:
    """A chip with the core that does what it is told."""

    def __init__(self, board: Microcontroller) -> None:
        self.board = board

    def tell(self, letter: str, which: int = 0, value: int = 0) -> None:
        self.board.feed(bytes((ord(letter), which, value & 255, value >> 8, 0)))

    def ask(self, letter: str, which: int = 0, value: int = 0) -> int:
        self.board.run(0.001)
        self.board.tapped()
        self.tell(letter, which, value)
        self.board.run(0.002)
        answer = self.board.tapped()
        assert answer[:1] == letter.encode()
        assert len(answer) == 9
        return int.from_bytes(answer[1:], "little")


@contextmanager
def probe(link: Path, world: WorldSpec | None = None, eeprom: Path | None = None) -> Iterator[Probe]:
    """In lockstep, ready."""
    need("atmega2560")
    program = firmware("atmega2560", CORES / "probe")
    with Microcontroller(world or WorldSpec(), link, program=program, eeprom=eeprom, lockstep=True) as board:
        board.wait_ready()
        board.tap()
        yield Probe(board)
