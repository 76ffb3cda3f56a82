"""Work on single servos at the bench: find them, name them, set their rate, let them go limp.

Nothing here needs a rig. Every change is written while torque is off where that is needed, and verified.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from ori_deploy.actuators.bus import BusClosed, BusTimeout, CommandRefused, CorruptReply, HardwareError
from ori_deploy.actuators.dynamixel.line import MAX_ID, Pong, ServoLine, ServoRefused
from ori_deploy.actuators.dynamixel.readings import hardware_error
from ori_deploy.actuators.dynamixel.startup import ATTEMPTS, read, write
from ori_deploy.actuators.dynamixel.wiring import RAD_PER_COUNT
from ori_deploy.bench.meaning import TIME_BASED, Meaning, meaning
from ori_deploy.errors import InputError, begun
from ori_deploy.wire.dynamixel import BAUD_CODES, Register, ServoModel
from ori_deploy.wire.dynamixel.models import RPM
from ori_deploy.wire.dynamixel.registers import CENTRE_COUNT, LOAD_UNIT, VELOCITY_UNIT_RPM, VOLTAGE_UNIT_V

USUAL_BAUDS = (57_600, 1_000_000, 2_000_000, 3_000_000, 4_000_000)
"""Rates that servos are found at: the factory's, then those that a rig would use."""

RATE_TOLERANCE = 0.03
"""How far off two ends of a line may be and understand each other."""

_PONG_BYTES = 14
_BLOCK_START, _BLOCK_SIZE = 126, 21
"""Current or load, velocity, position, trajectories, voltage, temperature: the same in every model."""

_FLAGS_START, _FLAGS_SIZE = 64, 7
"""Torque enable first, hardware error status last."""


@dataclass(frozen=True, slots=True)
class Census:
    """Who answers at one rate.

    Attributes
    ----------
    baud
        The rate.
    pongs
        Servos that answer, by id.
    damaged
        Ids at which something answers that cannot be believed: most often two servos with one id.
    """

    baud: int
    pongs: tuple[Pong, ...]
    damaged: tuple[int, ...]

    @property
    def anybody(self) -> bool:
        """Whether anything answered, believable or not."""
        return bool(self.pongs or self.damaged)


def census(line: ServoLine, baud: int) -> Census:
    """Ask everybody at one rate; ids whose answers collide are looked for one by one.

    Raises
    ------
    BusClosed
        The port is gone, or cannot be set to this rate.
    """
    line.port.setBaudRate(baud)
    found = {pong.id: pong for pong in line.ping_all()}
    if line.port.heard == _PONG_BYTES * len(found):
        return Census(baud, tuple(found.values()), ())
    damaged = []
    for servo_id in (i for i in range(MAX_ID + 1) if i not in found):
        answer = _answer(line, servo_id)
        if isinstance(answer, CorruptReply):
            answer = _answer(line, servo_id)  # damaged once is an accident
        if isinstance(answer, Pong):
            found[servo_id] = answer
        elif isinstance(answer, CorruptReply):
            damaged.append(servo_id)
    return Census(baud, tuple(found[i] for i in sorted(found)), tuple(damaged))


def _answer(line: ServoLine, servo_id: int) -> Pong | BusTimeout | CorruptReply:
    try:
        return line.ping(servo_id)
    except (BusTimeout, CorruptReply) as wrong:
        return wrong


def find(line: ServoLine, servo_id: int, bauds: Sequence[int]) -> Pong:
    """Find one servo, and leave the port at its rate.

    Parameters
    ----------
    bauds
        Rates to try, in order.

    Raises
    ------
    BusTimeout, CorruptReply
        It answers at none of them, or never believably.
    """
    damaged: CorruptReply | None = None
    for baud in bauds:
        line.port.setBaudRate(baud)
        for _ in range(ATTEMPTS):
            answer = _answer(line, servo_id)
            if isinstance(answer, Pong):
                return answer
            if isinstance(answer, CorruptReply):
                damaged = answer
    if damaged is not None:
        raise damaged
    raise BusTimeout(
        f"servo {servo_id} does not answer on {line.port.path}; limit: tried {', '.join(map(str, bauds))} baud; "
        "remedy: check power, wiring and id; ori-deploy bus scan shows who is there"
    )


def find_all(line: ServoLine, bauds: Sequence[int]) -> tuple[Pong, ...]:
    """Everybody at the first rate at which there is somebody; the port is left at it.

    Raises
    ------
    BusTimeout
        Nobody answers.
    CommandRefused
        An id answers with damage only: what is meant for all would not reach it for certain.
    """
    for baud in bauds:
        found = everybody(line, baud)
        if found:
            return found
    raise nobody(line, bauds)


def everybody(line: ServoLine, baud: int) -> tuple[Pong, ...]:
    """Who answers at a rate, asked more than once: an answer that is lost leaves no trace in a broadcast.

    Raises
    ------
    BusClosed
        As `census`.
    CommandRefused
        As `find_all`.
    """
    found: dict[int, Pong] = {}
    for asked in range(ATTEMPTS):
        if asked > 1 and not found:
            break  # silent twice; the last time is for those whose neighbours answer
        one = census(line, baud)
        if one.damaged:
            raise CommandRefused(
                f"id {one.damaged[0]} answers with damage only at {baud} baud: two servos with one id, or bad "
                "wiring; remedy: ori-deploy doctor finds out; give ids instead of all to go on without it"
            )
        found |= {pong.id: pong for pong in one.pongs}
    return tuple(found[i] for i in sorted(found))


def nobody(line: ServoLine, bauds: Sequence[int]) -> BusTimeout:
    """What to raise when there is nobody at any rate."""
    return BusTimeout(
        f"nobody answers on {line.port.path}; limit: tried {', '.join(map(str, bauds))} baud; "
        "remedy: check power and wiring; ori-deploy bus scan tries every usual rate"
    )


def known_model(pong: Pong) -> ServoModel:
    """The model of a servo. Raises `CommandRefused` for one whose registers are not known."""
    if pong.model is None:
        raise CommandRefused(
            f"servo {pong.id} has model number {pong.model_number}, whose registers this package does not know; "
            "remedy: use DYNAMIXEL Wizard for it"
        )
    return pong.model


# -- registers -----------------------------------------------------------------------------------------

MAIN_REGISTERS = (
    "firmware_version", "baud_rate", "return_delay_time", "drive_mode", "operating_mode", "homing_offset",
    "temperature_limit", "max_voltage_limit", "min_voltage_limit", "current_limit", "max_position_limit",
    "min_position_limit", "torque_enable", "status_return_level", "hardware_error_status", "bus_watchdog",
    "goal_position", "present_current", "present_load", "present_velocity", "present_position",
    "present_input_voltage", "present_temperature",
)  # fmt: skip


def registers(line: ServoLine, pong: Pong, *, everything: bool) -> tuple[Meaning, ...]:
    """Registers of a servo and what they mean, by address. Those that its firmware does not have are left out.

    Parameters
    ----------
    everything
        All there are, instead of those that matter most.

    Raises
    ------
    BusError
        It does not answer, or is of a model that is not known.
    """
    model = known_model(pong)
    time_based = bool(read(line, pong.id, model.table.drive_mode) & TIME_BASED)
    wanted = [register for register in model.table if everything or register.name in MAIN_REGISTERS]
    found = []
    for register in wanted:
        with suppress(ServoRefused):
            found.append(meaning(model, register, read(line, pong.id, register), time_based=time_based))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What one servo says of itself at one moment.

    Attributes
    ----------
    id
        On the bus.
    position_rad, velocity_rad_s
        Of the shaft; 0 rad in the middle of the first turn.
    current_a
        Signed; None where the model measures load.
    load
        Part of the stall torque, signed; None where the model measures current.
    voltage_v, temperature_c
        Supply and housing.
    torque_on
        Whether it holds.
    error_bits
        Of the hardware error register.
    """

    id: int
    position_rad: float
    velocity_rad_s: float
    current_a: float | None
    load: float | None
    voltage_v: float
    temperature_c: float
    torque_on: bool
    error_bits: int

    @property
    def error(self) -> HardwareError:
        """What the bits mean."""
        return hardware_error(self.error_bits)


def snapshots(line: ServoLine, pongs: Sequence[Pong]) -> tuple[Snapshot | None, ...]:
    """Read several servos at once, in their order; None for one that does not answer believably.

    Raises
    ------
    BusClosed
        The port is gone.
    CommandRefused
        A model is not known.
    """
    models = [known_model(pong) for pong in pongs]
    ids = [pong.id for pong in pongs]
    state = line.sync_read(_BLOCK_START, _BLOCK_SIZE, ids).by_id
    flags = line.sync_read(_FLAGS_START, _FLAGS_SIZE, ids).by_id
    return tuple(
        _snapshot(i, model, state[i].data, flags[i].data) if i in state and i in flags else None
        for i, model in zip(ids, models, strict=True)
    )


def snapshot(line: ServoLine, pong: Pong) -> Snapshot:
    """Read one servo, patiently.

    Raises
    ------
    BusTimeout
        It does not answer believably.
    """
    for _ in range(ATTEMPTS):
        (found,) = snapshots(line, (pong,))
        if found is not None:
            return found
    raise BusTimeout(f"servo {pong.id}: no answer that can be believed; remedy: check power and wiring")


def _snapshot(servo_id: int, model: ServoModel, state: bytes, flags: bytes) -> Snapshot:
    table = model.table

    def value(register: Register) -> int:
        return register.decode(state[register.address - _BLOCK_START : register.end - _BLOCK_START])

    effort = value(table.effort)
    unit = model.current_unit_a
    return Snapshot(
        id=servo_id,
        position_rad=(value(table.present_position) - CENTRE_COUNT) * RAD_PER_COUNT,
        velocity_rad_s=value(table.present_velocity) * VELOCITY_UNIT_RPM * RPM,
        current_a=None if unit is None else effort * unit,
        load=effort * LOAD_UNIT if unit is None else None,
        voltage_v=value(table.present_input_voltage) * VOLTAGE_UNIT_V,
        temperature_c=float(value(table.present_temperature)),
        torque_on=flags[0] == 1,
        error_bits=flags[-1],
    )


# -- changes -------------------------------------------------------------------------------------------


def set_id(line: ServoLine, pong: Pong, new: int) -> Pong:
    """Give a servo another id, and make sure that it has it.

    Raises
    ------
    InputError
        The new id is the old one, or none that a servo can have.
    CommandRefused
        Somebody has the new id, torque is on, or the servo says no: nothing was changed. Or it did not take it.
    """
    if not 0 <= new <= MAX_ID or new == pong.id:
        raise InputError(
            "NEW: not an id that the servo can be given",
            value=new,
            limit=f"0 to {MAX_ID}, and not {pong.id}, which it has",
            remedy="choose another id",
        )
    model = known_model(pong)
    for _ in range(ATTEMPTS):
        answer = _answer(line, new)
        if not isinstance(answer, BusTimeout):
            raise CommandRefused(
                f"id {new} is taken: a servo answers at it; limit: one servo, one id; "
                "remedy: choose another id, or give that servo another one first"
            )
    _require_limp(line, pong, model)
    _write_unheard(line, pong.id, model.table.id, new)
    with begun():
        moved = next((answer for _ in range(ATTEMPTS) if isinstance(answer := _answer(line, new), Pong)), None)
        if moved is None or isinstance(_answer(line, pong.id), Pong):
            raise CommandRefused(
                f"servo {pong.id} did not take id {new}; "
                "remedy: ori-deploy bus scan shows who is there, then try again"
            )
    return moved


def set_baud(line: ServoLine, pongs: Sequence[Pong], new: int) -> tuple[Pong, ...]:
    """Set the rate of servos, and make sure that they answer at it; the port is left at the new rate.

    Raises
    ------
    InputError
        No servo has such a rate.
    CommandRefused
        A model or the adapter does not have this rate, torque is on, or the first does not take it: nothing was
        changed. Or a later one does not take it, or some do not answer at the new rate; the message names them.
    """
    if new not in BAUD_CODES:
        raise InputError(
            "BAUD: not a rate of these servos",
            value=new,
            limit=f"one of {', '.join(map(str, BAUD_CODES))}",
            remedy="choose one of them",
        )
    for pong in pongs:
        model = known_model(pong)
        if new not in model.bauds:
            raise CommandRefused(
                f"servo {pong.id}, an {model.name}, has no rate of {new} baud; "
                f"limit: {', '.join(map(str, model.bauds))}; remedy: choose a rate that all have"
            )
        _require_limp(line, pong, model)
    _require_rate(line, new)
    for k, pong in enumerate(pongs):
        _set_baud(line, pong, new, changed=pongs[:k])
    with begun():
        return _follow(line, pongs, new)


def _require_rate(line: ServoLine, new: int) -> None:
    """Try a rate on the adapter: a servo at one that it does not make would be out of reach."""
    old = line.port.getBaudRate()
    try:
        why = set_rate(line, new)
    finally:
        line.port.setBaudRate(old)
    if why is not None:
        raise CommandRefused(
            f"no servo was set to {new} baud, where {line.port.path} could not follow: {why}; "
            f"limit: within {100.0 * RATE_TOLERANCE:.0f} %; remedy: choose another rate, or another adapter"
        )


def set_rate(line: ServoLine, baud: int) -> str | None:
    """Set the adapter to a rate. Why it does not make it; None if it does.

    Raises
    ------
    BusClosed
        The port is gone.
    """
    try:
        line.port.setBaudRate(baud)
        made = line.port.made_baud()
    except BusClosed as wrong:
        line.port.check()
        return str(wrong)
    off = made is not None and abs(made - baud) > RATE_TOLERANCE * baud
    return f"the adapter makes {made}" if off else None


def _set_baud(line: ServoLine, pong: Pong, new: int, changed: Sequence[Pong]) -> None:
    try:
        _write_unheard(line, pong.id, known_model(pong).table.baud_rate, BAUD_CODES[new])
    except ServoRefused as wrong:
        if not changed:
            raise
        with begun():
            raise CommandRefused(
                f"{wrong}; servo {', '.join(str(other.id) for other in changed)} is at {new} baud already; "
                f"remedy: bring it back with ori-deploy bus set-baud ID {line.port.getBaudRate()} --baud {new}"
            ) from wrong


def _follow(line: ServoLine, pongs: Sequence[Pong], new: int) -> tuple[Pong, ...]:
    """Go to a rate that servos were set to, and see who answers there."""
    old = line.port.getBaudRate()
    line.port.setBaudRate(new)
    there = [next((a for _ in range(ATTEMPTS) if isinstance(a := _answer(line, p.id), Pong)), None) for p in pongs]
    lost = [str(pong.id) for pong, answer in zip(pongs, there, strict=True) if answer is None]
    if lost:
        raise CommandRefused(
            f"no answer at {new} baud from servo {', '.join(lost)}; remedy: ori-deploy bus scan shows whether it is "
            f"still at {old}; at the fastest rates check the length and the ends of the cable"
        )
    return tuple(answer for answer in there if answer is not None)


def _write_unheard(line: ServoLine, servo_id: int, register: Register, value: int) -> None:
    """Write what changes how a servo answers: whether its consent is understood is left open, to be verified."""
    try:
        line.write(servo_id, register, value)
    except (BusTimeout, CorruptReply):
        return


def _require_limp(line: ServoLine, pong: Pong, model: ServoModel) -> None:
    if read(line, pong.id, model.table.torque_enable):
        raise CommandRefused(
            f"servo {pong.id}: torque is on; limit: this register can be written only while it is off; "
            f"remedy: ori-deploy bus torque-off {pong.id}, with the structure held by hand"
        )


def torque_off(line: ServoLine, pongs: Sequence[Pong]) -> None:
    """Let servos go limp: all at once, then one by one until each confirms it.

    Raises
    ------
    BusError
        Some did not confirm; the message names them. All others are limp.
    """
    with begun():
        require_all_limp([str(servo_id) for servo_id in let_go(line, pongs)])


def let_go(line: ServoLine, pongs: Sequence[Pong]) -> tuple[int, ...]:
    """As `torque_off`, and return the ids of those that did not confirm it."""
    tables = {pong.id: known_model(pong).table for pong in pongs}
    first = known_model(pongs[0]).table.torque_enable
    with begun():
        line.sync_write(first.address, first.size, dict.fromkeys(tables, first.encode(0)))
        return tuple(i for i, table in tables.items() if not _confirms(line, i, table.torque_enable))


def require_all_limp(holding: Sequence[str]) -> None:
    """Raise `CommandRefused` when there are servos that did not confirm that torque is off."""
    if holding:
        raise CommandRefused(
            f"servo {', '.join(holding)} does not confirm that torque is off; "
            "remedy: take hold of the structure and switch the supply off"
        )


def _confirms(line: ServoLine, servo_id: int, register: Register) -> bool:
    """What it says when it is asked counts: it may be set to consent to no write."""
    with suppress(BusTimeout, CorruptReply, ServoRefused):
        write(line, servo_id, register, 0)
    try:
        return read(line, servo_id, register) == 0
    except (BusTimeout, CorruptReply, ServoRefused):
        return False
