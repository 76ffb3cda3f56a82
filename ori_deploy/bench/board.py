"""A microcontroller at the bench: find it, ask what it is, and clear its fault."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.mcu.faults import enum_name, fault_error, fault_name, refusal
from ori_deploy.actuators.mcu.line import McuLine
from ori_deploy.actuators.mcu.port import SerialPort
from ori_deploy.actuators.mcu.startup import find_device
from ori_deploy.clock import Clock
from ori_deploy.wire.mcu import Disable, FaultClear, Info, State, dialect

BENCH_TIMEOUT_S = 0.1
"""How late an answer may come at the bench, where nobody is in a hurry."""

BOOT_WAIT_S = 3.0
"""A board that restarts when its port is opened takes about two."""


@dataclass(frozen=True, slots=True)
class Board:
    """A device that answered.

    Attributes
    ----------
    line
        To talk with it.
    info
        What it said it is.
    """

    line: McuLine
    info: Info

    def state(self) -> State:
        """How it is now."""
        state = self.line.poll_patiently(dialect.ORI_POLL_STATE).state
        assert state is not None
        return state


@contextmanager
def board(port: str, baud: int, clock: Clock, boot_wait_s: float = BOOT_WAIT_S) -> Iterator[Board]:
    """The device behind a port, for this process alone.

    Raises
    ------
    BusClosed
        The port cannot be opened.
    BusTimeout
        No device answers.
    """
    serial = SerialPort(port, baud)
    serial.open()
    try:
        line = McuLine(serial, clock, BENCH_TIMEOUT_S)
        info = find_device(line, clock, boot_wait_s)
        # Turns nothing off, and is answered whatever the token was that another program used last.
        line.command(lambda token: Disable(token, 0), "greeting")
        yield Board(line, info)
    finally:
        serial.close()


def firmware_version(info: Info) -> str:
    """Major, minor and patch."""
    return ".".join(str(info.firmware >> shift & 0xFF) for shift in (24, 16, 8))


def reset_cause(info: Info) -> str:
    """Why it started last."""
    return enum_name("ORI_RESET_CAUSE", info.reset_cause).removeprefix("reset ")


def fault_words(state: State) -> str:
    """The latched fault in words, with its remedy; "none" without one."""
    wrong = fault_error(state, ())
    return "none" if wrong is None else f"{fault_name(state.fault)}: {wrong}"


def clear_fault(found: Board) -> str | None:
    """Clear the latched fault; nothing moves because of it.

    Returns
    -------
    Its name, or None when there was none.

    Raises
    ------
    CommandRefused
        It stays: its cause persists, or only a configuration or power ends it.
    """
    state = found.state()
    if state.fault == dialect.ORI_FAULT_NONE:
        return None
    name = fault_name(state.fault)
    ack = found.line.command(lambda token: FaultClear(token, state.fault), f"clearing the fault {name}")
    if ack.result != dialect.ORI_ACCEPTED:
        if ack.result == dialect.ORI_REFUSED_CAUSE:
            raise CommandRefused(f"the fault {name} stays: {fault_words(state)}")
        raise refusal(ack, f"the fault {name} stays", ())
    return name
