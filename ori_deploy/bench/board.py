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
from ori_deploy.errors import begun
from ori_deploy.wire.mcu import Disable, FaultClear, Info, LatchCommand, State, dialect

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

    def hinges_on(self) -> tuple[str, ...]:
        """Hinges that are on."""
        mask = self.state().outputs_on
        return tuple(self.naming.hinge(k) for k in range(self.info.hinges) if mask >> k & 1)

    def latches_engaged(self) -> tuple[str, ...]:
        """Latches that are told to hold."""
        return tuple(self.naming.latch(k) for k in _engaged(self))


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
        yield board_on(McuLine(serial, clock, BENCH_TIMEOUT_S), clock, boot_wait_s, *names)
    finally:
        serial.close()


def board_on(
    line: McuLine, clock: Clock, boot_wait_s: float, hinges: Sequence[str] = (), latches: Sequence[str] = ()
) -> Board:
    """The device on a line. Raises `BusTimeout` when there is none."""
    info = find_device(line, clock, boot_wait_s)
    # Turns nothing off, and is answered whatever the token was that another program used last.
    line.command(lambda token: Disable(token, 0), "greeting")
    clear = f"ori-deploy mcu clear-fault --port {line.port.path}"
    return Board(line, info, Naming(hinges, latches, clear, read_device(line)))


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


def release(found: Board, *, with_latches: bool) -> tuple[str, ...]:
    """Turn every hinge off, and with the latches let those go that are engaged. Returns these.

    Raises
    ------
    CommandRefused
        Something moves: all is as it was. Or a latch is not let go, with the hinges off.
    """
    every = (1 << found.info.hinges) - 1
    ack = found.line.command(lambda token: Disable(token, every), "torque off")
    if ack.result != dialect.ORI_ACCEPTED:
        raise refusal(ack, "torque stays on", WHOLE, found.naming)
    if not with_latches:
        return ()
    with begun():
        return _let_latches_go(found)


def _let_latches_go(found: Board) -> tuple[str, ...]:
    engaged = _engaged(found)
    for k in engaged:
        what = f"{found.naming.latch(k)} is not released"
        ack = found.line.command(lambda token, k=k: LatchCommand(token, k, 0), what)  # type: ignore[misc]
        if ack.result != dialect.ORI_ACCEPTED:
            raise refusal(ack, what, found.naming.latch(k), found.naming)
    return tuple(found.naming.latch(k) for k in engaged)


def _engaged(found: Board) -> list[int]:
    latches = found.line.poll_patiently(dialect.ORI_POLL_LATCHES).latches
    assert latches is not None
    return [k for k in range(found.info.latches) if latches.commanded >> k & 1]


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
