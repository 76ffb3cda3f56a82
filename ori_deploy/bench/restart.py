"""Restart servos at the bench, which clears their errors, and know that they did.

A packet may be lost on its way, and a servo that was not restarted answers as one that is back: with its torque on.
"""

from __future__ import annotations

from dataclasses import dataclass

from ori_deploy.actuators.bus import BusError, BusTimeout, CommandRefused, CorruptReply, HardwareError
from ori_deploy.actuators.dynamixel.line import Pong, ServoLine, ServoRefused
from ori_deploy.actuators.dynamixel.readings import hardware_error
from ori_deploy.actuators.dynamixel.startup import ATTEMPTS, MARK_ADDRESS, read
from ori_deploy.bench.meaning import error_words
from ori_deploy.bench.servos import known_model, torque_off
from ori_deploy.clock import Clock
from ori_deploy.errors import begun
from ori_deploy.wire.dynamixel import Register

PATIENCE_S = 3.0
"""How long a servo may take to come back after it was told to restart."""

SETTLE_S = 0.1
"""A servo answers for a moment after it has consented; asked then, it would seem not to have restarted."""


@dataclass(frozen=True, slots=True)
class Reset:
    """A servo that was restarted.

    Attributes
    ----------
    id
        On the bus.
    error_bits
        What it reported before; 0 for none.
    """

    id: int
    error_bits: int


class NotRestarted(BusError):
    """A servo goes on, however often it was told to restart."""


def errors_of(line: ServoLine, pong: Pong) -> int:
    """Bits of a servo's hardware error register. Raises as `startup.read`."""
    return read(line, pong.id, known_model(pong).table.hardware_error_status)


def reset_error(line: ServoLine, pong: Pong, clock: Clock) -> Reset:
    """Let a servo go limp and restart it, which clears its errors; make sure that it did and that they are gone.

    Raises
    ------
    NotRestarted
        It answers, and has forgotten nothing.
    BusTimeout
        It did not come back.
    CommandRefused
        It does not go limp, took torque by itself (and is limp again), or reports an error again; or, `refused` where
        it was limp already, it does not keep what a restart would clear.
    """
    bits = errors_of(line, pong)
    holds = bool(read(line, pong.id, known_model(pong).table.torque_enable))
    with begun(already=holds):
        if holds:
            torque_off(line, [pong])  # a restart does it anyway, and some take no pointer while they hold
        witness = _plant(line, pong)
    with begun():
        _restart(line, pong, witness, clock)
        takes_torque = read(line, pong.id, known_model(pong).table.torque_enable)
        again = errors_of(line, pong)
        if takes_torque:
            torque_off(line, [pong])
            raise CommandRefused(
                f"servo {pong.id} took torque by itself when it restarted, and was let go of again"
                f"{f'; it reports {error_words(again)} again' if again else ''}; "
                "limit: limp, or it holds what nobody chose; "
                "remedy: write 0 to address 60, startup_configuration, with DYNAMIXEL Wizard"
            )
        if again:
            raise CommandRefused(
                f"servo {pong.id} reports {error_words(again)} again after a restart; "
                f"remedy: {_cause(again)}, then try again"
            )
    return Reset(pong.id, bits)


def _plant(line: ServoLine, pong: Pong) -> Register:
    """Write what only a restart clears, into the last indirect pointer but one, which nobody uses.

    The last one is the mark of who vouched for its turns.
    """
    block = known_model(pong).table.indirect
    witness = block.pointer(block.count - 2)
    for _ in range(ATTEMPTS):
        try:
            line.write(pong.id, witness, MARK_ADDRESS)
        except (BusTimeout, CorruptReply, ServoRefused):
            continue  # its consent is lost, or it gives none to writes: what it keeps is read
        break
    kept = read(line, pong.id, witness)
    if kept != MARK_ADDRESS:
        raise CommandRefused(
            f"servo {pong.id}: {witness.name} reads {kept} after {MARK_ADDRESS} was written, and whether it restarts "
            "could not be told; it is limp, and was not restarted; remedy: switch its supply off and on"
        )
    return witness


def _restart(line: ServoLine, pong: Pong, witness: Register, clock: Clock) -> None:
    """Ask until the witness is gone: for as long as the servo answers and has it, it was not heard."""
    begin = asked = clock.now()
    answers = True
    while True:
        if answers:
            if clock.now() > begin + PATIENCE_S:
                raise NotRestarted(_as_it_was(line, pong))
            asked = clock.now()
            _ask_to_restart(line, pong.id)
        elif clock.now() > asked + PATIENCE_S:
            raise BusTimeout(
                f"servo {pong.id} did not come back within {PATIENCE_S:g} s of its restart; "
                "remedy: check its supply and wiring"
            )
        clock.sleep_until(clock.now() + (SETTLE_S if answers else 0.5 * SETTLE_S))
        seen = _look(line, pong.id, witness)
        if seen is not None and seen != MARK_ADDRESS:
            return
        answers = seen is not None


def _as_it_was(line: ServoLine, pong: Pong) -> str:
    holds = read(line, pong.id, known_model(pong).table.torque_enable)
    return (
        f"servo {pong.id} did not restart: it answers, its torque is {'on' if holds else 'off'}; "
        f"limit: {PATIENCE_S:g} s; remedy: check its wiring, or take hold of the structure and switch its supply "
        "off and on"
    )


def _look(line: ServoLine, servo_id: int, register: Register) -> int | None:
    """Value of a register, or None while nothing comes that can be believed."""
    try:
        return line.read(servo_id, register)
    except (BusTimeout, CorruptReply):
        return None


def _ask_to_restart(line: ServoLine, servo_id: int) -> None:
    try:
        line.reboot(servo_id)
    except (BusTimeout, CorruptReply, ServoRefused):
        return  # some firmware is gone before it consents; whether it restarted shows in what it has forgotten


def _cause(bits: int) -> str:
    remedies = (
        (HardwareError.OVERHEATING, "let it cool"),
        (HardwareError.INPUT_VOLTAGE, "check the supply"),
        (HardwareError.OVERLOAD, "free its shaft"),
        (HardwareError.ENCODER, "replace it"),
        (HardwareError.ELECTRICAL_SHOCK, "check supply and motor, replace it"),
    )
    return " and ".join(text for flag, text in remedies if hardware_error(bits) & flag) or "replace it"
