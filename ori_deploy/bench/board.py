"""A microcontroller at the bench: find it, ask what it is, and clear its fault."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from ori_deploy.actuators.bus import ActuatorFault, CommandRefused
from ori_deploy.actuators.mcu.configure import read_device
from ori_deploy.actuators.mcu.faults import WHOLE, Naming, enum_name, fault_error, fault_name, refusal
from ori_deploy.actuators.mcu.line import McuLine
from ori_deploy.actuators.mcu.port import SerialPort
from ori_deploy.actuators.mcu.startup import find_device
from ori_deploy.clock import Clock
from ori_deploy.wire.mcu import Disable, FaultClear, Info, State, dialect

BENCH_TIMEOUT_S = 0.1
"""How late an answer may come at the bench, where nobody is in a hurry."""

BOOT_WAIT_S = 10.0
"""As `McuSettings.boot_wait_s`."""


@dataclass(frozen=True, slots=True)
class Board:
    """A device that answered.

    Attributes
    ----------
    line
        To talk with it.
    info
        What it said it is.
    naming
        What messages call its parts.
    """

    line: McuLine
    info: Info
    naming: Naming

    def state(self) -> State:
        """How it is now."""
        state = self.line.poll_patiently(dialect.ORI_POLL_STATE).state
        assert state is not None
        return state


@contextmanager
def board(
    port: str,
    baud: int,
    clock: Clock,
    boot_wait_s: float = BOOT_WAIT_S,
    names: tuple[Sequence[str], Sequence[str]] = ((), ()),
) -> Iterator[Board]:
    """The device behind a port, for this process alone; `names` are those of its hinges and latches, if known.

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
        yield Board(line, info, Naming(*names, f"ori-deploy mcu clear-fault --port {port}", read_device(line)))
    finally:
        serial.close()


def firmware_version(info: Info) -> str:
    """Major, minor and patch."""
    return ".".join(str(info.firmware >> shift & 0xFF) for shift in (24, 16, 8))


def reset_cause(info: Info) -> str:
    """Why it started last."""
    return enum_name("ORI_RESET_CAUSE", info.reset_cause).removeprefix("reset ")


def fault_words(state: State, naming: Naming) -> str:
    """The latched fault in words, with its remedy; "none" without one."""
    wrong = fault_error(state, naming)
    return "none" if wrong is None else f"{fault_name(state.fault)}: {_alone(wrong)}"


def _alone(wrong: ActuatorFault) -> str:
    """Without the microcontroller's name, where everything is about it."""
    return str(wrong).removeprefix(f"{WHOLE}: ")


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
            wrong = fault_error(state, found.naming)
            assert wrong is not None
            raise CommandRefused(f"the fault {name} stays: {_alone(wrong)}")
        raise refusal(ack, f"the fault {name} stays", WHOLE, found.naming)
    return name
